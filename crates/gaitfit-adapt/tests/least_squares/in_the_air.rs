//! Least squares of logs of a clamped robot, whose derivatives are the simulator's own, and what logs can tell.

use super::*;
use gaitfit_adapt::ReplaySimulator;
use gaitfit_adapt::fit::{Predicted, sensitivity, simulate_one};
use gaitfit_adapt::{Entry, Resets};
use gaitfit_model::{Model, ReadOptions, Root, read};
use gaitfit_physics::Preset;
use gaitfit_sim::{Recording, ReplayOptions};
use std::path::Path;
use std::sync::Mutex;

pub(super) const DT: f64 = 0.005;
pub(super) const POSE: [f64; 3] = [0.0, 0.9, -1.6];

pub(super) fn go2() -> Model {
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../assets/go2.xml");
    read(&path, &ReadOptions { root: Some(Root::Fixed), ..ReadOptions::default() }).unwrap()
}

/// Every joint swings at its own pace.
pub(super) fn recording(joints: usize, samples: usize) -> Recording {
    let at = |sample: usize, j: usize| {
        let pace = std::f64::consts::TAU * (0.5 + 0.23 * j as f64) * sample as f64 * DT;
        POSE[j % 3] + 0.3 * pace.sin() + 0.1 * (2.7 * pace).sin()
    };
    Recording {
        dt: DT,
        q0: (0..joints).map(|j| POSE[j % 3]).collect(),
        dq0: vec![0.0; joints],
        target: (0..samples).flat_map(|i| (0..joints).map(move |j| at(i, j))).collect(),
        kp: vec![25.0; joints],
        kd: vec![0.6; joints],
    }
}

/// Friction, armature and damping of hips, thighs and calves, and one delay.
fn theta_of(model: &Model) -> Theta {
    let names: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
    let groups =
        ["hip", "thigh", "calf"].map(|group| (group.to_owned(), vec![format!("*_{group}*")])).to_vec();
    let delay =
        ParameterRule { per: Sharing::All, upper: Some(0.02), ..ParameterRule::new(JointParameter::Delay) };
    let rules = [
        ParameterRule::new(JointParameter::FrictionLoss),
        ParameterRule::new(JointParameter::Armature),
        ParameterRule::new(JointParameter::Damping),
        delay,
    ];
    Theta::from_rules(&rules, &groups, &names).unwrap()
}

const TRUE: [f64; 10] = [0.2, 0.1, 0.35, 0.015, 0.02, 0.04, 0.1, 0.2, 0.3, 0.0073];

fn air(model: &Model, samples: usize, preset: Preset) -> ReplaySimulator {
    let options = ReplayOptions { substeps: 2, preset, max_delay: 0.02, ..ReplayOptions::default() };
    ReplaySimulator::new(model, vec![recording(model.joints.len(), samples)], options, 1).unwrap()
}

fn logged(simulator: &ReplaySimulator, theta: &Theta) -> Arc<Reference> {
    let predicted: Predicted = simulate_one(simulator, theta, &TRUE, Resets::Never).unwrap().remove(0);
    let wide = |all: Vec<f32>| all.into_iter().map(f64::from).collect();
    let recorded = Recorded {
        position: wide(predicted.position),
        velocity: wide(predicted.velocity),
        ..Recorded::default()
    };
    Arc::new(Reference::new(simulator.joints().to_vec(), &[recorded], 0).unwrap())
}

#[test]
fn delays_count_from_the_stamps_of_targets() {
    let model = go2();
    let (theta, simulator) = (theta_of(&model), air(&model, 100, Preset::Fast));
    let positions = |simulator: &ReplaySimulator, delay: f64| {
        let mut values = TRUE;
        values[9] = delay;
        simulate_one(simulator, &theta, &values, Resets::Never).unwrap().remove(0).position
    };
    let want = positions(&simulator, 0.0073);
    let late = simulator.late(0.003);
    let apart = |delay: f64| {
        let shifted = positions(&late, delay);
        shifted.iter().zip(&want).map(|(a, b)| (a - b).abs()).fold(0.0, f32::max)
    };
    assert!(apart(0.0043) < 1e-5 && apart(0.0073) > 1e-3, "{} {}", apart(0.0043), apart(0.0073));
}

