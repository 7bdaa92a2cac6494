//! A policy at work in many environments on a GPU: its mean actions, no learning.

use gaitfit_learn::evaluate::Subject;
use gaitfit_learn::ppo::{self, Settings, Widths};
use gaitfit_learn::task::{Environment, Snapshot};
use gaitfit_learn::{Training, TrainingError, widths};
use gaitfit_sim::Candidate;

use super::run::{Planned, Rollout};
use super::scene::{Mode, Sizes};
use super::{RolloutError, check};
use crate::networks::{Actor, ActorPlan};
use crate::ppo::{Batch, Learner, Limits, Precision, Share};
use crate::runtime::{CudaError, Device, Graph};

/// Environments at once: the kernels of few are hardly faster, and many take memory.
const ENVIRONMENTS: (usize, usize) = (64, 16_384);
/// Max number of steps of one graph, after which what they did is read.
const STEPS: u32 = 25;

/// How much a policy plays.
#[derive(Clone, Copy, Debug)]
pub(super) struct Extent {
    /// Robots.
    pub count: usize,
    /// Steps of each.
    pub last: u32,
    /// Commands are [held](Play::hold) before steps whose number is 1 more than a multiple of this; 0 if they never are.
    pub command_period: u32,
}

impl Extent {
    /// Robots that keep their commands.
    pub fn new(count: usize, last: u32) -> Self {
        Self { count, last, command_period: 0 }
    }
}

/// A policy and the environments it moves, as [`gaitfit_learn`]'s player does: the same robots, commands, starts, noise
/// and pushes, and motions that differ by rounding. A robot that ended begins anew here, which nobody looks at.
pub(super) struct Play<'a> {
    graph: Graph,
    rollout: Rollout<'a>,
    /// Holds the samples.
    learner: Learner,
    actor: Actor,
    subject: Subject<'a>,
    candidates: Vec<Candidate>,
    /// Environments at once.
    pub environments: usize,
    /// Steps at once.
    pub steps: usize,
    first: u32,
}

/// Record of some steps of the policy, each array `steps × environments × width`.
pub(super) struct Played {
    /// Actions, a row an environment.
    pub action: Vec<f32>,
    /// Rewards; not a number of a robot that diverged in [`Mode::Trials`].
    pub reward: Vec<f32>,
    /// Whether each episode ended: by a fall, or at the edge of generated ground.
    pub done: Vec<f32>,
}

impl<'a> Play<'a> {
    /// For robots and steps of this extent.
    ///
    /// # Errors
    /// [`RolloutError::Trials`] for what only the CPU simulates; a robot that cannot be; a failure of the GPU.
    pub fn new(
        device: &Device,
        subject: &Subject<'a>,
        mode: Mode,
        extent: Extent,
    ) -> Result<Self, RolloutError> {
        let Subject { task, policy, candidate, seed, .. } = *subject;
        let refused = |error: &dyn std::fmt::Display| RolloutError::Trials(error.to_string());
        let wanted = (task.walker.observation.width(), task.walker.joints.len());
        let found = (policy.interface.observation_width(), policy.interface.joints.len());
        if wanted != found {
            return Err(refused(&format!(
                "a policy with {} observations and {} actions, where the task has {} and {},",
                found.0, found.1, wanted.0, wanted.1
            )));
        }
        // Rollouts keep their samples in a learner's arrays. Its networks act nowhere, and the critic sees at least one number.
        let settings =
            Settings { actor_hidden: vec![32], critic_hidden: vec![32], memory: None, ..Settings::default() };
        let widths = widths(task);
        let widths = Widths { critic_observation: widths.critic_observation.max(1), ..widths };
        let host = ppo::Learner::new(settings, widths, seed).map_err(TrainingError::from)?;
        let candidates = vec![candidate.cloned().unwrap_or_else(|| Candidate::nominal(task.walker.model()))];
        let unsupported = |error: RolloutError| match error {
            RolloutError::Unsupported(what) => refused(&what),
            error => error,
        };
        check(task, &candidates).map_err(unsupported)?;
        let Extent { count, last, command_period } = extent;
        let environments = count.clamp(ENVIRONMENTS.0, ENVIRONMENTS.1);
        // Commands change between graphs alone, so a graph must end where the next command begins.
        let fits = |steps: &u32| command_period.is_multiple_of(*steps);
        let steps = (1..=STEPS.min(last)).rev().find(fits).unwrap_or(1) as usize;
        let batch = Batch { steps, environments, tile: Training::TILE, share: Share::WHOLE };
        let networks = host.actor().parameters.len() + host.critic().parameters.len();
        let sizes = Sizes { steps, environments, networks, gamma: 1.0, remembered: 0, mode };
        let actor_plan = ActorPlan::new(policy, environments, steps, Limits::from_device(device));
        let actor_plan = actor_plan.map_err(|error| refused(&error))?;
        let planned = Planned::new(device, task, &candidates, sizes)?;
        let programs = planned.programs().into_iter().chain([actor_plan.program.clone()]);
        let _ahead = device.compile_ahead(programs);
        let mut learner = Learner::new(device, &host, batch, Precision::F32)?;
        learner.quiet()?;
        let (stream, planned) = (learner.stream(), (planned, sizes));
        let rollout = Rollout::from_plan(device, stream, task, &candidates, planned, (seed, 0))?;
        let actor = Actor::new(device, learner.stream(), actor_plan)?;
        let array = |name: &str| {
            let reason = || format!("the learner has no array `{name}`");
            learner
                .argument(name)
                .ok_or_else(|| CudaError::Launch { kernel: "decide".into(), reason: reason() })
        };
        let (observation, mean) = (array("observation")?, array("mean")?);
        let graph = learner.stream().record(|stream| {
            rollout.start_with(stream, &learner, &|step| actor.decide(stream, step, observation, mean))
        })?;
        Ok(Self {
            graph,
            rollout,
            learner,
            actor,
            subject: *subject,
            candidates,
            environments,
            steps,
            first: 0,
        })
    }

