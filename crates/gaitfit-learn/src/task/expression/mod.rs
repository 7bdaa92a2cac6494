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
//! out: first each fold goes once over its row, then the rest is one number. So a value needs no memory, its cost
//! grows with text times row, and a GPU's text can be written from the same tree.

mod error;
mod operator;
mod parse;
mod quantity;
mod token;

use std::fmt;

use super::Moment;

pub use error::{ExpressionError, Problem};
pub use operator::{FoldKind, One, Two};
pub use quantity::{Elements, Names, Quantity};

/// Most folds of an expression.
const MAX_FOLDS: usize = 32;

/// A part of an expression: a number, or one for each element of a row.
#[derive(Clone, Debug, PartialEq)]
pub enum Node {
    /// The same number always.
    Number(f32),
    /// Numbers of a quantity, by their places in it. One place is a number, several are a row.
    Quantity(Quantity, Vec<usize>),
    /// What the fold of this number, in [`Expression::folds`], gives.
    Fold(usize),
    /// Of one value.
    One(One, Box<Node>),
    /// Of two values.
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

    /// Its value. What is not a number in it stays that, also through `min`, `max` and `clamp`.
    pub fn value(&self, moment: &Moment<'_>) -> f32 {
        let mut folded = [0.0; MAX_FOLDS];
        for (k, fold) in self.folds.iter().enumerate() {
            let values = (0..fold.width).map(|place| fold.row.value(moment, place, &folded));
            let value = fold.kind.value(values, fold.width);
            folded[k] = value;
        }
        self.value.value(moment, 0, &folded)
    }
}

impl fmt::Display for Expression {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(&self.text)
    }
}

impl Node {
    /// Its value where it is the same always.
    fn constant(&self) -> Option<f32> {
        Some(match self {
            Self::Number(number) => *number,
            Self::One(operator, node) => operator.value(node.constant()?),
            Self::Two(operator, nodes) => operator.value(nodes[0].constant()?, nodes[1].constant()?),
            Self::Quantity(..) | Self::Fold(_) | Self::Select(_) => return None,
        })
    }

    /// Element `place`; `folded`: what the folds before gave.
    fn value(&self, moment: &Moment<'_>, place: usize, folded: &[f32; MAX_FOLDS]) -> f32 {
        let evaluated = |node: &Self| node.value(moment, place, folded);
        match self {
            Self::Number(number) => *number,
            Self::Quantity(quantity, places) => {
                // A single number stands beside every element of a row.
                let element = if places.len() == 1 { 0 } else { place };
                places.get(element).map_or(f32::NAN, |&place| quantity.value(moment, place))
            }
            Self::Fold(number) => folded[*number],
            Self::One(operator, node) => operator.value(evaluated(node)),
            Self::Two(operator, nodes) => operator.value(evaluated(&nodes[0]), evaluated(&nodes[1])),
            Self::Select(nodes) => evaluated(&nodes[if evaluated(&nodes[0]) != 0.0 { 1 } else { 2 }]),
        }
    }
}
