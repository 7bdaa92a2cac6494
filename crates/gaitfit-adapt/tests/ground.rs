//! Privileged costs, falls, random numbers, identification and networks, on simulators of a few formulas.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

#[path = "ground/identified.rs"]
mod identified;

use gaitfit_adapt::cmaes::{BoundHandling, CovarianceKind};
use gaitfit_adapt::cost::{
    Cost, CostError, CostKind, MatchR, Recorded, Reference, Signal, TimeAligned, Wass, Weights,
};
use gaitfit_adapt::fit::{
    Alternative, FallPenalty, Fit, FitOptions, Job, Method, NoiseSource, Predicted, RandomNumbers, evaluate,
    identify, simulate_one,
};
use gaitfit_adapt::{
    Cancel, Consume, Entry, Identity, Modification, NetworkName, NetworkRule, NetworkStart, Resets, Rollout,
    Signals, Simulator, SimulatorError, Theta, never,
};
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::Candidate;
use std::num::NonZeroUsize;
use std::sync::{Arc, Mutex};

/// Numbers without a robot: what only a formula knows.
#[derive(Debug)]
struct Numbers(Vec<Entry>);

impl Modification for Numbers {
    fn entries(&self) -> &[Entry] {
        &self.0
    }

    fn apply(&self, _values: &[f64], _joints: &[String], _candidate: &mut Candidate) {}
}

fn theta(names: &[&str], start: f64) -> Theta {
    let entry = |name: &&str| Entry {
        name: name.to_string(),
        kind: "number",
        unit: "-".into(),
        joints: vec![name.to_string()],
        lower: 0.0,
        upper: 2.0,
        start,
        deviation: 0.2,
    };
    Theta::new(vec![Box::new(Numbers(names.iter().map(entry).collect()))]).unwrap()
}

/// A driven pendulum with friction on a base it pushes: x'' = −4 x − a x' + sin(ω t), base velocity = b x. Value 0 is
/// a, value 1 is b, further ones do nothing. Falls where |x| exceeds `reach`.
struct Pendulum {
    identity: Identity,
    /// What the robot did: the states to be reset to; `samples × (x, x', base position, base velocity)`.
    logs: Vec<Vec<[f64; 4]>>,
    reach: f64,
    noise: f64,
    draws: Mutex<Vec<u64>>,
}

const SIGNALS: [Signal; 4] = [Signal::Position, Signal::Velocity, Signal::BasePosition, Signal::BaseVelocity];
const SAMPLES: usize = 150;
const STEP: f64 = 0.02;

impl Pendulum {
    fn new(recordings: usize, noise: f64) -> Self {
        let mut pendulum = Self {
            identity: Identity::new(vec!["hip".into()], recordings).with_signals(&SIGNALS),
            logs: Vec::new(),
            reach: f64::INFINITY,
            noise,
            draws: Mutex::default(),
        };
        for recording in 0..recordings {
            pendulum.logs.push(pendulum.run(recording, &TRUTH, Resets::Never, 999));
        }
        pendulum
    }

    fn run(&self, recording: usize, values: &[f64], resets: Resets, draw: u64) -> Vec<[f64; 4]> {
        let stream = Stream::new(draw, Purpose::TORQUE_NOISE).environment(recording as u32);
        let mut state = [0.1 + 0.05 * recording as f64, 0.0, 0.0, 0.0];
        let mut states = vec![state];
        for sample in 1..SAMPLES {
            let noise = self.noise * stream.normal(sample as u32);
            let [x, v, base, _] = state;
            let t = STEP * sample as f64;
            let drive = ((1.5 + 0.3 * recording as f64) * t).sin();
            let v = v + STEP * (drive - 4.0 * x - values[0] * v + noise);
            let x = x + STEP * v;
            let speed = values[1] * x;
            state = [x, v, base + STEP * speed, speed];
            states.push(state);
            let every = match resets {
                Resets::Never => usize::MAX,
                Resets::State(every) | Resets::Sensors(every) => every,
            };
            if sample % every == 0 {
                state = self.logs[recording][sample];
            }
        }
        states
    }

    fn target(&self, base: bool) -> Arc<Reference> {
        let recorded: Vec<Recorded> = self
            .logs
            .iter()
            .map(|log| {
                let axes = |k: usize| log.iter().flat_map(|state| [state[k], 0.0, 0.3]).collect::<Vec<f64>>();
                Recorded {
                    position: log.iter().map(|state| state[0]).collect(),
                    velocity: log.iter().map(|state| state[1]).collect(),
                    action: None,
                    base_position: base.then(|| axes(2)),
                    base_velocity: base.then(|| axes(3)),
                }
            })
            .collect();
        Arc::new(Reference::new(self.identity.joints.clone(), &recorded, 0).unwrap())
    }

    fn cost(&self, name: &str) -> Box<dyn Cost> {
        name.parse::<CostKind>().unwrap().build(&self.target(true), self).unwrap()
    }
}

const TRUTH: [f64; 2] = [0.5, 0.8];

