//! One program for all lanes from a recording of the whole robot.
//!
//! What belongs to one lane must have the same form in every lane. Tuples (node of lane 0, of lane 1, …) are unified
//! from the outputs down: the same operation, tuples of operands. Constants that differ become rows of a table. A tuple
//! stands where its node of lane 0 stood, so that order and regions are lane 0's.

use std::collections::HashMap;

use super::EmitError;
use super::chain::{Chains, Kind, Term};
use super::lanes::Lanes;
use super::op::Op;
use super::source::Source;

/// An operation of the program for all lanes. Operands are other items.
#[derive(Clone, Copy, Debug)]
pub struct Item {
    /// Its place: the recording's node of lane 0 that it stands for, then a number among those.
    pub place: (u32, u32),
    /// The operation.
    pub op: Op,
    /// Operands.
    pub args: [u32; 4],
}

/// A number that a loop hands on: items of its first value and of its value at the end of a turn.
#[derive(Clone, Copy, Debug)]
pub struct Handed {
    /// Its value in the first turn.
    pub first: u32,
    /// Its value at the end of a turn.
    pub next: u32,
}

/// The inputs of a recording as lanes see them.
pub struct InputSeats {
    /// Lane of each, none for all.
    pub lane: Vec<Option<usize>>,
    /// Counterpart in lane 0.
    pub twin: Vec<u32>,
}

/// The items of a program.
pub struct Plan {
    /// Operations in no order; see [`Item::place`].
    pub items: Vec<Item>,
    /// Constants that differ by lane.
    pub table: Vec<Vec<f64>>,
    /// Numbers that each loop hands on, by its region.
    pub handed: HashMap<u32, Vec<Handed>>,
    /// Items of the outputs, as they were asked for.
    pub outputs: Vec<u32>,
}

/// Last among the items of one place.
const LAST: u32 = u32::MAX;

struct Planner<'a> {
    source: &'a Source,
    chains: &'a Chains<'a>,
    lanes: &'a Lanes,
    seats: &'a InputSeats,
    count: usize,
    known: HashMap<Vec<u32>, u32>,
    waiting: Vec<(u32, Vec<u32>)>,
    places: HashMap<(u32, Vec<u32>), u32>,
    next_place: u32,
    plan: Plan,
}

impl Plan {
    /// Unifies lanes. `outputs`: nodes of lane 0, 1, … of each output.
    ///
    /// # Errors
    /// Lanes that differ in more than constants.
    pub fn new(
        source: &Source,
        chains: &Chains<'_>,
        lanes: &Lanes,
        seats: &InputSeats,
        count: usize,
        outputs: &[Vec<u32>],
    ) -> Result<Self, EmitError> {
        let plan = Self { items: Vec::new(), table: Vec::new(), handed: HashMap::new(), outputs: Vec::new() };
        let mut planner = Planner {
            source,
            chains,
            lanes,
            seats,
            count,
            known: HashMap::new(),
            waiting: Vec::new(),
            places: HashMap::new(),
            next_place: 0,
            plan,
        };
        // From the outputs down: only what they need becomes an item.
        for tuple in outputs {
            let item = planner.intern(tuple.clone());
            planner.plan.outputs.push(item);
        }
        // A list in place of recursion: recordings are deeper than a stack.
        while let Some((item, tuple)) = planner.waiting.pop() {
            planner.fill(item, &tuple)?;
        }
        Ok(planner.plan)
    }
}

