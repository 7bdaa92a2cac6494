//! Whether a log's actions are the policy's: they follow from the log's own observations, or they do not.
//!
//! A log may lack a part of an observation (in a log of joint signals, all readings of an inertial unit). This part is
//! estimated sample by sample: the values, near those of a level robot at rest, with which the policy comes closest to
//! the logged action. A dozen actions stand against five unknowns (three rates, two of a unit vector), so that the
//! right policy's actions are met almost exactly and another's are not.

use super::imu_search::{Search, clipped, phases};
use super::observation::{self, Given};
use crate::Error;
use gaitfit_log::Trajectory;
use gaitfit_model::counted;
use gaitfit_policy::Policy;
use gaitfit_policy::network::Scratch;
use gaitfit_policy::observation::{Layout, Past};
use serde::Serialize;

/// Max samples that are compared, evenly over the logs.
const MAX_SAMPLES: usize = 1500;
/// Min samples for a comparison.
const MIN_SAMPLES: usize = 40;
/// Share of the samples, those least well met, that do not count: stumbles, dropouts, samples between two steps.
const LEFT_OUT: f64 = 0.1;
/// Mismatch from which on it is worth a warning, and from which on the policy is another. Measured on logs of three
/// trained Go2 policies, joints only: the right policy 0.002–0.004 (0.06 where the log has other sensor noise than the
/// policy saw), actions a sample off 0.12–0.20, scaled by 1.2 0.12, commands lost 0.25–0.29; another policy of the same
/// task 0.39–0.49, legs permuted 0.63–0.84, scaled by a half 0.63.
const DOUBTFUL: f64 = 0.08;
const ANOTHER: f64 = 0.33;
/// Time at a log's beginning in which a recurrent policy's actions are not compared, s.
const SETTLE_S: f64 = 0.4;
/// Time after that in which the phase of its gait clock is looked for, s.
const CLOCK_S: f64 = 4.0;
/// Below this mismatch not even a shift is looked for.
const NOTICED: f64 = 0.02;

/// Agreement of logged actions with those that the policy computes from logged observations.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct PolicyMatch {
    /// Whether the logs held the whole observation, base state included.
    pub exact: bool,
    /// Samples compared.
    pub samples: usize,
    /// RMS of (policy's action − logged action), relative to the logged actions' spread about their mean; over the best
    /// 90 % of the samples. 0: the same; 1: no better than a constant.
    pub mismatch: f64,
    /// The mismatch if the logged actions were one sample earlier, and one later, than they are.
    pub shifted: [f64; 2],
    /// Factor on the policy's deviations from the mean that meets the logged actions best: 1 if the scale is right.
    pub slope: f64,
    /// Correlation of the policy's and the logged action, by joint.
    pub correlation: Vec<(String, f64)>,
    /// The mismatch of each log.
    pub by_log: Vec<f64>,
    /// Whether the policy follows a motion, in which logs may have a wrong place.
    #[serde(skip)]
    pub follows_motion: bool,
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
        follows_motion: policy.interface.reference.is_some(),
    }
}

/// [`PolicyMatch::mismatch`] alone; `None` where too few samples say anything.
pub fn mismatch(policy: &Policy, logs: &[&Trajectory]) -> Option<f64> {
    let here = Comparison::new(policy, logs, 0);
    let mismatch = here.mismatch(None);
    (here.samples.len() >= MIN_SAMPLES && mismatch.is_finite()).then_some(mismatch)
}

/// Like [`mismatch`], but over about `samples` samples.
pub(crate) fn mismatch_of(policy: &Policy, logs: &[&Trajectory], samples: usize) -> Option<f64> {
    let here = Comparison::over(policy, logs, 0, samples);
    let mismatch = here.mismatch(None);
    (here.samples.len() >= MIN_SAMPLES && mismatch.is_finite()).then_some(mismatch)
}

/// Returns [`PolicyMatch::slope`] alone, over about `samples` samples.
pub(crate) fn slope_of(policy: &Policy, logs: &[&Trajectory], samples: usize) -> f64 {
    Comparison::over(policy, logs, 0, samples).slope()
}

/// Logged actions beside the policy's.
struct Comparison {
    joints: usize,
    /// Log of each sample.
    samples: Vec<usize>,
    /// `samples × joints`.
    logged: Vec<f64>,
    /// `samples × joints`. Observations that the log lacks have the values that fit best.
    predicted: Vec<f64>,
    exact: bool,
}

