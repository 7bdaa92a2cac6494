//! The learner in the GPU's memory.

use gaitfit_learn::ppo::{self, Diagnostics, Precision, Samples, SamplesError, UpdateError};
use gaitfit_policy::network::{Memory, Normaliser, RecurrentShape};

use super::error::PpoError;
use super::flat::Flat;
use super::launch::{Batch, Id, Launch, Value};
use super::plan::{CHECKED, Plan};
use super::prepared::{Limits, Prepared, memories};
use super::report::{LEARNING_RATE, STEPS};
use super::storage::{Storage, Stored};
use super::together::update_together;
use crate::runtime::{Argument, CudaError, Device, Event, Graph, Kernel, Stream};

/// Min compute capability: matrix units take TF32 from Ampere on.
const CAPABILITY: (i32, i32) = (8, 0);

/// A logarithm of σ whose exponential is 0 in single precision: so little exploration around an action is the action.
pub(crate) const NO_EXPLORATION: f32 = -1e4;

/// Networks, optimiser and samples in a GPU's memory; see the module.
pub struct Learner {
    pub(super) plan: Plan,
    arrays: Vec<Storage>,
    kernels: Vec<(&'static str, Kernel)>,
    stream: Stream,
    /// Work that need not wait runs here, between these marks.
    aside: Stream,
    marks: [Event; 2],
    /// With several GPUs: the mark after what this one writes for an exchange.
    said: Event,
    /// The update, in parts between which GPUs tell each other numbers; empty until it is first run.
    graphs: Vec<Graph>,
    pub(super) batch: Batch,
    pub(super) settings: ppo::Settings,
    pub(super) widths: ppo::Widths,
    seed: u64,
    /// Parameters of the actor and of the critic.
    sizes: [usize; 2],
    normalised: [bool; 2],
}

impl Learner {
    /// A copy of the CPU's `learner` for rollouts of `batch`. Refused before anything is allocated if the arrays do not
    /// fit into the GPU's free memory.
    ///
    /// # Errors
    /// [`PpoError`], naming what does not fit or what is missing.
    pub fn new(
        device: &Device,
        learner: &ppo::Learner,
        batch: Batch,
        precision: Precision,
    ) -> Result<Self, PpoError> {
        let info = device.info();
        if info.capability < CAPABILITY {
            let (name, found) = (info.name.clone(), info.capability);
            return Err(PpoError::TooOld { name, found, min: CAPABILITY });
        }
        let limits = Limits::from_device(device);
        let Prepared { program, plan, maps, turn, sizes } = Prepared::new(learner, batch, precision, limits)?;
        let parts: Vec<(&str, u64)> = plan.arrays.iter().map(|array| (array.name, array.bytes())).collect();
        device.check_room(&parts)?;
        let module = device.load(&program)?;
        let mut kernels: Vec<(&'static str, Kernel)> = Vec::new();
        let (remember, forget) = (plan.remember(0), plan.forget(0, 0).map(|(launch, _)| launch));
        let foresee = plan.foresee(0, 1);
        let others = plan.pack.iter().chain(&foresee).chain(&remember).chain(&forget);
        for launch in plan.launches.iter().chain(others) {
            if kernels.iter().all(|(name, _)| *name != launch.kernel) {
                kernels.push((launch.kernel, module.kernel(launch.kernel)?));
            }
        }
        let mut arrays = Vec::with_capacity(plan.arrays.len());
        for array in &plan.arrays {
            arrays.push(Storage::new(device, array)?);
        }
        let normalised = [learner.normaliser().is_some(), learner.critic_normaliser().is_some()];
        let (settings, widths) = (learner.settings().clone(), learner.widths());
        let stream = Stream::new(device)?;
        let seed = learner.scalars().seed;
        let mut built = Self {
            plan,
            arrays,
            kernels,
            stream,
            aside: Stream::new(device)?,
            marks: [Event::new(device)?, Event::new(device)?],
            said: Event::mark(device)?,
            graphs: Vec::new(),
            batch,
            settings,
            widths,
            seed,
            sizes,
            normalised,
        };
        for (name, map) in ["map", "forth", "back"].into_iter().zip(&maps) {
            built.write(name, map)?;
        }
        built.write("memory_turn", &turn)?;
        if let Some(memories) = memories(learner) {
            let scales_and_shifts =
                |shape: &RecurrentShape| [vec![1.0f32; shape.outputs()], vec![0.0; shape.outputs()]].concat();
            built.write("memory_unit", &memories.each_ref().map(scales_and_shifts).concat())?;
        }
        built.load(learner)?;
        Ok(built)
    }

    /// Takes over the state of a learner of the same settings and shapes.
    ///
    /// # Errors
    /// [`PpoError`] if it is another one's, or the GPU fails.
    pub fn load(&mut self, learner: &ppo::Learner) -> Result<(), PpoError> {
        let Flat { parameters, moments, memories, memory_moments } = Flat::new(learner);
        self.write("parameters", &parameters)?;
        self.write("moments", &moments)?;
        self.write("memory_parameters", &memories)?;
        self.write("memory_moments", &memory_moments)?;
        let scalars = learner.scalars();
        self.seed = scalars.seed;
        let mut state = self.read::<f64>("state")?;
        (state[LEARNING_RATE], state[STEPS]) = (scalars.learning_rate, scalars.steps as f64);
        self.write("state", &state)?;
        for (name, width, normaliser) in [
            ("statistics", self.widths.observation, &scalars.normaliser),
            ("critic_statistics", self.widths.critic_observation, &scalars.critic_normaliser),
        ] {
            let fresh = Normaliser::new(width);
            let from = normaliser.as_ref().unwrap_or(&fresh);
            self.write(name, &[&from.mean[..], &from.variance, &[from.count]].concat())?;
        }
        self.plan.pack.iter().try_for_each(|launch| self.start(&self.stream, launch))?;
        self.stream.wait()?;
        Ok(())
    }

    /// Leaves exploration out: actions are the policy's means.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn quiet(&mut self) -> Result<(), PpoError> {
        let mut parameters = self.read_f32("parameters")?;
        let networks = self.sizes.iter().sum::<usize>();
        parameters.iter_mut().skip(networks).for_each(|log_std| *log_std = NO_EXPLORATION);
        Ok(self.write("parameters", &parameters)?)
    }

