//! Draws by address.

use crate::elementary::{cos_sin_turns, ln};
use crate::philox::philox4x32_10;

/// What a draw is for. Two purposes never share a block. Values are part of every recorded result: add new ones,
/// never renumber.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
pub struct Purpose(pub u32);

impl Purpose {
    /// Seeds of independent sub-runs, see [`derive_seed`].
    pub const SEED: Self = Self(0);
    /// Normals of the optimiser's candidates (environment = candidate, step = generation).
    pub const CMAES: Self = Self(1);
    /// Seeds of the optimiser's restarts.
    pub const RESTART: Self = Self(2);
    /// Gaussian torque noise (environment, physics step, joint).
    pub const TORQUE_NOISE: Self = Self(3);
    /// Random start shift of a log.
    pub const LOG_SHIFT: Self = Self(4);
    /// Velocity commands.
    pub const COMMAND: Self = Self(5);
    /// Initial states.
    pub const RESET: Self = Self(6);
    /// Domain randomisation of model parameters.
    pub const RANDOMISATION: Self = Self(7);
    /// Observation noise.
    pub const OBSERVATION_NOISE: Self = Self(8);
    /// Policy exploration.
    pub const EXPLORATION: Self = Self(9);
    /// Network initialisation.
    pub const WEIGHTS: Self = Self(10);
    /// Minibatch order.
    pub const SHUFFLE: Self = Self(11);
    /// Resampling for confidence intervals.
    pub const BOOTSTRAP: Self = Self(12);
    /// Pushes.
    pub const PUSH: Self = Self(13);
    /// Generated ground.
    pub const TERRAIN: Self = Self(14);
    /// Where on the ground a robot starts.
    pub const PLACE: Self = Self(15);
    /// Phases of chirps, and the robots that they are tried on.
    pub const EXCITATION: Self = Self(16);
    /// Starts near those of logs (environment = log).
    pub const START: Self = Self(18);
    /// Values of simulated robots, and starts of their logs.
    pub const SIMULATED_ROBOTS: Self = Self(17);
}

/// An address up to the draw: (seed, purpose, environment, step). Holds no state; copy it freely.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Stream {
    seed: u64,
    purpose: Purpose,
    environment: u32,
    step: u32,
}

impl Stream {
    /// The stream of `seed` and `purpose` at environment 0, step 0.
    #[inline]
    pub const fn new(seed: u64, purpose: Purpose) -> Self {
        Self { seed, purpose, environment: 0, step: 0 }
    }

    /// The same stream at another environment (or candidate).
    #[inline(always)]
    pub const fn environment(self, environment: u32) -> Self {
        Self { environment, ..self }
    }

    /// The same stream at another step (or generation).
    #[inline]
    pub const fn step(self, step: u32) -> Self {
        Self { step, ..self }
    }

    /// Four random words: number `block` of this address.
    #[inline(always)]
    pub fn block(self, block: u32) -> [u32; 4] {
        let counter = [block, self.step, self.environment, self.purpose.0];
        philox4x32_10(counter, [self.seed as u32, (self.seed >> 32) as u32])
    }

    /// Uniform 32-bit word; word `draw % 4` of block `draw / 4`.
    #[inline]
    pub fn word(self, draw: u32) -> u32 {
        self.block(draw / 4)[(draw % 4) as usize]
    }

    /// Uniform `f32` in [0, 1), a multiple of 2⁻²⁴: the upper 24 bits of [`Self::word`].
    #[inline]
    pub fn uniform_f32(self, draw: u32) -> f32 {
        const SCALE: f32 = 1.0 / (1 << 24) as f32;
        // 24 bits are the precision of `f32`: each value is exact, and 1 is never reached.
        (self.word(draw) >> 8) as f32 * SCALE
    }

