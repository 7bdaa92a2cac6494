//! Eight `f32` in one AVX register, with fused multiply-add.

#![allow(unsafe_code)] // Intrinsics; see each block's reason.

use core::arch::x86_64::*;

use super::sincos::{sin_cos, turn};
use super::x86::{compiled_for, intrinsic, lane_type};
use crate::real::branching_guards;
use crate::{Part, Period};

lane_type! {
    /// Eight `f32` in one AVX register, with fused multiply-add.
    F32x8(__m256) of 8:
    _mm256_add_ps _mm256_sub_ps _mm256_mul_ps _mm256_div_ps _mm256_sqrt_ps _mm256_min_ps _mm256_max_ps
    _mm256_xor_ps _mm256_andnot_ps _mm256_set1_ps;
    Real {
        #[inline(always)]
        fn fma(self, b: Self, c: Self) -> Self {
            Self(intrinsic!(_mm256_fmadd_ps(self.0, b.0, c.0)))
        }
        #[inline(always)]
        fn fnma(self, b: Self, c: Self) -> Self {
            Self(intrinsic!(_mm256_fnmadd_ps(self.0, b.0, c.0)))
        }
        #[inline(always)]
        fn select_lt(a: Self, b: Self, x: Self, y: Self) -> Self {
            // The comparison is false for NaN, so such lanes take the second number.
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
        branching_guards!(all_ge);
        #[inline(always)]
        fn separate<P: Part<A, R>, A, R>(arguments: A) -> R {
            #[target_feature(enable = "avx2,fma")]
            #[inline(never)]
            fn run<P: Part<A, R>, A, R>(arguments: A) -> R {
                P::run(arguments)
            }
            intrinsic!(run::<P, A, R>(arguments))
        }
    }
    Lanes {
        fn control_period(period: &mut Period<'_, Self>) {
            compiled(period);
        }
    }
}

compiled_for!(F32x8, "avx2,fma", Avx2, "AVX2");

#[inline(always)]
fn all_ge(a: F32x8, b: F32x8) -> bool {
    intrinsic!(_mm256_movemask_ps(_mm256_cmp_ps::<_CMP_GE_OQ>(a.0, b.0)) == 0xff)
}

#[inline(always)]
fn round(x: F32x8) -> F32x8 {
    F32x8(intrinsic!(_mm256_round_ps::<{ _MM_FROUND_TO_NEAREST_INT | _MM_FROUND_NO_EXC }>(x.0)))
}

#[inline(always)]
fn quarters(k: F32x8, s: F32x8, c: F32x8) -> (F32x8, F32x8) {
    turn(k, s, c, round)
}
