//! Do velocities lag behind positions, as those of a filter or of differences do?
//!
//! If a velocity is the derivative as it was τ earlier, then over an interval h the position changes by τ·Δq̇ more than the
//! mean of the two velocities says: Δq − h(q̇₁ + q̇₀)/2 ≈ τ·Δq̇. The slope over all joints and samples is τ. Noise of the
//! velocities does not move the numerator: it is in q̇₁ + q̇₀ and q̇₁ − q̇₀ without correlation.

use super::{FindingKind, Findings, Severity};
use crate::Trajectory;
use crate::scale::{GAP, Scales, equal, typical_step};
use serde::Serialize;

/// A lag below this is none of a sensor, s. Exact velocities of a trot at 50 Hz show 0.4 ms; those of simulators, whose
/// integrators have a velocity half a step before its position, 1.1 ms.
const HARMLESS_S: f64 = 1.5e-3;
/// The same as a part of the interval between samples: between coarse samples the mean of two velocities is not that of the
/// motion. Exact velocities of fast steps at 50 Hz show 2.7 ms.
const HARMLESS_PART: f64 = 0.15;
/// Standard errors by which a lag must be beyond it.
const SURE: f64 = 3.0;
/// Length of a stretch whose samples do not count as independent, s.
const STRETCH_S: f64 = 0.5;
/// Fewer stretches do not say how sure a lag is.
const ENOUGH: usize = 6;

/// How far velocities are behind positions.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct VelocityLag {
    /// The lag, s; negative where positions lag behind velocities.
    pub seconds: f64,
    /// Its standard error, s.
    pub error: f64,
    /// Longest interval between samples of the logs that show it, s.
    pub interval: f64,
}

impl VelocityLag {
    /// Whether it is beyond doubt more than what does no harm.
    pub fn matters(&self) -> bool {
        self.seconds.abs() - SURE * self.error > HARMLESS_S.max(HARMLESS_PART * self.interval)
    }
}

impl std::fmt::Display for VelocityLag {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (behind, ahead) = match self.seconds < 0.0 {
            true => ("positions", "velocities"),
            false => ("velocities", "positions"),
        };
        write!(
            f,
            "{behind} lag behind {ahead} by {:.1} ± {:.1} ms, as a filter or differences make them: fits take it for delay \
             and friction; record them unfiltered",
            1e3 * self.seconds.abs(),
            1e3 * self.error
        )
    }
}

/// Sums over stretches, from one log or several.
#[derive(Clone, Debug, Default)]
pub(crate) struct LagSums {
    /// Σ rest·change and Σ change² of each stretch.
    stretches: Vec<[f64; 2]>,
    /// Longest interval between samples, s.
    interval: f64,
}

impl LagSums {
    /// Adds the joints of a log whose velocities are their positions' derivatives.
    pub fn add(&mut self, log: &Trajectory, scales: &Scales) {
        // Another clock or scale comes first.
        if scales.shared.is_some_and(|shared| !equal(shared, 1.0)) {
            return;
        }
        let usable =
            |joint: &usize| scales.joints[*joint].is_some_and(|scale| scale.same() && scale.may_be(1.0));
        let joints: Vec<usize> = (0..log.joints.len()).filter(usable).collect();
        let Some(step) = typical_step(&log.time).filter(|_| !joints.is_empty()) else { return };
        self.interval = self.interval.max(step);
        let width = log.joints.len();
        let rows = ((STRETCH_S / step).round() as usize).max(1);
        let mut sums = [0.0; 2];
        for sample in 1..log.len() {
            let interval = log.time[sample] - log.time[sample - 1];
            if interval > 0.0 && interval < GAP * step {
                for joint in &joints {
                    let (now, before) = (sample * width + joint, (sample - 1) * width + joint);
                    let (from, to) = (log.velocity[before], log.velocity[now]);
                    let rest = log.position[now] - log.position[before] - 0.5 * interval * (from + to);
                    let change = to - from;
                    if rest.is_finite() && change.is_finite() {
                        sums[0] += rest * change;
                        sums[1] += change * change;
                    }
                }
            }
            if sample.is_multiple_of(rows) {
                self.stretches.push(std::mem::take(&mut sums));
            }
        }
    }

    /// The lag of all that was added; `None` if that is too little.
    pub fn lag(&self) -> Option<VelocityLag> {
        if self.stretches.len() < ENOUGH {
            return None;
        }
        let total = self.stretches.iter().fold([0.0; 2], |sum, one| [sum[0] + one[0], sum[1] + one[1]]);
        let seconds = total[0] / total[1];
        let squares: f64 = self.stretches.iter().map(|one| (one[0] - seconds * one[1]).powi(2)).sum();
        let error = squares.sqrt() / total[1];
        (seconds.is_finite() && error.is_finite()).then_some(VelocityLag {
            seconds,
            error,
            interval: self.interval,
        })
    }
}

pub(super) fn check(findings: &mut Findings, scales: &Scales) {
    let mut sums = LagSums::default();
    sums.add(findings.log, scales);
    if let Some(lag) = sums.lag().filter(VelocityLag::matters) {
        findings.add(FindingKind::VelocityLag, Severity::Warning, &[], None, lag.to_string());
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scale::scales;

    fn noise(i: usize) -> f64 {
        2.0 * ((i as f64 * 12.9898).sin() * 43_758.547).fract().abs() - 1.0
    }

    /// The lag of a chirp at `rate` whose velocities are `lag` late and disturbed by `disturbance` rad/s.
    fn lag(rate: f64, lag: f64, disturbance: f64) -> Option<VelocityLag> {
        let samples = (8.0 * rate) as usize;
        let time: Vec<f64> = (0..samples).map(|i| i as f64 / rate).collect();
        let angle = |t: f64| 0.4 * (5.0 * t + 1.5 * t * t).sin();
        let speed = |t: f64| 0.4 * (5.0 + 3.0 * t) * (5.0 * t + 1.5 * t * t).cos();
        let position: Vec<f64> = time.iter().map(|t| angle(*t)).collect();
        let velocity: Vec<f64> =
            time.iter().enumerate().map(|(i, t)| speed(t - lag) + disturbance * noise(i)).collect();
        let log = Trajectory {
            source: None,
            robot: None,
            joints: vec!["knee".into()],
            rate_hz: rate,
            target: None,
            action: None,
            command: None,
            base: None,
            gains: None,
            lead: None,
            fell: false,
            time,
            position,
            velocity,
        };
        let mut sums = LagSums::default();
        sums.add(&log, &scales(&log.time, &log.position, &log.velocity, 1));
        sums.lag()
    }

    #[test]
    fn lags_are_estimated_with_their_error() {
        for rate in [50.0, 200.0] {
            for late in [0.0, 0.004, 0.01, -0.006] {
                let found =
                    lag(rate, late, 0.0).unwrap_or(VelocityLag { seconds: 9.0, error: 0.0, interval: 0.0 });
                assert!((found.seconds - late).abs() < 5e-4, "{rate} {late} {found:?}");
                assert_eq!(found.matters(), late != 0.0, "{rate} {late} {found:?}");
            }
            let noisy =
                lag(rate, 0.0, 0.05).unwrap_or(VelocityLag { seconds: 9.0, error: 0.0, interval: 0.0 });
            assert!(noisy.seconds.abs() < 1e-3 && !noisy.matters(), "{rate} {noisy:?}");
        }
    }
}
