//! CUDA at run time: GPUs, memory, programs, order of work.
//!
//! The driver and the compiler are libraries that are looked for when first needed. Everything that can be missing is
//! an error with a remedy, never a panic. All of this crate's `unsafe` is here.
//!
//! ```no_run
//! use gaitfit_cuda::runtime::{Buffer, Device, Program, Shape, Stream};
//!
//! # fn main() -> Result<(), gaitfit_cuda::runtime::CudaError> {
//! let device = Device::open(0)?;
//! let text = "extern \"C\" __global__ void twice(float* x, unsigned n) {
//!     unsigned i = blockIdx.x * blockDim.x + threadIdx.x;
//!     if (i < n) x[i] *= 2.0f;
//! }";
//! let module = device.load(&Program::new("example", text).option("--use_fast_math"))?;
//! let twice = module.kernel("twice")?;
//! let stream = Stream::new(&device)?;
//! let mut x = Buffer::from_slice(&device, "x", &[1.0f32, 2.0])?;
//! twice.launch(&stream, Shape::cover(x.len(), 256), &[(&mut x).into(), 2u32.into()])?;
//! assert_eq!(x.read(&stream)?, [2.0, 4.0]);
//! // Recorded once, started with one call.
//! let mut graph = stream.record(|stream| twice.launch(stream, Shape::new(1, 32), &[(&mut x).into(), 2u32.into()]))?;
//! graph.launch(&stream)?;
//! # Ok(())
//! # }
//! ```
//!
//! - [`find`] says what is there and what is missing; [`Device::open`] opens a GPU.
//! - [`Program`] is CUDA C++ text. [`Device::load`] compiles it with [`Nvrtc`] or takes it from the [`Cache`];
//!   [`compile()`] does it without a GPU. [`Device::compile_ahead`] begins on threads of their own.
//! - [`Module::kernel`] finds a kernel, [`Kernel::launch`] starts it. Arguments are buffers and numbers, `into()`.
//! - [`Buffer`] checks free memory before it allocates; [`Device::check_room`] does it for a whole plan.
//!   [`HostBuffer`] is memory of the host that a GPU copies to fast.
//! - [`Stream`] orders work, [`Stream::record`] makes a [`Graph`] of it, [`Event`] takes times. A failure of a kernel
//!   shows when the stream is waited for, and names the kernels since the last wait.
#![allow(unsafe_code, reason = "calls of the driver and the compiler, each with its reason")]

mod ahead;
mod cache;
mod compile;
mod device;
mod driver;
mod error;
mod found;
mod host;
mod memory;
mod module;
mod nvrtc;
pub mod search;
mod stream;
mod table;

pub use ahead::Ahead;
pub use cache::Cache;
pub use compile::{Compiled, Program, compile};
pub use device::{Device, DeviceInfo, Visit};
pub use error::{CudaError, bytes};
pub use found::{Found, find};
pub use host::HostBuffer;
pub use memory::{Buffer, Number};
pub use module::{Argument, Kernel, Module, Shape};
pub use nvrtc::{Image, Nvrtc};
pub use stream::{Event, Graph, Stream};