impl Comparison {
    /// `shift`: samples by which the logged actions are taken later than the row they stand in.
    fn new(policy: &Policy, logs: &[&Trajectory], shift: isize) -> Self {
        Self::over(policy, logs, shift, MAX_SAMPLES)
    }

    /// The same over about `max` samples.
    fn over(policy: &Policy, logs: &[&Trajectory], shift: isize, max: usize) -> Self {
        let interface = &policy.interface;
        let joints = interface.joints.len();
        let samples: usize = logs.iter().map(|log| log.len()).sum();
        // Samples are thinned evenly over all logs, so that long ones do not fill the limit.
        let every = samples.div_ceil(max).max(1);
        let spread = spread(logs, joints);
        let mut this =
            Self { joints, samples: Vec::new(), logged: Vec::new(), predicted: Vec::new(), exact: true };
        let mut search = Search::new(policy, &spread);
        let mut seen = 0;
        for (number, log) in logs.iter().enumerate() {
            let Some(action) = &log.action else { continue };
            // A policy with a memory must act along the whole log, so single samples cannot be chosen.
            if policy.is_recurrent() {
                this.remembering(policy, log, number, action, shift, every, &mut seen);
                continue;
            }
            let row = |row: usize| -> Vec<f64> {
                clipped(interface, action[row * joints..(row + 1) * joints].iter().copied())
            };
            let mut chosen = Vec::new();
            // The first sample's last action is unknown. Of past frames too all must be known: a search for what
            // several samples lack would find it for any policy.
            let frames = search.frames();
            let known = |sample: usize| Given::from_log(log, sample).missing(interface).is_empty();
            for sample in frames..log.len() {
                if frames > 1 && !(sample + 1 - frames..=sample).all(known) {
                    continue;
                }
                seen += 1;
                // The logged action of this sample, or of a neighbour to test for a shift of one row.
                // The first row has no action before it, which the policy may observe.
                let at = sample.checked_add_signed(shift).filter(|&at| at >= 1 && at < log.len());
                if let Some(at) = at.filter(|_| seen % every == 0) {
                    chosen.push((sample, row(at), action[(at - 1) * joints..at * joints].to_vec()));
                }
            }
            // The phase of the gait clock is one unknown of the whole log, found before the samples.
            let clock = search.clock(log, &chosen);
            for (sample, logged, last) in chosen {
                let given = Given::from_log(log, sample);
                this.exact &= given.missing(interface).is_empty();
                this.predicted.extend(search.nearest(log, sample, &last, &given, clock, &logged).0);
                this.logged.extend(logged);
                this.samples.push(number);
            }
        }
        this
    }

    /// Samples of a recurrent policy, which acts along the whole log. A log that lacks anything says nothing, nor does
    /// its beginning, before which the policy may have seen more than the log holds.
    fn remembering(
        &mut self,
        policy: &Policy,
        log: &Trajectory,
        number: usize,
        action: &[f64],
        shift: isize,
        every: usize,
        seen: &mut usize,
    ) {
        let interface = &policy.interface;
        let joints = self.joints;
        // The memory keeps what was observed before, so one unknown sample makes all later ones unknown.
        if !(0..log.len()).all(|sample| Given::from_log(log, sample).missing(interface).is_empty()) {
            return;
        }
        let samples = |seconds: f64| (seconds / interface.control_dt).round() as usize;
        let settled = samples(SETTLE_S);
        // The logged action that the policy's action of a sample stands against.
        let logged = |sample: usize| {
            let at = sample.checked_add_signed(shift).filter(|&at| at >= 1 && at < log.len());
            let at = at.filter(|_| sample >= settled)?;
            Some(clipped(interface, action[at * joints..(at + 1) * joints].iter().copied()))
        };
        // A log does not say when the gait clock began. Its beginning is enough for one unknown.
        let beginning = log.len().min(settled + samples(CLOCK_S));
        let off = |clock: f64| -> f64 {
            let predicted = remembered(policy, log, action, clock, beginning);
            let rows = predicted.chunks_exact(joints).enumerate();
            let pairs = rows.filter_map(|(sample, row)| Some((row, logged(sample)?)));
            pairs
                .map(|(row, logged)| row.iter().zip(&logged).map(|(a, b)| (a - b).powi(2)).sum::<f64>())
                .sum()
        };
        let tried: Vec<f64> = phases(interface).collect();
        let clock = match tried.as_slice() {
            [only] => *only,
            _ => {
                let costs = tried.into_iter().map(|clock| (clock, off(clock)));
                costs.min_by(|a, b| a.1.total_cmp(&b.1)).map_or(0.0, |(clock, _)| clock)
            }
        };
        let predicted = remembered(policy, log, action, clock, log.len());
        for (sample, row) in predicted.chunks_exact(joints).enumerate() {
            *seen += 1;
            if let Some(logged) = logged(sample).filter(|_| seen.is_multiple_of(every)) {
                self.logged.extend(logged);
                self.predicted.extend(row);
                self.samples.push(number);
            }
        }
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
        // All samples count for the spread. Only the errors leave out the worst ones.
        let away = squares.iter().map(|(_, away)| away).sum::<f64>() / squares.len() as f64;
        squares.sort_by(|a, b| a.0.total_cmp(&b.0));
        // Rounded up, so that a single sample still counts.
        let counted = ((1.0 - LEFT_OUT) * squares.len() as f64).ceil() as usize;
        let error = squares[..counted].iter().map(|(error, _)| error).sum::<f64>() / counted as f64;
        (error / away).sqrt()
    }