impl Simulator for Pendulum {
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
            self.draws.lock().unwrap().push(rollout.draw);
            for recording in 0..self.logs.len() {
                let states = self.run(recording, &rollout.values, rollout.resets, rollout.draw);
                let column = |k: usize| states.iter().map(|state| state[k] as f32).collect::<Vec<f32>>();
                let axes = |k: usize| {
                    states.iter().flat_map(|state| [state[k] as f32, 0.0, 0.3]).collect::<Vec<f32>>()
                };
                let (position, velocity, base, speed) = (column(0), column(1), axes(2), axes(3));
                let fell_at = states.iter().position(|state| state[0].abs() > self.reach);
                let signals = Signals::of_joints(&position, &velocity);
                let base_signals =
                    Signals { base_position: Some(&base), base_velocity: Some(&speed), ..signals };
                consume(candidate, recording, Signals { fell_at, ..base_signals });
            }
        }
        Ok(())
    }
}

fn options(generations: usize) -> FitOptions {
    FitOptions {
        method: Method::Auto,
        population: 0,
        generations,
        restarts: 0,
        seeds: vec![1],
        covariance: CovarianceKind::Full,
        bounds: BoundHandling::Reflect,
        patience: 0,
        tolerance: 1e-7,
        falls: FallPenalty::default(),
        random_numbers: RandomNumbers::default(),
    }
}

fn value(simulator: &Pendulum, cost: &[Box<dyn Cost>], values: &[f64]) -> f64 {
    let job = Job { cost: 0, values: values.to_vec(), draw: 7 };
    let theta = theta(&["a", "b", "idle"][..values.len()], 1.0);
    evaluate(simulator, &theta, cost, &FallPenalty::default(), &[job], &never).unwrap()[0].cost.unwrap()
}

/// The squared cost is a parabola about the truth, for small errors as for large ones.
#[test]
fn privileged_costs_are_sharp_at_the_truth() {
    let simulator = Pendulum::new(2, 0.0);
    for name in ["matchs1", "matchs20", "matchs", "matcho"] {
        let cost = [simulator.cost(name)];
        assert_eq!(cost[0].name(), name);
        assert!(value(&simulator, &cost, &TRUTH) < 1e-7, "{name}");
        let at = |error: f64| value(&simulator, &cost, &[TRUTH[0] + error, TRUTH[1]]);
        let (small, large) = (at(0.002), at(0.02));
        assert!((large / small - 10.0).abs() < 0.2, "{name}: {small} {large}");
    }
    for name in ["matchs1", "matchs20", "matchs", "matchr1", "matchr20"] {
        let costs = [simulator.cost(name)];
        let theta = theta(&["a", "b"], 1.2);
        let mut fit = Fit::new(&simulator, &theta, &costs, options(250)).unwrap();
        while fit.step(&never).unwrap().is_some() {}
        // MatchR does not look at the base, which alone shows the second value.
        let shown = if name.starts_with("matchr") { 1 } else { 2 };
        for (value, truth) in fit.outcomes()[0].values().iter().zip(TRUTH).take(shown) {
            assert!((value / truth - 1.0).abs() < 1e-3, "{name}: {value} {truth}");
        }
    }
}

/// Resets make a horizon of one a one-step prediction: the larger H, the more an error has time to grow.
#[test]
fn errors_grow_with_the_horizon() {
    let simulator = Pendulum::new(1, 0.0);
    let off = |name: &str| value(&simulator, &[simulator.cost(name)], &[0.9, 0.8]);
    let (one, five, twenty) = (off("matchs1"), off("matchs5"), off("matchs20"));
    assert!(0.0 < one && 2.0 * one < five && 1.5 * five < twenty, "{one} {five} {twenty}");
}

#[test]
fn a_log_without_the_base_refuses_privileged_costs_by_name() {
    let simulator = Pendulum::new(1, 0.0);
    let target = simulator.target(false);
    let error = CostKind::MatchS(NonZeroUsize::new(20)).build(&target, &simulator).err().unwrap();
    assert_eq!(
        error,
        CostError::Privileged { cost: "matchs20".into(), signal: Signal::BasePosition },
        "{error}"
    );
    assert!(CostKind::Wass.build(&target, &simulator).is_ok());
    let target = simulator.target(true);
    let constant = target.constant();
    assert_eq!(constant[0], (Signal::BasePosition, "y"));
}

