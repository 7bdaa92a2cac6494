//! How many times the recorded velocities are the derivative of the positions.
//!
//! Over a span of samples the position changes by the integral of the velocity. Both are noisy: the regression of the
//! integral on the change is too small, its inverse too large (Fuller 1987, "Measurement Error Models", section 1.1).
//! The true factor lies between them, up to twice the standard error of the slope. Spans of 0.2 s average out what
//! happens between two samples.

use crate::stats::{self, deviation, median};

/// Length of a span, s.
const SPAN_S: f64 = 0.2;
/// Min and max number of samples of a span.
const SPAN_SAMPLES: (usize, usize) = (4, 400);
/// Fewer spans say nothing.
const ENOUGH: usize = 20;
/// Deviation of the position's changes, rad, below which encoder resolution rules.
const MOVES: f64 = 0.01;
/// An interval this many medians long has lost samples.
pub(crate) const GAP: f64 = 1.5;
/// At this correlation the two are one signal, up to a factor.
pub(crate) const SAME: f64 = 0.8;
/// Factors this close to each other are the same.
pub(crate) const TOLERANCE: f64 = 1.05;

/// One joint's velocity beside the derivative of its position.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Scale {
    /// Correlation of the integral of the velocity with the changes of the position.
    pub correlation: f64,
    /// Velocity over derivative, by size.
    pub factor: f64,
    /// Standard error of the regression's slope, relative to `factor`.
    pub error: f64,
    /// Factor by which sampling alone may put it off: what a velocity does between samples the trapezoidal rule does not see.
    pub tolerance: f64,
}

/// Error of a factor by sampling, over the roughness: the mean square change of the velocity from sample to sample over four
/// times its mean square. Exact data of legs of a hung-up robot are 1.10 off at a roughness of 0.10 and 1.13 at 0.13.
const SAMPLING: f64 = 1.25;
/// Roughness from which on more makes no factor more doubtful.
const MAX_ROUGH: f64 = 0.25;
/// Sample interval of logs at a policy's rate, s, and more.
pub(crate) const SLOW_S: f64 = 0.0099;
/// Factor by which such sampling may put velocities off: they are those at the ends of answers to steps of the target,
/// up to a tenth beside the mean.
const SLOW: f64 = 1.1;

impl Scale {
    /// Whether the two are one signal, up to a positive factor.
    pub fn same(&self) -> bool {
        self.correlation > SAME
    }

    /// Bounds of the true factor.
    pub fn bounds(&self) -> [f64; 2] {
        let sure = 2.0 * self.error;
        [self.factor * (self.correlation - sure), self.factor * (1.0 / self.correlation + sure)]
    }

    /// Whether the true factor may be `factor`, within the tolerance.
    pub fn may_be(&self, factor: f64) -> bool {
        let [low, high] = self.bounds();
        low <= factor * self.tolerance && high >= factor / self.tolerance
    }
}

/// The joints' factors and what most of them agree on.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Scales {
    /// One a joint; absent where the joint hardly moves or the samples do not say.
    pub joints: Vec<Option<Scale>>,
    /// The factor that two thirds of the moving joints share.
    pub shared: Option<f64>,
}

/// The factors of all joints over spans of 0.2 s of the time column. `position`, `velocity`: `time.len() × joints`,
/// row-major.
pub(crate) fn scales(time: &[f64], position: &[f64], velocity: &[f64], joints: usize) -> Scales {
    let samples = SPAN_S / typical_step(time).unwrap_or(SPAN_S);
    let span = samples.round().clamp(SPAN_SAMPLES.0 as f64, SPAN_SAMPLES.1 as f64) as usize;
    over_spans(time, position, velocity, joints, span)
}

/// The factor that most joints share, over the shortest spans in which they move. For a time column whose unit is not
/// known.
pub(crate) fn shared_factor(time: &[f64], position: &[f64], velocity: &[f64], joints: usize) -> Option<f64> {
    [4, 32, 256].into_iter().find_map(|span| over_spans(time, position, velocity, joints, span).shared)
}

/// The factors over spans of so many samples.
fn over_spans(time: &[f64], position: &[f64], velocity: &[f64], joints: usize, span: usize) -> Scales {
    let Some(typical) = typical_step(time) else {
        return Scales { joints: vec![None; joints], shared: None };
    };
    let column = |values: &[f64], joint: usize| -> Vec<f64> {
        values.iter().skip(joint).step_by(joints).copied().collect()
    };
    let joints: Vec<Option<Scale>> = (0..joints)
        .map(|joint| scale(time, &column(position, joint), &column(velocity, joint), typical, span))
        .collect();
    let shared = shared(&joints);
    Scales { joints, shared }
}

/// Median of the intervals by which time increases; absent where it never does.
pub(crate) fn typical_step(time: &[f64]) -> Option<f64> {
    let mut steps: Vec<f64> =
        time.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 0.0).collect();
    median(&mut steps)
}

