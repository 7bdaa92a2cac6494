//! Environments in a GPU's memory.

use std::sync::Arc;

use gaitfit_physics::trace::{Input, Output};
use gaitfit_physics::{Params, Slot, State};

use super::DeviceError;
use super::period::{BLOCK, Period};
use crate::emit::{Class, KERNEL, Place};
use crate::runtime::{Argument, Buffer, CudaError, Device, Kernel, Shape, Stream};

/// Many environments of one robot. Environments beyond those asked for, up to whole blocks, are copies of others.
pub struct Batch {
    period: Arc<Period>,
    kernel: Kernel,
    cached: bool,
    environments: usize,
    /// Environments of a candidate: those that share the modifications' weights.
    per_candidate: usize,
    blocks: usize,
    buffers: [Buffer<f32>; 7],
    start: Buffer<f32>,
}

impl Batch {
    /// Room for `environments` environments, `candidates` of which each have the weights of one candidate: the first
    /// `environments / candidates` have those of the first, and so on. All numbers are zero.
    ///
    /// # Errors
    /// A GPU without room or compiler; environments that are no multiple of the candidates.
    pub fn new(
        device: &Device,
        period: &Arc<Period>,
        environments: usize,
        candidates: usize,
    ) -> Result<Self, DeviceError> {
        if environments == 0 || candidates == 0 || !environments.is_multiple_of(candidates) {
            let must = format!("a multiple of the {candidates} candidates, from 1");
            return Err(DeviceError::Count { what: "environments", must, found: environments });
        }
        let layout = &period.layout;
        // Whole blocks: a part of a block cannot be started.
        let tiles_of_block = BLOCK / crate::emit::TILE;
        let blocks = environments.div_ceil(layout.environments() * tiles_of_block);
        let tiles = blocks * tiles_of_block;
        let per_candidate = environments / candidates;
        // Copies beyond the last environment read weights of candidates beyond the last.
        let sets = (tiles * layout.environments()).div_ceil(per_candidate);
        let length = |class: Class| {
            let times = match class {
                Class::Weights => sets,
                Class::Disturbance => tiles * period.substeps(),
                _ => tiles,
            };
            layout.size(class) * times
        };
        let names = ["states", "parameters", "targets", "memory", "weights", "reports", "disturbances"];
        let sizes: Vec<(&str, u64)> =
            Class::ALL.iter().zip(names).map(|(&class, name)| (name, 4 * length(class) as u64)).collect();
        let mut plan = sizes.clone();
        plan.push(("states at the start", sizes[0].1));
        device.check_room(&plan)?;
        let module = device.load(&period.program())?;
        let buffer = |class: Class| Buffer::new(device, names[class as usize], length(class));
        Ok(Self {
            period: period.clone(),
            kernel: module.kernel(KERNEL)?,
            cached: module.cached(),
            environments,
            per_candidate,
            blocks,
            buffers: [
                buffer(Class::State)?,
                buffer(Class::Params)?,
                buffer(Class::Targets)?,
                buffer(Class::Memory)?,
                buffer(Class::Weights)?,
                buffer(Class::Report)?,
                buffer(Class::Disturbance)?,
            ],
            start: Buffer::new(device, "states at the start", length(Class::State))?,
        })
    }

    /// Environments asked for.
    pub fn environments(&self) -> usize {
        self.environments
    }

    /// The program's kernel.
    pub fn kernel(&self) -> &Kernel {
        &self.kernel
    }

    /// Whether the program was compiled before.
    pub fn cached(&self) -> bool {
        self.cached
    }

    /// The numbers of a class, as an argument of other kernels; where each lies says [`Period::layout`].
    pub fn numbers(&self, class: Class) -> Argument {
        (&self.buffers[class as usize]).into()
    }

    /// Bytes of the GPU's memory.
    pub fn bytes(&self) -> usize {
        self.buffers.iter().chain([&self.start]).map(Buffer::bytes).sum()
    }

    /// Writes a class. `number(environment, input)` is the number of an input of the recording.
    fn fill(
        &mut self,
        stream: &Stream,
        class: Class,
        mut number: impl FnMut(usize, usize) -> f32,
    ) -> Result<(), CudaError> {
        let layout = &self.period.layout;
        let places: Vec<(usize, Place)> =
            layout.inputs.iter().copied().enumerate().filter(|(_, place)| place.class == class).collect();
        let buffer = &mut self.buffers[class as usize];
        let mut host = vec![0.0; buffer.len()];
        let (size, per_tile) = (layout.size(class), layout.environments());
        // Places behind the last environment are filled too, with copies: their threads run all the same.
        for (tile, numbers) in host.chunks_exact_mut(size.max(1)).enumerate() {
            for inner in 0..per_tile {
                let environment = (tile * per_tile + inner) % self.environments;
                for &(input, place) in &places {
                    numbers[layout.offset(place, inner)] = number(environment, input);
                }
            }
        }
        buffer.write(stream, &host)
    }

