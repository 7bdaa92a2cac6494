//! Joints and motors while nothing is sent.

use serde::Serialize;

use super::network::step;
use super::statistics::{deviation, mean, span};
use super::{Check, Finding, Heard};
use crate::robot::Robot;

/// How far outside its range a joint may be, rad: encoders are off, and stops give way.
const OUTSIDE: f64 = 0.03;
/// A joint this near to the end of its range is at its stop, rad.
const AT_STOP: f64 = 0.03;
/// A joint that moves further while nothing is sent is a warning, and then a fault, rad.
const MOVES: [f64; 2] = [0.02, 0.1];
/// Velocity that a joint at rest may seem to have, rad/s.
const RESTING: f64 = 0.05;
/// A coarser step of an encoder is a warning, rad.
const COARSE: f64 = 0.003;
/// A motor this near to the max temperature is a warning, °C.
const WARM: i16 = 10;
/// Temperatures that no motor has, °C.
const NO_TEMPERATURE: [i16; 2] = [-20, 150];

/// A joint while nothing is sent.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JointReport {
    /// Its name.
    pub joint: String,
    /// Its mean angle, rad.
    pub angle: f64,
    /// Distance to the nearer end of its range, rad; negative outside; absent for wheels.
    pub room: Option<f64>,
    /// How far it moved, rad.
    pub moved: f64,
    /// Noise of its angle, rad (standard deviation).
    pub noise: f64,
    /// Smallest step of its angle, rad; 0 if it never changed.
    pub step: f64,
    /// Mean of its velocity, rad/s.
    pub velocity: f64,
    /// Noise of its velocity, rad/s.
    pub velocity_noise: f64,
    /// Mean of its reported torque, N·m.
    pub torque: f64,
    /// Hottest temperature of its motor, °C.
    pub temperature: i16,
    /// Its motor's error number; 0 is none.
    pub error: u32,
    /// Packets that its motor lost meanwhile.
    pub lost: u32,
}

/// The joints' numbers from states, in motor order. Numbers that are not finite are left out.
pub(super) fn joints(heard: &[Heard], robot: &Robot) -> Vec<JointReport> {
    let finite = |value: &dyn Fn(&Heard) -> f32| -> Vec<f64> {
        heard.iter().map(|one| f64::from(value(one))).filter(|x| x.is_finite()).collect()
    };
    let limits = robot.limits();
    let report = |motor: usize| {
        let q = finite(&|one| one.state.q[motor]);
        let dq = finite(&|one| one.state.dq[motor]);
        let angle = mean(&q);
        // To the nearer end of the range; negative outside.
        let room = (f64::from(limits.upper[motor]) - angle).min(angle - f64::from(limits.lower[motor]));
        let lost = |one: &Heard| one.state.lost[motor];
        let differences: Vec<f64> = q.windows(2).map(|pair| pair[1] - pair[0]).collect();
        JointReport {
            joint: robot.motors[motor].joint.clone(),
            angle,
            // A wheel's range is infinite.
            room: room.is_finite().then_some(room),
            moved: span(q.iter().copied()),
            // Differences of neighbours leave a slow sway out. Their variance is twice that of one reading.
            noise: deviation(&differences) / 2f64.sqrt(),
            step: step(&q),
            velocity: mean(&dq),
            velocity_noise: deviation(&dq),
            torque: mean(&finite(&|one| one.state.torque[motor])),
            temperature: heard.iter().map(|one| one.state.temperature[motor]).max().unwrap_or(0),
            // An error that has gone again counts too.
            error: heard.iter().map(|one| one.state.error[motor]).find(|error| *error != 0).unwrap_or(0),
            // A counter of 32 bits, which may wrap.
            lost: heard.last().map_or(0, lost).wrapping_sub(heard.first().map_or(0, lost)),
        }
    };
    (0..robot.motors.len()).map(report).collect()
}

