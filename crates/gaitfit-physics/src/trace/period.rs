//! A control period as a graph, its inputs and outputs by name.

use std::collections::HashMap;

use super::graph::{Graph, TraceError};
use super::record::{Loop, record};
use super::scalar::{Known, Traced};
use crate::modify::memory_places;
use crate::{Drive, JointModification, Modify, Owner, Params, Period, Real, Slot, State, Tree, Work, phase};

/// What an input of a recorded control period is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Input {
    /// A number of the state at its start.
    State(Slot),
    /// A parameter of the environment.
    Params(Slot),
    /// A sent target: `tap` control periods old, of a joint, rad.
    Target {
        /// Control periods since it was sent.
        tap: usize,
        /// The joint.
        joint: usize,
    },
    /// The disturbing torque on a joint, N·m: another number in each turn of the loop over physics steps.
    Disturbance {
        /// The joint.
        joint: usize,
    },
    /// A number that the modifications remember.
    Memory {
        /// Its place.
        index: usize,
        /// What it belongs to.
        owner: Owner,
        /// Whether it is 0 for a robot that has been in a state for long; else it is of the joint's motion.
        zero: bool,
    },
    /// A weight of a modification's network; the same for all environments of a candidate.
    Weight {
        /// Number of the modification.
        modification: usize,
        /// The weight.
        slot: Slot,
    },
}

impl Input {
    /// What it belongs to.
    pub fn owner(&self) -> Owner {
        match *self {
            Input::State(slot) | Input::Params(slot) | Input::Weight { slot, .. } => slot.owner,
            Input::Target { joint, .. } | Input::Disturbance { joint } => Owner::Joint(joint),
            Input::Memory { owner, .. } => owner,
        }
    }
}

/// What an output of a recorded control period is.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Output {
    /// A number of the state at its end.
    State(Slot),
    /// A number that the modifications remember.
    Memory(usize),
    /// The newest target of a joint as modifications corrected it, rad: later periods, which it is an older one of, take
    /// it so. Told where targets are corrected and older ones act.
    Target {
        /// The joint.
        joint: usize,
    },
    /// What a [`Report`] asks for: `torque` of a joint, `normal_force` of a compiled pair, `place` of one.
    Report(Slot),
}

/// What a recorded control period takes and tells besides robots, targets and states.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Report {
    /// Torques that disturb the joints in each physics step are among the inputs.
    pub disturbed: bool,
    /// Of the last physics step: the joints' torques (N·m: the motors', with modifications and disturbances) and the normal force on every compiled pair (N).
    pub forces: bool,
    /// Compiled pairs whose centres are told: at the start of the last physics step, m, world axes.
    pub tracked: Vec<usize>,
    /// Parameters that every robot has alike ([`Kept`](crate::Kept)): constants of the recording. Their inputs are there,
    /// and no operation takes them.
    pub fixed: Vec<(Slot, f64)>,
}

/// A recorded control period.
#[derive(Clone, Debug, PartialEq)]
pub struct PeriodGraph {
    /// The operations.
    pub graph: Graph,
    /// What each input is.
    pub inputs: Vec<Input>,
    /// What each output is.
    pub outputs: Vec<Output>,
}

/// Records a control period of `substeps` physics steps with `taps` sent targets. Both loops, over physics steps and of
/// the solver, stay loops.
///
/// # Errors
/// A step that passes a number out of a region otherwise than by [`Real::merge`].
pub fn record_period(
    tree: &Tree<Known>,
    taps: usize,
    substeps: usize,
    modifications: &[JointModification<Known>],
) -> Result<PeriodGraph, TraceError> {
    record_period_with(tree, taps, substeps, modifications, &Report::default())
}

