//! The search by least squares, its intervals and its refusals, on a simulator of a formula.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_adapt::cost::{Cost, CostKind, Recorded, Reference};
use gaitfit_adapt::fit::{
    Alternative, Fit, FitError, FitOptions, Method, NoiseSource, Problem, Stop, uncertainty,
};
use gaitfit_adapt::{
    Cancel, Consume, Identity, JointParameter, ParameterRule, Rollout, Sharing, Signals, Simulator,
    SimulatorError, Theta, never,
};
use gaitfit_random::{Purpose, Stream};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

#[path = "least_squares/in_the_air.rs"]
mod in_the_air;
#[path = "least_squares/motors.rs"]
mod motors;

const TRUTH: [f64; 2] = [0.2, 0.07];
const SAMPLES: u32 = 60;
const RECORDINGS: usize = 32;

/// q = a sin(t/9 + k) + 4 b cos(t/5) + c, and its derivative, in recording k. `shift` is c.
struct Waves {
    identity: Identity,
    shift: f64,
}

fn waves(values: &[f64], recording: usize, shift: f64) -> (Vec<f64>, Vec<f64>) {
    let sample = |t: u32| {
        let (slow, fast) = (f64::from(t) / 9.0 + recording as f64, f64::from(t) / 5.0);
        let (a, b) = (values[0], 4.0 * values[1]);
        (a * slow.sin() + b * fast.cos() + shift, a * slow.cos() / 9.0 - b * fast.sin() / 5.0)
    };
    (0..SAMPLES).map(sample).unzip()
}

impl Simulator for Waves {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn simulate(
        &self,
        _theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        for (candidate, rollout) in candidates.iter().enumerate() {
            if cancel() {
                return Err(SimulatorError::Cancelled);
            }
            for recording in 0..RECORDINGS {
                let (position, velocity) = waves(&rollout.values, recording, self.shift);
                let single = |all: Vec<f64>| all.into_iter().map(|x| x as f32).collect::<Vec<_>>();
                consume(candidate, recording, Signals::of_joints(&single(position), &single(velocity)));
            }
        }
        Ok(())
    }
}

fn simulator(shift: f64) -> Waves {
    Waves { identity: Identity::new(vec!["FL_hip".to_owned()], RECORDINGS), shift }
}

fn theta(upper: f64) -> Theta {
    let rule = |kind| ParameterRule { per: Sharing::All, ..ParameterRule::new(kind) };
    let friction = ParameterRule { upper: Some(upper), ..rule(JointParameter::FrictionLoss) };
    Theta::from_rules(&[friction, rule(JointParameter::Armature)], &[], simulator(0.0).joints()).unwrap()
}

/// Recordings of the truth with normal noise; one sample in `wild` is off by much more, if that is not 0.
fn reference(noise: f64, wild: u32, seed: u64) -> Arc<Reference> {
    let recorded = |recording: usize| {
        let stream = Stream::new(seed, Purpose::OBSERVATION_NOISE).environment(recording as u32);
        let (mut position, mut velocity) = waves(&TRUTH, recording, 0.0);
        for t in 0..SAMPLES {
            position[t as usize] += noise * stream.normal(2 * t);
            velocity[t as usize] += noise / 9.0 * stream.normal(2 * t + 1);
            if wild > 0 && t % wild == 3 {
                position[t as usize] += 1.0;
            }
        }
        Recorded { position, velocity, ..Recorded::default() }
    };
    let recorded: Vec<Recorded> = (0..RECORDINGS).map(recorded).collect();
    Arc::new(Reference::new(simulator(0.0).identity.joints, &recorded, 0).unwrap())
}

fn costs(kind: &str, reference: &Arc<Reference>) -> Vec<Box<dyn Cost>> {
    let kind: CostKind = kind.parse().unwrap();
    vec![kind.build(reference, &simulator(0.0)).unwrap()]
}

fn problem<'a>(simulator: &'a Waves, theta: &'a Theta, cost: &'a dyn Cost) -> Problem<'a> {
    Problem { simulator, theta, cost, draw: 0, cancel: &never }
}

fn options(method: Method) -> FitOptions {
    FitOptions { method, generations: 40, tolerance: 1e-5, ..FitOptions::default() }
}

fn fitted(reference: &Arc<Reference>, upper: f64) -> (Vec<f64>, Option<Stop>, usize) {
    let (simulator, theta, costs) = (simulator(0.0), theta(upper), costs("matchr1", reference));
    let mut fit = Fit::new(&simulator, &theta, &costs, options(Method::Auto)).unwrap();
    let mut evaluations = 0;
    while let Some(generation) = fit.step(&never).unwrap() {
        evaluations += generation.evaluations;
    }
    let outcome = fit.outcomes().remove(0);
    (outcome.values(), outcome.runs[0].stop, evaluations)
}

