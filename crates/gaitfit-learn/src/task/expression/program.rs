//! Expressions as a list of steps that computes them for several robots at once.
//!
//! Trees are walked once, when a task is made. A step takes whole rows, and each number of a row is [`LANES`] robots side
//! by side, so that the time goes into vector instructions and not into finding out what to do. Expressions
//! share equal steps. The program computes in the order of the trees, so the values have the same bits as
//! an evaluation robot by robot.

use std::collections::HashMap;

use super::operator::select;
use super::{Expression, FoldKind, Node, One, Quantity, Two};
use crate::task::Moment;

/// Robots that are computed together: several vectors of any machine.
pub(in crate::task) const LANES: usize = 32;

/// Rows of all steps: the first element of all robots, then the second, and so on.
pub(in crate::task) type Scratch = Vec<Vec<f32>>;

/// A row: its place in the scratch, and its width.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
struct Row {
    at: usize,
    width: usize,
}

/// The work of a step. `R` names rows, by the number of the step that makes them or by their place.
#[derive(Clone, Debug, PartialEq, Eq, Hash)]
enum Work<R> {
    /// The number with these bits.
    Number(u32),
    Quantity(Quantity, Vec<usize>),
    One(One, R),
    Two(Two, [R; 2]),
    Select([R; 3]),
    Fold(FoldKind, R),
}

impl<R: Copy> Work<R> {
    /// Rows that it reads.
    fn sources(&self) -> &[R] {
        match self {
            Self::Number(_) | Self::Quantity(..) => &[],
            Self::One(_, row) | Self::Fold(_, row) => std::slice::from_ref(row),
            Self::Two(_, rows) => rows,
            Self::Select(rows) => rows,
        }
    }

    /// The same work with its rows renamed by `name`.
    fn renamed<S>(&self, name: impl Fn(R) -> S) -> Work<S> {
        match self {
            Self::Number(bits) => Work::Number(*bits),
            Self::Quantity(quantity, places) => Work::Quantity(*quantity, places.clone()),
            Self::One(operator, row) => Work::One(*operator, name(*row)),
            Self::Two(operator, rows) => Work::Two(*operator, rows.map(name)),
            Self::Select(rows) => Work::Select(rows.map(name)),
            Self::Fold(kind, row) => Work::Fold(*kind, name(*row)),
        }
    }
}

/// The values of several expressions.
#[derive(Debug, Default)]
pub(in crate::task) struct Program {
    steps: Vec<(Work<Row>, Row)>,
    /// Place of each expression's value at the end.
    values: Vec<usize>,
    /// Numbers of each row of the scratch.
    sizes: Vec<usize>,
}

impl Program {
    pub(in crate::task) fn new<'a>(expressions: impl IntoIterator<Item = &'a Expression>) -> Self {
        let mut list = List::default();
        // All steps of all expressions are known before places are given: a row may serve several expressions.
        let values: Vec<usize> =
            expressions.into_iter().map(|expression| list.expression(expression)).collect();
        list.placed(&values)
    }

    /// Memory for [`Program::run`].
    pub(in crate::task) fn scratch(&self) -> Scratch {
        self.sizes.iter().map(|&size| vec![0.0; size]).collect()
    }

    /// Writes the expressions' values of up to [`LANES`] robots, a row a robot. `scratch`: [`Program::scratch`].
    pub(in crate::task) fn run(&self, moments: &[Moment<'_>], scratch: &mut Scratch, values: &mut [f32]) {
        for (work, to) in &self.steps {
            // Taken out, so that the step can read the other rows; `placed` lets no step write where it reads.
            let mut row = std::mem::take(&mut scratch[to.at]);
            step(work, moments, scratch, &mut row);
            scratch[to.at] = row;
        }
        // A program without expressions has rows of no width, which chunks refuse.
        let width = self.values.len().max(1);
        for (lane, row) in values.chunks_exact_mut(width).enumerate().take(moments.len()) {
            row.iter_mut().zip(&self.values).for_each(|(value, &at)| *value = scratch[at][lane]);
        }
    }
}