    /// Writes the state into the CPU's learner, which must be of the same settings and shapes.
    ///
    /// # Errors
    /// [`PpoError::State`] if it is not; the CPU's learner is then unchanged.
    pub fn store(&self, learner: &mut ppo::Learner) -> Result<(), PpoError> {
        let parameters = self.read_f32("parameters")?;
        let memory_parameters = self.read_f32("memory_parameters")?;
        let flat = Flat {
            moments: self.read_f32("moments")?,
            memories: memory_parameters,
            memory_moments: self.read_f32("memory_moments")?,
            parameters,
        };
        let state = self.read::<f64>("state")?;
        let parts = flat.parts(self.sizes, learner);
        let mut scalars = learner.scalars();
        scalars.seed = self.seed;
        scalars.steps = state[STEPS] as u64;
        scalars.learning_rate = state[LEARNING_RATE];
        let statistics = |name: &str, width: usize| -> Result<Normaliser, CudaError> {
            let numbers = self.read::<f64>(name)?;
            Ok(Normaliser {
                mean: numbers[..width].to_vec(),
                variance: numbers[width..2 * width].to_vec(),
                count: numbers[2 * width],
            })
        };
        if self.normalised[0] {
            scalars.normaliser = Some(statistics("statistics", self.widths.observation)?);
        }
        if self.normalised[1] {
            scalars.critic_normaliser =
                Some(statistics("critic_statistics", self.widths.critic_observation)?);
        }
        let find =
            |name: &str| parts.iter().find(|(known, _)| known == name).map(|(_, numbers)| &numbers[..]);
        learner.restore(find, &scalars)?;
        Ok(())
    }

