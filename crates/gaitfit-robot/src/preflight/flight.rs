//! The small motions of a hanging robot, with the guard of a run before every command. Pure: times are given.

use std::time::Duration;

use super::Heard;
use super::plan::{Plan, Stage};
use crate::RobotError;
use crate::command::{Command, damping};
use crate::guard::{GuardSettings, Reason, Watch};
use crate::per_motor::PerMotor;
use crate::robot::Robot;
use crate::state::Reading;

/// How far a joint may be from its target, rad: while the gains grow, and afterwards. While they grow, targets are
/// where the joints are: a joint that moves has another order, sign or zero in commands than in states.
const ASTRAY: [f32; 2] = [0.12, 0.3];
/// Damping before the last command, as long as that of a run.
const DAMPING: Duration = Duration::from_secs(2);

/// A command that was sent.
#[derive(Clone, Copy, Debug)]
pub struct Sent {
    /// When.
    pub at: Duration,
    /// The stage in which it was sent.
    pub stage: Stage,
    /// What.
    pub command: Command,
}

/// A motion, or the part of it that was made.
#[derive(Clone, Debug)]
pub struct Flown {
    /// Commands that were sent.
    pub sent: Vec<Sent>,
    /// States that came meanwhile.
    pub heard: Vec<Heard>,
    /// The plan; absent if the robot was not armed.
    pub plan: Option<Plan>,
    /// The reason for damping; `None` after an orderly end.
    pub reason: Option<Reason>,
    /// Commands that the guard changed.
    pub changed: u64,
}

/// Moves the joints of a robot that hangs.
#[derive(Clone, Debug)]
pub struct Flight {
    robot: Robot,
    watch: Watch,
    damping: PerMotor<f32>,
    stage: Stage,
    begun: Duration,
    /// Time at which damping began.
    damped: Duration,
    ticked: Option<Duration>,
    refused: Option<Reason>,
    flown: Flown,
}

impl Flight {
    /// A flight that is idle until [`Self::arm`].
    pub fn new(robot: &Robot, guard: GuardSettings) -> Self {
        Self {
            robot: robot.clone(),
            watch: Watch::new(guard),
            damping: robot.each(|motor| motor.damping),
            stage: Stage::Idle,
            begun: Duration::ZERO,
            damped: Duration::ZERO,
            ticked: None,
            refused: None,
            flown: Flown { sent: Vec::new(), heard: Vec::new(), plan: None, reason: None, changed: 0 },
        }
    }

    /// The current stage.
    pub fn stage(&self) -> Stage {
        self.stage
    }

    /// Returns the states and commands of the motion.
    pub fn flown(self) -> Flown {
        self.flown
    }

    /// Whether it is over: it was in damping long enough.
    pub fn is_over(&self, now: Duration) -> bool {
        self.stage == Stage::Damping && now.saturating_sub(self.damped) >= DAMPING
    }

    /// Takes a message that came at `now`. A bad one is a reason for damping; while idle it only keeps the robot from being
    /// armed.
    pub fn read(&mut self, now: Duration, reading: &Reading) {
        let taken = self.watch.take(now, reading);
        if self.stage == Stage::Idle {
            self.refused = taken.err();
            return;
        }
        self.flown.heard.push(Heard { came: now, state: reading.state, seal: reading.seal });
        if let Err(reason) = taken {
            self.stop(now, reason);
        }
    }

    /// A part of the robot's state no longer comes, `what` in words: a reason for damping; while idle it keeps the robot from
    /// being armed until a state comes.
    pub fn lacks(&mut self, now: Duration, what: String) {
        match self.stage {
            Stage::Idle if self.watch.fresh(now).is_ok() => {}
            Stage::Idle => self.refused = Some(Reason::Lacks(what)),
            _ => self.stop(now, Reason::Lacks(what)),
        }
    }

    /// Returns the reason why an idle robot may not be armed.
    pub fn refused(&self) -> Option<&Reason> {
        self.flown.reason.as_ref().or(self.refused.as_ref())
    }