/// Adds what is wrong with them. `simulator`: zeros do not show that a motor does not answer.
pub(super) fn judge(
    reports: &[JointReport],
    heard: &[Heard],
    robot: &Robot,
    simulator: bool,
    findings: &mut Vec<Finding>,
) {
    let limits = robot.limits();
    for (motor, report) in reports.iter().enumerate() {
        let mut say = |finding: Finding| findings.push(finding.at_joint(&report.joint));
        let parts = |one: &Heard| [one.state.q[motor], one.state.dq[motor], one.state.torque[motor]];
        let names = ["angle", "velocity", "torque"];
        let wrong = (0..3).find(|part| heard.iter().any(|one| !parts(one)[*part].is_finite()));
        // The other checks read these numbers and would mislead.
        if let Some(part) = wrong {
            let count = heard.iter().filter(|one| !parts(one)[part].is_finite()).count();
            say(Finding::fault(
                Check::Numbers,
                format!("its {} is not finite in {count} states", names[part]),
                "Switch the robot off and on; if the fault stays, the motor's encoder or its cable is defective",
            ));
            continue;
        }
        let silent = |one: &Heard| parts(one) == [0.0; 3] && one.state.temperature[motor] == 0;
        // A joint without noise, torque and temperature may answer: then zeros show nothing.
        if !simulator && robot.messages.has_temperatures() && heard.iter().all(silent) {
            say(Finding::fault(
                Check::Present,
                "its slot in the messages has only zeros: no motor answers there",
                "Check `slot` in the robot's file, the motor's cable, and whether the motor is switched on",
            ));
            continue;
        }
        if let Some(room) = report.room.filter(|room| *room < -OUTSIDE) {
            say(Finding::fault(
                Check::Range,
                format!(
                    "it reads {:.3} rad, {:.3} rad outside its range of {} to {}",
                    report.angle, -room, limits.lower[motor], limits.upper[motor]
                ),
                "Look at the leg; if the joint is inside its range, its zero or sign is wrong, or joints are in another order",
            ));
        }
        if report.moved > MOVES[0] {
            let problem = format!("it moved by {:.3} rad while nothing was sent", report.moved);
            let remedy = "Hold the legs still and repeat; if nobody moves them, another program does, or the encoder is defective";
            say(match report.moved > MOVES[1] {
                true => Finding::fault(Check::Still, problem, remedy),
                false => Finding::warning(Check::Still, problem, remedy),
            });
        // Only of a joint that did not move: otherwise the velocity may be true.
        } else if report.velocity.abs() > RESTING {
            say(Finding::warning(
                Check::Still,
                format!("it stands still but reads a velocity of {:.3} rad/s", report.velocity),
                "Check the unit of velocities; a policy observes this number",
            ));
        }
        if report.step > COARSE {
            say(Finding::warning(
                Check::Numbers,
                format!("its angle changes in steps of {:.4} rad", report.step),
                "Some motors have two encoders: check that the angle comes from the finer one",
            ));
        }
        if let Some(finding) = temperature(report.temperature, robot.guard.temperature) {
            say(finding);
        }
        if report.error != 0 {
            say(Finding::fault(
                Check::MotorError,
                format!("its motor reports the error number {:#x}", report.error),
                "Find this number in the vendor's documentation; switch the robot off and on",
            ));
        }
        if report.lost > 0 {
            say(Finding::warning(
                Check::MotorError,
                format!("{} packets between its motor and the main board were lost", report.lost),
                "Check the motor's cable",
            ));
        }
    }
}

/// What is wrong with a motor's temperature, °C. Without a limit only temperatures that no motor has are faults.
fn temperature(degrees: i16, limit: Option<i16>) -> Option<Finding> {
    if let Some(hot) = limit.filter(|hot| degrees > *hot) {
        return Some(Finding::fault(
            Check::Temperature,
            format!("its motor is at {degrees} °C; at most {hot} are allowed"),
            "Let it cool; if it is cold, its sensor is defective",
        ));
    }
    if degrees < NO_TEMPERATURE[0] || degrees > NO_TEMPERATURE[1] {
        return Some(Finding::fault(
            Check::Temperature,
            format!("its motor reads {degrees} °C; no motor has this temperature"),
            "Replace its sensor, or check `messages` in the robot's file",
        ));
    }
    let hot = limit.filter(|hot| degrees > hot.saturating_sub(WARM))?;
    Some(Finding::warning(
        Check::Temperature,
        format!("its motor is at {degrees} °C; a run stops above {hot}"),
        "Let it cool",
    ))
}

/// Whether a joint rests at its stop, which is usual for a leg that hangs limp.
pub(super) fn at_stop(report: &JointReport) -> bool {
    report.room.is_some_and(|room| room.abs() <= AT_STOP)
}

impl JointReport {
    /// Whether it rests at an end of its range.
    pub fn is_at_stop(&self) -> bool {
        at_stop(self)
    }
}

/// Adds what is wrong with the battery, if the robot's file has a limit for it.
pub(super) fn judge_battery(heard: &[Heard], robot: &Robot, simulator: bool, findings: &mut Vec<Finding>) {
    let (Some(least), Some(last)) = (robot.guard.charge, heard.last()) else { return };
    match last.state.battery {
        Some(battery) if battery.charge < least => findings.push(Finding::fault(
            Check::Battery,
            format!("the battery is at {} %; a run needs {least} %", battery.charge),
            "Charge it",
        )),
        None if !simulator => findings.push(Finding::fault(
            Check::Battery,
            "the robot reports no battery",
            "Check its cable; if this robot has none in its state, leave `charge` out of its file",
        )),
        _ => {}
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn temperatures_are_judged_with_and_without_a_limit() {
        let problem = |degrees, limit| temperature(degrees, limit).map(|finding| finding.problem);
        let words =
            |degrees, limit, words: &str| problem(degrees, limit).is_some_and(|text| text.contains(words));
        assert!(words(90, Some(85), "at most 85 are allowed"));
        assert!(words(80, Some(85), "a run stops above 85"));
        assert!(words(200, None, "no motor has this temperature"));
        assert!(words(-40, Some(85), "no motor has this temperature"));
        assert_eq!((problem(140, None), problem(60, Some(85))), (None, None));
    }
}