fn step(work: &Work<Row>, moments: &[Moment<'_>], scratch: &Scratch, to: &mut [f32]) {
    // A single number stands beside every element of a row.
    let element = |row: &Row, k: usize| {
        let from = if row.width == 1 { 0 } else { k * LANES };
        &scratch[row.at][from..from + LANES]
    };
    let elements = |to| <[f32]>::chunks_exact_mut(to, LANES).enumerate();
    match work {
        Work::Number(bits) => to.fill(f32::from_bits(*bits)),
        Work::Quantity(quantity, places) => {
            // Lanes without a robot keep old numbers, which `run` does not hand out.
            elements(to).zip(places).for_each(|((_, to), &place)| quantity.load(moments, place, to));
        }
        Work::One(operator, row) => operator.apply(&scratch[row.at], to),
        // Rows of the same width are one loop over all their numbers.
        Work::Two(operator, [a, b]) if a.width == b.width => {
            operator.apply(&scratch[a.at], &scratch[b.at], to);
        }
        Work::Two(operator, [a, b]) => {
            elements(to).for_each(|(k, to)| operator.apply(element(a, k), element(b, k), to));
        }
        Work::Select([condition, yes, no]) => elements(to)
            .for_each(|(k, to)| select(element(condition, k), element(yes, k), element(no, k), to)),
        Work::Fold(kind, row) => kind.apply(&scratch[row.at], to),
    }
}

/// A program in the making: rows are named by the number of their step.
#[derive(Default)]
struct List {
    steps: Vec<(Work<usize>, usize)>,
    known: HashMap<Work<usize>, usize>,
}

impl List {
    /// The step that makes an expression's value.
    fn expression(&mut self, expression: &Expression) -> usize {
        let mut folded = Vec::with_capacity(expression.folds().len());
        for fold in expression.folds() {
            let work = if fold.width == 0 {
                // Pairs of a single element: there is none.
                let mut value = [0.0];
                fold.kind.apply(&[], &mut value);
                Work::Number(value[0].to_bits())
            } else {
                Work::Fold(fold.kind, self.node(&fold.row, &folded))
            };
            folded.push(self.step(work, 1));
        }
        self.node(expression.root(), &folded)
    }

    /// Index of the step that computes a node's row. `folded`: indices of the steps of the expression's earlier folds.
    fn node(&mut self, node: &Node, folded: &[usize]) -> usize {
        match node {
            Node::Number(number) => self.step(Work::Number(number.to_bits()), 1),
            Node::Quantity(quantity, places) => {
                self.step(Work::Quantity(*quantity, places.clone()), places.len())
            }
            Node::Fold(number) => folded[*number],
            Node::One(operator, of) => {
                let row = self.node(of, folded);
                self.step(Work::One(*operator, row), self.steps[row].1)
            }
            Node::Two(operator, nodes) => {
                let rows = [self.node(&nodes[0], folded), self.node(&nodes[1], folded)];
                let width = self.common(&rows);
                self.step(Work::Two(*operator, rows), width)
            }
            Node::Select(nodes) => {
                let rows = [0, 1, 2].map(|k| self.node(&nodes[k], folded));
                let width = self.common(&rows);
                self.step(Work::Select(rows), width)
            }
        }
    }

    /// The width of rows that are taken together: that of the ones that are not single numbers.
    fn common(&self, rows: &[usize]) -> usize {
        let widths = rows.iter().map(|&row| self.steps[row].1);
        widths.reduce(|a, b| if a == 1 { b } else { a }).unwrap_or(1)
    }

    fn step(&mut self, work: Work<usize>, width: usize) -> usize {
        if let Some(&known) = self.known.get(&work) {
            return known;
        }
        self.known.insert(work.clone(), self.steps.len());
        self.steps.push((work, width));
        self.steps.len() - 1
    }

    /// Gives every row a place in the scratch; the place of a row that nobody reads any more is given again.
    fn placed(self, values: &[usize]) -> Program {
        // The last step that reads each row; a row that nobody reads ends with its own step.
        let mut last: Vec<usize> = (0..self.steps.len()).collect();
        for (number, (work, _)) in self.steps.iter().enumerate() {
            work.sources().iter().for_each(|&row| last[row] = number);
        }
        // Rows that are results are read after the last step, so their places are never free.
        values.iter().for_each(|&row| last[row] = usize::MAX);
        let mut rows: Vec<Row> = Vec::with_capacity(self.steps.len());
        // Places of each width that are free again.
        let mut free: HashMap<usize, Vec<usize>> = HashMap::new();
        let (mut sizes, mut steps) = (Vec::new(), Vec::with_capacity(self.steps.len()));
        for (number, (work, width)) in self.steps.iter().enumerate() {
            // The place is taken before the places that this step reads are free: no step writes where it
            // reads.
            let at = free.get_mut(width).and_then(Vec::pop).unwrap_or_else(|| {
                sizes.push(width * LANES);
                sizes.len() - 1
            });
            let to = Row { at, width: *width };
            rows.push(to);
            steps.push((work.renamed(|row| rows[row]), to));
            let mut done: Vec<usize> = work.sources().to_vec();
            done.sort_unstable();
            // A step may read a row twice, as x · x does. Its place must be free only once, or two rows would
            // get it.
            done.dedup();
            for row in done.into_iter().filter(|&row| last[row] == number) {
                free.entry(rows[row].width).or_default().push(rows[row].at);
            }
        }
        Program { steps, values: values.iter().map(|&row| rows[row].at).collect(), sizes }
    }
}
