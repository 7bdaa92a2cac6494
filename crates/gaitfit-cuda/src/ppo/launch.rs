//! What a plan is made of.

use crate::runtime::Shape;

/// Sizes of a rollout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Batch {
    /// Control steps.
    pub steps: usize,
    /// Environments.
    pub environments: usize,
    /// Environments of a tile of the CPU's learner, which numbers samples tile by tile: the deal of the samples is then
    /// the same. The last tile may be smaller.
    pub tile: usize,
}

impl Batch {
    /// Samples in all.
    pub fn rows(&self) -> usize {
        self.steps * self.environments
    }
}

/// What an array holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// 32-bit floats.
    F32,
    /// 64-bit floats.
    F64,
    /// 32-bit words.
    U32,
    /// Bytes: 0 or 1.
    U8,
}

impl Kind {
    /// Bytes of a number.
    pub fn bytes(self) -> usize {
        match self {
            Self::F64 => 8,
            Self::F32 | Self::U32 => 4,
            Self::U8 => 1,
        }
    }
}

/// Number of an array in [`super::Plan::arrays`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Id(pub usize);

/// One array.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Array {
    /// Its name.
    pub name: &'static str,
    /// Its numbers' type.
    pub kind: Kind,
    /// Numbers in it.
    pub length: usize,
}

impl Array {
    /// Bytes that it takes.
    pub fn bytes(&self) -> u64 {
        self.length as u64 * self.kind.bytes() as u64
    }
}

/// An argument of a kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// Pointer to an array's beginning.
    Array(Id),
    /// A word.
    U32(u32),
    /// A float.
    F32(f32),
}

/// One kernel's start.
#[derive(Clone, Debug, PartialEq)]
pub struct Launch {
    /// Name in the text.
    pub kernel: &'static str,
    /// Threads.
    pub shape: Shape,
    /// Arguments in order.
    pub arguments: Vec<Value>,
}
