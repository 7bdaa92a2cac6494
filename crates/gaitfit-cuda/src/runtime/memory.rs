//! Arrays in the GPU's memory.

use std::ffi::c_void;
use std::marker::PhantomData;
use std::sync::Arc;

use super::device::{Context, Device};
use super::driver::Address;
use super::error::CudaError;
use super::stream::Stream;

/// Numbers that may lie in a GPU's memory: any bits of their size are one.
pub trait Number: sealed::Sealed + Copy + Default + Send + Sync + 'static {}

mod sealed {
    pub trait Sealed {}
}

macro_rules! numbers {
    ($($type:ty),*) => { $(impl sealed::Sealed for $type {} impl Number for $type {})* };
}
numbers!(u8, i8, u16, i16, u32, i32, u64, i64, f32, f64);

/// Bytes that the driver and the programs need besides arrays.
const RESERVE: u64 = 64 << 20;

/// Refuses parts that together exceed what is free, but for a reserve.
pub(super) fn check(parts: &[(&str, u64)], ordinal: usize, free: u64, total: u64) -> Result<(), CudaError> {
    let needed = parts.iter().fold(0u64, |sum, (_, bytes)| sum.saturating_add(*bytes));
    let free = free.saturating_sub(RESERVE);
    if needed <= free {
        return Ok(());
    }
    let mut largest = parts.to_vec();
    largest.sort_by_key(|(_, bytes)| std::cmp::Reverse(*bytes));
    let names: Vec<&str> = largest.iter().take(3).map(|(name, _)| *name).collect();
    Err(CudaError::Memory { what: names.join(", "), ordinal, needed, free, total })
}

/// An array of numbers in a GPU's memory, freed with this.
pub struct Buffer<T> {
    context: Arc<Context>,
    name: String,
    pub(super) address: Address,
    length: usize,
    number: PhantomData<T>,
}

impl<T: Number> Buffer<T> {
    /// Room for `length` numbers, all bits 0. `name` is for messages. A length of 0 allocates nothing.
    ///
    /// # Errors
    /// [`CudaError::Memory`] if it does not fit.
    pub fn new(device: &Device, name: &str, length: usize) -> Result<Self, CudaError> {
        let context = device.context.clone();
        let mut buffer = Self { context, name: name.to_owned(), address: 0, length, number: PhantomData };
        let bytes = length.saturating_mul(size_of::<T>());
        if bytes == 0 {
            return Ok(buffer);
        }
        device.check_room(&[(name, bytes as u64)])?;
        let driver = buffer.context.driver;
        let mut address = 0;
        // SAFETY: the driver stores one address; `check_room` made the context the thread's own.
        let code = unsafe { (driver.allocate)(&raw mut address, bytes) };
        driver.check(code, || format!("allocating `{name}`"))?;
        buffer.address = address;
        let stream = Stream::new(device)?;
        buffer.clear(&stream)?;
        // Another stream may write the buffer at once, and must not be overtaken by the zeros.
        stream.wait()?;
        Ok(buffer)
    }

    /// A copy of `numbers`.
    ///
    /// # Errors
    /// As [`Buffer::new`].
    pub fn from_slice(device: &Device, name: &str, numbers: &[T]) -> Result<Self, CudaError> {
        let buffer = Self::new(device, name, numbers.len())?;
        let stream = Stream::new(device)?;
        buffer.write(&stream, numbers)?;
        Ok(buffer)
    }

    /// Address of its first number in the GPU's memory; 0 if it holds none.
    pub fn address(&self) -> u64 {
        self.address
    }

    /// Its name in messages.
    pub fn name(&self) -> &str {
        &self.name
    }

    /// Numbers in it.
    pub fn len(&self) -> usize {
        self.length
    }

    /// Whether it holds none.
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Bytes that it takes.
    pub fn bytes(&self) -> usize {
        self.length * size_of::<T>()
    }

    fn expect(&self, found: usize) -> Result<(), CudaError> {
        if found == self.length {
            return Ok(());
        }
        Err(CudaError::Length { buffer: self.name.clone(), expected: self.length, found })
    }

    /// Sets all bits to 0, in the stream's order.
    ///
    /// # Errors
    /// [`CudaError::Call`].
    pub fn clear(&mut self, stream: &Stream) -> Result<(), CudaError> {
        if self.length == 0 {
            return Ok(());
        }
        self.context.enter()?;
        // SAFETY: the array has that many bytes and lives at least until the driver frees it, which waits for the GPU.
        let code =
            unsafe { (self.context.driver.fill_bytes)(self.address, 0, self.bytes(), stream.handle()) };
        self.context.driver.check(code, || format!("clearing `{}`", self.name))
    }

    /// Copies `numbers` in, after what the stream has to do; returns when they are there. Whoever reads the array on another
    /// stream waits for that by its own means.
    ///
    /// # Errors
    /// [`CudaError::Length`], or a failure of the GPU.
    pub fn write(&self, stream: &Stream, numbers: &[T]) -> Result<(), CudaError> {
        self.expect(numbers.len())?;
        if self.length == 0 {
            return Ok(());
        }
        self.context.enter()?;
        let from = numbers.as_ptr().cast::<c_void>();
        // SAFETY: both arrays have that many bytes; `numbers` is borrowed until the wait below is over.
        let code =
            unsafe { (self.context.driver.copy_in)(self.address, from, self.bytes(), stream.handle()) };
        let copied = self.context.driver.check(code, || format!("copying into `{}`", self.name));
        stream.wait()?;
        copied
    }

