//! Numbers that cross the bounds of guarded regions.
//!
//! A merge whose number before is there when its region begins is a variable that the region changes: so the device's
//! compiler keeps it in one register. A number that one guarded region makes for another goes through scratch memory,
//! also from one turn of a loop to the next: were it in a register, or left to the compiler to spill, threads that
//! leave the regions out would pay for it too.

use std::collections::{BTreeMap, BTreeSet};

use super::op::Op;
use super::program::{Kind, Program};

/// The numbers that cross the bounds of regions.
pub struct Crossing {
    /// Nodes that are declared before the region they are made in.
    pub early: BTreeSet<u32>,
    /// Places in scratch memory of what only guarded regions read.
    pub scratch: BTreeMap<u32, usize>,
    /// Places in scratch memory of what only guarded regions of a loop (its region) hand on (its place).
    pub held: BTreeMap<(u32, u32), usize>,
    /// Merges that are set in their region, by the region.
    pub set_inside: BTreeMap<u32, Vec<u32>>,
    /// All of those merges.
    pub merged: BTreeSet<u32>,
}

impl Program {
    /// A node without signs, and whether it is negated.
    pub(super) fn bare(&self, mut node: u32) -> (u32, bool) {
        let mut minus = false;
        while self.nodes[node as usize].op == Op::Neg {
            minus = !minus;
            node = self.nodes[node as usize].args[0];
        }
        (node, minus)
    }

    /// A region and those around it.
    pub(super) fn around(&self, region: Option<u32>) -> impl Iterator<Item = u32> + use<'_> {
        std::iter::successors(region, |&region| self.regions[region as usize].parent)
    }
}

impl Crossing {
    /// Finds the crossings of a program.
    pub fn new(program: &Program) -> Self {
        let mut crossing = Self {
            early: BTreeSet::new(),
            scratch: BTreeMap::new(),
            held: BTreeMap::new(),
            set_inside: BTreeMap::new(),
            merged: BTreeSet::new(),
        };
        crossing.find_merges(program);
        let uses = crossing.uses(program);
        crossing.find_held(program, &uses);
        crossing.find_early(program, &uses);
        crossing
    }

    /// Numbers in scratch memory.
    pub fn rooms(&self) -> usize {
        self.scratch.len() + self.held.len()
    }

    fn find_merges(&mut self, program: &Program) {
        for (index, node) in program.nodes.iter().enumerate() {
            let [_, inside, before, _] = node.args;
            if node.op != Op::Merge {
                continue;
            }
            let Some(home) = program.home[inside as usize] else { continue };
            let region = &program.regions[home as usize];
            // Only a number that is there when the region begins can be a variable that the region changes.
            let guarded = matches!(region.kind, Kind::Guarded(_));
            if guarded && before < region.nodes.start && region.parent == program.home[index] {
                self.set_inside.entry(home).or_default().push(index as u32);
                self.merged.insert(index as u32);
            }
        }
    }

    /// Every use by an operation: the node, the region that it is used in, and by what.
    fn uses(&self, program: &Program) -> Vec<(u32, Option<u32>, u32)> {
        let mut used = Vec::new();
        for (index, node) in program.nodes.iter().enumerate() {
            let set = self.merged.contains(&(index as u32));
            for (k, &operand) in node.operands().iter().enumerate() {
                let user = if set && k == 1 { operand as usize } else { index };
                // A sign is written where its operand is used.
                if node.op != Op::Neg {
                    used.push((program.bare(operand).0, program.home[user], index as u32));
                }
            }
        }
        used
    }

    /// Finds the numbers that a loop hands on from guarded regions to guarded regions.
    fn find_held(&mut self, program: &Program, uses: &[(u32, Option<u32>, u32)]) {
        for (index, region) in program.regions.iter().enumerate() {
            let Kind::Loop { carried, .. } = &region.kind else { continue };
            // All that the loop hands on: a number among these is also read at the loop's bounds, where no
            // guard holds.
            let others: BTreeSet<u32> = carried
                .iter()
                .flat_map(|&(first, next)| [program.bare(first).0, program.bare(next).0])
                .collect();
            for (place, &(first, next)) in carried.iter().enumerate() {
                let is_handed = |op: Op| {
                    matches!(op, Op::Variable(of, at) | Op::Result(of, at)
                        if (of, at) == (index as u32, place as u32))
                };
                let home = |node: u32| program.home[program.bare(node).0 as usize];
                let (Some(end), true) = (home(next), guarded(program, home(first))) else { continue };
                let end = program.regions[end as usize].nodes.end;
                let mut fits = guarded(program, home(next));
                // Every reader must be guarded too. A reader behind the region sees the next turn's number,
                // as scratch memory holds one number only.
                for &(node, from, by) in uses.iter().filter(|one| is_handed(program.nodes[one.0 as usize].op))
                {
                    let late = by >= end && matches!(program.nodes[node as usize].op, Op::Variable(..));
                    fits &= guarded(program, from) && !late;
                }
                let handed = |node: &u32| is_handed(program.nodes[*node as usize].op);
                fits &= !others.iter().any(handed);
                fits &= !program.outputs.iter().any(|&output| handed(&program.bare(output).0));
                if fits {
                    let room = self.rooms();
                    self.held.insert((index as u32, place as u32), room);
                }
            }
        }
    }

    fn find_early(&mut self, program: &Program, uses: &[(u32, Option<u32>, u32)]) {
        // A loop reads first values outside itself and last values inside, and outputs are read outside all
        // regions.
        let mut used: Vec<(u32, Option<u32>)> = uses.iter().map(|&(node, from, _)| (node, from)).collect();
        for (index, region) in program.regions.iter().enumerate() {
            if let Kind::Loop { carried, .. } = &region.kind {
                for (place, &(first, next)) in carried.iter().enumerate() {
                    if !self.held.contains_key(&(index as u32, place as u32)) {
                        used.push((program.bare(first).0, region.parent));
                        used.push((program.bare(next).0, Some(index as u32)));
                    }
                }
            }
        }
        used.extend(program.outputs.iter().map(|&output| (program.bare(output).0, None)));
        let mut by_regions = BTreeSet::new();
        for (node, from) in used {
            let Some(home) = program.home[node as usize] else { continue };
            // Readers in the region itself or deeper see an ordinary number.
            if !guarded(program, Some(home)) || program.around(from).any(|region| region == home) {
                continue;
            }
            // A condition is declared early and not kept in scratch memory, which holds floats.
            if guarded(program, from) && program.nodes[node as usize].op != Op::Unless {
                by_regions.insert(node);
            } else {
                self.early.insert(node);
            }
        }
        // A number that is declared early anyway needs no place in memory.
        for node in by_regions.difference(&self.early) {
            let room = self.scratch.len() + self.held.len();
            self.scratch.insert(*node, room);
        }
    }
}

/// Whether a region is a guarded one.
fn guarded(program: &Program, region: Option<u32>) -> bool {
    region.is_some_and(|region| matches!(program.regions[region as usize].kind, Kind::Guarded(_)))
}