    /// Takes up `environment`, whose first environment is number `first`.
    ///
    /// # Errors
    /// A randomisation that leaves no robot, or a failure of the GPU.
    pub fn begin(&mut self, environment: &mut Environment<'_>, first: u32) -> Result<(), RolloutError> {
        // `Play::new` has made the robots from number 0 on.
        if self.first != first {
            self.first = first;
            self.rollout.randomise(self.learner.stream(), &self.candidates, self.subject.seed, first)?;
        }
        let snapshots: Vec<Snapshot> =
            (0..environment.count()).map(|index| environment.snapshot(index)).collect();
        self.rollout.load(self.learner.stream(), &snapshots)?;
        Ok(self.actor.forget(self.learner.stream())?)
    }

    /// Gives all robots this command.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn hold(&mut self, command: [f32; 3]) -> Result<(), RolloutError> {
        let columns: Vec<f32> =
            command.iter().flat_map(|&number| std::iter::repeat_n(number, self.environments)).collect();
        Ok(self.rollout.write(self.learner.stream(), "command", &columns)?)
    }

    /// The next steps, the first of which is number `from`.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn advance(&mut self, from: u32) -> Result<Played, RolloutError> {
        let ranges = self.subject.task.settings.command.ranges(1.0);
        self.rollout.number(self.learner.stream(), from, self.subject.seed, ranges, self.first)?;
        self.graph.launch(self.learner.stream())?;
        let [action, reward, done] = ["action", "reward", "done"].map(|name| self.learner.read_f32(name));
        Ok(Played { action: action?, reward: reward?, done: done? })
    }

    /// Errors of velocity and yaw rate in these steps, of [`Mode::Trials`]; `steps × environments × 2`.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn errors(&self) -> Result<Vec<f32>, RolloutError> {
        Ok(self.rollout.errors(self.learner.stream())?)
    }

    /// Distance of each robot's joints from the motion that the policy follows, rad, of [`Mode::Trials`];
    /// `steps × environments`, or empty if the policy follows none.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn motion_errors(&self) -> Result<Vec<f32>, RolloutError> {
        Ok(self.rollout.motion_errors(self.learner.stream())?)
    }

    /// Position (m) and orientation (wxyz) of each base after each of these steps, of [`Mode::Trials`]; `steps × environments × 7`.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn bases(&self) -> Result<Vec<f32>, RolloutError> {
        Ok(self.rollout.bases(self.learner.stream())?)
    }

    /// Records of [`Mode::Logs`] before these steps; `steps × environments ×`
    /// [`gaitfit_learn::collect::sensed_width`].
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn records(&self) -> Result<Vec<f32>, RolloutError> {
        Ok(self.rollout.records(self.learner.stream())?)
    }
}
