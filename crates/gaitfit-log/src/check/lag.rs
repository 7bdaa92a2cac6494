//! Do velocities lag behind positions, as those of a filter or of differences do? [`crate::velocity_lag`] estimates it.

use super::{FindingKind, Findings, Severity, replayed};
use crate::scale::{Scales, equal, typical_step};
use crate::sensors;
use crate::{Estimate, Trajectory};
use serde::Serialize;

/// A lag below this does not count as a sensor's, s. Exact velocities of a trot at 50 Hz show 0.4 ms. Velocities of
/// simulators are half a step before their positions; in logs that do not state the step they show 1.1 ms.
const HARMLESS_S: f64 = 1.5e-3;
/// The same as a part of the interval between samples: between coarse samples the mean of two velocities is not that of the
/// motion. Exact velocities of fast steps at 50 Hz show 2.7 ms.
const HARMLESS_PART: f64 = 0.15;
/// Standard errors by which a lag must be beyond it.
const SURE: f64 = 3.0;
/// A lag beyond this makes fits of a clamped robot's logs wrong, s: they compare velocities sample by sample, and take the
/// lag for delay, armature and damping.
const HARMFUL_S: f64 = 2e-3;

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
        self.exceeds(HARMLESS_S)
    }

    fn exceeds(&self, limit: f64) -> bool {
        self.seconds.abs() - SURE * self.error > limit.max(HARMLESS_PART * self.interval)
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
             and friction; record them unfiltered, or take central differences, (q[k+1] − q[k−1]) / 2Δt",
            1e3 * self.seconds.abs(),
            1e3 * self.error
        )
    }
}

/// Sums of one log or several.
#[derive(Debug, Default)]
pub(crate) struct LagSums {
    sums: sensors::LagSums,
    /// Logs that were added.
    logs: usize,
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
        self.sums.add(self.logs, log, &joints);
        self.logs += 1;
    }

    /// The lag of all that was added; `None` if that is too little.
    pub fn lag(&self) -> Option<VelocityLag> {
        let Estimate { value: seconds, error } = self.sums.estimate()?;
        let lag = VelocityLag { seconds, error, interval: self.interval };
        (seconds.is_finite() && error.is_finite()).then_some(lag)
    }
}