impl Planner<'_> {
    /// The item of a tuple; its operation is found later.
    fn intern(&mut self, tuple: Vec<u32>) -> u32 {
        if let Some(&item) = self.known.get(&tuple) {
            return item;
        }
        // A placeholder: `fill` sets the operation.
        let item = self.add((tuple[0], LAST), Op::Neg, &[]);
        self.known.insert(tuple.clone(), item);
        self.waiting.push((item, tuple));
        item
    }

    fn add(&mut self, place: (u32, u32), op: Op, operands: &[u32]) -> u32 {
        let mut args = [0; 4];
        args[..operands.len()].copy_from_slice(operands);
        self.plan.items.push(Item { place, op, args });
        self.plan.items.len() as u32 - 1
    }

    fn set(&mut self, item: u32, op: Op, operands: &[u32]) {
        let place = self.plan.items[item as usize].place;
        let mut args = [0; 4];
        args[..operands.len()].copy_from_slice(operands);
        self.plan.items[item as usize] = Item { place, op, args };
    }

    fn fill(&mut self, item: u32, tuple: &[u32]) -> Result<(), EmitError> {
        let nodes: Vec<_> = tuple.iter().map(|&index| self.source.nodes[index as usize]).collect();
        let same = tuple.iter().all(|&index| index == tuple[0]);
        let constants: Vec<u64> = nodes
            .iter()
            .filter_map(|node| match node.op {
                Op::Constant(bits) => Some(bits),
                _ => None,
            })
            .collect();
        // Constants may differ by lane, as the signs of left and right do; then a table holds them.
        if constants.len() == nodes.len() {
            let op = if constants.iter().all(|&bits| bits == constants[0]) {
                Op::Constant(constants[0])
            } else {
                self.row(&constants)
            };
            self.set(item, op, &[]);
            return Ok(());
        }
        if same && self.lanes.reduced[tuple[0] as usize] {
            return self.reduction(item, tuple[0]);
        }
        // A number of one lane alone, or a wrong lane's, would be another number in every lane.
        for (lane, &index) in tuple.iter().enumerate() {
            let mask = self.lanes.mask[index as usize];
            let fits = mask == 0 || (self.count > 1 && !same && mask == 1 << lane) || self.count == 1;
            if !fits {
                return Err(EmitError::Alone);
            }
        }
        // A node in a region needs the region's guards, which no operand names.
        self.guards(tuple)?;
        match nodes[0].op {
            Op::Input(number) => {
                let twin = self.seats.twin[number as usize];
                for (lane, node) in nodes.iter().enumerate() {
                    let Op::Input(own) = node.op else { return Err(EmitError::Unlike) };
                    let seat = self.seats.lane[own as usize];
                    // An input of all lanes has no lane; one of each lane must be of the lane that reads it.
                    let right = if same { seat.is_none() || self.count == 1 } else { seat == Some(lane) };
                    if !right || self.seats.twin[own as usize] != twin {
                        return Err(EmitError::Unlike);
                    }
                }
                self.set(item, Op::Input(twin), &[]);
            }
            Op::Variable(region, _) | Op::Result(region, _) => {
                let after = matches!(nodes[0].op, Op::Result(..));
                let mut places = Vec::with_capacity(self.count);
                for node in &nodes {
                    match node.op {
                        Op::Variable(own, place) if own == region && !after => places.push(place),
                        Op::Result(own, place) if own == region && after => places.push(place),
                        _ => return Err(EmitError::Unlike),
                    }
                }
                let place = self.handed(region, places);
                let op = if after { Op::Result(region, place) } else { Op::Variable(region, place) };
                self.set(item, op, &[]);
            }
            op => {
                if nodes.iter().any(|node| node.op != op) {
                    return Err(EmitError::Unlike);
                }
                let operands: Vec<u32> = (0..op.arity())
                    .map(|k| self.intern(nodes.iter().map(|node| node.args[k]).collect()))
                    .collect();
                self.set(item, op, &operands);
            }
        }
        Ok(())
    }

    /// Asks for the guards of the regions around a tuple.
    fn guards(&mut self, tuple: &[u32]) -> Result<(), EmitError> {
        let around = |&index: &u32| -> Vec<u32> {
            self.source
                .around(index)
                .filter_map(|region| self.source.regions[region as usize].guard)
                .collect()
        };
        let guards: Vec<Vec<u32>> = tuple.iter().map(around).collect();
        let depth = guards[0].len();
        if guards.iter().any(|own| own.len() != depth) {
            return Err(EmitError::Unlike);
        }
        for level in 0..depth {
            self.intern(guards.iter().map(|own| own[level]).collect());
        }
        Ok(())
    }

    fn row(&mut self, constants: &[u64]) -> Op {
        let row: Vec<f64> = constants.iter().map(|&bits| f64::from_bits(bits)).collect();
        let table = &mut self.plan.table;
        let number = table.iter().position(|known| *known == row).unwrap_or_else(|| {
            table.push(row);
            table.len() - 1
        });
        Op::Table(number as u32)
    }

    /// The place of what a loop hands on in these places of the recording, one a lane.
    fn handed(&mut self, region: u32, places: Vec<u32>) -> u32 {
        let key = (region, places);
        if let Some(&place) = self.places.get(&key) {
            return place;
        }
        let carried: Vec<(u32, u32)> =
            key.1.iter().map(|&place| self.source.carried(region, place)).collect();
        let list = self.plan.handed.entry(region).or_default();
        // The place is known before its numbers are followed: what a turn ends with may depend on what it
        // began with.
        let place = list.len() as u32;
        list.push(Handed { first: 0, next: 0 });
        self.places.insert(key, place);
        let first = self.intern(carried.iter().map(|one| one.0).collect());
        let next = self.intern(carried.iter().map(|one| one.1).collect());
        if let Some(list) = self.plan.handed.get_mut(&region) {
            list[place as usize] = Handed { first, next };
        }
        place
    }

    /// Lane sums of a chain that ends with `root`.
    fn reduction(&mut self, item: u32, root: u32) -> Result<(), EmitError> {
        let kind = self.chains.kind(root).ok_or(EmitError::Unlike)?;
        let mut per_lane: Vec<Vec<Term>> = vec![Vec::new(); self.count];
        let mut shared = Vec::new();
        for term in self.chains.terms(root)? {
            let zero = self.source.nodes[term.a as usize].op == Op::Constant(0);
            // A zero of no lane adds nothing.
            if kind == Kind::Sum && zero {
                continue;
            }
            let mut mask =
                self.lanes.mask[term.a as usize] | term.b.map_or(0, |b| self.lanes.mask[b as usize]);
            mask |= term.gate.map_or(0, |(guard, _)| self.lanes.mask[guard as usize]);
            // Terms of one lane are added in that lane, terms of all after the lanes' sum: they would count
            // once a lane otherwise.
            match mask.count_ones() {
                0 => shared.push(vec![term; self.count]),
                1 => per_lane[mask.trailing_zeros() as usize].push(term),
                _ => return Err(EmitError::Mixes("a product")),
            }
        }
        // Lanes run one program, so each needs a term at every place.
        let length = per_lane[0].len();
        if per_lane.iter().any(|terms| terms.len() != length) {
            return Err(EmitError::Unlike);
        }
        let per_place: Vec<Vec<Term>> =
            (0..length).map(|k| per_lane.iter().map(|terms| terms[k]).collect()).collect();
        let part = self.chain(kind, per_place)?.ok_or(EmitError::Unlike)?;
        let all = self.chain(kind, shared)?;
        let op = match kind {
            Kind::Sum => Op::LaneSum,
            Kind::Max => Op::LaneMax,
            Kind::Min => Op::LaneMin,
        };
        match all {
            None => self.set(item, op, &[part]),
            Some(all) => {
                // Just before the chain's end, which is the last item of its place.
                let sum = self.add((root, LAST - 1), op, &[part]);
                self.set(item, joining(kind), &[sum, all]);
            }
        }
        Ok(())
    }

    /// The chain of terms, one a lane at each place.
    fn chain(&mut self, kind: Kind, mut terms: Vec<Vec<Term>>) -> Result<Option<u32>, EmitError> {
        // As they arise: a sum that leans to the right takes in its first terms last.
        terms.sort_by_key(|term| term[0].at);
        // Terms in a row that one region makes are added under one guard.
        let region = |term: &Term| term.gate.map(|(guard, _)| (guard, self.source.home[term.at as usize]));
        let runs: Vec<usize> =
            terms.chunk_by(|a, b| region(&a[0]) == region(&b[0])).map(|run| run.len()).collect();
        let mut sum: Option<u32> = None;
        let mut terms = terms.as_slice();
        for length in runs {
            let (run, rest) = terms.split_at(length);
            terms = rest;
            let before = sum;
            for term in run {
                let first = term[0];
                let alike = |other: &Term| {
                    other.minus == first.minus
                        && other.b.is_some() == first.b.is_some()
                        && other.gate.is_some() == first.gate.is_some()
                };
                if !term.iter().all(alike) {
                    return Err(EmitError::Unlike);
                }
                let a = self.intern(term.iter().map(|one| one.a).collect());
                let b = first.b.map(|_| self.intern(term.iter().filter_map(|one| one.b).collect()));
                sum = Some(self.take_in(kind, sum, first, a, b));
            }
            // The last merge of the run: all its terms exist there.
            let merge = run.iter().filter_map(|term| term[0].gate.map(|(_, merge)| merge)).max();
            if let (Some(merge), Some(inside)) = (merge, sum) {
                let gates = run[0].iter().filter_map(|term| term.gate.map(|(guard, _)| guard));
                let guard = self.intern(gates.collect());
                // What a lane adds that leaves the region out. The extremes are finite, as the text has no infinity.
                let neutral = match kind {
                    Kind::Sum => 0.0,
                    Kind::Max => f64::MIN,
                    Kind::Min => f64::MAX,
                };
                let place = self.within(merge);
                let before =
                    before.unwrap_or_else(|| self.add(place, Op::Constant(f64::to_bits(neutral)), &[]));
                let place = self.within(merge);
                sum = Some(self.add(place, Op::Merge, &[guard, inside, before]));
            }
        }
        Ok(sum)
    }

    /// The next place among those of a chain at a node.
    fn within(&mut self, node: u32) -> (u32, u32) {
        self.next_place += 1;
        (node, self.next_place)
    }

    fn take_in(&mut self, kind: Kind, sum: Option<u32>, term: Term, a: u32, b: Option<u32>) -> u32 {
        let place = self.within(term.at);
        match (sum, b) {
            (None, None) if !term.minus => a,
            (None, None) => self.add(place, Op::Neg, &[a]),
            (None, Some(b)) => {
                let product = self.add(place, Op::Mul, &[a, b]);
                if !term.minus {
                    return product;
                }
                let place = self.within(term.at);
                self.add(place, Op::Neg, &[product])
            }
            (Some(sum), None) => {
                let op = if term.minus { Op::Sub } else { joining(kind) };
                self.add(place, op, &[sum, a])
            }
            (Some(sum), Some(b)) => {
                self.add(place, if term.minus { Op::Fnma } else { Op::Fma }, &[a, b, sum])
            }
        }
    }
}

fn joining(kind: Kind) -> Op {
    match kind {
        Kind::Sum => Op::Add,
        Kind::Max => Op::Max,
        Kind::Min => Op::Min,
    }
}
