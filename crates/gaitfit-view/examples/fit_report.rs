//! Writes a report of an invented Go2 fit, to look at the page without running one:
//! `cargo run -p gaitfit-view --example fit_report -- report.html`

use gaitfit_view::fit::{
    Bound, Comparison, ComparisonEntry, Fit, JointTrace, OptimizerRun, Parameter, PublishedRange, Score,
    Signal, SignalDistribution, Validation,
};
use gaitfit_view::{FitReport, Setting, fit_html};
use std::f64::consts::PI;

const RATE: f64 = 200.0;
const SAMPLES: usize = 4700;
const SEEDS: usize = 5;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let path = std::env::args().nth(1).unwrap_or_else(|| "report.html".to_string());
    let page = fit_html(&invented())?;
    println!("{path}: {} bytes", page.len());
    std::fs::write(path, page)?;
    Ok(())
}

/// A small deterministic stand-in for noise, uniform in ±1.
fn noise(i: usize, stream: usize) -> f64 {
    let mut x =
        (i as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15) ^ (stream as u64).wrapping_mul(0xD1B5_4A32_D192_ED03);
    // Shifts and multiplications mix the bits as in SplitMix64, so that neighbours get unrelated numbers.
    x ^= x >> 29;
    x = x.wrapping_mul(0xBF58_476D_1CE4_E5B9);
    x ^= x >> 32;
    (x as f64 / u64::MAX as f64) * 2.0 - 1.0
}

fn invented() -> FitReport {
    let score = |name: &str, cost, fit, validation| Score {
        name: name.into(),
        cost,
        rmse_fit_rad: fit,
        rmse_validation_rad: validation,
    };
    let joints: Vec<String> = ["FL", "FR", "RL", "RR"]
        .iter()
        .flat_map(|leg| ["hip", "thigh", "calf"].map(|part| format!("{leg}_{part}")))
        .collect();
    let traces: Vec<JointTrace> = joints.iter().enumerate().map(|(j, name)| trace(name, j)).collect();
    let setting = |name: &str, value: &str| Setting { name: name.into(), value: value.into() };
    let parameters = parameters();
    FitReport {
        title: "go2-air: joint parameters from in-air sweeps".into(),
        robot: "Unitree Go2, base clamped (assets/go2/go2.xml)".into(),
        created: "2026-11-21 09:30 UTC".into(),
        wall_seconds: 41.7,
        fit_logs: (0..6).map(|i| format!("logs/run_{i}.csv")).collect(),
        fitted: score("fitted simulator", 0.312, 0.00466, 0.00481),
        nominal: score("nominal simulator", 2.41, 0.0673, 0.0678),
        baselines: vec![
            score("echo of the target", 3.02, 0.0791, 0.0794),
            score("best pure delay (70 ms)", 1.57, 0.0424, 0.0426),
            score("published 36-parameter fit", f64::NAN, f64::NAN, 0.0715),
        ],
        comparisons: vec![comparison(&parameters)],
        fits: vec![Fit { cost_name: "MatchO".into(), parameters, runs: runs(), ..Fit::default() }],
        validation: validation(&joints),
        distributions: traces.iter().flat_map(distributions).collect(),
        traces,
        warnings: vec![
            "torque_scale[*_calf] lies on its upper bound: widen it or fix it and fit again.".into(),
            "RR_calf: 0.4 % of the samples of run_3.csv are missing and were left out of the cost.".into(),
        ],
        settings: vec![
            setting("cost", "MatchO"),
            setting("fit.seeds", "[1, 2, 3, 4, 5]"),
            setting("fit.generations", "200"),
            setting("simulation.timestep", "0.005 s"),
            setting("simulation.preset", "accurate"),
            setting("logs", "logs/run_0.csv … logs/run_5.csv"),
        ],
        versions: vec![
            setting("gaitfit", "0.1.0"),
            setting("threads", "2"),
            setting("lanes", "AVX-512, 16 × f32"),
        ],
        ..FitReport::default()
    }
}

