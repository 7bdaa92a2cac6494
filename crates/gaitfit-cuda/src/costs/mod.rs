//! What the costs of a fit are made of, for all candidates at once, from trajectories in the GPU's memory.
//!
//! [`Comparison`] computes the Wasserstein-1 distance of every dimension's pooled samples (the cost Wass) and the sums of
//! squared differences (MatchO, MatchS), unscaled, as `gaitfit_adapt::cost` does. Sums of squares have the CPU's bits;
//! distances differ from the CPU's by the rounding of the sum.

use crate::runtime::{Buffer, CudaError, Device, Kernel, Program, Shape, Stream};

/// Sizes of a comparison.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Candidates that are compared at once.
    pub candidates: usize,
    /// The robot's recordings.
    pub recordings: usize,
    /// Samples of a recording, the pre-roll included.
    pub samples: usize,
    /// Signals' dimensions: joint positions, velocities, actions, …, all one after the other.
    pub dimensions: usize,
    /// Samples at the beginning of each recording that do not count.
    pub skip: usize,
}

/// Sizes that cannot be compared.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum CostsError {
    /// The GPU or its driver.
    #[error(transparent)]
    Cuda(#[from] CudaError),
    /// An array of another length.
    #[error("`{array}` has {found} numbers, the sizes need {expected}")]
    Length {
        /// Which.
        array: &'static str,
        /// Needed.
        expected: usize,
        /// There.
        found: usize,
    },
    /// Nothing to compare, or more than the kernels count.
    #[error(
        "{0} numbers cannot be compared at once: give fewer candidates or shorter recordings, and at least one"
    )]
    Size(usize),
}

/// Threads of a block of `wasserstein`.
const THREADS: u32 = 512;
/// Max number of keys that a thread keeps in registers; with more, too many spill.
const MAX_ITEMS: usize = 101;
// Places of keys in shared memory are counted in 16 bits.
const _: () = assert!(MAX_ITEMS * (THREADS as usize) < 1 << 16);
/// Max bytes of static shared memory of the text.
const DECLARED: usize = 6400;

impl Sizes {
    fn signals(&self) -> usize {
        [self.recordings, self.samples, self.dimensions]
            .into_iter()
            .fold(self.candidates, usize::saturating_mul)
    }

    /// Numbers that a block of `wasserstein` sorts.
    fn sorted(&self) -> usize {
        self.recordings.saturating_mul(self.samples)
    }

    /// Keys of a thread of such a block, of this many threads. An odd number keeps neighbouring threads in different banks.
    pub fn items(&self, threads: u32) -> usize {
        self.sorted().div_ceil(threads as usize) | 1
    }

    fn check(&self) -> Result<(), CostsError> {
        let size = self.signals();
        let sorted = self.sorted();
        // The kernels count numbers and places in 32 bits.
        let max = u32::MAX as usize / 4;
        let small = sorted <= max && self.candidates.saturating_mul(self.recordings) <= max;
        let fits =
            // A grid has at most 65,535 blocks along y, one for each dimension.
            small && self.candidates <= max && self.dimensions <= 65_535 && size / self.samples.max(1) <= max;
        if size > 0 && fits { Ok(()) } else { Err(CostsError::Size(size)) }
    }
}

/// The program of [`Comparison`], whose threads sort this many keys each in shared memory; with 0 all keys are in global memory.
/// Products and sums are rounded one by one, as on the CPU.
pub fn program(items: usize) -> Program {
    let text = format!("#define ITEMS {items}\n{}", include_str!("kernels.cu"));
    Program::new("costs", text).option("--fmad=false")
}

/// Bytes of shared memory of a block of `wasserstein`: a thread counts 16 digits, with one count of padding.
pub fn shared(threads: u32, items: usize) -> u32 {
    // Counts of keys in shared memory have 16 bits, those of keys in global memory 32.
    let counts = 17 * threads;
    if items > 0 { 2 * counts + 4 * threads * items as u32 } else { 4 * counts }
}

/// The robot's side of the costs in a GPU's memory, and room for the results.
pub struct Comparison {
    sizes: Sizes,
    wasserstein: Kernel,
    squares_of: Kernel,
    sum_of: Kernel,
    /// Ascending, dimensions × counted samples.
    sorted: Buffer<f64>,
    /// Recordings × samples × dimensions.
    measured: Buffer<f64>,
    scratch: Buffer<u32>,
    distance: Buffer<f64>,
    squares: Buffer<f64>,
    sums: Buffer<f64>,
    shared: u32,
}

