//! The time-aligned cost with what the robot's own sensors read.

use super::aligned::{AlignedSums, Norm};
use super::{Accumulator, Compared, Cost, CostError, CostKind, Differences, Reference, Weights};
use crate::Resets;
use std::num::NonZeroUsize;
use std::sync::Arc;

/// MatchR(H): mean time-aligned distance of joint positions and velocities, the simulated robot given what the log's
/// sensors read (joints, attitude, rates) every H samples, and the log's targets all the time. With e the scaled
/// difference of one joint at one sample, T all samples of all recordings and J the joints, a group costs
/// 1/(T·J) Σ_t Σ_j |e|; the groups are summed, each with its weight.
///
/// Short predictions do not drift apart, so the cost is smooth and all of a log counts; and as they begin where the log
/// is, the two sides need no common clock. Absolute values are summed, not squares: a few samples in which the robot
/// does what no candidate can, legs that hit each other for one, then hardly count.
#[derive(Clone, Debug)]
pub struct MatchR {
    reference: Arc<Reference>,
    horizon: NonZeroUsize,
    name: String,
}

impl MatchR {
    /// The cost against `reference`, with `horizon` samples from one reading to the next.
    ///
    /// # Errors
    /// As [`Weights::check`].
    pub fn new(reference: Arc<Reference>, horizon: NonZeroUsize) -> Result<Self, CostError> {
        Weights::JOINTS.check(&reference)?;
        Ok(Self { reference, horizon, name: CostKind::MatchR(horizon).to_string() })
    }
}

impl Cost for MatchR {
    fn name(&self) -> &str {
        &self.name
    }

    fn resets(&self) -> Resets {
        CostKind::MatchR(self.horizon).given()
    }

    fn begin(&self) -> Box<dyn Accumulator + '_> {
        Box::new(AlignedSums::new(&self.reference, Weights::JOINTS, Norm::Absolute))
    }

    fn differences(&self) -> Option<Differences<'_>> {
        Some(Differences::new(&self.reference, Weights::JOINTS))
    }

    fn compared(&self) -> Option<Compared<'_>> {
        Some(Compared { reference: &self.reference, weights: Weights::JOINTS })
    }

    fn lost(&self) -> f64 {
        super::LOST * Weights::JOINTS.sum()
    }

    fn subset(&self, recordings: &[usize]) -> Option<Box<dyn Cost>> {
        Some(Box::new(Self { reference: Arc::new(self.reference.subset(recordings)), ..self.clone() }))
    }
}
