//! Indirect inference on a toy whose least squares are attenuated: a first-order process that is read with noise, each
//! reading predicted from the one before.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_adapt::cost::{Cost, CostKind, Recorded, Reference};
use gaitfit_adapt::fit::{Correction, CostOutcome, Fit, FitOptions, Method, Problem, Replicate, World};
use gaitfit_adapt::{
    Cancel, Consume, Identity, JointParameter, ParameterRule, Rollout, Sharing, Signals, Simulator,
    SimulatorError, Theta, never,
};
use gaitfit_random::{Purpose, Stream};
use std::sync::Arc;

const TRUTH: [f64; 2] = [0.4, 0.07];
/// Values of which readings show all.
const MIDDLE: [f64; 2] = [0.33, 0.035];
const SAMPLES: usize = 80;
const RECORDINGS: usize = 24;

/// Readings of x' = 2a x + 10b u + noise, with a known drive u, and the predictions from each to the next.
struct Process {
    identity: Identity,
    readings: Vec<Vec<f64>>,
}

fn drive(recording: usize, sample: usize) -> f64 {
    (0.3 * sample as f64 + 1.7 * recording as f64).sin() + (0.11 * sample as f64 + recording as f64).cos()
}

impl Process {
    /// `noise`: of the readings.
    fn new(values: &[f64], noise: f64, seed: u64) -> Self {
        let one = |recording: usize| {
            let stream = Stream::new(seed, Purpose::OBSERVATION_NOISE).environment(recording as u32);
            let mut x = 0.0;
            let reading = |sample: usize| {
                let read = x + noise * stream.normal(2 * sample as u32);
                let disturbed = 0.3 * stream.normal(2 * sample as u32 + 1);
                x = 2.0 * values[0] * x + 10.0 * values[1] * drive(recording, sample) + disturbed;
                read
            };
            (0..SAMPLES).map(reading).collect()
        };
        Self {
            identity: Identity::new(vec!["FL_hip".to_owned()], RECORDINGS),
            readings: (0..RECORDINGS).map(one).collect(),
        }
    }

    fn cost(&self) -> Box<dyn Cost> {
        let recorded = |readings: &Vec<f64>| Recorded {
            position: readings.clone(),
            velocity: (0..SAMPLES).map(|t| readings[t] - readings[t.saturating_sub(1)]).collect(),
            ..Recorded::default()
        };
        let recorded: Vec<Recorded> = self.readings.iter().map(recorded).collect();
        let reference = Arc::new(Reference::new(self.identity.joints.clone(), &recorded, 0).unwrap());
        "matchr1".parse::<CostKind>().unwrap().build(&reference, self).unwrap()
    }
}

impl Simulator for Process {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn simulate(
        &self,
        _theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
        _cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        for (candidate, rollout) in candidates.iter().enumerate() {
            for (recording, readings) in self.readings.iter().enumerate() {
                let from = |t: usize| readings[t.saturating_sub(1)];
                let to = |t: usize| match t {
                    0 => readings[0],
                    _ => {
                        2.0 * rollout.values[0] * from(t) + 10.0 * rollout.values[1] * drive(recording, t - 1)
                    }
                };
                let position: Vec<f32> = (0..SAMPLES).map(|t| to(t) as f32).collect();
                let velocity: Vec<f32> = (0..SAMPLES).map(|t| (to(t) - from(t)) as f32).collect();
                consume(candidate, recording, Signals::of_joints(&position, &velocity));
            }
        }
        Ok(())
    }
}

/// The process as it makes readings; it fails above `most`.
struct Toy {
    most: f64,
    /// What readings show of a change of both values together, each in deviations of the search.
    shown: f64,
}

impl Toy {
    fn new(most: f64) -> Self {
        Self { most, shown: 1.0 }
    }

