//! Environments on a GPU, one control period at a time, under actions from outside.

use std::sync::Arc;

use gaitfit_learn::task::{Environment, Snapshot, Task, TaskError};
use gaitfit_sim::Candidate;

use super::RolloutError;
use super::plan::BASE_NUMBERS;
use super::run::Rollout;
use super::scene::{Mode, Sizes};
use super::shared::Shared;
use super::sums::Sum;
use crate::ppo::{NO_EXPLORATION, Storage};
use crate::runtime::{Argument, CudaError, Device, Event, Graph, Stream};

/// Value of `refused` if no action was refused.
const NONE: u32 = u32::MAX;

/// Arrays that steps write; each is at the same place after every step. N: environments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Shown {
    /// Observations of the actor, with noise; N × observation.
    Observation,
    /// Observations of the critic; N × critic's observation.
    CriticObservation,
    /// Observations of the actor at the end of each environment's last episode; N × observation.
    LastObservation,
    /// Reward of the step; N.
    Reward,
    /// Whether the robot fell; N bytes.
    Terminated,
    /// Whether time was up; N bytes.
    Truncated,
    /// Whether an episode ended in any way; N bytes.
    Ended,
    /// Commands: forward and left, m/s, and yaw rate, rad/s; N × 3.
    Commands,
    /// How robots move, as [`Stepper::observe_motion`] wrote it.
    Motion(Moved),
}

/// Parts of how robots move, in the order in which they are written. N: environments.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Moved {
    /// Position of the base, m, world frame; N × 3.
    BasePosition,
    /// Its orientation, wxyz; N × 4.
    BaseQuaternion,
    /// Its velocity, m/s, world frame; N × 3.
    BaseLinear,
    /// Its angular velocity, rad/s, body frame; N × 3.
    BaseAngular,
    /// Positions of the policy's joints as encoders report them, rad; N × joints.
    JointPosition,
    /// Their velocities, rad/s; N × joints.
    JointVelocity,
    /// Torques on them in the last physics step, N·m; N × joints.
    Torque,
}

impl Moved {
    /// The first number and the width of a row of this part, of robots with so many actions.
    fn place(self, actions: usize) -> (usize, usize) {
        let base = BASE_NUMBERS;
        match self {
            Self::BasePosition => (0, 3),
            Self::BaseQuaternion => (3, 4),
            Self::BaseLinear => (7, 3),
            Self::BaseAngular => (10, 3),
            Self::JointPosition => (base, actions),
            Self::JointVelocity => (base + actions, actions),
            Self::Torque => (base + 2 * actions, actions),
        }
    }
}

/// Episodes that one step ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stepped {
    /// Episodes that ended.
    pub ended: usize,
    /// Of these, episodes whose simulation diverged.
    pub diverged: usize,
}

/// Gives an environment the rows of the control period before, whose frames move up at the next observation. The kernels
/// have the present rows already, in which they moved.
pub fn before_rows(task: &Task, one: &mut Snapshot) {
    let layouts = [&task.walker.observation, &task.walker.critic_observation];
    for (row, layout) in one.past.iter_mut().zip(layouts).filter(|(row, _)| !row.is_empty()) {
        *row = layout.before(row);
    }
}

/// Environments of a task on a GPU that are stepped under actions from outside. Robots, commands, starts, noise and pushes
/// are those of the CPU's [`Environment`] of the same seed, with the same numbers of steps: the first step is number 0.
pub struct Stepper<'a> {
    device: Device,
    rollout: Rollout<'a>,
    environments: usize,
    terms: usize,
    /// Sum of each reward term over all environments since [`Stepper::take_terms`].
    summed: Vec<f64>,
    stream: Stream,
    graph: Option<Graph>,
    ready: Arc<Event>,
}

