//! Rollouts in a GPU's memory.

use std::sync::Arc;

use gaitfit_learn::task::{Interval, Snapshot, Task, TaskError};
use gaitfit_sim::Candidate;

use super::plan::{Home, Plan, control};
use super::scene::{Scene, Sizes};
use super::{Packed, RolloutError, imu_rows};
use crate::emit::Class;
use crate::physics::{self, Batch, Period};
use crate::ppo::{Id, Launch, Learner, Storage, Stored};
use crate::runtime::{Argument, CudaError, Device, Kernel, Program, Stream};

/// A task's environments in a GPU's memory.
pub struct Rollout<'a> {
    task: &'a Task,
    period: Arc<Period>,
    sizes: Sizes,
    batch: Batch,
    plan: Plan,
    /// The rollout's own arrays, by their numbers in the plan.
    storages: Vec<Option<Arc<Storage>>>,
    kernels: Vec<(&'static str, Kernel)>,
}

/// Programs and launches of a rollout, before a GPU has them.
pub struct Planned {
    period: Arc<Period>,
    plan: Plan,
}

impl Planned {
    /// Environments of `task` around `candidates` on a GPU like `device`.
    ///
    /// # Errors
    /// As [`Rollout::new`].
    pub fn new(
        device: &Device,
        task: &Task,
        candidates: &[Candidate],
        sizes: Sizes,
    ) -> Result<Self, RolloutError> {
        let processors = usize::try_from(device.info().processors).unwrap_or(1);
        let period = Arc::new(Scene::period(task, candidates, sizes.environments, processors)?);
        let plan = Plan::new(&Scene::new(task, &period, sizes)?);
        Ok(Self { period, plan })
    }

    /// The programs that it compiles: the physics, and the other kernels.
    pub fn programs(&self) -> [Program; 2] {
        [self.period.program(), self.plan.program.clone()]
    }
}

impl<'a> Rollout<'a> {
    /// Environments of `task` around `candidates` in turn, randomised by `seed` as those from number `first` on;
    /// [`Rollout::load`] says where they are. Refused
    /// before anything is allocated if the arrays do not fit into the GPU's free memory.
    ///
    /// # Errors
    /// [`RolloutError`], naming what does not fit or is not done here.
    pub fn new(
        device: &Device,
        stream: &Stream,
        task: &'a Task,
        candidates: &[Candidate],
        sizes: Sizes,
        (seed, first): (u64, u32),
    ) -> Result<Self, RolloutError> {
        let planned = Planned::new(device, task, candidates, sizes)?;
        let _ahead = device.compile_ahead(planned.programs());
        Self::from_plan(device, stream, task, candidates, (planned, sizes), (seed, first))
    }

    /// As [`Rollout::new`], of what was planned for the same task, candidates and sizes.
    ///
    /// # Errors
    /// As there.
    pub fn from_plan(
        device: &Device,
        stream: &Stream,
        task: &'a Task,
        candidates: &[Candidate],
        (planned, sizes): (Planned, Sizes),
        (seed, first): (u64, u32),
    ) -> Result<Self, RolloutError> {
        let Planned { period, plan } = planned;
        let owned = plan.arrays.iter().zip(&plan.homes).filter(|(_, home)| **home == Home::Own);
        let parts: Vec<(&str, u64)> = owned.map(|(array, _)| (array.name, array.bytes())).collect();
        device.check_room(&parts)?;
        let module = device.load(&plan.program)?;
        let kernels = module.kernels(plan.kernels())?;
        let mut batch = Batch::new(device, &period, sizes.environments, 1)?;
        if let Some(candidate) = candidates.first().filter(|candidate| !candidate.networks.is_empty()) {
            let weights =
                physics::weights(task.walker.model(), &candidate.networks).map_err(TaskError::from)?;
            batch.write_weights(stream, &[weights])?;
        }
        let storages = plan
            .arrays
            .iter()
            .zip(&plan.homes)
            .map(|(array, home)| match home {
                Home::Own => Storage::new(device, array).map(|storage| Some(Arc::new(storage))),
                _ => Ok(None),
            })
            .collect::<Result<_, CudaError>>()?;
        let mut rollout = Self { task, period, sizes, batch, plan, storages, kernels };
        rollout.randomise(stream, candidates, seed, first)?;
        let environments = first as usize..first as usize + sizes.environments;
        let deviation = |environment: usize| candidates[environment % candidates.len()].torque_noise;
        let deviations: Vec<f64> = environments.clone().map(deviation).collect();
        rollout.write(stream, "deviation", &deviations)?;
        rollout.write(stream, "imu", &imu_rows(candidates, environments))?;
        Ok(rollout)
    }