    /// Uniform `f64` in [0, 1), a multiple of 2⁻⁵³. Draws 2k and 2k + 1 are words (0, 1) and (2, 3) of block k,
    /// the first word of each the less significant.
    #[inline]
    pub fn uniform(self, draw: u32) -> f64 {
        self.uniform_pair(draw / 2)[(draw % 2) as usize]
    }

    /// Standard normal `f64` by the Box–Muller transform (Box and Muller 1958): with (u, v) the two uniforms of
    /// block k, draw 2k is √(−2 ln(1 − u))·cos 2πv and draw 2k + 1 the same with sin. |draw| ≤ 8.6.
    #[inline]
    pub fn normal(self, draw: u32) -> f64 {
        self.normal_pair(draw / 2)[(draw % 2) as usize]
    }

    /// Fills `out` with the standard normals of draws `first`, `first + 1`, …; two a block.
    /// Keep `first + out.len()` at or below 2³²; above it the blocks do not repeat but have no draw number.
    pub fn fill_normals(self, first: u32, out: &mut [f64]) {
        // An odd start takes the second half of its block.
        let head = out.len().min((first % 2) as usize);
        let (head, rest) = out.split_at_mut(head);
        for value in &mut *head {
            *value = self.normal(first);
        }
        // Whole pairs begin with the next even draw.
        let mut block = first.div_ceil(2);
        for pair in rest.chunks_mut(2) {
            let values = self.normal_pair(block);
            pair.copy_from_slice(&values[..pair.len()]);
            block = block.wrapping_add(1);
        }
    }

    #[inline(always)]
    fn uniform_pair(self, block: u32) -> [f64; 2] {
        const SCALE: f64 = 1.0 / (1_u64 << 53) as f64;
        let [w0, w1, w2, w3] = self.block(block);
        // 53 bits are the precision of `f64`: each value is exact, and 1 is never reached.
        let join = |low: u32, high: u32| ((u64::from(high) << 32 | u64::from(low)) >> 11) as f64 * SCALE;
        [join(w0, w1), join(w2, w3)]
    }

    #[inline(always)]
    pub(crate) fn normal_pair(self, block: u32) -> [f64; 2] {
        let [u, v] = self.uniform_pair(block);
        // 1 − u lies in (0, 1] and is exact, so the logarithm is finite.
        // The smallest 1 − u is 2⁻⁵³, hence |draw| ≤ √(2 · 53 · ln 2) = 8.6.
        let radius = (-2.0 * ln(1.0 - u)).sqrt();
        let (cosine, sine) = cos_sin_turns(v);
        [radius * cosine, radius * sine]
    }
}

