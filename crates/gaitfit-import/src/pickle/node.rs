//! The objects of a pickle, as plain data.

use crate::dtype::DType;
use std::rc::Rc;

/// Max number of objects of a pickle. Each takes some tens of bytes.
pub(super) const MAX_NODES: usize = 20_000_000;

/// Number of an object.
pub(crate) type Id = usize;

/// An object.
#[derive(Clone, Debug)]
pub(crate) enum Node {
    None,
    Number(f64),
    Text(Rc<str>),
    Bytes(Rc<[u8]>),
    /// Lists, tuples and sets.
    List(Vec<Id>),
    Dict(Vec<(Id, Id)>),
    /// The name of a class or function, not the thing itself.
    Global(Rc<str>),
    /// A NumPy array; its content comes after it is made.
    Array(Rc<RawArray>),
    /// A NumPy type of numbers.
    DType(DType),
    /// Numbers in another file of the archive: key and type.
    Storage(Rc<str>, DType),
    /// A PyTorch tensor.
    Tensor(Rc<Tensor>),
}

/// A pickle as data.
#[derive(Debug)]
pub(crate) struct Pickle {
    /// All objects.
    pub nodes: Vec<Node>,
    /// The one that was saved.
    pub root: Id,
}

/// A NumPy array as it was pickled.
#[derive(Debug)]
pub(crate) struct RawArray {
    pub dtype: DType,
    pub shape: Vec<usize>,
    pub fortran: bool,
    pub bytes: Rc<[u8]>,
}

/// A PyTorch tensor: a view of numbers in another file.
#[derive(Debug)]
pub(crate) struct Tensor {
    pub key: Rc<str>,
    pub dtype: DType,
    pub offset: usize,
    pub shape: Vec<usize>,
    pub stride: Vec<usize>,
}
