//! A value for each motor of a robot, without allocation.

use std::fmt;
use std::ops::{Deref, DerefMut};

/// Max number of motors of a robot: the slots of the largest message.
pub const MAX_MOTORS: usize = 35;

/// A value for each motor of a robot, motor order. Used as a slice; its length is the robot's number of motors.
#[derive(Clone, Copy)]
pub struct PerMotor<T> {
    values: [T; MAX_MOTORS],
    count: usize,
}

impl<T: Copy + Default> PerMotor<T> {
    /// `value` for each of `count` motors, [`MAX_MOTORS`] at most.
    pub fn new(count: usize, value: T) -> Self {
        // Files of robots with more motors are refused, so nothing is cut off.
        Self { values: [value; MAX_MOTORS], count: count.min(MAX_MOTORS) }
    }

    /// `value` of each of `count` motors, [`MAX_MOTORS`] at most.
    pub fn from_fn(count: usize, mut value: impl FnMut(usize) -> T) -> Self {
        let mut motors = Self::new(count, T::default());
        (0..motors.count).for_each(|motor| motors.values[motor] = value(motor));
        motors
    }

    /// Applies `f` to each value.
    pub fn map<U: Copy + Default>(&self, mut f: impl FnMut(T) -> U) -> PerMotor<U> {
        PerMotor::from_fn(self.count, |motor| f(self.values[motor]))
    }
}

impl<T: Copy + Default, const N: usize> From<[T; N]> for PerMotor<T> {
    fn from(values: [T; N]) -> Self {
        const { assert!(N <= MAX_MOTORS, "more values than a robot has motors") };
        Self::from_fn(N, |motor| values[motor])
    }
}

impl<T> Deref for PerMotor<T> {
    type Target = [T];

    fn deref(&self) -> &[T] {
        &self.values[..self.count]
    }
}

impl<T> DerefMut for PerMotor<T> {
    fn deref_mut(&mut self) -> &mut [T] {
        &mut self.values[..self.count]
    }
}

impl<'a, T> IntoIterator for &'a PerMotor<T> {
    type Item = &'a T;
    type IntoIter = std::slice::Iter<'a, T>;

    fn into_iter(self) -> Self::IntoIter {
        self.iter()
    }
}

impl<T: PartialEq> PartialEq for PerMotor<T> {
    fn eq(&self, other: &Self) -> bool {
        self[..] == other[..]
    }
}

impl<T: fmt::Debug> fmt::Debug for PerMotor<T> {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        self[..].fmt(f)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn it_has_as_many_values_as_motors_and_no_more_than_there_are_slots() {
        let row = PerMotor::from([1, 2, 3]);
        assert_eq!((row.len(), row.map(|x| 2 * x)), (3, PerMotor::from([2, 4, 6])));
        assert_ne!(row, PerMotor::new(3, 1));
        assert_ne!(PerMotor::new(2, 1), PerMotor::new(3, 1));
        assert_eq!(PerMotor::from_fn(1000, |motor| motor).last(), Some(&(MAX_MOTORS - 1)));
    }
}