    fn slope(&self) -> f64 {
        let (logged, predicted) = (mean(&self.logged, self.joints), mean(&self.predicted, self.joints));
        let (mut covariance, mut variance) = (0.0, 0.0);
        for (place, (a, b)) in self.logged.iter().zip(&self.predicted).enumerate() {
            let (a, b) = (a - logged[place % self.joints], b - predicted[place % self.joints]);
            covariance += a * b;
            variance += b * b;
        }
        // The slope of the logged actions over the predicted ones.
        covariance / variance
    }

    fn correlation(&self, names: &[String]) -> Vec<(String, f64)> {
        let (logged, predicted) = (mean(&self.logged, self.joints), mean(&self.predicted, self.joints));
        let correlation = |joint: usize| {
            let column = |values: &'_ [f64], mean: f64| -> Vec<f64> {
                values.iter().skip(joint).step_by(self.joints).map(|x| x - mean).collect()
            };
            let (a, b) = (column(&self.logged, logged[joint]), column(&self.predicted, predicted[joint]));
            let product = |a: &[f64], b: &[f64]| a.iter().zip(b).map(|(a, b)| a * b).sum::<f64>();
            let norm = (product(&a, &a) * product(&b, &b)).sqrt();
            if norm > 0.0 { product(&a, &b) / norm } else { 0.0 }
        };
        names.iter().enumerate().map(|(joint, name)| (name.clone(), correlation(joint))).collect()
    }
}

/// The actions of a recurrent policy in the first `samples` rows of a log, `samples × joints`, within their limits.
/// `clock`: phase of the gait clock in the first row.
fn remembered(policy: &Policy, log: &Trajectory, action: &[f64], clock: f64, samples: usize) -> Vec<f64> {
    let interface = &policy.interface;
    let joints = interface.joints.len();
    let layout = Layout::new(interface, &interface.observation);
    let (mut memory, mut past) = (policy.memory(1), Past::new(&layout, 1));
    let (mut row, mut acted) = (vec![0.0; layout.width()], vec![0.0; joints]);
    let mut scratch = Scratch::default();
    let mut last = vec![0.0; joints];
    let mut predicted = Vec::with_capacity(samples * joints);
    for sample in 0..samples {
        let given = Given::from_log(log, sample);
        observation::write(&layout, interface, log, sample, &last, &given, clock, past.row(0), &mut row);
        policy.act_with(1, &row, &mut memory, &mut acted, &mut scratch);
        past.take(&row);
        // The logged action, not the predicted one: the policy observed what it had really done.
        last.copy_from_slice(&action[sample * joints..(sample + 1) * joints]);
        predicted.extend(clipped(interface, acted.iter().map(|&x| f64::from(x))));
    }
    predicted
}

fn mean(values: &[f64], joints: usize) -> Vec<f64> {
    let rows = (values.len() / joints).max(1) as f64;
    (0..joints).map(|joint| values.iter().skip(joint).step_by(joints).sum::<f64>() / rows).collect()
}

