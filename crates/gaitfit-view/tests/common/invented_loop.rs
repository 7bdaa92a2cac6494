//! A loop of two rounds with invented but plausible numbers.

use crate::go2;
use gaitfit_view::fit::{Fit, LogSummary, OptimizerRun, Parameter, Signal, SignalDistribution};
use gaitfit_view::loop_report::{
    Difference, DriftTrials, HeldOut, JointDistance, LoopReport, Round, Tracking,
};
use gaitfit_view::replay::Replay;
use gaitfit_view::training::{SeedCurve, Series};
use gaitfit_view::{Drift, Estimate};
use gaitfit_view::{Link, Setting};

/// A small deterministic stand-in for noise, uniform in ±1.
fn noise(i: usize, stream: usize) -> f64 {
    let mut x = (i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (stream as u64 + 7).wrapping_mul(0xD1B5_4A32_D192_ED03);
    // Shifts and multiplications mix the bits as in SplitMix64, so that neighbours get unrelated numbers.
    x ^= x >> 29;
    x = x.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x ^= x >> 32;
    (x as f64 / u64::MAX as f64) * 2.0 - 1.0
}

fn setting(name: &str, value: &str) -> Setting {
    Setting { name: name.into(), value: value.into() }
}

/// Two rounds with `seeds` optimiser runs each over `generations`; the replay has `frames` frames.
pub fn two_rounds(seeds: usize, generations: usize, frames: usize) -> LoopReport {
    LoopReport {
        title: "go2-mujoco: two rounds".into(),
        robot: "go2 in MuJoCo with worn joints".into(),
        created: "2026-11-21 16:00 UTC".into(),
        wall_seconds: 1123.0,
        before: "π₀".into(),
        after: "π₂".into(),
        target: "target".into(),
        measured: "on the robot (MuJoCo): 10000 trajectories of 4 s".into(),
        rounds: vec![
            round("Round 1: π₀ → π₁", 0, seeds, generations),
            round("Round 2: π₁ → π₂", 1, seeds, generations),
        ],
        best: None,
        tracking: tracking(),
        differences: vec![Difference {
            policy: "π₂".into(),
            against: "π₀".into(),
            simulator: "target".into(),
            paired: true,
            linear_velocity_error: Estimate { mean: -0.0927, ci95: 0.0021 },
            angular_velocity_error: Estimate { mean: -0.1337, ci95: 0.0033 },
            fall_rate: Estimate { mean: -0.0323, ci95: 0.0041 },
        }],
        bought: "The fit gave 39 % less tracking error than domain randomisation.".into(),
        drift: drift(),
        replay: Some(Replay {
            note: "π₀ and π₂ under the same commands on the target.".into(),
            dt: go2::DT,
            robots: vec![go2::trot("π₀", frames, 0.7), go2::trot("π₂", frames, 0.98)],
            ..Replay::default()
        }),
        doubts: Vec::new(),
        facts: vec![setting("Rounds", "2"), setting("Stopped because", "the cost stopped falling")],
        links: vec![Link { text: "Fine-tuned policy".into(), path: "round-2/policy.safetensors".into() }],
        warnings: vec!["The log's clock jumps by 0.3 s in trajectory 12.".into()],
        settings: vec![setting("collect.trajectories", "64"), setting("adapt.cost", "wass")],
        versions: vec![setting("gaitfit", "0.1.0")],
    }
}

fn tracking() -> Vec<Tracking> {
    let estimate = |mean: f64, share: f64| Estimate { mean, ci95: mean * share };
    let on = |policy: &str, simulator: &str, linear, angular, reward, falls| Tracking {
        policy: policy.into(),
        simulator: simulator.into(),
        trajectories: 10_000,
        linear_velocity_error: estimate(linear, 0.012),
        angular_velocity_error: estimate(angular, 0.014),
        reward: estimate(reward, 0.004),
        fall_rate: estimate(falls, 0.12),
    };
    vec![
        on("π₀", "target", 0.2143, 0.2871, 4.31, 0.0384),
        on("π₁", "target", 0.1377, 0.1812, 5.22, 0.0092),
        on("π₂", "target", 0.1216, 0.1534, 5.41, 0.0061),
        on("fine-tuned on the truth", "target", 0.1189, 0.1502, 5.46, 0.0055),
        on("π₀", "adapted", 0.2087, 0.2764, 4.38, 0.0341),
        on("π₂", "adapted", 0.1174, 0.1466, 5.49, 0.0049),
    ]
}

fn drift() -> Vec<DriftTrials> {
    let commands = [
        ("+x 0.5 m/s", [0.5, 0.0, 0.0]),
        ("−x 0.5 m/s", [-0.5, 0.0, 0.0]),
        ("+y 0.5 m/s", [0.0, 0.5, 0.0]),
        ("−y 0.5 m/s", [0.0, -0.5, 0.0]),
        ("+yaw 1 rad/s", [0.0, 0.0, 1.0]),
        ("−yaw 1 rad/s", [0.0, 0.0, -1.0]),
    ];
    let trial = |k: usize, skill: f64, bend: f64| {
        let (name, command) = commands[k];
        let time = |i: usize| 4.0 * i as f64 / 200.0;
        let side = bend * (0.6 + 0.4 * noise(k, 3)) * if k.is_multiple_of(2) { 1.0 } else { -0.6 };
        let path = |i: usize| {
            let t = time(i);
            let along = [skill * command[0] * t, skill * command[1] * t];
            let sway = 0.012 * (t * 13.0).sin();
            [along[0] - side * command[1] * t * t + sway * 0.3, along[1] + side * command[0] * t * t + sway]
        };
        let intended = |i: usize| [command[0] * time(i), command[1] * time(i)];
        Drift {
            name: name.into(),
            command,
            trials: 10,
            // One fall of the worse policy, so that the page has one to show.
            falls: u32::from(skill < 0.9 && k == 3),
            error: [path(200)[0] - intended(200)[0], path(200)[1] - intended(200)[1], side * 2.0],
            ci95: [0.021, 0.034, 0.016],
            path: (0..=200).map(path).collect(),
            intended: (0..=200).map(intended).collect(),
        }
    };
    let policy = |name: &str, skill: f64, bend: f64| DriftTrials {
        policy: name.into(),
        simulator: "target".into(),
        trials: (0..commands.len()).map(|k| trial(k, skill, bend)).collect(),
    };
    vec![policy("π₀", 0.83, 0.12), policy("π₂", 0.97, 0.025)]
}

fn round(name: &str, index: usize, seeds: usize, generations: usize) -> Round {
    // Only the log of the first round has a gap in its commands.
    let uncovered =
        if index == 0 { vec!["backward walking with a turn to the right".into()] } else { vec![] };
    // The commands of the gap that the line above names.
    let within = |c: &[f64; 3]| index > 0 || !(c[0] < -0.2 && c[2] < -0.1);
    let command = |i: usize| [0, 1, 2].map(|k| noise(i, 40 + 10 * index + k));
    Round {
        name: name.into(),
        wall_seconds: 520.0 + 80.0 * index as f64,
        log: Some(LogSummary {
            source: format!("round-{}/log", index + 1),
            trajectories: 64,
            seconds: 256.0,
            falls: if index == 0 { 3 } else { 0 },
            cut_seconds: if index == 0 { 6.4 } else { 0.0 },
            commands: (0..64).map(command).filter(within).collect(),
            uncovered,
            ..LogSummary::default()
        }),
        fits: vec![fit(index, seeds, generations)],
        distributions: distributions(index),
        held_out: (index == 1).then(held_out),
        fine_tuning: (0..2).map(|seed| fine_tuning(index, seed)).collect(),
    }
}

fn held_out() -> HeldOut {
    let distances = ["FL_hip_joint", "FL_calf_joint"].map(|joint| JointDistance {
        joint: joint.into(),
        slides: false,
        signal: Signal::Velocity,
        nominal: 0.61,
        fitted: 0.083,
        floor: 0.072,
    });
    HeldOut {
        sentence:
            "The fit explains 16 held-out logs as well as other seconds of the same walks do: 0.0121 against \
                   0.0118 ± 0.0009."
                .into(),
        explained: Some(true),
        gain: Some(5.3),
        distances: distances.to_vec(),
    }
}

/// Name, unit, value, truth, spread, upper bound, and whether the log identifies it.
type Invented = (&'static str, &'static str, f64, f64, f64, f64, bool);

fn fit(index: usize, seeds: usize, generations: usize) -> Fit {
    let (nominal, floor) = ([1.62, 1.48][index], [0.094, 0.071][index]);
    let run = |seed: usize| {
        let curve = |scale: f64, end: f64, stream: usize| -> Vec<f64> {
            let decay = |g: usize| (-(g as f64) / (16.0 + 3.0 * noise(seed, stream))).exp();
            (0..generations).map(|g| end + scale * decay(g) * (1.0 + 0.3 * noise(g, stream + seed))).collect()
        };
        OptimizerRun {
            label: format!("seed {}", seed + 1),
            best_cost: floor,
            best: curve(1.1, floor + 0.004 * seed as f64, 60),
            mean: curve(1.9, 1.15 * floor, 80),
            sigma: (0..generations).map(|g| (-(g as f64) / 40.0 + 0.2 * noise(g / 3, seed)).exp()).collect(),
        }
    };
    let invented: [Invented; 7] = [
        ("frictionloss_hip", "N·m", 0.197, 0.2, 0.004, 0.5, true),
        ("frictionloss_thigh", "N·m", 0.153, 0.15, 0.006, 0.5, true),
        ("frictionloss_calf", "N·m", 0.106, 0.1, 0.009, 0.5, true),
        ("armature_hip", "kg·m²", 0.0504, 0.05, 0.0021, 0.5, true),
        ("armature_thigh", "kg·m²", 0.0987, 0.1, 0.0034, 0.5, true),
        // A value that the log does not identify is far from the truth.
        ("armature_calf", "kg·m²", 0.121, 0.075, 0.061, 0.5, false),
        ("delay", "s", 0.0104, 0.01, 0.0004, 0.04, true),
    ];
    let parameter = |(i, row): (usize, &Invented)| {
        let (name, unit, value, truth, spread, upper, identified) = *row;
        Parameter {
            name: name.into(),
            unit: unit.into(),
            value,
            lower: 0.0,
            upper,
            start: 0.0,
            spread,
            per_run: (0..seeds).map(|s| (value + 1.4 * spread * noise(i, s)).max(0.0)).collect(),
            identified: Some(identified),
            interval: Some(if identified {
                [value - 2.2 * spread, value + 2.6 * spread]
            } else {
                [0.012, 0.31]
            }),
            truth: Some(truth),
            ..Parameter::default()
        }
    };
    Fit {
        cost_name: "Wass".into(),
        nominal_cost: nominal,
        fitted_cost: floor * 1.02,
        runs: (0..seeds).map(run).collect(),
        parameters: invented.iter().enumerate().map(parameter).collect(),
    }
}

fn distributions(index: usize) -> Vec<SignalDistribution> {
    let joints = ["FL", "FR", "RL", "RR"]
        .into_iter()
        .flat_map(|leg| ["hip", "thigh", "calf"].map(|part| format!("{leg}_{part}")));
    joints
        .enumerate()
        .flat_map(|(j, joint)| {
            let centre = [0.05, 0.85, -1.5][j % 3];
            let reach = [0.12, 0.35, 0.5][j % 3];
            let wave = |lag: f64, gain: f64, stream: usize| -> Vec<f64> {
                let at = |i: usize| i as f64 * 0.13 + j as f64 - lag;
                let swing = |i: usize| at(i).sin() + 0.35 * (2.0 * at(i) + 0.4).sin();
                (0..1500).map(|i| gain * swing(i) + 0.12 * noise(i, 500 + stream + j)).collect()
            };
            let side = |stream: usize, gain: f64, offset: f64| -> [Vec<f64>; 3] {
                let position = wave(0.0, gain * reach, stream).iter().map(|q| centre + offset + q).collect();
                let velocity =
                    wave(1.5, gain * 11.0 * reach, 2 * stream).iter().map(|v| v * v.abs() / 4.0).collect();
                [position, velocity, wave(0.4, gain * 1.2, 3 * stream)]
            };
            let log = side(1, 1.0, 0.0);
            let nominal = side(2, 1.24 - 0.08 * index as f64, 0.06 * noise(j, 9));
            let adapted = side(3, 1.02, 0.004 * noise(j, 10));
            [Signal::Position, Signal::Velocity, Signal::Action].into_iter().enumerate().map(
                move |(k, signal)| SignalDistribution {
                    distance_nominal: [0.061, 0.47, 0.19][k],
                    distance_fitted: [0.0052, 0.038, 0.021][k],
                    ..SignalDistribution::from_samples(&joint, signal, &log[k], &nominal[k], &adapted[k])
                },
            )
        })
        .collect()
}

fn fine_tuning(index: usize, seed: usize) -> SeedCurve {
    let series = |name: &str, unit: &str, from: f64, to: f64| Series {
        name: name.into(),
        unit: unit.into(),
        values: (0..150)
            .map(|i| {
                let done = 1.0 - (-(i as f64) / (30.0 + 8.0 * noise(seed, 1))).exp();
                (from + (to - from) * done) * (1.0 + 0.03 * noise(i, 31 * seed + name.len() + index))
            })
            .collect(),
        ..Series::default()
    };
    SeedCurve {
        seed: seed as u64 + 1,
        iteration: (0..150).collect(),
        progress: vec![
            series("reward", "", 21.0, 27.5),
            series("linear-velocity error", "m/s", 0.21, 0.117),
            series("angular-velocity error", "rad/s", 0.28, 0.147),
        ],
        rewards: vec![series("action rate", "", -0.3, -0.12)],
        diagnostics: vec![series("KL", "", 0.02, 0.009), series("explained variance", "", 0.4, 0.94)],
        ..SeedCurve::default()
    }
}