    /// Gives the environments the robots that those from number `first` on have.
    ///
    /// # Errors
    /// A randomisation that leaves no robot, or a failure of the GPU.
    pub fn randomise(
        &mut self,
        stream: &Stream,
        candidates: &[Candidate],
        seed: u64,
        first: u32,
    ) -> Result<(), RolloutError> {
        let robots = self.task.robots(candidates, seed, first, self.sizes.environments)?;
        Ok(self.batch.write_params(stream, &robots)?)
    }

    /// Arrays and kernels, and the physics' tiles.
    pub(super) fn plan(&self) -> (&Plan, usize) {
        (&self.plan, self.batch.tiles())
    }

    /// The task.
    pub(super) fn task(&self) -> &'a Task {
        self.task
    }

    pub(super) fn scene(&self) -> Result<Scene<'_>, RolloutError> {
        Scene::new(self.task, &self.period, self.sizes)
    }

    /// Bytes of the GPU's memory.
    pub fn bytes(&self) -> u64 {
        let arrays = self.plan.arrays.iter().zip(&self.storages).filter(|(_, storage)| storage.is_some());
        self.batch.bytes() as u64 + arrays.map(|(array, _)| array.bytes()).sum::<u64>()
    }

    /// Threads of an environment in the physics.
    pub fn lanes(&self) -> usize {
        self.period.lanes()
    }

    /// Registers and bytes of local memory of a thread, of each kernel.
    ///
    /// # Errors
    /// [`CudaError::Call`].
    pub fn resources(&self) -> Result<Vec<(String, i32, i32)>, CudaError> {
        let kernels = self.kernels.iter().map(|(_, kernel)| kernel).chain([self.batch.kernel()]);
        kernels
            .map(|kernel| Ok((kernel.name().to_owned(), kernel.registers()?, kernel.local_bytes()?)))
            .collect()
    }

    /// An own array, to be shared with others: it lives as long as one of them has it.
    pub(super) fn storage(&self, name: &str) -> Option<&Arc<Storage>> {
        let Id(number) = self.plan.array(name)?;
        self.storages.get(number)?.as_ref()
    }

    /// Writes an own array. Others may read it ([`super::Shared`]): the caller has waited for all work on the GPU.
    pub(super) fn write<T: Stored>(
        &mut self,
        stream: &Stream,
        name: &str,
        numbers: &[T],
    ) -> Result<(), CudaError> {
        self.storage(name).map_or(Ok(()), |storage| storage.write(stream, numbers))
    }

    pub(super) fn read<T: Stored>(&self, stream: &Stream, name: &str) -> Result<Vec<T>, CudaError> {
        let storage = self.plan.array(name).and_then(|Id(number)| self.storages.get(number)?.as_ref());
        storage.map_or_else(|| Ok(Vec::new()), |storage| storage.read(stream))
    }

    /// Numbers of an `f64` array of the rollout: `totals`, the sums of all environments, or `tally`, those of each.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn read_f64(&self, stream: &Stream, name: &str) -> Result<Vec<f64>, CudaError> {
        self.read(stream, name)
    }

    /// Errors of velocity and yaw rate of every step and environment of trials, m/s and rad/s in turn.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn errors(&self, stream: &Stream) -> Result<Vec<f32>, CudaError> {
        self.read(stream, "errors")
    }

    /// Root-mean-square distance of the joints from the motion that the policy follows, rad, after every step of every
    /// environment of trials; empty if the policy follows none.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn motion_errors(&self, stream: &Stream) -> Result<Vec<f32>, CudaError> {
        if self.task.walker.observation.follows() {
            self.read(stream, "motion_errors")
        } else {
            Ok(Vec::new())
        }
    }

    /// Position (m) and orientation (wxyz) of the base after every step of every environment of trials.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn bases(&self, stream: &Stream) -> Result<Vec<f32>, CudaError> {
        self.read(stream, "bases")
    }

    /// What was recorded before every step of every environment, rows of [`gaitfit_learn::collect::sensed_width`] numbers.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn records(&self, stream: &Stream) -> Result<Vec<f32>, CudaError> {
        self.read(stream, "records")
    }

    /// Puts the environments where `snapshots` say.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn load(&mut self, stream: &Stream, snapshots: &[Snapshot]) -> Result<(), RolloutError> {
        let packed = Packed::new(&self.scene()?, snapshots, self.batch.tiles());
        self.load_robots(stream, &packed)?;
        for (name, numbers) in [
            ("command", &packed.command),
            ("last_action", &packed.last_action),
            ("feet", &packed.feet),
            ("returns", &packed.returns),
            ("past", &packed.past),
            ("critic_past", &packed.critic_past),
            ("ways", &packed.ways),
            ("turned", &packed.turned),
        ] {
            self.write(stream, name, numbers)?;
        }
        self.write(stream, "steps", &packed.steps)?;
        self.write(stream, "fresh", &packed.fresh)?;
        Ok(())
    }

    /// Puts all robots where one is, also those in places of the physics' tiles beyond the last environment. Nothing else of the
    /// environments is written.
    pub(super) fn place(&mut self, stream: &Stream, one: &Snapshot) -> Result<(), RolloutError> {
        let packed = Packed::new(&self.scene()?, std::slice::from_ref(one), self.batch.tiles());
        Ok(self.load_robots(stream, &packed)?)
    }

    fn load_robots(&mut self, stream: &Stream, packed: &Packed) -> Result<(), CudaError> {
        for (class, numbers) in [
            (Class::State, &packed.state),
            (Class::Targets, &packed.targets),
            (Class::Memory, &packed.memory),
            (Class::Report, &packed.report),
        ] {
            self.batch.write_numbers(stream, class, numbers)?;
        }
        Ok(())
    }

    /// The environments as they are.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn snapshots(&self, stream: &Stream) -> Result<Vec<Snapshot>, RolloutError> {
        let packed = Packed {
            state: self.batch.read_numbers(stream, Class::State)?,
            targets: self.batch.read_numbers(stream, Class::Targets)?,
            memory: self.batch.read_numbers(stream, Class::Memory)?,
            report: self.batch.read_numbers(stream, Class::Report)?,
            steps: self.read(stream, "steps")?,
            fresh: self.read(stream, "fresh")?,
            command: self.read(stream, "command")?,
            last_action: self.read(stream, "last_action")?,
            feet: self.read(stream, "feet")?,
            returns: self.read(stream, "returns")?,
            past: self.read(stream, "past")?,
            critic_past: self.read(stream, "critic_past")?,
            ways: self.read(stream, "ways")?,
            turned: self.read(stream, "turned")?,
        };
        Ok(packed.snapshots(&self.scene()?))
    }

    /// Numbers the steps of the next rollout from `first_step` and its environments from `first`, and draws its commands
    /// from `ranges`.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn number(
        &mut self,
        stream: &Stream,
        first_step: u32,
        seed: u64,
        ranges: [Interval; 3],
        first: u32,
    ) -> Result<(), CudaError> {
        self.write(stream, "control", &control(first_step, seed, ranges, first))
    }

    /// Starts a whole rollout under the learner's policy; its samples are the learner's. It can be recorded in a graph.
    ///
    /// # Errors
    /// [`CudaError::Launch`].
    pub fn start(&self, stream: &Stream, learner: &Learner) -> Result<(), CudaError> {
        let environments = self.sizes.environments;
        self.start_with(stream, learner, &|step| learner.foresee(stream, step * environments, environments))
    }

    /// As [`Rollout::start`]. `act` starts the work that fills the learner's mean actions of a step from its observations.
    ///
    /// # Errors
    /// [`CudaError::Launch`].
    pub fn start_with(
        &self,
        stream: &Stream,
        learner: &Learner,
        act: &dyn Fn(usize) -> Result<(), CudaError>,
    ) -> Result<(), CudaError> {
        self.launch(stream, learner, &self.plan.begin())?;
        for step in 0..self.sizes.steps {
            if let Some(record) = self.plan.record(step) {
                self.launch(stream, learner, &record)?;
            }
            self.launch(stream, learner, &self.plan.observe(step))?;
            act(step)?;
            self.launch(stream, learner, &self.plan.act(step))?;
            if let Some(disturb) = self.plan.disturb(step, self.batch.tiles()) {
                self.launch(stream, learner, &disturb)?;
            }
            self.batch.step(stream)?;
            self.launch(stream, learner, &self.plan.finish(step))?;
            self.forget(stream, learner, step)?;
        }
        // Policies of other trainers have no critic. Trials need none.
        if !self.task.walker.interface.critic_observation.is_empty() {
            self.launch(stream, learner, &self.plan.observe_end())?;
            self.foresee_tail(stream, learner)?;
            self.launch(stream, learner, &self.plan.add_values())?;
        }
        self.launch(stream, learner, &self.plan.total())
    }

    fn foresee_tail(&self, stream: &Stream, learner: &Learner) -> Result<(), CudaError> {
        let array = |name: &str| match self.storage(name).map(Arc::as_ref) {
            Some(Storage::F32(buffer)) => Some(buffer),
            _ => None,
        };
        match (array("tail"), array("tail_memory"), array("tail_value")) {
            (Some(tail), Some(memory), Some(value)) => {
                learner.foresee_values(stream, value.len(), tail, memory, value)
            }
            _ => Ok(()),
        }
    }

    /// Lets the learner's memories forget episodes that ended in a step.
    fn forget(&self, stream: &Stream, learner: &Learner, step: usize) -> Result<(), CudaError> {
        let argument = |name: &str| self.storage(name).map(|storage| storage.argument());
        match (argument("cut"), argument("tail_memory")) {
            (Some(cut), Some(memory)) => {
                let cuts = self.plan.cuts();
                learner.forget(stream, (step, cuts), cut, memory)
            }
            _ => Ok(()),
        }
    }

    /// Starts one part of every step of a rollout, for timing: `observe`, `foresee`, `act`, `physics` or `finish`.
    ///
    /// # Errors
    /// [`CudaError::Launch`].
    pub fn start_part(&self, stream: &Stream, learner: &Learner, part: &str) -> Result<(), CudaError> {
        let environments = self.sizes.environments;
        for step in 0..self.sizes.steps {
            match part {
                "observe" => self.launch(stream, learner, &self.plan.observe(step))?,
                "foresee" => learner.foresee(stream, step * environments, environments)?,
                "act" => self.launch(stream, learner, &self.plan.act(step))?,
                "finish" => self.launch(stream, learner, &self.plan.finish(step))?,
                _ => self.batch.step(stream)?,
            }
        }
        Ok(())
    }

    /// Starts the physics of a control period.
    pub(super) fn move_robots(&self, stream: &Stream) -> Result<(), CudaError> {
        self.batch.step(stream)
    }

    fn launch(&self, stream: &Stream, learner: &Learner, launch: &Launch) -> Result<(), CudaError> {
        self.launch_with(stream, &|name| learner.argument(name), launch)
    }

    /// Starts a kernel; `caller` has the caller's arrays.
    pub(super) fn launch_with(
        &self,
        stream: &Stream,
        caller: &dyn Fn(&str) -> Option<Argument>,
        launch: &Launch,
    ) -> Result<(), CudaError> {
        launch.start(stream, &self.kernels, |number| match self.plan.homes[number] {
            Home::Own => self.storages[number].as_ref().map(|storage| storage.argument()),
            Home::Physics(class) => Some(self.batch.numbers(class)),
            Home::Caller => caller(self.plan.arrays[number].name),
        })
    }
}
