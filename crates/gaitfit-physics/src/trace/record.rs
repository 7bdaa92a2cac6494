//! The recording of a thread: nodes made once, and where each may be used.

use std::cell::RefCell;
use std::collections::{BTreeSet, HashMap};
use std::sync::Arc;

use super::graph::{Carried, Graph, Id, Node, Region, RegionKind, TraceError};
use super::scalar::{Known, Traced};

/// What must run for a node to have a value.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
enum Needs {
    Guard(Id),
    Loop(u32),
}

type Scope = BTreeSet<Needs>;

#[derive(Default)]
struct Recording {
    graph: Graph,
    /// One a node.
    scopes: Vec<Scope>,
    /// Nodes of each operation; several where none can be used in the other's place.
    known: HashMap<Node, Vec<Id>>,
    /// Places in [`Graph::tables`], by address and length.
    tables: HashMap<(usize, usize), u32>,
    /// Places in [`Graph::functions`], by their keys.
    functions: HashMap<usize, u32>,
    /// Open regions, outer first.
    open: Vec<u32>,
    scope: Scope,
    error: Option<TraceError>,
}

thread_local! {
    static RECORDING: RefCell<Recording> = RefCell::new(Recording::default());
}

/// Records what `function` computes on [`Traced`] numbers; what it returns are the outputs.
///
/// # Errors
/// A number that leaves a region, or regions that are not nested.
pub fn record(function: impl FnOnce() -> Vec<Traced>) -> Result<Graph, TraceError> {
    // A function that is recorded inside another recording begins with an empty one (see [`call`]).
    let outer = RECORDING.take();
    let outputs: Vec<Id> = function().into_iter().map(|traced| traced.0).collect();
    let mut recording = RECORDING.replace(outer);
    recording.check(&outputs);
    if !recording.open.is_empty() {
        recording.fail(TraceError::Nesting);
    }
    match recording.error {
        Some(error) => Err(error),
        None => Ok(Graph { outputs, ..recording.graph }),
    }
}

/// A loop whose turn is being recorded.
#[derive(Debug)]
#[must_use = "a loop ends with `Loop::end`"]
pub struct Loop(u32);

impl Loop {
    /// Begins a loop of `count` turns. `carried` are the numbers that turns hand on: from here on they stand for their
    /// values at the beginning of any turn.
    pub fn begin(count: usize, carried: Vec<&mut Traced>) -> Self {
        RECORDING.with_borrow_mut(|recording| Self(recording.begin_loop(count, carried)))
    }

    /// Ends the loop's turn. `carried` are the same numbers at its end: from here on they stand for their values after
    /// the last turn.
    pub fn end(self, carried: Vec<&mut Traced>) {
        RECORDING.with_borrow_mut(|recording| recording.end_loop(self.0, carried));
    }
}

/// Records an operation.
pub(super) fn node(node: Node) -> Traced {
    RECORDING.with_borrow_mut(|recording| Traced(recording.node(node)))
}

/// The value of a constant, or of one's magnitude or opposite.
pub(super) fn constant(id: Id) -> Option<f64> {
    RECORDING.with_borrow(|recording| recording.constant(id))
}

/// A further input.
pub(super) fn input() -> Traced {
    RECORDING.with_borrow_mut(|recording| {
        recording.graph.inputs += 1;
        let number = recording.graph.inputs as u32 - 1;
        Traced(recording.node(Node::Input(number)))
    })
}

/// The entry of a table. A table lives as long as the recording, so its address names it.
pub(super) fn gather(table: &[Known], index: Traced) -> Traced {
    RECORDING.with_borrow_mut(|recording| {
        let table = recording.table(table);
        Traced(recording.node(Node::Gather(table, index.0)))
    })
}

/// A function's outputs for `inputs`; its operations are recorded when its key is new.
pub(super) fn call(
    key: usize,
    inputs: [Traced; 3],
    function: impl FnOnce([Traced; 3]) -> [Traced; 4],
) -> [Traced; 4] {
    let known = RECORDING.with_borrow(|recording| recording.functions.get(&key).copied());
    // Outside of the borrow: recording the function borrows this thread's recording itself.
    let recorded = known.is_none().then(|| record(|| function(std::array::from_fn(|_| input())).to_vec()));
    RECORDING.with_borrow_mut(|recording| {
        let place = known.unwrap_or_else(|| recording.function(key, recorded));
        let [a, b, c] = inputs.map(|number| number.0);
        std::array::from_fn(|output| Traced(recording.node(Node::Call(place, output as u32, a, b, c))))
    })
}

pub(super) fn enter(guard: Id) {
    RECORDING.with_borrow_mut(|recording| {
        recording.check(&[guard]);
        recording.open(RegionKind::Guarded(guard), Needs::Guard(guard));
    });
}

pub(super) fn leave(guard: Id) {
    RECORDING.with_borrow_mut(|recording| {
        let kind = RegionKind::Guarded(guard);
        match recording.open.last() {
            Some(&last) if recording.graph.regions[last as usize].kind == kind => recording.close(),
            _ => recording.fail(TraceError::Nesting),
        }
    });
}

impl Recording {
    fn fail(&mut self, error: TraceError) {
        // The first error is kept: later ones tend to follow from it.
        self.error.get_or_insert(error);
    }