/// One joint's factor.
fn scale(time: &[f64], q: &[f64], dq: &[f64], typical: f64, span: usize) -> Option<Scale> {
    // Integral of the velocity from where the samples are last interrupted, by the trapezoidal rule.
    let mut integral = vec![0.0; time.len()];
    let mut unbroken = 0;
    let (mut changes, mut integrals) = (Vec::new(), Vec::new());
    let (mut steps_squared, mut squared) = (0.0, 0.0);
    for i in 1..time.len() {
        let step = time[i] - time[i - 1];
        let regular = step > 0.0 && step <= GAP * typical;
        let part = 0.5 * step * (dq[i - 1] + dq[i]);
        // Over a gap the integral is not known, so spans begin anew behind it.
        if !(regular && part.is_finite() && (q[i] - q[i - 1]).is_finite()) {
            unbroken = 0;
            integral[i] = 0.0;
            continue;
        }
        steps_squared += (dq[i] - dq[i - 1]).powi(2);
        squared += 4.0 * dq[i] * dq[i];
        integral[i] = integral[i - 1] + part;
        unbroken += 1;
        if unbroken >= span {
            changes.push(q[i] - q[i - span]);
            integrals.push(integral[i] - integral[i - span]);
        }
    }
    // A joint that hardly moves shows only noise.
    if changes.len() < ENOUGH || deviation(&changes) < MOVES {
        return None;
    }
    let correlation = stats::correlation(&changes, &integrals);
    // Spans overlap: as many are independent as fit one after the other.
    let independent = (changes.len() as f64 / span as f64).max(1.0);
    // sin²(ωh/2) of a wave.
    let roughness = if squared > 0.0 { (steps_squared / squared).min(MAX_ROUGH) } else { 0.0 };
    let scale = Scale {
        correlation,
        // The geometric mean of both regressions.
        factor: deviation(&integrals) / deviation(&changes),
        // Rounding may bring the correlation a little beyond 1.
        error: ((1.0 - correlation * correlation).max(0.0) / independent).sqrt(),
        tolerance: TOLERANCE.max(if typical >= SLOW_S { SLOW } else { 0.0 }).max(1.0 + SAMPLING * roughness),
    };
    (scale.correlation.is_finite() && scale.factor.is_finite() && scale.factor > 0.0).then_some(scale)
}

/// The median factor, where at least two thirds of the joints may have it.
fn shared(joints: &[Option<Scale>]) -> Option<f64> {
    let usable: Vec<Scale> = joints.iter().flatten().filter(|scale| scale.same()).copied().collect();
    let mut factors: Vec<f64> = usable.iter().map(|scale| scale.factor).collect();
    let middle = median(&mut factors)?;
    let agree = usable.iter().filter(|scale| scale.may_be(middle)).count();
    // One joint of many agrees with nobody.
    (3 * agree >= 2 * usable.len() && (agree > 1 || joints.len() == 1)).then_some(middle)
}

/// Whether two factors are the same within the tolerance.
pub(crate) fn equal(a: f64, b: f64) -> bool {
    (1.0 / TOLERANCE..=TOLERANCE).contains(&(a / b))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Two joints at 2 and 1 Hz, sampled at `rate`; velocities `factor` times the derivative, disturbed by `noise`.
    fn waves(rate: f64, factor: [f64; 2], noise: f64) -> Scales {
        let time: Vec<f64> = (0..400).map(|i| f64::from(i) / rate).collect();
        let (mut position, mut velocity) = (Vec::new(), Vec::new());
        for (i, t) in time.iter().enumerate() {
            for (joint, hertz) in [2.0, 1.0].into_iter().enumerate() {
                let turn = std::f64::consts::TAU * hertz;
                position.push(0.3 * (turn * t).sin());
                let disturbance = noise * (((2 * i + joint) as f64 * 12.9898).sin() * 43_758.547).fract();
                velocity.push(factor[joint] * 0.3 * turn * (turn * t).cos() + disturbance);
            }
        }
        scales(&time, &position, &velocity, 2)
    }

    #[test]
    fn the_factor_is_found_within_a_percent() {
        for rate in [50.0, 200.0, 1000.0] {
            for factor in [1.0, 1.06, 2.0, 57.3] {
                let shared = waves(rate, [factor; 2], 0.0).shared;
                assert!(
                    shared.is_some_and(|shared| (shared / factor - 1.0).abs() < 0.01),
                    "{rate} {factor} {shared:?}"
                );
            }
        }
    }

    #[test]
    fn bounds_hold_the_truth_under_noise() {
        let scales = waves(200.0, [1.0, 1.2], 2.0);
        for (scale, truth) in scales.joints.iter().flatten().zip([1.0, 1.2]) {
            let [low, high] = scale.bounds();
            assert!(low < truth && high > truth && high - low < 0.3, "{scale:?}");
        }
        assert_eq!(waves(200.0, [1.0, 1.3], 0.0).shared, None);
    }

    #[test]
    fn joints_that_hardly_move_and_lost_samples_say_nothing() {
        let time: Vec<f64> = (0..100).map(f64::from).collect();
        let still = vec![0.001; 100];
        assert_eq!(scales(&time, &still, &still, 1).joints, [None]);
        // Every third interval is a gap: no span is whole.
        let broken: Vec<f64> = (0..100).map(|i| f64::from(i + i / 3 * 5)).collect();
        let moving: Vec<f64> = (0..100).map(|i| (0.3 * f64::from(i)).sin()).collect();
        assert_eq!(scales(&broken, &moving, &moving, 1).joints, [None]);
        assert_eq!(scales(&[], &[], &[], 1).joints, [None]);
    }
}
