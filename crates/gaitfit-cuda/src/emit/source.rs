//! A recorded graph made ready: which nodes are needed, in which region each lies, and how often it is used.
//!
//! Guards of little work are dissolved: their regions are always computed. It is correct, for where a guard is 0 a
//! region's result equals the number before it, and a branch costs more than a few operations.

use std::ops::Range;
use std::sync::Arc;

use gaitfit_physics::trace::{Graph, RegionKind};

use super::op::{Node, Op};

/// No region.
pub const NOWHERE: u32 = u32::MAX;

/// Regions of a recording.
#[derive(Clone, Debug)]
pub struct SourceRegion {
    /// Its guard if it has one, else it is a loop or dissolved.
    pub guard: Option<u32>,
    /// Turns and what they hand on, (first, next), of a loop.
    pub turns: Option<(usize, Vec<(u32, u32)>)>,
    /// Region it lies in, or [`NOWHERE`].
    pub parent: u32,
}

/// A recording made ready.
pub struct Source {
    /// Operations.
    pub nodes: Vec<Node>,
    /// Innermost region of each node, or [`NOWHERE`].
    pub home: Vec<u32>,
    /// Regions; those dissolved have neither guard nor turns and are nobody's home.
    pub regions: Vec<SourceRegion>,
    /// Nodes of the outputs.
    pub outputs: Vec<u32>,
    /// Whether an output needs the node.
    pub live: Vec<bool>,
    /// How often needed nodes and outputs use it.
    pub uses: Vec<u32>,
    /// The recording's tables.
    pub tables: Vec<Arc<[f64]>>,
    /// Its functions.
    pub functions: Vec<Arc<Graph>>,
}

impl Source {
    /// Makes a recording ready; guards of fewer operations than their `min` are dissolved.
    pub fn new(graph: &Graph, min: impl Fn(u32) -> usize) -> Self {
        let count = graph.nodes.len();
        let mut work = vec![0usize; count];
        for region in &graph.regions {
            if let RegionKind::Guarded(guard) = region.kind {
                // Several regions may have the same guard: they are dissolved together or not at all.
                work[guard.0 as usize] += operations(graph, &region.nodes);
            }
        }
        let dissolved = |guard: u32| work[guard as usize] < min(guard);
        let mut alias: Vec<u32> = (0..count as u32).collect();
        let mut nodes: Vec<Node> = Vec::with_capacity(count);
        // Operands come first, so an operand's alias is final when it is read.
        for (index, &node) in graph.nodes.iter().enumerate() {
            let mut node = Node::from(node);
            for k in 0..node.op.arity() {
                node.args[k] = alias[node.args[k] as usize];
            }
            if node.op == Op::Merge && dissolved(node.args[0]) {
                // A dissolved region always runs, so its merge is the number that it makes.
                alias[index] = node.args[1];
            }
            nodes.push(node);
        }
        let mut home = vec![NOWHERE; count];
        let mut regions: Vec<SourceRegion> = Vec::with_capacity(graph.regions.len());
        let mut stands_for: Vec<u32> = Vec::new();
        // Outer regions come first, so inner ones fill their own nodes after them. A dissolved region stands
        // for its parent.
        for (index, region) in graph.regions.iter().enumerate() {
            let parent = region.parent.map_or(NOWHERE, |parent| stands_for[parent as usize]);
            let (guard, turns) = match &region.kind {
                RegionKind::Guarded(guard) => ((!dissolved(guard.0)).then_some(guard.0), None),
                RegionKind::Loop { count, carried } => {
                    let pair = |id: gaitfit_physics::trace::Id| alias[id.0 as usize];
                    let carried = carried.iter().map(|one| (pair(one.first), pair(one.next))).collect();
                    (None, Some((*count, carried)))
                }
            };
            let kept = guard.is_some() || turns.is_some();
            let region_id = if kept { index as u32 } else { parent };
            stands_for.push(region_id);
            if kept {
                home[region.nodes.start as usize..region.nodes.end as usize].fill(region_id);
            }
            regions.push(SourceRegion { guard, turns, parent });
        }
        let outputs = graph.outputs.iter().map(|id| alias[id.0 as usize]).collect();
        let (live, uses) = (vec![false; count], vec![0; count]);
        let (tables, functions) = (graph.tables.clone(), graph.functions.clone());
        let mut source = Self { nodes, home, regions, outputs, live, uses, tables, functions };
        source.find_live();
        source.count_uses();
        source
    }

    /// (first, next) of a number that a loop hands on.
    pub fn carried(&self, region: u32, place: u32) -> (u32, u32) {
        let turns = self.regions.get(region as usize).and_then(|region| region.turns.as_ref());
        turns.and_then(|(_, carried)| carried.get(place as usize)).copied().unwrap_or_default()
    }

    /// Regions around a node, inner first.
    pub fn around(&self, node: u32) -> impl Iterator<Item = u32> + use<'_> {
        std::iter::successors(Some(self.home[node as usize]), |&region| {
            self.regions.get(region as usize).map(|region| region.parent)
        })
        .take_while(|&region| region != NOWHERE)
    }

    fn find_live(&mut self) {
        let mut waiting = self.outputs.clone();
        while let Some(index) = waiting.pop() {
            if std::mem::replace(&mut self.live[index as usize], true) {
                continue;
            }
            let node = self.nodes[index as usize];
            waiting.extend(node.operands());
            if let Op::Variable(region, place) | Op::Result(region, place) = node.op {
                let (first, next) = self.carried(region, place);
                waiting.extend([first, next]);
            }
            waiting.extend(self.around(index).filter_map(|region| self.regions[region as usize].guard));
        }
    }

    fn count_uses(&mut self) {
        // A loop reads its first and last values once, however often its variable is used.
        let mut handed = std::collections::BTreeSet::new();
        for index in 0..self.nodes.len() {
            if !self.live[index] {
                continue;
            }
            let node = self.nodes[index];
            for &operand in node.operands() {
                self.uses[operand as usize] += 1;
            }
            if let Op::Variable(region, place) | Op::Result(region, place) = node.op {
                handed.insert((region, place));
            }
        }
        for (region, place) in handed {
            let (first, next) = self.carried(region, place);
            self.uses[first as usize] += 1;
            self.uses[next as usize] += 1;
        }
        for output in self.outputs.clone() {
            self.uses[output as usize] += 1;
        }
    }
}

fn operations(graph: &Graph, nodes: &Range<u32>) -> usize {
    let nodes = &graph.nodes[nodes.start as usize..nodes.end as usize];
    nodes.iter().filter(|&&node| Node::from(node).op.arity() > 0).count()
}
