//! The numbers from which costs are computed, for simulators that compare signals themselves, for example on a GPU.

use super::{Breakdown, GroupCost, LOST, Reference, Signal, Weights};
use std::sync::Arc;

/// The numbers of a candidate's signals that a cost needs, besides the samples that its falls lost. Samples count from the end of the
/// pre-roll to a fall ([`crate::Signals::fell_at`]).
#[derive(Clone, Copy, Debug)]
pub enum Pieces<'a> {
    /// The Wasserstein-1 distance of each dimension, of the pooled samples that count, unscaled. It is not used if no sample
    /// counts.
    Distances(Compared<'a>),
    /// The sum of squared differences of each dimension, over the samples that count, recordings summed in their order,
    /// unscaled.
    Squares(Compared<'a>),
}

/// The two sides of a comparison.
#[derive(Clone, Copy, Debug)]
pub struct Compared<'a> {
    /// The robot's side.
    pub reference: &'a Arc<Reference>,
    /// Weights of the groups of signals. Groups with weight 0 are not used.
    pub weights: Weights,
}

impl<'a> Pieces<'a> {
    /// The two sides of the comparison.
    pub fn compared(&self) -> Compared<'a> {
        match *self {
            Self::Distances(compared) | Self::Squares(compared) => compared,
        }
    }

    /// The cost of a candidate with these pieces, one for each signal and dimension. `lost`: the samples of all recordings that
    /// its falls lost. It is not finite if a piece is not.
    pub fn total(&self, lost: usize, piece: impl FnMut(Signal, usize) -> f64) -> f64 {
        let Compared { reference, weights } = self.compared();
        let counted = reference.counted();
        let kept = counted.saturating_sub(lost);
        match self {
            Self::Distances(_) => distances(reference, &weights, [lost, kept], piece),
            Self::Squares(_) => squares(reference, &weights, [lost, counted], piece),
        }
        .total
    }
}

/// The cost of distances: (1 − m) W₁ + m · [`LOST`] with m the share of samples lost beyond what the robot itself loses to falls,
/// scaled; the mean over a signal's dimensions.
pub(super) fn distances(
    reference: &Reference,
    weights: &Weights,
    [lost, kept]: [usize; 2],
    mut distance: impl FnMut(Signal, usize) -> f64,
) -> Breakdown {
    // Only losses beyond the real robot's count: a simulated robot that falls as often as the real one is right.
    let share = (lost as f64 / (lost + kept) as f64 - reference.lost_by_robot()).max(0.0);
    let mut number = |signal: Signal, column: usize, scale: f64| {
        // Without samples there is no distance, and everything is lost.
        if kept == 0 {
            return LOST;
        }
        let distance = scale * distance(signal, column);
        // The branch keeps the bits of a cost without falls.
        if share == 0.0 { distance } else { (1.0 - share) * distance + share * LOST }
    };
    let groups = weights.signals().map(|signal| {
        let dimensions = reference.dimensions(signal).unwrap_or_default().iter().enumerate();
        let per_joint: Vec<Option<f64>> = dimensions
            .map(|(column, dimension)| dimension.scale.map(|scale| number(signal, column, scale)))
            .collect();
        // `Weights::check` refuses a signal without a scaled dimension, so the count is not 0.
        let count = per_joint.iter().flatten().count();
        let value = per_joint.iter().flatten().sum::<f64>() / count as f64;
        GroupCost { signal, weight: weights.get(signal), value, per_joint }
    });
    Breakdown::new(groups.collect())
}

/// The cost of sums of squares: the root of the mean square over samples and a signal's dimensions, scaled; a sample lost
/// counts as [`LOST`].
pub(super) fn squares(
    reference: &Reference,
    weights: &Weights,
    [lost, counted]: [usize; 2],
    mut sum: impl FnMut(Signal, usize) -> f64,
) -> Breakdown {
    // Sums are of squares, so a lost sample counts with its square.
    let lost = lost as f64 * (LOST * LOST);
    let groups = weights.signals().map(|signal| {
        let dimensions = reference.dimensions(signal).unwrap_or_default().iter().enumerate();
        let per_joint: Vec<Option<f64>> = dimensions
            .map(|(column, dimension)| {
                let sum = sum(signal, column);
                // Without a fall this adds exactly 0.
                dimension.scale.map(|scale| {
                    // Sums are unscaled, so what counts for lost samples is brought to the dimension's unit.
                    let mean = (sum + lost / (scale * scale)) / counted as f64;
                    scale * mean.sqrt()
                })
            })
            .collect();
        let count = per_joint.iter().flatten().count();
        let joints = per_joint.iter().flatten();
        // The root of the mean square over joints as well, so that the cost is the norm of all differences.
        let value = (joints.map(|rms| rms * rms).sum::<f64>() / count as f64).sqrt();
        GroupCost { signal, weight: weights.get(signal), value, per_joint }
    });
    Breakdown::new(groups.collect())
}