impl Comparison {
    /// With the robot's samples, `recordings × samples × dimensions`. For the distances those after the pre-roll of all
    /// recordings are pooled.
    ///
    /// # Errors
    /// [`CostsError`] if sizes do not fit each other or the GPU's memory.
    pub fn new(device: &Device, sizes: Sizes, measured: &[f64]) -> Result<Self, CostsError> {
        let expected = sizes.recordings * sizes.samples * sizes.dimensions;
        if measured.len() != expected {
            return Err(CostsError::Length { array: "measured", expected, found: measured.len() });
        }
        Self::with(device, sizes, &pooled(sizes, measured), measured)
    }

    /// With the robot's samples and those that count ascending, `dimensions` times as many numbers: of recordings that are
    /// shorter than `sizes.samples`, what is behind their end in `measured` is not looked at.
    ///
    /// # Errors
    /// As [`Comparison::new`].
    pub fn with(device: &Device, sizes: Sizes, sorted: &[f64], measured: &[f64]) -> Result<Self, CostsError> {
        sizes.check()?;
        let expected = sizes.recordings * sizes.samples * sizes.dimensions;
        if measured.len() != expected {
            return Err(CostsError::Length { array: "measured", expected, found: measured.len() });
        }
        // Before compiling, which takes longer than to see that the arrays do not fit.
        device.check_room(&Self::parts(device, sizes))?;
        let items = items(device, sizes);
        let module = device.load(&program(items))?;
        // One block of threads sorts and compares a dimension of a candidate.
        let blocks = sizes.candidates * sizes.dimensions;
        // The sort in global memory moves keys to and fro between two halves.
        let scratch = if items > 0 { 0 } else { blocks.saturating_mul(2 * sizes.sorted()) };
        // Squares are summed recording by recording, and then over recordings.
        let runs = sizes.candidates * sizes.recordings * sizes.dimensions;
        Ok(Self {
            sizes,
            wasserstein: module.kernel("wasserstein")?,
            squares_of: module.kernel("squared_differences")?,
            sum_of: module.kernel("sum_recordings")?,
            sorted: Buffer::from_slice(device, "sorted", sorted)?,
            measured: Buffer::from_slice(device, "measured", measured)?,
            scratch: Buffer::new(device, "keys", scratch)?,
            distance: Buffer::new(device, "distances", blocks)?,
            squares: Buffer::new(device, "squares", runs)?,
            sums: Buffer::new(device, "sums of squares", blocks)?,
            shared: shared(THREADS, items),
        })
    }

    /// Parts of the GPU's memory that it takes, by name, bytes.
    pub fn parts(device: &Device, sizes: Sizes) -> Vec<(&'static str, u64)> {
        let Sizes { candidates, recordings, samples, dimensions, .. } = sizes;
        let product =
            |factors: &[usize]| factors.iter().fold(1u64, |product, &one| product.saturating_mul(one as u64));
        let keys = if items(device, sizes) > 0 { 0 } else { sizes.sorted().saturating_mul(2) };
        vec![
            ("keys", product(&[4, candidates, dimensions, keys])),
            // Two arrays in double precision: as recorded, and sorted.
            ("measured", product(&[16, recordings, samples, dimensions])),
            // With the squares of each recording, their sum, and the distance.
            ("squares", product(&[8, candidates, recordings + 2, dimensions])),
        ]
    }

    fn expect(&self, signals: &Buffer<f32>, ends: &Buffer<u32>) -> Result<(), CostsError> {
        let runs = self.sizes.candidates * self.sizes.recordings;
        for (array, expected, found) in
            [("signals", self.sizes.signals(), signals.len()), ("ends", runs, ends.len())]
        {
            if expected != found {
                return Err(CostsError::Length { array, expected, found });
            }
        }
        Ok(())
    }

    /// Wasserstein-1 distance of every candidate and dimension, `candidates × dimensions`, unscaled. `signals`:
    /// candidates × recordings × samples × dimensions; `ends`: the sample of each candidate's recording at which the
    /// robot fell, or the number of samples. NaN where a sample that counts is not finite, or none counts.
    ///
    /// # Errors
    /// [`CostsError::Length`], or a failure of the GPU.
    pub fn distances(
        &mut self,
        stream: &Stream,
        signals: &Buffer<f32>,
        ends: &Buffer<u32>,
    ) -> Result<Vec<f64>, CostsError> {
        self.start_distances(stream, signals, ends, self.sizes.candidates, self.sizes.dimensions)?;
        Ok(self.distance.read(stream)?)
    }

