//! A policy as a graph of operators that runs node by node, for inference: whatever is no plain perceptron.
//!
//! A graph is written for one robot. Every value has a fixed shape, the one that it has for one robot, axes of length one
//! for rows and time steps included. So shapes are checked when the file is read, and the same steps run for any number of
//! robots: a value is `rows × count` numbers, and an operator never looks beyond a row.
//!
//! `gaitfit-policy-files` makes a [`Plan`] of an ONNX file, and checks all its sizes. Nothing is checked here.

mod along;
mod elementwise;
mod inputs;
mod product;

pub use along::{Along, Reduction};
pub use elementwise::{Binary, Function, Reach};
pub use inputs::{Frames, Inputs, Taken};

use crate::network::{Cell, Memory, RecurrentLayer, Scratch};
use std::sync::Arc;

/// Robots that pass through all steps together, so that values stay small.
const TILE: usize = 64;

/// A graph at work. It is read from an ONNX file, and refused by trainings and GPUs.
#[derive(Clone, Debug, PartialEq)]
pub struct Graph {
    plan: Arc<Plan>,
}

/// Inputs, steps and output of a graph.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Plan {
    /// Width of the observation.
    pub observed: usize,
    /// Inputs that take numbers of the observation.
    pub feeds: Vec<Feed>,
    /// Inputs that take an output of the step before; zeros at an episode's start.
    pub carried: Vec<Carried>,
    /// Steps, in the order in which they are computed.
    pub steps: Vec<Step>,
    /// Numbers that are the same for all robots.
    pub constants: Vec<Vec<f32>>,
    /// Numbers of each value, a robot.
    pub counts: Vec<usize>,
    /// Where the actions are.
    pub actions: Operand,
    /// Number of actions.
    pub outputs: usize,
    /// The file: an ONNX model that holds all its numbers.
    pub source: Vec<u8>,
    /// Numbers that each input takes, as descriptions write it.
    pub inputs: Inputs,
    /// The output that is the action.
    pub output: String,
}

/// An input of the graph that takes numbers of the observation.
#[derive(Clone, Debug, PartialEq)]
pub struct Feed {
    /// Its name in the file.
    pub name: String,
    /// The value that it is.
    pub value: usize,
    /// Places in the observation.
    pub places: Vec<usize>,
}

/// An output that becomes an input one control step later.
#[derive(Clone, Debug, PartialEq)]
pub struct Carried {
    /// The input's name in the file.
    pub name: String,
    /// The value that the input is.
    pub value: usize,
    /// Value that becomes the input.
    pub from: Operand,
    /// Its numbers a robot.
    pub count: usize,
}

/// An input of an operator.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Operand {
    /// A value, by its place in [`Plan::counts`].
    Value(usize),
    /// A constant, by its place in [`Plan::constants`].
    Constant(usize),
}

impl Default for Operand {
    fn default() -> Self {
        Self::Value(0)
    }
}

/// One operator.
#[derive(Clone, Debug, PartialEq)]
pub struct Step {
    /// What it does.
    pub operator: Operator,
    /// Its operands.
    pub inputs: Vec<Operand>,
    /// The value that it gives.
    pub output: usize,
}

/// The operator of a step.
#[derive(Clone, Debug, PartialEq)]
pub enum Operator {
    /// Number by number: the input and the place that it is taken from. Cuts, joins, turns and repeats are all this.
    Take(Vec<[u32; 2]>),
    /// A function of each number.
    Function(Function),
    /// A function of two operands, and which of their numbers meet.
    Binary(Binary, [Reach; 2]),
    /// The second where the first is not zero, else the third.
    Choose([Reach; 3]),
    /// The last axis, of `inner` numbers, times a constant matrix `inner × outer`.
    Product {
        /// Numbers of the last axis.
        inner: usize,
        /// Numbers that come of it.
        outer: usize,
    },
    /// `many` products of matrices, `rows × inner` and `inner × outer`; a factor that is not repeated is there once.
    Products {
        /// Number of products.
        many: usize,
        /// Rows of the first factor.
        rows: usize,
        /// Its columns, rows of the second.
        inner: usize,
        /// Columns of the second.
        outer: usize,
        /// Whether there are many matrices of each factor.
        repeated: [bool; 2],
    },
    /// Sums and the like: where each number of the input goes, and how many go to each number of the output.
    Reduce {
        /// Reduction of the numbers that go to the same place.
        what: Reduction,
        /// Place in the output of each number of the input.
        to: Vec<u32>,
        /// Numbers that go to a place.
        each: usize,
    },
    /// A function of the numbers along an axis of `length`, `stride` apart.
    Along {
        /// The function.
        what: Along,
        /// Numbers along the axis.
        length: usize,
        /// Distance between neighbours along the axis.
        stride: usize,
    },
    /// A recurrent layer along `times` time steps: inputs, output before and, of an LSTM, its cell before. It gives all
    /// outputs, then the last output and cell.
    Recurrent {
        /// Its kind.
        cell: Cell,
        /// Its numbers.
        layer: Box<RecurrentLayer>,
        /// Time steps.
        times: usize,
    },
}