/// Standard deviation of each joint's actions over all logs; 1 where they stand still.
pub fn spread(logs: &[&Trajectory], joints: usize) -> Vec<f64> {
    let actions: Vec<f64> = logs.iter().flat_map(|log| log.action.iter().flatten().copied()).collect();
    let rows = (actions.len() / joints).max(1) as f64;
    let mean = mean(&actions, joints);
    let spread_of_joint = |joint: usize| {
        let squares =
            actions.iter().skip(joint).step_by(joints).map(|x| (x - mean[joint]).powi(2)).sum::<f64>();
        let spread = (squares / rows).sqrt();
        if spread > 1e-9 { spread } else { 1.0 }
    };
    (0..joints).map(spread_of_joint).collect()
}

impl PolicyMatch {
    /// Correlation of the joint that agrees least.
    fn worst(&self) -> (&str, f64) {
        let min = self.correlation.iter().min_by(|a, b| a.1.total_cmp(&b.1));
        min.map_or(("", f64::NAN), |(name, value)| (name, *value))
    }

    /// Whether the actions are the policy's without doubt.
    pub fn agrees(&self) -> bool {
        self.samples >= MIN_SAMPLES && self.mismatch < DOUBTFUL
    }

    /// Whether there is enough to compare.
    pub fn is_enough(&self) -> bool {
        self.samples >= MIN_SAMPLES && self.mismatch.is_finite()
    }

    /// The measurements, for messages.
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
    pub fn judge(&self, policy: &str, logs: &[&str]) -> Result<Vec<String>, Error> {
        // Too little to compare is a doubt about the logs, not about the policy.
        if !self.is_enough() {
            let why = match self.samples {
                samples if samples < MIN_SAMPLES => {
                    format!(
                        "only {} can be compared, and {MIN_SAMPLES} are needed",
                        counted(samples, "sample")
                    )
                }
                _ => "positions, velocities or actions are not finite".to_owned(),
            };
            return Ok(vec![format!(
                "the logs do not show whether their actions are those of {policy}: {why}"
            )]);
        }
        let place = match self.follows_motion {
            true => {
                " The policy follows a motion: do motion_time (s) and motion_heading (rad) state where the logs are in it?"
            }
            false => "",
        };
        // A shift of one row is looked for before another policy is blamed.
        let numbers = self.numbers();
        let [earlier, later] = self.shifted;
        // A slow walk changes little in a sample: what counts there is how much better the other sample fits.
        let fits = |shifted: f64| {
            if self.mismatch < DOUBTFUL {
                self.mismatch > NOTICED && shifted < 0.25 * self.mismatch
            } else {
                shifted < DOUBTFUL.max(0.5 * self.mismatch) && shifted < ANOTHER
            }
        };
        for (shifted, how, remedy) in [(earlier, "earlier", "later"), (later, "later", "earlier")] {
            if fits(shifted) {
                return Ok(vec![format!(
                    "the logs' actions follow from {policy} one sample {how} than they are logged ({shifted:.3} there; \
                     {numbers}): log an action in the row of the state it was chosen in, shift the columns act_… \
                     {remedy}, or import the recording again with the clocks' offset (`--clock-offset`)",
                )]);
            }
        }
        if self.mismatch < DOUBTFUL {
            return Ok(Vec::new());
        }
        if self.mismatch < ANOTHER {
            return Ok(vec![format!(
                "the logs' actions are not quite those of {policy} ({numbers}, best factor {:.2}): are filters, delays or \
                 another observation scale between the log and the policy?{place}",
                self.slope
            )]);
        }
        // The log that fits least helps to find a single wrong file.
        let finite = self.by_log.iter().zip(logs).filter(|(mismatch, _)| mismatch.is_finite());
        let worst = finite.max_by(|a, b| a.0.total_cmp(b.0));
        let worst =
            worst.map_or(String::new(), |(mismatch, log)| format!("; worst: {log} with {mismatch:.2}"));
        Err(Error::failed(format!(
            "the logs' actions do not follow from {policy}: {numbers}{worst}. Give the policy that walked while the logs \
             were recorded, and check its joint order, default pose and scales (`gaitfit inspect` shows a log).{place}"
        )))
    }
}

#[cfg(test)]
mod tests;
