//! The readings of an inertial unit that a log lacks, estimated from the policy's actions.

use super::observation::{self, Given};
use gaitfit_log::Trajectory;
use gaitfit_policy::network::Scratch;
use gaitfit_policy::observation::Layout;
use gaitfit_policy::{Interface, Policy};
use nalgebra::{DMatrix, DVector};

/// Max steps of the search for the missing readings.
const STEPS: usize = 10;
/// Weight of an action's error against an unknown's distance from rest, both relative to their spread.
const PRECISION: f64 = 30.0;
/// Phases of a gait clock that are tried; a log does not say when the clock began.
const PHASES: usize = 20;

/// The phases of the gait clock at a log's first sample that are tried; 0 alone for policies without a clock.
pub fn phases(interface: &Interface) -> impl ExactSizeIterator<Item = f64> + use<> {
    let clocked = interface.observation.iter().any(|term| term.quantity.is_of_clock());
    let count = if clocked { PHASES } else { 1 };
    (0..count).map(|phase| phase as f64 / PHASES as f64)
}

/// Estimates the numbers that a sample lacks, by Levenberg–Marquardt on ‖PRECISION (π(o) − a) / spread‖² + ‖unknown / spread‖².
pub struct Search<'a> {
    policy: &'a Policy,
    layout: Layout,
    spread: &'a [f64],
    scratch: Scratch,
    observation: Vec<f32>,
    action: Vec<f32>,
}

/// The actions of one moment, policy order, within their limits.
pub fn clipped(interface: &Interface, actions: impl Iterator<Item = f64>) -> Vec<f64> {
    let within = |(joint, action): (usize, f64)| {
        let clip = interface.clip(joint);
        action.clamp(-clip, clip)
    };
    actions.enumerate().map(within).collect()
}

/// Step of finite differences, relative to an unknown's spread. `f32` networks resolve 1e-6.
const DIFFERENCE: f64 = 0.01;

impl<'a> Search<'a> {
    /// `spread`: of each joint's actions.
    pub fn new(policy: &'a Policy, spread: &'a [f64]) -> Self {
        Self {
            policy,
            layout: Layout::new(&policy.interface, &policy.interface.observation),
            spread,
            scratch: Scratch::default(),
            observation: Vec::new(),
            action: Vec::new(),
        }
    }

    /// Frames that the policy observes.
    pub fn frames(&self) -> usize {
        self.layout.frames()
    }

    /// The policy's actions where the log is in `all` the states of its base; one row each.
    fn act(
        &mut self,
        log: &Trajectory,
        sample: usize,
        last: &[f64],
        all: &[Given],
        clock: f64,
    ) -> Vec<Vec<f64>> {
        let interface = &self.policy.interface;
        let (width, joints) = (self.layout.width(), interface.joints.len());
        // All rows are of the same sample, so they share its past.
        let past = observation::past(&self.layout, interface, log, sample, clock);
        let past = past.as_deref();
        self.observation.resize(all.len() * width, 0.0);
        self.action.resize(all.len() * joints, 0.0);
        for (given, row) in all.iter().zip(self.observation.chunks_exact_mut(width)) {
            observation::write(&self.layout, interface, log, sample, last, given, clock, past, row);
        }
        self.policy.act(all.len(), &self.observation, &mut self.action, &mut self.scratch);
        let row = |row: &[f32]| clipped(interface, row.iter().map(|&x| f64::from(x)));
        self.action.chunks_exact(joints).map(row).collect()
    }

