//! An array of a plan in the GPU's memory.

use super::launch::{Array, Kind};
use crate::runtime::{Argument, Buffer, CudaError, Device};

/// An array of a plan in the GPU's memory.
pub(crate) enum Storage {
    F32(Buffer<f32>),
    F64(Buffer<f64>),
    U32(Buffer<u32>),
}

impl Storage {
    /// Room for an array, all bits 0.
    pub(crate) fn new(device: &Device, array: &Array) -> Result<Self, CudaError> {
        Ok(match array.kind {
            Kind::F32 => Self::F32(Buffer::new(device, array.name, array.length)?),
            Kind::F64 => Self::F64(Buffer::new(device, array.name, array.length)?),
            Kind::U32 => Self::U32(Buffer::new(device, array.name, array.length)?),
        })
    }

    /// A pointer to its beginning.
    pub(crate) fn argument(&self) -> Argument {
        match self {
            Self::F32(buffer) => buffer.into(),
            Self::F64(buffer) => buffer.into(),
            Self::U32(buffer) => buffer.into(),
        }
    }
}
