//! Is the velocity the derivative of the position, by the clock that the log has?

use super::saturation::clipped;
use super::{FindingKind, Findings, Severity};
use crate::Signal;
use crate::scale::{SAME, SLOW_S, Scale, Scales, equal, typical_step};
use crate::stats::{range, short};

/// Below this correlation they are two different signals. A hip of a trotting robot sampled at 50 Hz reaches
/// only 0.55: impacts fall between samples.
const UNRELATED: f64 = 0.2;
/// Factor beyond which no fit is worth anything.
const FAR_OFF: f64 = 1.5;

pub(super) fn check(findings: &mut Findings, scales: &Scales, rate_is_said: bool) {
    let joints: Vec<(usize, Scale)> = scales
        .joints
        .iter()
        .enumerate()
        .filter_map(|(joint, scale)| Some((joint, (*scale)?)))
        // A cut-off or constant velocity is reported as such.
        .filter(|(joint, _)| {
            let velocity = findings.log.column_at(Signal::Velocity, *joint).unwrap_or_default();
            range(&velocity).is_some_and(|(low, high)| low < high) && !clipped(&velocity)
        })
        .collect();
    let pick = |test: &dyn Fn(&Scale) -> bool| -> Vec<usize> {
        joints.iter().filter(|(_, scale)| test(scale)).map(|(joint, _)| *joint).collect()
    };

    // Signs first: a factor of a mirrored velocity means nothing.
    let flipped = pick(&|scale| scale.correlation < -SAME);
    if !flipped.is_empty() {
        let message = format!(
            "velocity of {} has the opposite sign of the position's derivative; negate one of them",
            findings.names(&flipped)
        );
        findings.add(FindingKind::VelocityMismatch, Severity::Error, &flipped, None, message);
    }
    let unrelated = pick(&|scale| scale.correlation.abs() < UNRELATED);
    if !unrelated.is_empty() {
        let message = format!(
            "velocity of {} has nothing to do with the derivative of the position; are columns mixed up?",
            findings.names(&unrelated)
        );
        findings.add(FindingKind::VelocityMismatch, Severity::Warning, &unrelated, None, message);
    }

    // A wrong clock concerns all joints alike; fast motion between samples does not.
    let right = joints.iter().filter(|(_, scale)| scale.same() && equal(scale.factor, 1.0)).count();
    // If more than a sixth of the joints have the factor 1, the clock is right.
    let shared = scales.shared.filter(|shared| !equal(*shared, 1.0) && 6 * right <= joints.len());
    let with_it = |scale: &Scale| shared.is_some_and(|shared| scale.may_be(shared));
    // Joints with the factor of most, and then those with one of their own.
    if let Some(shared) = shared.filter(|_| !rate_is_said) {
        let together = pick(&|scale| scale.same() && with_it(scale));
        scaled(findings, &together, [shared, shared], far(shared), Some(shared));
    }
    // Joints with a factor of their own point to units or gear ratios.
    let off: Vec<(usize, &Scale)> = joints
        .iter()
        .filter(|(_, scale)| scale.same() && !with_it(scale) && !scale.may_be(1.0))
        .map(|(joint, scale)| (*joint, scale))
        .collect();
    // Fast motion between samples puts single joints off; what it may do does not forbid a log.
    let sure = |scale: &Scale| match nearest_to_one(scale) {
        low if low > 1.0 => low / scale.tolerance,
        high => high * scale.tolerance,
    };
    let severe = off.iter().all(|(_, scale)| far(sure(scale)));
    let off: Vec<(usize, f64)> = off.iter().map(|(joint, scale)| (*joint, nearest_to_one(scale))).collect();
    let (low, high) =
        off.iter().fold((f64::INFINITY, 0.0f64), |(low, high), (_, f)| (low.min(*f), high.max(*f)));
    let joints: Vec<usize> = off.into_iter().map(|(joint, _)| joint).collect();
    scaled(findings, &joints, [low, high], severe, None);
}

/// Whether a factor is so far off that no fit is worth anything.
fn far(factor: f64) -> bool {
    !(1.0 / FAR_OFF..FAR_OFF).contains(&factor)
}

/// The bound of the true factor that is nearer to one.
fn nearest_to_one(scale: &Scale) -> f64 {
    let [low, high] = scale.bounds();
    if low > 1.0 { low } else { high }
}

/// Says that the velocity of `joints` is `low` to `high` times the derivative, which forbids the log where it is `severe`.
/// `shared`: what most joints have, which a wrong clock would explain.
fn scaled(
    findings: &mut Findings,
    joints: &[usize],
    [low, high]: [f64; 2],
    severe: bool,
    shared: Option<f64>,
) {
    if joints.is_empty() {
        return;
    }
    let factor = if equal(low, high) {
        // Factors multiply, so the middle is the geometric mean.
        short((low * high).sqrt())
    } else {
        format!("{} to {}", short(low), short(high))
    };
    let message = format!(
        "velocity of {} is {factor} times the derivative of the position; {}",
        findings.names(joints),
        reading(findings, (low * high).sqrt(), equal(low, high), shared)
    );
    let severity = if severe { Severity::Error } else { Severity::Warning };
    findings.add(FindingKind::VelocityMismatch, severity, joints, None, message);
}

/// Returns what a factor may come from, and what to do.
fn reading(findings: &Findings, factor: f64, one: bool, shared: Option<f64>) -> String {
    let near = |wanted: f64| one && (0.9..1.1).contains(&(factor / wanted));
    let degrees = 1f64.to_degrees();
    if near(degrees) {
        return "the velocities are in degrees per second, it seems: multiply them by π/180".to_owned();
    }
    if near(1.0 / degrees) {
        return "the positions are in degrees, it seems: multiply them by π/180".to_owned();
    }
    for (unit, per_second) in [("milliseconds", 1e3), ("microseconds", 1e6), ("nanoseconds", 1e9)] {
        if near(per_second) {
            return format!("time is in {unit}, it seems: divide it by {per_second}");
        }
    }
    match (shared, typical_step(&findings.log.time)) {
        (Some(shared), Some(step)) => format!(
            "the velocities fit a sample rate of {} Hz, the time column says {} Hz. Correct the time column if the \
             rate is wrong; divide the velocities by {} if their scale is wrong (unit, gear ratio)",
            short(shared / step),
            short(1.0 / step),
            short(shared)
        ),
        // A sound joint may answer each target within one sample. Then its velocity at a sample is below the mean velocity.
        (_, Some(step)) if factor < 1.0 && !far(factor) && step >= SLOW_S => {
            "the other joints fit the time column, or have other factors, so the rate alone is not to blame. At this rate \
             nothing need be wrong: joints that answer a new target before the next sample look like this. Otherwise check \
             units (rad, rad/s) and gear ratios"
                .to_owned()
        }
        _ => "the other joints fit the time column, or have other factors, so the rate alone is not to blame; check \
              units (rad, rad/s) and gear ratios"
            .to_owned(),
    }
}
