//! Functions that exporters write as several nodes, put together again: SiLU, GELU and layer norm.
//!
//! A function that is found becomes one node in the place of its last; nodes that nothing else needs go.

use super::attributes::Attributes;
use super::constant::Constant;
use super::proto::{Attribute, Node};
use prost::Message;
use std::collections::{HashMap, HashSet};

/// Difference up to which a constant counts as the one of a formula.
const CLOSE: f64 = 1e-4;

/// A function that one node stands for.
struct Fused {
    operator: &'static str,
    input: String,
    /// ε and axis of a layer norm.
    norm: Option<(f64, i64)>,
    /// Nodes that it replaces, without the last.
    inner: Vec<usize>,
}

struct Nodes<'a> {
    nodes: &'a [Node],
    /// Index of the node that gives a value.
    producer: HashMap<&'a str, usize>,
    constants: HashMap<String, Constant>,
}

/// `nodes` with the functions above in one node each. `constants`: the graph's initializers.
pub(super) fn fuse(nodes: Vec<Node>, constants: &HashMap<String, Constant>, outputs: &[String]) -> Vec<Node> {
    let mut all = Nodes { nodes: &nodes, producer: HashMap::new(), constants: HashMap::new() };
    for (index, node) in nodes.iter().enumerate() {
        for output in &node.output {
            all.producer.insert(output, index);
        }
    }
    // Formulas have single numbers only. Weights are not copied.
    let scalars = constants.iter().filter(|(_, constant)| constant.values.len() <= 1);
    all.constants.extend(scalars.map(|(name, constant)| (name.clone(), constant.clone())));
    for node in nodes.iter().filter(|node| node.op_type == "Constant") {
        let value = Attributes::decode(node).and_then(|attributes| attributes.constant());
        if let (Ok(value), Some(output)) = (value, node.output.first()) {
            all.constants.insert(output.clone(), value);
        }
    }
    let mut fused: HashMap<usize, Fused> = HashMap::new();
    for (index, node) in nodes.iter().enumerate() {
        // SiLU and GELU end with a product, a layer norm with a quotient.
        let one = match node.op_type.as_str() {
            "Mul" => all.silu(node).or_else(|| all.gelu(index)),
            "Div" => all.layer_norm(node),
            _ => None,
        };
        fused.extend(one.map(|one| (index, one)));
    }
    let inner: HashSet<usize> = fused.values().flat_map(|one| one.inner.iter().copied()).collect();
    // An inner node stays if something outside needs it. Backwards, everything that reads a node is known
    // before the node is judged.
    let mut needed: HashSet<&str> = outputs.iter().map(String::as_str).collect();
    for (index, node) in nodes.iter().enumerate().rev() {
        let gone = inner.contains(&index) && !node.output.iter().any(|name| needed.contains(name.as_str()));
        match fused.get(&index) {
            _ if gone => {}
            Some(one) => {
                needed.insert(&one.input);
            }
            None => needed.extend(node.input.iter().map(String::as_str)),
        }
    }
    let kept = nodes.iter().enumerate().filter(|(index, node)| {
        !inner.contains(index) || node.output.iter().any(|name| needed.contains(name.as_str()))
    });
    kept.map(|(index, node)| match fused.get(&index) {
        None => node.clone(),
        Some(Fused { operator, input, norm, .. }) => {
            let attributes = norm.iter().flat_map(|&(epsilon, i)| {
                let f = epsilon as f32;
                [
                    Attribute { name: "epsilon".to_owned(), f, ..Attribute::default() },
                    Attribute { name: "axis".to_owned(), i, ..Attribute::default() },
                ]
            });
            Node {
                input: vec![input.clone()],
                output: node.output.clone(),
                name: node.name.clone(),
                op_type: (*operator).to_owned(),
                attribute: attributes.map(|attribute| attribute.encode_to_vec()).collect(),
                domain: String::new(),
            }
        }
    })
    .collect()
}

