//! A graph computed in `f64`, as one environment alone would: guarded regions are left out where they can be.

use core::ops::Range;

use super::graph::{Graph, Id, Node, RegionKind};
use crate::Real;

impl Graph {
    /// The outputs for these inputs, with the arithmetic of `f64`'s own [`Real`]. Numbers of regions that are left out
    /// are NaN; an input that is missing is too.
    pub fn evaluate(&self, inputs: &[f64]) -> Vec<f64> {
        let mut values = vec![f64::NAN; self.nodes.len()];
        self.run(None, 0..self.nodes.len() as u32, inputs, &mut values);
        self.outputs.iter().map(|id| values[id.0 as usize]).collect()
    }

    /// Computes `nodes`, which are those of the region `parent` or all.
    fn run(&self, parent: Option<u32>, nodes: Range<u32>, inputs: &[f64], values: &mut [f64]) {
        let mut at = nodes.start;
        // Inner regions come in the order of their nodes; the nodes between them belong to none.
        let inner = self.regions.iter().enumerate().filter(|(_, region)| region.parent == parent);
        for (index, region) in inner {
            self.line(at..region.nodes.start, inputs, values);
            at = region.nodes.end;
            let index = index as u32;
            match &region.kind {
                RegionKind::Guarded(guard) => {
                    if values[guard.0 as usize] == 0.0 {
                        // NaN shows in the outputs if something uses a number that was left out.
                        values[region.nodes.start as usize..at as usize].fill(f64::NAN);
                    } else {
                        self.run(Some(index), region.nodes.clone(), inputs, values);
                    }
                }
                RegionKind::Loop { count, carried } => {
                    let read = |id: Id, values: &[f64]| values[id.0 as usize];
                    let mut now: Vec<f64> = carried.iter().map(|one| read(one.first, values)).collect();
                    for _ in 0..*count {
                        // Variables are the loop's first nodes.
                        let first = region.nodes.start as usize;
                        values[first..first + now.len()].copy_from_slice(&now);
                        self.run(Some(index), region.nodes.clone(), inputs, values);
                        // All are read before any is written: the next value of one may be the variable of
                        // another.
                        now = carried.iter().map(|one| read(one.next, values)).collect();
                    }
                    // So are results the first nodes after it.
                    values[at as usize..at as usize + now.len()].copy_from_slice(&now);
                }
            }
        }
        self.line(at..nodes.end, inputs, values);
    }

    /// Computes nodes without regions.
    fn line(&self, nodes: Range<u32>, inputs: &[f64], values: &mut [f64]) {
        for index in nodes {
            let at = |id: Id| values[id.0 as usize];
            values[index as usize] = match self.nodes[index as usize] {
                // Set by their loop.
                Node::Variable(..) | Node::Result(..) => values[index as usize],
                Node::Input(number) => inputs.get(number as usize).copied().unwrap_or(f64::NAN),
                Node::Constant(bits) => f64::from_bits(bits),
                Node::Add(a, b) => at(a) + at(b),
                Node::Sub(a, b) => at(a) - at(b),
                Node::Mul(a, b) => at(a) * at(b),
                Node::Neg(a) => -at(a),
                Node::Fma(a, b, c) => at(a).fma(at(b), at(c)),
                Node::Fnma(a, b, c) => at(a).fnma(at(b), at(c)),
                Node::Div(a, b) => Real::div(at(a), at(b)),
                Node::Sqrt(a) => at(a).sqrt(),
                Node::Recip(a) => Real::recip(at(a)),
                Node::Tanh(a) => at(a).tanh(),
                Node::Min(a, b) => Real::min(at(a), at(b)),
                Node::Max(a, b) => Real::max(at(a), at(b)),
                Node::Abs(a) => at(a).abs(),
                Node::Select(a, b, x, y) => f64::select_lt(at(a), at(b), at(x), at(y)),
                Node::Sin(a) => at(a).sin(),
                Node::Cos(a) => at(a).cos(),
                Node::Round(a) => Real::round(at(a)),
                Node::Call(function, output, a, b, c) => {
                    // Each output computes the whole function again, which is good enough for tests.
                    self.functions[function as usize].evaluate(&[at(a), at(b), at(c)])[output as usize]
                }
                Node::Gather(table, a) => {
                    self.tables[table as usize].get(at(a) as usize).copied().unwrap_or(0.0)
                }
                Node::Unless(a, b) => f64::from(u8::from(at(a).unless_ge(at(b)))),
                Node::Merge(guard, inside, before) => {
                    if at(guard) == 0.0 {
                        at(before)
                    } else {
                        at(inside)
                    }
                }
            };
        }
    }
}
