//! Nodes of a program are made here: constants are folded, zeros and ones vanish, equal operations are one node.
//!
//! Every rewriting gives the same number in exact arithmetic, and in floating point too but for signs of zero and for
//! products of zero with what is not finite.

use std::collections::HashMap;

use super::op::{Node, Op};

/// Nodes being made, with the region of each.
#[derive(Default)]
pub struct Nodes {
    /// Operations.
    pub nodes: Vec<Node>,
    /// Region of each.
    pub home: Vec<u32>,
    /// Region of the nodes to come.
    pub current: u32,
    /// Guards and loops that must run for a region's numbers to be there, one list a region.
    pub needs: Vec<Vec<(bool, u32)>>,
    known: HashMap<Node, Vec<u32>>,
}

impl Nodes {
    fn needs(&self, region: u32) -> &[(bool, u32)] {
        self.needs.get(region as usize).map_or(&[], Vec::as_slice)
    }

    /// Whether a node's number is there in the current region.
    fn reachable(&self, node: u32) -> bool {
        let here = self.needs(self.current);
        self.needs(self.home[node as usize]).iter().all(|need| here.contains(need))
    }

    fn find(&self, node: &Node) -> Option<u32> {
        // An equal operation in a region that need not have run cannot stand for this one.
        self.known.get(node)?.iter().rev().copied().find(|&known| self.reachable(known))
    }

    /// The node of an operation as it is.
    pub fn put(&mut self, op: Op, operands: &[u32]) -> u32 {
        let node = Node::new(op, operands);
        let mut swapped = node;
        if matches!(op, Op::Add | Op::Mul | Op::Min | Op::Max | Op::Fma | Op::Fnma) {
            // Sums and products do not depend on the order of their operands; the factors of an fma may be exchanged.
            swapped.args.swap(0, 1);
        }
        if let Some(known) = self.find(&node).or_else(|| self.find(&swapped)) {
            return known;
        }
        let index = self.nodes.len() as u32;
        self.nodes.push(node);
        self.home.push(self.current);
        self.known.entry(node).or_default().push(index);
        index
    }

    /// The node of an operation, simplified.
    pub fn make(&mut self, op: Op, args: [u32; 4]) -> u32 {
        let [a, b, c, d] = args;
        match op {
            Op::Add => self.sum(a, b),
            Op::Sub => self.difference(a, b),
            Op::Mul => self.product(a, b),
            Op::Neg => self.negative(a),
            Op::Fma => self.fused(a, b, c, false),
            Op::Fnma => self.fused(a, b, c, true),
            Op::Div => self.quotient(a, b),
            Op::Recip => self.of_one(op, a, |x| 1.0 / x),
            Op::Sqrt => self.of_one(op, a, f64::sqrt),
            Op::Tanh => self.of_one(op, a, f64::tanh),
            Op::Sin => self.of_one(op, a, f64::sin),
            Op::Cos => self.of_one(op, a, f64::cos),
            Op::Round => self.of_one(op, a, f64::round_ties_even),
            // Signs move outwards, so that equal nodes are found and a sign is written only where its node is
            // used.
            Op::Abs => {
                let bare = self.negated(a).unwrap_or(a);
                self.of_one(op, bare, f64::abs)
            }
            Op::Min => self.of_two(op, a, b, f64::min),
            Op::Max => self.of_two(op, a, b, f64::max),
            Op::Select => match (self.value(a), self.value(b)) {
                _ if c == d => c,
                (Some(x), Some(y)) => {
                    if x < y {
                        c
                    } else {
                        d
                    }
                }
                _ => self.put(op, &args),
            },
            Op::Merge if b == c => c,
            _ => self.put(op, &args[..op.arity()]),
        }
    }

    fn constant(&mut self, value: f64) -> u32 {
        // One zero.
        self.put(Op::Constant((value + 0.0).to_bits()), &[])
    }

    fn value(&self, node: u32) -> Option<f64> {
        match self.nodes[node as usize].op {
            Op::Constant(bits) => Some(f64::from_bits(bits)),
            _ => None,
        }
    }

