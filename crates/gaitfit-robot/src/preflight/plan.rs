//! The targets of the joints, as a function of the time since the motion began.

use std::f64::consts::{PI, TAU};
use std::time::Duration;

use serde::Serialize;

use crate::command::{Command, MotorCommand};
use crate::per_motor::PerMotor;
use crate::robot::Robot;

/// Stage of the motion.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "kebab-case")]
pub enum Stage {
    /// Nothing is sent.
    Idle,
    /// Targets are where the joints are; the gains grow from 0.
    Soften,
    /// The joints move slowly to the hanging pose.
    Approach,
    /// The joints rest in the hanging pose.
    Hold,
    /// The joint of this motor moves alone.
    Joint(usize),
    /// All joints move together.
    Excite,
    /// The joints move slowly back to where they were.
    Return,
    /// The motors resist motion and hold nothing. It is never left.
    Damping,
}

/// kp of all motions, as a part of the robot file's kp for standing up.
const SOFT: f32 = 0.5;
/// Time in which the gains grow, s.
const SOFTEN: f64 = 1.5;
/// Mean speed of the joint that has the longest way in approach and return, rad/s.
const SPEED: f64 = 0.4;
/// Min time of approach and return, s, for joints that are in the hanging pose already.
const LEAST: f64 = 1.5;
/// Time at rest before the joints move, s.
const HOLD: f64 = 0.7;
/// Largest motion of a joint about its pose, rad.
pub(super) const AMPLITUDE: f64 = 0.1;
/// Distance of targets from the ends of a joint's range, rad: a reading may be off by as much.
const ROOM: f64 = 0.03;
/// Time of the first half of a joint's own motion, up and back, and of the second, down and back, s. The amount is
/// judged from these halves alone.
pub(super) const SLOW: f64 = 0.9;
/// Time of the quick motion after them, s.
const QUICK: f64 = 0.8;
/// Frequency of the quick motion, Hz.
const QUICK_HZ: f64 = 4.0;
/// Size of the quick motion, in parts of the slow one.
const QUICK_PART: f64 = 0.7;
/// Time in which all joints move together, s.
const EXCITE: f64 = 8.0;
/// Frequency of that motion at its beginning and at its end, Hz.
const SWEEP: [f64; 2] = [0.3, 3.0];
/// Size of that motion, in parts of a joint's amplitude.
const EXCITE_PART: f64 = 0.8;
/// Time in which that motion grows at its beginning and fades at its end, s.
const FADE: f64 = 0.5;

/// The targets of the joints over time.
#[derive(Clone, Debug)]
pub struct Plan {
    /// Where the joints were, rad.
    from: PerMotor<f32>,
    /// The hanging pose, rad.
    hanging: PerMotor<f32>,
    /// Largest motion of each joint, rad.
    amplitude: PerMotor<f32>,
    kp: PerMotor<f32>,
    kd: PerMotor<f32>,
    /// Motors that move alone, one after another.
    order: Vec<usize>,
    /// Time of approach and return, s.
    travel: f64,
}

impl Plan {
    /// For a robot whose joints are at `from`. Motors without a position gain, as those of wheels, are braked and do not move.
    pub fn new(robot: &Robot, from: PerMotor<f32>) -> Self {
        let hanging = robot.hanging();
        let kp = robot.each(|motor| SOFT * motor.kp);
        // All joints take the time of the one with the longest way, so that they arrive together.
        let furthest = (0..from.len())
            .filter(|&motor| kp[motor] > 0.0)
            .map(|motor| f64::from(hanging[motor] - from[motor]).abs())
            .fold(0.0, f64::max);
        let amplitude = PerMotor::from_fn(from.len(), |motor| {
            let [low, high] = robot.motors[motor].range.unwrap_or([f32::NEG_INFINITY, f32::INFINITY]);
            // The motion is the same to both sides, so the nearer end of the range bounds it.
            let room = (high - hanging[motor]).min(hanging[motor] - low) - ROOM as f32;
            // An infinite range leaves the whole amplitude.
            room.clamp(0.0, AMPLITUDE as f32)
        });
        Self {
            from,
            hanging,
            amplitude,
            kd: robot.each(|motor| motor.kd),
            order: (0..from.len()).filter(|&motor| kp[motor] > 0.0).collect(),
            kp,
            travel: (furthest / SPEED).max(LEAST),
        }
    }

    /// Position gains, N·m/rad.
    pub fn kp(&self) -> &PerMotor<f32> {
        &self.kp
    }

    /// Velocity gains, N·m·s/rad.
    pub fn kd(&self) -> &PerMotor<f32> {
        &self.kd
    }

    /// The hanging pose, rad.
    pub fn hanging(&self) -> &PerMotor<f32> {
        &self.hanging
    }

    /// Largest motion of each joint about it, rad.
    pub fn amplitude(&self) -> &PerMotor<f32> {
        &self.amplitude
    }

    /// Motors that move alone, one after another.
    pub fn order(&self) -> &[usize] {
        &self.order
    }

    /// Length of the whole motion before damping, s.
    pub fn seconds(&self) -> f64 {
        SOFTEN + 2.0 * self.travel + HOLD + self.alone() * self.order.len() as f64 + EXCITE
    }

    /// Length of a joint's own motion, s.
    fn alone(&self) -> f64 {
        2.0 * SLOW + QUICK
    }

