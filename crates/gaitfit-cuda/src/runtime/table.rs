//! A table of functions read from a library that is loaded when the program runs.

/// Declares a struct of function pointers and `load`, which reads them from a library by name.
macro_rules! functions {
    ($(#[$doc:meta])* $name:ident { $($field:ident = $symbol:literal ($($argument:ty),* $(,)?);)* }) => {
        $(#[$doc])*
        pub(super) struct $name {
            $(pub(super) $field: unsafe extern "system" fn($($argument),*) -> std::ffi::c_int,)*
            /// Kept loaded as long as the pointers are.
            _library: libloading::Library,
        }

        impl $name {
            /// Reads every function; the first missing one's name if one is missing.
            fn load(library: libloading::Library) -> Result<Self, &'static str> {
                $(
                    // SAFETY: the library is NVIDIA's, and each function has the C signature that its header declares.
                    let $field = unsafe {
                        *library
                            .get::<unsafe extern "system" fn($($argument),*) -> std::ffi::c_int>($symbol)
                            .map_err(|_| $symbol)?
                    };
                )*
                Ok(Self { $($field,)* _library: library })
            }
        }
    };
}

pub(super) use functions;
