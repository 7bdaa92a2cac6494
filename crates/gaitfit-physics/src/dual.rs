//! Forward-mode derivatives: a number with its derivative along one direction.
//!
//! With a [`Dual`] for the scalar, the step computes how its result changes along a direction of all that goes in: the
//! start, the robot's numbers, targets. The derivative is that of the computation itself, with the steps of the solver
//! that it takes: no step width is to be chosen and nothing is rounded but the numbers. See Griewank and Walther,
//! *Evaluating Derivatives* (2008), ch. 3.
//!
//! Values are those of the plain scalar, bit for bit. Where a function has a kink the derivative is that of the side
//! taken; a rounded number and a table's entry do not change. A guarded region is left out where the values need none of
//! it. What is left out there is zero on the whole side of the bound, so its derivative is zero too; where a number of 0
//! bounds nothing, a region is left out only if the number's derivative is 0 as well ([`Real::unless_zero`]).
//!
//! The solver stops after the steps that its settings say. Where it stops before its end, its result jumps a little here
//! and there, which a derivative does not see and a wide difference does: on replays with the preset `accurate` the two are
//! some percent apart. A line search can arrive at the same number by two ways whose derivatives have not both come to
//! their end; which way it takes is then a matter of rounding. In single precision that spoils the preset `converged`.
//!
//! One direction a number, and not several: with lanes, each lane takes a direction of its own, so that a whole vector
//! of them costs one dual step, and no lane is empty where a fit has one log.

use core::ops::{Add, Mul, Neg, Sub};

use crate::{Params, Real};

/// A value and its derivative along one direction.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Dual<T> {
    /// The number.
    pub value: T,
    /// Its derivative.
    pub tangent: T,
}

impl<T> Dual<T> {
    /// A number that changes by `tangent` for a unit along the direction.
    #[inline(always)]
    pub fn new(value: T, tangent: T) -> Self {
        Self { value, tangent }
    }
}

impl<T: Real> Dual<T> {
    /// The function with value `value` and derivative `slope` at this number.
    #[inline(always)]
    fn chain(self, value: T, slope: T) -> Self {
        Self { value, tangent: slope * self.tangent }
    }
}

impl<T: Real> Add for Dual<T> {
    type Output = Self;
    #[inline(always)]
    fn add(self, b: Self) -> Self {
        Self { value: self.value + b.value, tangent: self.tangent + b.tangent }
    }
}

impl<T: Real> Sub for Dual<T> {
    type Output = Self;
    #[inline(always)]
    fn sub(self, b: Self) -> Self {
        Self { value: self.value - b.value, tangent: self.tangent - b.tangent }
    }
}

impl<T: Real> Mul for Dual<T> {
    type Output = Self;
    #[inline(always)]
    fn mul(self, b: Self) -> Self {
        Self { value: self.value * b.value, tangent: self.tangent.fma(b.value, self.value * b.tangent) }
    }
}

impl<T: Real> Neg for Dual<T> {
    type Output = Self;
    #[inline(always)]
    fn neg(self) -> Self {
        Self { value: -self.value, tangent: -self.tangent }
    }
}

