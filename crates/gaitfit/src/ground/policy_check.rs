//! Whether a log's actions are the policy's: they follow from the log's own observations, or they do not.
//!
//! What the log lacks of an observation (all that an inertial unit measures, in a log of joint signals) is found sample
//! by sample: the values, near those of a level robot at rest, with which the policy comes closest to the logged
//! action. A dozen actions stand against five unknowns (three rates, two of a unit vector), so that the right policy's
//! actions are met almost exactly and another's are not.

use super::observation::{self, Given};
use crate::exit::Failure;
use gaitfit_learn::Quantity;
use gaitfit_learn::policy::{ActScratch, Policy};
use gaitfit_log::Trajectory;
use nalgebra::{DMatrix, DVector};
use serde::Serialize;

/// Most samples that are looked at, evenly over the logs.
const MOST_SAMPLES: usize = 1500;
/// Samples below which nothing can be said.
const LEAST_SAMPLES: usize = 40;
/// Share of the samples, those least well met, that do not count: stumbles, dropouts, samples between two steps.
const LEFT_OUT: f64 = 0.1;
/// Most steps of the search for what the log lacks.
const STEPS: usize = 10;
/// Weight of an action's error against an unknown's distance from rest, both relative to their spread.
const PRECISION: f64 = 30.0;
/// Phases of a gait clock that are tried; a log does not say when the clock began.
const PHASES: usize = 20;
/// Mismatch from which on it is worth a warning, and from which on the policy is another.
const DOUBTFUL: f64 = 0.1;
const ANOTHER: f64 = 0.35;

/// How well logged actions follow from logged observations.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PolicyMatch {
    /// Whether the logs held the whole observation, base state included.
    pub exact: bool,
    /// Samples compared.
    pub samples: usize,
    /// RMS of (policy's action − logged action), relative to the logged actions' spread about their mean; over the best
    /// 90 % of the samples. 0: the same; 1: no better than a constant.
    pub mismatch: f64,
    /// As `mismatch`, if the logged actions were one sample earlier, and one later, than they are.
    pub shifted: [f64; 2],
    /// Factor on the policy's deviations from the mean that meets the logged actions best: 1 if the scale is right.
    pub slope: f64,
    /// Correlation of the policy's and the logged action, by joint.
    pub correlation: Vec<(String, f64)>,
    /// As `mismatch`, a log each.
    pub by_log: Vec<f64>,
}

/// Compares the actions of `logs` (joints in the policy's order, at its rate) with `policy`'s.
pub fn check(policy: &Policy, logs: &[&Trajectory]) -> PolicyMatch {
    let here = Comparison::new(policy, logs, 0);
    PolicyMatch {
        exact: here.exact,
        samples: here.samples.len(),
        mismatch: here.mismatch(None),
        shifted: [-1, 1].map(|shift| Comparison::new(policy, logs, shift).mismatch(None)),
        slope: here.slope(),
        correlation: here.correlation(&policy.interface.joints),
        by_log: (0..logs.len()).map(|log| here.mismatch(Some(log))).collect(),
    }
}

/// Logged actions beside the policy's.
struct Comparison {
    joints: usize,
    /// Log of each sample.
    samples: Vec<usize>,
    /// `samples × joints`.
    logged: Vec<f64>,
    /// `samples × joints`, with the best values of what the log lacks.
    predicted: Vec<f64>,
    exact: bool,
}

impl Comparison {
    /// `shift`: samples by which the logged actions are taken later than the row they stand in.
    fn new(policy: &Policy, logs: &[&Trajectory], shift: isize) -> Self {
        let interface = &policy.interface;
        let joints = interface.joints.len();
        let all: usize = logs.iter().map(|log| log.len()).sum();
        let every = all.div_ceil(MOST_SAMPLES).max(1);
        let spread = spread(logs, joints);
        let clip = interface.action_clip.unwrap_or(f64::INFINITY);
        let mut this =
            Self { joints, samples: Vec::new(), logged: Vec::new(), predicted: Vec::new(), exact: true };
        let mut search = Search::new(policy, &spread, clip);
        let mut seen = 0;
        for (number, log) in logs.iter().enumerate() {
            let Some(action) = &log.action else { continue };
            let row = |row: usize| -> Vec<f64> {
                action[row * joints..(row + 1) * joints].iter().map(|x| x.clamp(-clip, clip)).collect()
            };
            let mut chosen = Vec::new();
            // The first sample's last action is unknown.
            for sample in 1..log.len() {
                seen += 1;
                let at = sample.checked_add_signed(shift).filter(|&at| at >= 1 && at < log.len());
                if let Some(at) = at.filter(|_| seen % every == 0) {
                    chosen.push((sample, row(at), action[(at - 1) * joints..at * joints].to_vec()));
                }
            }
            let clock = search.clock(log, &chosen);
            for (sample, logged, last) in chosen {
                let given = Given::of(log, sample);
                this.exact &= given.missing(interface).is_empty();
                this.predicted.extend(search.nearest(log, sample, &last, &given, clock, &logged));
                this.logged.extend(logged);
                this.samples.push(number);
            }
        }
        this
    }

