//! A control period as a graph, its inputs and outputs by name.

use super::graph::{Graph, TraceError};
use super::record::{Loop, record};
use super::scalar::{Known, Traced};
use crate::modify::memory_owners;
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
    /// A number that the modifications remember.
    Memory {
        /// Its place.
        index: usize,
        /// What it belongs to.
        owner: Owner,
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
            Input::Target { joint, .. } => Owner::Joint(joint),
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
    let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
    let mut modifications = modifications.to_vec();
    let graph = record(|| {
        let mut input = |what| {
            inputs.push(what);
            Traced::input()
        };
        let joints = tree.joints();
        let mut state = State::<Traced>::new(tree);
        state.visit_mut(|slot, number| *number = input(Input::State(slot)));
        let mut params = Params::<Traced>::zeros(tree.links.len(), joints, tree.pairs.len());
        params.visit_mut(|slot, number| *number = input(Input::Params(slot)));
        let mut targets: Vec<Traced> = (0..taps * joints)
            .map(|index| input(Input::Target { tap: index / joints, joint: index % joints }))
            .collect();
        let owners = memory_owners(&modifications);
        let mut memory: Vec<Traced> =
            owners.iter().enumerate().map(|(index, &owner)| input(Input::Memory { index, owner })).collect();
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
            disturbance: &[],
            modifications: &modifications,
            memory: &mut memory,
            substeps,
            state: &mut state,
            work: &mut work,
            drives: &mut drives,
        };
        phase::begin(&mut period);
        let mut clock = Traced::zero();
        let steps = Loop::begin(substeps, handed_on(&mut period, &mut clock));
        phase::before(&mut period, clock, &[]);
        let turns = Loop::begin(tree.settings.iterations, iterated(&mut period));
        phase::iterate(&mut period, false);
        turns.end(iterated(&mut period));
        phase::after(&mut period);
        clock = clock + Traced::lit(1.0);
        steps.end(handed_on(&mut period, &mut clock));

        let mut all = Vec::new();
        state.visit(|slot, &number| {
            outputs.push(Output::State(slot));
            all.push(number);
        });
        outputs.extend((0..memory.len()).map(Output::Memory));
        all.extend(memory);
        all
    })?;
    Ok(PeriodGraph { graph, inputs, outputs })
}

/// What one physics step hands to the next.
fn handed_on<'a>(period: &'a mut Period<'_, Traced>, clock: &'a mut Traced) -> Vec<&'a mut Traced> {
    let mut all = vec![clock];
    period.state.visit_mut(|_, number| all.push(number));
    all.extend(&mut *period.memory);
    all
}

/// What one iteration of the solver hands to the next.
fn iterated<'a>(period: &'a mut Period<'_, Traced>) -> Vec<&'a mut Traced> {
    phase::carried(period.tree, period.state, period.work)
}