#[test]
fn a_linear_simulator_is_solved_in_a_few_steps_and_wild_samples_hardly_count() {
    let (values, stop, evaluations) = fitted(&reference(0.0, 0, 1), 0.5);
    assert!(matches!(stop, Some(Stop::Tolerance | Stop::Converged)), "{stop:?}");
    assert!(evaluations < 80, "{evaluations}");
    let off = |values: &[f64]| values.iter().zip(TRUTH).map(|(x, t)| (x - t).abs()).fold(0.0, f64::max);
    assert!(off(&values) < 1e-5, "{values:?}");
    // Least squares without robust weights would be 0.03 off.
    let (values, _, _) = fitted(&reference(1e-3, 20, 1), 0.5);
    assert!(off(&values) < 3e-3, "{values:?}");
}

#[test]
fn bounds_hold_and_the_rest_goes_on() {
    let (values, stop, _) = fitted(&reference(1e-3, 0, 2), 0.1);
    assert_eq!(values[0], 0.1);
    assert!(values[1] > 0.05 && values[1] < 0.09, "{values:?}");
    assert!(stop.is_some());
}

#[test]
fn a_search_goes_on_from_its_checkpoint_to_the_same_bits_and_a_cancelled_step_changes_nothing() {
    let reference = reference(1e-2, 0, 3);
    let (simulator, theta, costs) = (simulator(0.0), theta(0.5), costs("matchr1", &reference));
    let options = FitOptions { seeds: vec![1, 2], ..options(Method::Auto) };
    let mut whole = Fit::new(&simulator, &theta, &costs, options.clone()).unwrap();
    whole.step(&never).unwrap();
    let before = whole.checkpoint();
    let asked = AtomicUsize::new(0);
    let error = whole.step(&|| asked.fetch_add(1, Ordering::Relaxed) > 12).unwrap_err();
    assert!(matches!(error, FitError::Cancelled), "{error}");
    assert_eq!(whole.checkpoint(), before);
    let text = serde_json::to_string(&before).unwrap();
    let saved = serde_json::from_str(&text).unwrap();
    let mut resumed = Fit::resume(&simulator, &theta, &costs, options.clone(), saved).unwrap();
    while whole.step(&never).unwrap().is_some() {}
    while resumed.step(&never).unwrap().is_some() {}
    assert_eq!(resumed.outcomes(), whole.outcomes());
    let runs = &whole.outcomes()[0].runs;
    assert!((runs[0].values[0] - runs[1].values[0]).abs() < 1e-4, "two starts, one end: {runs:?}");
    let cma = FitOptions { method: Method::CmaEs, ..options.clone() };
    let error = Fit::resume(&simulator, &theta, &costs, cma, before).err().unwrap();
    assert!(error.to_string().contains("`method` was Auto, and it is CmaEs now"), "{error}");
    // More steps than were asked for at first.
    let short = FitOptions { generations: 2, ..options.clone() };
    let mut fit = Fit::new(&simulator, &theta, &costs, short).unwrap();
    while fit.step(&never).unwrap().is_some() {}
    let mut longer = Fit::resume(&simulator, &theta, &costs, options, fit.checkpoint()).unwrap();
    while longer.step(&never).unwrap().is_some() {}
    assert_eq!(longer.outcomes(), whole.outcomes());
}

#[test]
fn costs_that_compare_distributions_are_refused() {
    let reference = reference(0.0, 0, 1);
    let (simulator, theta, costs) = (simulator(0.0), theta(0.5), costs("wass", &reference));
    let error = Fit::new(&simulator, &theta, &costs, options(Method::LeastSquares)).err().unwrap();
    assert!(error.to_string().contains("`wass`"), "{error}");
    assert!(Fit::new(&simulator, &theta, &costs, options(Method::Auto)).is_ok());
}

#[test]
fn intervals_of_many_fits_cover_the_truth_as_they_say() {
    let theta = theta(0.5);
    let (mut inside, mut all) = (0, 0);
    for seed in 0..100 {
        let reference = reference(3e-2, 0, 100 + seed);
        let (values, _, _) = fitted(&reference, 0.5);
        let costs = costs("matchr1", &reference);
        let uncertainty =
            uncertainty(problem(&simulator(0.0), &theta, costs[0].as_ref()), &[], &values, None).unwrap();
        let uncertainty = uncertainty.unwrap();
        for ((interval, truth), draw) in uncertainty.interval.iter().zip(TRUTH).zip(&uncertainty.draws[0]) {
            inside += usize::from((interval[0]..=interval[1]).contains(&truth));
            all += 1;
            assert!((0.0..=0.5).contains(draw));
        }
    }
    // 190 of 200 are due; two standard errors are 6.
    assert!((182..=198).contains(&inside), "{inside} of {all}");
}

