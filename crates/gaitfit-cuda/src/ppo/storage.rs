//! An array of a plan in the GPU's memory.

use super::launch::{Array, Kind};
use crate::runtime::{Argument, Buffer, CudaError, Device, Number, Stream};

/// An array of a plan in the GPU's memory.
pub(crate) enum Storage {
    F32(Buffer<f32>),
    F64(Buffer<f64>),
    U32(Buffer<u32>),
    U8(Buffer<u8>),
}

impl Storage {
    /// Room for an array, all bits 0.
    pub(crate) fn new(device: &Device, array: &Array) -> Result<Self, CudaError> {
        Ok(match array.kind {
            Kind::F32 => Self::F32(Buffer::new(device, array.name, array.length)?),
            Kind::F64 => Self::F64(Buffer::new(device, array.name, array.length)?),
            Kind::U32 => Self::U32(Buffer::new(device, array.name, array.length)?),
            Kind::U8 => Self::U8(Buffer::new(device, array.name, array.length)?),
        })
    }

    /// A pointer to its beginning.
    pub(crate) fn argument(&self) -> Argument {
        match self {
            Self::F32(buffer) => buffer.into(),
            Self::F64(buffer) => buffer.into(),
            Self::U32(buffer) => buffer.into(),
            Self::U8(buffer) => buffer.into(),
        }
    }

    /// Type of its numbers.
    pub(crate) fn kind(&self) -> Kind {
        match self {
            Self::F32(_) => Kind::F32,
            Self::F64(_) => Kind::F64,
            Self::U32(_) => Kind::U32,
            Self::U8(_) => Kind::U8,
        }
    }

    /// Where its beginning is in the GPU's memory.
    pub(crate) fn address(&self) -> u64 {
        match self {
            Self::F32(buffer) => buffer.address(),
            Self::F64(buffer) => buffer.address(),
            Self::U32(buffer) => buffer.address(),
            Self::U8(buffer) => buffer.address(),
        }
    }

    /// Copies another array of such numbers, of this GPU or another, to the places from its length times `number` on; what has
    /// other numbers stays as it is.
    ///
    /// # Errors
    /// A failure of the GPU; an array that does not fit.
    pub(crate) fn take_part(&self, stream: &Stream, number: usize, other: &Self) -> Result<(), CudaError> {
        match (self, other) {
            (Self::F32(to), Self::F32(from)) => to.take_part(stream, number * from.len(), from),
            (Self::F64(to), Self::F64(from)) => to.take_part(stream, number * from.len(), from),
            (Self::U32(to), Self::U32(from)) => to.take_part(stream, number * from.len(), from),
            (Self::U8(to), Self::U8(from)) => to.take_part(stream, number * from.len(), from),
            _ => Ok(()),
        }
    }

    /// Fills it; what has other numbers stays as it is.
    ///
    /// # Errors
    /// A failure of the GPU; another length.
    pub(crate) fn write<T: Stored>(&self, stream: &Stream, numbers: &[T]) -> Result<(), CudaError> {
        T::held(self).map_or(Ok(()), |buffer| buffer.write(stream, numbers))
    }

    /// Its numbers; none of other ones.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub(crate) fn read<T: Stored>(&self, stream: &Stream) -> Result<Vec<T>, CudaError> {
        T::held(self).map_or_else(|| Ok(Vec::new()), |buffer| buffer.read(stream))
    }
}

/// A kind of number that an array can have.
pub(crate) trait Stored: Number {
    /// The array, if it has such numbers.
    fn held(storage: &Storage) -> Option<&Buffer<Self>>;
}

macro_rules! stored {
    ($($number:ty, $variant:ident;)*) => {$(
        impl Stored for $number {
            fn held(storage: &Storage) -> Option<&Buffer<Self>> {
                if let Storage::$variant(buffer) = storage { Some(buffer) } else { None }
            }
        }
    )*};
}
stored! {
    f32, F32;
    f64, F64;
    u32, U32;
    u8, U8;
}