    /// The values of the process by which readings are made.
    fn acting(&self, values: &[f64]) -> Vec<f64> {
        let deviations = theta().entries().iter().map(|entry| entry.deviation).collect::<Vec<_>>();
        let off = |at: usize| (values[at] - MIDDLE[at]) / deviations[at];
        let hidden = (1.0 - self.shown) * 0.5 * (off(0) + off(1));
        values.iter().zip(deviations).map(|(value, deviation)| value - hidden * deviation).collect()
    }
}

impl World for Toy {
    fn replicates(&self, values: &[f64], noise: f64, numbers: &[u32]) -> Result<Vec<Replicate>, String> {
        if values[0] > self.most {
            return Err("It falls.".to_owned());
        }
        let one = |&number: &u32| {
            let process = Process::new(&self.acting(values), noise, 1000 + u64::from(number));
            let cost = process.cost();
            Replicate { simulator: Box::new(process), cost }
        };
        Ok(numbers.iter().map(one).collect())
    }
}

fn theta() -> Theta {
    let rule = |kind| ParameterRule { per: Sharing::All, ..ParameterRule::new(kind) };
    let rules = [
        ParameterRule { upper: Some(0.5), ..rule(JointParameter::FrictionLoss) },
        rule(JointParameter::Armature),
    ];
    Theta::from_rules(&rules, &[], &["FL_hip".to_owned()]).unwrap()
}

/// The fit of readings with `noise`, corrected in `world`, and why it is not.
fn fitted(noise: f64, seed: u64, world: &Toy) -> (CostOutcome, Option<String>) {
    let (process, theta) = (Process::new(&world.acting(&TRUTH), noise, seed), theta());
    let costs = vec![process.cost()];
    let options = FitOptions { method: Method::LeastSquares, generations: 40, ..FitOptions::default() };
    let mut fit = Fit::new(&process, &theta, &costs, options).unwrap();
    while fit.step(&never).unwrap().is_some() {}
    let mut outcome = fit.outcomes().remove(0);
    let cost = costs[0].as_ref();
    let problem = Problem { simulator: &process, theta: &theta, cost, draw: outcome.draw(), cancel: &never };
    let refused = outcome.correct(problem, world, 4).unwrap();
    outcome.trust(problem, &[]).unwrap();
    (outcome, refused)
}

fn correction(outcome: &CostOutcome) -> &Correction {
    outcome.correction.as_ref().unwrap()
}

#[test]
fn attenuation_and_the_noise_that_makes_it_are_found() {
    let (outcome, refused) = fitted(0.4, 1, &Toy::new(1.0));
    assert_eq!(refused, None);
    let corrected = correction(&outcome);
    // Least squares take noise of the readings for a loss of memory.
    assert!(
        corrected.uncorrected[0] < 0.97 * TRUTH[0] && corrected.uncorrected[1] > 1.06 * TRUTH[1],
        "{corrected:?}"
    );
    assert!((corrected.torque_noise / 0.4 - 1.0).abs() < 0.2, "{}", corrected.torque_noise);
    for (value, truth) in outcome.values().iter().zip(TRUTH) {
        assert!((value / truth - 1.0).abs() < 0.05, "{value} for {truth}");
    }
    assert_eq!(outcome.parameters[0].uncorrected, Some(corrected.uncorrected[0]));
    // The cost is that of the corrected values: they predict the readings worse.
    assert!(outcome.best_cost > outcome.runs[0].best_cost);
    // A process without noise is left where it is.
    let (outcome, _) = fitted(0.0, 2, &Toy::new(1.0));
    let corrected = correction(&outcome);
    assert!(
        corrected.by().iter().zip(&corrected.spread).all(|(by, spread)| by.abs() < 3.0 * spread),
        "{corrected:?}"
    );
}