impl<'a> Stepper<'a> {
    /// Environments around `candidates` in turn, in their first episodes. `stagger` spreads these episodes' ages evenly.
    ///
    /// # Errors
    /// [`RolloutError::Steps`] for what only the CPU steps; a robot that cannot be; a GPU without room or compiler.
    pub fn new(
        device: &Device,
        task: &'a Task,
        candidates: &[Candidate],
        environments: usize,
        seed: u64,
        stagger: bool,
    ) -> Result<Self, RolloutError> {
        let unsupported = |error: RolloutError| match error {
            RolloutError::Unsupported(what) => RolloutError::Steps(what),
            error => error,
        };
        let sizes =
            Sizes { steps: 1, environments, networks: 0, gamma: 1.0, remembered: 0, mode: Mode::Steps };
        let stream = Stream::new(device)?;
        let mut rollout =
            Rollout::new(device, &stream, task, candidates, sizes, (seed, 0)).map_err(unsupported)?;
        rollout.place(&stream, &Environment::among(task, candidates, seed, 0, 1)?.snapshot(0))?;
        rollout.write(&stream, "parameters", &vec![NO_EXPLORATION; task.walker.joints.len()])?;
        rollout.write(&stream, "refused", &[NONE])?;
        rollout.write(&stream, "held", &[0u32])?;
        let ready = Arc::new(Event::new(device)?);
        let (device, terms) = (device.clone(), task.reward_names().len());
        let summed = vec![0.0; terms];
        let mut stepper = Self { device, rollout, environments, terms, summed, stream, graph: None, ready };
        // Before step 0, so that the first episodes begin at it.
        stepper.rollout.number(&stepper.stream, u32::MAX, seed, task.settings.command.ranges(1.0), 0)?;
        stepper.restart()?;
        if stagger {
            let ages: Vec<u32> =
                (0..environments).map(|number| task.staggered_age(seed, number as u32)).collect();
            stepper.rollout.write(&stepper.stream, "steps", &ages)?;
            let observe = stepper.rollout.plan().0.observe(0);
            stepper.launch(&observe)?;
            stepper.finish()?;
        }
        Ok(stepper)
    }

    /// Environments.
    pub fn environments(&self) -> usize {
        self.environments
    }

    /// Where steps run. Actions must be written before what this stream has to do at the time of [`Stepper::step`].
    pub fn stream(&self) -> &Stream {
        &self.stream
    }

    /// Bytes of the GPU's memory.
    pub fn bytes(&self) -> u64 {
        self.rollout.bytes()
    }

    fn launch(&self, launch: &crate::ppo::Launch) -> Result<(), CudaError> {
        self.rollout.launch_with(&self.stream, &|_| None, launch)
    }

    /// Marks the end of the stream's work, and waits for it.
    fn finish(&self) -> Result<(), CudaError> {
        self.ready.record(&self.stream)?;
        self.stream.wait()
    }

    /// Episodes that end begin anew within the step, unless they are [held](Self::hold). `actions` points to N × actions 32-bit floats of this GPU, row by row;
    /// they are read there. When this returns, all arrays are written.
    ///
    /// # Errors
    /// [`RolloutError::Action`] for one that is not finite: nothing has been stepped then. A failure of the GPU.
    pub fn step(&mut self, actions: Argument) -> Result<Stepped, RolloutError> {
        let (plan, tiles) = self.rollout.plan();
        self.rollout.launch_with(&self.stream, &|name| (name == "mean").then_some(actions), &plan.take())?;
        if let Some(&place) = self.rollout.read::<u32>(&self.stream, "refused")?.first()
            && place != NONE
        {
            return Err(self.refuse(place as usize)?);
        }
        if self.graph.is_none() {
            let launch = |stream: &Stream, launches: &[crate::ppo::Launch]| {
                launches.iter().try_for_each(|one| self.rollout.launch_with(stream, &|_| None, one))
            };
            self.graph = Some(self.stream.record(|stream| {
                launch(stream, &plan.before(tiles))?;
                self.rollout.move_robots(stream)?;
                launch(stream, &plan.after())
            })?);
        }
        if let Some(graph) = &mut self.graph {
            graph.launch(&self.stream)?;
        }
        self.ready.record(&self.stream)?;
        let totals = self.rollout.read_f64(&self.stream, "totals")?;
        // The first sum is the whole reward; its terms follow.
        for (sum, total) in self.summed.iter_mut().zip(totals.iter().skip(1)) {
            *sum += total;
        }
        let count = |sum: Sum| totals.get(sum.place(self.terms)).map_or(0, |&count| count as usize);
        Ok(Stepped { ended: count(Sum::Episodes), diverged: count(Sum::Diverged) })
    }

    fn refuse(&mut self, place: usize) -> Result<RolloutError, RolloutError> {
        self.rollout.write(&self.stream, "refused", &[NONE])?;
        let interface = &self.rollout.task().walker.interface;
        let width = interface.joints.len().max(1);
        let joint = interface.joints.get(place % width).cloned().unwrap_or_default();
        Ok(RolloutError::Action { environment: place / width, joint })
    }

