//! The states of a run, from idle to lying down, with the guard before every command. Pure: times are given.

use std::time::Duration;

use crate::RobotError;
use crate::command::{Command, MotorCommand, damping};
use crate::guard::{GuardSettings, Reason, Watch};
use crate::per_motor::PerMotor;
use crate::state::{Reading, RobotState};

/// Phase of a run.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Phase {
    /// Nothing is sent.
    Idle,
    /// Moves to the lying posture, then stands up.
    StandUp,
    /// Stands with the policy's gains.
    Stand,
    /// Under the policy.
    Walk,
    /// Under the policy with the command 0: the robot comes to rest before it lies down.
    Stop,
    /// Down to the lying posture.
    LieDown,
    /// The motors resist motion and hold nothing. It is never left.
    Damping,
}

impl Phase {
    /// Its name in files and messages.
    pub fn name(self) -> &'static str {
        match self {
            Self::Idle => "idle",
            Self::StandUp => "stand up",
            Self::Stand => "stand",
            Self::Walk => "walk",
            Self::Stop => "stop",
            Self::LieDown => "lie down",
            Self::Damping => "damping",
        }
    }
}

/// Postures and gains of a run, motor order.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Postures {
    /// Lying, legs folded, rad.
    pub lying: PerMotor<f32>,
    /// Standing: the policy's pose at action zero, rad.
    pub standing: PerMotor<f32>,
    /// Position gains of standing up and lying down, N·m/rad.
    pub stand_kp: PerMotor<f32>,
    /// Velocity gains of standing up and lying down, N·m·s/rad.
    pub stand_kd: PerMotor<f32>,
    /// The policy's position gains, N·m/rad.
    pub kp: PerMotor<f32>,
    /// The policy's velocity gains, N·m·s/rad.
    pub kd: PerMotor<f32>,
    /// Velocity gains of damping, N·m·s/rad.
    pub damping: PerMotor<f32>,
    /// Whether the policy's targets are velocities, as for wheels that roll. These wheels stand still in all phases except the
    /// walk and the stop after it.
    pub rolls: PerMotor<bool>,
}

/// How long each state lasts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Times {
    /// To the lying posture, wherever the legs are: only from there is the way up known.
    pub fold: Duration,
    /// Time from lying to standing.
    pub rise: Duration,
    /// Time of the change from the gains of standing up to the policy's, while standing.
    pub settle: Duration,
    /// From wherever a stride left the legs to standing, before they fold: a robot with two feet in the air tips over.
    pub gather: Duration,
    /// Time from standing to lying.
    pub lie_down: Duration,
    /// Damping before the last command.
    pub damping: Duration,
}

impl Default for Times {
    fn default() -> Self {
        let seconds = Duration::from_secs_f32;
        Self {
            fold: seconds(1.5),
            rise: seconds(1.5),
            settle: seconds(0.5),
            gather: seconds(0.25),
            lie_down: seconds(2.0),
            damping: seconds(2.0),
        }
    }
}

/// The states of a run and the guard before every command.
#[derive(Clone, Debug)]
pub struct Supervisor {
    watch: Watch,
    postures: Postures,
    times: Times,
    phase: Phase,
    /// Time at which the phase began.
    since: Duration,
    /// Joint angles from which the phase's motion begins, rad.
    from: PerMotor<f32>,
    /// How long the legs take to standing before they fold.
    gather: Duration,
    /// Time of the last call of [`Supervisor::tick`].
    ticked: Option<Duration>,
    /// The policy's last targets (rad, or rad/s for wheels that roll), and when they came.
    targets: Option<(Duration, PerMotor<f32>)>,
    /// The last command.
    sent: Command,
    /// Whether the guard changed what was wanted.
    changed: bool,
    reason: Option<Reason>,
    /// While idle: what is wrong with the last reading; it may be mended.
    refused: Option<Reason>,
}

impl Supervisor {
    /// Idle.
    pub fn new(guard: GuardSettings, postures: Postures, times: Times) -> Self {
        Self {
            watch: Watch::new(guard),
            postures,
            times,
            phase: Phase::Idle,
            since: Duration::ZERO,
            from: postures.lying,
            gather: Duration::ZERO,
            ticked: None,
            targets: None,
            sent: damping(&postures.damping),
            changed: false,
            reason: None,
            refused: None,
        }
    }

    /// Returns the current phase.
    pub fn phase(&self) -> Phase {
        self.phase
    }

    /// Returns the reason for damping; `None` after an orderly end, and in other phases.
    pub fn reason(&self) -> Option<&Reason> {
        self.reason.as_ref()
    }

    /// While idle: what is wrong with the last reading.
    pub fn refused(&self) -> Option<&Reason> {
        self.refused.as_ref().filter(|_| self.phase == Phase::Idle)
    }

    /// Whether the guard changed what was wanted last.
    pub fn changed(&self) -> bool {
        self.changed
    }

    /// The last good state.
    pub fn state(&self) -> Option<&RobotState> {
        self.watch.state()
    }