    /// Copies the CPU's samples in: tiles of the batch's size, as its trainer makes them.
    ///
    /// # Errors
    /// [`PpoError::Batch`] for samples of another size, [`PpoError::Update`] for arrays of wrong length.
    pub fn upload(&mut self, tiles: &[Samples]) -> Result<(), PpoError> {
        let Batch { steps, environments, tile, .. } = self.batch;
        let widths = environments.div_ceil(tile);
        let expected = |number: usize| tile.min(environments - number * tile);
        let fits = tiles.len() == widths
            && tiles.iter().enumerate().all(|(number, samples)| {
                samples.steps == steps
                    && samples.environments == expected(number)
                    && samples.widths == self.widths
            });
        if !fits {
            let sizes: Vec<(usize, usize)> =
                tiles.iter().map(|tile| (tile.steps, tile.environments)).collect();
            let found = format!("{} tiles, {:?}", tiles.len(), sizes.first());
            let expected = format!("{widths} tiles, {steps} steps, {environments} environments");
            return Err(PpoError::Batch { expected, found });
        }
        for name in CHECKED {
            let width = match name {
                "observation" => self.widths.observation,
                "critic_observation" => self.widths.critic_observation,
                "action" | "mean" => self.widths.action,
                _ => 1,
            };
            let steps = if name == "last_value" { 1 } else { steps };
            let mut values = vec![0.0; steps * environments * width];
            for (number, samples) in tiles.iter().enumerate() {
                let numbers = array_of(samples, name);
                let count = samples.environments * width;
                if numbers.len() != steps * count {
                    let (found, expected) = (numbers.len(), steps * count);
                    let environments = samples.environments;
                    let error = SamplesError::Size {
                        tile: number,
                        array: name,
                        steps,
                        environments,
                        expected,
                        found,
                    };
                    return Err(UpdateError::from(error).into());
                }
                for (step, from) in numbers.chunks_exact(count).enumerate() {
                    let to = (step * environments + number * tile) * width;
                    values[to..to + count].copy_from_slice(from);
                }
            }
            self.write(name, &values)?;
        }
        let starts = tiles.iter().map(|tile| [rows_of(&tile.actor_memory), rows_of(&tile.critic_memory)]);
        let (actor, critic): (Vec<_>, Vec<_>) = starts.map(|[actor, critic]| (actor, critic)).unzip();
        self.write("actor_start", &actor.concat())?;
        Ok(self.write("critic_start", &critic.concat())?)
    }

    /// An array of the plan as an argument of other kernels.
    pub fn argument(&self, name: &str) -> Option<Argument> {
        self.storage(name).map(Storage::argument)
    }

    /// One update on the samples in the GPU's memory, as [`ppo::Learner::update`] does it. Of several GPUs:
    /// [`super::update_together`].
    ///
    /// # Errors
    /// [`PpoError::Update`] as there, or a failure of the GPU.
    pub fn update(&mut self, iteration: u32) -> Result<Diagnostics, PpoError> {
        update_together(std::slice::from_mut(self), iteration)
    }

    /// Tells the kernels of an update what they must know.
    pub(super) fn begin(&mut self, iteration: u32) -> Result<(), CudaError> {
        // In the warm-up the critic learns alone; at its end the optimiser's moments begin anew.
        let warmup = self.settings.critic_warmup.unwrap_or(0);
        let flags = [u32::from(iteration < warmup), u32::from(warmup > 0 && iteration == warmup)];
        let [critic_alone, reset] = flags;
        let seed = [self.seed as u32, (self.seed >> 32) as u32];
        self.write("control", &[iteration, critic_alone, reset, seed[0], seed[1]])
    }

    /// Records the update, unless it is recorded.
    pub(super) fn record(&mut self) -> Result<(), CudaError> {
        if !self.graphs.is_empty() {
            return Ok(());
        }
        let Plan { launches, apart, .. } = &self.plan;
        let [fork, join] = &self.marks;
        let start =
            |stream: &Stream, part: &[Launch]| part.iter().try_for_each(|launch| self.start(stream, launch));
        let record = |(number, part): (usize, std::ops::Range<usize>)| {
            self.stream.record(|stream| {
                if part.start > apart.start {
                    start(stream, &launches[part])?;
                } else {
                    // The deal of samples needs none of the advantages: it runs beside them, and both join before the
                    // gradient steps.
                    fork.record(stream)?;
                    self.aside.wait_for(fork)?;
                    start(&self.aside, &launches[apart.clone()])?;
                    join.record(&self.aside)?;
                    start(stream, &launches[part.start..apart.start])?;
                    stream.wait_for(join)?;
                    start(stream, &launches[apart.end..part.end])?;
                }
                self.take(number, self)
            })
        };
        self.graphs = self.plan.parts().into_iter().enumerate().map(record).collect::<Result<_, _>>()?;
        Ok(())
    }

