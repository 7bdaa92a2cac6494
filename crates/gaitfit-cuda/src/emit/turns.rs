//! Loops as text, and what of them is left out.

use std::collections::BTreeSet;
use std::ops::Range;

use super::PeriodProgram;
use super::layout::{Class, Layout};
use super::op::Op;
use super::program::Kind;
use super::text::Writer;

/// Whether a loop has two texts, one without guarded regions.
pub fn has_two_texts(program: &PeriodProgram, layout: &Layout) -> bool {
    let writer = Writer::new(program, layout);
    let inner = |region: u32| {
        let regions = &program.program.regions;
        let is_loop = |region: u32| matches!(regions[region as usize].kind, Kind::Loop { .. });
        is_loop(region) && program.program.around(regions[region as usize].parent).any(is_loop)
    };
    (0..program.program.regions.len() as u32).any(|region| inner(region) && writer.guards(region).is_some())
}

impl Writer<'_> {
    fn is_guarded(&self, region: u32) -> bool {
        matches!(self.program.regions[region as usize].kind, Kind::Guarded(_))
    }

    /// A guarded region that is not needed: what it would have changed stays as it was.
    pub(super) fn left_out(&mut self, index: u32) {
        for merge in self.crossing.set_inside.get(&index).cloned().unwrap_or_default() {
            let before = self.operand(self.program.nodes[merge as usize].args[2]);
            self.line(&format!("const R t{merge} = {before};"));
        }
    }

    /// The guards of a loop's regions, if they are known before the loop. Where none of them is needed, a second text of the
    /// loop without regions does: it is much shorter, and what decides the speed is that it fits the cache of instructions.
    fn guards(&self, index: u32) -> Option<BTreeSet<u32>> {
        let start = self.program.regions[index as usize].nodes.start;
        let guarded = |region: u32| self.is_guarded(region);
        let mut guards = BTreeSet::new();
        for region in &self.program.regions {
            let Kind::Guarded(guard) = region.kind else { continue };
            let mut around = self.program.around(region.parent).take_while(|&outer| outer != index);
            let inside = self.program.around(region.parent).any(|outer| outer == index);
            // Inner regions are skipped with the region around them, so their own guards need not be known.
            if !inside || around.any(guarded) {
                continue;
            }
            if guard >= start || self.program.home[guard as usize].is_some_and(guarded) {
                return None;
            }
            guards.insert(guard);
        }
        Some(guards).filter(|guards| !guards.is_empty())
    }

    pub(super) fn turns(
        &mut self,
        index: u32,
        count: usize,
        carried: &[(u32, u32)],
        parent: Option<u32>,
        nodes: Range<u32>,
    ) {
        let outer = !self
            .program
            .around(parent)
            .any(|region| matches!(self.program.regions[region as usize].kind, Kind::Loop { .. }));
        let held = |place: usize| (index, place as u32);
        for (place, &(first, _)) in carried.iter().enumerate() {
            if self.crossing.held.contains_key(&held(place)) {
                continue;
            }
            let first = self.operand(first);
            self.line(&format!("R v{index}_{place} = {first};"));
        }
        if !outer {
            // An inner loop does not read the same numbers at every turn.
            for node in nodes.clone().filter(|&node| self.program.home[node as usize] == Some(index)) {
                for &operand in self.program.nodes[node as usize].operands() {
                    let (operand, _) = self.bare(operand);
                    if self.read_late(operand) {
                        self.read(operand);
                    }
                }
            }
        }
        let guards = if outer || self.lean.is_some() { None } else { self.guards(index) };
        let Some(guards) = guards else {
            return self.whole_turns(index, count, carried, outer, nodes);
        };
        let guards: Vec<String> = guards.into_iter().map(|guard| self.operand(guard)).collect();
        // Both texts begin with the same knowledge, and neither may see the other's declarations.
        let before = (self.declared.clone(), self.read.clone());
        for (lean, begin) in [(false, format!("if ({}) {{", guards.join(" || "))), (true, "} else {".into())]
        {
            (self.declared, self.read) = before.clone();
            self.line(&begin);
            self.depth += 1;
            self.lean = Some(lean);
            self.whole_turns(index, count, carried, outer, nodes.clone());
            self.lean = None;
            self.depth -= 1;
        }
        (self.declared, self.read) = before;
        self.line("}");
    }

    /// The text of a loop.
    fn whole_turns(
        &mut self,
        index: u32,
        count: usize,
        carried: &[(u32, u32)],
        outer: bool,
        nodes: Range<u32>,
    ) {
        self.line(&format!("ONCE for (int turn{index} = 0; turn{index} < {count}; ++turn{index}) {{"));
        self.enter(index, outer);
        if outer {
            self.refresh(nodes.clone());
        }
        self.block(Some(index), nodes);
        // Assignments come after all values are computed, at the end of the turn.
        let mut assigned = Vec::new();
        for (place, &(_, next)) in carried.iter().enumerate() {
            if self.crossing.held.contains_key(&(index, place as u32)) {
                continue;
            }
            let (bare, minus) = self.bare(next);
            let home = self.program.home[bare as usize];
            if self.lean == Some(true)
                && home != Some(index)
                && home.is_some_and(|home| self.is_guarded(home))
            {
                // Only regions that are left out look at it.
                continue;
            }
            let value = self.operand(next);
            let name = format!("v{index}_{place}");
            match self.program.nodes[bare as usize].op {
                Op::Variable(own, other) if own == index => {
                    if minus || other != place as u32 {
                        // Turns hand numbers on at the same time: what a later line reads must not have been
                        // overwritten.
                        self.line(&format!("const R n{index}_{place} = {value};"));
                        assigned.push(format!("{name} = n{index}_{place};"));
                    }
                }
                _ => assigned.push(format!("{name} = {value};")),
            }
        }
        for text in assigned {
            self.line(&text);
        }
        let disturbed = self.layout.size(Class::Disturbance);
        if outer && disturbed > 0 {
            self.line(&format!("NEXT(d, {disturbed})"));
        }
        self.close();
    }

    /// Where the numbers lie that are read in a loop's turn is made to look new.
    fn refresh(&mut self, nodes: Range<u32>) {
        let mut pointers = BTreeSet::new();
        for node in &self.program.nodes[nodes.start as usize..nodes.end as usize] {
            for &operand in node.operands() {
                let (operand, _) = self.bare(operand);
                match self.program.nodes[operand as usize].op {
                    Op::Input(number) if self.read_late(operand) => {
                        let place = self.places[number as usize];
                        let who = if place.lane.is_some() { "own" } else { "all" };
                        pointers.insert(format!("FRESH({}_{who})", place.class.letter()));
                    }
                    Op::Table(_) => {
                        pointers.insert("FRESH_TABLE".to_owned());
                    }
                    _ => {}
                }
            }
        }
        for pointer in pointers {
            self.line(&pointer);
        }
    }
}
