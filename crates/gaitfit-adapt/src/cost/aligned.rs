//! Sums of time-aligned differences, as MatchO, MatchS and MatchR need them.

use super::{Accumulator, Breakdown, CostError, GroupCost, LOST, Reference, Signal, Weights, pieces};
use crate::Signals;

/// How differences become one number.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Norm {
    /// The root of the mean square.
    Square,
    /// The mean of the absolute values.
    Absolute,
}

/// Sums of differences. Kept by recording, so that the order of `add` cannot change the last bits.
///
/// With e the scaled difference of one dimension at one sample, T all samples of all recordings and J the
/// dimensions, a group costs √(1/(T·J) Σ_t Σ_j e²), or 1/(T·J) Σ_t Σ_j |e|. A sample lost to a fall counts as e = 2.
pub(super) struct AlignedSums<'a> {
    reference: &'a Reference,
    weights: Weights,
    norm: Norm,
    /// One entry a recording.
    recordings: Vec<Option<Sums>>,
}

/// The sums of one recording.
#[derive(Clone)]
struct Sums {
    /// One vector a weighted signal with one sum a dimension, unscaled.
    differences: Vec<Vec<f64>>,
    /// Samples lost to a fall.
    lost: usize,
}

impl<'a> AlignedSums<'a> {
    pub fn new(reference: &'a Reference, weights: Weights, norm: Norm) -> Self {
        Self { reference, weights, norm, recordings: vec![None; reference.recordings()] }
    }

    fn clear(&mut self) {
        self.recordings.fill(None);
    }

    fn compare(&mut self, recording: usize, simulated: Signals<'_>) -> Result<(), CostError> {
        let reference = self.reference;
        let count = self.recordings.len();
        let slot =
            self.recordings.get_mut(recording).ok_or(CostError::UnknownRecording { recording, count })?;
        // Adding a recording twice would count it twice without an error.
        if slot.is_some() {
            return Err(CostError::Repeated(recording));
        }
        let samples = reference.samples(recording);
        let mut sums = Sums { differences: Vec::new(), lost: 0 };
        for signal in self.weights.signals() {
            let width = signal.width(reference.joints().len());
            let measured = reference.recording(signal, recording).unwrap_or_default();
            let counted = reference.checked(signal, recording, &simulated)?;
            // Time-aligned costs need a partner for each recorded sample, either a simulated one or one lost to a
            // fall.
            if counted.matrix.len() + counted.lost * width != measured.len() {
                return Err(CostError::Shape {
                    signal,
                    recording,
                    len: simulated.get(signal).unwrap_or_default().len(),
                    expected: format!("{samples} samples × {width}"),
                });
            }
            // A fall takes the same rows of every signal, so any signal may set the number.
            sums.lost = counted.lost;
            sums.differences.push(match self.norm {
                Norm::Square => squared_differences(counted.matrix, measured, width),
                Norm::Absolute => sum_differences(counted.matrix, measured, width, f64::abs),
            });
        }
        *slot = Some(sums);
        Ok(())
    }
}

/// Σ_t (a − b)² of each column, in the order of the rows; rows of `b` beyond the end of `a` are left out. The
/// difference is that of the two numbers as doubles: nothing but the simulator's own rounding limits how small it
/// gets.
pub(crate) fn squared_differences(a: &[f32], b: &[f64], width: usize) -> Vec<f64> {
    sum_differences(a, b, width, |difference| difference * difference)
}

fn sum_differences(a: &[f32], b: &[f64], width: usize, of: impl Fn(f64) -> f64) -> Vec<f64> {
    let mut sums = vec![0.0; width];
    // A fall makes `a` shorter, and `zip` ends there. The samples that it lost are charged at the end.
    for (row_a, row_b) in a.chunks_exact(width).zip(b.chunks_exact(width)) {
        for ((sum, x), y) in sums.iter_mut().zip(row_a).zip(row_b) {
            // Sums of many samples would lose digits in single precision.
            *sum += of(f64::from(*x) - y);
        }
    }
    sums
}

impl Accumulator for AlignedSums<'_> {
    /// Every recording of the reference must be added once.
    fn add(&mut self, recording: usize, simulated: Signals<'_>) -> Result<(), CostError> {
        // After an error the accumulator must be empty, see the trait.
        self.compare(recording, simulated).inspect_err(|_| self.clear())
    }

    fn finish(&mut self) -> Result<Breakdown, CostError> {
        if let Some(missing) = self.recordings.iter().position(Option::is_none) {
            self.clear();
            return Err(CostError::Missing(missing));
        }
        let reference = self.reference;
        let samples = reference.counted();
        let lost: usize = self.recordings.iter().flatten().map(|sums| sums.lost).sum();
        let signals: Vec<Signal> = self.weights.signals().collect();
        let sum = |signal: Signal, column: usize| -> f64 {
            // Only weighted signals are asked for, and each of them is in the list.
            let number = signals.iter().position(|of| *of == signal).unwrap_or_default();
            self.recordings.iter().flatten().map(|sums| sums.differences[number][column]).sum()
        };
        let breakdown = match self.norm {
            Norm::Square => pieces::squares(reference, &self.weights, [lost, samples], sum),
            Norm::Absolute => absolute(reference, &self.weights, [lost, samples], sum),
        };
        self.clear();
        Ok(breakdown)
    }
}

/// The cost of sums of absolute differences: the mean over samples and a signal's dimensions, scaled.
fn absolute(
    reference: &Reference,
    weights: &Weights,
    [lost, counted]: [usize; 2],
    sum: impl Fn(Signal, usize) -> f64,
) -> Breakdown {
    let lost = lost as f64 * LOST;
    let groups = weights.signals().map(|signal| {
        let dimensions = reference.dimensions(signal).unwrap_or_default().iter().enumerate();
        let per_joint: Vec<Option<f64>> = dimensions
            .map(|(column, dimension)| {
                let sum = sum(signal, column);
                // Without a fall this adds exactly 0.
                dimension.scale.map(|scale| scale * ((sum + lost / scale) / counted as f64))
            })
            .collect();
        // Dimensions without a scale are left out, so the mean is over those that count.
        let count = per_joint.iter().flatten().count();
        let value = per_joint.iter().flatten().sum::<f64>() / count as f64;
        GroupCost { signal, weight: weights.get(signal), value, per_joint }
    });
    Breakdown::new(groups.collect())
}
