//! Sums of time-aligned squared differences, as MatchO and MatchS need them.

use super::{Accumulator, Breakdown, CostError, GroupCost, LOST, Reference, Weights};
use crate::Signals;

/// Sums of squared differences. Kept by recording, so that the order of `add` cannot change the last bits.
///
/// With e the scaled difference of one dimension at one sample, T all samples of all recordings and J the
/// dimensions, a group costs √(1/(T·J) Σ_t Σ_j e²). A sample lost to a fall counts as e = 2.
pub(super) struct AlignedSums<'a> {
    reference: &'a Reference,
    weights: Weights,
    /// One entry a recording.
    recordings: Vec<Option<Sums>>,
}

/// The sums of one recording.
#[derive(Clone)]
struct Sums {
    /// One vector a weighted signal with one sum a dimension, unscaled.
    squares: Vec<Vec<f64>>,
    /// Samples lost to a fall.
    lost: usize,
}

impl<'a> AlignedSums<'a> {
    pub fn new(reference: &'a Reference, weights: Weights) -> Self {
        Self { reference, weights, recordings: vec![None; reference.recordings()] }
    }

    fn clear(&mut self) {
        self.recordings.fill(None);
    }

    fn compare(&mut self, recording: usize, simulated: Signals<'_>) -> Result<(), CostError> {
        let reference = self.reference;
        let count = self.recordings.len();
        let slot =
            self.recordings.get_mut(recording).ok_or(CostError::UnknownRecording { recording, count })?;
        if slot.is_some() {
            return Err(CostError::Repeated(recording));
        }
        let samples = reference.samples(recording);
        let mut sums = Sums { squares: Vec::new(), lost: 0 };
        for signal in self.weights.signals() {
            let width = signal.width(reference.joints().len());
            let measured = reference.recording(signal, recording).unwrap_or_default();
            let counted = reference.checked(signal, recording, &simulated)?;
            if counted.matrix.len() + counted.lost * width != measured.len() {
                return Err(CostError::Shape {
                    signal,
                    recording,
                    len: simulated.get(signal).unwrap_or_default().len(),
                    expected: format!("{samples} samples × {width}"),
                });
            }
            sums.lost = counted.lost;
            sums.squares.push(squared_differences(counted.matrix, measured, width));
        }
        *slot = Some(sums);
        Ok(())
    }
}

/// Σ_t (a − b)² of each column, in the order of the rows; rows of `b` beyond the end of `a` are left out. The
/// difference is that of the two numbers as doubles: nothing but the simulator's own rounding limits how small it
/// gets.
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

impl Accumulator for AlignedSums<'_> {
    /// Every recording of the reference must be added once.
    fn add(&mut self, recording: usize, simulated: Signals<'_>) -> Result<(), CostError> {
        self.compare(recording, simulated).inspect_err(|_| self.clear())
    }

    fn finish(&mut self) -> Result<Breakdown, CostError> {
        if let Some(missing) = self.recordings.iter().position(Option::is_none) {
            self.clear();
            return Err(CostError::Missing(missing));
        }
        let reference = self.reference;
        let samples: usize =
            (0..self.recordings.len()).map(|recording| reference.samples(recording) - reference.skip()).sum();
        let lost: usize = self.recordings.iter().flatten().map(|sums| sums.lost).sum();
        let lost = LOST * LOST * lost as f64;
        let mut groups = Vec::new();
        for (number, signal) in self.weights.signals().enumerate() {
            let per_joint: Vec<Option<f64>> = reference
                .dimensions(signal)
                .unwrap_or_default()
                .iter()
                .enumerate()
                .map(|(column, dimension)| {
                    let sum: f64 =
                        self.recordings.iter().flatten().map(|sums| sums.squares[number][column]).sum();
                    // Without a fall this adds exactly 0.
                    dimension
                        .scale
                        .map(|scale| scale * ((sum + lost / (scale * scale)) / samples as f64).sqrt())
                })
                .collect();
            let count = per_joint.iter().flatten().count();
            let mean_square = per_joint.iter().flatten().map(|rms| rms * rms).sum::<f64>() / count as f64;
            let weight = self.weights.get(signal);
            groups.push(GroupCost { signal, weight, value: mean_square.sqrt(), per_joint });
        }
        self.clear();
        Ok(Breakdown::new(groups))
    }
}