/// Of two runs of x = 0 … 3, the second loses its last two samples: the cost of each is worked out by hand.
#[test]
fn samples_lost_to_a_fall_count_as_the_whole_range() {
    let recorded = Recorded {
        position: vec![0.0, 1.0, 2.0, 3.0],
        velocity: vec![0.0, 1.0, 0.0, 1.0],
        ..Recorded::default()
    };
    let target = Arc::new(Reference::new(vec!["hip".into()], &[recorded.clone(), recorded], 0).unwrap());
    let good =
        Predicted { position: vec![0.0, 1.0, 2.0, 3.0], velocity: vec![0.0; 4], ..Predicted::default() };
    let bad = Predicted { position: vec![0.0, 1.0, f32::NAN, f32::NAN], fell_at: Some(2), ..good.clone() };
    let run = |cost: &dyn Cost, second: &Predicted| {
        let mut accumulator = cost.begin();
        accumulator.add(0, good.signals()).unwrap();
        accumulator.add(1, second.signals()).unwrap();
        accumulator.finish().unwrap().total
    };
    let aligned = TimeAligned::match_s(Arc::clone(&target), Weights::POSITION, None).unwrap();
    assert_eq!(run(&aligned, &good), 0.0);
    // Two of eight samples at 2: √(2 · 4 / 8).
    assert_eq!(run(&aligned, &bad), 1.0);
    // Velocities range over 1, so that an error of 1 is e = 2: the good run has it in two of four samples.
    let robust = MatchR::new(Arc::clone(&target), NonZeroUsize::MIN).unwrap();
    assert_eq!(run(&robust, &good), 1.0);
    // Two of eight positions are lost at 2; of the velocities two are off by 2, one of them lost, and one more is.
    assert_eq!(run(&robust, &bad), 0.5 + 1.25);
    let wass = Wass::new(target, Weights::POSITION).unwrap();
    // Six samples {0, 0, 1, 1, 2, 3} against {0, 0, 1, 1, 2, 2, 3, 3}: ∫|F − G| = 1/12 + 1/6 + 1/12, times
    // the scale of 2/3, times three quarters; and a quarter at 2.
    let expected = 0.75 * (2.0 / 3.0) / 3.0 + 0.25 * 2.0;
    assert!((run(&wass, &bad) - expected).abs() < 1e-12, "{}", run(&wass, &bad));
    let at_once = Predicted { fell_at: Some(0), ..good.clone() };
    let mut accumulator = wass.begin();
    accumulator.add(0, at_once.signals()).unwrap();
    assert_eq!(accumulator.finish().unwrap().total, wass.lost());
}

#[test]
fn falls_are_counted_and_never_beat_standing() {
    // The log's robot stays within 0.5; candidates with little friction swing further and fall.
    let mut simulator = Pendulum::new(3, 0.0);
    let most = simulator.logs.iter().flatten().fold(0.0f64, |most, state| most.max(state[0].abs()));
    simulator.reach = most + 1e-6;
    let costs = [simulator.cost("wass")];
    let theta = theta(&["a", "b"], 0.6);
    let mut fit = Fit::new(&simulator, &theta, &costs, options(60)).unwrap();
    let mut falls = 0;
    while let Some(generation) = fit.step(&never).unwrap() {
        let run = &generation.runs[0];
        assert!(run.fallen <= run.falls && run.falls <= 3 * run.fallen, "{run:?}");
        falls += run.falls;
    }
    let outcome = &fit.outcomes()[0];
    assert!(falls > 0 && outcome.runs[0].falls == falls, "{falls}");
    assert!((outcome.values()[0] - TRUTH[0]).abs() < 0.02, "{:?}", outcome.values());

    let cost = costs[0].as_ref();
    let default = FallPenalty::default();
    // Weights 1 for position and velocity: a fall costs 2 + 2.
    assert_eq!((default.charge(cost, 0, 8), default.charge(cost, 1, 8)), (0.0, 4.0));
    let log_falls = FallPenalty { robot_rate: 0.25, robot_falls: 2, ..default };
    // Two falls were seen and two are expected: chance explains 2 + 2 √(2 + 2) = 6.
    assert_eq!((log_falls.charge(cost, 6, 8), log_falls.charge(cost, 8, 8)), (0.0, 1.0));
    // With four starts of each recording 8 are expected: chance explains 8 + 2 √(8 + 32) = 20.6.
    assert_eq!((log_falls.charge(cost, 21, 32), log_falls.charge(cost, 23, 32)), (0.0, 0.25));
    assert_eq!(FallPenalty { penalty: Some(3.0), ..default }.charge(cost, 2, 8), 0.75);
}

#[test]
fn random_numbers_are_shared_as_asked() {
    let simulator = Pendulum::new(1, 0.1);
    let (theta, costs) = (theta(&["a", "b"], 1.0), [simulator.cost("wass")]);
    let draws = |random_numbers: RandomNumbers| {
        simulator.draws.lock().unwrap().clear();
        let options = FitOptions { population: 4, random_numbers, ..options(2) };
        let mut fit = Fit::new(&simulator, &theta, &costs, options).unwrap();
        while fit.step(&never).unwrap().is_some() {}
        let draws = simulator.draws.lock().unwrap().clone();
        let mut distinct = draws.clone();
        distinct.sort_unstable();
        distinct.dedup();
        (draws, distinct.len())
    };
    assert_eq!(draws(RandomNumbers::Run).1, 1);
    assert_eq!(draws(RandomNumbers::Candidate).1, 8);
    let (draws, distinct) = draws(RandomNumbers::Generation);
    assert_eq!(distinct, 2);
    assert!(draws[0] == draws[3] && draws[3] != draws[4]);
}