/// Name, unit, value, spread, upper bound, published range.
type Invented = (&'static str, &'static str, f64, f64, f64, Option<(f64, f64)>);

fn parameters() -> Vec<Parameter> {
    let rows: [Invented; 14] = [
        ("frictionloss[*_hip]", "N·m", 0.213, 0.004, 0.5, Some((0.20, 0.23))),
        ("frictionloss[*_thigh]", "N·m", 0.188, 0.006, 0.5, Some((0.15, 0.21))),
        ("frictionloss[*_calf]", "N·m", 0.463, 0.011, 1.5, Some((0.57, 0.82))),
        ("armature[*_hip]", "kg·m²", 0.0134, 0.0003, 0.5, Some((0.010, 0.019))),
        ("armature[*_thigh]", "kg·m²", 0.0179, 0.0004, 0.5, Some((0.016, 0.021))),
        ("armature[*_calf]", "kg·m²", 0.0481, 0.0011, 0.5, Some((0.043, 0.053))),
        ("damping[*_hip]", "N·m·s/rad", 0.204, 0.003, 2.0, Some((0.18, 0.23))),
        ("damping[*_thigh]", "N·m·s/rad", 0.187, 0.005, 2.0, Some((0.16, 0.23))),
        ("damping[*_calf]", "N·m·s/rad", 0.291, 0.009, 2.0, Some((0.25, 0.34))),
        ("delay", "s", 0.0102, 0.0001, 0.05, Some((0.008, 0.012))),
        ("torque_scale[*_hip]", "", 0.981, 0.012, 1.1, None),
        // At its bound and not identified, so that the page shows both marks.
        ("torque_scale[*_calf]", "", 1.1, 0.0004, 1.1, None),
        ("encoder_bias[FL_hip]", "rad", -0.0031, 0.0004, 0.05, None),
        ("encoder_bias[RR_calf]", "rad", 0.0118, 0.0009, 0.05, None),
    ];
    let invent = |(i, (name, unit, value, spread, upper, published)): (usize, Invented)| {
        let lower = match unit {
            "" => 0.8,
            "rad" => -upper,
            _ => 0.0,
        };
        Parameter {
            name: name.into(),
            unit: unit.into(),
            value,
            lower,
            upper,
            start: if unit.is_empty() { 1.0 } else { 0.0 },
            spread,
            per_run: (0..SEEDS).map(|s| (value + 1.4 * spread * noise(i, s)).min(upper)).collect(),
            at_bound: (value >= upper).then_some(Bound::Upper),
            published: published.map(|(lower, upper)| PublishedRange {
                lower,
                upper,
                source: "published real fits of this robot".into(),
            }),
            identified: (name == "torque_scale[*_calf]").then_some(false),
            ..Parameter::default()
        }
    };
    rows.into_iter().enumerate().map(invent).collect()
}

fn comparison(parameters: &[Parameter]) -> Comparison {
    let entry = |(i, p): (usize, &Parameter)| {
        // One parameter is far off in the second fit, so that one row differs.
        let second = p.value + p.spread * (1.6 * noise(i, 77) + if p.name == "delay" { 30.0 } else { 0.0 });
        ComparisonEntry {
            name: p.name.clone(),
            unit: p.unit.clone(),
            first: p.value,
            first_half: p.spread,
            second,
            second_half: 1.8 * p.spread,
            agrees: Some((second - p.value).abs() <= 3.6 * p.spread),
        }
    };
    Comparison {
        first: "MatchO (time-aligned)".into(),
        second: "Wass (no time axis)".into(),
        entries: parameters.iter().enumerate().map(entry).collect(),
        reasons: vec![
            "delay: a distribution has no time axis; shifting a periodic sweep leaves it unchanged, so the Wass fit \
             determines the delay only through its effect on the reversals."
                .into(),
        ],
    }
}

