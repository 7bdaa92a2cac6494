//! Between which numbers a graph clips what its layers give.

use super::node_error::{NodeError, misfit};
use gaitfit_policy::PolicyError;
use gaitfit_policy::invalid;
use std::ops::Range;

/// Lower and upper bound of each output.
#[derive(Clone, Debug)]
pub(super) struct Bounds(Vec<[f64; 2]>);

impl Bounds {
    /// No bounds on `width` numbers.
    pub fn new(width: usize) -> Self {
        Self(vec![[f64::NEG_INFINITY, f64::INFINITY]; width])
    }

    /// x ↦ max(low, min(x, high)); `low` is at most `high`.
    pub fn narrow(&mut self, low: f64, high: f64) {
        for bound in &mut self.0 {
            // The bounds go through the clip as the numbers themselves do.
            *bound = bound.map(|limit| limit.max(low).min(high));
        }
    }

    /// x ↦ x ∘ factor + offset; vectors of one number or of the width.
    pub fn scale(&mut self, factor: &[f64], offset: &[f64]) -> Result<(), NodeError> {
        let at =
            |values: &[f64], index: usize| values.get(if values.len() == 1 { 0 } else { index }).copied();
        for (index, bound) in self.0.iter_mut().enumerate() {
            let (Some(factor), Some(offset)) = (at(factor, index), at(offset, index)) else {
                return Err(misfit("its constant is not of as many numbers as the layer before it gives"));
            };
            // Also without a limit: 0 times the infinite is no number.
            *bound = bound.map(|limit| if factor == 0.0 { offset } else { factor * limit + offset });
            // A negative factor exchanges the bounds.
            bound.sort_by(f64::total_cmp);
        }
        Ok(())
    }

    /// Keeps the bounds of the outputs `range`, all of which exist.
    pub fn select(&mut self, range: Range<usize>) {
        self.0 = self.0.drain(range).collect();
    }

    /// The magnitude that each output is clipped to.
    ///
    /// # Errors
    /// Bounds that are not the same to both sides.
    pub fn magnitudes(&self) -> Result<Vec<f64>, PolicyError> {
        let magnitude = |&[low, high]: &[f64; 2]| {
            // The file has them in single precision.
            let even = (low + high).abs() <= 1e-6 * high.abs() && high > 0.0 && high.is_finite();
            even.then_some(high).ok_or_else(|| {
                invalid(format!(
                    "it clips its actions to [{low}, {high}], and gaitfit's action clip is the same to both sides. Export \
                     the actor without its Clip; if the limits matter, run the whole file as a function in Python \
                     (gaitfit.Policy, docs/python.md)"
                ))
            })
        };
        self.0.iter().map(magnitude).collect()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn a_factor_of_zero_leaves_the_offset_also_without_a_limit() {
        let mut bounds = Bounds::new(3);
        bounds.narrow(-1.0, f64::INFINITY);
        bounds.scale(&[0.0, -2.0, 1.0], &[0.5, 0.0, 1.0]).unwrap();
        assert_eq!(bounds.0, [[0.5, 0.5], [f64::NEG_INFINITY, 2.0], [0.0, f64::INFINITY]]);
    }
}
