//! A function compiled for every set.

use crate::{Isa, current};

/// A function of the arguments `A` that is compiled for every set; made by [`kernels!`](crate::kernels). It is
/// `#[inline(always)]`, so that it is compiled with the features of its caller.
pub trait Kernel<A> {
    /// Runs it. `FUSED` says whether multiplications and additions may be fused: with AVX-512 and AVX2, which give the
    /// same bits.
    fn run<const FUSED: bool>(arguments: A);
}

/// Runs a kernel compiled for the set in use.
#[inline]
pub fn dispatch<K: Kernel<A>, A>(arguments: A) {
    #[cfg(target_arch = "x86_64")]
    {
        #[target_feature(enable = "avx512f,avx512dq,avx512vl,avx512bw,fma")]
        fn avx512<K: Kernel<A>, A>(arguments: A) {
            K::run::<true>(arguments);
        }
        #[target_feature(enable = "avx2,fma")]
        fn avx2<K: Kernel<A>, A>(arguments: A) {
            K::run::<true>(arguments);
        }
        let isa = current();
        if isa == Isa::Avx512 && isa.available() {
            // SAFETY: the features that the function is compiled for were detected.
            #[allow(unsafe_code, reason = "a function of a detected set is entered by an unsafe call")]
            return unsafe { avx512::<K, A>(arguments) };
        }
        if isa == Isa::Avx2 && isa.available() {
            // SAFETY: as above.
            #[allow(unsafe_code, reason = "a function of a detected set is entered by an unsafe call")]
            return unsafe { avx2::<K, A>(arguments) };
        }
    }
    // SSE2 has no fused multiply-add: it would be a slow call of a library.
    K::run::<false>(arguments);
}

/// Functions that are compiled for every instruction set; a call runs the one of the set in use. In a body `FUSED`
/// says whether multiplications and additions may be fused. A function may have one type parameter.
#[macro_export]
macro_rules! kernels {
    ($(
        $(#[$doc:meta])*
        $visibility:vis fn $name:ident $(<$scalar:ident: $bound:path>)? ($($argument:ident: $type:ty),* $(,)?) $body:block
    )*) => {$(
        $(#[$doc])*
        $visibility fn $name $(<$scalar: $bound>)? ($($argument: $type),*) {
            struct Body;
            impl $(<$scalar: $bound>)? $crate::Kernel<($($type,)*)> for Body {
                #[inline(always)]
                fn run<const FUSED: bool>(($($argument,)*): ($($type,)*)) $body
            }
            $crate::dispatch::<Body, _>(($($argument,)*))
        }
    )*};
}

#[cfg(test)]
mod tests {
    use crate::{Isa, with_isa};

    kernels! {
        /// Adds what tells whether it is fused.
        fn mark(marks: &mut Vec<bool>) {
            marks.push(FUSED);
        }

        fn add<T: std::ops::AddAssign<f32>>(all: &mut [T], term: f32) {
            for one in all {
                *one += term;
            }
        }
    }

    #[test]
    fn every_set_runs_its_own_version() {
        let mut marks = Vec::new();
        for isa in Isa::found() {
            let ran = with_isa(isa, || {
                mark(&mut marks);
                let mut numbers = [1.0, 2.0, 3.0];
                add(&mut numbers, 2.0);
                assert_eq!(numbers, [3.0, 4.0, 5.0]);
            });
            assert_eq!(ran, Ok(()));
        }
        let fused: Vec<bool> = Isa::found().map(|isa| isa != Isa::Portable).collect();
        assert_eq!(marks, fused);
    }
}
