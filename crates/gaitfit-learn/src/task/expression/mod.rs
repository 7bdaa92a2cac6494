//! Reward terms that users write: an expression over named quantities of a robot's [`Moment`].
//!
//! ```toml
//! [task.terms]
//! crouch = 'exp(-square((height - 0.25) / 0.05))'
//! calf_effort = 'sum(abs(tau["*_calf"]))'
//! [task.rewards]
//! crouch = 2.0
//! calf_effort = -1e-3
//! ```
//!
//! A quantity is a number or a row of numbers (one a joint, foot or axis). Operators work element by element; `sum`,
//! `mean`, `norm`, `min` and `max` fold a row into a number. An expression is kept as a tree in which folds are pulled
//! out: first each fold goes once over its row, then the rest is one number. So its cost grows with text times row. A GPU's
//! text is written from the tree; the CPU computes a `program::Program` of all expressions of a task for many robots
//! at once.

mod error;
mod operator;
mod parse;
pub(in crate::task) mod program;
mod quantity;
mod token;

use std::fmt;

use super::Moment;

pub use error::{ExpressionError, Problem};
pub(in crate::task) use operator::flag;
pub use operator::{FoldKind, One, Two};
pub use quantity::{Elements, Names, Quantity};

use program::Program;

/// Max number of folds of an expression.
const MAX_FOLDS: usize = 32;

/// A part of an expression: a number, or one for each element of a row.
#[derive(Clone, Debug, PartialEq)]
pub enum Node {
    /// A constant.
    Number(f32),
    /// Numbers of a quantity, by their places in it. One place is a number, several are a row.
    Quantity(Quantity, Vec<usize>),
    /// Result of the fold of this number, in [`Expression::folds`].
    Fold(usize),
    /// A function of one value.
    One(One, Box<Node>),
    /// A function of two values.
    Two(Two, Box<[Node; 2]>),
    /// The second where the first is not 0, else the third.
    Select(Box<[Node; 3]>),
}

/// A row made one number.
#[derive(Clone, Debug, PartialEq)]
pub struct Fold {
    /// How.
    pub kind: FoldKind,
    /// Numbers of the row.
    pub width: usize,
    /// The row. It may name earlier folds only.
    pub row: Node,
}

/// An expression over a robot's moment.
#[derive(Clone, Debug, PartialEq)]
pub struct Expression {
    text: String,
    folds: Vec<Fold>,
    value: Node,
}

impl Expression {
    /// Reads an expression for a robot of these joints and feet.
    ///
    /// # Errors
    /// What is wrong, at which character, and what there could be.
    pub fn new(text: &str, names: &Names<'_>) -> Result<Self, ExpressionError> {
        let (folds, value) = parse::parse(text, names)?;
        Ok(Self { text: text.to_owned(), folds, value })
    }

    /// As it was written.
    pub fn text(&self) -> &str {
        &self.text
    }

    /// Its folds, in the order in which they are made.
    pub fn folds(&self) -> &[Fold] {
        &self.folds
    }

    /// The number that it is, after its folds.
    pub fn root(&self) -> &Node {
        &self.value
    }

    /// Its value at one moment. NaN stays NaN, also through `min`, `max` and `clamp`. Each call compiles the expression; a task
    /// compiles its terms once.
    pub fn value(&self, moment: &Moment<'_>) -> f32 {
        let program = Program::new([self]);
        let mut values = [0.0];
        program.run(std::slice::from_ref(moment), &mut program.scratch(), &mut values);
        values[0]
    }
}

impl fmt::Display for Expression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Node {
    /// Its value, if it is the same at all moments.
    fn constant(&self) -> Option<f32> {
        Some(match self {
            Self::Number(number) => *number,
            Self::One(operator, node) => operator.value(node.constant()?),
            Self::Two(operator, nodes) => operator.value(nodes[0].constant()?, nodes[1].constant()?),
            Self::Quantity(..) | Self::Fold(_) | Self::Select(_) => return None,
        })
    }

    /// The row of its elements at `places`; a single number stays as it is.
    fn picked(self, places: &[usize]) -> Self {
        match self {
            // A single number stands beside every element, so there is nothing to pick from it.
            Self::Quantity(quantity, elements) if elements.len() != 1 => {
                let places = places.iter().filter_map(|&place| elements.get(place).copied());
                Self::Quantity(quantity, places.collect())
            }
            Self::One(operator, node) => Self::One(operator, Box::new(node.picked(places))),
            Self::Two(operator, nodes) => {
                Self::Two(operator, Box::new((*nodes).map(|node| node.picked(places))))
            }
            Self::Select(nodes) => Self::Select(Box::new((*nodes).map(|node| node.picked(places)))),
            Self::Number(_) | Self::Fold(_) | Self::Quantity(..) => self,
        }
    }
}