#[test]
fn a_replays_derivatives_are_those_of_its_signals_also_on_bounds() {
    let model = go2();
    let (theta, simulator) = (theta_of(&model), air(&model, 200, Preset::Accurate));
    // The delay rests on its upper bound, where the replay knows no longer one.
    let mut values = TRUE;
    values[9] = 0.02;
    let slopes = Mutex::new(vec![Vec::new(); theta.len()]);
    let keep = |entry: usize, _: usize, signals: Signals<'_>| {
        slopes.lock().unwrap()[entry] = signals.position.to_vec();
    };
    let rollout = Rollout { values: values.to_vec(), ..Rollout::default() };
    assert!(simulator.differentiate(&theta, &rollout, &keep, &never).unwrap());
    let at = |entry: usize, value: f64| -> Vec<f32> {
        let mut values = values.to_vec();
        values[entry] = value;
        simulate_one(&simulator, &theta, &values, Resets::Never).unwrap().remove(0).position
    };
    let slopes = slopes.lock().unwrap().clone();
    for (number, (entry, slopes)) in theta.entries().iter().zip(slopes).enumerate() {
        let Entry { name, lower, upper, .. } = entry;
        let by = 2e-2 * values[number];
        let (up, down) = ((values[number] + by).min(*upper), (values[number] - by).max(*lower));
        let (ahead, behind) = (at(number, up), at(number, down));
        let (mut off, mut all) = (0.0, 0.0);
        for ((slope, ahead), behind) in slopes.iter().zip(ahead).zip(behind) {
            let wanted = f64::from(ahead - behind) / (up - down);
            off += (f64::from(*slope) - wanted).powi(2);
            all += wanted * wanted;
        }
        println!("{name}: {:.1e}", (off / all).sqrt());
        assert!((off / all).sqrt() < 0.15, "{name} is off by {}", (off / all).sqrt());
    }
    let reset = Rollout { resets: Resets::Sensors(1), ..rollout };
    assert!(!simulator.differentiate(&theta, &reset, &keep, &never).unwrap());
    let converged = air(&model, 200, Preset::Converged);
    let rollout = Rollout { values: TRUE.to_vec(), ..Rollout::default() };
    assert!(!converged.differentiate(&theta, &rollout, &keep, &never).unwrap());
}

#[test]
fn the_truth_is_found_in_a_few_steps_and_the_log_tells_all_of_it() {
    let model = go2();
    let (theta, simulator) = (theta_of(&model), air(&model, 600, Preset::Accurate));
    let reference = logged(&simulator, &theta);
    let costs = vec!["matcho".parse::<CostKind>().unwrap().build(&reference, &simulator).unwrap()];
    let mut fit = Fit::new(&simulator, &theta, &costs, options(Method::LeastSquares)).unwrap();
    let mut evaluations = 0;
    while let Some(generation) = fit.step(&never).unwrap() {
        evaluations += generation.evaluations;
    }
    let outcome = fit.outcomes().remove(0);
    println!("{evaluations} simulations, {:?}", outcome.values());
    assert!(evaluations < 400, "{evaluations}");
    for ((entry, value), truth) in theta.entries().iter().zip(outcome.values()).zip(TRUE) {
        assert!((value / truth - 1.0).abs() < 1e-4, "{}: {value} and not {truth}", entry.name);
    }
    let problem =
        Problem { simulator: &simulator, theta: &theta, cost: costs[0].as_ref(), draw: 0, cancel: &never };
    let sensitivity = sensitivity(problem, &TRUE, Some(1e-3)).unwrap().unwrap();
    assert_eq!(sensitivity.difference, 1e-3);
    for (at, entry) in theta.entries().iter().enumerate() {
        let (deviation, alone) = (sensitivity.deviation[at].unwrap(), sensitivity.alone[at].unwrap());
        assert!(deviation >= alone && deviation < entry.deviation, "{}: {deviation}", entry.name);
        assert!((sensitivity.correlation[at][at] - 1.0).abs() < 1e-9);
    }
}

/// Deviations that derivatives promise are those of fits of logs with other noise.
#[test]
fn promised_deviations_are_those_of_many_fits() {
    let theta = theta(0.5);
    let quiet = reference(3e-2, 0, 400);
    let costs_of = costs("matchr1", &quiet);
    let simulator = simulator(0.0);
    let promised =
        sensitivity(problem(&simulator, &theta, costs_of[0].as_ref()), &TRUTH, None).unwrap().unwrap();
    assert!(promised.together < 1.3, "{}", promised.together);
    let fits: Vec<Vec<f64>> = (0..60).map(|seed| fitted(&reference(3e-2, 0, 400 + seed), 0.5).0).collect();
    for at in 0..TRUTH.len() {
        let values: Vec<f64> = fits.iter().map(|fit| fit[at]).collect();
        let scatter = gaitfit_sim::stats::deviation(&values).unwrap();
        let ratio = promised.deviation[at].unwrap() / scatter;
        assert!((0.7..1.4).contains(&ratio), "entry {at}: promised over found {ratio}");
    }
    let rule = |kind| ParameterRule { per: Sharing::All, ..ParameterRule::new(kind) };
    let rules = [JointParameter::FrictionLoss, JointParameter::Armature, JointParameter::Damping].map(rule);
    let more = Theta::from_rules(&rules, &[], simulator.joints()).unwrap();
    let sensitivity = sensitivity(problem(&simulator, &more, costs_of[0].as_ref()), &[0.2, 0.07, 0.1], None);
    let sensitivity = sensitivity.unwrap().unwrap();
    assert!(
        sensitivity.deviation[0].is_some() && sensitivity.deviation[2].is_none(),
        "the damping has no effect"
    );
}
