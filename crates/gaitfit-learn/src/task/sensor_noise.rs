//! Sensor noise: what is added to the actor's observation.

use gaitfit_policy::{Quantity, Term};

use super::NoiseSettings;

/// Uniform noise of the given half ranges on an observation, for one environment and step.
pub(super) struct SensorNoise<'a> {
    settings: &'a NoiseSettings,
    /// The words of [`blocks`], which the terms take one after the other.
    words: &'a [[u32; 4]],
}

/// Numbers of the random blocks that the noise on `terms` takes, in their order: four draws a block, blocks apart by
/// the place in the row.
pub(super) fn blocks(settings: &NoiseSettings, terms: &[Term], joints: usize) -> Vec<u32> {
    let mut blocks = Vec::new();
    let mut place = 0;
    for term in terms {
        let width = term.quantity.width(joints);
        if settings.half_range(term.quantity) > 0.0 {
            // Blocks go by the place in the row, so noise on one term does not change the draws of another.
            blocks.extend((place..place + width).step_by(4).map(|place| place as u32));
        }
        place += width;
    }
    blocks
}

impl<'a> SensorNoise<'a> {
    /// Noise from the words of one environment's [`blocks`].
    pub(super) fn new(settings: &'a NoiseSettings, words: &'a [[u32; 4]]) -> Self {
        Self { settings, words }
    }

    /// Adds to the present values of a term; terms come in the order of [`blocks`].
    pub(super) fn add(&mut self, quantity: Quantity, values: &mut [f32]) {
        let half = self.settings.half_range(quantity);
        // `blocks` has left out such terms too, so no words are taken for them.
        if half <= 0.0 {
            return;
        }
        // A block has four draws. The last block of a term may be used in part.
        let (drawn, rest) = self.words.split_at(values.len().div_ceil(4));
        for (chunk, words) in values.chunks_mut(4).zip(drawn) {
            for (value, word) in chunk.iter_mut().zip(words) {
                // 24 bits are the precision of `f32`: each value is exact, and 1 is never reached.
                let uniform = (word >> 8) as f32 * (1.0 / (1 << 24) as f32);
                *value += half * (2.0 * uniform - 1.0);
            }
        }
        self.words = rest;
    }
}
