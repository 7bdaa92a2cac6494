//! Parts of the step that stay functions of their own.
//!
//! Everything else is inlined into one function for each scalar. The compiler's time grows faster than a function's
//! length, so large parts, parts that are called from several places and parts that few robots need are kept apart.

/// The body of a separate function with the arguments `A` and the result `R`; made by `separate!`.
pub trait Part<A, R> {
    /// Runs it. It is `#[inline(always)]`, so that it is compiled with the features of its caller.
    fn run(arguments: A) -> R;
}

/// A function over `T: Real` that is compiled once for each scalar, with the vector instructions of that scalar
/// ([`Real::separate`](crate::Real::separate)).
macro_rules! separate {
    (@result $result:ty) => { $result };
    (@result) => { () };
    (
        $(#[$doc:meta])*
        $visibility:vis fn $name:ident<$scalar:ident>($($argument:ident: $type:ty),* $(,)?) $(-> $result:ty)? $body:block
    ) => {
        $(#[$doc])*
        #[inline(always)]
        $visibility fn $name<$scalar: crate::Real>($($argument: $type),*) $(-> $result)? {
            struct Body;
            impl<$scalar: crate::Real> crate::separate::Part<($($type,)*), crate::separate::separate!(@result $($result)?)> for Body {
                #[inline(always)]
                fn run(($($argument,)*): ($($type,)*)) $(-> $result)? $body
            }
            $scalar::separate::<Body, _, _>(($($argument,)*))
        }
    };
}
pub(crate) use separate;