    /// The first environment whose simulation diverged in the last step, if one did.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn first_diverged(&self) -> Result<Option<usize>, CudaError> {
        let tally = self.rollout.read_f64(&self.stream, "tally")?;
        let broken = tally.chunks_exact(self.environments).nth(Sum::Diverged.place(self.terms));
        Ok(broken.and_then(|broken| broken.iter().position(|&count| count > 0.0)))
    }

    /// Whether robots whose episode ended stay as they are, until they are [restarted](Self::restart_those). Those whose
    /// simulation diverged begin anew all the same. At first they are not held.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn hold(&mut self, held: bool) -> Result<(), CudaError> {
        self.rollout.write(&self.stream, "held", &[u32::from(held)])
    }

    /// New episodes for all environments. Waits for all work on the GPU first, that of others who read the arrays too.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn restart(&mut self) -> Result<(), CudaError> {
        self.restart_those(&vec![true; self.environments])
    }

    /// New episodes for the environments that are `chosen`, one entry each; environments beyond its end are not. What the
    /// others observe stays. Waits as [`Stepper::restart`].
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn restart_those(&mut self, chosen: &[bool]) -> Result<(), CudaError> {
        let number = |e: usize| u32::from(chosen.get(e).copied().unwrap_or_default());
        let chosen: Vec<u32> = (0..self.environments).map(number).collect();
        self.device.wait()?;
        self.rollout.write(&self.stream, "chosen", &chosen)?;
        self.rollout.plan().0.restart().iter().try_for_each(|launch| self.launch(launch))?;
        self.finish()
    }

    /// As [`Stepper::restart_those`], and the last step of the `chosen` belongs to no episode: it pays nothing and ends nothing.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn restart_without_step(&mut self, chosen: &[bool]) -> Result<(), CudaError> {
        self.restart_those(chosen)?;
        self.launch(&self.rollout.plan().0.clear())?;
        self.finish()
    }

    /// Sums of the weighted reward terms over all environments since the last call, in the order of
    /// [`Task::reward_names`]. A step in which an environment's simulation diverged has none of it.
    pub fn take_terms(&mut self) -> Vec<f64> {
        let none = vec![0.0; self.terms];
        std::mem::replace(&mut self.summed, none)
    }

    /// The environments as they are before the next step, and its number: as [`Environment::snapshot`] has them.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn state(&self) -> Result<(Vec<Snapshot>, u32), RolloutError> {
        let mut snapshots = self.rollout.snapshots(&self.stream)?;
        snapshots.iter_mut().for_each(|one| before_rows(self.rollout.task(), one));
        let control = self.rollout.read::<u32>(&self.stream, "control")?;
        Ok((snapshots, control.first().copied().unwrap_or_default()))
    }

    /// Makes the environments what they were before step `step`, here or on the CPU, and writes what they observe. Waits for all
    /// work on the GPU first, that of others who read the arrays too.
    ///
    /// # Errors
    /// Another number of environments; a failure of the GPU.
    pub fn set_state(&mut self, snapshots: &[Snapshot], step: u32) -> Result<(), RolloutError> {
        if snapshots.len() != self.environments {
            let what = format!("is of {} robots; here are {}", snapshots.len(), self.environments);
            return Err(TaskError::Setting { setting: "the robots' state".to_owned(), what }.into());
        }
        self.device.wait()?;
        self.rollout.load(&self.stream, snapshots)?;
        let mut control = self.rollout.read::<u32>(&self.stream, "control")?;
        if let Some(first) = control.first_mut() {
            *first = step;
        }
        self.rollout.write(&self.stream, "control", &control)?;
        self.launch(&self.rollout.plan().0.observe(0))?;
        Ok(self.finish()?)
    }

    /// Writes how robots move, for [`Shown::Motion`]. Waits as [`Stepper::restart`].
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn observe_motion(&mut self) -> Result<(), CudaError> {
        self.device.wait()?;
        self.launch(&self.rollout.plan().0.motion())?;
        self.finish()
    }

    /// An array that steps write.
    ///
    /// # Errors
    /// None is there.
    pub fn array(&self, shown: Shown) -> Result<Shared, RolloutError> {
        let interface = &self.rollout.task().walker.interface;
        let count = self.environments;
        let (one, columns) = ([count], [3, count]);
        let rows = [count, interface.observation_width()];
        let critic = [count, interface.critic_width()];
        let apart = self.rollout.scene()?.ends_apart();
        let moved;
        let (name, first, shape) = match shown {
            Shown::Observation => ("observation", 0, &rows[..]),
            Shown::CriticObservation => ("critic_observation", 0, &critic[..]),
            Shown::LastObservation => ("last_observation", 0, &rows[..]),
            Shown::Reward => ("reward", 0, &one[..]),
            Shown::Terminated => ("ends", 0, &one[..]),
            Shown::Truncated => ("ends", apart, &one[..]),
            Shown::Ended => ("ends", 2 * apart, &one[..]),
            Shown::Commands => ("command", 0, &columns[..]),
            Shown::Motion(part) => {
                let (first, width) = part.place(interface.joints.len());
                moved = [count, width];
                ("motion", count * first, &moved[..])
            }
        };
        let missing =
            || CudaError::Call { doing: format!("sharing `{name}`"), reason: "it is missing".into() };
        let storage: &Arc<Storage> = self.rollout.storage(name).ok_or_else(missing)?;
        let array = Shared::new(&self.device, storage, &self.ready, first, shape);
        Ok(if shown == Shown::Commands { array.transposed() } else { array })
    }
}
