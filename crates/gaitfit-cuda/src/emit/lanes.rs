//! The lanes that each number of a recording belongs to.

use std::collections::BTreeMap;

use super::EmitError;
use super::chain::Chains;
use super::op::Op;
use super::source::Source;

/// The lanes of every number: bit sets, zero for all lanes alike.
pub struct Lanes {
    /// One a node.
    pub mask: Vec<u8>,
    /// Whether the node ends a chain with terms of several lanes.
    pub reduced: Vec<bool>,
    /// One a number that a loop (its region) hands on (its place).
    carried: BTreeMap<(u32, u32), u8>,
}

impl Lanes {
    /// Follows the lanes of the inputs through the recording.
    ///
    /// # Errors
    /// An operation that mixes lanes otherwise than in a chain.
    pub fn new(source: &Source, chains: &Chains<'_>, inputs: &[u8]) -> Result<Self, EmitError> {
        let count = source.nodes.len();
        let mut lanes = Self { mask: vec![0; count], reduced: vec![false; count], carried: BTreeMap::new() };
        // What loops hand on is taken to belong to all lanes at first.
        for (index, node) in source.nodes.iter().enumerate() {
            if let (true, Op::Variable(region, place) | Op::Result(region, place)) =
                (source.live[index], node.op)
            {
                lanes.carried.insert((region, place), 0);
            }
        }
        // A number that a loop hands on may belong to more lanes than it began with: passes repeat until none grows.
        loop {
            let mixed = lanes.pass(source, chains, inputs);
            let mut grown = false;
            let keys: Vec<(u32, u32)> = lanes.carried.keys().copied().collect();
            for key in keys {
                let (first, next) = source.carried(key.0, key.1);
                let mask = lanes.mask[first as usize] | lanes.mask[next as usize];
                if let Some(own) = lanes.carried.get_mut(&key) {
                    grown |= *own | mask != *own;
                    *own |= mask;
                }
            }
            if !grown {
                // Only the last pass counts: earlier ones knew too few lanes and may have reported what no
                // longer holds.
                mixed?;
                return match lanes.carried.values().find(|mask| mask.count_ones() > 1) {
                    Some(_) => Err(EmitError::Mixes("a number that a loop hands on")),
                    None => Ok(lanes),
                };
            }
        }
    }

    fn pass(&mut self, source: &Source, chains: &Chains<'_>, inputs: &[u8]) -> Result<(), EmitError> {
        let mut result = Ok(());
        for (index, node) in source.nodes.iter().enumerate() {
            if !source.live[index] {
                continue;
            }
            self.reduced[index] = false;
            self.mask[index] = match node.op {
                Op::Input(number) => inputs.get(number as usize).copied().unwrap_or(0),
                Op::Variable(region, place) | Op::Result(region, place) => {
                    self.carried.get(&(region, place)).copied().unwrap_or(0)
                }
                op => {
                    let mask =
                        node.operands().iter().fold(0, |mask, &operand| mask | self.mask[operand as usize]);
                    let several = mask.count_ones() > 1;
                    let inside = chains.interior(index as u32);
                    // The end of a chain over several lanes is a sum over lanes, which every lane then has.
                    if several && chains.kind(index as u32).is_some() && !inside {
                        self.reduced[index] = true;
                        0
                    } else {
                        if several && !inside {
                            result = Err(EmitError::Mixes(name(op)));
                        }
                        mask
                    }
                }
            };
        }
        result
    }
}

fn name(op: Op) -> &'static str {
    match op {
        Op::Mul => "a product",
        Op::Div | Op::Recip => "a quotient",
        Op::Select => "a choice",
        Op::Merge => "a guarded region",
        Op::Unless => "a guard",
        _ => "an operation",
    }
}
