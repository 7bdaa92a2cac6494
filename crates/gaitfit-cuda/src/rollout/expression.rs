//! Reward terms as CUDA text: a function of a robot's moment each, from the same tree that the CPU's program comes from.

use std::fmt::Write;

use gaitfit_learn::task::Task;
use gaitfit_learn::task::expression::{Expression, FoldKind, Node, One, Quantity, Two};

use crate::words::{Words, single};

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
            let value = self.node(&fold.row);
            let (width, result) = (fold.width, format!("fold{number}"));
            let next = match fold.kind {
                FoldKind::Sum | FoldKind::Mean => format!("{result} + x"),
                FoldKind::Norm => format!("{result} + x * x"),
                FoldKind::Min => format!("i == 0 ? x : smaller({result}, x)"),
                FoldKind::Max => format!("i == 0 ? x : larger({result}, x)"),
            };
            // Writing to a string does not fail.
            let _ = writeln!(body, "    float {result} = 0.0f;");
            let _ = writeln!(
                body,
                "    for (int i = 0; i < {width}; i++) {{ float x = {value}; {result} = {next}; }}"
            );
            let _ = match fold.kind {
                FoldKind::Mean => writeln!(body, "    {result} = {result} / {width}.0f;"),
                FoldKind::Norm => writeln!(body, "    {result} = sqrtf({result});"),
                _ => Ok(()),
            };
        }
        let value = self.node(expression.root());
        let _ = writeln!(
            self.functions,
            "DEVICE float reward_{name}(const Moment& m) {{\n    const int i = 0;\n    (void)i;\n{body}    return {value};\n}}"
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

    /// The expression of element `i` of a node.
    fn node(&mut self, node: &Node) -> String {
        match node {
            Node::Number(number) => format!("({})", single(*number)),
            Node::Quantity(quantity, places) => self.quantity(*quantity, places),
            Node::Fold(number) => format!("fold{number}"),
            Node::One(operator, of) => {
                let x = self.node(of);
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
                let [a, b] = [self.node(&nodes[0]), self.node(&nodes[1])];
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
                let [condition, yes, no] = [self.node(&nodes[0]), self.node(&nodes[1]), self.node(&nodes[2])];
                format!("({condition} != 0.0f ? {yes} : {no})")
            }
        }
    }

    fn quantity(&mut self, quantity: Quantity, places: &[usize]) -> String {
        let constants: Option<Vec<String>> = places
            .iter()
            .map(|&place| quantity.constant(self.task, place).map(|value| format!("({})", single(value))))
            .collect();
        match (constants, places) {
            // A single number stands beside every element of a row.
            (Some(values), [_]) => values.concat(),
            (Some(values), _) => self.element("float", values),
            (None, [place]) => format!("quantity_{}(m, {place})", quantity.name()),
            (None, _) => {
                let whole = places.iter().enumerate().all(|(k, &place)| k == place);
                let places = places.iter().map(ToString::to_string).collect();
                let place = if whole { "i".to_owned() } else { self.element("int", places) };
                format!("quantity_{}(m, {place})", quantity.name())
            }
        }
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
