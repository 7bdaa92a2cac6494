//! A recorded control period as CUDA text.
//!
//! The recording of [`gaitfit_physics::trace`] is of one robot. Here the robot's equal limbs are shared among the
//! threads ("lanes") of an environment ([`Seating`]), the recording becomes one [`Program`] that all lanes run, and
//! the program becomes text. Loops stay loops, for what decides a GPU's speed is that the loop's text fits its cache
//! of instructions. Guarded regions become branches that a warp takes if one of its lanes needs them.

mod chain;
mod crossing;
mod evaluate;
mod function;
mod lanes;
mod layout;
mod op;
mod plan;
mod program;
mod seating;
mod simplify;
mod source;
mod text;
mod turns;

use std::collections::HashMap;

use gaitfit_physics::trace::{Input, Node as Recorded, Output, PeriodGraph};
use gaitfit_physics::{Owner, Slot};

pub use function::tables;
pub use layout::{Class, Layout, Place, Slots, TILE};
pub use op::{Node, Op};
pub use program::{Kind, Program, Region};
pub use seating::Seating;
pub use text::{KERNEL, WORDS, body, cuda, head};
pub use turns::has_two_texts;

use chain::Chains;
use lanes::Lanes;
use plan::{InputSeats, Plan};
use source::Source;

/// Why a robot's step cannot be shared among that many threads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum EmitError {
    /// An operation mixes lanes.
    #[error("{0} mixes numbers of several limbs otherwise than by a sum; use fewer threads an environment")]
    Mixes(&'static str),
    /// Limbs are computed differently.
    #[error("limbs of one kind are computed by different operations; use fewer threads an environment")]
    Unlike,
    /// Something of one limb alone is asked for.
    #[error("a number of one limb is needed by all; use fewer threads an environment")]
    Alone,
    /// Guarded regions in guarded regions, in a sum over limbs.
    #[error("a sum over limbs passes through nested guarded regions; use fewer threads an environment")]
    Nested,
    /// Something is needed before it is computed.
    #[error(
        "limbs need each other's numbers in an order that they do not share; use fewer threads an environment"
    )]
    Order,
    /// A result without a place to be written.
    #[error("a control period gives a number that the next one does not take")]
    Unplaced,
}

/// Options for making a program.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct EmitOptions {
    /// Guards of fewer operations than this are dissolved: their regions are always computed. For what all threads of
    /// an environment compute alike a sixth of it counts: it is seldom a foot. Guards that follow from a robot's
    /// parameters alone are kept.
    pub min_guarded: usize,
}

impl Default for EmitOptions {
    fn default() -> Self {
        // A foot that is a sphere takes up to 400 operations, and some foot of a warp's robots always touches. A
        // cylinder takes 800.
        Self { min_guarded: 600 }
    }
}

/// Meaning of an input or output, without its number in a list.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
enum Name {
    State(Slot),
    Params(Slot),
    Target(usize, Slot),
    Memory(usize, Slot),
    Weight(usize, Slot),
    Report(Slot),
    Disturbance(Slot),
}

/// A program with the meaning of its inputs and outputs.
#[derive(Clone, Debug, PartialEq)]
pub struct PeriodProgram {
    /// The program. Its inputs have the recording's numbers of lane 0.
    pub program: Program,
    /// Lane and counterpart in lane 0 of each input of the recording.
    pub inputs: Vec<(Option<usize>, u32)>,
    /// Lane of each output of the recording, and its place in [`Program::outputs`].
    pub outputs: Vec<(Option<usize>, u32)>,
}

impl PeriodProgram {
    /// Shares a recording among the lanes of `seating`.
    ///
    /// # Errors
    /// Limbs that cannot be computed apart.
    pub fn new(period: &PeriodGraph, seating: &Seating, options: EmitOptions) -> Result<Self, EmitError> {
        let names = input_names(period);
        // An input is known by its name: the same name with a counterpart's owner is the counterpart in lane
        // 0.
        let mut first: HashMap<Name, u32> = HashMap::new();
        for (number, &name) in names.iter().enumerate() {
            first.insert(name, number as u32);
        }
        let mut seats = InputSeats { lane: Vec::new(), twin: Vec::new() };
        for &name in &names {
            let (lane, twin) = seat(seating, name);
            seats.lane.push(lane);
            seats.twin.push(first.get(&twin).copied().ok_or(EmitError::Unlike)?);
        }
        let masks: Vec<u8> = seats.lane.iter().map(|lane| lane.map_or(0, |lane| 1 << lane)).collect();
        let whole = Source::new(&period.graph, |_| 0);
        // The lanes of the guards are needed before guards are dissolved, so they are found on the whole recording
        // first.
        let owned = Lanes::new(&whole, &Chains::new(&whole), &masks)?.mask;
        let steady = of_parameters(period);
        let source = Source::new(&period.graph, |guard| {
            // A guard that follows from parameters alone tells what a robot lacks. Its neighbours lack the same, so
            // threads never take different branches.
            if steady[guard as usize] {
                return 0;
            }
            let alike = seating.lanes() > 1 && owned[guard as usize] == 0;
            if alike { options.min_guarded / 6 } else { options.min_guarded }
        });
        let chains = Chains::new(&source);
        let lanes = Lanes::new(&source, &chains, &masks)?;

        // Outputs by their counterpart in lane 0.
        let outputs = output_names(period);
        let mut places: HashMap<Name, usize> = HashMap::new();
        let mut tuples: Vec<Vec<Option<u32>>> = Vec::new();
        let mut seated = Vec::with_capacity(outputs.len());
        for (&name, &node) in outputs.iter().zip(&source.outputs) {
            let (lane, twin) = seat(seating, name);
            // Counterparts of all lanes make one tuple, which one statement of the program writes.
            let place = *places.entry(twin).or_insert_with(|| {
                tuples.push(vec![None; seating.lanes()]);
                tuples.len() - 1
            });
            match lane {
                Some(lane) => tuples[place][lane] = Some(node),
                None => tuples[place].fill(Some(node)),
            }
            seated.push((lane, place as u32));
        }
        // A lane without its counterpart cannot run the same program.
        let tuples: Vec<Vec<u32>> = tuples
            .into_iter()
            .map(|tuple| tuple.into_iter().collect::<Option<Vec<u32>>>().ok_or(EmitError::Unlike))
            .collect::<Result<_, _>>()?;
        let plan = Plan::new(&source, &chains, &lanes, &seats, seating.lanes(), &tuples)?;
        let program = Program::new(&source, &plan, seating.lanes())?;
        let inputs = seats.lane.into_iter().zip(seats.twin).collect();
        Ok(Self { program, inputs, outputs: seated })
    }
}

