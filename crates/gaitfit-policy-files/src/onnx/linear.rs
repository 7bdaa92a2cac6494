//! The matrices of `MatMul` and `Gemm`, and reshapes that leave rows alone.

use super::attributes::Attributes;
use super::constant::Constant;
use super::node_error::{NodeError, misfit, unread};
use crate::layers::{Affine, transpose};

/// A weight matrix; `transposed` is `outputs × inputs`.
pub(super) fn linear(weight: &Constant, transposed: bool) -> Result<Affine, NodeError> {
    let [rows, columns] = weight.dims[..] else {
        return Err(misfit(format!("its weight has shape {:?}; a matrix is needed", weight.dims)));
    };
    let single: Vec<f32> = weight.values.iter().map(|&x| x as f32).collect();
    let (inputs, outputs, weight) =
        if transposed { (columns, rows, transpose(&single, rows, columns)) } else { (rows, columns, single) };
    Ok(Affine { inputs, outputs, weight, bias: vec![0.0; outputs] })
}

/// alpha · x W + beta · c.
pub(super) fn gemm(
    weight: &Constant,
    bias: Option<&Constant>,
    attributes: &Attributes,
) -> Result<Affine, NodeError> {
    if attributes.integer("transA", 0) != 0 {
        return Err(unread("it transposes the layers' value (transA), which mixes rows"));
    }
    let mut layer = linear(weight, attributes.integer("transB", 0) != 0)?;
    let (alpha, beta) = (attributes.number("alpha", 1.0), attributes.number("beta", 1.0));
    for weight in &mut layer.weight {
        *weight *= alpha;
    }
    if let Some(bias) = bias {
        let row = bias.as_row().ok_or(unread("its bias does not act alike on every row"))?;
        if row.len() != 1 && row.len() != layer.outputs {
            return Err(misfit(format!(
                "its bias has {} numbers, its weight gives {}",
                row.len(),
                layer.outputs
            )));
        }
        // A bias of one number is that of all outputs.
        layer.bias = (0..layer.outputs).map(|index| beta * row[index.min(row.len() - 1)] as f32).collect();
    }
    Ok(layer)
}

/// Whether a reshape to `shape` leaves rows of `width` as they are. `axes`: how many the value has; `stacked`: whether
/// it has several such rows of each robot, which may become one.
pub(super) fn keeps_rows(shape: &[f64], width: Option<usize>, axes: usize, stacked: bool) -> bool {
    let width = width.map(|width| width as f64);
    match *shape {
        // A 0 in the second place names an axis between the robots' and the numbers'.
        [rows, last] if axes > 2 => {
            (rows == 0.0 && last == -1.0)
                || (!stacked && (rows == -1.0 || rows == 0.0) && Some(last) == width)
        }
        // 0 keeps the length of that axis.
        [rows, last] => {
            (rows == -1.0 && (Some(last) == width || last == 0.0))
                || (rows == 0.0 && (last == -1.0 || last == 0.0 || Some(last) == width))
        }
        _ => false,
    }
}
