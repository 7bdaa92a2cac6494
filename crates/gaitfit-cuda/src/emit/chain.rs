//! Sums (or largest, or smallest values) whose terms belong to several lanes.
//!
//! A chain is a tree of +, −, fma (or max, or min) whose inner nodes nothing else uses. If its terms belong to several
//! lanes it becomes a reduction: each lane's part, a sum over the lanes, and the terms of all. A chain goes through
//! guarded regions: of `merge(guard, before + terms, before)` the terms count under the guard.

use super::EmitError;
use super::op::{Node, Op};
use super::source::Source;

/// The operation of a chain.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// Adds.
    Sum,
    /// Takes the largest.
    Max,
    /// Takes the smallest.
    Min,
}

impl Kind {
    /// The kind of chain that an operation continues.
    pub fn from_op(op: Op) -> Option<Self> {
        match op {
            Op::Add | Op::Sub | Op::Neg | Op::Fma | Op::Fnma => Some(Kind::Sum),
            Op::Max => Some(Kind::Max),
            Op::Min => Some(Kind::Min),
            _ => None,
        }
    }
}

/// A term of a chain: ± a, or ± a · b.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Term {
    /// Whether it is subtracted.
    pub minus: bool,
    /// The number, or a factor.
    pub a: u32,
    /// The other factor of a product.
    pub b: Option<u32>,
    /// The chain's node that takes it in.
    pub at: u32,
    /// Guard and merge of the region in which it is made.
    pub gate: Option<(u32, u32)>,
}

/// The chains of a recording.
pub struct Chains<'a> {
    source: &'a Source,
    /// The kind of each chain node.
    kinds: Vec<Option<Kind>>,
    /// Uses, where a merge and the chain inside it count once for the number before both.
    uses: Vec<u32>,
    /// Whether a node is inside a longer chain of its kind.
    interior: Vec<bool>,
}

/// The operands of a chain node that continue the chain, and whether they are subtracted.
fn addends(node: &Node) -> Vec<(u32, bool)> {
    let [a, b, c, _] = node.args;
    match node.op {
        Op::Add | Op::Max | Op::Min => vec![(a, false), (b, false)],
        Op::Sub => vec![(a, false), (b, true)],
        Op::Neg => vec![(a, true)],
        Op::Fma | Op::Fnma => vec![(c, false)],
        _ => Vec::new(),
    }
}

impl<'a> Chains<'a> {
    /// Finds the chains.
    pub fn new(source: &'a Source) -> Self {
        let kinds = source.nodes.iter().map(|node| Kind::from_op(node.op)).collect();
        let count = source.nodes.len();
        let mut chains = Self { source, kinds, uses: source.uses.clone(), interior: vec![false; count] };
        // Merges first: they join the chain inside a region to the chain outside, which changes how often
        // `before` counts as used.
        for index in 0..count {
            let node = source.nodes[index];
            if source.live[index] && node.op == Op::Merge {
                let [_, inside, before, _] = node.args;
                if let Some(kind) = Kind::from_op(source.nodes[inside as usize].op)
                    && chains.reaches(inside, before, kind)
                {
                    chains.kinds[index] = Some(kind);
                    // The merge and the chain inside it both use `before`; the flattened chain takes it in once.
                    chains.uses[before as usize] -= 1;
                }
            }
        }
        // Then the inner nodes: those that only the chain itself uses.
        for index in 0..count {
            let (node, kind) = (&source.nodes[index], chains.kinds[index]);
            if !source.live[index] || kind.is_none() {
                continue;
            }
            // A merge continues the chain by what is made inside and by what was there before.
            let inner: Vec<u32> = match node.op {
                Op::Merge => node.args[1..3].to_vec(),
                _ => addends(node).into_iter().map(|(operand, _)| operand).collect(),
            };
            for operand in inner {
                let operand = operand as usize;
                // A number that is made in another region stays a term of its own: it is made at another time.
                let inside = node.op == Op::Merge && node.args[1] as usize == operand;
                let together = inside || source.home[operand] == source.home[index];
                if together && chains.uses[operand] == 1 && chains.kinds[operand] == kind {
                    chains.interior[operand] = true;
                }
            }
        }
        chains
    }

