//! Four `f32` in plain Rust, for other architectures than x86-64: the compiler uses whatever the target has.

use core::ops::{Add, Mul, Neg, Sub};

use super::sincos::{sin_cos, turn};
use super::{Differentiable, Lanes};
use crate::real::branching_guards;
use crate::{Dual, Period, Real, control_period};

const N: usize = 4;

/// Four `f32` lanes.
#[derive(Clone, Copy, Debug)]
#[repr(align(16))]
pub struct Portable([f32; N]);

macro_rules! each {
    ($i:ident => $e:expr) => {{
        let mut out = [0.0f32; N];
        let mut $i = 0;
        while $i < N {
            out[$i] = $e;
            $i += 1;
        }
        Portable(out)
    }};
}

/// Fused where that is one instruction; a library call would be far slower than two roundings.
#[inline(always)]
fn multiply_add(a: f32, b: f32, c: f32) -> f32 {
    if cfg!(any(target_feature = "fma", target_arch = "aarch64")) { a.mul_add(b, c) } else { a * b + c }
}

impl Add for Portable {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        each!(i => self.0[i] + b.0[i])
    }
}
impl Sub for Portable {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        each!(i => self.0[i] - b.0[i])
    }
}
impl Mul for Portable {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        each!(i => self.0[i] * b.0[i])
    }
}
impl Neg for Portable {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        each!(i => -self.0[i])
    }
}

/// Nearest whole number for |x| < 2²², without the library call that SSE2 would need.
#[inline(always)]
fn round(x: Portable) -> Portable {
    // 1.5 · 2²³: about this number neighbours of single precision are 1 apart, for both signs of x.
    const MAGIC: f32 = 12_582_912.0;
    each!(i => (x.0[i] + MAGIC) - MAGIC)
}

#[inline(always)]
fn quarters(k: Portable, s: Portable, c: Portable) -> (Portable, Portable) {
    turn(k, s, c, round)
}

impl Differentiable for Portable {
    fn period_along(period: &mut Period<'_, Dual<Self>>) {
        control_period(period);
    }
}

#[inline(always)]
fn all_ge(a: Portable, b: Portable) -> bool {
    let mut all = true;
    let mut i = 0;
    while i < N {
        all &= a.0[i] >= b.0[i];
        i += 1;
    }
    all
}

impl Real for Portable {
    type K = f32;
    #[inline(always)]
    fn constant(x: f64) -> f32 {
        x as f32
    }
    #[inline(always)]
    fn k(x: f32) -> Self {
        Self([x; N])
    }
    #[inline(always)]
    fn fma(self, b: Self, c: Self) -> Self {
        each!(i => multiply_add(self.0[i], b.0[i], c.0[i]))
    }
    #[inline(always)]
    fn fnma(self, b: Self, c: Self) -> Self {
        each!(i => multiply_add(-self.0[i], b.0[i], c.0[i]))
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        each!(i => self.0[i] / b.0[i])
    }
    #[inline(always)]
    fn sqrt(self) -> Self {
        each!(i => self.0[i].sqrt())
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        // As x86's vector instructions: the second number where one is NaN.
        each!(i => if self.0[i] < b.0[i] { self.0[i] } else { b.0[i] })
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        each!(i => if self.0[i] > b.0[i] { self.0[i] } else { b.0[i] })
    }
    #[inline(always)]
    fn abs(self) -> Self {
        each!(i => self.0[i].abs())
    }
    #[inline(always)]
    fn select_lt(a: Self, b: Self, x: Self, y: Self) -> Self {
        each!(i => if a.0[i] < b.0[i] { x.0[i] } else { y.0[i] })
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        sin_cos(self, round, quarters)
    }
    #[inline(always)]
    fn round(self) -> Self {
        round(self)
    }
    #[inline(always)]
    fn gather(table: &[f32], index: Self) -> Self {
        each!(i => table.get(index.0[i] as usize).copied().unwrap_or(0.0))
    }
    branching_guards!(all_ge);
}

impl Lanes for Portable {
    const LANES: usize = N;
    #[inline(always)]
    fn load(x: &[f32]) -> Self {
        each!(i => x[i])
    }
    #[inline(always)]
    fn store(self, x: &mut [f32]) {
        x[..N].copy_from_slice(&self.0);
    }
    fn control_period(period: &mut Period<'_, Self>) {
        control_period(period);
    }
}