impl<T: Real> Real for Dual<T> {
    type K = T::K;
    type Guard = T::Guard;
    #[inline(always)]
    fn separate<P: crate::Part<A, R>, A, R>(arguments: A) -> R {
        T::separate::<P, A, R>(arguments)
    }
    #[inline(always)]
    fn constant(x: f64) -> T::K {
        T::constant(x)
    }
    #[inline(always)]
    fn k(x: T::K) -> Self {
        Self { value: T::k(x), tangent: T::zero() }
    }
    #[inline(always)]
    fn fma(self, b: Self, c: Self) -> Self {
        Self {
            value: self.value.fma(b.value, c.value),
            tangent: self.tangent.fma(b.value, self.value.fma(b.tangent, c.tangent)),
        }
    }
    #[inline(always)]
    fn fnma(self, b: Self, c: Self) -> Self {
        Self {
            value: self.value.fnma(b.value, c.value),
            tangent: self.tangent.fnma(b.value, self.value.fnma(b.tangent, c.tangent)),
        }
    }
    #[inline(always)]
    fn div(self, b: Self) -> Self {
        let value = self.value.div(b.value);
        // (a/b)′ = (a′ − (a/b) b′) / b: it takes the quotient that is there already.
        Self { value, tangent: value.fnma(b.tangent, self.tangent).div(b.value) }
    }
    /// At 0 the derivative counts as 0: the step takes roots of lengths whose direction is not asked for there.
    #[inline(always)]
    fn sqrt(self) -> Self {
        let (value, z) = (self.value.sqrt(), T::zero());
        // At 0 this is infinite or NaN; the selection below drops it.
        let slope = T::lit(0.5).div(value);
        self.chain(value, T::select_lt(z, value, slope, z))
    }
    #[inline(always)]
    fn min(self, b: Self) -> Self {
        // Where both are equal, the value and the derivative are those of `b`.
        let tangent = T::select_lt(self.value, b.value, self.tangent, b.tangent);
        Self { value: self.value.min(b.value), tangent }
    }
    #[inline(always)]
    fn max(self, b: Self) -> Self {
        // Where both are equal, the derivative is that of `b`, as in `min`.
        let tangent = T::select_lt(b.value, self.value, self.tangent, b.tangent);
        Self { value: self.value.max(b.value), tangent }
    }
    #[inline(always)]
    fn abs(self) -> Self {
        // At 0 the derivative is that of the positive side.
        let tangent = T::select_lt(self.value, T::zero(), -self.tangent, self.tangent);
        Self { value: self.value.abs(), tangent }
    }
    #[inline(always)]
    fn select_lt(a: Self, b: Self, x: Self, y: Self) -> Self {
        Self {
            value: T::select_lt(a.value, b.value, x.value, y.value),
            tangent: T::select_lt(a.value, b.value, x.tangent, y.tangent),
        }
    }
    #[inline(always)]
    fn sin_cos(self) -> (Self, Self) {
        let (sine, cosine) = self.value.sin_cos();
        (self.chain(sine, cosine), self.chain(cosine, -sine))
    }
    #[inline(always)]
    fn never() -> T::Guard {
        T::never()
    }
    #[inline(always)]
    fn unless_ge(self, b: Self) -> T::Guard {
        self.value.unless_ge(b.value)
    }
    #[inline(always)]
    fn unless_zero(self) -> T::Guard {
        // This sum is 0 only where the value and its derivative are both 0.
        (self.value.abs() + self.tangent.abs()).unless_zero()
    }
    #[inline(always)]
    fn enter(guard: T::Guard) -> bool {
        T::enter(guard)
    }
    #[inline(always)]
    fn leave(guard: T::Guard) {
        T::leave(guard);
    }
    #[inline(always)]
    fn merge(self, guard: T::Guard, before: Self) -> Self {
        Self {
            value: self.value.merge(guard, before.value),
            tangent: self.tangent.merge(guard, before.tangent),
        }
    }
    #[inline(always)]
    fn round(self) -> Self {
        Self { value: self.value.round(), tangent: T::zero() }
    }
    #[inline(always)]
    fn gather(table: &[T::K], index: Self) -> Self {
        Self { value: T::gather(table, index.value), tangent: T::zero() }
    }
    #[inline(always)]
    fn recip(self) -> Self {
        let value = self.value.recip();
        self.chain(value, -(value * value))
    }
    #[inline(always)]
    fn tanh(self) -> Self {
        let value = self.value.tanh();
        self.chain(value, value.fnma(value, T::lit(1.0)))
    }
}

impl<T: Real> Params<Dual<T>> {
    /// The robots of `values`, each number of which changes by that of `tangents` for a unit along the direction. Both are
    /// of the same model.
    pub fn along(values: &Params<T>, tangents: &Params<T>) -> Self {
        let mut all = Self::zeros(values.links.len(), values.joints.len(), values.pairs.len());
        // `zeros` makes no numbers of a free joint.
        all.free = vec![Dual::zero(); values.free.len()];
        let mut numbers = Vec::new();
        values.visit(|_, &number| numbers.push(number));
        let mut slopes = Vec::with_capacity(numbers.len());
        tangents.visit(|_, &number| slopes.push(number));
        // All visits go through the numbers in one order.
        let mut pairs = numbers.into_iter().zip(slopes);
        all.visit_mut(|_, number| {
            if let Some((value, tangent)) = pairs.next() {
                *number = Dual { value, tangent };
            }
        });
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn robots_along_a_direction_have_the_numbers_of_their_free_joint() {
        let mut values = Params::<f64>::zeros(1, 1, 1);
        values.free = vec![0.0; 2];
        let mut tangents = values.clone();
        let mut next = 0.0;
        for params in [&mut values, &mut tangents] {
            params.visit_mut(|_, number| {
                next += 1.0;
                *number = next;
            });
        }
        let mut wanted = Vec::new();
        values.visit(|slot, &value| wanted.push((slot, value)));
        let mut slopes = Vec::new();
        tangents.visit(|_, &tangent| slopes.push(tangent));
        let (mut found, mut found_slopes) = (Vec::new(), Vec::new());
        Params::along(&values, &tangents).visit(|slot, number| {
            found.push((slot, number.value));
            found_slopes.push(number.tangent);
        });
        assert_eq!((found, found_slopes), (wanted, slopes));
    }
}
