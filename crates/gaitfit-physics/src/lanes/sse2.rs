//! Four `f32` in one SSE register: what every x86-64 has.

#![allow(unsafe_code)] // Intrinsics; see each block's reason.

use core::arch::x86_64::*;

use super::Differentiable;
use super::sincos::{sin_cos, turn};
use super::x86::{intrinsic, lane_type};
use crate::real::branching_guards;
use crate::{Dual, Period, Real, control_period};

lane_type! {
    /// Four `f32` in one SSE register: what every x86-64 has.
    F32x4(__m128) of 4:
    _mm_add_ps _mm_sub_ps _mm_mul_ps _mm_div_ps _mm_sqrt_ps _mm_min_ps _mm_max_ps
    _mm_xor_ps _mm_andnot_ps _mm_set1_ps;
    Real {
        #[inline(always)]
        fn fma(self, b: Self, c: Self) -> Self {
            // SSE2 has no fused multiply-add: two roundings.
            self * b + c
        }
        #[inline(always)]
        fn fnma(self, b: Self, c: Self) -> Self {
            c - self * b
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
        branching_guards!(all_ge);
    }
    Lanes {
        fn control_period(period: &mut Period<'_, Self>) {
            control_period(period);
        }
    }
}

impl Differentiable for F32x4 {
    fn period_along(period: &mut Period<'_, Dual<Self>>) {
        control_period(period);
    }
}

#[inline(always)]
fn all_ge(a: F32x4, b: F32x4) -> bool {
    intrinsic!(_mm_movemask_ps(_mm_cmpge_ps(a.0, b.0)) == 0xf)
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
