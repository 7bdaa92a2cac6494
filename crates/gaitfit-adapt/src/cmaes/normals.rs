//! Where standard normal draws come from.

use gaitfit_random::{Purpose, Stream, fill_normal_rows};

/// Standard normals by address. Must be a pure function of its arguments: a population is made anew on resumption.
pub trait NormalSource {
    /// Fills `out` (one entry a coordinate) for attempt `attempt` at candidate `candidate` of `generation`.
    fn fill(&self, generation: u32, candidate: u32, attempt: u32, out: &mut [f64]);

    /// Fills `out`, `candidates × width`, with the first attempt of every candidate.
    fn fill_all(&self, generation: u32, width: usize, out: &mut [f64]) {
        for (candidate, row) in out.chunks_mut(width).enumerate() {
            self.fill(generation, candidate as u32, 0, row);
        }
    }
}

/// The normals of [`gaitfit_random`] under one seed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct AddressedNormals {
    /// Seed of the run.
    pub seed: u64,
}

impl NormalSource for AddressedNormals {
    fn fill(&self, generation: u32, candidate: u32, attempt: u32, out: &mut [f64]) {
        let stream = Stream::new(self.seed, Purpose::CMAES).environment(candidate).step(generation);
        // Each attempt takes new draws: its own begin where the draws of the last attempt end.
        stream.fill_normals(attempt.wrapping_mul(out.len() as u32), out);
    }

    fn fill_all(&self, generation: u32, width: usize, out: &mut [f64]) {
        // The same bits, several candidates at once.
        fill_normal_rows(Stream::new(self.seed, Purpose::CMAES).step(generation), 0, width, out);
    }
}