    /// When the last good state came.
    pub fn came(&self) -> Option<Duration> {
        self.watch.came()
    }

    /// Whether the run is over: it was in damping long enough.
    pub fn is_over(&self, now: Duration) -> bool {
        self.phase == Phase::Damping && now.saturating_sub(self.since) >= self.times.damping
    }

    /// Takes a message of the robot that came at `now`. A bad one is a reason for damping; while idle it only keeps the
    /// robot from being armed.
    pub fn read(&mut self, now: Duration, reading: &Reading) {
        let taken = self.watch.take(now, reading);
        if self.phase == Phase::Idle {
            self.refused = taken.err();
        } else if let Err(reason) = taken {
            self.stop(now, reason);
        }
    }

    /// A part of the robot's state no longer comes, `what` in words: a reason for damping; while idle it keeps the robot from
    /// being armed until a state comes.
    pub fn lacks(&mut self, now: Duration, what: String) {
        match self.phase {
            Phase::Idle if self.watch.fresh(now).is_ok() => {}
            Phase::Idle => self.refused = Some(Reason::Lacks(what)),
            _ => self.stop(now, Reason::Lacks(what)),
        }
    }

    /// Another program's command was seen.
    pub fn second_controller(&mut self, now: Duration) {
        self.stop(now, Reason::SecondController);
    }

    /// Goes to damping, for `reason`. The first reason stays. While idle it keeps the robot from being armed.
    pub fn stop(&mut self, now: Duration, reason: Reason) {
        match self.phase {
            Phase::Damping => {}
            Phase::Idle => {
                // Unlike the reason in a bad message, this one stays when good messages follow.
                self.reason.get_or_insert(reason);
            }
            _ => {
                self.reason = Some(reason);
                (self.phase, self.since) = (Phase::Damping, now);
            }
        }
    }

    /// Begins to stand up, from idle.
    ///
    /// # Errors
    /// A rule that the robot's state fails, or that it is not idle.
    pub fn arm(&mut self, now: Duration) -> Result<(), RobotError> {
        if let Some(reason) = self.reason.as_ref().or(self.refused.as_ref()) {
            return Err(RobotError::NotArmed(reason.clone()));
        }
        let state = self.watch.fresh(now).map_err(RobotError::NotArmed)?;
        if self.phase == Phase::Idle {
            self.from = state.q;
            (self.phase, self.since, self.ticked) = (Phase::StandUp, now, None);
        }
        Ok(())
    }

    /// Whether it stands and waits for the policy's first targets.
    pub fn awaits_policy(&self, now: Duration) -> bool {
        self.phase == Phase::Stand && now.saturating_sub(self.since) >= self.times.settle
    }

    /// The policy's targets of time `now`, motor order: rad, or rad/s for wheels that roll. A target that is not finite is a
    /// reason for damping.
    pub fn aim(&mut self, now: Duration, targets: PerMotor<f32>) {
        if targets.iter().all(|target| target.is_finite()) {
            self.targets = Some((now, targets));
        } else {
            self.stop(now, Reason::PolicyNotFinite);
        }
    }

    /// The commands are over: the policy's targets are from now on those of the command 0.
    pub fn slow_down(&mut self, now: Duration) {
        if self.phase == Phase::Walk {
            (self.phase, self.since) = (Phase::Stop, now);
        }
    }

    /// Lies down, from wherever the robot is, as the walk is over.
    pub fn lie_down(&mut self, now: Duration) {
        if !matches!(self.phase, Phase::StandUp | Phase::Stand | Phase::Walk | Phase::Stop) {
            return;
        }
        if let Some(state) = self.watch.state() {
            // Where the gains change, the torque stays: kp₁ (q₁ − q) = kp₀ (q₀ − q).
            let kp = &self.postures.stand_kp;
            self.from = PerMotor::from_fn(kp.len(), |motor| {
                let (sent, q) = (&self.sent[motor], state.q[motor]);
                // A wheel has no position gain.
                if kp[motor] > 0.0 { q + sent.kp * (sent.q - q) / kp[motor] } else { q }
            });
            // Legs that are not up yet fold at once.
            self.gather = if self.phase == Phase::StandUp { Duration::ZERO } else { self.times.gather };
            (self.phase, self.since) = (Phase::LieDown, now);
        }
    }

