//! Whether a robot's states are such that it may be driven.

use std::f32::consts::TAU;
use std::sync::Arc;
use std::time::Duration;

use gaitfit_model::rotation::up;

use super::{Limits, Reason};
use crate::robot::Robot;
use crate::state::{Reading, RobotState, Seal};

/// Limits that lead to damping.
#[derive(Clone, Debug, PartialEq)]
pub struct GuardSettings {
    /// Names of the joints, motor order, for reasons.
    pub joints: Arc<[String]>,
    /// Limits of its motors.
    pub limits: Limits,
    /// Oldest state to act on.
    pub stale: Duration,
    /// Longest time between two commands.
    pub late: Duration,
    /// Oldest output of the policy to act on.
    pub late_policy: Duration,
    /// Largest angle between the base's z axis and the world's, degrees.
    pub tilt: f32,
    /// Hottest motor, °C; `None` where the robot's state has no temperatures.
    pub temperature: Option<i16>,
    /// Least charge of the battery, %; `None` where the robot's state has no battery.
    pub charge: Option<u8>,
    /// How far a joint may be outside of its range, rad: encoders are off, and stops give way.
    pub range_margin: f32,
    /// Whether the sender is a simulator: it may leave checksum, counter and battery out.
    pub simulator: bool,
}

impl GuardSettings {
    /// For a robot whose policy acts every `control_dt`: states of 20 ms, and what its file says.
    pub fn new(robot: &Robot, control_dt: Duration) -> Self {
        Self {
            joints: robot.joints(),
            limits: robot.limits(),
            // Ten states or commands at 500 Hz.
            stale: Duration::from_millis(20),
            late: Duration::from_millis(20),
            // One output may be missing, and the next one a little late.
            late_policy: 2 * control_dt + Duration::from_millis(10),
            tilt: robot.guard.tilt,
            temperature: robot.guard.temperature,
            charge: robot.guard.charge,
            range_margin: 0.15,
            simulator: false,
        }
    }
}

/// Factor on a joint's largest speed that no reading may exceed: of a robot, and of a simulator, whose motors turn as fast as
/// their torques make them.
const SPEED_FACTOR: f32 = 1.5;
/// See [`SPEED_FACTOR`].
const SIMULATED_SPEED_FACTOR: f32 = 3.0;
/// Jump that a joint may show beside its speed, rad: noise and delayed messages.
const JUMP: f32 = 0.25;
/// Longest time between two states that the robot's counter may tell, ms: with more a state would be stale, and a
/// wrong counter could excuse any jump.
const MAX_COUNTED: u32 = 20;
/// Max difference of the length of the orientation's quaternion from 1.
const OFF_UNIT: f32 = 0.05;

/// Watches a robot's states.
#[derive(Clone, Debug)]
pub struct Watch {
    settings: GuardSettings,
    /// The last reading with news in it, and when it came.
    last: Option<(Duration, RobotState)>,
}

impl Watch {
    /// Nothing seen yet.
    pub fn new(settings: GuardSettings) -> Self {
        Self { settings, last: None }
    }

    /// Returns the limits that lead to damping.
    pub fn settings(&self) -> &GuardSettings {
        &self.settings
    }

    /// The last state that was taken.
    pub fn state(&self) -> Option<&RobotState> {
        self.last.as_ref().map(|(_, state)| state)
    }

    /// When the last state came that was taken.
    pub fn came(&self) -> Option<Duration> {
        self.last.as_ref().map(|(came, _)| *came)
    }

    /// Takes a reading that came at `now`. A state that fails a rule is not taken. One whose counter stands still holds no
    /// news: it counts as none.
    ///
    /// # Errors
    /// The first rule that it fails.
    pub fn take(&mut self, now: Duration, reading: &Reading) -> Result<(), Reason> {
        let sealed = match reading.seal {
            Seal::Right | Seal::Unused => true,
            Seal::Absent => self.settings.simulator,
            Seal::Wrong => false,
        };
        if !sealed {
            return Err(Reason::WrongChecksum);
        }
        let state = &reading.state;
        // The time of the last news stays, so that a robot that repeats one state becomes too old.
        if let Some((_, before)) = &self.last
            && before.tick == state.tick
            && self.counts(reading)
        {
            return Ok(());
        }
        // First: comparisons with NaN are false, so the checks below would let it pass.
        self.check_numbers(state)?;
        self.check_joints(now, state, self.counts(reading))?;
        self.check_body(state)?;
        // Whoever commands: it is the button at hand.
        if state.remote.b {
            return Err(Reason::Operator);
        }
        self.last = Some((now, *state));
        Ok(())
    }

