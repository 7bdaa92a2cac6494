//! The loop that sends: states in, the guard, commands out.

use std::time::Duration;

use super::board::Board;
use super::delay::Trace;
use super::jitter::Jitter;
use crate::RobotError;
use crate::guard::Reason;
use crate::link::Link;
use crate::supervisor::{Phase, Supervisor};

/// Sends commands at a steady rate and takes what the robot says.
pub struct Sender<'a> {
    link: Box<dyn Link + Send + 'a>,
    supervisor: Supervisor,
    /// Computes and sends nothing.
    dry: bool,
    targets_of: Option<Duration>,
    first_came: Option<Duration>,
    last_came: Option<Duration>,
    /// Messages of the robot so far.
    pub states: u64,
    /// Messages while armed.
    pub armed_states: u64,
    /// Commands sent so far.
    pub commands: u64,
    /// Commands of the policy that the guard changed.
    pub clamped: u64,
    /// Longest time between two messages while armed.
    pub longest_gap: Duration,
    /// Lateness of the loop.
    pub jitter: Jitter,
    /// Commands and states while walking.
    pub trace: Trace,
}

impl<'a> Sender<'a> {
    /// Idle. `dry`: it computes and sends nothing.
    pub fn new(link: Box<dyn Link + Send + 'a>, supervisor: Supervisor, dry: bool) -> Self {
        Self {
            link,
            supervisor,
            dry,
            targets_of: None,
            first_came: None,
            last_came: None,
            states: 0,
            armed_states: 0,
            commands: 0,
            clamped: 0,
            longest_gap: Duration::ZERO,
            jitter: Jitter::default(),
            trace: Trace::default(),
        }
    }

    /// Its part of the work at `now`.
    pub fn cycle(&mut self, now: Duration, board: &mut Board) {
        // Taken apart, because the closure below changes some of them while the link is borrowed.
        let Self {
            link, supervisor, states, armed_states, first_came, last_came, longest_gap, trace, ..
        } = self;
        // The order matters: first what speaks against moving (states, other controllers, reasons to stop), then
        // what is asked for, then the command, so that it never rests on a state that was refused in the same turn.
        let armed = supervisor.phase() != Phase::Idle;
        let mut newest = None;
        let heard = link.receive(now, &mut |age, reading| {
            let came = now.saturating_sub(age);
            supervisor.read(came, reading);
            *states += 1;
            *armed_states += u64::from(armed);
            first_came.get_or_insert(came);
            if let Some(before) = last_came.replace(came)
                && armed
            {
                *longest_gap = (*longest_gap).max(came.saturating_sub(before));
            }
            newest = Some((came, reading.state));
        });
        match heard {
            Ok(0) => {}
            Ok(others) => {
                board.others += others;
                supervisor.second_controller(now);
            }
            Err(problem) => supervisor.stop(now, Reason::Link(problem)),
        }
        if let Some(what) = link.lacks() {
            supervisor.lacks(now, what);
        }
        if let Some(reason) = board.stop.take() {
            supervisor.stop(now, reason);
        }
        if std::mem::take(&mut board.arm)
            && let Err(RobotError::NotArmed(reason)) = supervisor.arm(now)
        {
            board.refused = Some(reason);
        }
        if std::mem::take(&mut board.slow_down) {
            supervisor.slow_down(now);
        }
        if std::mem::take(&mut board.lie_down) {
            supervisor.lie_down(now);
        }
        if let Some((at, targets)) = board.targets
            // Each output is taken once, so that its age grows while the policy is silent.
            && self.targets_of != Some(at)
        {
            self.targets_of = Some(at);
            supervisor.aim(at, targets);
        }
        let command = supervisor.tick(now);
        if let Some(command) = &command {
            if supervisor.phase() == Phase::Walk {
                self.clamped += u64::from(supervisor.changed());
                trace.take(now, newest, command);
            }
            if !self.dry {
                self.commands += 1;
                if let Err(problem) = link.send(command) {
                    supervisor.stop(now, Reason::Link(problem));
                }
            }
        }
        // Not the time of the last message, which may repeat the state: the state would look younger than it is.
        board.state = supervisor.came().zip(supervisor.state().copied());
        board.phase = supervisor.phase();
        board.awaits_policy = supervisor.awaits_policy(now);
        board.over = supervisor.is_over(now);
        board.reason = supervisor.reason().or(supervisor.refused()).cloned();
        // In a dry run nothing was sent, so the cells of the log are empty.
        board.sent = if self.dry { None } else { command };
    }

    /// Whether it computes and sends nothing.
    pub fn is_dry(&self) -> bool {
        self.dry
    }

    /// Rate of the robot's messages from the first to the last, Hz; 0 for fewer than two.
    pub fn state_hz(&self) -> f64 {
        match (self.first_came, self.last_came) {
            (Some(first), Some(last)) if last > first => {
                (self.states - 1) as f64 / (last - first).as_secs_f64()
            }
            _ => 0.0,
        }
    }
}
