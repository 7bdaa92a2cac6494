//! A program computed in `f64` by all lanes of one environment, to test it.

use std::ops::Range;

use super::PeriodProgram;
use super::op::Op;
use super::program::{Kind, Program};

/// The most lanes of an environment.
pub const MAX_LANES: usize = 4;

type Row = [f64; MAX_LANES];

impl PeriodProgram {
    /// The recording's outputs for the recording's inputs. Numbers of regions that no lane needs are NaN.
    pub fn evaluate(&self, inputs: &[f64]) -> Vec<f64> {
        let mut rows = vec![[f64::NAN; MAX_LANES]; self.inputs.len()];
        for (&(lane, twin), &value) in self.inputs.iter().zip(inputs) {
            match lane {
                Some(lane) => rows[twin as usize][lane] = value,
                None => rows[twin as usize] = [value; MAX_LANES],
            }
        }
        let values = self.program.evaluate(&rows);
        self.outputs
            .iter()
            .map(|&(lane, place)| {
                let node = self.program.outputs[place as usize];
                values[node as usize][lane.unwrap_or(0)]
            })
            .collect()
    }
}

impl Program {
    /// Every node's number in every lane, for inputs by the recording's numbers.
    fn evaluate(&self, inputs: &[Row]) -> Vec<Row> {
        let mut values = vec![[f64::NAN; MAX_LANES]; self.nodes.len()];
        self.run(None, 0..self.nodes.len() as u32, inputs, &mut values);
        values
    }

    fn run(&self, parent: Option<u32>, nodes: Range<u32>, inputs: &[Row], values: &mut [Row]) {
        let mut at = nodes.start;
        let inner = self.regions.iter().enumerate();
        // Regions come in the order in which they begin: nodes between two of them run one by one.
        for (index, region) in inner.filter(|(_, region)| region.parent == parent) {
            self.line(at..region.nodes.start, inputs, values);
            at = region.nodes.end;
            match &region.kind {
                Kind::Guarded(guard) => {
                    // Lane 0 speaks for all: a guard is the same in every lane.
                    if values[*guard as usize][0] == 0.0 {
                        // NaN shows in the outputs if something reads what was not computed.
                        values[region.nodes.start as usize..at as usize].fill([f64::NAN; MAX_LANES]);
                    } else {
                        self.run(Some(index as u32), region.nodes.clone(), inputs, values);
                    }
                }
                Kind::Loop { count, carried } => {
                    let mut now: Vec<Row> = carried.iter().map(|one| values[one.0 as usize]).collect();
                    for _ in 0..*count {
                        self.hand(index as u32, &now, false, values);
                        self.run(Some(index as u32), region.nodes.clone(), inputs, values);
                        now = carried.iter().map(|one| values[one.1 as usize]).collect();
                    }
                    self.hand(index as u32, &now, true, values);
                }
            }
        }
        self.line(at..nodes.end, inputs, values);
    }

    /// Writes what a loop hands on, or its results.
    fn hand(&self, region: u32, now: &[Row], result: bool, values: &mut [Row]) {
        for (index, node) in self.nodes.iter().enumerate() {
            match node.op {
                Op::Variable(own, place) if own == region && !result => values[index] = now[place as usize],
                Op::Result(own, place) if own == region && result => values[index] = now[place as usize],
                _ => {}
            }
        }
    }

    fn line(&self, nodes: Range<u32>, inputs: &[Row], values: &mut [Row]) {
        for index in nodes {
            let node = self.nodes[index as usize];
            let operands = node.args.map(|operand| values[operand as usize]);
            let lanes = operands[0].iter().take(self.lanes).copied();
            // Operations over all lanes give every lane the same number.
            let whole = match node.op {
                Op::Variable(..) | Op::Result(..) => continue,
                Op::LaneSum => Some(lanes.sum()),
                Op::LaneMax => Some(lanes.fold(f64::MIN, f64::max)),
                Op::LaneMin => Some(lanes.fold(f64::MAX, f64::min)),
                Op::Unless => {
                    let [a, b, ..] = operands;
                    let all = (0..self.lanes).all(|lane| a[lane] >= b[lane]);
                    Some(f64::from(u8::from(!all)))
                }
                _ => None,
            };
            let row = std::array::from_fn(|lane| {
                let [a, b, c, d] = operands.map(|operand| operand[lane]);
                match node.op {
                    Op::Constant(bits) => f64::from_bits(bits),
                    Op::Table(row) => self.table[row as usize].get(lane).copied().unwrap_or(f64::NAN),
                    Op::Input(number) => inputs[number as usize][lane],
                    Op::Add => a + b,
                    Op::Sub => a - b,
                    Op::Mul => a * b,
                    Op::Neg => -a,
                    Op::Fma => a * b + c,
                    Op::Fnma => c - a * b,
                    Op::Fms => a * b - c,
                    Op::Div => a / b,
                    Op::Sqrt => a.sqrt(),
                    Op::Recip => 1.0 / a,
                    Op::Tanh => a.tanh(),
                    Op::Min => a.min(b),
                    Op::Max => a.max(b),
                    Op::Abs => a.abs(),
                    Op::Select => {
                        if a < b {
                            c
                        } else {
                            d
                        }
                    }
                    Op::Sin => a.sin(),
                    Op::Cos => a.cos(),
                    Op::Round => a.round_ties_even(),
                    Op::Call(function, output) => {
                        self.functions[function as usize].evaluate(&[a, b, c])[output as usize]
                    }
                    Op::Gather(table) => self.tables[table as usize].get(a as usize).copied().unwrap_or(0.0),
                    Op::Merge => {
                        if a == 0.0 {
                            c
                        } else {
                            b
                        }
                    }
                    _ => whole.unwrap_or(f64::NAN),
                }
            });
            values[index as usize] = row;
        }
    }
}
