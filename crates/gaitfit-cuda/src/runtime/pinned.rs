//! Page-locked memory of the host.

use std::ffi::c_void;
use std::ops::{Deref, DerefMut};
use std::ptr::{NonNull, null_mut};
use std::sync::Arc;

use super::device::Context;
use super::error::CudaError;
use super::memory::Number;
use super::stream::Stream;

/// Numbers in page-locked memory of the host. A GPU copies them several times as fast as numbers in other memory.
pub struct Pinned<T> {
    context: Arc<Context>,
    first: NonNull<T>,
    length: usize,
}

// SAFETY: it owns its numbers, and the driver frees them from any thread.
unsafe impl<T: Send> Send for Pinned<T> {}
// SAFETY: a shared one only lends its numbers.
unsafe impl<T: Sync> Sync for Pinned<T> {}

impl<T: Number> Pinned<T> {
    /// Room for `length` numbers, all bits 0, to copy to on `stream`. A length of 0 allocates nothing.
    ///
    /// # Errors
    /// [`CudaError::Call`] if the system has no such memory left.
    pub fn new(stream: &Stream, length: usize) -> Result<Self, CudaError> {
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
}

impl<T: Number> Deref for Pinned<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        // SAFETY: `length` numbers, written by `new`, live as long as this; any bits are a number.
        unsafe { std::slice::from_raw_parts(self.first.as_ptr(), self.length) }
    }
}

impl<T: Number> DerefMut for Pinned<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        // SAFETY: as above, and nobody else has them.
        unsafe { std::slice::from_raw_parts_mut(self.first.as_ptr(), self.length) }
    }
}

impl<T> Drop for Pinned<T> {
    fn drop(&mut self) {
        if self.length > 0 && self.context.enter().is_ok() {
            // SAFETY: allocated by `new` and freed once. Copies to it have ended: `Buffer` waits for its copies.
            unsafe { (self.context.driver.free_host)(self.first.as_ptr().cast::<c_void>()) };
        }
    }
}
