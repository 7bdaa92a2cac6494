//! The choice of the set, once a program.

use std::cell::Cell;
use std::sync::OnceLock;

use crate::{Isa, IsaError};

/// Name of the variable that chooses the set.
pub const VARIABLE: &str = "GAITFIT_ISA";

/// The set of the program, or why there is none: chosen once, because results of two sets may differ in the last bits.
static SELECTED: OnceLock<Result<Isa, IsaError>> = OnceLock::new();

thread_local! {
    /// The set of this thread, which [`with_isa`] chooses instead.
    static THREAD_CHOICE: Cell<Option<Isa>> = const { Cell::new(None) };
}

/// Chooses the set for the whole program, before it is first used.
///
/// # Errors
/// A set that this machine lacks; another set in use already.
pub fn select(isa: Isa) -> Result<(), IsaError> {
    let isa = isa.checked()?;
    match SELECTED.get_or_init(|| Ok(isa)) {
        Ok(used) if *used != isa => Err(IsaError::InUse { wanted: isa.name(), used: used.name() }),
        Ok(_) => Ok(()),
        Err(error) => Err(error.clone()),
    }
}

/// The set in use.
///
/// # Errors
/// The variable names no set, or one that this machine lacks.
pub fn selected() -> Result<Isa, IsaError> {
    match THREAD_CHOICE.get() {
        Some(own) => Ok(own),
        None => chosen().clone(),
    }
}

/// The set in use, for functions that cannot fail: where [`selected`] does, the best.
pub fn current() -> Isa {
    THREAD_CHOICE.get().or_else(|| chosen().as_ref().ok().copied()).unwrap_or_else(Isa::best)
}

fn chosen() -> &'static Result<Isa, IsaError> {
    SELECTED.get_or_init(|| from_variable(std::env::var_os(VARIABLE)))
}

/// Returns the set that the variable's value names.
fn from_variable(value: Option<std::ffi::OsString>) -> Result<Isa, IsaError> {
    match value {
        Some(value) if !value.is_empty() => value.to_string_lossy().parse::<Isa>()?.checked(),
        _ => Ok(Isa::best()),
    }
}

/// Runs `function` with another set on this thread, for tests that compare sets. Threads that `function` starts are
/// not concerned.
///
/// # Errors
/// A set that this machine lacks.
pub fn with_isa<R>(isa: Isa, function: impl FnOnce() -> R) -> Result<R, IsaError> {
    /// Puts the old set back, also when `function` panics.
    struct Back(Option<Isa>);
    impl Drop for Back {
        fn drop(&mut self) {
            THREAD_CHOICE.set(self.0);
        }
    }
    let _back = Back(THREAD_CHOICE.replace(Some(isa.checked()?)));
    Ok(function())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn the_variable_chooses() {
        assert_eq!(from_variable(None), Ok(Isa::best()));
        assert_eq!(from_variable(Some("".into())), Ok(Isa::best()));
        assert_eq!(from_variable(Some("portable".into())), Ok(Isa::Portable));
        assert!(matches!(from_variable(Some("mmx".into())), Err(IsaError::Unknown { .. })));
        for isa in Isa::ALL {
            assert_eq!(from_variable(Some(isa.name().into())), isa.checked());
        }
    }

    #[test]
    fn a_choice_comes_before_use() {
        let used = selected().unwrap();
        assert_eq!(select(used), Ok(()));
        for other in Isa::found().filter(|isa| *isa != used) {
            assert!(matches!(select(other), Err(IsaError::InUse { .. })));
        }
        assert_eq!(current(), used);
    }

    #[test]
    fn a_thread_can_have_its_own() {
        let before = current();
        for isa in Isa::found() {
            assert_eq!(with_isa(isa, || (current(), selected())), Ok((isa, Ok(isa))));
        }
        assert_eq!(current(), before);
    }
}
