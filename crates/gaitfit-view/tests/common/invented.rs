//! Reports filled with invented but plausible numbers.

use crate::go2;
use gaitfit_view::Drift;
use gaitfit_view::evaluation::{EvaluationReport, Ground, Histogram, Measure};
use gaitfit_view::training::{SeedCurve, SeedResult, Series, TrainingReport};
use gaitfit_view::{Link, Replay, Setting};

/// A small deterministic stand-in for noise, uniform in ±1.
fn noise(i: usize, stream: usize) -> f64 {
    let mut x = (i as u64 + 1).wrapping_mul(0x9E37_79B9_7F4A_7C15)
        ^ (stream as u64).wrapping_mul(0xD1B5_4A32_D192_ED03);
    x ^= x >> 29;
    x = x.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x ^= x >> 32;
    (x as f64 / u64::MAX as f64) * 2.0 - 1.0
}

fn setting(name: &str, value: &str) -> Setting {
    Setting { name: name.into(), value: value.into() }
}

fn replay() -> Replay {
    Replay { dt: go2::DT, robots: vec![go2::trot("go2", 100, 0.9)], ..Replay::default() }
}

/// A run of `seeds` seeds over `iterations` iterations.
pub fn training(seeds: usize, iterations: usize) -> TrainingReport {
    let seed = |s: usize| {
        let series = |name: &str, unit: &str, from: f64, to: f64, log: bool| Series {
            name: name.into(),
            unit: unit.into(),
            log,
            values: (0..iterations)
                .map(|i| {
                    let slow = 60.0 + 25.0 * noise(0, s);
                    let done = 1.0 - (-(i as f64) / slow).exp();
                    (from + (to - from) * done) * (1.0 + 0.04 * noise(i, 31 * s + name.len()))
                })
                .collect(),
        };
        SeedCurve {
            seed: s as u64 + 1,
            result: SeedResult {
                reward: 28.4 + 0.5 * noise(1, s),
                linear_velocity_error: 0.112 + 0.01 * noise(2, s),
                angular_velocity_error: 0.143 + 0.01 * noise(3, s),
                fall_rate: 0.003 + 0.002 * noise(4, s),
                iterations: iterations as u32,
                wall_seconds: 540.0 + 20.0 * noise(5, s),
                samples_per_second: 108_400.0 + 2000.0 * noise(6, s),
            },
            iteration: (0..iterations as u32).collect(),
            progress: vec![
                series("reward", "", -3.0, 28.0, false),
                series("linear-velocity error", "m/s", 0.75, 0.11, false),
                series("angular-velocity error", "rad/s", 0.62, 0.14, false),
                series("episode length", "s", 1.0, 19.6, false),
                series("fall rate", "", 0.9, 0.004, false),
            ],
            rewards: [
                "linear velocity",
                "angular velocity",
                "gait",
                "torque",
                "joint acceleration",
                "action rate",
            ]
            .iter()
            .enumerate()
            .map(|(k, name)| {
                series(name, "", 0.0, if k < 3 { 1.2 - 0.3 * k as f64 } else { -0.05 * k as f64 }, false)
            })
            .collect(),
            diagnostics: vec![
                series("KL", "", 0.03, 0.01, true),
                series("clip fraction", "", 0.35, 0.12, false),
                series("explained variance", "", 0.0, 0.93, false),
                series("action std", "", 1.0, 0.25, true),
                series("learning rate", "", 1e-3, 2e-4, true),
                series("value loss", "", 4.0, 0.05, true),
                series("surrogate loss", "", -0.02, -0.008, false),
            ],
        }
    };
    TrainingReport {
        title: "go2-velocity".into(),
        robot: "go2, velocity tracking".into(),
        created: "2026-11-21 12:00 UTC".into(),
        wall_seconds: 2710.0,
        doubts: Vec::new(),
        measured_on: "10,000 trajectories of 4 s with random commands".into(),
        seeds: (0..seeds).map(seed).collect(),
        gait: Some(go2::gait(200)),
        replay: Some(replay()),
        gait_caption: "Seed 1, walking forward at 0.6 m/s, then turning.".into(),
        links: vec![Link { text: "Replay in 3-D".into(), path: "seed-1/replay.html".into() }],
        facts: vec![setting("Environments", "4096"), setting("Action rate (RMS)", "4.1 rad/s")],
        warnings: vec!["Seed 3 was stopped by hand at iteration 412.".into()],
        configuration: "[task]\nname = \"velocity\"\n\n[ppo]\nclip = 0.2\n".into(),
        versions: vec![setting("gaitfit", "0.1.0")],
    }
}

