//! What a plan is made of.

use crate::runtime::Shape;

/// Which of the equal parts of a training's robots a GPU has.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Share {
    /// Its number, from 0: sums over all GPUs are in this order.
    pub number: usize,
    /// How many there are.
    pub count: usize,
}

impl Share {
    /// All robots on one GPU.
    pub const WHOLE: Self = Self { number: 0, count: 1 };
}

/// Sizes of a rollout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Batch {
    /// Control steps.
    pub steps: usize,
    /// Environments, of this GPU.
    pub environments: usize,
    /// Environments of a tile of the CPU's learner, which numbers samples tile by tile: the deal of the samples is then
    /// the same. The last tile may be smaller.
    pub tile: usize,
    /// Which environments these are of a training's.
    pub share: Share,
}

impl Batch {
    /// Samples in all, of this GPU.
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

/// Where the GPUs of a training tell each other numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Exchange {
    /// Launches of the update before it.
    pub before: usize,
    /// Arrays of this GPU, each with the array that takes those of all GPUs, in order.
    pub arrays: Vec<[Id; 2]>,
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
