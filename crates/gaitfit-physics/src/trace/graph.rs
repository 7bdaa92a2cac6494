//! What a recording leaves.

use core::ops::Range;
use std::sync::Arc;

/// Place of a node in [`Graph::nodes`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, PartialOrd, Ord)]
pub struct Id(pub u32);

/// One operation. Operands come before it.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub enum Node {
    /// An input, by its number.
    Input(u32),
    /// A constant, as the bits of its `f64`.
    Constant(u64),
    /// a + b
    Add(Id, Id),
    /// a − b
    Sub(Id, Id),
    /// a · b
    Mul(Id, Id),
    /// −a
    Neg(Id),
    /// a · b + c
    Fma(Id, Id, Id),
    /// c − a · b
    Fnma(Id, Id, Id),
    /// a / b
    Div(Id, Id),
    /// √a
    Sqrt(Id),
    /// Reciprocal of a positive, finite, normal number.
    Recip(Id),
    /// tanh a
    Tanh(Id),
    /// Smaller of two.
    Min(Id, Id),
    /// Larger of two.
    Max(Id, Id),
    /// |a|
    Abs(Id),
    /// Where a < b the third, else the fourth.
    Select(Id, Id, Id, Id),
    /// sin a
    Sin(Id),
    /// cos a
    Cos(Id),
    /// The whole number nearest to a.
    Round(Id),
    /// The entry with the number a, whole and not negative, of a table (its place in [`Graph::tables`]); 0 beyond its end.
    Gather(u32, Id),
    /// The output with this number of a function (by its place in [`Graph::functions`]), for these arguments.
    Call(u32, u32, Id, Id, Id),
    /// A guard: 0 if every lane certainly satisfies a ≥ b, else 1.
    Unless(Id, Id),
    /// After a guarded region: the second, made in it, where the guard (the first) is not 0, else the third.
    Merge(Id, Id, Id),
    /// In a loop (number of the region): a number that turns hand on (its place in [`RegionKind::Loop`]).
    Variable(u32, u32),
    /// After a loop: such a number after the last turn.
    Result(u32, u32),
}

impl Node {
    /// What it is computed from; of a variable or result see its loop.
    pub fn operands(&self) -> impl Iterator<Item = Id> + use<> {
        // An array, filled up with repeated operands, saves an allocation for each node.
        let (all, count) = match *self {
            Node::Input(_) | Node::Constant(_) | Node::Variable(..) | Node::Result(..) => ([Id(0); 4], 0),
            Node::Neg(a)
            | Node::Sqrt(a)
            | Node::Recip(a)
            | Node::Tanh(a)
            | Node::Abs(a)
            | Node::Sin(a)
            | Node::Cos(a)
            | Node::Round(a)
            | Node::Gather(_, a) => ([a; 4], 1),
            Node::Add(a, b)
            | Node::Sub(a, b)
            | Node::Mul(a, b)
            | Node::Div(a, b)
            | Node::Min(a, b)
            | Node::Max(a, b)
            | Node::Unless(a, b) => ([a, b, a, a], 2),
            Node::Fma(a, b, c) | Node::Fnma(a, b, c) | Node::Merge(a, b, c) | Node::Call(_, _, a, b, c) => {
                ([a, b, c, a], 3)
            }
            Node::Select(a, b, x, y) => ([a, b, x, y], 4),
        };
        all.into_iter().take(count)
    }
}

/// A number that the turns of a loop hand on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Carried {
    /// Its value in the first turn.
    pub first: Id,
    /// Its value at the end of a turn: that of the next turn, and of the result.
    pub next: Id,
}

/// What is special about a region's nodes.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum RegionKind {
    /// They are needed only where this guard is not 0 in some lane. Nodes elsewhere use them only through
    /// [`Node::Merge`], or in regions of the same guard.
    Guarded(Id),
    /// They are computed `count` times. Nodes elsewhere use them only through [`Node::Result`].
    Loop {
        /// Turns.
        count: usize,
        /// What turns hand on.
        carried: Vec<Carried>,
    },
}

/// Nodes in a row that belong together. Regions nest.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Region {
    /// Why they belong together.
    pub kind: RegionKind,
    /// The nodes, those of inner regions among them.
    pub nodes: Range<u32>,
    /// The region it lies in.
    pub parent: Option<u32>,
}

/// A recorded computation.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Graph {
    /// Operations, in an order in which they can be computed.
    pub nodes: Vec<Node>,
    /// Regions, outer before inner, in the order in which they begin.
    pub regions: Vec<Region>,
    /// What was asked for.
    pub outputs: Vec<Id>,
    /// Number of inputs.
    pub inputs: usize,
    /// What [`Node::Gather`] reads: constants that are too many for nodes, such as the heights of a field.
    pub tables: Vec<Arc<[f64]>>,
    /// What [`Node::Call`] computes: functions of three numbers with four outputs, without regions.
    pub functions: Vec<Arc<Graph>>,
}

/// What a recorded function may not do.
#[derive(Clone, Copy, Debug, PartialEq, Eq, thiserror::Error)]
pub enum TraceError {
    /// A number made in a region is used outside of it.
    #[error(
        "node {} is used outside of the region in which it was made; pass it on with `Real::merge` after a guarded \
         region, or as a carried number of the loop", .0.0
    )]
    Escapes(Id),
    /// A table that is not of constants.
    #[error("a table whose entries are no constants cannot be recorded")]
    Table,
    /// A function with regions, or one that calls another.
    #[error(
        "a function that is called at many places has guarded regions or loops, or calls another; use `Real::select_lt` in it"
    )]
    Function,
    /// Regions are not properly nested.
    #[error("a region ends that is not the one begun last; end inner regions first")]
    Nesting,
    /// A loop ends with another number of carried numbers than it began with.
    #[error("a loop begins with {began} carried numbers and ends with {ended}; give the same ones")]
    Carried {
        /// At the beginning.
        began: usize,
        /// At the end.
        ended: usize,
    },
}