    /// Returns the command for `now`: nothing while idle, else one inside the limits. To be called at a steady rate.
    pub fn tick(&mut self, now: Duration) -> Option<Command> {
        if self.phase == Phase::Idle {
            return None;
        }
        let before = self.ticked.replace(now);
        // In such a gap the motors kept to the last command, and nothing watched the robot.
        if let Some(gap) = before.map(|before| now.saturating_sub(before))
            && gap > self.watch.settings().late
        {
            self.stop(now, Reason::LateLoop(1e3 * gap.as_secs_f64()));
        }
        // Damping continues without states.
        if self.phase != Phase::Damping
            && let Err(reason) = self.watch.fresh(now)
        {
            self.stop(now, reason);
        }
        // After the stops above: a phase that is over must not begin the next one on a stale state.
        self.advance(now);
        let wanted = self.wanted(now);
        self.sent = match (self.watch.state(), self.phase) {
            (Some(state), Phase::Damping) => self.damped(state),
            (Some(state), _) => match self.watch.settings().limits.admit(&wanted, state) {
                Some(command) => command,
                None => {
                    self.stop(now, Reason::PolicyNotFinite);
                    damping(&self.postures.damping)
                }
            },
            (None, _) => damping(&self.postures.damping),
        };
        self.changed = self.sent != wanted;
        Some(self.sent)
    }

    /// Damping of a robot that was last known to be in `state`. The state may be old, so the torque has room.
    fn damped(&self, state: &RobotState) -> Command {
        let limits = self.watch.settings().limits.for_damping();
        let wanted = damping(&self.postures.damping);
        limits.admit(&wanted, state).unwrap_or(wanted)
    }

    /// Goes to the next phase if this one is over.
    fn advance(&mut self, now: Duration) {
        let elapsed = now.saturating_sub(self.since);
        match self.phase {
            Phase::StandUp if elapsed >= self.times.fold + self.times.rise => {
                (self.phase, self.since) = (Phase::Stand, now);
            }
            Phase::Stand if elapsed >= self.times.settle => {
                // Old targets were made for a state that the robot has left.
                let fresh = |(came, _)| now.saturating_sub(came) <= self.watch.settings().late_policy;
                if self.targets.is_some_and(fresh) {
                    (self.phase, self.since) = (Phase::Walk, now);
                }
            }
            Phase::Walk | Phase::Stop => {
                // A policy that stopped acting would leave the robot with one target while it falls.
                let age = self.targets.map_or(elapsed, |(came, _)| now.saturating_sub(came));
                if age > self.watch.settings().late_policy {
                    self.stop(now, Reason::LatePolicy(1e3 * age.as_secs_f64()));
                }
            }
            Phase::LieDown if elapsed >= self.gather + self.times.lie_down => {
                (self.phase, self.since) = (Phase::Damping, now);
            }
            _ => {}
        }
    }

    /// The command of the phase, before the guard.
    fn wanted(&self, now: Duration) -> Command {
        let Postures { lying, standing, stand_kp, stand_kd, .. } = &self.postures;
        let elapsed = now.saturating_sub(self.since);
        let part =
            // A phase of length 0 is at its end at once.
            |length: Duration| (elapsed.as_secs_f32() / length.as_secs_f32().max(1e-6)).clamp(0.0, 1.0);
        let between = |from: &PerMotor<f32>, to: &PerMotor<f32>, part: f32| {
            PerMotor::from_fn(from.len(), |motor| MotorCommand {
                q: from[motor] + part * (to[motor] - from[motor]),
                kp: stand_kp[motor],
                kd: stand_kd[motor],
                ..MotorCommand::default()
            })
        };
        match self.phase {
            Phase::StandUp if elapsed < self.times.fold => between(&self.from, lying, part(self.times.fold)),
            Phase::StandUp => {
                let risen =
                    (elapsed - self.times.fold).as_secs_f32() / self.times.rise.as_secs_f32().max(1e-6);
                between(lying, standing, risen.clamp(0.0, 1.0))
            }
            Phase::Stand => self.policy(standing, part(self.times.settle)),
            Phase::Walk | Phase::Stop => {
                // Without targets `advance` enters no walk.
                self.policy(self.targets.as_ref().map_or(standing, |(_, targets)| targets), 1.0)
            }
            Phase::LieDown if elapsed < self.gather => between(&self.from, standing, part(self.gather)),
            Phase::LieDown => {
                // The posture in which the phase before ended, so that targets do not jump.
                let from = if self.gather.is_zero() { &self.from } else { standing };
                let folded =
                    (elapsed - self.gather).as_secs_f32() / self.times.lie_down.as_secs_f32().max(1e-6);
                between(from, lying, folded.clamp(0.0, 1.0))
            }
            Phase::Idle | Phase::Damping => damping(&self.postures.damping),
        }
    }

    /// Targets with gains that are, by `part`, the policy's.
    fn policy(&self, targets: &PerMotor<f32>, part: f32) -> Command {
        let Postures { stand_kp, stand_kd, kp, kd, rolls, .. } = &self.postures;
        PerMotor::from_fn(targets.len(), |motor| {
            // A wheel's kp is 0, so its angle target has no effect.
            let (q, dq) = if rolls[motor] { (0.0, targets[motor]) } else { (targets[motor], 0.0) };
            MotorCommand {
                q,
                dq,
                kp: stand_kp[motor] + part * (kp[motor] - stand_kp[motor]),
                kd: stand_kd[motor] + part * (kd[motor] - stand_kd[motor]),
                ..MotorCommand::default()
            }
        })
    }
}
