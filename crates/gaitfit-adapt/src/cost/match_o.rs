//! The time-aligned cost.

use super::aligned::{AlignedSums, Norm};
use super::{Accumulator, Compared, Cost, CostError, Differences, Pieces, Reference, Weights};
use std::sync::Arc;

/// MatchO(∞): time-aligned L2 between the simulated and the recorded joint signals without resets, in the reference's
/// fixed scaling. With e the scaled difference of one joint at one sample, T all samples of all recordings and J
/// the joints, a group costs √(1/(T·J) Σ_t Σ_j e²); the groups are summed, each with its weight. The two sides
/// need the same clock and the same sample counts. A sample lost to a fall counts as e = 2, the robot's whole range.
///
/// Per joint the breakdown gives √(1/T Σ_t e²), so the group is the root mean square of its joints.
#[derive(Clone, Debug)]
pub struct MatchO {
    reference: Arc<Reference>,
    weights: Weights,
}

impl MatchO {
    /// The cost against `reference`.
    ///
    /// # Errors
    /// As [`Weights::check`].
    pub fn new(reference: Arc<Reference>, weights: Weights) -> Result<Self, CostError> {
        weights.check(&reference)?;
        Ok(Self { reference, weights })
    }
}

impl Cost for MatchO {
    fn name(&self) -> &str {
        "matcho"
    }

    fn begin(&self) -> Box<dyn Accumulator + '_> {
        Box::new(AlignedSums::new(&self.reference, self.weights, Norm::Square))
    }

    fn pieces(&self) -> Option<Pieces<'_>> {
        Some(Pieces::Squares(Compared { reference: &self.reference, weights: self.weights }))
    }

    fn differences(&self) -> Option<Differences<'_>> {
        Some(Differences::new(&self.reference, self.weights))
    }

    fn lost(&self) -> f64 {
        super::LOST * self.weights.sum()
    }

    fn subset(&self, recordings: &[usize]) -> Option<Box<dyn Cost>> {
        Some(Box::new(Self { reference: Arc::new(self.reference.subset(recordings)), ..self.clone() }))
    }
}
