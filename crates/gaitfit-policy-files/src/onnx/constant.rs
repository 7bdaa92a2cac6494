//! Constants of a graph, and the arithmetic between them that exporters leave in it.

use super::attributes::Attributes;
use super::moves::moved;
use super::proto::{BOOL, DOUBLE, FLOAT, INT32, INT64, Tensor};
use gaitfit_model::shown;
use gaitfit_policy::PolicyError;
use gaitfit_policy::invalid;

/// Max number of numbers of one constant.
pub(super) const MAX_NUMBERS: usize = 16 << 20;

/// Max number of numbers of a constant that is filled with one number, or counts.
const MAX_FILLED: usize = 1 << 16;

/// ONNX's data types of whole numbers: UINT8, INT8, UINT16, INT16, INT32, INT64, UINT32, UINT64.
const WHOLE: [i64; 8] = [2, 3, 4, 5, 6, 7, 12, 13];

/// A constant: its shape, and its numbers row-major, whatever their type in the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Constant {
    pub dims: Vec<usize>,
    pub values: Vec<f64>,
    /// Whether the file's type has whole numbers alone, which are divided as such.
    pub whole: bool,
}

impl Constant {
    /// A single number.
    pub fn scalar(value: f64) -> Self {
        Self { dims: Vec::new(), values: vec![value], whole: false }
    }

    /// A list of whole numbers.
    pub fn wholes(values: Vec<f64>) -> Self {
        Self { dims: vec![values.len()], values, whole: true }
    }

    /// Reads the file's form: F32, F64 (later rounded to F32), I64, I32 or truth values, in any of its
    /// containers but another file.
    pub fn read(tensor: Tensor) -> Result<Self, PolicyError> {
        let name = shown(&tensor.name);
        let length = |&length: &i64| usize::try_from(length).ok();
        let dims: Option<Vec<usize>> = tensor.dims.iter().map(length).collect();
        // The shape comes from a file, so its product may overflow.
        let count = dims
            .as_ref()
            .and_then(|dims| dims.iter().try_fold(1_usize, |count, &length| count.checked_mul(length)))
            .filter(|&count| count <= MAX_NUMBERS);
        let (Some(dims), Some(count)) = (dims, count) else {
            return Err(invalid(format!("tensor {name} has an impossible shape")));
        };
        let raw = &tensor.raw_data;
        // ONNX keeps numbers in a list of their type or as little-endian bytes; an empty one says that it is
        // the other.
        let (values, rest): (Vec<f64>, usize) = match tensor.data_type {
            FLOAT if raw.is_empty() => (tensor.float_data.iter().map(|&x| f64::from(x)).collect(), 0),
            FLOAT => {
                let (numbers, rest) = raw.as_chunks();
                // `rest` has bytes behind the last whole number, which only a damaged tensor has.
                (numbers.iter().map(|&bytes| f64::from(f32::from_le_bytes(bytes))).collect(), rest.len())
            }
            DOUBLE if raw.is_empty() => (tensor.double_data, 0),
            DOUBLE => {
                let (numbers, rest) = raw.as_chunks();
                (numbers.iter().map(|&bytes| f64::from_le_bytes(bytes)).collect(), rest.len())
            }
            INT64 if raw.is_empty() => (tensor.int64_data.iter().map(|&x| x as f64).collect(), 0),
            INT64 => {
                let (numbers, rest) = raw.as_chunks();
                (numbers.iter().map(|&bytes| i64::from_le_bytes(bytes) as f64).collect(), rest.len())
            }
            BOOL if !raw.is_empty() => (raw.iter().map(|&byte| f64::from(byte)).collect(), 0),
            INT32 if !raw.is_empty() => {
                let (numbers, rest) = raw.as_chunks();
                (numbers.iter().map(|&bytes| f64::from(i32::from_le_bytes(bytes))).collect(), rest.len())
            }
            BOOL | INT32 => (tensor.int32_data.iter().map(|&x| f64::from(x)).collect(), 0),
            other => {
                return Err(invalid(format!(
                    "tensor {name} has ONNX data type {other}; only FLOAT (1), DOUBLE (11, rounded to FLOAT), \
                     INT64 (7), INT32 (6) and BOOL (9) are read. Export the model in single precision"
                )));
            }
        };
        if rest != 0 || values.len() != count {
            return Err(invalid(format!(
                "tensor {name} has shape {dims:?}, so {count} numbers, but the file holds {}{}",
                values.len(),
                if rest != 0 { " and a torn one" } else { "" }
            )));
        }
        Ok(Self { dims, values, whole: matches!(tensor.data_type, INT32 | INT64) })
    }

    /// The one number, of any shape.
    pub fn as_scalar(&self) -> Option<f64> {
        match self.values[..] {
            [value] => Some(value),
            _ => None,
        }
    }

    /// The numbers, if only the last axis is longer than one, so that they act alike on every row.
    pub fn as_row(&self) -> Option<&[f64]> {
        // A scalar has no axes and acts like a row of one number.
        let last = self.dims.last().copied().unwrap_or(1);
        (last == self.values.len()).then_some(&self.values[..])
    }

