//! What the vector types of x86-64 share.

/// An intrinsic of the type's instruction set. Values are only worked on inside functions that were entered
/// after the set was found on the machine (see [`super::Lanes::control_period`]).
macro_rules! intrinsic {
    ($e:expr) => {
        // SAFETY: register arithmetic without memory access; the set is present, see above.
        unsafe { $e }
    };
}
pub(super) use intrinsic;

/// A lane type over one register: operators from the named intrinsics, and the methods of
/// [`crate::Real`] and [`super::Lanes`] that differ from set to set as they are given.
macro_rules! lane_type {
    (
        $(#[$doc:meta])*
        $name:ident($register:ty) of $lanes:literal:
        $add:ident $sub:ident $mul:ident $div:ident $sqrt:ident $min:ident $max:ident
        $xor:ident $andnot:ident $set1:ident;
        Real { $($real:tt)* }
        Lanes { $($operations:tt)* }
    ) => {
        $(#[$doc])*
        #[derive(Clone, Copy, Debug)]
        #[repr(transparent)]
        pub struct $name($register);

        impl core::ops::Add for $name {
            type Output = Self;
            #[inline(always)]
            fn add(self, b: Self) -> Self {
                Self(intrinsic!($add(self.0, b.0)))
            }
        }
        impl core::ops::Sub for $name {
            type Output = Self;
            #[inline(always)]
            fn sub(self, b: Self) -> Self {
                Self(intrinsic!($sub(self.0, b.0)))
            }
        }
        impl core::ops::Mul for $name {
            type Output = Self;
            #[inline(always)]
            fn mul(self, b: Self) -> Self {
                Self(intrinsic!($mul(self.0, b.0)))
            }
        }
        impl core::ops::Neg for $name {
            type Output = Self;
            #[inline(always)]
            fn neg(self) -> Self {
                Self(intrinsic!($xor(self.0, $set1(-0.0))))
            }
        }

        impl crate::Real for $name {
            type K = f32;
            #[inline(always)]
            fn constant(x: f64) -> f32 {
                x as f32
            }
            #[inline(always)]
            fn k(x: f32) -> Self {
                Self(intrinsic!($set1(x)))
            }
            #[inline(always)]
            fn div(self, b: Self) -> Self {
                Self(intrinsic!($div(self.0, b.0)))
            }
            #[inline(always)]
            fn sqrt(self) -> Self {
                Self(intrinsic!($sqrt(self.0)))
            }
            #[inline(always)]
            fn min(self, b: Self) -> Self {
                Self(intrinsic!($min(self.0, b.0)))
            }
            #[inline(always)]
            fn max(self, b: Self) -> Self {
                Self(intrinsic!($max(self.0, b.0)))
            }
            #[inline(always)]
            fn abs(self) -> Self {
                Self(intrinsic!($andnot($set1(-0.0), self.0)))
            }
            #[inline(always)]
            fn round(self) -> Self {
                round(self)
            }
            // One load a lane: gathering instructions would need addresses that are known to be good.
            #[inline(always)]
            fn gather(table: &[f32], index: Self) -> Self {
                let mut numbers = [0.0; $lanes];
                super::Lanes::store(index, &mut numbers);
                let mut lane = 0;
                while lane < $lanes {
                    numbers[lane] = table.get(numbers[lane] as usize).copied().unwrap_or(0.0);
                    lane += 1;
                }
                super::Lanes::load(&numbers)
            }
            $($real)*
        }

        impl super::Lanes for $name {
            const LANES: usize = $lanes;
            // Not by intrinsics: outside of `control_period` each would be a call.
            #[inline(always)]
            fn load(x: &[f32]) -> Self {
                let mut numbers = [0.0; $lanes];
                numbers.copy_from_slice(&x[..$lanes]);
                // SAFETY: the register is as many numbers of 32 bits, any of which are valid.
                Self(unsafe { core::mem::transmute::<[f32; $lanes], $register>(numbers) })
            }
            #[inline(always)]
            fn store(self, x: &mut [f32]) {
                // SAFETY: as above.
                let numbers = unsafe { core::mem::transmute::<$register, [f32; $lanes]>(self.0) };
                x[..$lanes].copy_from_slice(&numbers);
            }
            $($operations)*
        }
    };
}
pub(super) use lane_type;

/// `compiled`, the control period of `$name` compiled with these features, and with derivatives. `$words`: the set in messages.
macro_rules! compiled_for {
    ($name:ident, $features:literal, $isa:ident, $words:literal) => {
        impl super::Differentiable for $name {
            fn period_along(period: &mut Period<'_, crate::Dual<Self>>) {
                compiled(period);
            }
        }

        fn compiled<T: crate::Real>(period: &mut Period<'_, T>) {
            #[target_feature(enable = $features)]
            fn run<T: crate::Real>(period: &mut Period<'_, T>) {
                crate::control_period(period);
            }
            let is_there = crate::Isa::$isa.available();
            assert!(is_there, concat!("this machine has no ", $words, "; ask `Isa::available` first"));
            // SAFETY: the set has just been found on the machine.
            unsafe { run(period) }
        }
    };
}
pub(super) use compiled_for;
