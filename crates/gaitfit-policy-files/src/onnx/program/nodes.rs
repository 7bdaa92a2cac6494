//! Operators, one node at a time.

use super::shapes::{axis, broadcast, reach, reduced};
use super::{Program, Value};
use crate::onnx::attributes::Attributes;
use crate::onnx::node_error::{NodeError, misfit, unread};
use crate::onnx::proto::{DOUBLE, FLOAT, Node};
use gaitfit_policy::graph::{Along, Binary, Function, Operator, Reach, Reduction};
use gaitfit_policy::network::{Activation, LayerNorm};

/// Max number of inputs, outputs and attributes of a node.
pub(super) const MAX_PARTS: usize = 1024;

/// Refuses nodes that are not of ONNX's own operators, or have too many parts.
pub(super) fn bounded(node: &Node) -> Result<(), NodeError> {
    if !matches!(node.domain.as_str(), "" | "ai.onnx") {
        let domain = gaitfit_model::shown(&node.domain);
        return Err(unread(format!(
            "it is of the operator set `{domain}`; only ONNX's own operators are run"
        )));
    }
    if [node.input.len(), node.output.len(), node.attribute.len()].iter().any(|&count| count > MAX_PARTS) {
        return Err(misfit(format!("it has more than {MAX_PARTS} inputs, outputs or attributes")));
    }
    Ok(())
}

/// Error for an operator that is not run.
fn unknown() -> NodeError {
    unread(
        "it is not run here (docs/policies-foreign.md lists the operators). Export the actor without it, or run the whole \
         file as a function in Python (gaitfit.Policy, docs/python.md)",
    )
}

impl Program {
    /// A node whose inputs are known, one of them at least a value or an operator that is no constant arithmetic.
    pub(super) fn operator(&mut self, node: &Node, attributes: &Attributes) -> Result<(), NodeError> {
        if let Some(function) = function(&node.op_type, attributes)? {
            let input = self.value(node, 0)?;
            let dims = input.dims.clone();
            let value = self.step(Operator::Function(function), &[&input], dims)?;
            return self.give(node, 0, value);
        }
        if let Some(binary) = binary(&node.op_type) {
            return self.binary(node, binary);
        }
        if let Some(what) = reduction(&node.op_type) {
            return self.reduce(node, attributes, what);
        }
        match node.op_type.as_str() {
            // Dropout acts in training alone.
            "Identity" | "Dropout" => {
                let input = self.value(node, 0)?;
                self.give(node, 0, input)
            }
            "Cast" => {
                // Values are computed in single precision, whichever of the two the file names.
                if ![FLOAT, DOUBLE].map(i64::from).contains(&attributes.integer("to", 0)) {
                    return Err(unread("it makes whole numbers of values"));
                }
                let input = self.value(node, 0)?;
                self.give(node, 0, input)
            }
            "Slice" | "Gather" | "Unsqueeze" | "Squeeze" | "Reshape" | "Transpose" | "Flatten" | "Expand" => {
                let value = self.moved(node, attributes)?;
                self.give(node, 0, value)
            }
            "Concat" => self.concat(node, attributes),
            "Split" => self.split(node, attributes),
            "Clip" => self.clip(node, attributes),
            "Where" => self.choose(node),
            "MatMul" => self.matmul(node),
            "Gemm" => self.gemm(node, attributes),
            "Softmax" => self.along(node, attributes, Along::Softmax),
            "LogSoftmax" => self.along(node, attributes, Along::LogSoftmax),
            "LpNormalization" => match attributes.integer("p", 2) {
                1 => self.along(node, attributes, Along::L1),
                2 => self.along(node, attributes, Along::L2),
                p => Err(unread(format!("its p is {p}; 1 and 2 are run"))),
            },
            "LayerNormalization" => self.layer_norm(node, attributes),
            "BatchNormalization" => self.batch_norm(node, attributes),
            "Conv" => self.convolution(node, attributes),
            "LSTM" | "GRU" => self.recurrent(node, attributes),
            _ => Err(unknown()),
        }
    }

