//! The fit driver against a simulator of two formulas: it finds known parameters, resumes to the same bits,
//! counts divergence, and compares costs.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_adapt::cmaes::{BoundHandling, CovarianceKind};
use gaitfit_adapt::cost::{Cost, Recorded, Reference, TimeAligned, Wass, Weights};
use gaitfit_adapt::fit::{
    Checkpoint, CostOutcome, FallPenalty, FinalComparison, Fit, FitError, FitOptions, Job, Method,
    RandomNumbers, RunOutcome, Stop, compare, evaluate, simulate_one,
};
use gaitfit_adapt::{
    Cancel, Consume, Identity, JointParameter, ParameterRule, Resets, Rollout, Sharing, Signals, Simulator,
    SimulatorError, Theta, never,
};
use gaitfit_random::{Purpose, Stream};
use std::sync::Arc;

/// q = damping · sin(ω t) + bias, one frequency a recording: each value leaves its own mark.
struct Sines {
    identity: Identity,
    /// Damping above which the "simulation" is not a number.
    limit: f64,
    /// Damping with which a recording ends in a fall as often as not, by its draw.
    edge: f64,
}

/// How fast falls become frequent around the edge.
const STEEP: f64 = 0.02;

const SAMPLES: usize = 400;

impl Simulator for Sines {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn simulate(
        &self,
        theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
        _cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        for (candidate, rollout) in candidates.iter().enumerate() {
            let mut size = vec![1.0; self.identity.joints.len()];
            let mut bias = vec![0.0; self.identity.joints.len()];
            for (entry, &value) in theta.entries().iter().zip(&rollout.values) {
                for (joint, name) in self.identity.joints.iter().enumerate() {
                    match entry.kind {
                        _ if !entry.joints.contains(name) => {}
                        "damping" => size[joint] = if value > self.limit { f64::NAN } else { value },
                        "encoder_bias" => bias[joint] = value,
                        kind => unreachable!("{kind}"),
                    }
                }
            }
            for recording in 0..2 {
                let omega = 3.0 + recording as f64;
                let mut position = Vec::new();
                let mut velocity = Vec::new();
                for sample in 0..SAMPLES {
                    let t = sample as f64 * 0.01;
                    for joint in 0..self.identity.joints.len() {
                        position.push((size[joint] * (omega * t).sin() + bias[joint]) as f32);
                        velocity.push((size[joint] * omega * (omega * t).cos()) as f32);
                    }
                }
                let draws = Stream::new(rollout.draw, Purpose::TORQUE_NOISE).environment(recording as u32);
                let chance = (1.0 + ((self.edge - size[0]) / STEEP).exp()).recip();
                let fell_at = (draws.step(0).uniform(0) < chance).then_some(SAMPLES / 2);
                let signals = Signals { fell_at, ..Signals::of_joints(&position, &velocity) };
                consume(candidate, recording, signals);
            }
        }
        Ok(())
    }
}

const TRUTH: [f64; 3] = [0.8, 0.02, -0.03];

fn sines(limit: f64) -> Sines {
    Sines {
        identity: Identity::new(["FL_hip", "FR_hip"].map(String::from).to_vec(), 2),
        limit,
        edge: f64::INFINITY,
    }
}

fn theta() -> Theta {
    let damping = ParameterRule { per: Sharing::All, ..ParameterRule::new(JointParameter::Damping) };
    let bias = ParameterRule { per: Sharing::Joint, ..ParameterRule::new(JointParameter::EncoderBias) };
    Theta::from_rules(&[damping, bias], &[], sines(9.0).joints()).unwrap()
}

fn costs(simulator: &Sines) -> Vec<Box<dyn Cost>> {
    costs_at(simulator, &TRUTH)
}

/// Costs against logs of a robot with these values.
fn costs_at(simulator: &Sines, truth: &[f64]) -> Vec<Box<dyn Cost>> {
    let truth = simulate_one(simulator, &theta(), truth, Resets::Never).unwrap();
    let wide = |values: &[f32]| values.iter().map(|value| f64::from(*value)).collect::<Vec<f64>>();
    let recorded: Vec<Recorded> = truth
        .iter()
        .map(|log| Recorded {
            position: wide(&log.position),
            velocity: wide(&log.velocity),
            ..Recorded::default()
        })
        .collect();
    let target = Arc::new(Reference::new(simulator.identity.joints.clone(), &recorded, 0).unwrap());
    let weights = Weights::from_reference(&target);
    vec![
        Box::new(TimeAligned::match_o(Arc::clone(&target), weights).unwrap()),
        Box::new(Wass::new(target, weights).unwrap()),
    ]
}