pub(super) fn check(findings: &mut Findings, scales: &Scales) {
    let log = findings.log;
    let mut sums = LagSums::default();
    sums.add(log, scales);
    let Some(lag) = sums.lag().filter(VelocityLag::matters) else { return };
    let severity = if replayed(log) && lag.exceeds(HARMFUL_S) { Severity::Error } else { Severity::Warning };
    findings.add(FindingKind::VelocityLag, severity, &[], None, lag.to_string());
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::scale::scales;

    fn noise(i: usize) -> f64 {
        2.0 * ((i as f64 * 12.9898).sin() * 43_758.547).fract().abs() - 1.0
    }

    /// A chirp at `rate` whose velocities are `lag` late and disturbed by `disturbance` rad/s.
    fn swinging(rate: f64, lag: f64, disturbance: f64) -> Trajectory {
        let samples = (8.0 * rate) as usize;
        let time: Vec<f64> = (0..samples).map(|i| i as f64 / rate).collect();
        let angle = |t: f64| 0.4 * (5.0 * t + 1.5 * t * t).sin();
        let speed = |t: f64| 0.4 * (5.0 + 3.0 * t) * (5.0 * t + 1.5 * t * t).cos();
        let position: Vec<f64> = time.iter().map(|t| angle(*t)).collect();
        let velocity: Vec<f64> =
            time.iter().enumerate().map(|(i, t)| speed(t - lag) + disturbance * noise(i)).collect();
        Trajectory::of_joints(vec!["knee".into()], rate, time, position, velocity)
    }

    fn lag(rate: f64, lag: f64, disturbance: f64) -> Option<VelocityLag> {
        let log = swinging(rate, lag, disturbance);
        let mut sums = LagSums::default();
        sums.add(&log, &scales(&log.time, &log.position, &log.velocity, 1));
        sums.lag()
    }

    #[test]
    fn lags_are_estimated_with_their_error() {
        for rate in [50.0, 200.0] {
            for late in [0.0, 0.004, 0.01, -0.006] {
                let estimate =
                    lag(rate, late, 0.0).unwrap_or(VelocityLag { seconds: 9.0, error: 0.0, interval: 0.0 });
                assert!((estimate.seconds - late).abs() < 5e-4, "{rate} {late} {estimate:?}");
                assert_eq!(estimate.matters(), late != 0.0, "{rate} {late} {estimate:?}");
            }
            let noisy =
                lag(rate, 0.0, 0.05).unwrap_or(VelocityLag { seconds: 9.0, error: 0.0, interval: 0.0 });
            assert!(noisy.seconds.abs() < 1e-3 && !noisy.matters(), "{rate} {noisy:?}");
        }
    }

    #[test]
    fn half_a_step_of_a_simulator_is_no_lag() {
        let mut log = swinging(200.0, 0.005, 0.02);
        let finding = |log: &Trajectory| {
            let findings = crate::check(log, &crate::CheckSpec::default());
            findings.iter().any(|one| one.kind == FindingKind::VelocityLag)
        };
        assert!(finding(&log));
        log.simulated_step = Some(0.01);
        assert!(!finding(&log));
        let (shifted, said) = crate::Sensors::new(&[&log]).corrected(&log);
        assert!(said.len() == 1 && said[0].contains("5.00 ms"), "{said:?}");
        assert!(crate::velocity_lag(&[&shifted]).is_some_and(|lag| lag.value.abs() < 5e-4), "{said:?}");
        // A lag beyond half a step still counts.
        log.simulated_step = Some(0.001);
        assert!(finding(&log));
    }

    /// A light limb that runs after targets that change at every sample: most of a velocity's change comes early in the
    /// interval, and the mean of two velocities says too little.
    #[test]
    fn what_coarse_samples_hide_is_part_of_the_error() {
        let (dt, tempo) = (0.02, 120.0);
        let (mut time, mut position, mut velocity) = (Vec::new(), Vec::new(), Vec::new());
        let (mut q, mut v) = (0.0f64, 0.0f64);
        for sample in 0..600 {
            let t = dt * f64::from(sample);
            let target = 0.4 * (15.0 * t).sin() + 0.3 * (23.0 * t).cos();
            time.push(t);
            position.push(q);
            velocity.push(v);
            // Critically damped towards the target: q = target + (a + b s) e^(−tempo s).
            let (a, b) = (q - target, v + tempo * (q - target));
            let decay = (-tempo * dt).exp();
            q = target + (a + b * dt) * decay;
            v = (b - tempo * (a + b * dt)) * decay;
        }
        let log = Trajectory::of_joints(vec!["knee".into()], 50.0, time, position, velocity);
        let lag = crate::velocity_lag(&[&log]).unwrap_or(Estimate { value: 9.0, error: 0.0 });
        assert!(lag.value.abs() > 3e-3 && !lag.matters(1e-3), "{lag:?}");
    }

    #[test]
    fn a_clear_lag_forbids_the_log_of_a_clamped_robot() {
        let severity = |late: f64, walks: bool| {
            let mut log = swinging(200.0, late, 0.02);
            log.command = walks.then(|| vec![0.0; 3 * log.len()]);
            let findings = crate::check(&log, &crate::CheckSpec::default());
            findings.iter().find(|one| one.kind == FindingKind::VelocityLag).map(|one| one.severity)
        };
        assert_eq!(severity(0.008, false), Some(Severity::Error));
        assert_eq!(severity(0.002, false), Some(Severity::Warning));
        assert_eq!(severity(0.008, true), Some(Severity::Warning), "walks are compared otherwise");
        assert_eq!(severity(0.0, false), None);
    }
}
