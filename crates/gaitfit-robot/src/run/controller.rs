//! The policy's loop: what the robot senses in, targets out, and the logs.

use std::time::Duration;

use gaitfit_policy::observation::Sensed;
use gaitfit_policy::{Pilot, Policy};

use super::board::Board;
use super::commands::{Commands, Order};
use super::record::{Acted, Recorder};
use crate::RobotError;
use crate::per_motor::PerMotor;
use crate::robot::Robot;
use crate::state::RobotState;
use crate::supervisor::Phase;

/// Time for which the robot walks under the command 0 before it lies down, s.
const STOP: f64 = 1.0;

/// Runs a policy under commands.
pub struct Controller<'a> {
    pilot: Pilot<'a>,
    commands: Box<dyn Commands + 'a>,
    recorder: Recorder,
    /// Motor of each of the policy's joints.
    motors: Vec<usize>,
    /// Angles at which motors stay that the policy does not move, rad, motor order.
    standing: PerMotor<f32>,
    sensed: Sensed,
    begun: Option<Duration>,
    /// Time at which the commands were over, s after it began.
    ended: Option<f64>,
    /// The walk that is recorded.
    walk: Option<usize>,
    /// Age of the state at each output of the policy: sum and greatest, s.
    pub ages: (f64, f64),
    /// Outputs of the policy.
    pub outputs: u64,
}

impl<'a> Controller<'a> {
    /// `policy` on `robot` under `commands`; `recorder` keeps its logs.
    ///
    /// # Errors
    /// A policy for other joints, or one that observes what a robot does not measure.
    pub fn new(
        robot: &Robot,
        policy: &'a Policy,
        commands: impl Commands + 'a,
        recorder: Recorder,
    ) -> Result<Self, RobotError> {
        Ok(Self {
            motors: robot.motors_of(&policy.interface.joints)?,
            standing: robot.postures(&policy.interface)?.standing,
            pilot: Pilot::new(policy)?,
            commands: Box::new(commands),
            recorder,
            sensed: Sensed::new(policy.interface.joints.len()),
            begun: None,
            ended: None,
            walk: None,
            ages: (0.0, 0.0),
            outputs: 0,
        })
    }

    /// Makes the files of the logs; without it they are made at their first rows.
    ///
    /// # Errors
    /// Files that cannot be written.
    pub fn open_logs(&mut self) -> Result<(), RobotError> {
        self.recorder.open()
    }

    /// Removes logs that have no row, of a robot that was not armed after all.
    pub fn remove_logs(&mut self) {
        self.recorder.remove_empty();
    }

    /// Its part of the work at `now`: a turn each control period.
    ///
    /// # Errors
    /// Logs that cannot be written. The caller stops the robot.
    pub fn cycle(&mut self, now: Duration, board: &mut Board) -> Result<(), RobotError> {
        let Some((came, state)) = board.state else { return Ok(()) };
        let age = now.saturating_sub(came).as_secs_f64();
        // An idle robot gets no commands: there is nothing to record.
        if board.phase != Phase::Idle {
            self.recorder.whole(now.as_secs_f64(), &state, age, board.phase, board.sent.as_ref())?;
        }
        // In other phases the supervisor moves the robot alone.
        if !(matches!(board.phase, Phase::Walk | Phase::Stop) || board.awaits_policy) {
            return Ok(());
        }
        let begun = *self.begun.get_or_insert(now);
        let time = (now - begun).as_secs_f64();
        let order = if self.ended.is_some() { None } else { self.commands.at(time, &state) };
        let Order { command, walk } = match order {
            Some(order) => order,
            // A robot that lies down at speed falls. Logs do not have this part: their walk is over.
            None if time < *self.ended.get_or_insert(time) + STOP => {
                board.slow_down = true;
                Order { command: [0.0; 3], walk: None }
            }
            None => {
                board.lie_down = true;
                return Ok(());
            }
        };
        let number = walk.map(|(number, _)| number);
        if number != self.walk {
            self.walk = number;
            if let Some(number) = number {
                // As in simulated logs: a log begins with a policy that has done nothing yet.
                self.pilot.begin();
                self.recorder.begin(number)?;
            }
        }
        // Observe, act, and give motors that the policy does not move their standing angles.
        self.sense(&state, command);
        let (action, targets) = self.pilot.step(&mut self.sensed);
        let mut of_motors = self.standing;
        for (&motor, &target) in self.motors.iter().zip(targets) {
            of_motors[motor] = target;
        }
        board.targets = Some((now, of_motors));
        self.outputs += 1;
        self.ages = (self.ages.0 + age, self.ages.1.max(age));
        match walk {
            Some((_, began)) => {
                self.recorder.walk(&state, age, &Acted { time: time - began, command, action, targets })
            }
            None => Ok(()),
        }
    }

    fn sense(&mut self, state: &RobotState, command: [f32; 3]) {
        let sensed = &mut self.sensed;
        sensed.base_angular_velocity = state.gyroscope;
        sensed.orient(state.quaternion);
        sensed.command = command;
        for (index, &motor) in self.motors.iter().enumerate() {
            sensed.joint_position[index] = state.q[motor];
            sensed.joint_velocity[index] = state.dq[motor];
        }
    }
}