fn options(generations: usize) -> FitOptions {
    FitOptions {
        method: Method::Auto,
        population: 0,
        generations,
        restarts: 0,
        seeds: vec![1, 2, 3],
        covariance: CovarianceKind::Full,
        bounds: BoundHandling::Reflect,
        patience: 0,
        tolerance: 1e-5,
        falls: FallPenalty::default(),
        random_numbers: RandomNumbers::default(),
    }
}

#[test]
fn both_costs_find_the_truth_and_agree() {
    let simulator = sines(9.0);
    let (theta, costs) = (theta(), costs(&simulator));
    let mut fit = Fit::new(&simulator, &theta, &costs, options(400)).unwrap();
    let mut evaluations = 0;
    while let Some(generation) = fit.step(&never).unwrap() {
        evaluations += generation.evaluations;
    }
    let outcomes = fit.outcomes();
    assert_eq!(outcomes.iter().map(|outcome| outcome.cost.as_str()).collect::<Vec<_>>(), ["matcho", "wass"]);
    let told: usize = outcomes.iter().flat_map(|outcome| &outcome.runs).map(|run| run.generations * 7).sum();
    assert_eq!(evaluations, told);
    for outcome in &outcomes {
        for (parameter, truth) in outcome.parameters.iter().zip(TRUTH) {
            assert!((parameter.value - truth).abs() < 1e-4, "{} {}: {parameter:?}", outcome.cost, truth);
            assert!(parameter.spread.unwrap() < 1e-4 && !parameter.at_bound, "{parameter:?}");
        }
        assert!(outcome.runs.iter().all(|run| run.stop == Some(Stop::Tolerance)), "{:?}", outcome.runs);
    }
    let on = |cost: usize| {
        let (simulator, theta, costs) = (&simulator, &theta, &costs);
        move |values: &[Vec<f64>]| {
            let jobs: Vec<Job> =
                values.iter().map(|values| Job { cost, values: values.clone(), draw: 0 }).collect();
            let evaluations = evaluate(simulator, theta, costs, &FallPenalty::NONE, &jobs, &never)?;
            Ok(evaluations.into_iter().map(|evaluation| evaluation.cost).collect())
        }
    };
    let agreements = compare(&outcomes[0], &outcomes[1], on(0), on(1)).unwrap();
    assert!(agreements.iter().all(|one| one.agrees == Some(one.reason.is_none())), "{agreements:?}");
}

#[test]
fn a_resumed_fit_ends_with_the_same_bits() {
    resumes_to_the_same_bits(&sines(9.0), &options(30));
    // Some candidates fall: what they teach of the risk is saved too.
    let falls = FallPenalty { random: true, ..FallPenalty::default() };
    resumes_to_the_same_bits(&Sines { edge: 0.72, ..sines(9.0) }, &FitOptions { falls, ..options(30) });
}

fn resumes_to_the_same_bits(simulator: &Sines, options: &FitOptions) {
    let (theta, costs) = (theta(), costs(&sines(9.0)));
    let mut whole = Fit::new(simulator, &theta, &costs, options.clone()).unwrap();
    while whole.step(&never).unwrap().is_some() {}

    let mut part = Fit::new(simulator, &theta, &costs, options.clone()).unwrap();
    for _ in 0..11 {
        part.step(&never).unwrap();
    }
    let saved = serde_json::to_string(&part.checkpoint()).unwrap();
    let checkpoint: Checkpoint = serde_json::from_str(&saved).unwrap();
    let mut resumed = Fit::resume(simulator, &theta, &costs, options.clone(), checkpoint).unwrap();
    assert_eq!(resumed.generation(), 11);
    while resumed.step(&never).unwrap().is_some() {}
    assert_eq!(resumed.outcomes(), whole.outcomes());
    assert_eq!(resumed.checkpoint(), whole.checkpoint());
}

