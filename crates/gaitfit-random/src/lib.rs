//! Random numbers without state: every draw is a pure function of (seed, purpose, environment, step, draw).
//!
//! The generator is Philox 4×32-10 (Salmon, Moraes, Dror, Shaw: "Parallel random numbers: as easy as 1, 2, 3",
//! SC 2011), a keyed bijection of a 128-bit counter. A run therefore resumes, runs in parallel or moves to a GPU
//! without carrying generator state: whoever knows the five numbers knows the draw.
//!
//! Layout: key = (low, high word of the seed); counter = (block, step, environment, purpose). One block is four
//! 32-bit words. Word draws take one word each, `f64` draws two, so draw `d` lies in block `d / 4` or `d / 2`.
//! Draws of different kinds from one [`Stream`] overlap: give each kind of use its own [`Purpose`].
//!
//! Floating-point draws use IEEE `+ − × ÷ √` only, each rounded once and in a fixed order. A GPU kernel compiled
//! without contraction to fused multiply-add (`--fmad=false`) returns the same bits.
//!
//! ```
//! use gaitfit_random::{Purpose, Stream};
//! let noise = Stream::new(7, Purpose::TORQUE_NOISE).environment(12).step(345);
//! assert_eq!(noise.normal(0).to_bits(), noise.normal(0).to_bits());
//! assert_ne!(noise.normal(0), noise.step(346).normal(0));
//! ```

mod elementary;
mod lanes;
mod philox;
mod stream;

pub use lanes::{fill_block_rows, fill_normal_rows};
pub use philox::philox4x32_10;
pub use stream::{Purpose, Stream, derive_seed};
