//! A task on a robot as the kernels see it: sizes, and where the physics keeps each number.

use gaitfit_learn::collect::sensed_width;
use gaitfit_learn::task::{Task, TaskError, reward};
use gaitfit_physics::Kept;
use gaitfit_physics::trace::{Report, Traced};
use gaitfit_sim::{Candidate, modifications};

use super::RolloutError;
use super::sums::Sum;
use crate::emit::{Class, EmitOptions};
use crate::physics::{Period, PeriodOptions};
use crate::spots::{Spot, Spots};

/// Purpose of rollouts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mode {
    /// A training learns from them.
    Training,
    /// A policy is tried: robots keep their commands, episodes do not end by time, and the errors of every step are kept.
    Trials,
    /// A policy's walks are recorded: episodes do not end by time, and what sensors say before every step is kept.
    Logs,
    /// Steps one by one, under actions from outside.
    Steps,
}

/// Sizes of a rollout.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Sizes {
    /// Control steps.
    pub steps: usize,
    /// Environments.
    pub environments: usize,
    /// Parameters of both networks, which lie before ln σ.
    pub networks: usize,
    /// Discount of PPO.
    pub gamma: f64,
    /// Numbers that the critic remembers of an environment.
    pub remembered: usize,
    /// Purpose of the rollouts.
    pub mode: Mode,
}

/// More steps than any trajectory has.
const NEVER: u32 = 1 << 30;

/// A task on a robot as the kernels see it.
pub struct Scene<'a> {
    /// The task.
    pub task: &'a Task,
    /// The physics of a control period.
    pub period: &'a Period,
    /// Sizes.
    pub sizes: Sizes,
    pub(super) spots: Spots,
    /// Places of that part of the remembered numbers that the CPU has too: threads compute limbs alike, also where one alone has networks.
    pub(super) remembered: Vec<Spot>,
}

/// Refuses what a GPU does not train, without one.
///
/// # Errors
/// [`RolloutError::Unsupported`].
pub fn check(task: &Task, candidates: &[Candidate]) -> Result<(), RolloutError> {
    check_robots(candidates)?;
    check_rewards(task)
}

fn check_robots(candidates: &[Candidate]) -> Result<(), RolloutError> {
    let unsupported = |what: &str| Err(RolloutError::Unsupported(what.to_owned()));
    let networks = candidates.first().map_or(&[][..], |candidate| &candidate.networks);
    if candidates.iter().any(|candidate| candidate.networks != networks) {
        return unsupported("robots whose networks differ");
    }
    Ok(())
}

fn check_rewards(task: &Task) -> Result<(), RolloutError> {
    let function = task.reward_values().find(|(_, value)| matches!(value, reward::Value::Own(_)));
    let Some((function, _)) = function else { return Ok(()) };
    let what = format!("the reward term `{function}`, a function; write it as an expression in task.terms");
    Err(RolloutError::Unsupported(what))
}

impl<'a> Scene<'a> {
    /// The physics that a task's rollouts need. `processors`: the GPU's multiprocessors.
    ///
    /// # Errors
    /// A robot that cannot be stepped; candidates with different networks.
    pub fn period(
        task: &Task,
        candidates: &[Candidate],
        environments: usize,
        processors: usize,
    ) -> Result<Period, RolloutError> {
        check_robots(candidates)?;
        let networks = candidates.first().map_or(&[][..], |candidate| &candidate.networks);
        let batch = &task.walker.batch;
        let options = PeriodOptions {
            substeps: batch.options().substeps,
            taps: batch.taps(),
            lanes: 4,
            emit: EmitOptions::default(),
        };
        let disturbed = candidates.iter().any(|candidate| candidate.torque_noise > 0.0);
        let (model, settings) = (task.walker.model(), batch.settings());
        // Randomisation does not change what may be kept.
        let kept = candidates.iter().map(|candidate| Kept::from_robot(&candidate.robot)).reduce(Kept::both);
        let fixed = match (candidates.first(), kept) {
            (Some(first), Some(kept)) => {
                kept.numbers(&task.walker.robot(first).params(model).map_err(TaskError::from)?)
            }
            _ => Vec::new(),
        };
        let report = Report { disturbed, forces: true, tracked: batch.tracked().to_vec(), fixed };
        let parts = kept.map(|kept| kept.parts).unwrap_or_default();
        if parts.late_imu {
            let robots = candidates.iter().map(|candidate| task.walker.robot(candidate).params(model));
            let robots = robots.collect::<Result<Vec<_>, _>>().map_err(TaskError::from)?;
            batch.check_imu_delay(&robots).map_err(TaskError::from)?;
        }
        let networks = modifications::<Traced>(model, networks, parts).map_err(TaskError::from)?;
        let period =
            Period::for_environments(model, settings, options, &networks, &report, environments, processors)?;
        Ok(period)
    }

    /// A task on the physics of [`Scene::period`].
    ///
    /// # Errors
    /// [`RolloutError::Unsupported`] for reward terms that are functions of a library's user.
    pub fn new(task: &'a Task, period: &'a Period, sizes: Sizes) -> Result<Self, RolloutError> {
        check_robots(&[])?;
        check_rewards(task)?;
        let spots = Spots::new(period);
        let asked_slots = spots.memory.iter().zip(&period.memory).filter(|(_, asked)| **asked);
        let remembered = asked_slots.map(|(&spot, _)| spot).collect();
        Ok(Self { task, period, sizes, spots, remembered })
    }

    /// Numbers of a class in a tile.
    pub(super) fn size(&self, class: Class) -> usize {
        self.period.layout().size(class)
    }

    /// Max number of episodes of an environment that a rollout cuts off.
    pub(super) fn cuts(&self) -> usize {
        if self.is(Mode::Steps) {
            return 0;
        }
        // Episodes also end at the edge of generated ground.
        let left = usize::from(self.task.course.is_some());
        // So many episodes of full length can end by time within a rollout.
        self.sizes.steps.div_ceil(self.episode_steps() as usize) + left
    }

    /// Bytes from one list of ends to the next: libraries want arrays to begin at multiples of 256 bytes.
    pub fn ends_apart(&self) -> usize {
        self.sizes.environments.next_multiple_of(256)
    }

    /// Whether the steps are for this.
    pub(super) fn is(&self, mode: Mode) -> bool {
        self.sizes.mode == mode
    }

    /// Steps of an episode at most.
    pub(super) fn episode_steps(&self) -> u32 {
        if self.is(Mode::Training) || self.is(Mode::Steps) { self.task.episode_steps() } else { NEVER }
    }

    /// Steps after which a command is drawn anew.
    pub(super) fn command_steps(&self) -> u32 {
        if self.is(Mode::Trials) { NEVER } else { self.task.command_steps() }
    }

    /// Numbers of an action.
    pub(super) fn actions(&self) -> usize {
        self.task.walker.joints.len()
    }

    /// Whether actor or critic observe a motion that the policy follows.
    pub(super) fn follows(&self) -> bool {
        let walker = &self.task.walker;
        walker.observation.follows() || walker.critic_observation.follows()
    }

    /// Numbers that are recorded of a robot before a step.
    pub(super) fn recorded(&self) -> usize {
        if self.is(Mode::Logs) { sensed_width(self.actions()) } else { 0 }
    }

    /// Sums that a rollout keeps of each environment; `TALLIES` of the text.
    pub(super) fn tallies(&self) -> usize {
        Sum::count(self.task.reward_weights().count())
    }
}
