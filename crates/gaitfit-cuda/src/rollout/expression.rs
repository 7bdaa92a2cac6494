//! Reward terms as CUDA text: a function of a robot's moment each, from the same tree that the CPU's program comes from.

use std::fmt::Write;

use gaitfit_learn::task::Task;
use gaitfit_learn::task::expression::{Expression, FoldKind, Node, One, Quantity, Two};

use crate::words::{Words, single};

/// Longest row whose elements are written one after the other: the pairs of four feet, whose numbers the compiler then
/// keeps in registers. Longer ones are loops, for the text's length.
const MAX_WRITTEN_OUT: usize = 8;

/// Functions of a task's terms, and the tables that they read.
pub(super) struct Terms<'a> {
    task: &'a Task,
    tables: Vec<(&'static str, Vec<String>)>,
    functions: String,
}

impl<'a> Terms<'a> {
    pub(super) fn new(task: &'a Task) -> Self {
        Self { task, tables: Vec::new(), functions: String::new() }
    }

    /// Adds a term's function, `reward_NAME`. Names of terms are plain identifiers.
    pub(super) fn add(&mut self, name: &str, expression: &Expression) {
        let mut body = String::new();
        for (number, fold) in expression.folds().iter().enumerate() {
            let (width, result) = (fold.width, format!("fold{number}"));
            let next = |first: &str| match fold.kind {
                FoldKind::Sum | FoldKind::Mean => format!("{result} + x"),
                FoldKind::Norm => format!("{result} + x * x"),
                FoldKind::Min => format!("{first} ? x : smaller({result}, x)"),
                FoldKind::Max => format!("{first} ? x : larger({result}, x)"),
            };
            // Writing to a string does not fail.
            let _ = writeln!(body, "    float {result} = 0.0f;");
            if width <= MAX_WRITTEN_OUT {
                for i in 0..width {
                    let (value, next) = (self.node(&fold.row, Some(i)), next(&(i == 0).to_string()));
                    let _ = writeln!(body, "    {{ float x = {value}; {result} = {next}; }}");
                }
            } else {
                let (value, next) = (self.node(&fold.row, None), next("i == 0"));
                let _ = writeln!(
                    body,
                    "    for (int i = 0; i < {width}; i++) {{ float x = {value}; {result} = {next}; }}"
                );
            }
            let _ = match fold.kind {
                FoldKind::Mean => writeln!(body, "    {result} = {result} / {width}.0f;"),
                FoldKind::Norm => writeln!(body, "    {result} = sqrtf({result});"),
                _ => Ok(()),
            };
        }
        let value = self.node(expression.root(), Some(0));
        let _ = writeln!(
            self.functions,
            "DEVICE float reward_{name}(const Moment& m) {{\n{body}    return {value};\n}}"
        );
    }

    /// The text of all that was added.
    pub(super) fn text(self) -> String {
        let mut words = Words { text: String::new() };
        for (number, (kind, rows)) in self.tables.into_iter().enumerate() {
            words.table(kind, &format!("ROW_{number}"), rows);
        }
        words.text + &self.functions
    }

    /// The expression of element `i` of a node; `None`: of the variable `i`.
    fn node(&mut self, node: &Node, i: Option<usize>) -> String {
        match node {
            Node::Number(number) => format!("({})", single(*number)),
            Node::Quantity(quantity, places) => self.quantity(*quantity, places, i),
            Node::Fold(number) => format!("fold{number}"),
            Node::One(operator, of) => {
                let x = self.node(of, i);
                match operator {
                    One::Negate => format!("(-{x})"),
                    One::Not => format!("flag({x} == 0.0f)"),
                    One::Abs => format!("fabsf({x})"),
                    One::Sqrt => format!("sqrtf({x})"),
                    One::Square => format!("square({x})"),
                    One::Exp => format!("expf({x})"),
                    One::Ln => format!("logf({x})"),
                    One::Sin => format!("sinf({x})"),
                    One::Cos => format!("cosf({x})"),
                    One::Tanh => format!("tanhf({x})"),
                    One::Floor => format!("floorf({x})"),
                }
            }
            Node::Two(operator, nodes) => {
                let [a, b] = [0, 1].map(|k| self.node(&nodes[k], i));
                match operator {
                    Two::Add => format!("({a} + {b})"),
                    Two::Subtract => format!("({a} - {b})"),
                    Two::Multiply => format!("({a} * {b})"),
                    Two::Divide => format!("({a} / {b})"),
                    Two::Power => format!("powf({a}, {b})"),
                    Two::Min => format!("smaller({a}, {b})"),
                    Two::Max => format!("larger({a}, {b})"),
                    Two::Less => format!("flag({a} < {b})"),
                    Two::LessOrEqual => format!("flag({a} <= {b})"),
                    Two::Greater => format!("flag({a} > {b})"),
                    Two::GreaterOrEqual => format!("flag({a} >= {b})"),
                    Two::Equal => format!("flag({a} == {b})"),
                    Two::Unequal => format!("flag({a} != {b})"),
                    Two::And => format!("flag({a} != 0.0f && {b} != 0.0f)"),
                    Two::Or => format!("flag({a} != 0.0f || {b} != 0.0f)"),
                }
            }
            Node::Select(nodes) => {
                let [condition, yes, no] = [0, 1, 2].map(|k| self.node(&nodes[k], i));
                format!("({condition} != 0.0f ? {yes} : {no})")
            }
        }
    }

    fn quantity(&mut self, quantity: Quantity, places: &[usize], i: Option<usize>) -> String {
        let constant =
            |&place: &usize| quantity.constant(self.task, place).map(|x| format!("({})", single(x)));
        let moving = |place: &str| format!("quantity_{}(m, {place})", quantity.name());
        // A single number stands beside every element of a row.
        let element = if places.len() == 1 { Some(0) } else { i };
        if let Some(place) = element.and_then(|element| places.get(element)) {
            return constant(place).unwrap_or_else(|| moving(&place.to_string()));
        }
        if let Some(values) = places.iter().map(constant).collect::<Option<Vec<String>>>() {
            return self.element("float", values);
        }
        if places.iter().enumerate().all(|(k, &place)| k == place) {
            return moving("i");
        }
        let place = self.element("int", places.iter().map(ToString::to_string).collect());
        moving(&place)
    }

    /// Number `i` of a table.
    fn element(&mut self, kind: &'static str, rows: Vec<String>) -> String {
        let table = (kind, rows);
        let known = self.tables.iter().position(|other| *other == table);
        let number = known.unwrap_or_else(|| {
            self.tables.push(table);
            self.tables.len() - 1
        });
        format!("ROW_{number}[i]")
    }
}