    /// Two inputs, or of some operators any number of them.
    fn binary(&mut self, node: &Node, binary: Binary) -> Result<(), NodeError> {
        let many = node.input.len();
        // ONNX lets these three take any number of inputs, which are joined one after the other.
        let several = matches!(node.op_type.as_str(), "Max" | "Min" | "Sum");
        if many != 2 && !(several && many > 0) {
            return Err(misfit(format!("it has {many} inputs")));
        }
        let mut value = self.value(node, 0)?;
        for number in 1..many {
            let other = self.value(node, number)?;
            value = self.both(binary, &value, &other)?;
        }
        self.give(node, 0, value)
    }

    /// A step on two values.
    pub(super) fn both(&mut self, binary: Binary, a: &Value, b: &Value) -> Result<Value, NodeError> {
        let dims = broadcast(&[&a.dims, &b.dims])?;
        let reaches = [a, b].map(|one| self.reach(one, &dims)).into_iter().collect::<Result<Vec<_>, _>>()?;
        // Two values have two reaches, so the other case does not occur.
        let [first, second] = <[Reach; 2]>::try_from(reaches).unwrap_or([Reach::Same, Reach::Same]);
        self.step(Operator::Binary(binary, [first, second]), &[a, b], dims)
    }

    /// Returns how the numbers of a value meet those of a result, whose size is checked first.
    fn reach(&self, value: &Value, dims: &[usize]) -> Result<Reach, NodeError> {
        super::shapes::count(dims)
            .ok_or_else(|| misfit(format!("it gives numbers of shape {dims:?}, too many")))?;
        Ok(reach(&value.dims, dims))
    }

    fn choose(&mut self, node: &Node) -> Result<(), NodeError> {
        let [when, a, b] = [self.value(node, 0)?, self.value(node, 1)?, self.value(node, 2)?];
        let dims = broadcast(&[&when.dims, &a.dims, &b.dims])?;
        let reaches = [self.reach(&when, &dims)?, self.reach(&a, &dims)?, self.reach(&b, &dims)?];
        let value = self.step(Operator::Choose(reaches), &[&when, &a, &b], dims)?;
        self.give(node, 0, value)
    }

    fn clip(&mut self, node: &Node, attributes: &Attributes) -> Result<(), NodeError> {
        let mut value = self.value(node, 0)?;
        // Operator sets before 11 have attributes.
        for (number, key, binary) in [(1, "min", Binary::Max), (2, "max", Binary::Min)] {
            let limit = if Self::has(node, number) {
                self.value(node, number)?
            } else if attributes.has(key) {
                Value { operand: self.place(vec![attributes.number(key, 0.0)])?, dims: Vec::new() }
            } else {
                continue;
            };
            value = self.both(binary, &value, &limit)?;
        }
        self.give(node, 0, value)
    }

    fn reduce(&mut self, node: &Node, attributes: &Attributes, what: Reduction) -> Result<(), NodeError> {
        let input = self.value(node, 0)?;
        let listed = attributes.list("axes").map(<[i64]>::to_vec);
        // Newer operator sets give the axes as an input, older ones as an attribute.
        let axes = match (listed, Self::has(node, 1)) {
            (Some(axes), _) => axes,
            (None, true) => {
                let axes =
                    self.constant(node, 1).ok_or(NodeError::NotConstant("its axes are not constants"))?;
                axes.values.iter().take(MAX_PARTS).map(|&axis| axis as i64).collect()
            }
            (None, false) => Vec::new(),
        };
        // Without axes ONNX reduces all of them, unless the node says that it then does nothing.
        if axes.is_empty() && attributes.integer("noop_with_empty_axes", 0) != 0 {
            return self.give(node, 0, input);
        }
        let mut gone = axes.iter().map(|&number| axis(number, &input.dims)).collect::<Result<Vec<_>, _>>()?;
        if axes.is_empty() {
            // A pool leaves rows and channels.
            let first = if node.op_type == "GlobalAveragePool" { 2 } else { 0 };
            gone = (first..input.dims.len()).collect();
        }
        let (to, kept) = reduced(&input.dims, &gone);
        // How many numbers become one.
        let each = input.dims.iter().product::<usize>() / kept.iter().product::<usize>().max(1);
        let mut value = self.step(Operator::Reduce { what, to, each }, &[&input], kept)?;
        // `reduced` keeps the axes as ones; without `keepdims` they go.
        if attributes.integer("keepdims", 1) == 0 {
            let mut number = 0;
            value.dims.retain(|_| {
                number += 1;
                !gone.contains(&(number - 1))
            });
        }
        self.give(node, 0, value)
    }