    /// Relative RMS difference over the best samples, of one log or all; NaN for none.
    fn mismatch(&self, log: Option<usize>) -> f64 {
        let mean = mean(&self.logged, self.joints);
        let mut squares: Vec<(f64, f64)> = Vec::new();
        let rows = self.logged.chunks_exact(self.joints).zip(self.predicted.chunks_exact(self.joints));
        for (&of, (logged, predicted)) in self.samples.iter().zip(rows) {
            if log.is_none_or(|log| log == of) {
                let error = logged.iter().zip(predicted).map(|(a, b)| (a - b).powi(2)).sum::<f64>();
                let away = logged.iter().zip(&mean).map(|(a, m)| (a - m).powi(2)).sum::<f64>();
                squares.push((error, away));
            }
        }
        let away = squares.iter().map(|(_, away)| away).sum::<f64>() / squares.len() as f64;
        squares.sort_by(|a, b| a.0.total_cmp(&b.0));
        let counted = ((1.0 - LEFT_OUT) * squares.len() as f64).ceil() as usize;
        let error = squares[..counted].iter().map(|(error, _)| error).sum::<f64>() / counted as f64;
        (error / away).sqrt()
    }

    fn slope(&self) -> f64 {
        let (logged, predicted) = (mean(&self.logged, self.joints), mean(&self.predicted, self.joints));
        let (mut both, mut own) = (0.0, 0.0);
        for (place, (a, b)) in self.logged.iter().zip(&self.predicted).enumerate() {
            let (a, b) = (a - logged[place % self.joints], b - predicted[place % self.joints]);
            both += a * b;
            own += b * b;
        }
        both / own
    }

    fn correlation(&self, names: &[String]) -> Vec<(String, f64)> {
        let (logged, predicted) = (mean(&self.logged, self.joints), mean(&self.predicted, self.joints));
        let of = |joint: usize| {
            let column = |values: &'_ [f64], mean: f64| -> Vec<f64> {
                values.iter().skip(joint).step_by(self.joints).map(|x| x - mean).collect()
            };
            let (a, b) = (column(&self.logged, logged[joint]), column(&self.predicted, predicted[joint]));
            let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let norm = (product(&a, &a) * product(&b, &b)).sqrt();
            if norm > 0.0 { product(&a, &b) / norm } else { 0.0 }
        };
        names.iter().enumerate().map(|(joint, name)| (name.clone(), of(joint))).collect()
    }
}

fn mean(values: &[f64], joints: usize) -> Vec<f64> {
    let rows = (values.len() / joints).max(1) as f64;
    (0..joints).map(|joint| values.iter().skip(joint).step_by(joints).sum::<f64>() / rows).collect()
}

/// Standard deviation of each joint's actions over all logs; 1 where they stand still.
fn spread(logs: &[&Trajectory], joints: usize) -> Vec<f64> {
    let all: Vec<f64> = logs.iter().flat_map(|log| log.action.iter().flatten().copied()).collect();
    let rows = (all.len() / joints).max(1) as f64;
    let mean = mean(&all, joints);
    let of = |joint: usize| {
        let squares = all.iter().skip(joint).step_by(joints).map(|x| (x - mean[joint]).powi(2)).sum::<f64>();
        let spread = (squares / rows).sqrt();
        if spread > 1e-9 { spread } else { 1.0 }
    };
    (0..joints).map(of).collect()
}

/// Finds what a sample lacks: Levenberg–Marquardt on ‖PRECISION (π(o) − a) / spread‖² + ‖unknown / spread‖².
struct Search<'a> {
    policy: &'a Policy,
    spread: &'a [f64],
    clip: f64,
    scratch: ActScratch,
    observation: Vec<f32>,
    action: Vec<f32>,
}

/// Step of finite differences, relative to an unknown's spread. `f32` networks resolve 1e-6.
const DIFFERENCE: f64 = 0.01;