    /// The policy's action nearest to `logged`, and the state of the base in which it is chosen.
    pub fn nearest(
        &mut self,
        log: &Trajectory,
        sample: usize,
        last: &[f64],
        given: &Given,
        clock: f64,
        logged: &[f64],
    ) -> (Vec<f64>, Given) {
        let missing = given.missing(&self.policy.interface);
        let unknowns = missing.len();
        // The first guess: level and at rest, the most likely state.
        let mut values = vec![0.0; unknowns];
        let mut action = self.act(log, sample, last, &[given.filled(&missing, &values)], clock).remove(0);
        if unknowns == 0 {
            return (action, *given);
        }
        let spreads = self.spread;
        // Errors relative to the spread of each action, weighted against the price of unusual states.
        let error = |action: &[f64]| -> DVector<f64> {
            let each = action.iter().zip(logged).zip(spreads).map(|((a, b), s)| PRECISION * (a - b) / s);
            DVector::from_iterator(logged.len(), each)
        };
        let relative = |values: &[f64]| -> DVector<f64> {
            DVector::from_iterator(
                unknowns,
                values.iter().zip(&missing).map(|(x, unknown)| x / unknown.spread()),
            )
        };
        let mut residual = error(&action);
        let mut price = residual.norm_squared() + relative(&values).norm_squared();
        // The damping is relative to the curvature's diagonal, so the first step is nearly one of Gauss and
        // Newton.
        let mut damping = 1e-3;
        for _ in 0..STEPS {
            // Forward differences; the policy acts on all probes at once.
            let probes: Vec<Given> = (0..unknowns)
                .map(|k| {
                    let mut values = values.clone();
                    values[k] += DIFFERENCE * missing[k].spread();
                    given.filled(&missing, &values)
                })
                .collect();
            let probes = self.act(log, sample, last, &probes, clock);
            // Columns: change of the residual per unit of unknown / spread.
            let slopes = DMatrix::from_fn(logged.len(), unknowns, |joint, k| {
                PRECISION * (probes[k][joint] - action[joint]) / (spreads[joint] * DIFFERENCE)
            });
            let pull = slopes.tr_mul(&residual) + relative(&values);
            // The identity is the curvature of the unknowns' own price, whose unit is their spread.
            let curvature = slopes.tr_mul(&slopes) + DMatrix::identity(unknowns, unknowns);
            // Marquardt (1963): the damping rises until a step lowers the price, and falls after it.
            let mut moved = false;
            // The fourth try has 125 times the damping. If it does not lower the price either, the search
            // ends.
            for _ in 0..4 {
                let damped = &curvature + DMatrix::from_diagonal(&curvature.diagonal()) * damping;
                let Some(factor) = damped.cholesky() else { break };
                let step = factor.solve(&pull);
                let trial: Vec<f64> =
                    (0..unknowns).map(|k| values[k] - step[k] * missing[k].spread()).collect();
                let there = self.act(log, sample, last, &[given.filled(&missing, &trial)], clock).remove(0);
                let off = error(&there);
                let cost = off.norm_squared() + relative(&trial).norm_squared();
                if cost < price {
                    // A step that gains little is the last one.
                    moved = price - cost > 1e-4 * price;
                    (values, action, residual, price) = (trial, there, off, cost);
                    damping = (damping * 0.3).max(1e-6);
                    break;
                }
                damping *= 5.0;
            }
            if !moved {
                break;
            }
        }
        (action, given.filled(&missing, &values))
    }

    /// Phase of the gait clock at the log's first sample; 0 for policies without one.
    pub fn clock(&mut self, log: &Trajectory, chosen: &[(usize, Vec<f64>, Vec<f64>)]) -> f64 {
        let phases = phases(&self.policy.interface);
        if phases.len() == 1 {
            return 0.0;
        }
        // About 20 samples, spread over the log, are enough for one unknown.
        let some: Vec<_> = chosen.iter().step_by(chosen.len().div_ceil(20).max(1)).collect();
        let mut best = (f64::INFINITY, 0.0);
        for clock in phases {
            let mut off = 0.0;
            for (sample, logged, last) in &some {
                let given = Given::from_log(log, *sample);
                let action = self.act(log, *sample, last, &[given], clock).remove(0);
                off += action.iter().zip(logged).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
            }
            if off < best.0 {
                best = (off, clock);
            }
        }
        best.1
    }
}
