//! Reward terms written as expressions, as CUDA text: a function of a robot's moment each, from the same tree that the
//! CPU goes through.

use std::fmt::Write;

use gaitfit_learn::task::expression::{Expression, FoldKind, Node, One, Quantity, Two};

use crate::words::single;

/// Functions of terms, and the tables of places that they pick from.
#[derive(Default)]
pub(super) struct Terms {
    tables: Vec<Vec<usize>>,
    functions: String,
}

impl Terms {
    /// Adds a term's function, `reward_NAME`. Names of terms are plain identifiers.
    pub(super) fn add(&mut self, name: &str, expression: &Expression) {
        let mut body = String::new();
        for (number, fold) in expression.folds().iter().enumerate() {
            let value = self.node(&fold.row);
            let (width, result) = (fold.width, format!("fold{number}"));
            let next = match fold.kind {
                FoldKind::Sum | FoldKind::Mean => format!("{result} + x"),
                FoldKind::Norm => format!("{result} + x * x"),
                FoldKind::Min => format!("i == 0 ? x : term_least({result}, x)"),
                FoldKind::Max => format!("i == 0 ? x : term_largest({result}, x)"),
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
        let mut text = String::new();
        for (number, places) in self.tables.iter().enumerate() {
            let places: Vec<String> = places.iter().map(ToString::to_string).collect();
            let _ = writeln!(text, "TABLE int PICKED_{number}[] = {{{}}};", places.join(", "));
        }
        text + &self.functions
    }

    /// The expression of element `i` of a node.
    fn node(&mut self, node: &Node) -> String {
        match node {
            Node::Number(number) => format!("({})", single(*number)),
            Node::Quantity(quantity, places) => {
                let place = self.place(places);
                self.quantity(*quantity, &place)
            }
            Node::Fold(number) => format!("fold{number}"),
            Node::One(operator, of) => {
                let x = self.node(of);
                match operator {
                    One::Negate => format!("(-{x})"),
                    One::Not => format!("term_flag({x} == 0.0f)"),
                    One::Abs => format!("fabsf({x})"),
                    One::Sqrt => format!("sqrtf({x})"),
                    One::Square => format!("term_square({x})"),
                    One::Exp => format!("expf({x})"),
                    One::Ln => format!("logf({x})"),
                    One::Sin => format!("sinf({x})"),
                    One::Cos => format!("cosf({x})"),
                    One::Tanh => format!("tanhf({x})"),
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
                    Two::Min => format!("term_least({a}, {b})"),
                    Two::Max => format!("term_largest({a}, {b})"),
                    Two::Less => format!("term_flag({a} < {b})"),
                    Two::LessOrEqual => format!("term_flag({a} <= {b})"),
                    Two::Greater => format!("term_flag({a} > {b})"),
                    Two::GreaterOrEqual => format!("term_flag({a} >= {b})"),
                    Two::Equal => format!("term_flag({a} == {b})"),
                    Two::Unequal => format!("term_flag({a} != {b})"),
                    Two::And => format!("term_flag({a} != 0.0f && {b} != 0.0f)"),
                    Two::Or => format!("term_flag({a} != 0.0f || {b} != 0.0f)"),
                }
            }
            Node::Select(nodes) => {
                let [condition, yes, no] = [self.node(&nodes[0]), self.node(&nodes[1]), self.node(&nodes[2])];
                format!("({condition} != 0.0f ? {yes} : {no})")
            }
        }
    }

    /// Which number of a quantity element `i` is.
    fn place(&mut self, places: &[usize]) -> String {
        match places {
            // A single number stands beside every element of a row.
            [place] => place.to_string(),
            _ if places.iter().enumerate().all(|(k, &place)| k == place) => "i".to_owned(),
            _ => {
                let known = self.tables.iter().position(|table| table == places);
                let number = known.unwrap_or_else(|| {
                    self.tables.push(places.to_vec());
                    self.tables.len() - 1
                });
                format!("PICKED_{number}[i]")
            }
        }
    }

    fn quantity(&self, quantity: Quantity, k: &str) -> String {
        match quantity {
            Quantity::Command => format!("m.command[{k}]"),
            Quantity::Velocity => format!("m.velocity[{k}]"),
            Quantity::AngularVelocity => format!("m.angular[{k}]"),
            Quantity::YawRate => "m.yaw_rate".to_owned(),
            Quantity::Gravity => format!("m.gravity[{k}]"),
            Quantity::Uprightness => "m.uprightness".to_owned(),
            Quantity::Height => "m.height".to_owned(),
            Quantity::Qpos => format!("joint_position(m.state, m.params, m.e, {k})"),
            Quantity::DefaultPose => format!("DEFAULT_POSE[{k}]"),
            Quantity::Qvel => format!("joint_velocity(m.state, m.e, {k})"),
            Quantity::Qacc => format!("term_acceleration(m, {k})"),
            Quantity::Tau => format!("term_torque(m, {k})"),
            Quantity::Target => format!("term_target(m, {k})"),
            Quantity::Action => format!("m.action[{k}]"),
            Quantity::LastAction => format!("m.last_action[({k}) * ENVIRONMENTS + m.e]"),
            Quantity::Contact => format!("term_flag(m.feet[{k}].touching)"),
            Quantity::Landed => format!("term_flag(m.feet[{k}].landed)"),
            Quantity::FootHeight => format!("m.feet[{k}].height"),
            Quantity::FootSpeed => format!("m.feet[{k}].speed"),
            Quantity::AirTime => format!("m.feet[{k}].air"),
            Quantity::ContactTime => format!("m.feet[{k}].contact"),
            Quantity::LastAirTime => format!("m.feet[{k}].last_air"),
            Quantity::BodyContacts => "(float)m.body_contacts".to_owned(),
            Quantity::Walking => "term_flag(m.walking)".to_owned(),
            Quantity::Fallen => "term_flag(m.fallen)".to_owned(),
            Quantity::Clock => "m.clock".to_owned(),
            Quantity::Dt => "(float)CONTROL_DT".to_owned(),
        }
    }
}
