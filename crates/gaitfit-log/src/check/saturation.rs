//! Is anything cut off: velocities and actions at a bound of their own, torques at the motor's?

use super::{CheckSpec, FindingKind, Findings, Severity};
use crate::Signal;
use crate::stats::range;
use gaitfit_model::shown;

/// Separate visits to exactly the same extreme value. A real signal reaches its extreme once.
const VISITS: usize = 3;
/// Share of the samples that sit at the extreme.
const SHARE: f64 = 0.02;
/// Share of the samples whose demanded torque exceeds the limit.
const TORQUE_SHARE: f64 = 0.05;

pub(super) fn check(findings: &mut Findings, spec: &CheckSpec) {
    let log = findings.log;
    for (signal, remedy) in [
        (Signal::Velocity, "the encoder or the recorder clips it: widen its range or record slower motions"),
        (
            Signal::Action,
            "the policy's output is clipped: the log shows the clipped action, not the policy's",
        ),
    ] {
        let joints: Vec<usize> = (0..log.joints.len())
            .filter(|&joint| log.column_at(signal, joint).is_some_and(|column| clipped(&column)))
            .collect();
        if !joints.is_empty() {
            let message = format!(
                "{signal} of {} returns to exactly the same extreme; {remedy}",
                findings.names(&joints)
            );
            findings.add(FindingKind::Saturated, Severity::Warning, &joints, None, message);
        }
    }
    torque(findings, spec);
}

/// Whether the column comes back to exactly its extreme (either one), often and for long enough.
pub(super) fn clipped(column: &[f64]) -> bool {
    let Some((low, high)) = range(column) else { return false };
    // Quantised signals near rest have few values and visit each of them often.
    let mut values: Vec<f64> = column.iter().copied().filter(|value| value.is_finite()).collect();
    values.sort_by(f64::total_cmp);
    values.dedup();
    let varied = values.len() > column.len() / 20 + 10;
    varied
        && [low, high].iter().any(|extreme| {
            let at: Vec<bool> = column.iter().map(|value| value == extreme).collect();
            let visits = (0..at.len()).filter(|&i| at[i] && (i == 0 || !at[i - 1])).count();
            let samples = at.iter().filter(|at| **at).count();
            visits >= VISITS && samples as f64 >= SHARE * column.len() as f64
        })
}

fn torque(findings: &mut Findings, spec: &CheckSpec) {
    let log = findings.log;
    // Torques are known only with gains and targets.
    let (Some(gains), Some(_)) = (&log.gains, &log.target) else { return };
    let mut joints = Vec::new();
    let mut max = (0, 0.0);
    for (joint, name) in log.joints.iter().enumerate() {
        let Some(&limit) = spec.effort_limits.get(name) else { continue };
        let columns =
            [Signal::Target, Signal::Position, Signal::Velocity].map(|signal| log.column_at(signal, joint));
        let [Some(target), Some(q), Some(dq)] = columns else { continue };
        let beyond = (0..log.len())
            .filter(|&i| (gains.kp[joint] * (target[i] - q[i]) - gains.kd[joint] * dq[i]).abs() > limit)
            .count();
        let share = beyond as f64 / log.len() as f64;
        if share > TORQUE_SHARE {
            joints.push(joint);
            if share > max.1 {
                max = (joint, share);
            }
        }
    }
    if !joints.is_empty() {
        let message = format!(
            "PD torque of {} exceeds the motor's limit, most {} in {:.0} % of the samples; the motor clips it, so \
             the simulator must too; check gains and limits",
            findings.names(&joints),
            shown(&log.joints[max.0]),
            100.0 * max.1
        );
        findings.add(FindingKind::Saturated, Severity::Warning, &joints, None, message);
    }
}
