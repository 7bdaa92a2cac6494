//! Numbers that the two loops of a run exchange.

use std::time::Duration;

use crate::command::Command;
use crate::guard::Reason;
use crate::per_motor::PerMotor;
use crate::state::RobotState;
use crate::supervisor::Phase;

/// Numbers that the two loops of a run exchange: the one that sends at a high rate, and the policy's.
#[derive(Clone, Debug)]
pub struct Board {
    /// The last good state and when it came.
    pub state: Option<(Duration, RobotState)>,
    /// Phase of the run.
    pub phase: Phase,
    /// It stands and waits for the policy.
    pub awaits_policy: bool,
    /// The last command was sent.
    pub over: bool,
    /// The reason for damping, or for not arming the robot.
    pub reason: Option<Reason>,
    /// Why it was not armed when that was asked for.
    pub refused: Option<Reason>,
    /// The command that was sent last.
    pub sent: Option<Command>,
    /// Commands of other programs so far.
    pub others: u64,
    /// Asks the sender to leave idle.
    pub arm: bool,
    /// Tells the sender that the commands are over: the robot comes to rest.
    pub slow_down: bool,
    /// Tells the sender that the walk is over.
    pub lie_down: bool,
    /// Asks the sender for damping.
    pub stop: Option<Reason>,
    /// To the sender: the policy's targets and their time. Motor order; rad, or rad/s for wheels that roll.
    pub targets: Option<(Duration, PerMotor<f32>)>,
}

impl Default for Board {
    fn default() -> Self {
        Self {
            state: None,
            phase: Phase::Idle,
            awaits_policy: false,
            over: false,
            reason: None,
            refused: None,
            sent: None,
            others: 0,
            arm: false,
            slow_down: false,
            lie_down: false,
            stop: None,
            targets: None,
        }
    }
}