/// Each start takes twice the candidates of the one before; the best of all is kept; a stop between or within starts
/// changes nothing.
#[test]
fn restarts_double_the_population_and_resume_to_the_same_bits() {
    let simulator = sines(9.0);
    let (theta, costs) = (theta(), costs(&simulator));
    let options = FitOptions { restarts: 2, seeds: vec![4], ..options(6) };
    let mut whole = Fit::new(&simulator, &theta, &costs[..1], options.clone()).unwrap();
    let (mut evaluations, mut best) = (Vec::new(), f64::INFINITY);
    while let Some(generation) = whole.step(&never).unwrap() {
        evaluations.push(generation.evaluations);
        best = best.min(generation.runs[0].best);
        assert_eq!(generation.runs[0].best_so_far, best);
    }
    assert_eq!(evaluations, [[7; 6], [14; 6], [28; 6]].concat());
    assert_eq!((options.max_generations(), whole.outcomes()[0].runs[0].generations), (18, 18));
    assert_eq!(whole.outcomes()[0].runs[0].stop, Some(Stop::Generations));
    for stopped in [4, 6, 15] {
        let mut part = Fit::new(&simulator, &theta, &costs[..1], options.clone()).unwrap();
        for _ in 0..stopped {
            part.step(&never).unwrap();
        }
        let saved = serde_json::to_string(&part.checkpoint()).unwrap();
        let checkpoint = serde_json::from_str(&saved).unwrap();
        let mut resumed = Fit::resume(&simulator, &theta, &costs[..1], options.clone(), checkpoint).unwrap();
        while resumed.step(&never).unwrap().is_some() {}
        assert_eq!(resumed.checkpoint(), whole.checkpoint(), "stopped after {stopped}");
    }
}

#[test]
fn a_new_start_does_not_widen_what_the_start_before_it_found() {
    let simulator = sines(9.0);
    let (theta, costs) = (theta(), costs(&simulator));
    let options = FitOptions { restarts: 1, seeds: vec![1], ..options(400) };
    let mut fit = Fit::new(&simulator, &theta, &costs[..1], options).unwrap();
    // The first start has 7 candidates and ends at its tolerance.
    while fit.step(&never).unwrap().is_some_and(|generation| generation.evaluations == 7) {}
    let run = &fit.outcomes()[0].runs[0];
    assert_eq!((run.stop, run.deviations.len()), (None, theta.len()));
    for (at, entry) in theta.entries().iter().enumerate() {
        assert!(run.deviations[at] < 1.1e-5 * entry.deviation, "{run:?}");
        assert!((run.mean[at] - run.values[at]).abs() < 1e-3 * entry.deviation, "{run:?}");
    }
}

#[test]
fn a_checkpoint_of_another_fit_is_refused() {
    let simulator = sines(9.0);
    let (theta, costs) = (theta(), costs(&simulator));
    let fit = Fit::new(&simulator, &theta, &costs, options(5)).unwrap();
    let mut other = fit.checkpoint();
    other.origin.parameters[0].name = "armature".into();
    let error = Fit::resume(&simulator, &theta, &costs, options(5), other).err().unwrap();
    assert!(matches!(error, FitError::Checkpoint(_)), "{error}");
    let seeds = FitOptions { seeds: vec![7, 8, 9], ..options(5) };
    let error = Fit::resume(&simulator, &theta, &costs, seeds, fit.checkpoint()).err().unwrap();
    assert!(error.to_string().contains("`seeds` was") && error.to_string().contains("[7, 8, 9]"), "{error}");
}

