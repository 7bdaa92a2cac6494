//! The two float types a network runs in: `f32` at work, `f64` where its derivatives are checked.

use std::fmt::Debug;
use std::iter::Sum;
use std::ops::{Add, AddAssign, Div, Mul, MulAssign, Neg, Sub};

/// `f32` or `f64`. The elementwise functions are branch-free, so that loops over them vectorise; NaN comes out as NaN.
///
/// Sealed: the matrix kernels know these two types only.
pub trait Scalar:
    sealed::Sealed
    + Copy
    + Debug
    + Default
    + PartialOrd
    + Send
    + Sync
    + Sum
    + 'static
    + Add<Output = Self>
    + Sub<Output = Self>
    + Mul<Output = Self>
    + Div<Output = Self>
    + Neg<Output = Self>
    + AddAssign
    + MulAssign
{
    /// 0.
    const ZERO: Self;
    /// 1.
    const ONE: Self;

    /// The nearest number of this type.
    fn from_f64(x: f64) -> Self;
    /// Converts to double precision.
    fn to_f64(self) -> f64;
    /// self · a + b: in one rounding if `FUSED`, which only code compiled for fused multiply-add may ask for (elsewhere
    /// it is a slow call), else in two.
    fn multiply_add<const FUSED: bool>(self, a: Self, b: Self) -> Self;
    /// eˣ; the `f32` form is within 2 units in the last place on [−87, 88] and saturates outside.
    fn exponential<const FUSED: bool>(self) -> Self;
    /// √x.
    fn square_root(self) -> Self;
    /// Hyperbolic tangent; absolute error below 2⁻²² for `f32`.
    fn hyperbolic_tangent<const FUSED: bool>(self) -> Self;
}

pub(super) mod sealed {
    use gemm_common::Parallelism;

    /// A matrix product of the `gemm` family: sizes m, n, k; the destination with its column and row strides and whether
    /// it is read; both factors with their column and row strides; the factors of destination and product; three
    /// conjugations; threads. The destination's column stride must not be smaller than its row stride.
    pub type Product<T> = unsafe fn(
        usize,
        usize,
        usize,
        *mut T,
        isize,
        isize,
        bool,
        *const T,
        isize,
        isize,
        *const T,
        isize,
        isize,
        T,
        T,
        bool,
        bool,
        bool,
        Parallelism,
    );

    pub trait Sealed: Sized {
        /// The product's kernel for the processor at hand.
        fn product() -> Product<Self>;
    }
    impl Sealed for f32 {
        fn product() -> Product<Self> {
            gemm_f32::gemm::f32::get_gemm_fn()
        }
    }
    impl Sealed for f64 {
        fn product() -> Product<Self> {
            gemm_f64::gemm::f64::get_gemm_fn()
        }
    }
}

impl Scalar for f64 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;

    #[inline(always)]
    fn from_f64(x: f64) -> Self {
        x
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        self
    }
    #[inline(always)]
    fn multiply_add<const FUSED: bool>(self, a: Self, b: Self) -> Self {
        if FUSED { self.mul_add(a, b) } else { self * a + b }
    }
    #[inline(always)]
    fn exponential<const FUSED: bool>(self) -> Self {
        self.exp()
    }
    #[inline(always)]
    fn square_root(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn hyperbolic_tangent<const FUSED: bool>(self) -> Self {
        self.tanh()
    }
}

impl Scalar for f32 {
    const ZERO: Self = 0.0;
    const ONE: Self = 1.0;

    #[inline(always)]
    fn from_f64(x: f64) -> Self {
        x as f32
    }
    #[inline(always)]
    fn to_f64(self) -> f64 {
        f64::from(self)
    }
    #[inline(always)]
    fn square_root(self) -> Self {
        self.sqrt()
    }
    #[inline(always)]
    fn multiply_add<const FUSED: bool>(self, a: Self, b: Self) -> Self {
        if FUSED { self.mul_add(a, b) } else { self * a + b }
    }

    /// Cody and Waite (1980): x = n ln 2 + r with ln 2 in two parts, Taylor's series of degree 6 for eʳ, 2ⁿ by its
    /// bits.
    #[inline(always)]
    fn exponential<const FUSED: bool>(self) -> Self {
        // 1.5 × 2²³: adding it leaves the nearest integer in the low bits of the sum.
        const ROUND: f32 = 12_582_912.0;
        // 0.693359375 is 355/512, so n times it is exact in `f32`; the second part is the rest of ln 2.
        const LN_2_HIGH: f32 = 0.693_359_4;
        const LN_2_LOW: f32 = -2.121_944_4e-4;
        // From −87 to 88, n stays between −126 and 127, so 2ⁿ is a normal `f32`.
        // Selections written so that a NaN fails the comparison and passes through.
        let x = if self < -87.0 { -87.0 } else { self };
        let x = if x > 88.0 { 88.0 } else { x };
        let shifted = x.multiply_add::<FUSED>(std::f32::consts::LOG2_E, ROUND);
        let n = shifted - ROUND;
        let r = n.multiply_add::<FUSED>(-LN_2_LOW, n.multiply_add::<FUSED>(-LN_2_HIGH, x));
        let mut p = 1.0 / 720.0;
        for coefficient in [1.0 / 120.0, 1.0 / 24.0, 1.0 / 6.0, 0.5, 1.0, 1.0] {
            p = p.multiply_add::<FUSED>(r, coefficient);
        }
        // The low bits of `shifted` hold n; shifted to the exponent's place, with its bias of 127, they are
        // 2ⁿ.
        p * f32::from_bits((shifted.to_bits() << 23).wrapping_add(127 << 23))
    }

    /// 1 − 2 / (e²ˣ + 1), from `exponential`.
    #[inline(always)]
    fn hyperbolic_tangent<const FUSED: bool>(self) -> Self {
        // tanh 10 is 1 in `f32`.
        let x = if self > 10.0 { 10.0 } else { self };
        1.0 - 2.0 / ((2.0 * x).exponential::<FUSED>() + 1.0)
    }
}

#[cfg(test)]
mod tests {
    use super::Scalar;

    #[test]
    fn exponential_and_tangent_are_those_of_double_precision() {
        check::<false>();
        check::<true>();
    }

    fn check<const FUSED: bool>() {
        for i in -100_000..=100_000 {
            let x = i as f32 * 8.8e-4;
            if x >= -87.0 {
                let (got, want) = (f64::from(x.exponential::<FUSED>()), f64::from(x).exp());
                assert!((got / want - 1.0).abs() < 2.5e-7, "exp({x}) = {got}, not {want}");
            }
            let (got, want) = (f64::from(x.hyperbolic_tangent::<FUSED>()), f64::from(x).tanh());
            assert!((got - want).abs() < 2.4e-7, "tanh({x}) = {got}, not {want}");
        }
        assert_eq!(0.0_f32.exponential::<FUSED>(), 1.0);
        assert!(f32::NAN.exponential::<FUSED>().is_nan() && f32::NAN.hyperbolic_tangent::<FUSED>().is_nan());
        assert!(
            f32::NEG_INFINITY.exponential::<FUSED>() < 1e-37 && f32::INFINITY.exponential::<FUSED>() > 1e38
        );
        assert_eq!(f32::NEG_INFINITY.hyperbolic_tangent::<FUSED>(), -1.0);
        assert_eq!(f32::INFINITY.hyperbolic_tangent::<FUSED>(), 1.0);
    }
}
