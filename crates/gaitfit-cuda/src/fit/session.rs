//! Candidates of one structure in a GPU's memory.

use std::sync::Arc;

use gaitfit_sim::Candidate;

use super::candidates::Measured;
use super::plan::{Plan, Sizes};
use super::scene::{Scene, Structure, Subject};
use super::tables::Tables;
use super::{FitError, Numbers};
use crate::costs::{self, Comparison};
use crate::emit::Class;
use crate::networks::Blocks;
use crate::physics::{Batch, Period};
use crate::ppo::{Id, Launch, Storage, Stored};
use crate::runtime::{Buffer, CudaError, Device, Graph, HostBuffer, Kernel, Stream};

/// Max number of samples whose steps are one graph; more are started one by one.
const MAX_RECORDED: usize = 16_384;
/// Share of the free memory that candidates may take.
const SHARE: f64 = 0.8;

/// Candidates of one structure.
pub(super) struct Session {
    pub physics: Physics,
    /// Candidates that were asked for; more than there is room for where they do not fit.
    pub asked: usize,
    /// The recordings.
    pub tables: Arc<Tables>,
    batch: Batch,
    plan: Plan,
    storages: Vec<Option<Storage>>,
    kernels: Vec<(&'static str, Kernel)>,
    comparison: Option<Comparison>,
    graph: Option<Graph>,
}

/// The physics of candidates of one structure, however many there are.
#[derive(Clone)]
pub(super) struct Physics {
    period: Arc<Period>,
    pub structure: Structure,
}

impl Physics {
    /// The physics of candidates like this one.
    pub fn new(subject: Subject<'_>, candidate: &Candidate) -> Result<Self, FitError> {
        Ok(Self { period: Arc::new(subject.period(candidate)?), structure: Structure::new(candidate) })
    }

    /// Candidates that fit into the GPU's free memory, `wanted` at most and 1 at least.
    fn capacity(
        &self,
        device: &Device,
        subject: Subject<'_>,
        tables: &Tables,
        wanted: usize,
    ) -> Result<usize, FitError> {
        let layout = self.period.layout();
        let of_class = |class: Class| {
            let times = match class {
                Class::Disturbance => self.period.substeps(),
                // All recordings of a candidate share its weights.
                Class::Weights => return 4 * layout.size(class),
                _ => 1,
            };
            4 * times * layout.size(class) * tables.recordings() / layout.environments()
        };
        let (samples, dimensions) = (tables.samples, tables.dimensions(subject));
        let sizes =
            costs::Sizes { candidates: 1, recordings: tables.recordings(), samples, dimensions, skip: 0 };
        let compared: u64 = Comparison::parts(device, sizes).iter().map(|(_, bytes)| bytes).sum();
        let each = Class::ALL.iter().map(|&class| of_class(class)).sum::<usize>()
            + 4 * tables.recordings() * samples * dimensions;
        let (free, _) = device.memory()?;
        let fit = (SHARE * free as f64 / (each as f64 + compared as f64)) as usize;
        // The costs count signals' samples in 32 bits.
        let max = (u32::MAX as usize / 8) / (tables.recordings() * dimensions).max(1);
        Ok(wanted.min(fit).min(max).max(1))
    }
}

impl Session {
    /// Room for `asked` candidates, or as many as fit.
    pub fn new(
        device: &Device,
        stream: &Stream,
        subject: Subject<'_>,
        physics: Physics,
        tables: Arc<Tables>,
        measured: Option<&Measured>,
        asked: usize,
    ) -> Result<Self, FitError> {
        let candidates = physics.capacity(device, subject, &tables, asked)?;
        let recordings = tables.recordings();
        let processors = usize::try_from(device.info().processors).unwrap_or(1).max(1);
        let environments = candidates * recordings;
        let batch = Batch::new(device, &physics.period, environments, candidates)?;
        let blocks = match subject {
            // A prediction's step has little to compute: there neighbouring threads shall read neighbouring robots.
            Subject::Predict(_) => Blocks { rows: Blocks::MAX_ROWS, ..Blocks::new(environments, processors) },
            _ => Blocks::new(environments, processors),
        };
        let (samples, tiles) = (tables.samples, batch.tiles());
        let sizes = |Blocks { rows, group }| Sizes { candidates, recordings, samples, tiles, rows, group };
        let scene = Scene::new(subject, &physics.period);
        let plan = Plan::new(&scene, &tables, sizes(blocks));
        let available = usize::try_from(device.info().shared_memory).unwrap_or(0);
        let too_wide = |plan: &Plan| plan.shared() + Blocks::DECLARED > available;
        let smallest = Blocks::SMALLEST;
        let plan = if too_wide(&plan) { Plan::new(&scene, &tables, sizes(smallest)) } else { plan };
        if too_wide(&plan) {
            return Err(FitError::TooWide { needed: plan.shared(), rows: smallest.rows, available });
        }
        // Only what this session adds: the batch has taken its memory above.
        let owned = plan.arrays.iter().zip(&plan.physics).filter(|(_, class)| class.is_none());
        let parts: Vec<(&str, u64)> = owned.map(|(array, _)| (array.name, array.bytes())).collect();
        device.check_room(&parts)?;
        let module = device.load(&plan.program)?;
        let kernels = module.kernels(plan.kernels())?;
        let storages = plan
            .arrays
            .iter()
            .zip(&plan.physics)
            .map(|(array, class)| match class {
                None => Storage::new(device, array).map(Some),
                Some(_) => Ok(None),
            })
            .collect::<Result<_, CudaError>>()?;
        let dimensions = tables.dimensions(subject);
        let compare = |measured: &Measured| {
            let sizes = costs::Sizes {
                candidates,
                recordings,
                samples: tables.samples,
                dimensions,
                skip: measured.skip,
            };
            Comparison::with(device, sizes, &measured.sorted, &measured.samples)
        };
        let comparison = measured.map(compare).transpose()?;
        let mut session = Self {
            physics: physics.clone(),
            asked,
            tables,
            batch,
            plan,
            storages,
            kernels,
            comparison,
            graph: None,
        };
        session.write_tables(stream)?;
        Ok(session)
    }

