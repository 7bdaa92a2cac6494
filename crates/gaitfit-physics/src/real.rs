//! The scalar the step is written over.

use core::ops::{Add, Mul, Neg, Sub};

use crate::separate::Part;

/// Arithmetic that one physics step needs: an `f64`, a vector of `f32` lanes with one environment a lane,
/// or a node of a recorded expression graph.
///
/// There are no comparisons that return `bool` and no integers: choices are made with [`Real::select_lt`],
/// so that every implementation sees the same operations in the same order.
///
/// The single exception is a guarded region: work that is left out where no lane needs it. A [`Real::Guard`] is
/// made by [`Real::unless_ge`]. A region is the text between [`Real::enter`] and [`Real::leave`]:
/// ```ignore
/// if T::enter(guard) {
///     let new = expensive(sum);
///     T::leave(guard);
///     sum = new.merge(guard, sum);
/// }
/// ```
/// A number made in a region is read only in regions of the same guard, or passed on by [`Real::merge`]. In lanes
/// that do not need the region, the new number equals the old one; so results do not depend on what is left out. A
/// recording scalar enters every region and keeps its bounds (see [`crate::trace`]).
pub trait Real:
    Copy + Add<Output = Self> + Sub<Output = Self> + Mul<Output = Self> + Neg<Output = Self>
{
    /// A number that is the same for every environment of a block: a constant of the model, or a weight of a
    /// candidate's network.
    type K: Copy;
    /// Whether a region is needed.
    type Guard: Copy + core::fmt::Debug;
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
    /// A guard that no lane needs.
    fn never() -> Self::Guard;
    /// The guard of a region that is needed unless every lane satisfies `self ≥ b`.
    fn unless_ge(self, b: Self) -> Self::Guard;
    /// The guard of a region that is needed unless every lane is 0, and stays 0 along a derivative's direction.
    #[inline(always)]
    fn unless_zero(self) -> Self::Guard {
        // The negative of a magnitude is at least 0 only where the number is 0.
        (-self.abs()).unless_ge(Self::zero())
    }
    /// Begins a region; `false` says to leave it out.
    fn enter(guard: Self::Guard) -> bool;
    /// Ends a region that was begun.
    fn leave(guard: Self::Guard);
    /// After a region: `self`, made in it, where it was needed, else `before`.
    fn merge(self, guard: Self::Guard, before: Self) -> Self;
    /// The nearest whole number, for |self| < 2²².
    fn round(self) -> Self;
    /// The entry of `table` with the number `index`, which is whole and not negative; zero beyond the table's end.
    fn gather(table: &[Self::K], index: Self) -> Self;
    /// A function of three numbers that is called at many places: a recording holds its operations once. `key`
    /// identifies the function and all values that it uses besides its arguments.
    #[inline(always)]
    fn call(_key: usize, inputs: [Self; 3], function: impl FnOnce([Self; 3]) -> [Self; 4]) -> [Self; 4] {
        function(inputs)
    }
    /// Calls a part of the step that is a function of its own, compiled for the scalar's instruction set.
    #[inline(never)]
    fn separate<P: Part<A, R>, A, R>(arguments: A) -> R {
        P::run(arguments)
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
        // Beyond ±9 tanh differs from ±1 by less than 4e-8, while the fraction would leave its range.
        let x = self.clamp(Self::lit(-9.0), Self::lit(9.0)) * Self::lit(0.5);
        let s = x * x;
        let n = (s + Self::lit(378.0)).fma(s, Self::lit(17_325.0)).fma(s, Self::lit(135_135.0)) * x;
        let d = Self::lit(28.0).fma(s, Self::lit(3_150.0));
        let d = d.fma(s, Self::lit(62_370.0)).fma(s, Self::lit(135_135.0));
        let d2 = d * d;
        (Self::lit(2.0) * n * d) * n.fma(n, d2).recip()
    }
    /// `self` limited to `[−bound, bound]`, for bounds that are not negative. Instruction sets differ in what they return for
    /// numbers that are not finite.
    #[inline(always)]
    fn clamp_abs(self, bound: Self) -> Self {
        self.clamp(-bound, bound)
    }
    /// `self` limited to `[lower, upper]`.
    #[inline(always)]
    fn clamp(self, lower: Self, upper: Self) -> Self {
        self.max(lower).min(upper)
    }
}

/// Guards of scalars that can be looked at: a region is left out by an ordinary branch. `$all_ge(a, b)` says whether
/// every lane satisfies a ≥ b.
macro_rules! branching_guards {
    ($all_ge:expr) => {
        type Guard = bool;
        #[inline(always)]
        fn never() -> bool {
            false
        }
        #[inline(always)]
        fn unless_ge(self, b: Self) -> bool {
            !$all_ge(self, b)
        }
        #[inline(always)]
        fn enter(guard: bool) -> bool {
            guard
        }
        #[inline(always)]
        fn leave(_guard: bool) {}
        #[inline(always)]
        fn merge(self, _guard: bool, _before: Self) -> Self {
            self
        }
    };
}
pub(crate) use branching_guards;

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
                // As vector instructions do it: the second number where one is NaN.
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
            fn round(self) -> $t {
                <$t>::round_ties_even(self)
            }
            #[inline(always)]
            fn gather(table: &[$t], index: $t) -> $t {
                // Beyond its end a table has zeros, also for lanes and in recordings.
                table.get(index as usize).copied().unwrap_or(0.0)
            }
            branching_guards!(|a: $t, b: $t| a >= b);
            #[inline(always)]
            fn tanh(self) -> $t {
                <$t>::tanh(self)
            }
        }
    };
}
scalar!(f64);
scalar!(f32);