/// Tells of each node whether it follows from the robot's parameters alone.
fn of_parameters(period: &PeriodGraph) -> Vec<bool> {
    let mut steady: Vec<bool> = Vec::with_capacity(period.graph.nodes.len());
    for node in &period.graph.nodes {
        steady.push(match node {
            Recorded::Input(number) => matches!(period.inputs.get(*number as usize), Some(Input::Params(_))),
            Recorded::Variable(..) | Recorded::Result(..) => false,
            other => other.operands().all(|id| steady[id.0 as usize]),
        });
    }
    steady
}

/// A slot's lane, and the same slot of its owner's counterpart in lane 0.
fn seat_of(seating: &Seating, slot: Slot) -> (Option<usize>, Slot) {
    let (lane, owner) = seating.place(slot.owner);
    (lane, Slot { owner, ..slot })
}

fn seat(seating: &Seating, name: Name) -> (Option<usize>, Name) {
    match name {
        Name::State(slot) => {
            let (lane, slot) = seat_of(seating, slot);
            (lane, Name::State(slot))
        }
        Name::Params(slot) => {
            let (lane, slot) = seat_of(seating, slot);
            (lane, Name::Params(slot))
        }
        Name::Target(tap, slot) => {
            let (lane, slot) = seat_of(seating, slot);
            (lane, Name::Target(tap, slot))
        }
        Name::Memory(place, slot) => {
            let (lane, slot) = seat_of(seating, slot);
            (lane, Name::Memory(place, slot))
        }
        Name::Weight(modification, slot) => {
            let (lane, slot) = seat_of(seating, slot);
            (lane, Name::Weight(modification, slot))
        }
        Name::Report(slot) => {
            let (lane, slot) = seat_of(seating, slot);
            (lane, Name::Report(slot))
        }
        Name::Disturbance(slot) => {
            let (lane, slot) = seat_of(seating, slot);
            (lane, Name::Disturbance(slot))
        }
    }
}

fn target_name(tap: usize, owner: Owner) -> Name {
    Name::Target(tap, Slot { owner, name: "target", index: 0 })
}

/// Names of what is remembered: the how-manieth number of its owner.
fn memory_names(owners: impl Iterator<Item = Owner>) -> Vec<Name> {
    let mut counts: HashMap<Owner, usize> = HashMap::new();
    owners
        .map(|owner| {
            let count = counts.entry(owner).or_default();
            *count += 1;
            Name::Memory(*count - 1, Slot { owner, name: "memory", index: 0 })
        })
        .collect()
}

fn input_names(period: &PeriodGraph) -> Vec<Name> {
    let owners = period.inputs.iter().filter_map(|input| match input {
        Input::Memory { owner, .. } => Some(*owner),
        _ => None,
    });
    let mut memory = memory_names(owners).into_iter();
    let named = period.inputs.iter().map(|&input| match input {
        Input::State(slot) => Name::State(slot),
        Input::Params(slot) => Name::Params(slot),
        Input::Target { tap, .. } => target_name(tap, input.owner()),
        Input::Disturbance { .. } => {
            Name::Disturbance(Slot { owner: input.owner(), name: "disturbance", index: 0 })
        }
        Input::Weight { modification, slot } => Name::Weight(modification, slot),
        // As many names as there are such inputs.
        Input::Memory { owner, .. } => {
            memory.next().unwrap_or(Name::Memory(0, Slot { owner, name: "memory", index: 0 }))
        }
    });
    named.collect()
}

fn output_names(period: &PeriodGraph) -> Vec<Name> {
    let inputs = input_names(period);
    let memory: Vec<Name> = inputs.into_iter().filter(|name| matches!(name, Name::Memory(..))).collect();
    let named = period.outputs.iter().map(|output| match *output {
        Output::State(slot) => Name::State(slot),
        Output::Memory(place) => memory[place],
        Output::Target { joint } => target_name(0, Owner::Joint(joint)),
        Output::Report(slot) => Name::Report(slot),
    });
    named.collect()
}