    fn along(&mut self, node: &Node, attributes: &Attributes, what: Along) -> Result<(), NodeError> {
        let input = self.value(node, 0)?;
        let is_softmax = matches!(what, Along::Softmax | Along::LogSoftmax);
        // The default axis changed with operator set 13.
        let default = if is_softmax && self.opset < 13 { 1 } else { -1 };
        let axis = axis(attributes.integer("axis", default), &input.dims)?;
        // Before operator set 13 a softmax went over all axes from this one on.
        if is_softmax && self.opset < 13 && input.dims[axis + 1..].iter().any(|&length| length != 1) {
            return Err(unread("it goes over several axes; export with operator set 13 or later"));
        }
        let value = self.over(what, &input, axis..axis + 1)?;
        self.give(node, 0, value)
    }

    /// A function along axes that lie beside each other.
    fn over(&mut self, what: Along, input: &Value, axes: std::ops::Range<usize>) -> Result<Value, NodeError> {
        let length = input.dims[axes.clone()].iter().product();
        let stride = input.dims[axes.end..].iter().product();
        self.step(Operator::Along { what, length, stride }, &[input], input.dims.clone())
    }

    fn layer_norm(&mut self, node: &Node, attributes: &Attributes) -> Result<(), NodeError> {
        let input = self.value(node, 0)?;
        let first = axis(attributes.integer("axis", -1), &input.dims)?;
        let epsilon = attributes.number("epsilon", LayerNorm::EPSILON);
        if !(epsilon > 0.0 && epsilon.is_finite()) {
            return Err(misfit(format!("its epsilon is {epsilon}")));
        }
        let mut value = self.over(Along::Norm(epsilon), &input, first..input.dims.len())?;
        for (number, binary) in [(1, Binary::Mul), (2, Binary::Add)] {
            if Self::has(node, number) {
                let other = self.value(node, number)?;
                value = self.both(binary, &value, &other)?;
            }
        }
        self.give(node, 0, value)
    }

    fn batch_norm(&mut self, node: &Node, attributes: &Attributes) -> Result<(), NodeError> {
        if attributes.integer("training_mode", 0) != 0 {
            return Err(unread("it is in training mode: export the policy after policy.eval()"));
        }
        let mut value = self.value(node, 0)?;
        let channels = value.dims.get(1).copied().ok_or(misfit("its input has one axis"))?;
        let mut parts = Vec::new();
        // In ONNX's order: scale, bias, mean, variance.
        for number in 1..5 {
            let constant = self.constant(node, number).filter(|one| one.values.len() == channels);
            parts.push(
                constant
                    .ok_or(NodeError::NotConstant("its parts are not constants of its channels"))?
                    .values
                    .clone(),
            );
        }
        let epsilon = f64::from(attributes.number("epsilon", 1e-5));
        // In evaluation mode a batch norm is a fixed factor and offset a channel.
        let factor: Vec<f64> = parts[0]
            .iter()
            .zip(&parts[3])
            .map(|(scale, variance)| scale / (variance + epsilon).sqrt())
            .collect();
        let offset =
            parts[1].iter().zip(&parts[2]).zip(&factor).map(|((bias, mean), factor)| bias - mean * factor);
        let offset: Vec<f32> = offset.map(|x| x as f32).collect();
        // Channels are the second axis: ones behind them let broadcasting reach all places.
        let dims = [vec![channels], vec![1; value.dims.len() - 2]].concat();
        let factor = factor.into_iter().map(|x| x as f32).collect();
        for (binary, numbers) in [(Binary::Mul, factor), (Binary::Add, offset)] {
            let other = Value { operand: self.place(numbers)?, dims: dims.clone() };
            value = self.both(binary, &value, &other)?;
        }
        self.give(node, 0, value)
    }
}

