//! Launches, their arguments and the arrays of a plan.

use crate::runtime::{Argument, CudaError, Kernel, Shape, Stream};

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

/// Type of an array's numbers.
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

impl Launch {
    /// Starts it with the kernel of its name; `array` gives the argument for the array of a number.
    pub(crate) fn start(
        &self,
        stream: &Stream,
        kernels: &[(&'static str, Kernel)],
        array: impl Fn(usize) -> Option<Argument>,
    ) -> Result<(), CudaError> {
        let missing = |reason: &str| CudaError::Launch { kernel: self.kernel.into(), reason: reason.into() };
        let argument = |value: &Value| match *value {
            Value::Array(Id(number)) => array(number).ok_or_else(|| missing("an array of it is missing")),
            Value::U32(word) => Ok(word.into()),
            Value::F32(number) => Ok(number.into()),
        };
        let arguments = self.arguments.iter().map(argument).collect::<Result<Vec<_>, _>>()?;
        let kernel = kernels.iter().find(|(name, _)| *name == self.kernel);
        let (_, kernel) = kernel.ok_or_else(|| missing("the plan does not have it"))?;
        kernel.launch(stream, self.shape, &arguments)
    }
}