#[test]
fn another_simulator_shows_how_far_its_error_moves_the_result() {
    let (theta, reference) = (theta(0.5), reference(1e-3, 0, 5));
    let costs = costs("matchr1", &reference);
    let (values, _, _) = fitted(&reference, 0.5);
    let same = Alternative { what: "none".to_owned(), simulator: &simulator(0.0) };
    let other = Alternative { what: "offset".to_owned(), simulator: &simulator(1e-2) };
    let cost = costs[0].as_ref();
    let uncertainty =
        uncertainty(problem(&simulator(0.0), &theta, cost), &[same, other], &values, None).unwrap().unwrap();
    assert!(uncertainty.shifts[1].by.iter().all(|by| by.abs() < 1e-6), "{:?}", uncertainty.shifts);
    assert!(uncertainty.shifts[2].by.iter().any(|by| by.abs() > 1e-5), "{:?}", uncertainty.shifts);
    for (at, shift) in uncertainty.shifts[2].by.iter().enumerate() {
        let expected = uncertainty.sampling[at].hypot(*shift).hypot(uncertainty.shifts[0].by[at]);
        assert!((uncertainty.deviation[at] - expected).abs() < 1e-3 * expected);
    }
    let mut fit = Fit::new(&simulator(0.0), &theta, &costs, options(Method::Auto)).unwrap().outcomes();
    assert!(fit.is_empty(), "nothing has been found yet");
    let simulator = simulator(0.0);
    let mut search = Fit::new(&simulator, &theta, &costs, options(Method::Auto)).unwrap();
    while search.step(&never).unwrap().is_some() {}
    fit = search.outcomes();
    fit[0].trust(problem(&simulator, &theta, cost), &[]).unwrap();
    let known = fit[0].parameters[0].identification.clone().unwrap();
    assert!(known.identified && known.noise == NoiseSource::Refits && known.upper > known.lower);
}

#[test]
fn what_the_logs_do_not_show_is_not_identified_and_what_rests_on_a_bound_stays_there() {
    let rule = |kind| ParameterRule { per: Sharing::All, ..ParameterRule::new(kind) };
    let rules = [
        ParameterRule { upper: Some(0.1), ..rule(JointParameter::FrictionLoss) },
        rule(JointParameter::Armature),
        rule(JointParameter::Damping),
    ];
    let theta = Theta::from_rules(&rules, &[], simulator(0.0).joints()).unwrap();
    let reference = reference(1e-3, 0, 7);
    let (simulator, costs) = (simulator(0.0), costs("matchr1", &reference));
    let mut search = Fit::new(&simulator, &theta, &costs, options(Method::Auto)).unwrap();
    while search.step(&never).unwrap().is_some() {}
    let mut outcome = search.outcomes().remove(0);
    outcome.trust(problem(&simulator, &theta, costs[0].as_ref()), &[]).unwrap();
    let identified: Vec<bool> =
        outcome.parameters.iter().map(|one| one.identification.as_ref().unwrap().identified).collect();
    assert_eq!(identified, [true, true, false], "the damping has no effect");
    let draws = &outcome.uncertainty.as_ref().unwrap().draws;
    assert!(draws.iter().all(|draw| draw[0] == 0.1), "{draws:?}");
    let mean = draws.iter().map(|draw| draw[1]).sum::<f64>() / draws.len() as f64;
    let value = outcome.parameters[1].value;
    assert!((mean - value).abs() < 1e-3, "{mean} beside {value}");
    let damping: Vec<f64> = draws.iter().map(|draw| draw[2]).collect();
    assert!(damping.iter().any(|x| *x < 0.5) && damping.iter().any(|x| *x > 1.5), "{damping:?}");
}

#[test]
fn a_checkpoint_that_cannot_be_is_refused() {
    let reference = reference(1e-2, 0, 3);
    let (simulator, theta, costs) = (simulator(0.0), theta(0.5), costs("matchr1", &reference));
    let mut fit = Fit::new(&simulator, &theta, &costs, options(Method::Auto)).unwrap();
    fit.step(&never).unwrap();
    let good = serde_json::to_value(fit.checkpoint()).unwrap();
    for (key, bad) in [
        ("damping", serde_json::json!(-1.0)),
        ("values", serde_json::json!([0.1])),
        ("best", serde_json::Value::Null),
        ("best", serde_json::json!({ "x": [], "cost": 1.0, "generation": 0 })),
    ] {
        let mut bad_one = good.clone();
        bad_one["runs"][0]["state"]["least_squares"][key] = bad;
        let saved = serde_json::from_value(bad_one).unwrap();
        assert!(Fit::resume(&simulator, &theta, &costs, options(Method::Auto), saved).is_err(), "{key}");
    }
}