impl Nodes<'_> {
    /// The node that gives `name`, if it is an `operator`.
    fn made_by(&self, name: &str, operator: &str) -> Option<usize> {
        self.producer.get(name).copied().filter(|&index| self.nodes[index].op_type == operator)
    }

    fn input(&self, index: usize, number: usize) -> Option<&str> {
        self.nodes[index].input.get(number).map(String::as_str)
    }

    fn scalar(&self, name: &str) -> Option<f64> {
        self.constants.get(name)?.as_scalar()
    }

    /// The node's input that is not the number `value`.
    fn beside(&self, index: usize, value: f64) -> Option<&str> {
        let [a, b] = &self.nodes[index].input[..] else { return None };
        let is = |name: &str| self.scalar(name).is_some_and(|found| (found - value).abs() < CLOSE);
        if is(b) { Some(a) } else { is(a).then_some(b) }
    }

    /// x σ(x).
    fn silu(&self, node: &Node) -> Option<Fused> {
        let [a, b] = &node.input[..] else { return None };
        [(a, b), (b, a)].into_iter().find_map(|(x, gate)| {
            // The product commutes, so each factor is tried as the gate.
            let sigmoid = self.made_by(gate, "Sigmoid")?;
            let silu = Fused { operator: "Silu", input: x.clone(), norm: None, inner: vec![sigmoid] };
            (self.input(sigmoid, 0) == Some(x)).then_some(silu)
        })
    }

    /// Factors of a product of products that are not numbers, and the numbers' product.
    fn factors(&self, index: usize, inner: &mut Vec<usize>, deep: usize) -> Option<(Vec<String>, f64)> {
        let (mut names, mut number) = (Vec::new(), 1.0);
        for name in &self.nodes[index].input {
            if let Some(value) = self.scalar(name) {
                number *= value;
            } else if let Some(product) = self.made_by(name, "Mul").filter(|_| deep > 0) {
                let (inner_names, factor) = self.factors(product, inner, deep - 1)?;
                inner.push(product);
                names.extend(inner_names);
                number *= factor;
            } else {
                names.push(name.clone());
            }
        }
        // No formula here has more than three factors: x · x · x in GELU's cube.
        (names.len() <= 3).then_some((names, number))
    }

    /// ½ x (1 + erf(x / √2)), or with ½ x (1 + tanh(√(2/π) (x + 0.044715 x³))).
    fn gelu(&self, index: usize) -> Option<Fused> {
        let mut inner = Vec::new();
        // Exporters nest the factors ½, x and the sum in different orders, so products of products are opened too.
        let (names, number) = self.factors(index, &mut inner, 2)?;
        let [a, b] = &names[..] else { return None };
        if (number - 0.5).abs() > CLOSE {
            return None;
        }
        [(a, b), (b, a)].into_iter().find_map(|(x, sum)| {
            let sum = self.made_by(sum, "Add")?;
            let bell = self.beside(sum, 1.0)?;
            let mut inner = inner.clone();
            inner.push(sum);
            let operator = match self.made_by(bell, "Erf") {
                Some(erf) => {
                    // x / √2 is written as a quotient or as a product.
                    let scaled = *self.producer.get(self.input(erf, 0)?)?;
                    let root = match self.nodes[scaled].op_type.as_str() {
                        "Div" if self.input(scaled, 0) == Some(x) => {
                            self.beside(scaled, std::f64::consts::SQRT_2)
                        }
                        "Mul" => self.beside(scaled, std::f64::consts::FRAC_1_SQRT_2),
                        _ => None,
                    };
                    inner.extend([erf, scaled]);
                    (root == Some(x)).then_some("Gelu")?
                }
                None => {
                    // The argument of the tangent: a product of √(2/π) and a sum, whose cube is a product or
                    // a power.
                    let tanh = self.made_by(bell, "Tanh")?;
                    let outer = self.made_by(self.input(tanh, 0)?, "Mul")?;
                    let (names, number) = self.factors(outer, &mut inner, 1)?;
                    let [sum] = &names[..] else { return None };
                    let sum = self.made_by(sum, "Add")?;
                    inner.extend([tanh, outer, sum]);
                    let [first, second] = &self.nodes[sum].input[..] else { return None };
                    let cubic = if first == x { second } else { first };
                    let cubic = self.made_by(cubic, "Mul")?;
                    inner.push(cubic);
                    let (names, factor) = self.factors(cubic, &mut inner, 2)?;
                    let cube = match &names[..] {
                        [a, b, c] => a == x && b == x && c == x,
                        [power] => {
                            let power = self.made_by(power, "Pow")?;
                            inner.push(power);
                            self.input(power, 0) == Some(x) && self.beside(power, 3.0) == Some(x)
                        }
                        _ => false,
                    };
                    // Single precision rounds far less than CLOSE.
                    let right = (number - std::f64::consts::FRAC_2_PI.sqrt()).abs() < CLOSE
                        && (factor - 0.044_715).abs() < CLOSE
                        && (first == x || second == x);
                    (cube && right).then_some("GeluTanh")?
                }
            };
            Some(Fused { operator, input: x.clone(), norm: None, inner })
        })
    }

    /// (x − mean) / √(variance + ε) over one axis. Only who knows the shape of x can say whether it is the last one.
    fn layer_norm(&self, node: &Node) -> Option<Fused> {
        let [centred, root] = &node.input[..] else { return None };
        // From the quotient upwards: root, sum with ε, variance, square, difference and mean of the same x.
        let root = self.made_by(root, "Sqrt")?;
        let sum = self.made_by(self.input(root, 0)?, "Add")?;
        let [a, b] = &self.nodes[sum].input[..] else { return None };
        // The sum commutes: ε is on either side.
        let (variance, epsilon) = match (self.scalar(a), self.scalar(b)) {
            (_, Some(epsilon)) => (a, epsilon),
            (Some(epsilon), _) => (b, epsilon),
            _ => return None,
        };
        let (variance, axis) = self.mean(variance)?;
        let square = *self.producer.get(self.input(variance, 0)?)?;
        let squared = match self.nodes[square].op_type.as_str() {
            "Mul" => self.nodes[square].input == [centred.clone(), centred.clone()],
            "Pow" => self.input(square, 0) == Some(centred) && self.beside(square, 2.0) == Some(centred),
            _ => false,
        };
        let difference = self.made_by(centred, "Sub")?;
        let x = self.input(difference, 0)?;
        let (mean, same) = self.mean(self.input(difference, 1)?)?;
        let inner = vec![root, sum, variance, square, difference, mean];
        let norm = Some((epsilon, axis));
        let norm = Fused { operator: "LayerNormalization", input: x.to_owned(), norm, inner };
        (squared && axis == same && self.input(mean, 0) == Some(x)).then_some(norm)
    }

    /// The node of a mean over one axis, and the axis.
    fn mean(&self, name: &str) -> Option<(usize, i64)> {
        let index = self.made_by(name, "ReduceMean")?;
        let attributes = Attributes::decode(&self.nodes[index]).ok()?;
        let axis = match self.input(index, 1) {
            Some(axes) => self.scalar(axes).map(|axis| axis as i64),
            None => attributes.one_of("axes"),
        };
        // Without the kept axis the mean could not be subtracted row by row.
        Some((index, axis?)).filter(|_| attributes.integer("keepdims", 1) == 1)
    }
}