impl<'a> Search<'a> {
    fn new(policy: &'a Policy, spread: &'a [f64], clip: f64) -> Self {
        Self {
            policy,
            spread,
            clip,
            scratch: ActScratch::default(),
            observation: Vec::new(),
            action: Vec::new(),
        }
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
        let (width, joints) = (interface.observation_width(), interface.joints.len());
        self.observation.resize(all.len() * width, 0.0);
        self.action.resize(all.len() * joints, 0.0);
        for (given, row) in all.iter().zip(self.observation.chunks_exact_mut(width)) {
            observation::write(self.policy, log, sample, last, given, clock, row);
        }
        self.policy.act(all.len(), &self.observation, &mut self.action, &mut self.scratch);
        let clip = self.clip;
        let row = |row: &[f32]| row.iter().map(|&x| f64::from(x).clamp(-clip, clip)).collect();
        self.action.chunks_exact(joints).map(row).collect()
    }

    /// The policy's action nearest to `logged`.
    fn nearest(
        &mut self,
        log: &Trajectory,
        sample: usize,
        last: &[f64],
        given: &Given,
        clock: f64,
        logged: &[f64],
    ) -> Vec<f64> {
        let missing = given.missing(&self.policy.interface);
        let unknowns = missing.len();
        let mut values = vec![0.0; unknowns];
        let mut action = self.act(log, sample, last, &[given.filled(&missing, &values)], clock).remove(0);
        if unknowns == 0 {
            return action;
        }
        let spreads = self.spread;
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
        let mut damping = 1e-3;
        for _ in 0..STEPS {
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
            let curvature = slopes.tr_mul(&slopes) + DMatrix::identity(unknowns, unknowns);
            let mut moved = false;
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
        action
    }

    /// Phase of the gait clock at the log's first sample; 0 for policies without one.
    fn clock(&mut self, log: &Trajectory, chosen: &[(usize, Vec<f64>, Vec<f64>)]) -> f64 {
        let clocked =
            self.policy.interface.observation.iter().any(|term| term.quantity == Quantity::GaitPhase);
        if !clocked {
            return 0.0;
        }
        let some: Vec<_> = chosen.iter().step_by(chosen.len().div_ceil(20).max(1)).collect();
        let mut best = (f64::INFINITY, 0.0);
        for phase in 0..PHASES {
            let clock = phase as f64 / PHASES as f64;
            let mut off = 0.0;
            for (sample, logged, last) in &some {
                let given = Given::of(log, *sample);
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

impl PolicyMatch {
    /// Correlation of the joint that agrees least.
    fn worst(&self) -> (&str, f64) {
        let least = self.correlation.iter().min_by(|a, b| a.1.total_cmp(&b.1));
        least.map_or(("", f64::NAN), |(name, value)| (name, *value))
    }

    /// What was measured, for messages.
    fn numbers(&self) -> String {
        let (joint, correlation) = self.worst();
        format!(
            "difference {:.3} of the actions' spread over {} samples{}; least correlation {correlation:.2}, at {joint}",
            self.mismatch,
            self.samples,
            if self.exact { "" } else { ", unmeasured base motion chosen in the policy's favour" }
        )
    }

    /// Warnings about a doubtful match. `policy` and `logs` are names for messages; `logs` as given to [`check`].
    ///
    /// # Errors
    /// Another policy: named, with the log that fits least.
    pub fn judge(&self, policy: &str, logs: &[&str]) -> Result<Vec<String>, Failure> {
        if self.samples < LEAST_SAMPLES || !self.mismatch.is_finite() {
            return Ok(vec![format!(
                "whether the logs' actions are those of {policy} cannot be told: {} samples that say something",
                self.samples
            )]);
        }
        if self.mismatch < DOUBTFUL {
            return Ok(Vec::new());
        }
        let numbers = self.numbers();
        let [earlier, later] = self.shifted;
        for (shifted, how, remedy) in [(earlier, "earlier", "later"), (later, "later", "earlier")] {
            if shifted < DOUBTFUL.max(0.5 * self.mismatch) && shifted < ANOTHER {
                return Ok(vec![format!(
                    "the logs' actions follow from {policy} one sample {how} than they are logged ({shifted:.3} there; \
                     {numbers}): log an action in the row of the state it was chosen in, or shift the columns act_… \
                     {remedy}",
                )]);
            }
        }
        if self.mismatch < ANOTHER {
            return Ok(vec![format!(
                "the logs' actions are not quite those of {policy} ({numbers}, best factor {:.2}): are filters, delays or \
                 another observation scale between the log and the policy?",
                self.slope
            )]);
        }
        let of = self.by_log.iter().zip(logs).filter(|(mismatch, _)| mismatch.is_finite());
        let worst = of.max_by(|a, b| a.0.total_cmp(b.0));
        let worst =
            worst.map_or(String::new(), |(mismatch, log)| format!("; worst: {log} with {mismatch:.2}"));
        Err(Failure::failed(format!(
            "the logs' actions do not follow from {policy}: {numbers}{worst}. Give the policy that walked while the logs \
             were recorded, and check its joint order, default pose and scales (`gaitfit inspect` shows a log)."
        )))
    }
}