    /// Goes to damping, for `reason`. The first reason stays. While idle the reason keeps the robot from being armed.
    pub fn stop(&mut self, now: Duration, reason: Reason) {
        match self.stage {
            Stage::Damping => {}
            // A good message does not take it back, as it takes back what was wrong with a message.
            Stage::Idle => self.flown.reason = Some(self.flown.reason.take().unwrap_or(reason)),
            _ => {
                self.flown.reason = Some(reason);
                (self.stage, self.damped) = (Stage::Damping, now);
            }
        }
    }

    /// Starts the motion of an idle robot.
    ///
    /// # Errors
    /// A rule that the robot's state fails.
    pub fn arm(&mut self, now: Duration) -> Result<(), RobotError> {
        if let Some(reason) = self.refused() {
            return Err(RobotError::NotArmed(reason.clone()));
        }
        let state = self.watch.fresh(now).map_err(RobotError::NotArmed)?;
        if self.stage == Stage::Idle {
            // If a joint reads a little beyond its range, its target is the end of the range.
            let limits = self.robot.limits();
            let from = PerMotor::from_fn(state.q.len(), |motor| {
                state.q[motor].clamp(limits.lower[motor], limits.upper[motor])
            });
            self.flown.plan = Some(Plan::new(&self.robot, from));
            (self.stage, self.begun, self.ticked) = (Stage::Soften, now, None);
        }
        Ok(())
    }

    /// Returns the command for `now`: nothing while idle, else one inside the limits. Call it at a steady rate.
    pub fn tick(&mut self, now: Duration) -> Option<Command> {
        if self.stage == Stage::Idle {
            return None;
        }
        let before = self.ticked.replace(now);
        // While nothing is sent, motors keep to the last command.
        if let Some(gap) = before.map(|before| now.saturating_sub(before))
            && gap > self.watch.settings().late
        {
            self.stop(now, Reason::LateLoop(1e3 * gap.as_secs_f64()));
        }
        if self.stage != Stage::Damping
            && let Err(reason) = self.watch.fresh(now)
        {
            self.stop(now, reason);
        }
        let wanted = self.wanted(now);
        let limits = self.watch.settings().limits;
        let command = match self.watch.state() {
            // Damping leaves some torque unused, for a joint that is faster by now than in the last state.
            Some(state) if self.stage == Stage::Damping => {
                limits.for_damping().admit(&wanted, state).unwrap_or(wanted)
            }
            // A target that is no number becomes damping.
            Some(state) => limits.admit(&wanted, state).unwrap_or_else(|| damping(&self.damping)),
            None => damping(&self.damping),
        };
        // Damping is bounded on purpose, so its changes are no finding.
        if self.stage != Stage::Damping {
            self.flown.changed += u64::from(command != wanted);
        }
        self.flown.sent.push(Sent { at: now, stage: self.stage, command });
        Some(command)
    }

    /// The command of the stage, before the guard.
    fn wanted(&mut self, now: Duration) -> Command {
        let Some(plan) = &self.flown.plan else { return damping(&self.damping) };
        if self.stage == Stage::Damping {
            return damping(&self.damping);
        }
        let (stage, time) = plan.stage(now.saturating_sub(self.begun));
        // The plan is over: this end is orderly and has no reason.
        if stage == Stage::Damping {
            (self.stage, self.damped) = (stage, now);
            return damping(&self.damping);
        }
        self.stage = stage;
        let wanted = plan.command(stage, time);
        // A joint far from its target may have met something; more target would only press harder.
        if let Some(reason) = self.astray(stage, &wanted) {
            self.stop(now, reason);
            return damping(&self.damping);
        }
        wanted
    }

    /// The reason to stop if a joint is too far from its target.
    fn astray(&self, stage: Stage, wanted: &Command) -> Option<Reason> {
        let (plan, state) = (self.flown.plan.as_ref()?, self.watch.state()?);
        let far = if stage == Stage::Soften { ASTRAY[0] } else { ASTRAY[1] };
        let off = |motor: usize| (state.q[motor] - wanted[motor].q).abs();
        let worst = plan.order().iter().copied().max_by(|a, b| off(*a).total_cmp(&off(*b)))?;
        (off(worst) > far).then(|| Reason::Astray {
            joint: self.robot.motors[worst].joint.clone(),
            angle: state.q[worst] - wanted[worst].q,
        })
    }
}
