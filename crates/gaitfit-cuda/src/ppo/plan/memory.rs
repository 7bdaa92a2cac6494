//! The memories' part of an update: what stands before the networks, and the way back through it.

use super::super::launch::{Batch, Kind, Launch, Value};
use super::shared::TEAM;
use super::{CHUNK, Maker, launch, word};
use crate::runtime::Shape;
use gaitfit_policy::network::{Cell, RecurrentShape};

/// Threads of a block.
const THREADS: u32 = 256;
/// Rows whose derivatives a block adds up.
const ROWS: usize = 2048;
/// Columns and lines of what a block of `outer` computes; `TILE` of the text.
const TILE: usize = 32;

/// Sizes and arrays of both memories.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Memory {
    nets: [Net; 2],
    /// Parameters of the actor's memory, and of both.
    sizes: [usize; 2],
    steps: usize,
    environments: usize,
    minibatches: usize,
    chunks: usize,
    gpus: usize,
    /// With several GPUs: this one's gradient, two arrays that steps take in turn, and the gradients of all.
    own_shares: [Value; 2],
    shares: Value,
    /// Robots in the order of the minibatches, of every epoch.
    pub robots: Value,
    done: Value,
    parameters: Value,
    moments: Value,
    turned: Value,
    turn: Value,
    unit: Value,
    gradient: Value,
    partial: Value,
    squares: Value,
}

/// One network's memory, without layers if it has none.
#[derive(Clone, Debug, PartialEq)]
struct Net {
    shape: RecurrentShape,
    /// Where its parameters begin.
    offset: usize,
    observation: Value,
    scale: Value,
    /// Its state in each environment, and its state before the rollout.
    state: Value,
    start: Value,
    /// The first layer's input.
    taken: Value,
    /// Derivative by `taken`, of a network without a memory.
    derivative: Value,
    layers: Vec<Layer>,
}

#[derive(Clone, Debug, PartialEq)]
struct Layer {
    gates: Value,
    of_output: Value,
    output_before: Value,
    output: Value,
    cell_before: Value,
    cell: Value,
    derivative: Value,
}

/// Sequences that go through a memory.
struct Run {
    steps: usize,
    robots: usize,
    /// The first listed robot; all environments in order without one.
    from: Option<usize>,
    first_row: usize,
    input: Option<Value>,
    start: Value,
    start_first: usize,
    keep: bool,
}

/// Arrays of the samples that memories take.
pub(super) struct Samples {
    pub observations: [Value; 2],
    pub scales: [Value; 2],
    pub done: Value,
}

