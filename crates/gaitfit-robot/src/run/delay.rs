//! How long a command takes to a joint: which delay explains the torques that the motors report.

use std::collections::VecDeque;
use std::time::Duration;

use serde::Serialize;

use crate::command::Command;
use crate::guard::Limits;
use crate::state::RobotState;

/// Max number of moments that are kept: half a minute at 500 Hz.
const MAX_SAMPLES: usize = 15_000;
/// Delays that are tried, ms.
const DELAYS: u64 = 60;
/// Min number of states for an answer.
const FEWEST: usize = 200;

/// Commands and states, in the order of time.
#[derive(Clone, Debug, Default)]
pub struct Trace {
    commands: VecDeque<(Duration, Command)>,
    states: VecDeque<(Duration, RobotState)>,
}

/// The delay that explains the reported torques best.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct Delay {
    /// Time from sending a command to a state with its torque in it, whole ms.
    pub ms: u64,
    /// Part that stays unexplained: root mean square of the difference over that of the torques.
    pub residual: f64,
}

impl Trace {
    /// A command sent at `now`, and the state that came just before, if there was a new one.
    pub fn take(&mut self, now: Duration, state: Option<(Duration, RobotState)>, command: &Command) {
        if let Some(state) = state {
            if self.states.len() == MAX_SAMPLES {
                self.states.pop_front();
            }
            self.states.push_back(state);
        }
        if self.commands.len() == MAX_SAMPLES {
            self.commands.pop_front();
        }
        self.commands.push_back((now, *command));
    }

    /// Of delays of whole milliseconds, that with the least squares between the reported torques and those that the
    /// command of so long ago makes at the reported angles and velocities, within `limits`. `None` after a short walk, and
    /// where no torques are reported.
    pub fn delay(&self, limits: &Limits) -> Option<Delay> {
        // For earlier states the command of the longest delay is not kept.
        let first = self.commands.front()?.0 + Duration::from_millis(DELAYS);
        let states: Vec<&(Duration, RobotState)> =
            self.states.iter().filter(|(came, _)| *came >= first).collect();
        let power: f64 = states.iter().flat_map(|(_, state)| &state.torque).map(|x| f64::from(x * x)).sum();
        // A robot that reports no torques has zeros.
        if states.len() < FEWEST || power == 0.0 {
            return None;
        }
        let error = |ms: u64| -> f64 {
            let delay = Duration::from_millis(ms);
            let mut next = 0;
            let mut sum = 0.0;
            for (came, state) in &states {
                // The last command that had arrived by then; both lists rise, so one pass is enough.
                while self.commands.get(next + 1).is_some_and(|(sent, _)| *sent + delay <= *came) {
                    next += 1;
                }
                let (_, command) = &self.commands[next];
                for motor in 0..state.q.len() {
                    let max = limits.torque[motor];
                    // The motor cuts what it cannot give, and reports the rest.
                    let made = command[motor].torque(state.q[motor], state.dq[motor]).clamp(-max, max);
                    sum += f64::from(made - state.torque[motor]).powi(2);
                }
            }
            sum
        };
        let (ms, min) = (0..=DELAYS).map(|ms| (ms, error(ms))).min_by(|a, b| a.1.total_cmp(&b.1))?;
        Some(Delay { ms, residual: (min / power).sqrt() })
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::command::MotorCommand;
    use crate::per_motor::PerMotor;
    use crate::state::tests::standing;

    fn go2() -> Limits {
        crate::Robot::built_in("unitree-go2").unwrap().limits()
    }

    #[test]
    fn the_delay_of_made_up_torques_is_found() {
        for late in [0u64, 7, 23] {
            let mut trace = Trace::default();
            let wanted = |ms: u64| -> Command {
                PerMotor::from_fn(12, |motor| MotorCommand {
                    q: (0.013 * ms as f32 + motor as f32).sin(),
                    kp: 25.0,
                    kd: 0.5,
                    ..MotorCommand::default()
                })
            };
            for tick in 0..1000u64 {
                let ms = 2 * tick;
                let mut state = standing();
                // The command in force is the last that was sent `late` or longer ago.
                let sent = ms.saturating_sub(late) / 2 * 2;
                let command = wanted(sent);
                state.torque =
                    PerMotor::from_fn(12, |motor| command[motor].torque(state.q[motor], state.dq[motor]));
                let max = go2().torque;
                state
                    .torque
                    .iter_mut()
                    .zip(&max)
                    .for_each(|(torque, max)| *torque = torque.clamp(-max, *max));
                let now = Duration::from_millis(ms);
                trace.take(now, Some((now, state)), &wanted(ms));
            }
            let delay = trace.delay(&go2());
            assert!(
                delay.is_some_and(
                    |delay| (late.saturating_sub(1)..=late).contains(&delay.ms) && delay.residual < 1e-3
                ),
                "{late}: {delay:?}"
            );
        }
    }

    #[test]
    fn without_torques_there_is_no_delay() {
        let mut trace = Trace::default();
        for tick in 0..1000u64 {
            let now = Duration::from_millis(2 * tick);
            trace.take(now, Some((now, standing())), &crate::command::damping(&PerMotor::new(12, 2.0)));
        }
        assert_eq!(trace.delay(&go2()), None);
        assert_eq!(Trace::default().delay(&go2()), None);
    }
}
