//! Memory that begins where a cache line begins.

use std::ops::{Deref, DerefMut};

use super::scalar::Scalar;

/// Bytes of a cache line, and of the widest vectors: a vector across two lines takes two reads.
const LINE: usize = 64;

/// Numbers of which the first lies at the beginning of a cache line.
#[derive(Debug, Default)]
pub(crate) struct Aligned<T: Scalar> {
    /// The numbers, and room before and after.
    memory: Vec<T>,
    start: usize,
    len: usize,
}

impl<T: Scalar> Aligned<T> {
    /// `len` zeros.
    pub(crate) fn zeros(len: usize) -> Self {
        let memory = vec![T::ZERO; len + LINE / size_of::<T>()];
        // An offset that cannot be told costs speed, no more.
        let start = memory.as_ptr().align_offset(LINE).min(LINE / size_of::<T>());
        Self { memory, start, len }
    }

    /// Makes it at least `len` long; what it held is lost if it was shorter.
    pub(crate) fn at_least(&mut self, len: usize) {
        if self.len < len {
            *self = Self::zeros(len);
        }
    }
}

impl<T: Scalar> Clone for Aligned<T> {
    fn clone(&self) -> Self {
        let mut copy = Self::zeros(self.len);
        copy.copy_from_slice(self);
        copy
    }
}

impl<T: Scalar> Deref for Aligned<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.memory[self.start..self.start + self.len]
    }
}

impl<T: Scalar> DerefMut for Aligned<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.memory[self.start..self.start + self.len]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn clones_begin_at_a_line_too() {
        let mut numbers = Aligned::<f32>::zeros(37);
        numbers[36] = 2.0;
        for numbers in [numbers.clone(), numbers] {
            assert_eq!(numbers.as_ptr().addr() % LINE, 0);
            assert_eq!((numbers.len(), numbers[0], numbers[36]), (37, 0.0, 2.0));
        }
    }
}