    /// Starts part `number` of the recorded update.
    pub(super) fn launch(&mut self, number: usize) -> Result<(), CudaError> {
        self.graphs.get_mut(number).map_or(Ok(()), |graph| graph.launch(&self.stream))
    }

    /// The mark after what this GPU says in an exchange.
    pub(super) fn said(&self) -> &Event {
        &self.said
    }

    /// The update's numbers for the host.
    pub(super) fn state(&self) -> Result<Vec<f64>, CudaError> {
        self.read("state")
    }

    /// Copies what another GPU, or this one, says in exchange number `exchange`, in this stream's order.
    pub(super) fn take(&self, exchange: usize, from: &Self) -> Result<(), CudaError> {
        let arrays = self.plan.exchanges.get(exchange).map_or(&[][..], |exchange| &exchange.arrays);
        arrays.iter().try_for_each(|&[Id(own), Id(all)]| {
            self.arrays[all].take_part(&self.stream, from.batch.share.number, &from.arrays[own])
        })
    }

    /// The stream that the update runs on.
    pub fn stream(&self) -> &Stream {
        &self.stream
    }

    /// The plan of the update.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Starts one kernel of the plan.
    ///
    /// # Errors
    /// [`CudaError::Launch`].
    pub fn start(&self, stream: &Stream, launch: &Launch) -> Result<(), CudaError> {
        self.start_with(stream, launch, &[])
    }

    /// As [`Learner::start`], with other arguments at some places.
    pub(super) fn start_with(
        &self,
        stream: &Stream,
        launch: &Launch,
        others: &[(usize, Argument)],
    ) -> Result<(), CudaError> {
        let mut arguments: Vec<Argument> = launch
            .arguments
            .iter()
            .map(|value| match *value {
                Value::Array(Id(number)) => self.arrays[number].argument(),
                Value::U32(word) => word.into(),
                Value::F32(number) => number.into(),
            })
            .collect();
        for &(place, other) in others {
            arguments[place] = other;
        }
        let kernel = self.kernels.iter().find(|(name, _)| *name == launch.kernel);
        let Some((_, kernel)) = kernel else {
            let reason = "the plan does not have it".into();
            return Err(CudaError::Launch { kernel: launch.kernel.into(), reason });
        };
        kernel.launch(stream, launch.shape, &arguments)
    }

    /// Kernels of the update with registers and bytes of local memory of a thread.
    ///
    /// # Errors
    /// [`CudaError::Call`].
    pub fn resources(&self) -> Result<Vec<(&'static str, i32, i32)>, CudaError> {
        self.kernels
            .iter()
            .map(|(name, kernel)| Ok((*name, kernel.registers()?, kernel.local_bytes()?)))
            .collect()
    }

    /// Numbers of an `f32` array of the plan, for tests.
    ///
    /// # Errors
    /// A failure of the GPU; an array that is not there is empty.
    pub fn read_f32(&self, name: &str) -> Result<Vec<f32>, CudaError> {
        self.read(name)
    }

    fn storage(&self, name: &str) -> Option<&Storage> {
        self.plan.array(name).and_then(|Id(number)| self.arrays.get(number))
    }

    fn read<T: Stored>(&self, name: &str) -> Result<Vec<T>, CudaError> {
        self.storage(name).map_or_else(|| Ok(Vec::new()), |storage| storage.read(&self.stream))
    }

    pub(super) fn write<T: Stored>(&mut self, name: &str, numbers: &[T]) -> Result<(), CudaError> {
        let storage = self.plan.array(name).and_then(|Id(number)| self.arrays.get_mut(number));
        storage.map_or(Ok(()), |storage| storage.write(&self.stream, numbers))
    }
}

/// All rows of a memory.
fn rows_of(memory: &Memory) -> Vec<f32> {
    let mut rows = Vec::new();
    (0..memory.environments().unwrap_or(0)).for_each(|index| memory.append_row(index, &mut rows));
    rows
}

fn array_of<'a>(samples: &'a Samples, name: &str) -> &'a [f32] {
    match name {
        "observation" => &samples.observation,
        "critic_observation" => &samples.critic_observation,
        "action" => &samples.action,
        "mean" => &samples.mean,
        "log_probability" => &samples.log_probability,
        "value" => &samples.value,
        "reward" => &samples.reward,
        "done" => &samples.done,
        _ => &samples.last_value,
    }
}
