//! The differences whose size a time-aligned cost sums, one by one: what least squares needs.

use super::{CostError, LOST, Reference, Weights};
use crate::Signals;

/// Scaled and weighted differences between simulated and recorded samples.
#[derive(Clone, Copy, Debug)]
pub struct Differences<'a> {
    reference: &'a Reference,
    weights: Weights,
}

impl<'a> Differences<'a> {
    pub(super) fn new(reference: &'a Reference, weights: Weights) -> Self {
        Self { reference, weights }
    }

    /// Numbers a sample: the dimensions of all signals that count, those that are constant in the recordings left out.
    pub fn width(&self) -> usize {
        let dimensions = |signal| self.reference.dimensions(signal).unwrap_or_default();
        let scaled = |signal| dimensions(signal).iter().filter(|dimension| dimension.scale.is_some()).count();
        self.weights.signals().map(scaled).sum()
    }

    /// Numbers of all recordings together.
    pub fn count(&self) -> usize {
        let reference = self.reference;
        let samples = |recording: usize| reference.samples(recording).saturating_sub(reference.skip());
        self.width() * (0..reference.recordings()).map(samples).sum::<usize>()
    }

    /// Those of recording number `recording`: `samples × width`, row-major, without the samples that do not count. Units
    /// are those in which the robot's range is 2; a sample lost to a fall is off by the whole range.
    ///
    /// # Errors
    /// [`CostError::NotFinite`] if a sample is NaN or infinite; shapes that do not fit.
    pub fn compute(&self, recording: usize, simulated: Signals<'_>) -> Result<Vec<f32>, CostError> {
        self.numbers(recording, simulated, |simulated, measured| simulated - measured, LOST)
    }

    /// How they change where the simulated signals change by `slopes`: as [`Self::compute`], of the change itself.
    ///
    /// # Errors
    /// As [`Self::compute`].
    pub fn slopes(&self, recording: usize, slopes: Signals<'_>) -> Result<Vec<f32>, CostError> {
        // A lost sample has a fixed difference, so its slope is 0.
        self.numbers(recording, slopes, |slope, _| slope, 0.0)
    }

    /// Scaled and weighted numbers that `of` makes of a simulated and a recorded one; `lost` where a fall left none.
    fn numbers(
        &self,
        recording: usize,
        simulated: Signals<'_>,
        of: impl Fn(f64, f64) -> f64,
        lost: f64,
    ) -> Result<Vec<f32>, CostError> {
        let reference = self.reference;
        let count = reference.recordings();
        if recording >= count {
            return Err(CostError::UnknownRecording { recording, count });
        }
        let width = self.width();
        let rows = reference.samples(recording) - reference.skip();
        // Rows are samples, columns the compared dimensions of all signals; every candidate gets the same layout.
        let mut differences = vec![0.0f32; rows * width];
        let mut column = 0;
        for signal in self.weights.signals() {
            let joints = signal.width(reference.joints().len());
            let measured = reference.recording(signal, recording).unwrap_or_default();
            let counted = reference.checked(signal, recording, &simulated)?;
            // Rows are compared by their numbers, so both sides must have the same samples.
            if counted.matrix.len() + counted.lost * joints != measured.len() {
                return Err(CostError::Shape {
                    signal,
                    recording,
                    len: simulated.get(signal).unwrap_or_default().len(),
                    expected: format!("{} samples × {joints}", reference.samples(recording)),
                });
            }
            let weight = self.weights.get(signal);
            let dimensions = reference.dimensions(signal).unwrap_or_default();
            for (dimension, scale) in
                dimensions.iter().enumerate().filter_map(|(place, one)| Some((place, one.scale?)))
            {
                let factor = weight * scale;
                for (row, numbers) in differences.chunks_exact_mut(width).enumerate() {
                    let at = row * joints + dimension;
                    // A fall ends the simulated signal early: missing samples get the fixed difference.
                    numbers[column] = match counted.matrix.get(at) {
                        Some(&number) => (factor * of(f64::from(number), measured[at])) as f32,
                        // `lost` is in scaled units already, so the scale does not enter.
                        None => (weight * lost) as f32,
                    };
                }
                column += 1;
            }
        }
        Ok(differences)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::cost::Recorded;

    #[test]
    fn a_recording_that_is_not_there_is_refused() {
        let ramp = vec![0.0, 1.0, 3.0];
        let recorded = Recorded { position: ramp.clone(), velocity: ramp, ..Recorded::default() };
        let reference = Reference::new(vec!["hip".into()], &[recorded], 1).unwrap();
        let differences = Differences::new(&reference, Weights::JOINTS);
        let signals = Signals::of_joints(&[0.0; 3], &[0.0; 3]);
        assert_eq!(differences.compute(0, signals).unwrap().len(), differences.count());
        let unknown = CostError::UnknownRecording { recording: 1, count: 1 };
        assert_eq!(differences.compute(1, signals), Err(unknown));
    }
}
