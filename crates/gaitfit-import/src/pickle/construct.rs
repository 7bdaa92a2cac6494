//! The constructors that pickled logs use, as functions of data. What is not in this file is refused.

use super::PickleError;
use super::node::{Id, Node, RawArray, Tensor};
use crate::arrays::count;
use crate::budget::Budget;
use crate::dtype::DType;
use crate::problem::Problem;
use std::rc::Rc;

/// Max number of axes of an array.
const MAX_AXES: usize = 16;

/// Computes `function(*arguments)` for the functions that logs need.
pub(crate) fn call(
    nodes: &[Node],
    function: Id,
    arguments: Id,
    budget: &mut Budget,
) -> Result<Node, Problem> {
    let (Node::Global(name), Node::List(arguments)) = (&nodes[function], &nodes[arguments]) else {
        return Err(PickleError::NotAFunction.into());
    };
    let argument = |i: usize| arguments.get(i).map(|id| &nodes[*id]);
    let wrong = || Problem::from(PickleError::Arguments(name.to_string()));
    // Nothing is ever called: these few functions are imitated, and every other name is refused.
    match short(name) {
        "OrderedDict" => match arguments.as_slice() {
            [] => Ok(Node::Dict(Vec::new())),
            [items] => {
                let Node::List(items) = &nodes[*items] else { return Err(wrong()) };
                budget.take_values(2 * items.len())?;
                let pair = |id: &Id| match &nodes[*id] {
                    Node::List(pair) if pair.len() == 2 => Some((pair[0], pair[1])),
                    _ => None,
                };
                items.iter().map(pair).collect::<Option<_>>().map(Node::Dict).ok_or_else(wrong)
            }
            _ => Err(wrong()),
        },
        // Tuples and sets are lists here: only their items count.
        "list" | "tuple" | "set" | "frozenset" => match argument(0) {
            None => Ok(Node::List(Vec::new())),
            Some(Node::List(items)) => {
                budget.take_values(items.len())?;
                Ok(Node::List(items.clone()))
            }
            Some(_) => Err(wrong()),
        },
        // Protocols below 3 write bytes as text of Latin-1.
        "encode" => match (argument(0), argument(1)) {
            (Some(Node::Text(text)), Some(Node::Text(code))) if matches!(&**code, "latin1" | "latin-1") => {
                budget.take_bytes(text.len())?;
                let bytes: Option<Vec<u8>> = text.chars().map(|c| u8::try_from(u32::from(c)).ok()).collect();
                bytes.map(|bytes| Node::Bytes(bytes.into())).ok_or_else(wrong)
            }
            _ => Err(wrong()),
        },
        "bytes" | "bytearray" => match argument(0) {
            None => Ok(Node::Bytes(Rc::default())),
            Some(Node::Bytes(bytes)) => Ok(Node::Bytes(bytes.clone())),
            Some(_) => Err(wrong()),
        },
        // The order of bytes follows as the type's state.
        "dtype" => match argument(0) {
            Some(Node::Text(text)) => match DType::parse(text) {
                Some(dtype) => Ok(Node::DType(dtype)),
                None => Err(PickleError::Type(text.to_string()).into()),
            },
            _ => Err(wrong()),
        },
        // An empty array; its content follows as its state.
        "_reconstruct" => Ok(Node::None),
        "scalar" => match (argument(0), argument(1)) {
            (Some(Node::DType(dtype)), Some(Node::Bytes(bytes))) if dtype.is_text() => {
                budget.take_bytes(bytes.len())?;
                dtype.text(bytes).map(|text| Node::Text(text.into())).ok_or_else(wrong)
            }
            (Some(Node::DType(dtype)), Some(Node::Bytes(bytes))) => {
                dtype.number(bytes).map(Node::Number).ok_or_else(wrong)
            }
            _ => Err(wrong()),
        },
        // So NumPy writes contiguous arrays with protocol 5.
        "_frombuffer" => match (argument(0), argument(1), argument(2), argument(3)) {
            (
                Some(Node::Bytes(bytes)),
                Some(Node::DType(dtype)),
                Some(Node::List(shape)),
                Some(Node::Text(order)),
            ) => Ok(array(nodes, bytes, *dtype, shape, &**order == "F")?),
            _ => Err(wrong()),
        },
        // Storage, offset, sizes and strides. Arguments after these concern gradients.
        "_rebuild_tensor_v2" => match (argument(0), argument(1), argument(2), argument(3)) {
            (
                Some(Node::Storage(key, dtype)),
                Some(Node::Number(offset)),
                Some(Node::List(shape)),
                Some(Node::List(stride)),
            ) => {
                let (shape, stride) = (sizes(nodes, shape)?, sizes(nodes, stride)?);
                if shape.len() != stride.len() {
                    return Err(wrong());
                }
                let (key, dtype, offset) = (key.clone(), *dtype, size(*offset)?);
                Ok(Node::Tensor(Rc::new(Tensor { key, dtype, offset, shape, stride })))
            }
            _ => Err(wrong()),
        },
        _ => Err(PickleError::NotData(name.to_string()).into()),
    }
}

