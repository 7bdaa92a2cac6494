//! Four `f32` in one SSE register: what every x86-64 has.

#![allow(unsafe_code)] // Intrinsics; see each block's reason.

use core::arch::x86_64::*;
use core::ops::{Add, Mul, Neg, Sub};

use super::Lanes;
use super::sincos::{sin_cos, turn};
use crate::{Period, Real, control_period};

/// Four `f32` in one SSE register: what every x86-64 has.
#[derive(Clone, Copy, Debug)]
#[repr(transparent)]
pub struct F32x4(__m128);

/// An intrinsic of the set. Values of this type are only worked on inside functions that were entered after
/// the set was found on the machine (see [`Lanes::control_period`]).
macro_rules! intrinsic {
    ($e:expr) => {
        // SAFETY: register arithmetic without memory access; the set is present, see above.
        unsafe { $e }
    };
}

impl Add for F32x4 {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self(intrinsic!(_mm_add_ps(self.0, b.0)))
    }
}
impl Sub for F32x4 {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self(intrinsic!(_mm_sub_ps(self.0, b.0)))
    }
}
impl Mul for F32x4 {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self(intrinsic!(_mm_mul_ps(self.0, b.0)))
    }
}
impl Neg for F32x4 {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self(intrinsic!(_mm_xor_ps(self.0, _mm_set1_ps(-0.0))))
    }
}

/// Nearest whole number for |x| < 2²²: adding and taking away 1.5·2²³ rounds.
#[inline(always)]
fn round(x: F32x4) -> F32x4 {
    let magic = F32x4::lit(12_582_912.0);
    (x + magic) - magic
}

#[inline(always)]
fn quarters(k: F32x4, s: F32x4, c: F32x4) -> (F32x4, F32x4) {
    turn(k, s, c, round)
}

impl Real for F32x4 {
    type K = f32;
    #[inline(always)]
    fn constant(x: f64) -> f32 {
        x as f32
    }
    #[inline(always)]
    fn k(x: f32) -> Self {
        Self(intrinsic!(_mm_set1_ps(x)))
    }
    #[inline(always)]
    fn fma(self, b: Self, c: Self) -> Self {
        self * b + c
    }
    #[inline(always)]
    fn fnma(self, b: Self, c: Self) -> Self {
        c - self * b
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        Self(intrinsic!(_mm_div_ps(self.0, b.0)))
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        Self(intrinsic!(_mm_sqrt_ps(self.0)))
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        Self(intrinsic!(_mm_min_ps(self.0, b.0)))
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        Self(intrinsic!(_mm_max_ps(self.0, b.0)))
    }
    #[inline(always)]
    fn abs(self) -> Self {
        Self(intrinsic!(_mm_andnot_ps(_mm_set1_ps(-0.0), self.0)))
    }
    #[inline(always)]
    fn select_lt(a: Self, b: Self, x: Self, y: Self) -> Self {
        Self(intrinsic!({
            let mask = _mm_cmplt_ps(a.0, b.0);
            _mm_or_ps(_mm_and_ps(mask, x.0), _mm_andnot_ps(mask, y.0))
        }))
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        sin_cos(self, round, quarters)
    }
    #[inline(always)]
    fn all_ge(self, b: Self) -> bool {
        intrinsic!(_mm_movemask_ps(_mm_cmpge_ps(self.0, b.0)) == 0xf)
    }
}

impl Lanes for F32x4 {
    const LANES: usize = 4;
    #[inline(always)]
    fn load(x: &[f32]) -> Self {
        let x = &x[..4];
        // SAFETY: the slice above has 4 elements; unaligned load.
        Self(unsafe { _mm_loadu_ps(x.as_ptr()) })
    }
    #[inline(always)]
    fn store(self, x: &mut [f32]) {
        let x = &mut x[..4];
        // SAFETY: the slice above has 4 elements; unaligned store.
        unsafe { _mm_storeu_ps(x.as_mut_ptr(), self.0) }
    }
    fn control_period(period: &mut Period<'_, Self>) {
        control_period(period);
    }
}