    /// Copies all numbers out, after what the stream has to do.
    ///
    /// # Errors
    /// A failure of the GPU, of this copy or of the stream's earlier work.
    pub fn read(&self, stream: &Stream) -> Result<Vec<T>, CudaError> {
        let mut numbers = vec![T::default(); self.length];
        self.read_into(stream, &mut numbers)?;
        Ok(numbers)
    }

    /// As [`Buffer::read`], into memory that is there already.
    ///
    /// # Errors
    /// As there, or [`CudaError::Length`].
    pub fn read_into(&self, stream: &Stream, numbers: &mut [T]) -> Result<(), CudaError> {
        self.expect(numbers.len())?;
        self.read_beginning(stream, numbers)
    }

    /// As [`Buffer::read_into`], but only as many numbers as there is room for.
    ///
    /// # Errors
    /// As [`Buffer::read`], or [`CudaError::Length`] if there are fewer.
    pub fn read_first(&self, stream: &Stream, numbers: &mut [T]) -> Result<(), CudaError> {
        if numbers.len() > self.length {
            self.expect(numbers.len())?;
        }
        self.read_beginning(stream, numbers)
    }

    /// Fills `numbers` from the beginning of the buffer. `numbers` is not longer than the buffer.
    fn read_beginning(&self, stream: &Stream, numbers: &mut [T]) -> Result<(), CudaError> {
        if numbers.is_empty() {
            return stream.wait();
        }
        let bytes = size_of_val(numbers).min(self.bytes());
        // The stream's earlier work first: its failures name their kernels.
        stream.wait()?;
        self.context.enter()?;
        let to = numbers.as_mut_ptr().cast::<c_void>();
        // SAFETY: both arrays have that many bytes, any bits are a number, and the wait ends the copy.
        let code = unsafe { (self.context.driver.copy_out)(to, self.address, bytes, stream.handle()) };
        let copied = self.context.driver.check(code, || format!("copying from `{}`", self.name));
        stream.wait()?;
        copied
    }

    /// Copies another array of the same length here, in the stream's order.
    ///
    /// # Errors
    /// [`CudaError::Length`], [`CudaError::Call`].
    pub fn copy_from(&mut self, stream: &Stream, other: &Self) -> Result<(), CudaError> {
        self.expect(other.length)?;
        if self.length == 0 {
            return Ok(());
        }
        self.context.enter()?;
        // SAFETY: both arrays have that many bytes of this GPU's memory.
        let code = unsafe {
            (self.context.driver.copy_within)(self.address, other.address, self.bytes(), stream.handle())
        };
        self.context.driver.check(code, || format!("copying `{}` to `{}`", other.name, self.name))
    }

    /// Copies another array, of this GPU or another, to the places from `first` on, in the order of this GPU's `stream`. Whoever
    /// writes the other array waits for that by its own means.
    ///
    /// # Errors
    /// [`CudaError::Length`] if it does not fit, [`CudaError::Call`].
    pub fn take_part(&self, stream: &Stream, first: usize, other: &Self) -> Result<(), CudaError> {
        let end = first.saturating_add(other.length);
        if end > self.length {
            return Err(CudaError::Length { buffer: self.name.clone(), expected: self.length, found: end });
        }
        if other.length == 0 {
            return Ok(());
        }
        self.context.enter()?;
        let to = self.address + (first * size_of::<T>()) as u64;
        let (near, far) = (self.context.handle, other.context.handle);
        // SAFETY: both arrays have that many bytes from there on, each in its context's memory, and live at least until the
        // driver frees them, which waits for the GPU.
        let code = if near == far {
            unsafe { (self.context.driver.copy_within)(to, other.address, other.bytes(), stream.handle()) }
        } else {
            let driver = self.context.driver;
            unsafe { (driver.copy_across)(to, near, other.address, far, other.bytes(), stream.handle()) }
        };
        self.context.driver.check(code, || format!("copying `{}` to `{}`", other.name, self.name))
    }
}

impl<T> Drop for Buffer<T> {
    fn drop(&mut self) {
        if self.address != 0 && self.context.enter().is_ok() {
            // SAFETY: allocated by `new` and freed once; the driver waits for work that uses it.
            unsafe { (self.context.driver.free)(self.address) };
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn what_does_not_fit_is_named_by_its_largest_parts() {
        let parts = [("states", 1 << 30), ("samples", 3 << 30), ("networks", 1 << 20), ("graph", 5)];
        assert_eq!(check(&parts, 0, 5 << 30, 8 << 30), Ok(()));
        let error = check(&parts, 0, 4 << 30, 8 << 30);
        let Err(CudaError::Memory { what, needed, free, .. }) = error else { panic!("{error:?}") };
        assert_eq!(what, "samples, states, networks");
        assert_eq!((needed, free), ((4 << 30) + (1 << 20) + 5, (4 << 30) - RESERVE));
        assert!(check(&[("all", u64::MAX), ("more", 1)], 0, 4 << 30, 8 << 30).is_err());
    }
}
