//! The time-aligned cost.

use super::{Accumulator, Breakdown, Cost, CostError, GroupCost, Signal, Simulated, Target, Weights};
use std::sync::Arc;

/// MatchO(∞): time-aligned L2 between the simulated and the recorded joint signals without resets, in the target's
/// fixed scaling. With e the scaled difference of one joint at one sample, T all samples of all recordings and J
/// the joints, a group costs √(1/(T·J) Σ_t Σ_j e²); the groups are summed, each with its weight. The two sides
/// need the same clock and the same sample counts.
///
/// Per joint the breakdown gives √(1/T Σ_t e²), so the group is the root mean square of its joints.
#[derive(Clone, Debug)]
pub struct MatchO {
    target: Arc<Target>,
    weights: Weights,
}

impl MatchO {
    /// The cost against `target`.
    ///
    /// # Errors
    /// As [`Weights::check`].
    pub fn new(target: Arc<Target>, weights: Weights) -> Result<Self, CostError> {
        weights.check(&target)?;
        Ok(Self { target, weights })
    }

    fn signals(&self) -> impl Iterator<Item = Signal> {
        Signal::ALL.into_iter().filter(|signal| self.weights.get(*signal) > 0.0)
    }
}

impl Cost for MatchO {
    fn name(&self) -> &'static str {
        "matcho"
    }

    fn begin(&self) -> Box<dyn Accumulator + '_> {
        Box::new(Sums { cost: self, recordings: vec![None; self.target.recordings()] })
    }
}

/// Sums of squared differences. Kept by recording, so that the order of `add` cannot change the last bits.
struct Sums<'a> {
    cost: &'a MatchO,
    /// One entry a recording; inside, one vector a weighted signal with one sum a joint, unscaled.
    recordings: Vec<Option<Vec<Vec<f64>>>>,
}

impl Sums<'_> {
    fn clear(&mut self) {
        self.recordings.fill(None);
    }

    fn compare(&mut self, recording: usize, simulated: Simulated<'_>) -> Result<(), CostError> {
        let target = &self.cost.target;
        let count = self.recordings.len();
        let slot =
            self.recordings.get_mut(recording).ok_or(CostError::UnknownRecording { recording, count })?;
        if slot.is_some() {
            return Err(CostError::Repeated(recording));
        }
        let width = target.joints().len();
        let mut groups = Vec::new();
        for signal in self.cost.signals() {
            let measured = target.recording(signal, recording).unwrap_or_default();
            let matrix = target.checked(signal, recording, simulated.get(signal))?;
            if matrix.len() != measured.len() {
                return Err(CostError::Shape {
                    signal,
                    recording,
                    len: matrix.len() + target.skip() * width,
                    expected: format!("{} samples × {width} joints", target.samples(recording)),
                });
            }
            groups.push(squared_differences(matrix, measured, width));
        }
        *slot = Some(groups);
        Ok(())
    }
}

/// Σ_t (a − b)² of each column, in the order of the rows.
pub(crate) fn squared_differences(a: &[f32], b: &[f64], width: usize) -> Vec<f64> {
    let mut sums = vec![0.0; width];
    for (row_a, row_b) in a.chunks_exact(width).zip(b.chunks_exact(width)) {
        for ((sum, x), y) in sums.iter_mut().zip(row_a).zip(row_b) {
            let difference = f64::from(*x) - y;
            *sum += difference * difference;
        }
    }
    sums
}

impl Accumulator for Sums<'_> {
    /// Every recording of the target must be added once.
    fn add(&mut self, recording: usize, simulated: Simulated<'_>) -> Result<(), CostError> {
        self.compare(recording, simulated).inspect_err(|_| self.clear())
    }

    fn finish(&mut self) -> Result<Breakdown, CostError> {
        if let Some(missing) = self.recordings.iter().position(Option::is_none) {
            self.clear();
            return Err(CostError::Missing(missing));
        }
        let target = &self.cost.target;
        let samples: usize =
            (0..self.recordings.len()).map(|recording| target.samples(recording) - target.skip()).sum();
        let mut groups = Vec::new();
        for (number, signal) in self.cost.signals().enumerate() {
            let per_joint: Vec<Option<f64>> = target
                .dimensions(signal)
                .unwrap_or_default()
                .iter()
                .enumerate()
                .map(|(joint, dimension)| {
                    let sum: f64 = self.recordings.iter().flatten().map(|sums| sums[number][joint]).sum();
                    dimension.scale.map(|scale| scale * (sum / samples as f64).sqrt())
                })
                .collect();
            let count = per_joint.iter().flatten().count();
            let mean_square = per_joint.iter().flatten().map(|rms| rms * rms).sum::<f64>() / count as f64;
            let weight = self.cost.weights.get(signal);
            groups.push(GroupCost { signal, weight, value: mean_square.sqrt(), per_joint });
        }
        self.clear();
        Ok(Breakdown::new(groups))
    }
}
