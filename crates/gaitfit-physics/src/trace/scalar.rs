//! The recording scalar.

use core::ops::{Add, Mul, Neg, Sub};

use super::graph::{Id, Node};
use super::record::{call, constant, enter, gather, input, leave, node};
use crate::Real;

/// A number of the recording of this thread.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Traced(pub(super) Id);

/// What is the same for all environments of a block: known now, or an input such as a network's weight.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Known {
    /// A constant of the program.
    Constant(f64),
    /// A number of the recording.
    Number(Traced),
}

/// The guard of a region; none for a region that is never needed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Guard(Option<Id>);

impl Traced {
    /// A new input.
    pub fn input() -> Self {
        input()
    }

    /// Its node.
    pub fn id(self) -> Id {
        self.0
    }
}

impl Add for Traced {
    type Output = Self;
    fn add(self, b: Self) -> Self {
        node(Node::Add(self.0, b.0))
    }
}
impl Sub for Traced {
    type Output = Self;
    fn sub(self, b: Self) -> Self {
        node(Node::Sub(self.0, b.0))
    }
}
impl Mul for Traced {
    type Output = Self;
    fn mul(self, b: Self) -> Self {
        node(Node::Mul(self.0, b.0))
    }
}
impl Neg for Traced {
    type Output = Self;
    fn neg(self) -> Self {
        node(Node::Neg(self.0))
    }
}

impl Real for Traced {
    type K = Known;
    type Guard = Guard;

    fn constant(x: f64) -> Known {
        Known::Constant(x)
    }
    fn k(x: Known) -> Self {
        match x {
            // Kept as bits, because nodes are compared and hashed, which `f64` cannot be.
            Known::Constant(x) => node(Node::Constant(x.to_bits())),
            Known::Number(number) => number,
        }
    }
    fn fma(self, b: Self, c: Self) -> Self {
        node(Node::Fma(self.0, b.0, c.0))
    }
    fn fnma(self, b: Self, c: Self) -> Self {
        node(Node::Fnma(self.0, b.0, c.0))
    }
    fn div(self, b: Self) -> Self {
        node(Node::Div(self.0, b.0))
    }
    fn sqrt(self) -> Self {
        node(Node::Sqrt(self.0))
    }
    fn recip(self) -> Self {
        node(Node::Recip(self.0))
    }
    fn tanh(self) -> Self {
        node(Node::Tanh(self.0))
    }
    fn min(self, b: Self) -> Self {
        node(Node::Min(self.0, b.0))
    }
    fn max(self, b: Self) -> Self {
        node(Node::Max(self.0, b.0))
    }
    fn abs(self) -> Self {
        node(Node::Abs(self.0))
    }
    fn select_lt(a: Self, b: Self, x: Self, y: Self) -> Self {
        node(Node::Select(a.0, b.0, x.0, y.0))
    }
    fn sin_cos(self) -> (Self, Self) {
        (node(Node::Sin(self.0)), node(Node::Cos(self.0)))
    }
    fn round(self) -> Self {
        node(Node::Round(self.0))
    }
    fn gather(table: &[Known], index: Self) -> Self {
        gather(table, index)
    }
    fn call(key: usize, inputs: [Self; 3], function: impl FnOnce([Self; 3]) -> [Self; 4]) -> [Self; 4] {
        call(key, inputs, function)
    }
    fn never() -> Guard {
        Guard(None)
    }
    fn unless_ge(self, b: Self) -> Guard {
        // Two constants decide the guard while recording; a region that is never needed leaves no nodes.
        if let (Some(a), Some(b)) = (constant(self.0), constant(b.0))
            && a >= b
        {
            return Guard(None);
        }
        Guard(Some(node(Node::Unless(self.0, b.0)).0))
    }
    fn enter(guard: Guard) -> bool {
        guard.0.inspect(|&id| enter(id)).is_some()
    }
    fn leave(guard: Guard) {
        if let Some(id) = guard.0 {
            leave(id);
        }
    }
    fn merge(self, guard: Guard, before: Self) -> Self {
        match guard.0 {
            // A region that changed nothing needs no node.
            Some(_) if self == before => before,
            Some(id) => node(Node::Merge(id, self.0, before.0)),
            None => before,
        }
    }
}
