//! Sixteen `f32` in one AVX-512 register.

#![allow(unsafe_code)] // Intrinsics; see each block's reason.

use core::arch::x86_64::*;

use super::sincos::sin_cos;
use super::x86::{compiled_for, intrinsic, lane_type};
use crate::real::branching_guards;
use crate::{Part, Period};

lane_type! {
    /// Sixteen `f32` in one AVX-512 register.
    F32x16(__m512) of 16:
    _mm512_add_ps _mm512_sub_ps _mm512_mul_ps _mm512_div_ps _mm512_sqrt_ps _mm512_min_ps _mm512_max_ps
    _mm512_xor_ps _mm512_andnot_ps _mm512_set1_ps;
    Real {
        #[inline(always)]
        fn fma(self, b: Self, c: Self) -> Self {
            Self(intrinsic!(_mm512_fmadd_ps(self.0, b.0, c.0)))
        }
        #[inline(always)]
        fn fnma(self, b: Self, c: Self) -> Self {
            Self(intrinsic!(_mm512_fnmadd_ps(self.0, b.0, c.0)))
        }
        #[inline(always)]
        fn select_lt(a: Self, b: Self, x: Self, y: Self) -> Self {
            Self(intrinsic!(_mm512_mask_blend_ps(_mm512_cmp_ps_mask::<_CMP_LT_OQ>(a.0, b.0), y.0, x.0)))
        }
        #[inline(always)]
        fn sin_cos(self) -> (Self, Self) {
            sin_cos(self, round, quarters)
        }
        #[inline(always)]
        fn recip(self) -> Self {
            // 14 bits and one Newton step: the divider is several times slower.
            let r = Self(intrinsic!(_mm512_rcp14_ps(self.0)));
            self.fnma(r, Self::lit(1.0)).fma(r, r)
        }
        #[inline(always)]
        fn clamp_abs(self, bound: Self) -> Self {
            // The smaller of both by size, with the sign of the first: one instruction instead of three.
            Self(intrinsic!(_mm512_range_ps::<0b0010>(self.0, bound.0)))
        }
        branching_guards!(all_ge);
        #[inline(always)]
        fn separate<P: Part<A, R>, A, R>(arguments: A) -> R {
            #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,fma")]
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

compiled_for!(F32x16, "avx512f,avx512dq,avx512vl,avx512bw,fma", Avx512, "AVX-512");

#[inline(always)]
fn all_ge(a: F32x16, b: F32x16) -> bool {
    intrinsic!(_mm512_cmp_ps_mask::<_CMP_GE_OQ>(a.0, b.0) == u16::MAX)
}

#[inline(always)]
fn round(x: F32x16) -> F32x16 {
    F32x16(intrinsic!(_mm512_roundscale_ps::<0>(x.0)))
}

/// (s, c) turned by `k` quarters: odd ones swap, bit 1 of k (of k + 1) is the sign.
#[inline(always)]
fn quarters(k: F32x16, s: F32x16, c: F32x16) -> (F32x16, F32x16) {
    intrinsic!({
        let k = _mm512_cvtps_epi32(k.0);
        let one = _mm512_set1_epi32(1);
        let two = _mm512_set1_epi32(2);
        // An odd quarter swaps sine and cosine. Bit 1 of k, moved to bit 31, is the sine's sign; that of k +
        // 1 the cosine's.
        let odd = _mm512_test_epi32_mask(k, one);
        let sine = _mm512_castps_si512(_mm512_mask_blend_ps(odd, s.0, c.0));
        let cosine = _mm512_castps_si512(_mm512_mask_blend_ps(odd, c.0, s.0));
        let sign = _mm512_slli_epi32::<30>(_mm512_and_si512(k, two));
        let cosign = _mm512_slli_epi32::<30>(_mm512_and_si512(_mm512_add_epi32(k, one), two));
        (
            F32x16(_mm512_castsi512_ps(_mm512_xor_si512(sine, sign))),
            F32x16(_mm512_castsi512_ps(_mm512_xor_si512(cosine, cosign))),
        )
    })
}