impl Graph {
    /// A graph that does what `plan` says. A plan whose places and sizes do not fit panics when it acts.
    pub fn new(plan: Plan) -> Self {
        Self { plan: Arc::new(plan) }
    }

    /// What it does.
    pub fn plan(&self) -> &Plan {
        &self.plan
    }

    /// Width of the observation that it takes.
    pub fn inputs(&self) -> usize {
        self.plan.observed
    }

    /// Actions that it gives.
    pub fn outputs(&self) -> usize {
        self.plan.outputs
    }

    /// Whether it takes outputs of the step before.
    pub fn is_recurrent(&self) -> bool {
        !self.plan.carried.is_empty()
    }

    /// In words: operators, inputs, and what is carried from one step to the next.
    pub fn describe(&self) -> String {
        let plan = &self.plan;
        let feeds = plan.feeds.iter().map(|feed| format!("{} ({} numbers)", feed.name, feed.places.len()));
        let carried = plan.carried.iter().map(|one| format!("{} ({} remembered)", one.name, one.count));
        let inputs: Vec<String> = feeds.chain(carried).collect();
        format!("a graph of {} operators, inputs {}", plan.steps.len(), inputs.join(", "))
    }

    /// Nothing remembered, for `environments` robots.
    pub fn memory(&self, environments: usize) -> Memory {
        Memory::zeros(self.plan.carried.iter().map(|one| one.count), environments)
    }

    /// Actions, `rows × outputs`, of `rows` robots, which `memory` remembers.
    ///
    /// # Panics
    /// If an array is too short: an error of the caller.
    pub fn act(
        &self,
        rows: usize,
        observation: &[f32],
        memory: &mut Memory,
        actions: &mut Vec<f32>,
        scratch: &mut Scratch,
    ) {
        let plan = &*self.plan;
        actions.clear();
        let mut values = std::mem::take(scratch.values());
        // Never fewer than before: policies of several graphs share the thread's lists.
        values.resize_with(plan.counts.len().max(values.len()), Vec::new);
        // Each tile: its inputs, all operators, its actions, and what it remembers for the next control step.
        for first in (0..rows).step_by(TILE) {
            let rows = TILE.min(rows - first);
            for feed in &plan.feeds {
                let value = &mut values[feed.value];
                value.clear();
                let robots = observation[first * plan.observed..].chunks_exact(plan.observed).take(rows);
                robots.for_each(|robot| value.extend(feed.places.iter().map(|&place| robot[place])));
            }
            // The memory of the control step before is an input like any other.
            for (number, one) in plan.carried.iter().enumerate() {
                let kept = &memory.of_kind(number)[first * one.count..(first + rows) * one.count];
                values[one.value].clear();
                values[one.value].extend_from_slice(kept);
            }
            for step in &plan.steps {
                plan.step(step, rows, &mut values);
            }
            // Tiles come in the order of the robots, so each one's actions are appended.
            plan.copy(plan.actions, rows, &values, actions);
            for (number, one) in plan.carried.iter().enumerate() {
                // All outputs were computed from the old memory, so now each part of it may be replaced.
                let mut new = Vec::with_capacity(rows * one.count);
                plan.copy(one.from, rows, &values, &mut new);
                memory.of_kind(number)[first * one.count..(first + rows) * one.count].copy_from_slice(&new);
            }
        }
        *scratch.values() = values;
    }
}

/// An operand's numbers: `count` a robot, the same for all robots where it is a constant.
#[derive(Clone, Copy)]
struct Numbers<'a> {
    all: &'a [f32],
    count: usize,
    constant: bool,
}

impl<'a> Numbers<'a> {
    fn row(&self, row: usize) -> &'a [f32] {
        let row = if self.constant { 0 } else { row };
        &self.all[row * self.count..(row + 1) * self.count]
    }
}