/// Each change alone is refused, and named.
#[test]
fn a_checkpoint_of_other_logs_bounds_or_settings_is_refused_by_name() {
    let simulator = sines(9.0);
    let (theta, costs) = (theta(), costs(&simulator));
    let mut fit = Fit::new(&simulator, &theta, &costs, options(5)).unwrap();
    while fit.step(&never).unwrap().is_some() {}
    let saved = serde_json::to_value(fit.checkpoint()).unwrap();
    let refused = |path: &str, value: serde_json::Value, words: &str| {
        let mut other = saved.clone();
        *other.pointer_mut(path).unwrap() = value;
        let other = serde_json::from_value(other).unwrap();
        let error = Fit::resume(&simulator, &theta, &costs, options(5), other).err().unwrap().to_string();
        assert!(error.contains(words), "{path}: {error}");
    };
    use serde_json::json;
    refused("/origin/joints/0", json!("knee"), "its joints are knee");
    refused("/origin/recordings", json!(9), "begun with 9 logs");
    refused("/origin/parameters/0/upper", json!(1e300), "the upper bound of `");
    refused("/origin/parameters/0/upper", json!(1e300), "was 1e300");
    refused("/origin/parameters/0/lower", json!(-7.0), "the lower bound of `");
    refused("/origin/parameters/0/start", json!(0.125), "was 0.125");
    refused("/origin/parameters/0/deviation", json!(0.5), "the deviation of `");
    refused("/origin/costs/0/recordings", json!("00"), "its logs are others");
    refused("/origin/costs/0/skip", json!(3), "the first 3 samples");
    refused("/origin/costs/0/cost", json!("rmse"), "it minimises rmse");
    refused("/origin/options/population", json!(1000), "`population` was 1000");
    refused("/origin/options/tolerance", json!(0.5), "`tolerance` was 0.5");
    refused("/origin/options/falls/robot_rate", json!(0.25), "`falls` was robot_rate = 0.25");
    // The same logs, in which the robot fell otherwise.
    let mut cost = saved["origin"]["costs"][0].clone();
    (cost["recordings"], cost["fall_rate"]) = (json!("00"), json!(0.25));
    refused("/origin/costs/0", cost, "in which the robot fell was 25 %, and it is 0 % now");
    // Logs of a robot that differs a little.
    let others = costs_at(&simulator, &[0.8, 0.02, -0.030_01]);
    let saved = serde_json::from_value(saved).unwrap();
    let error = Fit::resume(&simulator, &theta, &others, options(5), saved).err().unwrap().to_string();
    assert!(error.contains("its logs are others"), "{error}");
}

#[test]
fn a_finished_fit_resumes_for_more_generations_to_the_bits_of_an_undisturbed_one() {
    let simulator = sines(9.0);
    let (theta, costs) = (theta(), costs(&simulator));
    let run = |mut fit: Fit<'_>| {
        while fit.step(&never).unwrap().is_some() {}
        (fit.outcomes(), serde_json::to_value(fit.checkpoint().runs).unwrap())
    };
    let whole = run(Fit::new(&simulator, &theta, &costs, options(30)).unwrap());
    let mut short = Fit::new(&simulator, &theta, &costs, options(8)).unwrap();
    while short.step(&never).unwrap().is_some() {}
    let saved = short.checkpoint();
    assert_eq!(short.generation(), 8);
    let longer = Fit::resume(&simulator, &theta, &costs, options(30), saved.clone()).unwrap();
    assert!(!longer.finished());
    assert_eq!(run(longer), whole);
    let error = Fit::resume(&simulator, &theta, &costs, options(7), saved.clone()).err().unwrap().to_string();
    assert!(error.contains("8 generations, and the limit is 7"), "{error}");
    // Interrupted before a limit that is lower now.
    let mut cut = Fit::new(&simulator, &theta, &costs, options(30)).unwrap();
    (0..8).for_each(|_| drop(cut.step(&never).unwrap()));
    let ended = Fit::resume(&simulator, &theta, &costs, options(8), cut.checkpoint()).unwrap();
    assert!(ended.finished());
    assert_eq!(ended.outcomes(), short.outcomes());
    // What the first of several starts did cannot be lengthened.
    let restarts = |generations| FitOptions { restarts: 1, ..options(generations) };
    let mut fit = Fit::new(&simulator, &theta, &costs, restarts(4)).unwrap();
    while fit.step(&never).unwrap().is_some() {}
    let error = Fit::resume(&simulator, &theta, &costs, restarts(9), fit.checkpoint()).err().unwrap();
    assert!(
        error
            .to_string()
            .contains("search number 1 ended after 4 generations, and the limit is 9 now: give 4"),
        "{error}"
    );
}