/// As [`record_period`], with what `report` asks for among the outputs.
///
/// # Errors
/// As there.
pub fn record_period_with(
    tree: &Tree<Known>,
    taps: usize,
    substeps: usize,
    modifications: &[JointModification<Known>],
    report: &Report,
) -> Result<PeriodGraph, TraceError> {
    let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
    let mut modifications = modifications.to_vec();
    let graph = record(|| {
        // Inputs get their numbers in the order of creation, so this list names them.
        let mut input = |what| {
            inputs.push(what);
            Traced::input()
        };
        let joints = tree.joints();
        let mut state = State::<Traced>::new(tree);
        state.visit_mut(|slot, number| *number = input(Input::State(slot)));
        let mut params = Params::<Traced>::zeros(tree.links.len(), joints, tree.all_pairs());
        // `zeros` makes no numbers of a free joint.
        params.free = vec![Traced::zero(); tree.free_weights()];
        let fixed: HashMap<Slot, f64> = report.fixed.iter().copied().collect();
        params.visit_mut(|slot, number| {
            // A fixed parameter gets an input too, so that the list of inputs is the same whatever is fixed.
            let given = input(Input::Params(slot));
            *number = fixed.get(&slot).map_or(given, |&value| Traced::lit(value));
        });
        let mut targets: Vec<Traced> = (0..taps * joints)
            .map(|index| input(Input::Target { tap: index / joints, joint: index % joints }))
            .collect();
        let disturbed = if report.disturbed { 0..joints } else { 0..0 };
        let disturbance: Vec<Traced> = disturbed.map(|joint| input(Input::Disturbance { joint })).collect();
        let places = memory_places(&modifications).into_iter().enumerate();
        let mut memory: Vec<Traced> =
            places.map(|(index, (owner, zero))| input(Input::Memory { index, owner, zero })).collect();
        for (modification, one) in modifications.iter_mut().enumerate() {
            one.visit_weights_mut(|slot, weight| {
                *weight = Known::Number(input(Input::Weight { modification, slot }));
            });
        }
        let (mut work, mut drives) = (Work::new(tree), vec![Drive::zero(); joints]);
        let mut period = Period {
            tree,
            params: &params,
            targets: &mut targets,
            // The loop below gives these torques to `before` in each turn.
            disturbance: &[],
            modifications: &modifications,
            memory: &mut memory,
            substeps,
            state: &mut state,
            work: &mut work,
            drives: &mut drives,
        };
        begin(&mut period);
        // The clock counts physics steps. It is carried, because one recorded turn serves all steps.
        let mut clock = Traced::zero();
        let slots = reported(tree, report);
        // Carried numbers need a value before the first turn. Every turn replaces these.
        let mut shown = vec![Traced::zero(); slots.len()];
        let mut forces = vec![Traced::zero(); if report.forces { tree.pairs.len() } else { 0 }];
        let steps = Loop::begin(substeps, handed_on(&mut period, &mut clock, &mut shown));
        before(&mut period, clock, &disturbance);
        let turns = Loop::begin(tree.settings.iterations, iterated(&mut period, &mut forces));
        iterate(&mut period);
        // A force is known inside the solver's loop alone.
        for (pair, force) in forces.iter_mut().enumerate() {
            *force = period.work.normal_force(tree, pair);
        }
        turns.end(iterated(&mut period, &mut forces));
        after(&mut period);
        show(&period, report, &forces, &mut shown);
        clock = clock + Traced::lit(1.0);
        steps.end(handed_on(&mut period, &mut clock, &mut shown));

        let mut all = Vec::new();
        state.visit(|slot, &number| {
            outputs.push(Output::State(slot));
            all.push(number);
        });
        outputs.extend((0..memory.len()).map(Output::Memory));
        all.extend(memory);
        let corrected = modifications.iter().any(|one| matches!(one, JointModification::ActionDelta(_)));
        // With one tap no later period reads an older target, so nobody needs the corrected one.
        let observed = if corrected && taps > 1 { 0..joints } else { 0..0 };
        outputs.extend(observed.clone().map(|joint| Output::Target { joint }));
        // The targets of tap 0, which are the newest, come first.
        all.extend_from_slice(&targets[observed]);
        outputs.extend(slots.into_iter().map(Output::Report));
        all.extend(shown);
        all
    })?;
    Ok(PeriodGraph { graph, inputs, outputs })
}

// The phases in functions that own nothing: where there is something to drop, the compiler plans for a panic in each of
// the thousands of operations, and takes a minute longer.

#[inline(never)]
fn begin(period: &mut Period<'_, Traced>) {
    phase::begin(period);
}

#[inline(never)]
fn before(period: &mut Period<'_, Traced>, clock: Traced, disturbance: &[Traced]) {
    phase::before(period, clock, disturbance);
}

#[inline(never)]
fn iterate(period: &mut Period<'_, Traced>) {
    // One recording serves all turns of the loop, so no turn may leave out what a further one reads.
    phase::iterate(period, false);
}

#[inline(never)]
fn after(period: &mut Period<'_, Traced>) {
    phase::after(period);
}

/// What one physics step hands to the next, and what it shows, which only the last one leaves.
fn handed_on<'a>(
    period: &'a mut Period<'_, Traced>,
    clock: &'a mut Traced,
    shown: &'a mut [Traced],
) -> Vec<&'a mut Traced> {
    let mut all = vec![clock];
    period.state.visit_mut(|_, number| all.push(number));
    all.extend(&mut *period.memory);
    all.extend(shown);
    all
}

/// What one iteration of the solver hands to the next, and the forces that it computed.
fn iterated<'a>(period: &'a mut Period<'_, Traced>, forces: &'a mut [Traced]) -> Vec<&'a mut Traced> {
    let mut all = phase::carried(period.tree, period.state, period.work);
    all.extend(forces);
    all
}

/// Names of what a report asks for, in the order of [`show`].
fn reported(tree: &Tree<Known>, report: &Report) -> Vec<Slot> {
    let mut slots = Vec::new();
    if report.forces {
        slots.extend((0..tree.joints()).map(|joint| Slot::new(Owner::Joint(joint), "torque")));
        slots.extend((0..tree.pairs.len()).map(|pair| Slot::new(Owner::Pair(pair), "normal_force")));
    }
    for &pair in &report.tracked {
        slots.extend((0..3).map(|index| Slot { index, ..Slot::new(Owner::Pair(pair), "place") }));
    }
    slots
}

/// What a report asks for, after a physics step.
fn show(period: &Period<'_, Traced>, report: &Report, forces: &[Traced], shown: &mut [Traced]) {
    let mut all = Vec::with_capacity(shown.len());
    if report.forces {
        all.extend(period.drives.iter().map(|drive| drive.torque));
        all.extend(forces);
    }
    // Places are about the base's origin at the start of the step.
    let h = Traced::lit(period.tree.settings.timestep);
    for &pair in &report.tracked {
        let center = period.work.pair_center(period.tree, pair);
        for k in 0..3 {
            // The step moved the base by h times its new velocity: taken off, its place at the start is left.
            all.push(h.fnma(period.state.base_linear[k], period.state.base_position[k]) + center[k]);
        }
    }
    shown.copy_from_slice(&all);
}
