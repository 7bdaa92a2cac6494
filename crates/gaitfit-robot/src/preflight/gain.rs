//! Gain and delay of a motor, from its reported torque.
//!
//! τ(t) = g (kp (q*(t − d) − q(t − a)) − kd q̇(t − a)) + c. The gain g is 1 if kp and kd are as stated; c is a constant. The delay d is
//! unknown. So is the age a: the state in a message may be newer than the one by which the motor's controller computed the
//! torque of the same message, by at most the time between two messages. If a is taken for 0, the joint looks lighter by kd·a
//! and less damped by kp·a. A light joint has little more than this, so its motion cannot tell an age from a gain. So all ages
//! and delays are tried. The gains of all that fit about as well as the best are possible. Both sides are smoothed, because kd
//! makes the noise of velocities large.

use std::ops::Range;

use super::delays::{DELAY_STEP, DELAYS, HELD, LENGTH, STRIDE, least};
use super::log::{DT, Row};
use super::statistics::{Measured, mean, span};

/// Reported torques that vary by less are not reported at all, N·m.
const REPORTED: f64 = 0.01;
/// An age and a delay are possible if they leave at most this many times the squared errors of the best ones.
const POSSIBLE: f64 = 2.0;
/// Squared errors that sampling alone leaves, as a part of the squares of the torque about its mean.
const FLOOR: f64 = 1e-5;
/// Step of ages and delays, in rows.
const PART: f64 = 0.125;
/// Step of ages and delays, s: finer than a row, as an age may be a part of the time between two messages.
const STEP: f64 = PART * DT;

/// Results of a reported torque.
#[derive(Clone, Copy, Debug)]
pub(super) struct Reported {
    /// Time from a target to it, s.
    pub(super) delay: Measured,
    /// Least and largest possible ratio of it to the torque of the command, without a unit.
    pub(super) gain: [f64; 2],
}

/// One age and one delay, in steps of [`STEP`].
#[derive(Clone, Copy, Debug)]
struct Tried {
    age: usize,
    delay: usize,
    /// Sum of the squared errors that are left, (N·m)².
    left: f64,
    /// Reported torque over that of the command.
    gain: f64,
}

/// The reported torque of `motor` in `rows[window]`. `None` where none is reported; `message`: time between two messages, s.
pub(super) fn reported(rows: &[Row], window: Range<usize>, motor: usize, message: f64) -> Option<Reported> {
    if span(window.clone().map(|at| f64::from(rows[at].state.torque[motor]))) < REPORTED {
        return None;
    }
    let longest = DELAYS as f64 * DELAY_STEP;
    // An age is not longer than the longest delay, because the smoothed rows begin only that much earlier.
    let steps = |time: f64| (time.min(longest) / STEP).round() as usize;
    let smooth = Smooth::new(rows, window, motor, steps(longest));
    let average = mean(&smooth.torque);
    let total: f64 = smooth.torque.iter().map(|x| (x - average).powi(2)).sum();
    // All ages up to the time between two messages, with all delays; errors in one side, and in both.
    let pairs = (0..=steps(message)).flat_map(|age| (0..=steps(longest)).map(move |delay| (age, delay)));
    let (alone, both): (Vec<Tried>, Vec<Tried>) = pairs.map(|(age, delay)| smooth.fit(age, delay)).unzip();
    // The gain is told as an interval over all fits that are possible; the delay comes from the best.
    let (kept, both) = (possible(&alone, FLOOR * total), possible(&both, FLOOR * total));
    let fits = || kept.iter().chain(&both);
    let (low, high) =
        fits().fold((f64::INFINITY, f64::NEG_INFINITY), |(l, h), one| (l.min(one.gain), h.max(one.gain)));
    let best = kept.iter().min_by(|a, b| a.left.total_cmp(&b.left))?;
    let of_best: Vec<f64> = alone.iter().filter(|one| one.age == best.age).map(|one| one.left).collect();
    // Neighbouring means share rows, so there are fewer independent ones (see `equation`).
    let overlap = (LENGTH as f64 / (1.5 * STRIDE as f64)).sqrt();
    // Between the steps the delay follows from the squares beside the best.
    let fine = least(&of_best, best.delay, smooth.torque.len(), overlap);
    // Other possible delays count as error: they explain the torque about as well.
    let spread = 0.5 * span(fits().map(|one| one.delay as f64));
    let delay = Measured { value: STEP * fine.value - HELD, error: STEP * fine.error.max(spread) };
    Some(Reported { delay, gain: [low, high] })
}

