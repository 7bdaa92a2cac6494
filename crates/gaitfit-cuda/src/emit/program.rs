//! The program that every lane of an environment runs.

use std::collections::{BTreeMap, HashMap};
use std::ops::Range;
use std::sync::Arc;

use gaitfit_physics::trace::Graph;

use super::EmitError;
use super::op::{Node, Op};
use super::plan::{Handed, Plan};
use super::simplify::Nodes;
use super::source::{NOWHERE, Source};

/// Why nodes belong together.
#[derive(Clone, Debug, PartialEq)]
pub enum Kind {
    /// They are computed where this guard is not 0 in some lane.
    Guarded(u32),
    /// They are computed `count` times.
    Loop {
        /// Turns.
        count: usize,
        /// Numbers that turns hand on: (in the first turn, at the end of a turn).
        carried: Vec<(u32, u32)>,
    },
}

/// Nodes in a row that belong together. Regions nest.
#[derive(Clone, Debug, PartialEq)]
pub struct Region {
    /// Why.
    pub kind: Kind,
    /// The nodes, those of inner regions among them.
    pub nodes: Range<u32>,
    /// Region it lies in.
    pub parent: Option<u32>,
}

/// A program for all lanes alike.
#[derive(Clone, Debug, PartialEq)]
pub struct Program {
    /// Threads of an environment.
    pub lanes: usize,
    /// Operations, operands first.
    pub nodes: Vec<Node>,
    /// Regions, outer before inner, in the order in which they begin.
    pub regions: Vec<Region>,
    /// Innermost region of each node.
    pub home: Vec<Option<u32>>,
    /// Constants that differ by lane.
    pub table: Vec<Vec<f64>>,
    /// Constants that [`Op::Gather`] reads, the same for all lanes.
    pub tables: Vec<Arc<[f64]>>,
    /// Functions that [`Op::Call`] computes.
    pub functions: Vec<Arc<Graph>>,
    /// Nodes of the outputs.
    pub outputs: Vec<u32>,
}

/// Nodes with regions by the recording's numbers.
struct Draft {
    nodes: Vec<Node>,
    home: Vec<u32>,
    /// The node of each guarded region's guard.
    guards: HashMap<u32, u32>,
    handed: HashMap<u32, Vec<(u32, u32)>>,
    outputs: Vec<u32>,
}

impl Program {
    /// Puts the items of a plan in order.
    ///
    /// # Errors
    /// Items that lanes need before they can be computed.
    pub fn new(source: &Source, plan: &Plan, lanes: usize) -> Result<Self, EmitError> {
        let mut draft = Draft::new(source, plan)?;
        draft.fuse();
        Ok(draft.finish(source, plan, lanes))
    }
}

impl Draft {
    fn new(source: &Source, plan: &Plan) -> Result<Self, EmitError> {
        // In the order of lane 0's recording, where operands come before their users.
        let mut order: Vec<u32> = (0..plan.items.len() as u32).collect();
        order.sort_by_key(|&item| plan.items[item as usize].place);
        let mut nodes = Nodes::default();
        nodes.needs = (0..source.regions.len() as u32).map(|region| needs(source, region)).collect();
        let mut made: Vec<Option<u32>> = vec![None; plan.items.len()];
        // Guards by the recording's node in lane 0.
        let mut guards = HashMap::new();
        for item in order {
            let planned = plan.items[item as usize];
            nodes.current = source.home[planned.place.0 as usize];
            let mut args = [0; 4];
            for k in 0..planned.op.arity() {
                // Fails where a lane's reduction needs a number that lane 0 makes later.
                args[k] = made[planned.args[k] as usize].ok_or(EmitError::Order)?;
            }
            let node = nodes.make(planned.op, args);
            if planned.op == Op::Unless {
                guards.insert(planned.place.0, node);
            }
            made[item as usize] = Some(node);
        }
        // Loops are followed after all nodes, because a turn's last values stand behind its first.
        let find = |item: u32| made[item as usize].ok_or(EmitError::Order);
        let mut handed = HashMap::new();
        for (&region, list) in &plan.handed {
            let pair = |one: &Handed| Ok((find(one.first)?, find(one.next)?));
            handed.insert(region, list.iter().map(pair).collect::<Result<_, EmitError>>()?);
        }
        let outputs = plan.outputs.iter().map(|&item| find(item)).collect::<Result<_, EmitError>>()?;
        let of_region = (0..source.regions.len() as u32).filter_map(|region| {
            let guard = source.regions[region as usize].guard?;
            Some((region, *guards.get(&guard)?))
        });
        let guards = of_region.collect();
        Ok(Self { nodes: nodes.nodes, home: nodes.home, guards, handed, outputs })
    }

    /// Nodes that outputs need.
    fn live(&self, source: &Source) -> Vec<bool> {
        let mut live = vec![false; self.nodes.len()];
        let mut waiting = self.outputs.clone();
        while let Some(index) = waiting.pop() {
            // Seen before: loops make the graph circular.
            if std::mem::replace(&mut live[index as usize], true) {
                continue;
            }
            let node = &self.nodes[index as usize];
            waiting.extend(node.operands());
            if let Op::Variable(region, place) | Op::Result(region, place) = node.op
                && let Some(list) = self.handed.get(&region)
                && let Some(&(first, next)) = list.get(place as usize)
            {
                waiting.extend([first, next]);
            }
            // A node in a guarded region needs the guard, which is no operand.
            for region in around(source, self.home[index as usize]) {
                waiting.extend(self.guards.get(&region));
            }
        }
        live
    }

