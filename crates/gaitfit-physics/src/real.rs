//! The scalar the step is written over.

use core::ops::{Add, Mul, Neg, Sub};

/// Arithmetic that one physics step needs: an `f64`, a vector of `f32` lanes with one environment a lane,
/// or a node of a recorded expression graph.
///
/// There are no comparisons that return `bool` and no integers: choices are made with [`Real::select_lt`],
/// so that every implementation sees the same straight line of operations. The single exception is
/// [`Real::all_ge`], a hint that may only be used to leave out work whose result is exactly zero.
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// A constant that is the same for every environment.
    type K: Copy;
    /// Rounds a model number to a constant.
    fn constant(x: f64) -> Self::K;
    /// Broadcasts a constant.
    fn k(x: Self::K) -> Self;
    /// Broadcasts a literal.
    #[inline(always)]
    fn lit(x: f64) -> Self {
        Self::k(Self::constant(x))
    }
    /// Zero.
    #[inline(always)]
    fn zero() -> Self {
        Self::lit(0.0)
    }
    /// `self · b + c`, fused where the hardware does.
    fn fma(self, b: Self, c: Self) -> Self;
    /// `c − self · b`, fused where the hardware does.
    fn fnma(self, b: Self, c: Self) -> Self;
    /// Quotient.
    fn div(self, b: Self) -> Self;
    /// Square root.
    fn sqrt(self) -> Self;
    /// Smaller of two.
    fn min(self, b: Self) -> Self;
    /// Larger of two.
    fn max(self, b: Self) -> Self;
    /// Absolute value.
    fn abs(self) -> Self;
    /// `x` where `a < b`, else `y`.
    fn select_lt(a: Self, b: Self, x: Self, y: Self) -> Self;
    /// Sine and cosine of an angle in radians.
    fn sin_cos(self) -> (Self, Self);
    /// Whether every lane certainly satisfies `self ≥ b`. `false` is always a correct answer.
    #[inline(always)]
    fn all_ge(self, _b: Self) -> bool {
        false
    }
    /// Reciprocal of a positive, finite, normal number; may be off by an ulp or two in lanes.
    #[inline(always)]
    fn recip(self) -> Self {
        Self::lit(1.0).div(self)
    }
    /// Hyperbolic tangent; in lanes to 1e-7.
    #[inline(always)]
    fn tanh(self) -> Self {
        // tanh x = 2ND/(D² + N²) with N/D Lambert's continued fraction of tanh(x/2), cut at x⁷/x⁶.
        let x = self.clamp(Self::lit(-9.0), Self::lit(9.0)) * Self::lit(0.5);
        let s = x * x;
        let n = (s + Self::lit(378.0)).fma(s, Self::lit(17_325.0)).fma(s, Self::lit(135_135.0)) * x;
        let d = Self::lit(28.0).fma(s, Self::lit(3_150.0));
        let d = d.fma(s, Self::lit(62_370.0)).fma(s, Self::lit(135_135.0));
        let d2 = d * d;
        (Self::lit(2.0) * n * d) * n.fma(n, d2).recip()
    }
    /// `self` limited to `[lower, upper]`.
    #[inline(always)]
    fn clamp(self, lower: Self, upper: Self) -> Self {
        self.max(lower).min(upper)
    }
}

macro_rules! scalar {
    ($t:ty) => {
        impl Real for $t {
            type K = $t;
            #[inline(always)]
            fn constant(x: f64) -> $t {
                x as $t
            }
            #[inline(always)]
            fn k(x: $t) -> $t {
                x
            }
            #[inline(always)]
            fn fma(self, b: $t, c: $t) -> $t {
                self * b + c
            }
            #[inline(always)]
            fn fnma(self, b: $t, c: $t) -> $t {
                c - self * b
            }
            #[inline(always)]
            fn div(self, b: $t) -> $t {
                self / b
            }
            #[inline(always)]
            fn sqrt(self) -> $t {
                <$t>::sqrt(self)
            }
            #[inline(always)]
            fn min(self, b: $t) -> $t {
                if self < b { self } else { b }
            }
            #[inline(always)]
            fn max(self, b: $t) -> $t {
                if self > b { self } else { b }
            }
            #[inline(always)]
            fn abs(self) -> $t {
                <$t>::abs(self)
            }
            #[inline(always)]
            fn select_lt(a: $t, b: $t, x: $t, y: $t) -> $t {
                if a < b { x } else { y }
            }
            #[inline(always)]
            fn sin_cos(self) -> ($t, $t) {
                <$t>::sin_cos(self)
            }
            #[inline(always)]
            fn all_ge(self, b: $t) -> bool {
                self >= b
            }
            #[inline(always)]
            fn tanh(self) -> $t {
                <$t>::tanh(self)
            }
        }
    };
}
scalar!(f64);
scalar!(f32);
