//! What a simulator behind the trait may do: evaluate costs itself, and be cancelled inside a batch.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_adapt::cmaes::{BoundHandling, CovarianceKind};
use gaitfit_adapt::cost::{Cost, CostKind, Recorded, Reference};
use gaitfit_adapt::fit::{Evaluation, FallPenalty, Fit, FitError, FitOptions, Job, Method, RandomNumbers};
use gaitfit_adapt::{
    Cancel, Consume, Identity, JointParameter, ParameterRule, Rollout, Sharing, Signals, Simulator,
    SimulatorError, Theta, never,
};
use std::sync::Arc;
use std::sync::atomic::{AtomicUsize, Ordering};

const TRUTH: f64 = 0.3;

/// q = damping · t. `device`: costs are evaluated without signals, as an engine on a GPU would.
struct Line {
    identity: Identity,
    device: bool,
}

impl Simulator for Line {
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
        assert!(!self.device, "no signals come back");
        for (candidate, rollout) in candidates.iter().enumerate() {
            if cancel() {
                return Err(SimulatorError::Cancelled);
            }
            let line: Vec<f32> = (0..50).map(|t| (rollout.values[0] * f64::from(t)) as f32).collect();
            consume(candidate, 0, Signals::of_joints(&line, &line));
        }
        Ok(())
    }

    fn costs(
        &self,
        theta: &Theta,
        costs: &[Box<dyn Cost>],
        jobs: &[Job],
        cancel: &Cancel<'_>,
    ) -> Result<Vec<Evaluation>, FitError> {
        if !self.device {
            return gaitfit_adapt::fit::accumulate(self, theta, costs, jobs, cancel);
        }
        let cost = |job: &Job| Evaluation { cost: Some((job.values[0] - TRUTH).abs()), falls: 0 };
        Ok(jobs.iter().map(cost).collect())
    }
}

fn line(device: bool) -> Line {
    Line { identity: Identity::new(vec!["FL_hip".to_owned()], 1), device }
}

fn theta() -> Theta {
    let damping = ParameterRule { per: Sharing::All, ..ParameterRule::new(JointParameter::Damping) };
    Theta::from_rules(&[damping], &[], line(false).joints()).unwrap()
}

fn costs(simulator: &Line) -> Vec<Box<dyn Cost>> {
    let line: Vec<f64> = (0..50).map(|t| TRUTH * f64::from(t)).collect();
    let recorded = Recorded { position: line.clone(), velocity: line, ..Recorded::default() };
    let reference = Arc::new(Reference::new(simulator.identity.joints.clone(), &[recorded], 0).unwrap());
    vec![CostKind::MatchO.build(&reference, simulator).unwrap()]
}

fn options() -> FitOptions {
    FitOptions {
        method: Method::Auto,
        population: 6,
        generations: 60,
        restarts: 0,
        seeds: vec![1],
        covariance: CovarianceKind::Full,
        bounds: BoundHandling::Reflect,
        patience: 0,
        tolerance: 1e-6,
        falls: FallPenalty::default(),
        random_numbers: RandomNumbers::default(),
    }
}

#[test]
fn an_engine_that_evaluates_costs_itself_returns_no_signals() {
    let (simulator, theta) = (line(true), theta());
    let costs = costs(&simulator);
    let mut fit = Fit::new(&simulator, &theta, &costs, options()).unwrap();
    while fit.step(&never).unwrap().is_some() {}
    assert!((fit.outcomes()[0].values()[0] - TRUTH).abs() < 1e-4);
}

#[test]
fn a_generation_that_is_cancelled_leaves_the_fit_as_it_was() {
    let (simulator, theta) = (line(false), theta());
    let costs = costs(&simulator);
    let mut whole = Fit::new(&simulator, &theta, &costs, options()).unwrap();
    let mut cut = Fit::new(&simulator, &theta, &costs, options()).unwrap();
    for _ in 0..3 {
        whole.step(&never).unwrap();
        cut.step(&never).unwrap();
    }
    let asked = AtomicUsize::new(0);
    let error = cut.step(&|| asked.fetch_add(1, Ordering::Relaxed) >= 2).unwrap_err();
    assert!(matches!(error, FitError::Cancelled), "{error}");
    assert_eq!(asked.into_inner(), 3, "it ends at once");
    assert_eq!(cut.checkpoint(), whole.checkpoint());
    let mut resumed = Fit::resume(&simulator, &theta, &costs, options(), cut.checkpoint()).unwrap();
    while whole.step(&never).unwrap().is_some() {}
    while resumed.step(&never).unwrap().is_some() {}
    assert_eq!(resumed.outcomes(), whole.outcomes());
}