#[test]
fn corrected_intervals_of_many_fits_cover_the_truth() {
    let (mut inside, mut before, mut all) = (0, 0, 0);
    for seed in 0..30 {
        let (outcome, _) = fitted(0.4, 100 + seed, &Toy::new(1.0));
        let uncertainty = outcome.uncertainty.as_ref().unwrap();
        for (at, ([low, high], truth)) in uncertainty.interval.iter().zip(TRUTH).enumerate() {
            inside += usize::from((*low..=*high).contains(&truth));
            let by = correction(&outcome).by()[at];
            before += usize::from((low - by..=high - by).contains(&truth));
            all += 1;
        }
        assert!(uncertainty.draws.iter().flatten().all(|value| (0.0..=0.5).contains(value)));
    }
    // 57 of 60 are due; uncorrected, a quarter.
    assert!(inside >= 52, "{inside} of {all}");
    assert!(before <= 30, "{before} of {all}");
}

#[test]
fn a_robot_that_cannot_be_simulated_leaves_the_values_as_they_are() {
    let (outcome, refused) = fitted(0.4, 1, &Toy::new(0.1));
    assert_eq!(refused.as_deref(), Some("It falls."));
    assert!(outcome.correction.is_none() && outcome.parameters[0].uncorrected.is_none());
    assert_eq!(outcome.values(), outcome.runs[0].values);
    assert_eq!(outcome.best_cost, outcome.runs[0].best_cost);
}

#[test]
fn how_a_fit_answers_to_the_robot_is_learnt() {
    // With twice the noise a fit moves by one and a half of what the process moves by.
    let (outcome, refused) = fitted(0.8, 7, &Toy::new(1.0));
    assert_eq!(refused, None);
    let corrected = correction(&outcome);
    assert!(
        corrected.uncorrected[0] < 0.9 * TRUTH[0] && corrected.uncorrected[1] > 1.25 * TRUTH[1],
        "{corrected:?}"
    );
    assert!(corrected.response[0][0] < 0.8, "{:?}", corrected.response);
    // Four rounds are not enough where the first ones go too far.
    assert!((5..=10).contains(&corrected.rounds.len()), "{}", corrected.rounds.len());
    let uncertainty = outcome.uncertainty.as_ref().unwrap();
    for ((value, truth), [low, high]) in outcome.values().iter().zip(TRUTH).zip(&uncertainty.interval) {
        assert!((value / truth - 1.0).abs() < 0.03, "{value} for {truth}");
        assert!((*low..=*high).contains(&truth), "{low} to {high}");
    }
}

#[test]
fn a_change_that_fits_answer_weakly_to_is_followed_far() {
    let (outcome, refused) = fitted(0.0, 3, &Toy { shown: 0.2, ..Toy::new(1.0) });
    assert_eq!(refused, None);
    let corrected = correction(&outcome);
    assert!(
        corrected.uncorrected[0] < 0.9 * TRUTH[0] && corrected.uncorrected[1] < 0.7 * TRUTH[1],
        "{corrected:?}"
    );
    // The fifth round goes a deviation beyond where the others are, to learn the answer.
    let moved = |at: usize| (corrected.rounds[at].values[1] - corrected.rounds[at - 1].values[1]) / 0.05;
    assert!(moved(4) > 0.8 && moved(5) < -0.8 && moved(3) < 0.5, "{:?}", corrected.rounds);
    // Its own noise does not count.
    let noise: Vec<f64> = [5, 7].map(|at| corrected.rounds[at].torque_noise).to_vec();
    assert!((corrected.torque_noise - 0.5 * (noise[0] + noise[1])).abs() < 1e-12, "{:?}", corrected.rounds);
    let uncertainty = outcome.uncertainty.as_ref().unwrap();
    let rows = outcome.values().into_iter().zip(&corrected.uncorrected).zip(TRUTH).zip(&uncertainty.interval);
    for (((value, before), truth), [low, high]) in rows {
        assert!((value - truth).abs() < 0.6 * (before - truth).abs(), "{before}, then {value}, for {truth}");
        assert!((*low..=*high).contains(&truth) && high - low > 0.05, "{low} to {high}");
    }
}