#[test]
fn diverged_candidates_are_counted_and_ranked_last() {
    // The truth lies close below the limit, so part of each generation diverges.
    let simulator = sines(0.81);
    let (theta, costs) = (theta(), costs(&simulator));
    let mut fit = Fit::new(&simulator, &theta, &costs[..1], options(300)).unwrap();
    while fit.step(&never).unwrap().is_some() {}
    let outcome = &fit.outcomes()[0];
    assert!(outcome.runs.iter().any(|run| run.diverged > 0));
    assert!((outcome.parameters[0].value - TRUTH[0]).abs() < 1e-3, "{outcome:?}");
    assert!(outcome.best_cost.is_finite());

    let hopeless = sines(-1.0);
    let mut fit = Fit::new(&hopeless, &theta, &costs[..1], options(5)).unwrap();
    let error = fit.step(&never).unwrap_err();
    assert!(matches!(error, FitError::AllDiverged { generation: 1, .. }), "{error}");
}

#[test]
fn a_search_with_random_falls_keeps_away_from_values_that_often_fall() {
    // Nearer to the truth, 0.8, robots fall more often.
    let (theta, costs) = (theta(), costs(&sines(9.0)));
    let simulator = Sines { edge: 0.72, ..sines(9.0) };
    let falls_of = |random| {
        let falls = FallPenalty { random, ..FallPenalty::default() };
        let seeds = (1..=4).collect();
        let random_numbers = RandomNumbers::Candidate;
        let options = FitOptions { population: 16, seeds, falls, random_numbers, ..options(60) };
        let mut fit = Fit::new(&simulator, &theta, &costs[1..], options).unwrap();
        let mut course = Vec::new();
        while let Some(generation) = fit.step(&never).unwrap() {
            course.push(generation.runs.iter().map(|run| run.falls).sum::<usize>());
        }
        assert!(fit.outcomes()[0].best_cost < costs[1].lost(), "the best candidate stands");
        course[30..].iter().sum::<usize>()
    };
    let (seen, expected) = (falls_of(false), falls_of(true));
    assert!(3 * expected < 2 * seen, "{expected} falls if expected ones count, {seen} if not");
}

#[test]
fn the_last_candidates_are_compared_again_and_a_lucky_one_does_not_win() {
    let simulator = sines(1.5);
    let theta = theta();
    let costs = costs(&simulator);
    let [lucky, diverging, near] =
        [[0.7, 0.02, -0.03], [1.9, 0.02, -0.03], [0.81, 0.02, -0.03]].map(Vec::from);
    let outcome = |mean: &[f64]| {
        let run = RunOutcome {
            seed: 1,
            best_cost: 1e-9,
            values: lucky.clone(),
            generations: 10,
            stop: Some(Stop::Patience),
            diverged: 0,
            falls: 0,
            deviations: Vec::new(),
            mean: mean.to_vec(),
        };
        CostOutcome::new(costs[0].name().to_owned(), &theta, vec![run]).unwrap()
    };
    let falls = FallPenalty::default();
    let comparison = FinalComparison {
        simulator: &simulator,
        theta: &theta,
        costs: &costs,
        cost: 0,
        falls: &falls,
        cancel: &never,
    };
    let course = [near.clone(), diverging.clone(), lucky.clone()];
    let chosen = |mean: &[f64], course: &[Vec<f64>]| {
        let mut outcome = outcome(mean);
        outcome.choose_finalist(&comparison, course.iter().map(Vec::as_slice)).unwrap();
        (outcome.values(), outcome.best_cost)
    };
    let job = Job { cost: 0, values: near.clone(), draw: 0 };
    let cost = evaluate(&simulator, &theta, &costs, &falls, &[job], &never).unwrap()[0].cost.unwrap();
    let (values, mean_cost) = chosen(&lucky, &course);
    assert!(values == near && (mean_cost - cost).abs() < 1e-12, "{values:?} {mean_cost} {cost}");
    // The mean of the distribution is a finalist too, clipped to the bounds.
    assert_eq!(chosen(&TRUTH, &course).0, TRUTH);
    let (only, kept) = chosen(&[1.9, 0.02, -0.03], &[diverging]);
    assert_eq!((only, kept), (lucky, 1e-9), "all finalists diverge, so the outcome stays");
}
