//! Diagnosis of a motion that was stopped: which joint, and what is wrong with it.

use super::flight::Flown;
use super::log::{Row, SampledStates};
use super::plan::Stage;
use super::statistics::mean;
use super::{Check, Finding};
use crate::guard::Reason;
use crate::robot::Robot;

/// A joint that was displaced by more than this moved, rad.
const MOVED: f64 = 0.04;
/// Torque of a command above which the motor must report some of it, N·m.
const ASKED: f64 = 0.5;
/// Part of that torque that the motor must report.
const ANSWER: f64 = 0.2;
/// Rows at the end that show the torque.
const LAST: usize = 50;

/// Adds what is wrong if the motion was stopped.
pub(super) fn stopped(flown: &Flown, sampled: &SampledStates, robot: &Robot, findings: &mut Vec<Finding>) {
    let Some(reason) = &flown.reason else { return };
    // Only a joint that went astray has a motion from which more can be told.
    let diagnosed = match (reason, sampled.rows.first(), sampled.rows.last()) {
        (Reason::Astray { joint, .. }, Some(first), Some(last)) => {
            let motor = robot.motors.iter().position(|motor| motor.joint == *joint);
            motor.map(|motor| match last.stage {
                Stage::Soften => softened(first, last, robot, motor),
                _ => astray(sampled, robot, motor),
            })
        }
        _ => None,
    };
    let stopped = || {
        Finding::fault(
            Check::Stopped,
            format!("the motion was stopped: {reason}"),
            "Repair this first; the joints after it were not moved",
        )
    };
    findings.push(diagnosed.unwrap_or_else(stopped));
}

/// A joint moved while its target stood where the joint was.
fn softened(first: &Row, last: &Row, robot: &Robot, motor: usize) -> Finding {
    let by = |index: usize| f64::from(last.state.q[index] - first.state.q[index]);
    let at = |index: usize| f64::from(first.state.q[index]);
    let joint = &robot.motors[motor].joint;
    let moved = by(motor);
    // Two joints whose readings are swapped go to each other's angles.
    let partner = (0..robot.motors.len())
        .filter(|index| *index != motor && by(*index).abs() > MOVED)
        .find(|index| (at(*index) - at(motor)) * moved > 0.0 && (at(motor) - at(*index)) * by(*index) > 0.0);
    if let Some(partner) = partner {
        let other = &robot.motors[partner].joint;
        return Finding::fault(
            Check::Order,
            format!("this joint and {other} moved to each other's angles while their targets stood still: they are swapped between commands and states"),
            "Check `slot` in the robot's file, and the cables of both motors",
        )
        .at_joint(joint);
    }
    // A reading with the other sign goes away from 0.
    let (check, words) = if at(motor) * moved > 0.0 || at(motor).abs() < MOVED {
        (Check::Zero, "command and state differ in zero, sign or order")
    } else {
        (Check::Sign, "the sign of its commands is not that of its angle, or their zeros differ")
    };
    Finding::fault(
        check,
        format!(
            "it moved by {moved:.2} rad while its target stood at its angle of {:.2}: {words}",
            at(motor)
        ),
        "Check the joint's direction, zero and slot in the vendor's documentation against the robot's file",
    )
    .at_joint(joint)
}

/// A joint did not follow its target.
fn astray(sampled: &SampledStates, robot: &Robot, motor: usize) -> Finding {
    let rows = &sampled.rows;
    let joint = &robot.motors[motor].joint;
    let (first, last) = (&rows[0], &rows[rows.len() - 1]);
    let wanted = f64::from(last.command[motor].q - first.command[motor].q);
    let by = |index: usize| f64::from(last.state.q[index] - first.state.q[index]);
    // The last rows, where the target had gone furthest.
    // 50 rows are 0.1 s: long enough for a mean of noisy torques.
    let end = &rows[rows.len().saturating_sub(LAST)..];
    let made: Vec<f64> = end
        .iter()
        .map(|row| f64::from(row.command[motor].torque(row.state.q[motor], row.state.dq[motor])))
        .collect();
    let reported: Vec<f64> = end.iter().map(|row| f64::from(row.state.torque[motor])).collect();
    let (made, reported) = (mean(&made), mean(&reported));
    // Some robots report no torques at all.
    let reports = rows.iter().any(|row| row.state.torque.iter().any(|torque| *torque != 0.0));
    let torques = format!("its command gives {made:.1} N·m, and its motor reports {reported:.1}");
    let other = (0..robot.motors.len())
        .filter(|index| *index != motor)
        .map(|index| (index, (by(index) - f64::from(last.command[index].q - first.command[index].q)).abs()))
        // Clearly off: by half of this joint's way at least.
        .filter(|(_, far)| *far > 0.5 * wanted.abs() && *far > 2.0 * MOVED)
        .max_by(|a, b| a.1.total_cmp(&b.1));
    // From the cause that explains most to the one that is left: a motor without torque also sticks.
    let finding = if reports && made.abs() > ASKED && reported.abs() < ANSWER * made.abs() {
        Finding::fault(
            Check::Gains,
            format!("it does not follow its target, and its gains have no effect: {torques}"),
            "Check the motor's mode, whether another program holds the low level, and whether gains arrive",
        )
    } else if let Some((other, far)) = other {
        let other = &robot.motors[other].joint;
        Finding::fault(
            Check::Order,
            format!("it does not follow its target, and {other} is {far:.2} rad from its own target"),
            "Joints are in another order in commands than in states: check `slot` in the robot's file",
        )
    } else if by(motor).abs() < MOVED {
        Finding::fault(
            Check::Moves,
            format!("it sticks: its target went {wanted:.2} rad and it moved by {:.3}; {torques}", by(motor)),
            "Move it by hand with the power off; look for what blocks it",
        )
    } else if by(motor) * wanted < 0.0 {
        Finding::fault(
            Check::Sign,
            format!(
                "it moves away from its target: the target moved by {wanted:.2} rad and the joint by {:.2}",
                by(motor)
            ),
            "The sign of its commands is not that of its angle: check the robot's file",
        )
    } else {
        Finding::fault(
            Check::Amount,
            format!("it stopped {:.2} rad before its target; {torques}", wanted - by(motor)),
            "It may have come to a stop or to an obstacle, or be too weak for its gains (half of kp in the robot's file)",
        )
    };
    finding.at_joint(joint)
}