    /// Stage at `elapsed` since the motion began, and the time since the stage began, s.
    pub fn stage(&self, elapsed: Duration) -> (Stage, f64) {
        let mut time = elapsed.as_secs_f64();
        let alone = self.order.iter().map(|&motor| (Stage::Joint(motor), self.alone()));
        let begin = [(Stage::Soften, SOFTEN), (Stage::Approach, self.travel), (Stage::Hold, HOLD)];
        let end = [(Stage::Excite, EXCITE), (Stage::Return, self.travel)];
        for (stage, length) in begin.into_iter().chain(alone).chain(end) {
            if time < length {
                return (stage, time);
            }
            time -= length;
        }
        (Stage::Damping, time)
    }

    /// Targets of a stage, `time` s after it began; those of damping are where the joints were at first.
    pub fn command(&self, stage: Stage, time: f64) -> Command {
        // Half a cosine begins and ends at rest; in the middle it is π/2 times as fast as on average.
        let smooth = |part: f64| 0.5 - 0.5 * (PI * part.clamp(0.0, 1.0)).cos();
        let between = |from: &PerMotor<f32>, to: &PerMotor<f32>, part: f64, motor: usize| {
            from[motor] + smooth(part) as f32 * (to[motor] - from[motor])
        };
        // Gains rise from 0, so that a wrong zero does not show as a jump.
        let gain = if stage == Stage::Soften { (time / SOFTEN).clamp(0.0, 1.0) as f32 } else { 1.0 };
        PerMotor::from_fn(self.from.len(), |motor| {
            // A wheel is braked where it is.
            let moves = self.kp[motor] > 0.0;
            let q = match stage {
                _ if !moves => self.from[motor],
                Stage::Approach => between(&self.from, &self.hanging, time / self.travel, motor),
                Stage::Return => between(&self.hanging, &self.from, time / self.travel, motor),
                Stage::Hold => self.hanging[motor],
                Stage::Joint(one) => {
                    let wave = if one == motor { alone(time) } else { 0.0 };
                    self.hanging[motor] + self.amplitude[motor] * wave as f32
                }
                Stage::Excite => self.hanging[motor] + self.amplitude[motor] * together(time, motor) as f32,
                Stage::Idle | Stage::Soften | Stage::Damping => self.from[motor],
            };
            MotorCommand { q, kp: gain * self.kp[motor], kd: self.kd[motor], ..MotorCommand::default() }
        })
    }
}

/// A joint's own motion, −1 to 1.
fn alone(time: f64) -> f64 {
    // Each part is 0 at both ends, and so is its velocity: targets never jump.
    let bump = |time: f64| (PI * time / SLOW).sin().powi(2);
    if time < SLOW {
        bump(time)
    } else if time < 2.0 * SLOW {
        -bump(time - SLOW)
    } else {
        // After its end the motion stays at 0.
        let time = (time - 2.0 * SLOW).min(QUICK);
        QUICK_PART * (TAU * QUICK_HZ * time).sin() * (PI * time / QUICK).sin().powi(2)
    }
}

/// A joint's part of the motion of all, −1 to 1: a sweep with a phase of its own.
fn together(time: f64, motor: usize) -> f64 {
    let fade = (time.min(EXCITE - time) / FADE).clamp(0.0, 1.0);
    // The frequency grows linearly; its integral is the phase.
    let turns = SWEEP[0] * time + 0.5 * (SWEEP[1] - SWEEP[0]) * time * time / EXCITE;
    // The golden ratio spreads the phases of any number of joints.
    let phase = TAU * (motor as f64 * 0.618_033_988_75).fract();
    EXCITE_PART * fade * (TAU * turns + phase).sin()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::robot::BUILT_IN;

    #[test]
    fn targets_are_inside_the_ranges_and_never_jump() {
        for (name, _) in BUILT_IN {
            let robot = Robot::built_in(name).unwrap();
            let plan = Plan::new(&robot, robot.each(|motor| motor.lying));
            let (limits, mut before) = (robot.limits(), None::<Command>);
            let ticks = (plan.seconds() / 0.002) as u64 + 10;
            for tick in 0..ticks {
                let (stage, time) = plan.stage(Duration::from_millis(2 * tick));
                let command = plan.command(stage, time);
                for (motor, slot) in command.iter().enumerate() {
                    let range = limits.lower[motor]..=limits.upper[motor];
                    assert!(range.contains(&slot.q), "{name} {stage:?} {motor} {}", slot.q);
                    let last = before.map_or(slot.q, |before| before[motor].q);
                    assert!((slot.q - last).abs() < 0.005, "{name} {stage:?} {motor}: {last} {}", slot.q);
                    assert!(slot.kp <= 0.5 * robot.motors[motor].kp && slot.kd <= robot.motors[motor].kd);
                }
                before = Some(command);
            }
            assert_eq!(plan.stage(Duration::from_secs_f64(plan.seconds() + 0.1)).0, Stage::Damping);
            let moving = robot.motors.iter().filter(|motor| motor.kp > 0.0).count();
            assert_eq!(plan.order().len(), moving, "{name}");
            assert!(plan.order().iter().all(|&motor| plan.amplitude()[motor] > 0.09), "{name}");
        }
    }
}
