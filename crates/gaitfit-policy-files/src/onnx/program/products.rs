//! Products of matrices.

use super::shapes::broadcast;
use super::{Program, Value};
use crate::onnx::attributes::Attributes;
use crate::onnx::node_error::{NodeError, misfit};
use crate::onnx::proto::Node;
use gaitfit_policy::graph::{Binary, Operand, Operator};

impl Program {
    /// A matrix product whose second factor is a constant, alone or behind others.
    pub(super) fn by_constant(&mut self, x: &Value, w: &Value, outer: usize) -> Result<Value, NodeError> {
        let Some((&inner, ahead)) = x.dims.split_last() else {
            return Err(misfit("its input is a single number"));
        };
        let dims = [ahead, &[outer]].concat();
        let height: usize = ahead.iter().product();
        self.count_products(&[height, inner, outer])?;
        self.step(Operator::Product { inner, outer }, &[x, w], dims)
    }

    pub(super) fn matmul(&mut self, node: &Node) -> Result<(), NodeError> {
        let (a, b) = (self.value(node, 0)?, self.value(node, 1)?);
        let shapes = || misfit(format!("its inputs have the shapes {:?} and {:?}", a.dims, b.dims));
        // A matrix of weights is multiplied with the rows of all robots at once.
        if let (Operand::Constant(_), &[inner, outer]) = (b.operand, &b.dims[..]) {
            if a.dims.last() != Some(&inner) {
                return Err(shapes());
            }
            let value = self.by_constant(&a, &b, outer)?;
            return self.give(node, 0, value);
        }
        // A vector is a matrix of one row, or behind the sign of one column.
        let mut high = a.dims.clone();
        let mut wide = b.dims.clone();
        if high.len() == 1 {
            high.insert(0, 1);
        }
        if wide.len() == 1 {
            wide.push(1);
        }
        let ([lead_a @ .., rows, inner], [lead_b @ .., depth, outer]) = (&high[..], &wide[..]) else {
            return Err(shapes());
        };
        let [many_a, many_b] = [lead_a, lead_b].map(|lead| lead.iter().product::<usize>());
        if inner != depth || (many_a != 1 && many_b != 1 && lead_a != lead_b) {
            return Err(shapes());
        }
        let mut dims = broadcast(&[lead_a, lead_b])?;
        // An axis that was put in above is not one of the result.
        if a.dims.len() > 1 {
            dims.push(*rows);
        }
        if b.dims.len() > 1 {
            dims.push(*outer);
        }
        // A single matrix on one side is multiplied with every matrix of the other side.
        let many = many_a.max(many_b);
        self.count_products(&[many, *rows, *inner, *outer])?;
        let operator = Operator::Products {
            many,
            rows: *rows,
            inner: *inner,
            outer: *outer,
            repeated: [many_a > 1, many_b > 1],
        };
        let value = self.step(operator, &[&a, &b], dims)?;
        self.give(node, 0, value)
    }

    pub(super) fn gemm(&mut self, node: &Node, attributes: &Attributes) -> Result<(), NodeError> {
        let x = self.value(node, 0)?;
        let weight = self.constant(node, 1).ok_or(NodeError::NotConstant("its weight is not a constant"))?;
        if attributes.integer("transA", 0) != 0 || x.dims.len() != 2 {
            return Err(misfit(format!("its input has the shape {:?}, or is turned", x.dims)));
        }
        let [rows, columns] = weight.dims[..] else {
            return Err(misfit(format!("its weight has the shape {:?}", weight.dims)));
        };
        let is_turned = attributes.integer("transB", 0) != 0;
        let (inner, outer) = if is_turned { (columns, rows) } else { (rows, columns) };
        if x.dims[1] != inner {
            return Err(misfit(format!("it takes {inner} numbers of {:?}", x.dims)));
        }
        let alpha = f64::from(attributes.number("alpha", 1.0));
        // alpha is multiplied into the weights now, so that it costs no step.
        let mut numbers: Vec<f32> = weight.values.iter().map(|&x| (alpha * x) as f32).collect();
        if is_turned {
            numbers = crate::layers::transpose(&numbers, outer, inner);
        }
        let w = Value { operand: self.place(numbers)?, dims: vec![inner, outer] };
        let mut value = self.by_constant(&x, &w, outer)?;
        if Self::has(node, 2) {
            let mut bias = self.value(node, 2)?;
            let beta = attributes.number("beta", 1.0);
            if beta != 1.0 {
                let factor = Value { operand: self.place(vec![beta])?, dims: Vec::new() };
                bias = self.both(Binary::Mul, &bias, &factor)?;
            }
            value = self.both(Binary::Add, &value, &bias)?;
        }
        self.give(node, 0, value)
    }
}