impl Memory {
    /// Adds the arrays to a plan. `rows`: of the largest minibatch.
    pub(super) fn new(
        m: &mut Maker,
        shapes: &[RecurrentShape; 2],
        batch: Batch,
        (minibatches, epochs): (usize, usize),
        samples: &Samples,
    ) -> Self {
        let Batch { steps, environments, share, .. } = batch;
        // Room for the largest minibatch of an update, and for a step of all environments in a rollout.
        let rows = (environments.div_ceil(minibatches) * steps).max(environments);
        let size: usize = shapes.iter().map(RecurrentShape::parameters).sum();
        let chunks = rows.div_ceil(ROWS);
        let shared = if share.count > 1 { size } else { 0 };
        let outputs: usize = shapes.iter().map(RecurrentShape::outputs).sum();
        let names = [
            ["actor_memory", "actor_start", "actor_taken"],
            ["critic_memory", "critic_start", "critic_taken"],
        ];
        let mut offset = 0;
        let nets = [0, 1].map(|number| {
            let (shape, [state, start, taken]) = (shapes[number].clone(), names[number]);
            // A GRU has no cell besides its output.
            let lstm = usize::from(shape.cell == Cell::Lstm);
            let layers = shape.layers().into_iter().map(|layer| {
                let (units, wide) = (rows * layer.hidden, rows * layer.hidden * shape.cell.gates());
                Layer {
                    gates: m.array("gates", Kind::F32, wide),
                    of_output: m.array("of_output", Kind::F32, wide),
                    output_before: m.array("output_before", Kind::F32, units),
                    output: m.array("output", Kind::F32, units),
                    cell_before: m.array("cell_before", Kind::F32, lstm * units),
                    cell: m.array("cell", Kind::F32, lstm * units),
                    derivative: m.array("derivative", Kind::F32, units),
                }
            });
            let layers = layers.collect();
            let net = Net {
                offset,
                observation: samples.observations[number],
                scale: samples.scales[number],
                state: m.array(state, Kind::F32, environments * shape.remembered()),
                start: m.array(start, Kind::F32, environments * shape.remembered()),
                taken: m.array(taken, Kind::F32, rows * shape.inputs),
                derivative: m.array(
                    "derivative",
                    Kind::F32,
                    if shape.hidden.is_empty() { rows * shape.inputs } else { 0 },
                ),
                layers,
                shape,
            };
            offset += net.shape.parameters();
            net
        });
        Self {
            sizes: [nets[0].shape.parameters(), size],
            nets,
            steps,
            environments,
            minibatches,
            chunks,
            gpus: share.count,
            own_shares: ["memory_share", "odd_memory_share"].map(|name| m.array(name, Kind::F32, shared)),
            shares: m.array("memory_shares", Kind::F32, share.count * shared),
            robots: m.array("robots", Kind::U32, epochs * environments),
            done: samples.done,
            parameters: m.array("memory_parameters", Kind::F32, size),
            moments: m.array("memory_moments", Kind::F32, 2 * size),
            turned: m.array("memory_turned", Kind::F32, size),
            turn: m.array("memory_turn", Kind::U32, size),
            unit: m.array("memory_unit", Kind::F32, 2 * outputs),
            gradient: m.array("memory_gradient", Kind::F32, size),
            partial: m.array("memory_partial", Kind::F32, chunks * size),
            squares: m.array("memory_squares", Kind::F64, 2 * size.div_ceil(THREADS as usize)),
        }
    }

    /// Factors of 1 and offsets of 0 of what the networks take.
    pub(super) fn unit(&self) -> Value {
        self.unit
    }

    /// Arrays that the networks take as input, and those that its derivatives go to.
    pub(super) fn seen(&self) -> [[Value; 2]; 2] {
        let none = |net: &Net| [net.taken, net.derivative];
        self.nets
            .each_ref()
            .map(|net| net.layers.last().map_or_else(|| none(net), |layer| [layer.output, layer.derivative]))
    }

    /// Squares of the gradient's norm, and how many there are of each network.
    pub(super) fn squares(&self) -> (Value, usize) {
        (self.squares, self.sizes[1].div_ceil(THREADS as usize))
    }

    /// Before an update.
    pub(super) fn begin(&self, control: Value) -> Launch {
        let arguments = [word(self.sizes[1]), control, self.moments];
        launch("memory_begin", Shape::cover(2 * self.sizes[1], THREADS), &arguments)
    }

    /// Rows of the samples in the order of the minibatches.
    pub(super) fn places(&self, epochs: usize, places: Value) -> Launch {
        let shape = Shape::cover(self.steps * self.environments, THREADS);
        let shape = Shape { grid: [shape.grid[0], epochs as u32, 1], ..shape };
        let numbers = [self.steps, self.environments, self.minibatches].map(word);
        launch("memory_places", shape, &[&numbers[..], &[self.robots, places]].concat())
    }

    /// Both memories over the robots of a minibatch.
    pub(super) fn forth(&self, epoch: usize, begin: usize, robots: usize) -> Vec<Launch> {
        let run = |net: &Net| Run {
            steps: self.steps,
            robots,
            from: Some(epoch * self.environments + begin),
            first_row: 0,
            input: None,
            start: net.start,
            start_first: 0,
            keep: false,
        };
        self.nets.iter().flat_map(|net| self.layers(net, &run(net))).collect()
    }

    /// Both memories over step `step` of a rollout, which they remember; before its first step what they remember is kept.
    pub(super) fn step(&self, step: usize) -> Vec<Launch> {
        let mut launches = Vec::new();
        for net in &self.nets {
            let count = self.environments * net.shape.remembered();
            if step == 0 {
                let shape = Shape::new(count.div_ceil(1024).clamp(1, 1024) as u32, THREADS);
                launches.push(launch("memory_copy", shape, &[word(count), net.state, net.start]));
            }
            launches.extend(
                self.layers(net, &self.once(net, net.observation, step * self.environments, 0, true)),
            );
        }
        launches
    }