/// A seed for sub-run `index` of a run: independent of the parent's draws and of every other index.
#[inline]
pub fn derive_seed(seed: u64, purpose: Purpose, index: u32) -> u64 {
    // The purpose takes the environment's place; only seeds use `Purpose::SEED`, so no draw shares these
    // blocks.
    let [low, high, _, _] = Stream::new(seed, Purpose::SEED).environment(purpose.0).step(index).block(0);
    u64::from(high) << 32 | u64::from(low)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::collections::HashSet;

    const DRAWS: u32 = 200_000;

    fn normals(stream: Stream) -> Vec<f64> {
        (0..DRAWS).map(|draw| stream.normal(draw)).collect()
    }

    fn correlation(a: &[f64], b: &[f64]) -> f64 {
        a.iter().zip(b).map(|(x, y)| x * y).sum::<f64>() / a.len() as f64
    }

    /// Moments of N(0, 1): 0, 1, 0, 3. Bounds are five standard errors √(Var/n), Var = 1, 2, 15, 96.
    #[test]
    fn normal_moments() {
        let sample = normals(Stream::new(1, Purpose::CMAES));
        let moment = |power: i32| sample.iter().map(|x| x.powi(power)).sum::<f64>() / f64::from(DRAWS);
        let error = |variance: f64| 5.0 * (variance / f64::from(DRAWS)).sqrt();
        assert!(moment(1).abs() < error(1.0));
        assert!((moment(2) - 1.0).abs() < error(2.0));
        assert!(moment(3).abs() < error(15.0));
        assert!((moment(4) - 3.0).abs() < error(96.0));
    }

    /// Kolmogorov–Smirnov distance of the uniforms to [0, 1); 1.95/√n is passed with probability 0.999.
    #[test]
    fn uniforms_are_uniform() {
        let stream = Stream::new(2, Purpose::RESET);
        for sample in [
            (0..DRAWS).map(|draw| stream.uniform(draw)).collect::<Vec<_>>(),
            (0..DRAWS).map(|draw| f64::from(stream.uniform_f32(draw))).collect(),
        ] {
            let mut sorted = sample;
            sorted.sort_by(f64::total_cmp);
            assert!(sorted[0] >= 0.0 && sorted[sorted.len() - 1] < 1.0);
            let n = f64::from(DRAWS);
            let distance =
                sorted.iter().enumerate().map(|(i, u)| (u - (i as f64 + 0.5) / n).abs()).fold(0.0, f64::max);
            assert!(distance < 1.95 / n.sqrt(), "{distance}");
        }
    }

    /// Neighbouring addresses in every coordinate are uncorrelated (five standard errors).
    #[test]
    fn neighbours_are_independent() {
        let base = Stream::new(3, Purpose::TORQUE_NOISE).environment(5).step(9);
        let sample = normals(base);
        let others = [
            Stream { seed: 4, ..base },
            Stream { seed: 3 | 1 << 32, ..base },
            Stream { purpose: Purpose::LOG_SHIFT, ..base },
            base.environment(6),
            base.step(10),
            // The same numbers in swapped places.
            base.environment(9).step(5),
        ];
        let bound = 5.0 / f64::from(DRAWS).sqrt();
        for other in others {
            let value = correlation(&sample, &normals(other));
            assert!(value.abs() < bound, "{other:?}: {value}");
        }
        let lagged = correlation(&sample[1..], &sample[..sample.len() - 1]);
        let paired: f64 =
            sample.chunks(2).map(|pair| pair[0] * pair[1]).sum::<f64>() * 2.0 / f64::from(DRAWS);
        assert!(lagged.abs() < bound && paired.abs() < 2.0 * bound);
    }

    #[test]
    fn filled_normals_are_the_addressed_ones() {
        let stream = Stream::new(11, Purpose::CMAES).environment(3);
        for (first, len) in [(0, 7), (1, 8), (5, 1), (4, 0), (9, 2)] {
            let mut filled = vec![0.0; len];
            stream.fill_normals(first, &mut filled);
            for (i, value) in filled.iter().enumerate() {
                assert_eq!(value.to_bits(), stream.normal(first + i as u32).to_bits());
            }
        }
    }

    /// Recorded bits: a change here changes every recorded result.
    #[test]
    fn words_follow_the_documented_layout() {
        let stream = Stream::new(0x299f_31d0_a409_3822, Purpose(0x0370_7344));
        let stream = stream.environment(0x1319_8a2e).step(0x85a3_08d3);
        // The third published known answer, through the stream's addressing.
        assert_eq!(stream.block(0x243f_6a88), [0xd16c_fe09, 0x94fd_cceb, 0x5001_e420, 0x2412_6ea1]);
        let stream = Stream::new(0, Purpose(0));
        assert_eq!(stream.word(2), 0xbc57_ac4c);
        assert_eq!(stream.uniform(0), (0xe169_c58d_6627_e8d5_u64 >> 11) as f64 / (1_u64 << 53) as f64);
    }

    #[test]
    fn derived_seeds_differ() {
        let mut seen = HashSet::new();
        for seed in 0..50 {
            for index in 0..50 {
                assert!(seen.insert(derive_seed(seed, Purpose::RESTART, index)));
                assert!(seen.insert(derive_seed(seed, Purpose::CMAES, index)));
            }
        }
    }
}