impl Plan {
    fn numbers<'a>(&'a self, operand: Operand, values: &'a [Vec<f32>]) -> Numbers<'a> {
        match operand {
            Operand::Value(value) => {
                Numbers { all: &values[value], count: self.counts[value], constant: false }
            }
            Operand::Constant(constant) => {
                let all = &self.constants[constant];
                Numbers { all, count: all.len(), constant: true }
            }
        }
    }

    fn copy(&self, operand: Operand, rows: usize, values: &[Vec<f32>], to: &mut Vec<f32>) {
        let numbers = self.numbers(operand, values);
        (0..rows).for_each(|row| to.extend_from_slice(numbers.row(row)));
    }

    /// Runs one step for `rows` robots.
    fn step(&self, step: &Step, rows: usize, values: &mut [Vec<f32>]) {
        let mut out = std::mem::take(&mut values[step.output]);
        let count = self.counts[step.output];
        out.clear();
        out.resize(rows * count, 0.0);
        {
            // The output was taken out of the list, so that inputs can be borrowed while it is written.
            let values = &*values;
            let input = |number: usize| self.numbers(step.inputs[number], values);
            match &step.operator {
                Operator::Take(places) => {
                    let inputs: Vec<Numbers<'_>> = (0..step.inputs.len()).map(input).collect();
                    for (row, out) in out.chunks_exact_mut(count).enumerate() {
                        let inputs: Vec<&[f32]> = inputs.iter().map(|input| input.row(row)).collect();
                        for (out, &[from, place]) in out.iter_mut().zip(places) {
                            *out = inputs[from as usize][place as usize];
                        }
                    }
                }
                Operator::Function(function) => {
                    // Functions work in place: the input is copied into the output first.
                    let input = input(0);
                    out.chunks_exact_mut(count)
                        .enumerate()
                        .for_each(|(row, out)| out.copy_from_slice(input.row(row)));
                    function.apply(&mut out);
                }
                Operator::Binary(binary, reach) => {
                    let (a, b) = (input(0), input(1));
                    for (row, out) in out.chunks_exact_mut(count).enumerate() {
                        binary.apply(out, (a.row(row), &reach[0]), (b.row(row), &reach[1]));
                    }
                }
                Operator::Choose(reach) => {
                    let (when, a, b) = (input(0), input(1), input(2));
                    for (row, out) in out.chunks_exact_mut(count).enumerate() {
                        let (when, a, b) = (when.row(row), a.row(row), b.row(row));
                        for (place, out) in out.iter_mut().enumerate() {
                            let chosen = when[reach[0].at(place)] != 0.0;
                            *out = if chosen { a[reach[1].at(place)] } else { b[reach[2].at(place)] };
                        }
                    }
                }
                Operator::Product { inner, outer } => {
                    product::by_constant(&mut out, rows, input(0), input(1), [*inner, *outer]);
                }
                Operator::Products { many, rows: height, inner, outer, repeated } => {
                    let (a, b) = (input(0), input(1));
                    for (row, out) in out.chunks_exact_mut(count).enumerate() {
                        let sizes = [*many, *height, *inner, *outer];
                        product::of_both(out, a.row(row), b.row(row), sizes, *repeated);
                    }
                }
                Operator::Reduce { what, to, each } => {
                    let input = input(0);
                    for (row, out) in out.chunks_exact_mut(count).enumerate() {
                        what.apply(out, input.row(row), to, *each);
                    }
                }
                Operator::Along { what, length, stride } => {
                    let input = input(0);
                    for (row, out) in out.chunks_exact_mut(count).enumerate() {
                        what.apply(out, input.row(row), *length, *stride);
                    }
                }
                Operator::Recurrent { cell, layer, times } => {
                    // A state may be a constant, which stands there once: each robot gets its copy.
                    let before = |number: usize| {
                        let mut state = Vec::with_capacity(rows * layer.hidden);
                        self.copy(step.inputs[number], rows, values, &mut state);
                        state
                    };
                    let before: Vec<Vec<f32>> = (1..step.inputs.len()).map(before).collect();
                    let x = input(0);
                    layer.along(*cell, (rows, *times), |row| x.row(row), &before, &mut out);
                }
            }
        }
        values[step.output] = out;
    }

    /// The numbers of a step whose inputs are all constants.
    pub fn constant_of(&self, step: &Step) -> Vec<f32> {
        // What is made of constants is the same for all robots: one row stands for them.
        let mut values = vec![Vec::new(); self.counts.len()];
        self.step(step, 1, &mut values);
        std::mem::take(&mut values[step.output])
    }
}