    fn table(&mut self, table: &[Known]) -> u32 {
        let key = (table.as_ptr() as usize, table.len());
        if let Some(&place) = self.tables.get(&key) {
            return place;
        }
        let value = |entry: &Known| match entry {
            Known::Constant(value) => Some(*value),
            Known::Number(_) => None,
        };
        let values: Option<Vec<f64>> = table.iter().map(value).collect();
        // The recording goes on with an empty table, and the error is reported at its end.
        if values.is_none() {
            self.fail(TraceError::Table);
        }
        let place = self.graph.tables.len() as u32;
        self.graph.tables.push(values.unwrap_or_default().into());
        self.tables.insert(key, place);
        place
    }

    /// Takes up a function's recording.
    fn function(&mut self, key: usize, recorded: Option<Result<Graph, TraceError>>) -> u32 {
        let graph = match recorded {
            Some(Ok(graph)) if graph.regions.is_empty() && graph.functions.is_empty() => graph,
            Some(Err(error)) => {
                self.fail(error);
                Graph::default()
            }
            _ => {
                self.fail(TraceError::Function);
                Graph::default()
            }
        };
        let place = self.graph.functions.len() as u32;
        self.graph.functions.push(Arc::new(graph));
        self.functions.insert(key, place);
        place
    }

    fn constant(&self, id: Id) -> Option<f64> {
        match self.graph.nodes.get(id.0 as usize)? {
            Node::Constant(bits) => Some(f64::from_bits(*bits)),
            Node::Neg(of) => Some(-self.constant(*of)?),
            Node::Abs(of) => Some(self.constant(*of)?.abs()),
            _ => None,
        }
    }

    /// Fails if a number is used where it may have no value.
    fn check(&mut self, used: &[Id]) {
        for &id in used {
            if !self.scopes.get(id.0 as usize).is_some_and(|scope| scope.is_subset(&self.scope)) {
                self.fail(TraceError::Escapes(id));
            }
        }
    }

    fn node(&mut self, node: Node) -> Id {
        if let Node::Merge(guard, inside, before) = node {
            // A merge is outside of the region, but may use the number that was made in it.
            self.check(&[guard, before]);
            let outer = self.scope.clone();
            self.scope.insert(Needs::Guard(guard));
            self.check(&[inside]);
            self.scope = outer;
        } else {
            self.check(&node.operands().collect::<Vec<_>>());
        }
        let known = self.known.get(&node).into_iter().flatten();
        // The same operation may stand in a region that is closed: its node has no value here.
        if let Some(&id) = known.rev().find(|id| self.scopes[id.0 as usize].is_subset(&self.scope)) {
            return id;
        }
        self.add(node, self.scope.clone())
    }

    fn add(&mut self, node: Node, scope: Scope) -> Id {
        let id = Id(self.graph.nodes.len() as u32);
        self.graph.nodes.push(node);
        self.scopes.push(scope);
        self.known.entry(node).or_default().push(id);
        id
    }

    fn open(&mut self, kind: RegionKind, needs: Needs) {
        let at = self.graph.nodes.len() as u32;
        self.graph.regions.push(Region { kind, nodes: at..at, parent: self.open.last().copied() });
        self.open.push(self.graph.regions.len() as u32 - 1);
        self.scope.insert(needs);
    }

    fn close(&mut self) {
        if let Some(index) = self.open.pop() {
            self.graph.regions[index as usize].nodes.end = self.graph.nodes.len() as u32;
        }
        // From what is still open: a guard may be entered twice.
        let open = self.open.iter().map(|&index| match self.graph.regions[index as usize].kind {
            RegionKind::Guarded(guard) => Needs::Guard(guard),
            RegionKind::Loop { .. } => Needs::Loop(index),
        });
        self.scope = open.collect();
    }

    fn begin_loop(&mut self, count: usize, carried: Vec<&mut Traced>) -> u32 {
        let index = self.graph.regions.len() as u32;
        // The value at a turn's end is not known yet; `end_loop` sets it.
        let firsts = carried.iter().map(|number| Carried { first: number.0, next: number.0 }).collect();
        self.open(RegionKind::Loop { count, carried: firsts }, Needs::Loop(index));
        for (place, number) in carried.into_iter().enumerate() {
            // A number that only has a value under some guard is carried under the same.
            let mut scope = self.scope.clone();
            scope.extend(&self.scopes[number.0.0 as usize]);
            number.0 = self.add(Node::Variable(index, place as u32), scope);
        }
        index
    }

    fn end_loop(&mut self, index: u32, numbers: Vec<&mut Traced>) {
        if self.open.last() != Some(&index) {
            return self.fail(TraceError::Nesting);
        }
        // The check below needs the scope of the turn, which `close` takes away.
        let inner = self.scope.clone();
        self.close();
        let RegionKind::Loop { carried, .. } = &self.graph.regions[index as usize].kind else {
            return self.fail(TraceError::Nesting);
        };
        // A copy, because `add` and `fail` below change the graph.
        let mut carried = carried.clone();
        if carried.len() != numbers.len() {
            return self.fail(TraceError::Carried { began: carried.len(), ended: numbers.len() });
        }
        for (place, (number, carried)) in numbers.into_iter().zip(&mut carried).enumerate() {
            let first = self.scopes[carried.first.0 as usize].clone();
            let next = number.0;
            // A number from an inner region that was not merged has no value at the end of the turn.
            if !self.scopes[next.0 as usize]
                .iter()
                .all(|needs| inner.contains(needs) || first.contains(needs))
            {
                self.fail(TraceError::Escapes(next));
            }
            carried.next = next;
            // The result has a value only where the number had one before the loop.
            let scope = self.scope.union(&first).copied().collect();
            number.0 = self.add(Node::Result(index, place as u32), scope);
        }
        if let RegionKind::Loop { carried: kept, .. } = &mut self.graph.regions[index as usize].kind {
            *kept = carried;
        }
    }
}
