//! Eight `f32` in one AVX register, with fused multiply-add.

#![allow(unsafe_code)] // Intrinsics; see each block's reason.

use core::arch::x86_64::*;
use core::ops::{Add, Mul, Neg, Sub};

use super::{Isa, Lanes};
use super::sincos::{sin_cos, turn};
use crate::{Period, Real, control_period};

/// Eight `f32` in one AVX register, with fused multiply-add.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct F32x8(__m256);

/// An intrinsic of the set. Values of this type are only worked on inside functions that were entered after
/// the set was found on the machine (see [`Lanes::control_period`]).
macro_rules! intrinsic {
    ($e:expr) => {
        // SAFETY: register arithmetic without memory access; the set is present, see above.
        unsafe { $e }
    };
}

impl Add for F32x8 {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self(intrinsic!(_mm256_add_ps(self.0, b.0)))
    }
}
impl Sub for F32x8 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self(intrinsic!(_mm256_sub_ps(self.0, b.0)))
    }
}
impl Mul for F32x8 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self(intrinsic!(_mm256_mul_ps(self.0, b.0)))
    }
}
impl Neg for F32x8 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(intrinsic!(_mm256_xor_ps(self.0, _mm256_set1_ps(-0.0))))
    }
}

#[inline(always)]
fn round(x: F32x8) -> F32x8 {
    F32x8(intrinsic!(_mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(x.0)))
}

#[inline(always)]
fn quarters(k: F32x8, s: F32x8, c: F32x8) -> (F32x8, F32x8) {
    turn(k, s, c, round)
}

impl Real for F32x8 {
    type K = f32;
    #[inline(always)]
    fn constant(x: f64) -> f32 {
        x as f32
    }
    #[inline(always)]
    fn k(x: f32) -> Self {
        Self(intrinsic!(_mm256_set1_ps(x)))
    }
    #[inline(always)]
    fn fma(self, b: Self, c: Self) -> Self {
        Self(intrinsic!(_mm256_fmadd_ps(self.0, b.0, c.0)))
    }
    #[inline(always)]
    fn fnma(self, b: Self, c: Self) -> Self {
        Self(intrinsic!(_mm256_fnmadd_ps(self.0, b.0, c.0)))
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        Self(intrinsic!(_mm256_div_ps(self.0, b.0)))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(intrinsic!(_mm256_sqrt_ps(self.0)))
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        Self(intrinsic!(_mm256_min_ps(self.0, b.0)))
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        Self(intrinsic!(_mm256_max_ps(self.0, b.0)))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(intrinsic!(_mm256_andnot_ps(_mm256_set1_ps(-0.0), self.0)))
    }
    #[inline(always)]
    fn select_lt(a: Self, b: Self, x: Self, y: Self) -> Self {
        Self(intrinsic!(_mm256_blendv_ps(y.0, x.0, _mm256_cmp_ps::<_CMP_LT_OQ>(a.0, b.0))))
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        sin_cos(self, round, quarters)
    }
    #[inline(always)]
    fn recip(self) -> Self {
        // 12 bits and two Newton steps: still faster than the divider.
        let r = Self(intrinsic!(_mm256_rcp_ps(self.0)));
        let r = self.fnma(r, Self::lit(1.0)).fma(r, r);
        self.fnma(r, Self::lit(1.0)).fma(r, r)
    }
    #[inline(always)]
    fn all_ge(self, b: Self) -> bool {
        intrinsic!(_mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GE_OQ>(self.0, b.0)) == 0xff)
    }
}

impl Lanes for F32x8 {
    const LANES: usize = 8;
    #[inline(always)]
    fn load(x: &[f32]) -> Self {
        let x = &x[..8];
        // SAFETY: the slice above has 8 elements; unaligned load.
        Self(unsafe { _mm256_loadu_ps(x.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, x: &mut [f32]) {
        let x = &mut x[..8];
        // SAFETY: the slice above has 8 elements; unaligned store.
        unsafe { _mm256_storeu_ps(x.as_mut_ptr(), self.0) }
    }
    fn control_period(period: &mut Period<'_, Self>) {
        #[target_feature(enable = "avx2,fma")]
        fn run(period: &mut Period<'_, F32x8>) {
            control_period(period);
        }
        assert!(Isa::Avx2.available(), "this machine has no AVX2; ask `Isa::available` first");
        // SAFETY: the set has just been found on the machine.
        unsafe { run(period) }
    }
}
