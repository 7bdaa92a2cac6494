//! Code compiled for several instruction sets, the best of them chosen at run time.

/// Numbers of an `f32` vector of AVX-512: columns of matrices are padded to a multiple of it.
pub(crate) const LANES: usize = 16;

/// Columns of a panel, as [`dispatched`] hands them to the code it chooses: on AVX-512 four vectors, so that with six
/// rows twenty-four registers add up; elsewhere one [`LANES`], two vectors of AVX2.
pub(crate) fn panel() -> usize {
    if has_avx512() { 4 * LANES } else { LANES }
}

/// From row to row of a matrix of `columns` columns that a product reads: padded to whole [`LANES`], and an odd number
/// of them, so that rows one below the other do not all fall into the same few sets of the first-level cache.
pub(crate) fn stride(columns: usize) -> usize {
    (columns.div_ceil(LANES) | 1) * LANES
}

/// Whether the processor has AVX-512 as the code compiled for it needs it.
pub(crate) fn has_avx512() -> bool {
    #[cfg(target_arch = "x86_64")]
    return is_x86_feature_detected!("avx512f")
        && is_x86_feature_detected!("avx512dq")
        && is_x86_feature_detected!("avx512vl")
        && is_x86_feature_detected!("fma");
    #[cfg(not(target_arch = "x86_64"))]
    false
}

/// Whether the processor has AVX2 and fused multiplication and addition.
#[cfg(target_arch = "x86_64")]
pub(crate) fn has_avx2() -> bool {
    is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma")
}

/// Compiles the body of each function three times (AVX-512, AVX2 with FMA, the target's baseline) and calls the best
/// that the processor has. `FUSED` tells the body whether it may fuse multiplication and addition, `PANEL` is
/// [`panel`]: the first two return the same bits, the baseline others in the last place.
macro_rules! dispatched {
    ($($(#[$doc:meta])* fn $name:ident($($argument:ident: $type:ty),* $(,)?) $body:block)*) => {$(
        $(#[$doc])*
        pub(crate) fn $name<T: Scalar>($($argument: $type),*) {
            #[inline(always)]
            fn body<T: Scalar, const FUSED: bool, const PANEL: usize>($($argument: $type),*) $body
            #[cfg(target_arch = "x86_64")]
            {
                #[target_feature(enable = "avx512f,avx512dq,avx512vl,fma")]
                fn avx512<T: Scalar>($($argument: $type),*) {
                    body::<T, true, { 4 * crate::network::dispatch::LANES }>($($argument),*);
                }
                #[target_feature(enable = "avx2,fma")]
                fn avx2<T: Scalar>($($argument: $type),*) {
                    body::<T, true, { crate::network::dispatch::LANES }>($($argument),*);
                }
                if crate::network::dispatch::has_avx512() {
                    // SAFETY: the four features that the function is compiled for were detected.
                    return unsafe { avx512($($argument),*) };
                }
                if crate::network::dispatch::has_avx2() {
                    // SAFETY: as above.
                    return unsafe { avx2($($argument),*) };
                }
            }
            body::<T, { cfg!(target_arch = "aarch64") }, { crate::network::dispatch::LANES }>($($argument),*);
        }
    )*};
}
pub(crate) use dispatched;