    /// The result of arithmetic on constants; `None` where `operator` is not one of the few that exporters leave.
    pub(super) fn fold(operator: &str, inputs: &[&Constant], attributes: &Attributes) -> Option<Constant> {
        match (operator, inputs) {
            ("Identity", [one]) => Some((*one).clone()),
            ("Cast", [one]) => Some(one.cast(attributes.integer("to", 0))),
            ("Sqrt", [one]) => Some(one.map(f64::sqrt)),
            ("Reciprocal", [one]) => Some(one.map(f64::recip)),
            ("Neg", [one]) => Some(one.map(|x| -x)),
            ("Add", [a, b]) => a.zip(b, |a, b| a + b),
            ("Sub", [a, b]) => a.zip(b, |a, b| a - b),
            ("Mul", [a, b]) => a.zip(b, |a, b| a * b),
            // ONNX rounds quotients of whole numbers towards zero.
            ("Div", [a, b]) if a.whole && b.whole => a.zip(b, |a, b| (a / b).trunc()),
            ("Div", [a, b]) => a.zip(b, |a, b| a / b),
            _ => None,
        }
    }

    fn map(&self, function: impl Fn(f64) -> f64) -> Constant {
        let values = self.values.iter().map(|&x| function(x)).collect();
        Constant { dims: self.dims.clone(), values, whole: self.whole }
    }

    /// The numbers as those of ONNX data type `to`. Wider and narrower types of one kind count as the same.
    fn cast(&self, to: i64) -> Constant {
        let whole = WHOLE.contains(&to);
        let cast = |x: f64| match whole {
            true => x.trunc(),
            false if to == i64::from(BOOL) => f64::from(u8::from(x != 0.0)),
            false => x,
        };
        Constant { whole, ..self.map(cast) }
    }

    /// Element by element; one side may be a single number. The result has as many axes as the side with more of them.
    fn zip(&self, other: &Constant, function: impl Fn(f64, f64) -> f64) -> Option<Constant> {
        let whole = self.whole && other.whole;
        let axes = self.dims.len().max(other.dims.len());
        // Axes that are missing stand in front, with a length of 1.
        let with_axes = |one: Constant| {
            let mut dims = vec![1; axes - one.dims.len()];
            dims.extend(&one.dims);
            Constant { dims, whole, ..one }
        };
        if let Some(b) = other.as_scalar() {
            return Some(with_axes(self.map(|a| function(a, b))));
        }
        if let Some(a) = self.as_scalar() {
            return Some(with_axes(other.map(|b| function(a, b))));
        }
        let values = self.values.iter().zip(&other.values).map(|(&a, &b)| function(a, b)).collect();
        (self.dims == other.dims).then(|| Constant { dims: self.dims.clone(), values, whole })
    }
}

/// The result of an operator on constants, arithmetic or moves; `None` for others.
pub(super) fn folded(operator: &str, inputs: &[&Constant], attributes: &Attributes) -> Option<Constant> {
    match (operator, inputs) {
        ("ConstantOfShape", [shape]) => {
            // A negative length saturates to 0.
            let dims: Vec<usize> = shape.values.iter().map(|&length| length as usize).collect();
            let count = dims.iter().try_fold(1_usize, |count, &length| count.checked_mul(length))?;
            let stated = attributes.tensor("value");
            let whole = stated.as_ref().is_some_and(|value| value.whole);
            // ONNX fills with 0 where no value is stated.
            let value = stated.and_then(|value| value.as_scalar()).unwrap_or(0.0);
            // A few bytes of the file can ask for any length, so the limit is lower than that of stored constants.
            (count <= MAX_FILLED).then(|| Constant { dims, values: vec![value; count], whole })
        }
        ("Range", [start, end, step]) => {
            let whole = inputs.iter().all(|one| one.whole);
            let (start, end, step) = (start.as_scalar()?, end.as_scalar()?, step.as_scalar()?);
            // A step of 0 gives ∞ or no number, neither of which is in the range below.
            let count = ((end - start) / step).ceil();
            let values = (0.0..=MAX_FILLED as f64).contains(&count).then_some(0..count as usize)?;
            let values: Vec<f64> = values.map(|number| start + number as f64 * step).collect();
            Some(Constant { dims: vec![values.len()], values, whole })
        }
        _ => Constant::fold(operator, inputs, attributes)
            .or_else(|| moved(operator, inputs, attributes, MAX_NUMBERS)),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::super::proto::Node;
    use super::*;

    #[test]
    fn a_single_number_keeps_the_axes_of_both_sides() {
        let none = Attributes::decode(&Node::default()).unwrap();
        let constant = |dims: &[usize], values: &[f64]| Constant {
            dims: dims.to_vec(),
            ..Constant::wholes(values.to_vec())
        };
        let sum = |a: &Constant, b: &Constant| Constant::fold("Add", &[a, b], &none).unwrap();
        let one = sum(&constant(&[], &[2.0]), &constant(&[1], &[3.0]));
        assert_eq!((one.dims, one.values), (vec![1], vec![5.0]));
        let row = sum(&constant(&[3], &[1.0, 2.0, 3.0]), &constant(&[1, 1], &[1.0]));
        assert_eq!((row.dims, row.values), (vec![1, 3], vec![2.0, 3.0, 4.0]));
    }
}