    /// Whether the last state is fresh at `now`.
    ///
    /// # Errors
    /// None has come, or it is old.
    pub fn fresh(&self, now: Duration) -> Result<&RobotState, Reason> {
        let (came, state) = self.last.as_ref().ok_or(Reason::NoState)?;
        let age = now.saturating_sub(*came);
        if age > self.settings.stale {
            return Err(Reason::StaleState(1e3 * age.as_secs_f64()));
        }
        Ok(state)
    }

    fn check_numbers(&self, state: &RobotState) -> Result<(), Reason> {
        let parts: [(&'static str, &[f32]); 6] = [
            ("a joint's angle", &state.q),
            ("a joint's velocity", &state.dq),
            ("a joint's torque", &state.torque),
            ("the orientation", &state.quaternion),
            ("the gyroscope", &state.gyroscope),
            ("the accelerometer", &state.accelerometer),
        ];
        match parts.iter().find(|(_, numbers)| numbers.iter().any(|x| !x.is_finite())) {
            Some((what, _)) => Err(Reason::StateNotFinite(what)),
            None => Ok(()),
        }
    }

    /// Whether its sender counts: simulators may not, and messages without a checksum may have no stamp.
    fn counts(&self, reading: &Reading) -> bool {
        reading.state.tick != 0 || !(self.settings.simulator || reading.seal == Seal::Unused)
    }

    fn check_joints(&self, now: Duration, state: &RobotState, counts: bool) -> Result<(), Reason> {
        let GuardSettings { limits, range_margin, temperature, .. } = &self.settings;
        // A link gives as many joints as its robot has; another number is another robot.
        if state.q.len() != limits.torque.len() {
            return Err(Reason::OtherRobot(state.q.len()));
        }
        // Ranges of all first: joints in another order jump too.
        for (motor, &angle) in state.q.iter().enumerate() {
            if angle < limits.lower[motor] - range_margin || angle > limits.upper[motor] + range_margin {
                return Err(Reason::OutOfRange { joint: self.joint(motor), angle });
            }
        }
        let factor = if self.settings.simulator { SIMULATED_SPEED_FACTOR } else { SPEED_FACTOR };
        for motor in 0..state.q.len() {
            let (angle, speed) = (state.q[motor], state.dq[motor]);
            let fastest = factor * limits.speed[motor];
            if speed.abs() > fastest {
                return Err(Reason::TooFast { joint: self.joint(motor), speed });
            }
            if let Some((came, before)) = &self.last {
                let jump = angle - before.q[motor];
                // Some encoders count a wheel's turns. Others begin again at each turn.
                let wheel = limits.upper[motor] - limits.lower[motor] == f32::INFINITY;
                let jump = if wheel { jump - TAU * (jump / TAU).round() } else { jump };
                // Messages that were held up come in a heap: the robot's own counter tells how far apart they are.
                // One that does not count may have been held up for as long as that.
                let counted = match counts {
                    true => state.tick.wrapping_sub(before.tick).min(MAX_COUNTED),
                    false => MAX_COUNTED,
                };
                let apart = now.saturating_sub(*came).max(Duration::from_millis(counted.into()));
                if jump.abs() > JUMP + fastest * apart.as_secs_f32() {
                    return Err(Reason::Jump { joint: self.joint(motor), angle: jump });
                }
            }
            if temperature.is_some_and(|hottest| state.temperature[motor] > hottest) {
                return Err(Reason::Hot { joint: self.joint(motor), degrees: state.temperature[motor] });
            }
        }
        Ok(())
    }

    fn joint(&self, motor: usize) -> String {
        self.settings.joints.get(motor).cloned().unwrap_or_default()
    }

    fn check_body(&self, state: &RobotState) -> Result<(), Reason> {
        let length = state.quaternion.iter().map(|x| x * x).sum::<f32>().sqrt();
        if (length - 1.0).abs() > OFF_UNIT {
            return Err(Reason::NoOrientation);
        }
        // The world's z axis in the body frame; its z is the cosine of the tilt.
        // Rotating by a quaternion that is not quite of length 1 stretches by its length squared.
        // The clamp is for rounding: beyond 1 the arc cosine is NaN, and NaN would pass the comparison.
        let tilt = (up(state.quaternion)[2] / (length * length)).clamp(-1.0, 1.0).acos().to_degrees();
        if tilt > self.settings.tilt {
            return Err(Reason::Tilt(tilt));
        }
        let Some(charge) = self.settings.charge else { return Ok(()) };
        match state.battery {
            Some(battery) if battery.charge < charge => Err(Reason::Battery(battery.charge)),
            None if !self.settings.simulator => Err(Reason::NoBattery),
            _ => Ok(()),
        }
    }
}
