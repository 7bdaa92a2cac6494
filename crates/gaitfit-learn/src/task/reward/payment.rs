//! Payment of several robots by a task's reward terms.

use super::{Value, WeightedTerm};
use crate::task::Moment;
use crate::task::expression::program::{self, LANES, Program};

/// The reward terms of a task. Those that are expressions are computed together.
#[derive(Default)]
pub(in crate::task) struct Rewards {
    terms: Vec<WeightedTerm>,
    program: Program,
    /// Number of the term that each value of the program is.
    numbers: Vec<usize>,
}

/// Memory for [`Rewards::pay`].
#[derive(Default)]
pub(in crate::task) struct Scratch {
    rows: program::Scratch,
    values: Vec<f32>,
}

impl Rewards {
    /// The rewards of these terms, all of non-zero weight.
    pub(in crate::task) fn new(terms: Vec<WeightedTerm>) -> Self {
        let expressions = terms.iter().enumerate().filter_map(|(number, term)| match &term.value {
            Value::Expression(expression) => Some((number, expression)),
            Value::Own(_) => None,
        });
        let (numbers, expressions): (Vec<_>, Vec<_>) = expressions.unzip();
        let program = Program::new(expressions);
        Self { terms, program, numbers }
    }

    /// Adds a term that is not an expression.
    pub(in crate::task) fn push(&mut self, term: WeightedTerm) {
        self.terms.push(term);
    }

    /// The terms.
    pub(in crate::task) fn terms(&self) -> &[WeightedTerm] {
        &self.terms
    }

    /// Memory for [`Rewards::pay`].
    pub(in crate::task) fn scratch(&self) -> Scratch {
        Scratch { rows: self.program.scratch(), values: vec![0.0; LANES * self.numbers.len()] }
    }

    /// Writes weight times value of each term, a row a robot; up to [`LANES`] robots. Functions of a library's user are
    /// not asked about robots whose simulation came apart, those that are not `whole`.
    pub(in crate::task) fn pay(
        &self,
        moments: &[Moment<'_>],
        whole: &[bool],
        scratch: &mut Scratch,
        paid: &mut [f32],
    ) {
        self.program.run(moments, &mut scratch.rows, &mut scratch.values);
        let mut values = scratch.values.chunks_exact(self.numbers.len().max(1));
        // A task without terms has rows of no width, which chunks refuse.
        let rows = paid.chunks_exact_mut(self.terms.len().max(1));
        for ((moment, &whole), row) in moments.iter().zip(whole).zip(rows) {
            // Expressions were computed for all robots together; functions of the user are called robot by
            // robot.
            for (&number, value) in self.numbers.iter().zip(values.next().unwrap_or_default()) {
                row[number] = self.terms[number].weight * value;
            }
            for (slot, term) in row.iter_mut().zip(&self.terms) {
                if let Value::Own(value) = &term.value {
                    *slot = if whole { term.weight * value(moment) } else { 0.0 };
                }
            }
        }
    }
}