    /// Puts tables of the same sizes in the place of its own.
    pub fn take_tables(&mut self, stream: &Stream, tables: &Arc<Tables>) -> Result<(), CudaError> {
        if Arc::ptr_eq(&self.tables, tables) {
            return Ok(());
        }
        self.tables = Arc::clone(tables);
        self.write_tables(stream)
    }

    fn write_tables(&mut self, stream: &Stream) -> Result<(), CudaError> {
        let tables = Arc::clone(&self.tables);
        self.write(stream, "lengths", &tables.lengths)?;
        for (name, numbers) in &tables.singles {
            self.write(stream, name, numbers)?;
        }
        for (name, numbers) in &tables.doubles {
            self.write(stream, name, numbers)?;
        }
        Ok(())
    }

    /// Candidates there is room for.
    pub fn capacity(&self) -> usize {
        self.plan.sizes.candidates
    }

    /// Registers and bytes of local memory of a thread, of each kernel.
    pub fn resources(&self) -> Result<Vec<(String, i32, i32)>, CudaError> {
        let kernels = self.kernels.iter().map(|(_, kernel)| kernel).chain([self.batch.kernel()]);
        kernels
            .map(|kernel| Ok((kernel.name().to_owned(), kernel.registers()?, kernel.local_bytes()?)))
            .collect()
    }

    /// Bytes of the GPU's memory.
    pub fn bytes(&self) -> u64 {
        let arrays = self.plan.arrays.iter().zip(&self.storages).filter(|(_, storage)| storage.is_some());
        self.batch.bytes() as u64 + arrays.map(|(array, _)| array.bytes()).sum::<u64>()
    }

    fn storage(&mut self, name: &str) -> Option<&mut Storage> {
        let Id(number) = self.plan.array(name)?;
        self.storages.get_mut(number)?.as_mut()
    }

    fn write<T: Stored>(&mut self, stream: &Stream, name: &str, numbers: &[T]) -> Result<(), CudaError> {
        self.storage(name).map_or(Ok(()), |storage| storage.write(stream, numbers))
    }

