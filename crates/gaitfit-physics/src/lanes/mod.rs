//! Vectors of `f32` lanes, one environment a lane, and the choice of instruction set at run time.
//!
//! This is the only module with `unsafe`: vector intrinsics, registers read as numbers, and calls into functions
//! compiled for an instruction set that has been found on the machine. Everything below [`Lanes::control_period`]
//! is inlined into it, so the whole step is compiled once for each set.

#[cfg(target_arch = "x86_64")]
mod avx2;
#[cfg(target_arch = "x86_64")]
mod avx512;
#[cfg(not(target_arch = "x86_64"))]
mod portable;
mod sincos;
#[cfg(target_arch = "x86_64")]
mod sse2;
#[cfg(target_arch = "x86_64")]
mod x86;

#[cfg(target_arch = "x86_64")]
pub use avx2::F32x8;
#[cfg(target_arch = "x86_64")]
pub use avx512::F32x16;
#[cfg(not(target_arch = "x86_64"))]
pub use portable::Portable;
#[cfg(target_arch = "x86_64")]
pub use sse2::F32x4 as Portable;

use crate::{Params, Period, Real};

/// Most lanes of any instruction set.
pub const WIDEST: usize = 16;

/// A scalar that holds several environments.
pub trait Lanes: Real<K = f32, Guard = bool> + Send + Sync + 'static {
    /// Environments in one value.
    const LANES: usize;
    /// Loads one value a lane from the first `LANES` of `x`.
    fn load(x: &[f32]) -> Self;
    /// Stores one value a lane to the first `LANES` of `x`.
    fn store(self, x: &mut [f32]);
    /// [`crate::control_period`] compiled for the lanes' instruction set.
    fn control_period(period: &mut Period<'_, Self>);
}

impl<T: Lanes> Params<T> {
    /// Parameters of a block: one robot a lane. Fewer robots than lanes leave the last ones at zero.
    pub fn in_lanes(robots: &[&Params<f64>]) -> Self {
        Self::pack(robots, |numbers| {
            let mut lanes = [0.0; WIDEST];
            for (lane, number) in lanes.iter_mut().zip(numbers) {
                *lane = *number as f32;
            }
            T::load(&lanes)
        })
    }
}

/// An instruction set the step is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// 16 lanes.
    Avx512,
    /// 8 lanes, fused multiply-add.
    Avx2,
    /// 4 lanes of what every machine of the architecture has: SSE2 on x86-64, NEON on 64-bit Arm.
    Portable,
}

impl Isa {
    /// The best set of this machine.
    pub fn best() -> Self {
        [Isa::Avx512, Isa::Avx2].into_iter().find(|isa| isa.available()).unwrap_or(Isa::Portable)
    }

    /// Whether this machine has it.
    pub fn available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("fma")
            }
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(not(target_arch = "x86_64"))]
            Isa::Avx512 | Isa::Avx2 => false,
            Isa::Portable => true,
        }
    }

    /// Environments in one vector.
    pub fn lanes(self) -> usize {
        match self {
            Isa::Avx512 => 16,
            Isa::Avx2 => 8,
            Isa::Portable => 4,
        }
    }

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Isa::Avx512 => "avx512",
            Isa::Avx2 => "avx2",
            Isa::Portable => "portable",
        }
    }
}

impl std::str::FromStr for Isa {
    type Err = String;
    fn from_str(text: &str) -> Result<Self, String> {
        [Isa::Avx512, Isa::Avx2, Isa::Portable]
            .into_iter()
            .find(|isa| isa.name() == text)
            .ok_or_else(|| format!("unknown instruction set `{text}`; use avx512, avx2 or portable"))
    }
}