fn runs() -> Vec<OptimizerRun> {
    let curve = |seed: usize, floor: f64, scale: f64, rate: f64| -> Vec<f64> {
        let wobble = |g: usize| 1.0 + 0.25 * noise(g, seed) * (-(g as f64) / 90.0).exp();
        (0..200).map(|g| floor + scale * (-(g as f64) / rate).exp() * wobble(g)).collect()
    };
    let run = |seed: usize| {
        let floor = 0.312 + 0.002 * (seed as f64 - 1.0);
        OptimizerRun {
            label: format!("seed {seed}"),
            best_cost: floor,
            best: curve(seed, floor, 1.8, 18.0 + seed as f64),
            mean: curve(seed + 10, floor * 1.02, 2.6, 24.0 + seed as f64),
            sigma: (0..200).map(|g| (-(g as f64) / 34.0 + 0.2 * noise(g / 3, seed + 20)).exp()).collect(),
        }
    };
    (1..=SEEDS).map(run).collect()
}

fn validation(joints: &[String]) -> Vec<Validation> {
    let log = |file: usize| Validation {
        file: format!("logs/run_{file}.csv"),
        rmse_rad: 0.00481 + 0.0001 * noise(file, 3),
        nominal_rmse_rad: 0.0678,
        rmse_per_joint: joints
            .iter()
            .enumerate()
            .map(|(j, name)| (name.clone(), 0.0045 + 0.0022 * noise(j, 5) + 0.0003 * noise(j, file)))
            .collect(),
        ..Validation::default()
    };
    vec![log(6), log(7)]
}

/// A triangle sweep, and first-order followers of it for robot and simulators.
fn trace(name: &str, j: usize) -> JointTrace {
    let amplitude = 0.35 + 0.1 * (j % 3) as f64;
    let centre = [0.0, 0.9, -1.6][j % 3];
    let time_s: Vec<f64> = (0..SAMPLES).map(|i| i as f64 / RATE).collect();
    let triangle = |t: f64| 2.0 / PI * (2.0 * PI * (0.25 + 0.03 * j as f64) * t).sin().asin();
    // Targets come at 50 Hz and are held in between, as those of a policy.
    let hold = |t: f64| (t * 50.0).floor() / 50.0;
    let target: Vec<f64> = time_s.iter().map(|t| centre + amplitude * triangle(hold(*t))).collect();
    let follow = |lag: f64, gain: f64, wobble: f64, stream: usize| -> Vec<f64> {
        let mut q = centre;
        (0..SAMPLES)
            .map(|i| {
                // An Euler step of a lag of first order.
                q += (centre + gain * (target[i] - centre) - q) / (lag * RATE);
                q + wobble * (0.6 * (time_s[i] * 5.3 + j as f64).sin() + 0.4 * noise(i, stream))
            })
            .collect()
    };
    JointTrace {
        joint: name.into(),
        file: "logs/run_6.csv".into(),
        measured: follow(0.07, 0.97, 0.0006, 100 + j),
        fitted: follow(0.0715, 0.972, 0.003, 200 + j),
        nominal: follow(0.03, 1.0, 0.0, 300 + j),
        target,
        time_s,
        slides: false,
    }
}

fn distributions(trace: &JointTrace) -> [SignalDistribution; 2] {
    // A difference over eight samples, 40 ms, so that noise does not hide the velocity.
    let velocity = |q: &[f64]| -> Vec<f64> { q.windows(9).map(|w| (w[8] - w[0]) * RATE / 8.0).collect() };
    let JointTrace { joint, measured, nominal, fitted, .. } = trace;
    let position = SignalDistribution::from_samples(joint, Signal::Position, measured, nominal, fitted);
    let [measured, nominal, fitted] = [measured, nominal, fitted].map(|q| velocity(q));
    let speed = SignalDistribution::from_samples(joint, Signal::Velocity, &measured, &nominal, &fitted);
    [
        SignalDistribution { distance_nominal: 0.0204, distance_fitted: 0.0017, ..position },
        SignalDistribution { distance_nominal: 0.131, distance_fitted: 0.018, ..speed },
    ]
}