    /// Starts the simulation of `candidates` candidates with these numbers on all recordings.
    pub fn run(&mut self, stream: &Stream, numbers: &Numbers, candidates: usize) -> Result<(), FitError> {
        let numbers = numbers.repeated(candidates, self.capacity());
        self.write(stream, "numbers", &numbers.params)?;
        self.write(stream, "factors", &numbers.factors)?;
        self.write(stream, "every", &numbers.every)?;
        self.write(stream, "seeds", &numbers.seeds)?;
        self.write(stream, "begins", &numbers.begins)?;
        // Subjects whose beginnings the tables hold have none of their own.
        if !numbers.starts.is_empty() {
            self.write(stream, "starts", &numbers.starts)?;
        }
        self.write(stream, "trust", &numbers.trust)?;
        self.write(stream, "deviation", &numbers.deviation)?;
        self.write(stream, "imus", &numbers.imus)?;
        // Robots without networks have no array of weights.
        if numbers.weights.iter().any(|weights| !weights.is_empty()) {
            self.batch.write_weights(stream, &numbers.weights)?;
        }
        // Recorded at the first run; arrays keep their addresses, so the graph serves all later ones.
        if self.graph.is_none() && self.plan.steps <= MAX_RECORDED {
            self.graph = Some(stream.record(|stream| self.start(stream))?);
        }
        match &mut self.graph {
            Some(graph) => graph.launch(stream)?,
            None => self.start(stream)?,
        }
        Ok(())
    }

    fn start(&self, stream: &Stream) -> Result<(), CudaError> {
        self.launch(stream, &self.plan.spread())?;
        for sample in 0..self.plan.steps {
            self.launch(stream, &self.plan.step(sample))?;
            if sample + 1 == self.plan.steps {
                break;
            }
            if let Some(disturb) = self.plan.disturb(sample) {
                self.launch(stream, &disturb)?;
            }
            self.batch.step(stream)?;
        }
        Ok(())
    }

    /// Starts one part of every step, for timing: `step`, `disturb`, `physics`, or `all`.
    pub fn start_part(&self, stream: &Stream, part: &str) -> Result<(), CudaError> {
        for sample in 0..self.plan.steps {
            match part {
                "all" if sample == 0 => self.start(stream)?,
                "all" => {}
                "step" => self.launch(stream, &self.plan.step(sample))?,
                "disturb" => {
                    if let Some(disturb) = self.plan.disturb(sample) {
                        self.launch(stream, &disturb)?;
                    }
                }
                _ => self.batch.step(stream)?,
            }
        }
        Ok(())
    }

    fn launch(&self, stream: &Stream, launch: &Launch) -> Result<(), CudaError> {
        launch.start(stream, &self.kernels, |number| match self.plan.physics[number] {
            Some(class) => Some(self.batch.numbers(class)),
            None => self.storages[number].as_ref().map(Storage::argument),
        })
    }

    fn results(&self) -> Option<(&Buffer<f32>, &Buffer<u32>)> {
        let storage = |name: &str| {
            let Id(number) = self.plan.array(name)?;
            self.storages.get(number)?.as_ref()
        };
        match (storage("signals"), storage("ends")) {
            (Some(Storage::F32(signals)), Some(Storage::U32(ends))) => Some((signals, ends)),
            _ => None,
        }
    }

    /// Copies the signals of the first `candidates` to `shown` and returns them, `candidates × recordings × samples × dimensions`.
    /// With them, where each recording ended.
    pub fn read<'a>(
        &self,
        stream: &Stream,
        candidates: usize,
        shown: &'a mut HostBuffer<f32>,
    ) -> Result<(&'a [f32], Vec<u32>), FitError> {
        let Some((signals, ends)) = self.results() else { return Ok(Default::default()) };
        let count = candidates * (signals.len() / self.capacity().max(1));
        shown.reserve(stream, count);
        signals.read_first(stream, &mut shown[..count])?;
        Ok((&shown[..count], ends.read(stream)?))
    }

    /// Compares the candidates: distances of the first `distances` of them and of the first `compared` dimensions; sums of
    /// squares of all, if `squares`. Each is `candidates × dimensions`. With them, where each recording ended.
    #[allow(clippy::type_complexity, reason = "three lists of numbers")]
    pub fn compare(
        &mut self,
        stream: &Stream,
        distances: usize,
        compared: usize,
        squares: bool,
    ) -> Result<(Vec<f64>, Vec<f64>, Vec<u32>), FitError> {
        // Taken out, because the results borrow the session.
        let mut comparison = self.comparison.take();
        let results = match (&mut comparison, self.results()) {
            (Some(comparison), Some((signals, ends))) => {
                // Distances are started and the squares after them; only then both are read, so the GPU is
                // not idle in between.
                if distances > 0 {
                    comparison.start_distances(stream, signals, ends, distances, compared)?;
                }
                let sums =
                    if squares { comparison.sums_of_squares(stream, signals, ends)? } else { Vec::new() };
                let distances = if distances > 0 { comparison.read_distances(stream)? } else { Vec::new() };
                (distances, sums, ends.read(stream)?)
            }
            _ => Default::default(),
        };
        self.comparison = comparison;
        Ok(results)
    }
}