    /// The critic's memory over the states that its caller observed, from row `part · environments` on, and two places of
    /// arguments: the observations, of the first launch, and what is remembered before them, of all launches of a memory.
    pub(super) fn tail(&self, part: usize) -> (Vec<Launch>, usize, Option<usize>) {
        let net = &self.nets[1];
        let first = part * self.environments;
        let start_first = part.saturating_sub(1) * self.environments;
        let launches = self.layers(net, &self.once(net, net.observation, first, start_first, false));
        // Places of `input` and `start` in the arguments of `pass_on`, and of `layers`.
        if net.layers.is_empty() { (launches, 8, None) } else { (launches, 18, Some(21)) }
    }

    fn once(&self, net: &Net, input: Value, first_row: usize, start_first: usize, keep: bool) -> Run {
        let (steps, robots) = (1, self.environments);
        Run { steps, robots, from: None, first_row, input: Some(input), start: net.state, start_first, keep }
    }

    fn layers(&self, net: &Net, run: &Run) -> Vec<Launch> {
        if net.layers.is_empty() {
            return vec![self.pass_on(net, run)];
        }
        let (shape, mut start_at) = (&net.shape, 0);
        let mut launches = Vec::new();
        for (index, (span, layer)) in shape.layers().iter().zip(&net.layers).enumerate() {
            let below = index.checked_sub(1).and_then(|below| net.layers.get(below));
            let flag = |yes: bool| word(usize::from(yes));
            let arguments = [
                word(run.steps),
                word(run.robots),
                word(run.from.unwrap_or(0)),
                flag(run.from.is_some()),
                word(self.environments),
                word(run.first_row),
                flag(below.is_some()),
                flag(below.is_none()),
                word(run.start_first),
                word(start_at),
                word(shape.remembered()),
                flag(run.keep),
                flag(run.steps > 1),
                word(shape.cell.gates()),
                word(span.inputs),
                word(span.hidden),
                word(net.offset + span.parts[0].start),
                self.robots,
                below.map_or(run.input.unwrap_or(net.observation), |below| below.output),
                net.scale,
                self.done,
                run.start,
                self.parameters,
                net.taken,
                layer.gates,
                layer.of_output,
                layer.output_before,
                layer.output,
                layer.cell_before,
                layer.cell,
            ];
            let shared = (4 * TEAM * (span.inputs + span.hidden)) as u32;
            let shape_of = Shape { shared, ..Shape::new(run.robots.div_ceil(TEAM) as u32, THREADS) };
            launches.push(launch("remember", shape_of, &arguments));
            start_at += shape.cell.remembered() * span.hidden;
        }
        launches
    }

    /// Rows of a network without a memory, in the order of those behind memories.
    fn pass_on(&self, net: &Net, run: &Run) -> Launch {
        let arguments = [
            word(run.steps),
            word(run.robots),
            word(run.from.unwrap_or(0)),
            word(usize::from(run.from.is_some())),
            word(self.environments),
            word(run.first_row),
            word(net.shape.inputs),
            self.robots,
            run.input.unwrap_or(net.observation),
            net.scale,
            net.taken,
        ];
        launch("pass_on", Shape::cover(run.steps * run.robots * net.shape.inputs, THREADS), &arguments)
    }

