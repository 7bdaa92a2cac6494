//! The time-aligned costs, without resets and with them.

use super::aligned::{AlignedSums, Norm};
use super::{
    Accumulator, Compared, Cost, CostError, CostKind, Differences, Pieces, Reference, Signal, Weights,
};
use crate::Resets;
use std::num::NonZeroUsize;
use std::sync::Arc;

/// Time-aligned L2 between simulated and recorded signals, in the reference's fixed scaling. With e the scaled
/// difference of one joint at one sample, T all samples of all recordings and J the joints, a group costs √(1/(T·J) Σ_t
/// Σ_j e²); the groups are summed, each with its weight. The two sides need the same clock and the same sample counts.
/// A sample lost to a fall counts as e = 2, the robot's whole range.
///
/// Per joint the breakdown gives √(1/T Σ_t e²), so the group is the root mean square of its joints.
#[derive(Clone, Debug)]
pub struct TimeAligned {
    reference: Arc<Reference>,
    weights: Weights,
    resets: Resets,
    name: String,
}

impl TimeAligned {
    /// MatchO(∞): joint signals, without resets.
    ///
    /// # Errors
    /// As [`Weights::check`].
    pub fn match_o(reference: Arc<Reference>, weights: Weights) -> Result<Self, CostError> {
        weights.check(&reference)?;
        Ok(Self { reference, weights, resets: Resets::Never, name: CostKind::MatchO.to_string() })
    }

    /// MatchS(H): joint position, joint velocity, base position and base velocity, the simulated robot reset to the
    /// recording's state every `horizon` samples (H infinite: never). Privileged: it needs the base's state, which
    /// robots do not log by themselves; a baseline.
    ///
    /// With H = 1 each sample is predicted from the one before. Errors are then as small as one control period makes
    /// them, and with noise-free data the cost rises linearly from 0 at the truth (its square: as the square of the
    /// parameters' error).
    ///
    /// # Errors
    /// [`CostError::Privileged`] without the base's position and velocity in every recording where `weights` ask
    /// for them; as [`Weights::check`].
    pub fn match_s(
        reference: Arc<Reference>,
        weights: Weights,
        horizon: Option<NonZeroUsize>,
    ) -> Result<Self, CostError> {
        let name = CostKind::MatchS(horizon).to_string();
        // The usual mistake gets an error of its own before the general check.
        let missing = weights.signals().find(|signal| signal.is_privileged() && !reference.has(*signal));
        if let Some(signal) = missing {
            return Err(CostError::Privileged { cost: name, signal });
        }
        // A robot that stands still or is clamped has a constant base: its dimensions are left out.
        let constant = |signal: Signal| {
            reference.dimensions(signal).is_some_and(|all| all.iter().all(|one| one.scale.is_none()))
        };
        let mut weights = weights;
        if constant(Signal::BasePosition) {
            weights.base_position = 0.0;
        }
        if constant(Signal::BaseVelocity) {
            weights.base_velocity = 0.0;
        }
        // Only now: a base that is constant has just lost its weights.
        weights.check(&reference)?;
        // Even a simulation that is never reset has one reset at its start: the simulated robot starts in the
        // recording's state.
        let resets = Resets::State(horizon.map_or(usize::MAX, NonZeroUsize::get));
        Ok(Self { reference, weights, resets, name })
    }
}

impl Cost for TimeAligned {
    fn name(&self) -> &str {
        &self.name
    }

    fn resets(&self) -> Resets {
        self.resets
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