/// Returns those that fit about as well as the best.
fn possible(fits: &[Tried], floor: f64) -> Vec<Tried> {
    let best = fits.iter().map(|one| one.left).fold(f64::INFINITY, f64::min);
    let mut kept: Vec<Tried> =
        fits.iter().filter(|one| one.left <= POSSIBLE * best.max(floor)).copied().collect();
    // A joint that follows its command has no negative gain. The gain of a light joint can look negative if its torque is late.
    if kept.iter().any(|one| one.gain > 0.0) {
        kept.retain(|one| one.gain > 0.0);
    }
    kept
}

/// A joint's own motion, smoothed.
struct Smooth {
    kp: f64,
    kd: f64,
    /// Reported torques of every third row ([`STRIDE`]), N·m.
    torque: Vec<f64>,
    /// Targets, rad, angles, rad, and velocities, rad/s, of each row. They begin as many rows earlier as the longest delay needs.
    target: Vec<f64>,
    angle: Vec<f64>,
    velocity: Vec<f64>,
    /// Number of the first torque's row among these.
    begin: usize,
}

impl Smooth {
    fn new(rows: &[Row], window: Range<usize>, motor: usize, longest: usize) -> Self {
        let half = LENGTH / 2;
        // Weights of a bump without corners: smoothing takes the noise that kd would enlarge.
        // Divided by `half + 1`, so that the outermost of the 15 samples still count.
        let bump = |k: usize| 1.0 - ((k as f64 - half as f64) / (half as f64 + 1.0)).powi(2);
        let weights: Vec<f64> = (0..=2 * half).map(|k| bump(k).powi(2)).collect();
        let sum: f64 = weights.iter().sum();
        // At the ends of the recording the first or last row is repeated.
        let inside = |at: usize, k: usize| (at + k).saturating_sub(half).min(rows.len() - 1);
        let smooth = |value: &dyn Fn(&Row) -> f32, at: usize| {
            let terms = weights.iter().enumerate();
            terms.map(|(k, weight)| weight * f64::from(value(&rows[inside(at, k)]))).sum::<f64>() / sum
        };
        let from = window.start.saturating_sub((longest as f64 * PART) as usize + 1);
        let smoothed = |value: &dyn Fn(&Row) -> f32| (from..window.end).map(|at| smooth(value, at)).collect();
        let slot = &rows[window.start].command[motor];
        Self {
            kp: f64::from(slot.kp),
            kd: f64::from(slot.kd),
            torque: window
                .clone()
                .step_by(STRIDE)
                .map(|at| smooth(&|row| row.state.torque[motor], at))
                .collect(),
            target: smoothed(&|row| row.command[motor].q),
            angle: smoothed(&|row| row.state.q[motor]),
            velocity: smoothed(&|row| row.state.dq[motor]),
            begin: window.start - from,
        }
    }

    /// A value `back` steps before the row `at`.
    fn before(values: &[f64], at: usize, back: usize) -> f64 {
        // Linear between rows, because a step is an eighth of a row.
        let exact = back as f64 * PART;
        let part = exact.fract();
        let value = |back: usize| values[at.saturating_sub(back)];
        (1.0 - part) * value(exact as usize) + part * value(exact as usize + 1)
    }

    /// The gains with this age and delay: first as if only the reported torque had errors, then as if the torque of the command
    /// had them too.
    fn fit(&self, age: usize, delay: usize) -> (Tried, Tried) {
        let count = self.torque.len() as f64;
        let (mut x, mut y, mut xx, mut xy, mut yy) = (0.0, 0.0, 0.0, 0.0, 0.0);
        for (number, torque) in self.torque.iter().enumerate() {
            let at = self.begin + STRIDE * number;
            let command = self.kp
                * (Self::before(&self.target, at, delay) - Self::before(&self.angle, at, age))
                - self.kd * Self::before(&self.velocity, at, age);
            x += command;
            y += torque;
            xx += command * command;
            xy += command * torque;
            yy += torque * torque;
        }
        // From here on about the means.
        (xx, xy, yy) = (xx - x * x / count, xy - x * y / count, yy - y * y / count);
        let slope = if xx > 0.0 { xy / xx } else { 0.0 };
        // Rounding may leave a little less than 0.
        let alone = Tried { age, delay, left: (yy - slope * xy).max(0.0), gain: slope };
        // Total least squares (Pearson 1901):
        // Errors in both: the slope is that of the longest axis, and the squares across it are left.
        let long = 0.5 * (xx + yy + ((xx - yy).powi(2) + 4.0 * xy * xy).sqrt());
        // If only the reported torque varies, the axis is vertical and this denominator 0.
        let axis = xy / (long - yy).max(1e-12 * long + f64::MIN_POSITIVE);
        (alone, Tried { left: (xx + yy - long).max(0.0), gain: axis, ..alone })
    }
}