    /// The way back of a minibatch, to the gradient of the memories; `turn`: which of this GPU's arrays takes it, of several GPUs.
    pub(super) fn back(
        &self,
        (control, turn): (Value, usize),
        epoch: usize,
        begin: usize,
        robots: usize,
    ) -> Vec<Launch> {
        let rows = self.steps * robots;
        let from = epoch * self.environments + begin;
        let mut launches = Vec::new();
        for net in &self.nets {
            let cell = net.shape.cell;
            // From the last layer back: each gives the one below it its derivative.
            for (index, (span, layer)) in net.shape.layers().iter().zip(&net.layers).enumerate().rev() {
                let wide = cell.gates() * span.hidden;
                let places = span.parts.each_ref().map(|range| net.offset + range.start);
                let numbers =
                    [self.steps, robots, from, self.environments, cell.gates(), span.hidden, places[1]];
                let arrays = [
                    self.robots,
                    self.done,
                    self.turned,
                    layer.derivative,
                    layer.gates,
                    layer.of_output,
                    layer.output_before,
                    layer.cell_before,
                    layer.cell,
                ];
                let shape = Shape::new(robots.div_ceil(TEAM) as u32, THREADS);
                let shape = Shape { shared: (4 * TEAM * (2 * span.hidden + wide)) as u32, ..shape };
                launches.push(launch("recall", shape, &[&numbers.map(word)[..], &arrays].concat()));
                let below = index.checked_sub(1).and_then(|below| net.layers.get(below));
                if let Some(below) = below {
                    let shape = Shape::new(rows.div_ceil(TEAM) as u32, THREADS);
                    let shape = Shape { shared: (4 * TEAM * wide) as u32, ..shape };
                    let numbers = [rows, span.inputs, wide, places[0]].map(word);
                    let arrays = [self.turned, layer.gates, below.derivative];
                    launches.push(launch("pass_down", shape, &[&numbers[..], &arrays].concat()));
                }
                let products = if cell == Cell::Lstm { layer.gates } else { layer.of_output };
                let input = below.map_or(net.taken, |below| below.output);
                for (inputs, weight, bias, left, right) in [
                    (span.inputs, places[0], places[2], input, layer.gates),
                    (span.hidden, places[1], places[3], layer.output_before, products),
                ] {
                    let tiles = (inputs + 1).div_ceil(TILE) * wide.div_ceil(TILE);
                    let shape = Shape::new(self.chunks as u32, THREADS);
                    let shape = Shape { grid: [shape.grid[0], tiles as u32, 1], ..shape };
                    let numbers = [rows, ROWS, inputs, wide, weight, bias, self.sizes[1]].map(word);
                    launches.push(launch(
                        "outer",
                        shape,
                        &[&numbers[..], &[left, right, self.partial]].concat(),
                    ));
                }
            }
        }
        let to = if self.gpus > 1 { self.own_shares[turn] } else { self.gradient };
        launches.push(self.reduce(self.chunks, self.partial, control, to));
        launches
    }

    /// The gradient as the sum of some parts, in order.
    fn reduce(&self, parts: usize, partial: Value, control: Value, to: Value) -> Launch {
        let numbers = [parts, self.sizes[1], self.sizes[0]].map(word);
        let arrays = [control, partial, to, self.squares];
        let shape = Shape::cover(self.sizes[1], THREADS);
        launch("memory_reduce", shape, &[&numbers[..], &arrays].concat())
    }

    /// With several GPUs: the arrays of this one's gradient and of the gradients of all.
    pub(super) fn shares(&self, turn: usize) -> [Value; 2] {
        [self.own_shares[turn], self.shares]
    }

    /// The gradient of all GPUs from their gradients.
    pub(super) fn together(&self, control: Value) -> Launch {
        self.reduce(self.gpus, self.shares, control, self.gradient)
    }

    /// A step of Adam; `copy`: renews the transposed copy without a step.
    pub(super) fn adam(&self, copy: bool, control: Value, state: Value) -> Launch {
        let arguments = [
            word(usize::from(copy)),
            word(self.sizes[1]),
            word(self.sizes[0]),
            control,
            state,
            self.turn,
            self.gradient,
            self.moments,
            self.parameters,
            self.turned,
        ];
        launch("memory_adam", Shape::cover(self.sizes[1], THREADS), &arguments)
    }

    /// After a step: ended episodes are forgotten. The arguments 8 and 9 are the caller's `cut` and `tail_memory`.
    pub(super) fn forget(&self, step: usize, cuts: usize) -> (Launch, [usize; 2]) {
        let [actor, critic] = &self.nets;
        let arguments = [
            word(step),
            word(self.environments),
            word(cuts),
            word(actor.shape.remembered()),
            word(critic.shape.remembered()),
            self.done,
            actor.state,
            critic.state,
            self.robots,
            self.robots,
        ];
        (launch("forget", Shape::cover(self.environments, CHUNK as u32), &arguments), [8, 9])
    }
}
