//! Programs that are compiled on threads of their own before they are needed. A robot's programs take some seconds each, and
//! the compiler works on several at a time.

use std::collections::HashMap;
use std::sync::{Arc, LazyLock, Mutex, MutexGuard, OnceLock, PoisonError};
use std::thread::JoinHandle;

use super::cache::Cache;
use super::compile::{Compiled, Program, identity, make};
use super::error::CudaError;
use super::nvrtc::Nvrtc;

type Pending = Arc<OnceLock<Result<Compiled, CudaError>>>;

/// Programs that some thread is compiling, or has compiled for another, by their keys in the cache.
static PENDING: LazyLock<Mutex<HashMap<String, Pending>>> = LazyLock::new(Mutex::default);

fn pending() -> MutexGuard<'static, HashMap<String, Pending>> {
    PENDING.lock().unwrap_or_else(PoisonError::into_inner)
}

/// Returns the program that `make` compiles. Threads that ask for the same key at the same time wait for one of them.
pub(super) fn once(
    key: &str,
    make: impl FnOnce() -> Result<Compiled, CudaError>,
) -> Result<Compiled, CudaError> {
    let entry = pending().entry(key.to_owned()).or_default().clone();
    let made = entry.get_or_init(make).clone();
    forget(key, &entry);
    made
}

fn forget(key: &str, entry: &Pending) {
    let mut pending = pending();
    if pending.get(key).is_some_and(|now| Arc::ptr_eq(now, entry)) {
        pending.remove(key);
    }
}

/// Programs that are being compiled. Dropping it waits for the compiler: a program must not end while that works.
#[must_use = "dropping it waits for the compiler"]
#[derive(Default)]
pub struct Ahead(Vec<(String, Pending, JoinHandle<()>)>);

impl Ahead {
    /// Begins to compile `programs` for a GPU of this compute capability. What fails is reported by whoever loads the program.
    pub(super) fn new(programs: impl IntoIterator<Item = Program>, capability: (i32, i32)) -> Self {
        let Ok(nvrtc) = Nvrtc::get() else { return Self::default() };
        let begin = |program: Program| {
            let (key, architecture) = identity(nvrtc, &program, capability).ok()?;
            let entry = pending().entry(key.clone()).or_default().clone();
            let (made, name) = (Arc::clone(&entry), key.clone());
            let work = move || {
                let cache = Cache::of_user();
                made.get_or_init(|| make(nvrtc, &program, (&name, &architecture), cache.as_ref()));
            };
            let thread = std::thread::Builder::new().name("nvrtc".into()).spawn(work).ok()?;
            Some((key, entry, thread))
        };
        Self(programs.into_iter().filter_map(begin).collect())
    }
}

impl Drop for Ahead {
    fn drop(&mut self) {
        for (key, entry, thread) in self.0.drain(..) {
            let _ = thread.join();
            forget(&key, &entry);
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::runtime::Image;

    #[test]
    fn what_was_compiled_ahead_is_used_once() {
        let compiled = Compiled { image: Image { code: vec![1, 2], log: String::new() }, cached: false };
        let entry = pending().entry("ahead".to_owned()).or_default().clone();
        entry.get_or_init(|| Ok(compiled.clone()));
        assert_eq!(once("ahead", || unreachable!("it is compiled")), Ok(compiled.clone()));
        // Then it is forgotten: the cache on disk has it.
        let other = Compiled { cached: true, ..compiled };
        assert_eq!(once("ahead", || Ok(other.clone())), Ok(other));
        assert!(!pending().contains_key("ahead"));
    }
}