    /// Writes all numbers of a class, laid out by the caller.
    ///
    /// # Errors
    /// [`CudaError::Length`], or a failure of the GPU.
    pub fn write_numbers(&mut self, stream: &Stream, class: Class, numbers: &[f32]) -> Result<(), CudaError> {
        self.buffers[class as usize].write(stream, numbers)
    }

    /// Reads all numbers of a class as they lie.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn read_numbers(&self, stream: &Stream, class: Class) -> Result<Vec<f32>, CudaError> {
        self.buffers[class as usize].read(stream)
    }

    /// Tiles of environments, those with copies among them.
    pub fn tiles(&self) -> usize {
        self.blocks * BLOCK / crate::emit::TILE
    }

    /// Writes parameters: those of environment `e` are `sets[e % sets.len()]`.
    ///
    /// # Errors
    /// No set, or of another robot, or with another number where the program has a constant; a failure of the GPU.
    pub fn write_params(&mut self, stream: &Stream, sets: &[Params<f64>]) -> Result<(), DeviceError> {
        sets.iter().try_for_each(|set| self.keeps(set))?;
        let values: Vec<Vec<f64>> =
            sets.iter().map(|set| listed(|add| set.visit(|slot, &x| add(slot, x)))).collect();
        let names = self.period.graph.inputs.iter().filter(|input| matches!(input, Input::Params(_))).count();
        self.write_listed(stream, Class::Params, "parameters", names, &values)
    }

    /// Refuses a robot with another number where the program has a constant.
    fn keeps(&self, set: &Params<f64>) -> Result<(), DeviceError> {
        let mut constants = self.period.fixed.iter().peekable();
        let mut refused = None;
        set.visit(|slot, &number| {
            if let Some(&(_, constant)) = constants.next_if(|(of, _)| *of == slot)
                && constant as f32 != number as f32
            {
                refused.get_or_insert(DeviceError::Constant { slot, constant, number });
            }
        });
        refused.map_or(Ok(()), Err)
    }

    /// Writes states: that of environment `e` is `states[e % states.len()]`.
    ///
    /// # Errors
    /// No state, or of another robot; a failure of the GPU.
    pub fn write_states(&mut self, stream: &Stream, states: &[State<f64>]) -> Result<(), DeviceError> {
        let values: Vec<Vec<f64>> =
            states.iter().map(|state| listed(|add| state.visit(|slot, &x| add(slot, x)))).collect();
        let names = self.period.graph.inputs.iter().filter(|input| matches!(input, Input::State(_))).count();
        self.write_listed(stream, Class::State, "states", names, &values)
    }

    /// Writes what modifications remember, a list for each environment in turn. Networks that were not asked for remember 0.
    ///
    /// # Errors
    /// No list, or one of another length; a failure of the GPU.
    pub fn write_memory(&mut self, stream: &Stream, values: &[Vec<f64>]) -> Result<(), DeviceError> {
        let count = self.period.memory.iter().filter(|&&asked| asked).count();
        if let Some(found) = values.iter().map(Vec::len).find(|&length| length != count) {
            let must = format!("lists of {count} numbers, one at least");
            return Err(DeviceError::Count { what: "memory", must, found });
        }
        let whole = |numbers: &Vec<f64>| {
            let mut numbers = numbers.iter().copied();
            let number = |&asked: &bool| if asked { numbers.next().unwrap_or(0.0) } else { 0.0 };
            self.period.memory.iter().map(number).collect()
        };
        let values: Vec<Vec<f64>> = values.iter().map(whole).collect();
        self.write_listed(stream, Class::Memory, "memory", self.period.memory.len(), &values)
    }

    /// Writes sent targets, rad: `taps × joints`, newest first, for each environment in turn.
    ///
    /// # Errors
    /// No list, or one of another length; a failure of the GPU.
    pub fn write_targets(&mut self, stream: &Stream, values: &[Vec<f64>]) -> Result<(), DeviceError> {
        let names = self.period.taps() * self.period.joints();
        self.write_listed(stream, Class::Targets, "targets", names, values)
    }

    fn write_listed(
        &mut self,
        stream: &Stream,
        class: Class,
        what: &'static str,
        count: usize,
        values: &[Vec<f64>],
    ) -> Result<(), DeviceError> {
        let wrong = values.iter().map(Vec::len).find(|&length| length != count);
        if values.is_empty() || wrong.is_some() {
            let must = format!("lists of {count} numbers, one at least");
            return Err(DeviceError::Count { what, must, found: wrong.unwrap_or(0) });
        }
        // Inputs of a class stand together in the recording, in the order of `values`.
        let first = self.period.layout.inputs.iter().position(|place| place.class == class).unwrap_or(0);
        self.fill(stream, class, |environment, input| {
            values[environment % values.len()][input - first] as f32
        })?;
        Ok(())
    }

    /// Writes each candidate's weights, as the modifications visit them.
    ///
    /// # Errors
    /// Another number of candidates or weights; a failure of the GPU.
    pub fn write_weights(&mut self, stream: &Stream, candidates: &[Vec<f64>]) -> Result<(), DeviceError> {
        let layout = &self.period.layout;
        let weights = layout.inputs.iter().copied().filter(|place| place.class == Class::Weights);
        // Networks that were added to make limbs alike keep their zeros.
        let asked = weights.zip(&self.period.weights).filter(|(_, asked)| **asked);
        let places: Vec<Place> = asked.map(|(place, _)| place).collect();
        let count = self.environments / self.per_candidate;
        let lengths = candidates.iter().all(|own| own.len() == places.len());
        if candidates.len() != count || !lengths {
            let must = format!("{count} lists of {} numbers", places.len());
            return Err(DeviceError::Count { what: "weights", must, found: candidates.len() });
        }
        let buffer = &mut self.buffers[Class::Weights as usize];
        let mut host = vec![0.0; buffer.len()];
        for (set, numbers) in host.chunks_exact_mut(layout.size(Class::Weights).max(1)).enumerate() {
            for (&place, &value) in places.iter().zip(&candidates[set % count]) {
                numbers[layout.offset(place, 0)] = value as f32;
            }
        }
        buffer.write(stream, &host)?;
        Ok(())
    }

    /// Advances all environments by one control period, in the stream's order.
    ///
    /// # Errors
    /// A kernel that cannot be started.
    pub fn step(&self, stream: &Stream) -> Result<(), CudaError> {
        let [state, params, targets, memory, weights, report, disturbance] = &self.buffers;
        let per_candidate = i32::try_from(self.per_candidate).unwrap_or(i32::MAX);
        let arguments = [
            state.into(),
            params.into(),
            targets.into(),
            memory.into(),
            weights.into(),
            report.into(),
            disturbance.into(),
            per_candidate.into(),
        ];
        let blocks = u32::try_from(self.blocks).unwrap_or(u32::MAX);
        self.kernel.launch(stream, Shape::new(blocks, BLOCK as u32), &arguments)
    }

    /// Keeps the present states for [`Batch::restart`].
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn keep(&mut self, stream: &Stream) -> Result<(), CudaError> {
        self.start.copy_from(stream, &self.buffers[Class::State as usize])
    }

    /// Goes back to the states last kept.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn restart(&mut self, stream: &Stream) -> Result<(), CudaError> {
        let [state, ..] = &mut self.buffers;
        state.copy_from(stream, &self.start)
    }

    /// The states of the first `count` environments, as lists of numbers in the order of [`State::visit`].
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn read_states(&self, stream: &Stream, count: usize) -> Result<Vec<Vec<f32>>, CudaError> {
        let numbers = self.buffers[Class::State as usize].read(stream)?;
        let layout = &self.period.layout;
        let outputs = self.period.graph.outputs.iter().zip(&layout.outputs);
        let places: Vec<Place> = outputs
            .filter(|(output, _)| matches!(output, Output::State(_)))
            .map(|(_, &place)| place)
            .collect();
        let (size, per_tile) = (layout.size(Class::State), layout.environments());
        let state = |environment: usize| {
            let tile = &numbers[environment / per_tile * size..][..size];
            places.iter().map(|&place| tile[layout.offset(place, environment % per_tile)]).collect()
        };
        Ok((0..count.min(self.environments)).map(state).collect())
    }
}

/// The numbers that a visit adds.
fn listed(visit: impl FnOnce(&mut dyn FnMut(Slot, f64))) -> Vec<f64> {
    let mut numbers = Vec::new();
    visit(&mut |_, number| numbers.push(number));
    numbers
}