    fn negated(&self, node: u32) -> Option<u32> {
        let node = &self.nodes[node as usize];
        (node.op == Op::Neg).then_some(node.args[0])
    }

    fn of_one(&mut self, op: Op, a: u32, compute: fn(f64) -> f64) -> u32 {
        match self.value(a) {
            Some(x) => self.constant(compute(x)),
            None => self.put(op, &[a]),
        }
    }

    fn of_two(&mut self, op: Op, a: u32, b: u32, compute: fn(f64, f64) -> f64) -> u32 {
        match (self.value(a), self.value(b)) {
            (Some(x), Some(y)) => self.constant(compute(x, y)),
            _ if a == b => a,
            _ => self.put(op, &[a, b]),
        }
    }

    fn sum(&mut self, a: u32, b: u32) -> u32 {
        match (self.value(a), self.value(b)) {
            (Some(x), Some(y)) => return self.constant(x + y),
            (Some(0.0), _) => return b,
            (_, Some(0.0)) => return a,
            _ => {}
        }
        match (self.negated(a), self.negated(b)) {
            (_, Some(b)) => self.difference(a, b),
            (Some(a), None) => self.difference(b, a),
            _ => self.put(Op::Add, &[a, b]),
        }
    }

    fn difference(&mut self, a: u32, b: u32) -> u32 {
        match (self.value(a), self.value(b)) {
            (Some(x), Some(y)) => return self.constant(x - y),
            (Some(0.0), _) => return self.negative(b),
            (_, Some(0.0)) => return a,
            _ => {}
        }
        match self.negated(b) {
            Some(b) => self.sum(a, b),
            None => self.put(Op::Sub, &[a, b]),
        }
    }

    fn negative(&mut self, a: u32) -> u32 {
        match (self.value(a), self.negated(a)) {
            (Some(x), _) => self.constant(-x),
            (_, Some(bare)) => bare,
            _ => self.put(Op::Neg, &[a]),
        }
    }

    fn product(&mut self, a: u32, b: u32) -> u32 {
        match (self.value(a), self.value(b)) {
            (Some(x), Some(y)) => return self.constant(x * y),
            // Not exact for infinity and NaN, as IEEE 754 has it; a step with such numbers has failed anyway.
            (Some(0.0), _) | (_, Some(0.0)) => return self.constant(0.0),
            (Some(1.0), _) => return b,
            (_, Some(1.0)) => return a,
            (Some(-1.0), _) => return self.negative(b),
            (_, Some(-1.0)) => return self.negative(a),
            _ => {}
        }
        match (self.negated(a), self.negated(b)) {
            (Some(a), Some(b)) => self.product(a, b),
            (Some(a), None) => {
                let product = self.product(a, b);
                self.negative(product)
            }
            (None, Some(b)) => {
                let product = self.product(a, b);
                self.negative(product)
            }
            _ => self.put(Op::Mul, &[a, b]),
        }
    }

    fn quotient(&mut self, a: u32, b: u32) -> u32 {
        match (self.value(a), self.value(b)) {
            (Some(x), Some(y)) => self.constant(x / y),
            (_, Some(1.0)) => a,
            (Some(1.0), _) => self.put(Op::Recip, &[b]),
            _ => self.put(Op::Div, &[a, b]),
        }
    }

    /// c + a b, or c − a b if `minus`.
    fn fused(&mut self, a: u32, b: u32, c: u32, minus: bool) -> u32 {
        let plain = |value: Option<f64>| value.is_some_and(|x| x == 0.0 || x.abs() == 1.0);
        let (x, y) = (self.value(a), self.value(b));
        if plain(x) || plain(y) || self.value(c) == Some(0.0) || (x.is_some() && y.is_some()) {
            let product = self.product(a, b);
            return if minus { self.difference(c, product) } else { self.sum(c, product) };
        }
        match (self.negated(a), self.negated(b)) {
            (Some(a), Some(b)) => self.fused(a, b, c, minus),
            (Some(a), None) => self.fused(a, b, c, !minus),
            (None, Some(b)) => self.fused(a, b, c, !minus),
            _ => self.put(if minus { Op::Fnma } else { Op::Fma }, &[a, b, c]),
        }
    }
}
