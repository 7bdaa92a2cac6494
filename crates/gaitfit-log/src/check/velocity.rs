//! Is the velocity the derivative of the position?

use super::stats::{correlation, range, rms};
use super::{FindingKind, Findings, Severity};
use crate::Signal;

/// Below this RMS derivative of the position, rad/s, encoder resolution rules.
const MOVES: f64 = 0.1;
/// At this correlation the two are one signal, up to a factor.
const SAME: f64 = 0.8;
/// Below this correlation they are two different signals. A hip of a trotting robot sampled at 50 Hz reaches
/// only 0.55: impacts fall between samples.
const UNRELATED: f64 = 0.2;
/// Factor beyond which the unit is another one.
const OTHER_UNIT: f64 = 5.0;
/// Factor beyond which the scale is off. Central differences at 50 Hz lose up to 30 % of a trot.
const OFF_SCALE: f64 = 1.8;
/// Fewer differences say nothing.
const ENOUGH: usize = 20;

pub(super) fn check(findings: &mut Findings) {
    let log = findings.log;
    let mut flipped = Vec::new();
    let mut scaled: Vec<(usize, f64)> = Vec::new();
    let mut unrelated = Vec::new();
    for joint in 0..log.joints.len() {
        let (Some(q), Some(dq)) =
            (log.column_at(Signal::Position, joint), log.column_at(Signal::Velocity, joint))
        else {
            continue;
        };
        // Central differences of the position against the velocity at the same instant.
        let (mut derivative, mut velocity) = (Vec::new(), Vec::new());
        for i in 1..log.len().saturating_sub(1) {
            let (before, after) = (log.time[i - 1], log.time[i + 1]);
            let regular = before < log.time[i] && log.time[i] < after;
            let slope = (q[i + 1] - q[i - 1]) / (after - before);
            if regular && slope.is_finite() && dq[i].is_finite() {
                derivative.push(slope);
                velocity.push(dq[i]);
            }
        }
        // A constant velocity is reported as such.
        let constant = range(&velocity).is_none_or(|(low, high)| low == high);
        if derivative.len() < ENOUGH || rms(&derivative) < MOVES || constant {
            continue;
        }
        let together = correlation(&derivative, &velocity);
        let factor = rms(&velocity) / rms(&derivative);
        if together < -SAME {
            flipped.push(joint);
        } else if together > SAME && !(1.0 / OFF_SCALE..OFF_SCALE).contains(&factor) {
            scaled.push((joint, factor));
        } else if together < UNRELATED {
            unrelated.push(joint);
        }
    }
    if !flipped.is_empty() {
        let message = format!(
            "velocity of {} has the opposite sign of the position's derivative; negate one of them",
            findings.names(&flipped)
        );
        findings.add(FindingKind::VelocityMismatch, Severity::Error, &flipped, None, message);
    }
    if !scaled.is_empty() {
        let joints: Vec<usize> = scaled.iter().map(|(joint, _)| *joint).collect();
        let factor = scaled.iter().map(|(_, factor)| factor).sum::<f64>() / scaled.len() as f64;
        let hint = match factor {
            f if (50.0..65.0).contains(&f) => "velocity is in degrees per second, it seems",
            f if (1.0 / 65.0..1.0 / 50.0).contains(&f) => "position is in degrees, it seems",
            f if (500.0..2000.0).contains(&f) => "time is in milliseconds, it seems",
            _ => "check units (rad, rad/s, s) and gear ratios",
        };
        let message = format!(
            "velocity of {} is {factor:.3} × the derivative of the position; {hint}",
            findings.names(&joints)
        );
        let far = !(1.0 / OTHER_UNIT..OTHER_UNIT).contains(&factor);
        let severity = if far { Severity::Error } else { Severity::Warning };
        findings.add(FindingKind::VelocityMismatch, severity, &joints, None, message);
    }
    if !unrelated.is_empty() {
        let message = format!(
            "velocity of {} has nothing to do with the derivative of the position; are columns mixed up?",
            findings.names(&unrelated)
        );
        findings.add(FindingKind::VelocityMismatch, Severity::Warning, &unrelated, None, message);
    }
}
