//! Where the numbers of a batch of environments lie in a device's memory.
//!
//! A tile is what one warp of 32 threads works on: 32 / lanes environments. In each tile a slot of the lanes is a row of
//! 32 numbers, one a thread; behind those rows lie the slots that all lanes share, a row of one number an environment.
//! So a warp reads whole rows, and every slot lies at a constant distance from a thread's own place.

use std::collections::HashMap;

use gaitfit_physics::trace::{Input, Output, PeriodGraph};

use super::{EmitError, PeriodProgram};

/// Threads in a tile.
pub const TILE: usize = 32;

/// Kinds of numbers that are kept together.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub enum Class {
    /// Motion state: read and written.
    State,
    /// Parameters of the robots.
    Params,
    /// Sent targets: read, and the newest written where modifications correct it.
    Targets,
    /// Memory of modifications: read and written.
    Memory,
    /// Weights of modifications, one set a candidate.
    Weights,
    /// Report of the last physics step: written only.
    Report,
    /// Torques that disturb the joints: all tiles of the first physics step, then of the next.
    Disturbance,
}

impl Class {
    /// All of them.
    pub const ALL: [Self; 7] = [
        Self::State,
        Self::Params,
        Self::Targets,
        Self::Memory,
        Self::Weights,
        Self::Report,
        Self::Disturbance,
    ];

    /// Its name in the text.
    pub(super) fn letter(self) -> char {
        match self {
            Self::State => 's',
            Self::Params => 'p',
            Self::Targets => 't',
            Self::Memory => 'm',
            Self::Weights => 'w',
            Self::Report => 'r',
            Self::Disturbance => 'd',
        }
    }

    /// The class of an input.
    fn from_input(input: &Input) -> Self {
        match input {
            Input::State(_) => Self::State,
            Input::Params(_) => Self::Params,
            Input::Target { .. } => Self::Targets,
            Input::Memory { .. } => Self::Memory,
            Input::Weight { .. } => Self::Weights,
            Input::Disturbance { .. } => Self::Disturbance,
        }
    }
}

/// Place of a number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Place {
    /// Class of the number.
    pub class: Class,
    /// The lane that has it, or `None` if all share it.
    pub lane: Option<usize>,
    /// Its slot among the lanes' or among the shared ones.
    pub slot: usize,
}

/// Slots of a class.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Slots {
    /// Slots that each lane has for itself.
    pub own: usize,
    /// Slots that all lanes share.
    pub shared: usize,
}

/// Places of all numbers.
#[derive(Clone, Debug, PartialEq)]
pub struct Layout {
    /// Threads of an environment.
    pub lanes: usize,
    /// Place of each input of the recording.
    pub inputs: Vec<Place>,
    /// Place of each output of the recording: that of the input of the same name; reports have places of their own.
    pub outputs: Vec<Place>,
    slots: [Slots; 7],
}

impl Layout {
    /// The layout of a program's numbers.
    ///
    /// # Errors
    /// A result that is no input of the next period: it has no place.
    pub fn new(period: &PeriodGraph, program: &PeriodProgram) -> Result<Self, EmitError> {
        let mut slots = [Slots::default(); 7];
        let mut first: Vec<Option<usize>> = vec![None; period.inputs.len()];
        let mut inputs = Vec::with_capacity(period.inputs.len());
        for (input, &(lane, twin)) in period.inputs.iter().zip(&program.inputs) {
            let class = Class::from_input(input);
            let of_class = &mut slots[class as usize];
            // Counterparts of all lanes share a slot, a row of one number a thread.
            let slot = *first[twin as usize].get_or_insert_with(|| {
                let count = if lane.is_some() { &mut of_class.own } else { &mut of_class.shared };
                *count += 1;
                *count - 1
            });
            inputs.push(Place { class, lane, slot });
        }
        // A result is written where the input of the same name is read, so that the next period begins with
        // it.
        let find = |output: &Output| {
            let same = |input: &Input| match (output, input) {
                (Output::State(a), Input::State(b)) => a == b,
                (Output::Memory(a), Input::Memory { index, .. }) => a == index,
                (Output::Target { joint: a }, Input::Target { tap: 0, joint }) => a == joint,
                _ => false,
            };
            period.inputs.iter().position(same)
        };
        let mut reports: HashMap<u32, usize> = HashMap::new();
        let mut place = |output: &Output, (lane, twin): (Option<usize>, u32)| match output {
            Output::Report(_) => {
                let of_class = &mut slots[Class::Report as usize];
                let slot = *reports.entry(twin).or_insert_with(|| {
                    let count = if lane.is_some() { &mut of_class.own } else { &mut of_class.shared };
                    *count += 1;
                    *count - 1
                });
                Some(Place { class: Class::Report, lane, slot })
            }
            output => Some(inputs[find(output)?]),
        };
        let outputs = period.outputs.iter().zip(&program.outputs);
        let outputs = outputs.map(|(output, &seat)| place(output, seat).ok_or(EmitError::Unplaced));
        let outputs = outputs.collect::<Result<_, _>>()?;
        Ok(Self { lanes: program.program.lanes, inputs, outputs, slots })
    }

    /// Slots of a class.
    pub fn slots(&self, class: Class) -> Slots {
        self.slots[class as usize]
    }

    /// Environments in a tile.
    pub fn environments(&self) -> usize {
        TILE / self.lanes
    }

    /// Numbers of a class in a tile; of weights, in a candidate.
    pub fn size(&self, class: Class) -> usize {
        let Slots { own, shared } = self.slots(class);
        match class {
            Class::Weights => own * self.lanes + shared,
            _ => own * TILE + shared * self.environments(),
        }
    }

    /// Where in its tile a number of the tile's environment `environment` lies; weights have none.
    pub fn offset(&self, place: Place, environment: usize) -> usize {
        let lanes_slots = self.slots(place.class).own;
        match (place.class, place.lane) {
            (Class::Weights, Some(lane)) => place.slot * self.lanes + lane,
            (Class::Weights, None) => lanes_slots * self.lanes + place.slot,
            (_, Some(lane)) => place.slot * TILE + environment * self.lanes + lane,
            (_, None) => lanes_slots * TILE + place.slot * self.environments() + environment,
        }
    }
}