    /// Computes the distances of the first candidates and of the first dimensions alone; [`Comparison::read_distances`]
    /// reads them.
    ///
    /// # Errors
    /// As [`Comparison::distances`].
    pub fn start_distances(
        &self,
        stream: &Stream,
        signals: &Buffer<f32>,
        ends: &Buffer<u32>,
        candidates: usize,
        compared: usize,
    ) -> Result<(), CostsError> {
        self.expect(signals, ends)?;
        let Sizes { recordings, samples, dimensions, skip, .. } = self.sizes;
        // Pooled over all recordings: the distance compares distributions and not times.
        let counted = self.sorted.len() / dimensions;
        let shape = Shape {
            grid: [candidates.min(self.sizes.candidates) as u32, compared.min(dimensions) as u32, 1],
            block: [THREADS, 1, 1],
            shared: self.shared,
        };
        self.wasserstein.launch(
            stream,
            shape,
            &[
                (recordings as u32).into(),
                (samples as u32).into(),
                (dimensions as u32).into(),
                (skip.min(samples) as u32).into(),
                signals.into(),
                ends.into(),
                (&self.sorted).into(),
                (counted as u32).into(),
                (&self.scratch).into(),
                (&self.distance).into(),
            ],
        )?;
        Ok(())
    }

    /// The distances last computed, `candidates × dimensions`.
    ///
    /// # Errors
    /// A failure of the GPU.
    pub fn read_distances(&self, stream: &Stream) -> Result<Vec<f64>, CostsError> {
        Ok(self.distance.read(stream)?)
    }

    /// Σ (simulated − measured)² over the samples that count, `candidates × recordings × dimensions`, unscaled.
    ///
    /// # Errors
    /// As [`Comparison::distances`].
    pub fn squared_differences(
        &mut self,
        stream: &Stream,
        signals: &Buffer<f32>,
        ends: &Buffer<u32>,
    ) -> Result<Vec<f64>, CostsError> {
        self.start_squares(stream, signals, ends)?;
        Ok(self.squares.read(stream)?)
    }

    /// As [`Comparison::squared_differences`], summed over recordings: `candidates × dimensions`.
    ///
    /// # Errors
    /// As [`Comparison::distances`].
    pub fn sums_of_squares(
        &mut self,
        stream: &Stream,
        signals: &Buffer<f32>,
        ends: &Buffer<u32>,
    ) -> Result<Vec<f64>, CostsError> {
        self.start_squares(stream, signals, ends)?;
        let Sizes { candidates, recordings, dimensions, .. } = self.sizes;
        self.sum_of.launch(
            stream,
            Shape::cover(candidates * dimensions, 64),
            &[
                (candidates as u32).into(),
                (recordings as u32).into(),
                (dimensions as u32).into(),
                (&self.squares).into(),
                (&self.sums).into(),
            ],
        )?;
        Ok(self.sums.read(stream)?)
    }

    fn start_squares(
        &self,
        stream: &Stream,
        signals: &Buffer<f32>,
        ends: &Buffer<u32>,
    ) -> Result<(), CostsError> {
        self.expect(signals, ends)?;
        let Sizes { candidates, recordings, samples, dimensions, skip } = self.sizes;
        self.squares_of.launch(
            stream,
            Shape::cover(candidates * recordings * dimensions, 64),
            &[
                (candidates as u32).into(),
                (recordings as u32).into(),
                (samples as u32).into(),
                (dimensions as u32).into(),
                (skip.min(samples) as u32).into(),
                signals.into(),
                ends.into(),
                (&self.measured).into(),
                (&self.squares).into(),
            ],
        )?;
        Ok(())
    }
}

/// Keys of a thread in shared memory and in its registers; 0 where they do not fit.
fn items(device: &Device, sizes: Sizes) -> usize {
    let available = usize::try_from(device.info().shared_memory).unwrap_or(0);
    let items = sizes.items(THREADS);
    let fits = items <= MAX_ITEMS && shared(THREADS, items) as usize + DECLARED <= available;
    if fits { items } else { 0 }
}

/// The robot's samples that count, ascending, dimension by dimension.
pub fn pooled(sizes: Sizes, measured: &[f64]) -> Vec<f64> {
    let Sizes { samples, dimensions, skip, .. } = sizes;
    let mut sorted = Vec::new();
    for dimension in 0..dimensions {
        let from = sorted.len();
        let rows = measured.chunks_exact(dimensions).enumerate();
        sorted.extend(rows.filter(|(row, _)| row % samples >= skip).map(|(_, row)| row[dimension]));
        sorted[from..].sort_by(f64::total_cmp);
    }
    sorted
}