fn function(operator: &str, attributes: &Attributes) -> Result<Option<Function>, NodeError> {
    let activation = match operator {
        "Elu" => Activation::elu(attributes.number("alpha", 1.0)),
        "Relu" => Activation::Relu,
        "Tanh" => Activation::Tanh,
        "LeakyRelu" => Activation::LeakyRelu(attributes.number("alpha", 0.01)),
        "Gelu" => match attributes.text("approximate") {
            b"tanh" => Activation::GeluTanh,
            _ => Activation::Gelu,
        },
        "Selu" => match attributes.other_selu() {
            None => Activation::Selu,
            Some(stated) => {
                return Err(unread(format!("its alpha and gamma are {stated:?}; only SELU's own are run")));
            }
        },
        "Swish" if attributes.number("alpha", 1.0) == 1.0 => Activation::Silu,
        _ => {
            let function = match operator {
                "Sigmoid" => Function::Sigmoid,
                "Exp" => Function::Exp,
                "Log" => Function::Log,
                "Sqrt" => Function::Sqrt,
                "Reciprocal" => Function::Reciprocal,
                "Neg" => Function::Neg,
                "Abs" => Function::Abs,
                "Erf" => Function::Erf,
                "Softplus" => Function::Softplus,
                "Softsign" => Function::Softsign,
                "Sin" => Function::Sin,
                "Cos" => Function::Cos,
                "Sign" => Function::Sign,
                "Floor" => Function::Floor,
                "Not" => Function::Not,
                "HardSigmoid" => {
                    Function::HardSigmoid([attributes.number("alpha", 0.2), attributes.number("beta", 0.5)])
                }
                "HardSwish" => Function::HardSwish,
                "Mish" => Function::Mish,
                _ => return Ok(None),
            };
            return Ok(Some(function));
        }
    };
    if !activation.is_sound() {
        return Err(misfit(format!("its parameter is out of range ({activation})")));
    }
    Ok(Some(Function::Activation(activation)))
}

fn binary(operator: &str) -> Option<Binary> {
    Some(match operator {
        "Add" | "Sum" => Binary::Add,
        "Sub" => Binary::Sub,
        "Mul" => Binary::Mul,
        "Div" => Binary::Div,
        "Max" => Binary::Max,
        "Min" => Binary::Min,
        "Pow" => Binary::Pow,
        "PRelu" => Binary::PRelu,
        "Equal" => Binary::Equal,
        "Less" => Binary::Less,
        "LessOrEqual" => Binary::LessOrEqual,
        "Greater" => Binary::Greater,
        "GreaterOrEqual" => Binary::GreaterOrEqual,
        "And" => Binary::And,
        "Or" => Binary::Or,
        _ => return None,
    })
}

fn reduction(operator: &str) -> Option<Reduction> {
    Some(match operator {
        "ReduceSum" => Reduction::Sum,
        "ReduceMean" | "GlobalAveragePool" => Reduction::Mean,
        "ReduceMax" => Reduction::Max,
        "ReduceMin" => Reduction::Min,
        "ReduceL1" => Reduction::L1,
        "ReduceL2" => Reduction::L2,
        "ReduceSumSquare" => Reduction::SumSquare,
        _ => return None,
    })
}