    /// A product used once, in a sum of the same region, becomes part of the sum.
    fn fuse(&mut self) {
        let mut uses = vec![0u32; self.nodes.len()];
        for node in &self.nodes {
            for &operand in node.operands() {
                uses[operand as usize] += 1;
            }
        }
        for &output in self.outputs.iter().chain(self.handed.values().flatten().flat_map(|(a, b)| [a, b])) {
            // Two, so that a product that is also an output never counts as used once.
            uses[output as usize] += 2;
        }
        // The product's own node stays and is dropped with all that nobody reads.
        for index in 0..self.nodes.len() {
            let node = self.nodes[index];
            let [x, y, ..] = node.args;
            let product = |operand: u32| {
                let at = operand as usize;
                let inside =
                    self.nodes[at].op == Op::Mul && uses[at] == 1 && self.home[at] == self.home[index];
                inside.then(|| self.nodes[at].args)
            };
            let fused = match node.op {
                Op::Add => match (product(y), product(x)) {
                    (Some([a, b, ..]), _) => Some(Node::new(Op::Fma, &[a, b, x])),
                    (_, Some([a, b, ..])) => Some(Node::new(Op::Fma, &[a, b, y])),
                    _ => None,
                },
                Op::Sub => match (product(y), product(x)) {
                    (Some([a, b, ..]), _) => Some(Node::new(Op::Fnma, &[a, b, x])),
                    (_, Some([a, b, ..])) => Some(Node::new(Op::Fms, &[a, b, y])),
                    _ => None,
                },
                _ => None,
            };
            if let Some(fused) = fused {
                self.nodes[index] = fused;
            }
        }
    }

    /// Leaves out what no output needs, and numbers nodes, regions and places anew.
    fn finish(self, source: &Source, plan: &Plan, lanes: usize) -> Program {
        let live = self.live(source);
        let mut kept: BTreeMap<u32, (u32, u32)> = BTreeMap::new();
        let mut number = vec![0u32; self.nodes.len()];
        let mut count = 0;
        // A region that keeps no node is not numbered, and so is dropped.
        for index in 0..self.nodes.len() {
            if !live[index] {
                continue;
            }
            number[index] = count;
            count += 1;
            for region in around(source, self.home[index]) {
                kept.entry(region).or_insert((number[index], count)).1 = count;
            }
        }
        let regions: Vec<u32> = kept.keys().copied().collect();
        let renamed = |region: u32| regions.iter().position(|&own| own == region).map(|own| own as u32);
        // Places of what loops hand on that something still reads.
        let mut places: BTreeMap<(u32, u32), u32> = BTreeMap::new();
        let mut last: HashMap<u32, u32> = HashMap::new();
        for (node, _) in self.nodes.iter().zip(&live).filter(|(_, live)| **live) {
            if let Op::Variable(region, place) | Op::Result(region, place) = node.op {
                places.entry((region, place)).or_insert_with(|| {
                    let next = last.entry(region).or_default();
                    *next += 1;
                    *next - 1
                });
            }
        }
        let rename = |op: Op| match op {
            Op::Variable(region, place) => {
                Op::Variable(renamed(region).unwrap_or(0), places.get(&(region, place)).copied().unwrap_or(0))
            }
            Op::Result(region, place) => {
                Op::Result(renamed(region).unwrap_or(0), places.get(&(region, place)).copied().unwrap_or(0))
            }
            op => op,
        };
        // Everything is named by its new number from here on.
        let mut nodes = Vec::with_capacity(count as usize);
        let mut home = Vec::with_capacity(count as usize);
        for index in (0..self.nodes.len()).filter(|&index| live[index]) {
            let node = self.nodes[index];
            let operands: Vec<u32> =
                node.operands().iter().map(|&operand| number[operand as usize]).collect();
            nodes.push(Node::new(rename(node.op), &operands));
            home.push(renamed(self.home[index]));
        }
        let made = regions.iter().map(|&own| {
            let range = kept.get(&own).map_or(0..0, |&(start, end)| start..end);
            let from = &source.regions[own as usize];
            let kind = match &from.turns {
                Some((count, _)) => {
                    let mut carried = vec![(0, 0); last.get(&own).map_or(0, |&count| count as usize)];
                    for (&(region, place), &new) in &places {
                        let list = if region == own { self.handed.get(&region) } else { None };
                        if let Some(&(first, next)) = list.and_then(|list| list.get(place as usize)) {
                            carried[new as usize] = (number[first as usize], number[next as usize]);
                        }
                    }
                    Kind::Loop { count: *count, carried }
                }
                None => Kind::Guarded(self.guards.get(&own).map_or(0, |&guard| number[guard as usize])),
            };
            Region { kind, nodes: range, parent: renamed(from.parent) }
        });
        let regions: Vec<Region> = made.collect();
        let outputs = self.outputs.iter().map(|&output| number[output as usize]).collect();
        let (table, tables, functions) =
            (plan.table.clone(), source.tables.clone(), source.functions.clone());
        Program { lanes, nodes, regions, home, table, tables, functions, outputs }
    }
}

/// A region and those around it.
fn around(source: &Source, region: u32) -> impl Iterator<Item = u32> + use<'_> {
    std::iter::successors(Some(region), |&region| source.regions.get(region as usize).map(|own| own.parent))
        .take_while(|&region| region != NOWHERE)
}

/// Guards (true) and loops (false) that must run for a region's numbers to be there.
fn needs(source: &Source, region: u32) -> Vec<(bool, u32)> {
    let need = |region: u32| match source.regions[region as usize].guard {
        Some(guard) => (true, guard),
        None => (false, region),
    };
    around(source, region).map(need).collect()
}