    /// Whether the chain from `inside` takes in `before`, first of all added. It may take it in again if it is a
    /// constant.
    fn reaches(&self, inside: u32, before: u32, kind: Kind) -> bool {
        let mut waiting = vec![(inside, false)];
        while let Some((index, minus)) = waiting.pop() {
            if index == before {
                return !minus;
            }
            let node = &self.source.nodes[index as usize];
            if Kind::from_op(node.op) == Some(kind) && self.source.uses[index as usize] == 1 {
                let inner = addends(node).into_iter().rev();
                waiting.extend(inner.map(|(operand, sign)| (operand, minus ^ sign)));
            }
        }
        false
    }

    /// The kind of the chain that a node is part of.
    pub fn kind(&self, index: u32) -> Option<Kind> {
        self.kinds[index as usize]
    }

    /// Whether the node is inside a longer chain.
    pub fn interior(&self, index: u32) -> bool {
        self.interior[index as usize]
    }

    /// The terms of the chain that ends with `root`.
    ///
    /// # Errors
    /// Guarded regions in guarded regions.
    pub fn terms(&self, root: u32) -> Result<Vec<Term>, EmitError> {
        let mut terms = Vec::new();
        if let Some(kind) = self.kind(root) {
            let walk = Walk { kind, root, minus: false, at: root, gate: None };
            self.flatten(walk, root, &mut None, &mut terms)?;
        }
        Ok(terms)
    }

    /// Adds the terms from `index` on, without the first that is `left_out`.
    fn flatten(
        &self,
        walk: Walk,
        index: u32,
        left_out: &mut Option<u32>,
        terms: &mut Vec<Term>,
    ) -> Result<(), EmitError> {
        // Only its first occurrence: the chain may add the same number again.
        if *left_out == Some(index) {
            *left_out = None;
            return Ok(());
        }
        let node = &self.source.nodes[index as usize];
        let inner = index == walk.root || self.interior(index);
        let Walk { minus, at, gate, .. } = walk;
        // The end of a branch. A product that nothing else uses stays two factors, for a fused
        // multiplication.
        if !inner || self.kind(index) != Some(walk.kind) {
            let product = walk.kind == Kind::Sum && node.op == Op::Mul && self.uses[index as usize] == 1;
            let (a, b) = if product { (node.args[0], Some(node.args[1])) } else { (index, None) };
            terms.push(Term { minus, a, b, at, gate });
            return Ok(());
        }
        if node.op == Op::Merge {
            // A term has room for one gate.
            if gate.is_some() {
                return Err(EmitError::Nested);
            }
            let [guard, inside, before, _] = node.args;
            self.flatten(Walk { at: index, ..walk }, before, left_out, terms)?;
            let inner = Walk { at: index, gate: Some((guard, index)), ..walk };
            // The chain inside begins with `before`, which is in the terms already.
            return self.flatten(inner, inside, &mut Some(before), terms);
        }
        for (operand, sign) in addends(node) {
            self.flatten(Walk { minus: minus ^ sign, at: index, ..walk }, operand, left_out, terms)?;
        }
        // The product of a fused sum comes after its other operand, as it was computed.
        if matches!(node.op, Op::Fma | Op::Fnma) {
            let minus = minus ^ (node.op == Op::Fnma);
            terms.push(Term { minus, a: node.args[0], b: Some(node.args[1]), at: index, gate });
        }
        Ok(())
    }
}

/// State of a walk through a chain.
#[derive(Clone, Copy)]
struct Walk {
    kind: Kind,
    root: u32,
    minus: bool,
    at: u32,
    gate: Option<(u32, u32)>,
}