/// The last part of the names of allowed functions; other names as they are.
fn short(name: &str) -> &str {
    match name {
        "collections.OrderedDict" => "OrderedDict",
        "builtins.list" | "__builtin__.list" => "list",
        "builtins.tuple" | "__builtin__.tuple" => "tuple",
        "builtins.set" | "__builtin__.set" => "set",
        "builtins.frozenset" | "__builtin__.frozenset" => "frozenset",
        "builtins.bytes" | "__builtin__.bytes" => "bytes",
        "builtins.bytearray" | "__builtin__.bytearray" => "bytearray",
        "_codecs.encode" => "encode",
        "numpy.dtype" => "dtype",
        "numpy.core.multiarray._reconstruct" | "numpy._core.multiarray._reconstruct" => "_reconstruct",
        "numpy.core.multiarray.scalar" | "numpy._core.multiarray.scalar" => "scalar",
        "numpy.core.numeric._frombuffer" | "numpy._core.numeric._frombuffer" => "_frombuffer",
        "torch._utils._rebuild_tensor_v2" => "_rebuild_tensor_v2",
        other if other.contains('.') => other,
        // A name without a module is none of the above.
        _ => "",
    }
}

/// Returns what an object becomes with its state; `None`: it stays as it is.
pub(crate) fn build(nodes: &[Node], object: Id, state: Id) -> Result<Option<Node>, PickleError> {
    match (&nodes[object], &nodes[state]) {
        // NumPy's array: version, shape, dtype, Fortran order, content.
        (Node::None, Node::List(parts)) if parts.len() == 5 => {
            let part = |i: usize| &nodes[parts[i]];
            match (part(1), part(2), part(3), part(4)) {
                (Node::List(shape), Node::DType(dtype), Node::Number(fortran), Node::Bytes(bytes)) => {
                    array(nodes, bytes, *dtype, shape, *fortran != 0.0).map(Some)
                }
                _ => Err(PickleError::ArrayOfObjects),
            }
        }
        // NumPy's dtype: version, byte order, and what structures have.
        (Node::DType(dtype), Node::List(parts)) => match parts.get(1).map(|id| &nodes[*id]) {
            Some(Node::Text(order)) => Ok(Some(Node::DType(dtype.ordered(order)))),
            _ => Ok(None),
        },
        // Attributes of dictionaries (PyTorch's state_dict has some) are no data.
        (Node::Dict(_), _) => Ok(None),
        _ => Err(PickleError::State),
    }
}

fn array(
    nodes: &[Node],
    bytes: &Rc<[u8]>,
    dtype: DType,
    shape: &[Id],
    fortran: bool,
) -> Result<Node, PickleError> {
    let shape = sizes(nodes, shape)?;
    let fits =
        count(&shape).and_then(|count| count.checked_mul(dtype.bytes())).is_some_and(|n| n == bytes.len());
    if !fits {
        return Err(PickleError::ArraySize);
    }
    Ok(Node::Array(Rc::new(RawArray { dtype, shape, fortran, bytes: bytes.clone() })))
}

fn sizes(nodes: &[Node], ids: &[Id]) -> Result<Vec<usize>, PickleError> {
    if ids.len() > MAX_AXES {
        return Err(PickleError::Axes);
    }
    let one = |id: &Id| match &nodes[*id] {
        Node::Number(number) => size(*number),
        _ => Err(PickleError::Shape),
    };
    ids.iter().map(one).collect()
}

fn size(number: f64) -> Result<usize, PickleError> {
    // Whole numbers below 2⁵³ (9e15) are exact in a double.
    if number >= 0.0 && number.fract() == 0.0 && number < 1e15 {
        Ok(number as usize)
    } else {
        Err(PickleError::Size)
    }
}

/// Returns the storage that PyTorch's persistent id ("storage", type, key, device, count) names.
pub(crate) fn storage(nodes: &[Node], id: Id) -> Result<Node, PickleError> {
    let wrong = || PickleError::Reference;
    let Node::List(parts) = &nodes[id] else { return Err(wrong()) };
    let part = |i: usize| parts.get(i).map(|id| &nodes[*id]);
    let (Some(Node::Text(what)), Some(Node::Global(class)), Some(Node::Text(key))) =
        (part(0), part(1), part(2))
    else {
        return Err(wrong());
    };
    if &**what != "storage" {
        return Err(wrong());
    }
    let name = match &**class {
        "torch.DoubleStorage" => "<f8",
        "torch.FloatStorage" => "<f4",
        "torch.HalfStorage" => "<f2",
        "torch.LongStorage" => "<i8",
        "torch.IntStorage" => "<i4",
        "torch.ShortStorage" => "<i2",
        "torch.CharStorage" => "|i1",
        "torch.ByteStorage" => "|u1",
        "torch.BoolStorage" => "|b1",
        other => {
            return Err(PickleError::Storage(other.to_owned()));
        }
    };
    DType::parse(name).map(|dtype| Node::Storage(key.clone(), dtype)).ok_or_else(wrong)
}
