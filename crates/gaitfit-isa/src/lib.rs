//! The instruction set a program uses, and functions compiled for each.
//!
//! The set is chosen once for the whole program: by [`select`], else by the variable `GAITFIT_ISA`, else the best that
//! the machine has. [`kernels!`] compiles a function for every set and calls the one chosen. [`with_isa`] lets a test
//! compare the sets on one machine.
//!
//! ```
//! gaitfit_isa::kernels! {
//!     /// sums += terms
//!     fn add(sums: &mut [f32], terms: &[f32]) {
//!         for (sum, term) in sums.iter_mut().zip(terms) {
//!             *sum += term;
//!         }
//!     }
//! }
//! let mut sums = [1.0, 2.0];
//! add(&mut sums, &[3.0, 4.0]);
//! assert_eq!(sums, [4.0, 6.0]);
//! ```

mod kernel;
mod select;

pub use kernel::{Kernel, dispatch};
pub use select::{VARIABLE, current, select, selected, with_isa};

/// An instruction set that code is compiled for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Isa {
    /// AVX-512: vectors of 16 `f32`.
    Avx512,
    /// AVX2 with fused multiply-add: vectors of 8 `f32`.
    Avx2,
    /// Vectors of 4 `f32`, which every machine of the architecture has: SSE2 on x86-64, NEON on 64-bit Arm.
    Portable,
}

impl Isa {
    /// Every set, the best first.
    pub const ALL: [Self; 3] = [Self::Avx512, Self::Avx2, Self::Portable];

    /// The sets of this machine, the best first.
    pub fn found() -> impl Iterator<Item = Self> {
        Self::ALL.into_iter().filter(|isa| isa.available())
    }

    /// The best set of this machine.
    pub fn best() -> Self {
        Self::found().next().unwrap_or(Self::Portable)
    }

    /// Whether this machine has it.
    pub fn available(self) -> bool {
        match self {
            #[cfg(target_arch = "x86_64")]
            Isa::Avx512 => {
                is_x86_feature_detected!("avx512f")
                    && is_x86_feature_detected!("avx512dq")
                    && is_x86_feature_detected!("avx512vl")
                    && is_x86_feature_detected!("avx512bw")
                    && is_x86_feature_detected!("fma")
            }
            #[cfg(target_arch = "x86_64")]
            Isa::Avx2 => is_x86_feature_detected!("avx2") && is_x86_feature_detected!("fma"),
            #[cfg(not(target_arch = "x86_64"))]
            Isa::Avx512 | Isa::Avx2 => false,
            Isa::Portable => true,
        }
    }

    /// Returns the same set, if this machine has it.
    ///
    /// # Errors
    /// [`IsaError::Missing`] names the sets that it has.
    pub fn checked(self) -> Result<Self, IsaError> {
        if self.available() {
            Ok(self)
        } else {
            Err(IsaError::Missing { isa: self.name(), found: names(Self::found()) })
        }
    }

    /// `f32` in one vector: environments that one step of the physics advances.
    pub fn lanes(self) -> usize {
        match self {
            Isa::Avx512 => 16,
            Isa::Avx2 => 8,
            Isa::Portable => 4,
        }
    }

    /// Its name on the command line.
    pub fn name(self) -> &'static str {
        match self {
            Isa::Avx512 => "avx512",
            Isa::Avx2 => "avx2",
            Isa::Portable => "portable",
        }
    }
}

impl std::str::FromStr for Isa {
    type Err = IsaError;
    fn from_str(text: &str) -> Result<Self, IsaError> {
        let unknown = || IsaError::Unknown { text: text.chars().take(40).collect(), known: names(Self::ALL) };
        Self::ALL.into_iter().find(|isa| isa.name() == text).ok_or_else(unknown)
    }
}

fn names(all: impl IntoIterator<Item = Isa>) -> String {
    all.into_iter().map(Isa::name).collect::<Vec<_>>().join(", ")
}

/// The reason why an instruction set cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum IsaError {
    /// No set has this name.
    #[error("unknown instruction set {text:?}; use one of {known}")]
    Unknown {
        /// The name, cut to 40 characters.
        text: String,
        /// The names there are.
        known: String,
    },
    /// The machine lacks it.
    #[error("this machine has no {isa}; it has {found}")]
    Missing {
        /// Name of the set.
        isa: &'static str,
        /// Names of those it has.
        found: String,
    },
    /// It was chosen after another was used.
    #[error("{wanted} cannot be selected, as {used} is in use; select it before anything is computed")]
    InUse {
        /// Name of the set that was to be selected.
        wanted: &'static str,
        /// Name of the set in use.
        used: &'static str,
    },
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn names_are_read_back() {
        for isa in Isa::ALL {
            assert_eq!(isa.name().parse(), Ok(isa));
        }
        let message = "sse9".parse::<Isa>().unwrap_err().to_string();
        assert!(message.contains("sse9") && message.contains("avx512, avx2, portable"), "{message}");
    }

    #[test]
    fn a_set_is_there_or_refused_with_those_that_are() {
        assert!(Isa::Portable.available());
        for isa in Isa::ALL {
            match isa.checked() {
                Ok(same) => assert!(same == isa && isa.available()),
                Err(error) => {
                    assert!(!isa.available());
                    let message = error.to_string();
                    assert!(message.contains(isa.name()) && message.contains("it has"), "{message}");
                    assert!(message.contains("portable"), "{message}");
                }
            }
        }
    }
}
