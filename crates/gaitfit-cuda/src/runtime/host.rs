//! Memory of the host that a GPU copies to.

use std::ffi::c_void;
use std::ops::{Deref, DerefMut};
use std::ptr::{NonNull, null_mut};
use std::sync::Arc;

use super::device::Context;
use super::error::CudaError;
use super::memory::Number;
use super::stream::Stream;

/// Numbers on the host, in page-locked memory if the system has some left. Copies from a GPU to it are several times as fast as
/// to other memory.
#[derive(Default)]
pub struct HostBuffer<T>(Memory<T>);

enum Memory<T> {
    Locked(Locked<T>),
    Ordinary(Vec<T>),
}

impl<T> Default for Memory<T> {
    fn default() -> Self {
        Self::Ordinary(Vec::new())
    }
}

impl<T: Number> HostBuffer<T> {
    /// Makes room for `length` numbers, for copies on `stream`. If there is not enough yet, all numbers are 0 afterwards.
    pub fn reserve(&mut self, stream: &Stream, length: usize) {
        if self.len() >= length {
            return;
        }
        // Freed first: the system may not have room for both.
        *self = Self(Memory::default());
        self.0 = match Locked::new(stream, length) {
            Ok(locked) => Memory::Locked(locked),
            Err(_) => Memory::Ordinary(vec![T::default(); length]),
        };
    }
}

impl<T: Number> Deref for HostBuffer<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        match &self.0 {
            Memory::Locked(locked) => locked.numbers(),
            Memory::Ordinary(numbers) => numbers,
        }
    }
}

impl<T: Number> DerefMut for HostBuffer<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        match &mut self.0 {
            Memory::Locked(locked) => locked.numbers_mut(),
            Memory::Ordinary(numbers) => numbers,
        }
    }
}

/// Numbers in page-locked memory.
struct Locked<T> {
    context: Arc<Context>,
    first: NonNull<T>,
    length: usize,
}

// SAFETY: it owns its numbers, and the driver frees them from any thread.
unsafe impl<T: Send> Send for Locked<T> {}
// SAFETY: a shared one only lends its numbers.
unsafe impl<T: Sync> Sync for Locked<T> {}

impl<T: Number> Locked<T> {
    /// Room for `length` numbers, all bits 0, for the stream's GPU. A length of 0 allocates nothing.
    ///
    /// # Errors
    /// [`CudaError::Call`] if the system has no such memory left.
    fn new(stream: &Stream, length: usize) -> Result<Self, CudaError> {
        let context = stream.context.clone();
        let bytes = length.saturating_mul(size_of::<T>());
        let mut first = null_mut::<c_void>();
        if bytes > 0 {
            context.enter()?;
            // SAFETY: the driver stores one address of the host.
            let code = unsafe { (context.driver.allocate_host)(&raw mut first, bytes) };
            context
                .driver
                .check(code, || format!("allocating {bytes} bytes of the host's page-locked memory"))?;
        }
        let Some(first) = NonNull::new(first.cast::<T>()) else {
            return Ok(Self { context, first: NonNull::dangling(), length: 0 });
        };
        // SAFETY: the driver allocated that many bytes, aligned to a page.
        unsafe { first.write_bytes(0, length) };
        Ok(Self { context, first, length })
    }

    fn numbers(&self) -> &[T] {
        // SAFETY: `length` numbers, written by `new`, live as long as this; any bits are a number.
        unsafe { std::slice::from_raw_parts(self.first.as_ptr(), self.length) }
    }

    fn numbers_mut(&mut self) -> &mut [T] {
        // SAFETY: as above, and nobody else has them.
        unsafe { std::slice::from_raw_parts_mut(self.first.as_ptr(), self.length) }
    }
}

impl<T> Drop for Locked<T> {
    fn drop(&mut self) {
        if self.length > 0 && self.context.enter().is_ok() {
            // SAFETY: allocated by `new` and freed once. Copies to it have ended: `Buffer` waits for its copies.
            unsafe { (self.context.driver.free_host)(self.first.as_ptr().cast::<c_void>()) };
        }
    }
}
