//! Vectors of `f32` lanes, one environment a lane, compiled for each instruction set.
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

use crate::{Dual, Params, Period, Real};

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

/// Lanes whose step is also compiled for numbers with derivatives.
pub trait Differentiable: Lanes {
    /// [`crate::control_period`] with a derivative beside every number, compiled for the lanes' instruction set.
    fn period_along(period: &mut Period<'_, Dual<Self>>);
}

/// Values are loaded and stored; a loaded number does not change along the direction.
impl<T: Differentiable> Lanes for Dual<T> {
    const LANES: usize = T::LANES;
    #[inline(always)]
    fn load(x: &[f32]) -> Self {
        Self { value: T::load(x), tangent: T::load(&[0.0; WIDEST]) }
    }
    #[inline(always)]
    fn store(self, x: &mut [f32]) {
        self.value.store(x);
    }
    fn control_period(period: &mut Period<'_, Self>) {
        T::period_along(period);
    }
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

/// The value of an expression with a type `$lanes`, the [`Lanes`] of an instruction set that the machine has.
#[macro_export]
macro_rules! with_lanes {
    ($isa:expr, $lanes:ident => $value:expr) => {
        match $isa {
            #[cfg(target_arch = "x86_64")]
            $crate::Isa::Avx512 => {
                type $lanes = $crate::F32x16;
                $value
            }
            #[cfg(target_arch = "x86_64")]
            $crate::Isa::Avx2 => {
                type $lanes = $crate::F32x8;
                $value
            }
            _ => {
                type $lanes = $crate::Portable;
                $value
            }
        }
    };
}