/// An evaluation over `count` trajectories.
pub fn evaluation(count: usize) -> EvaluationReport {
    let samples = |stream: usize, centre: f64| -> Vec<f64> {
        (0..count)
            .map(|i| {
                centre * (1.0 + 0.35 * (noise(i, stream) + noise(i, stream + 1) + noise(i, stream + 2))).abs()
            })
            .collect()
    };
    let measure = |name: &str, unit: &str, mean: f64, stream: usize, limit| Measure {
        name: name.into(),
        unit: unit.into(),
        mean,
        ci95: mean * 0.006,
        decimals: None,
        headline: name.ends_with("error"),
        limit,
        histogram: Some(Histogram::from_samples(&samples(stream, mean), 40)),
    };
    let commands = [
        ("+x 1 m/s", [1.0, 0.0, 0.0]),
        ("−x 1 m/s", [-1.0, 0.0, 0.0]),
        ("+y 1 m/s", [0.0, 1.0, 0.0]),
        ("−y 1 m/s", [0.0, -1.0, 0.0]),
        ("+yaw 1 rad/s", [0.0, 0.0, 1.0]),
        ("−yaw 1 rad/s", [0.0, 0.0, -1.0]),
        ("stand", [0.0; 3]),
    ];
    let drift = commands.iter().enumerate().map(|(k, (name, command))| {
        let time = |i: usize| 4.0 * i as f64 / 200.0;
        let bend = 0.03 * noise(k, 9);
        let path = |i: usize| {
            let t = time(i);
            [0.95 * command[0] * t - bend * t * t, 0.96 * command[1] * t + bend * t * t]
        };
        Drift {
            name: (*name).into(),
            command: *command,
            trials: 10,
            falls: 0,
            error: [path(200)[0] - 4.0 * command[0], path(200)[1] - 4.0 * command[1], 0.1 * noise(k, 10)],
            ci95: [0.02, 0.03, 0.011],
            path: (0..=200).map(path).collect(),
            intended: (0..=200).map(|i| [command[0] * time(i), command[1] * time(i)]).collect(),
        }
    });
    EvaluationReport {
        title: "policy.safetensors".into(),
        robot: "go2, nominal".into(),
        created: "2026-11-21 12:10 UTC".into(),
        wall_seconds: 63.0,
        doubts: Vec::new(),
        verdict: "Walks: its velocity error is 15 % of that of a robot that stands still.".into(),
        replay: Some(replay()),
        trajectories: count as u64,
        seconds: 4.0,
        measures: vec![
            measure("summed reward", "", 5.61, 20, None),
            measure("linear-velocity error", "m/s", 0.112, 30, Some(0.15)),
            measure("angular-velocity error", "rad/s", 0.143, 40, Some(0.20)),
            Measure {
                histogram: None,
                decimals: Some(2),
                headline: true,
                ..measure("falls", "%", 1.306, 50, Some(1.0))
            },
        ],
        drift: drift.collect(),
        ground: (0..10)
            .map(|level| Ground {
                name: "stairs up".into(),
                level,
                difficulty: format!("steps of {} cm", 2 * (level + 1)),
                robots: 64,
                crossed: 1.0 - 0.1 * f64::from(level),
                falls: 0.05 * f64::from(level),
                speed: if level < 9 { 0.5 } else { f64::NAN },
            })
            .collect(),
        gait: Some(go2::gait(200)),
        gait_caption: "Forward at 0.6 m/s, then turning.".into(),
        links: vec![Link { text: "Replay in 3-D".into(), path: "replay.html".into() }],
        warnings: vec!["The fall rate exceeds its limit.".into()],
        settings: vec![setting("evaluate.trajectories", "10000")],
        versions: vec![setting("gaitfit", "0.1.0")],
    }
}
