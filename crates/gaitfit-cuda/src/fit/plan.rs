//! A simulation of candidates as data: arrays, and the kernels of each step. A GPU runs it, and so does the test without
//! one.

use super::scene::{Scene, Subject};
use super::tables::Tables;
use super::text::program;
use crate::emit::Class;
use crate::networks::{Blocks, Networks};
use crate::ppo::{Array, Id, Kind, Launch, Value};
use crate::runtime::{Program, Shape};
use crate::walker::{kept, physics_arrays};
use gaitfit_sim::IMU_NUMBERS;

/// Threads of a block, where each has an environment.
const THREADS: u32 = 64;
/// Threads of a block of the kernel of predictions.
const THREADS_OF_PREDICTIONS: u32 = 256;

/// Sizes of a simulation.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sizes {
    /// Candidates.
    pub candidates: usize,
    /// Recordings.
    pub recordings: usize,
    /// Samples of the longest recording.
    pub samples: usize,
    /// Tiles of the physics.
    pub tiles: usize,
    /// Robots of a block of the policy's kernel, a multiple of 4.
    pub rows: usize,
    /// Robots of a thread of it, a multiple of 4 that divides `rows`.
    pub group: usize,
}

impl Sizes {
    /// Environments that are asked for.
    pub fn environments(&self) -> usize {
        self.candidates * self.recordings
    }

    fn blocks(&self) -> Blocks {
        Blocks { rows: self.rows, group: self.group }
    }
}

/// The kernel of a control step.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Step {
    /// The policy's: threads of a block, and bytes of shared memory.
    Walk(u32, u32),
    /// Predictions'.
    Predict,
    /// A clamped robot's.
    Replay,
}

/// Arrays and kernels of a simulation.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// The kernels.
    pub program: Program,
    /// All arrays.
    pub arrays: Vec<Array>,
    /// Class of numbers of the physics that each array is, if any.
    pub physics: Vec<Option<Class>>,
    /// Sizes.
    pub sizes: Sizes,
    /// Environments, with the copies that fill up the physics' blocks.
    places: usize,
    joints: usize,
    params: usize,
    /// Number of starts of each recording.
    starts: usize,
    /// Number of samples that are simulated.
    pub steps: usize,
    /// Physics steps of a control period, if torques disturb it.
    disturbed: Option<usize>,
    step: Step,
}

impl Plan {
    /// The plan of `sizes.candidates` candidates on the recordings of `tables`.
    pub fn new(scene: &Scene<'_>, tables: &Tables, sizes: Sizes) -> Self {
        let environments = sizes.environments();
        let logs = tables.earlier.is_some();
        let places = sizes.tiles * scene.period.layout().environments();
        let joints = scene.joints();
        // The batch of the physics owns the first arrays, which have a class; the session owns the others.
        let (mut physics, mut arrays): (Vec<_>, Vec<_>) = physics_arrays(scene.period, sizes.tiles)
            .into_iter()
            .map(|(class, array)| (Some(class), array))
            .unzip();
        let mut others = vec![
            ("numbers", Kind::F32, sizes.candidates * scene.params.len()),
            ("factors", Kind::F64, sizes.candidates * 3 * joints),
            ("every", Kind::U32, sizes.candidates),
            ("seeds", Kind::U32, 2 * sizes.candidates),
            ("begins", Kind::U32, if logs { environments } else { sizes.candidates }),
            ("deviation", Kind::F64, sizes.candidates),
            ("imus", Kind::F32, IMU_NUMBERS * sizes.candidates),
            ("lengths", Kind::U32, sizes.recordings),
        ];
        others.extend(tables.singles.iter().map(|(name, numbers)| (*name, Kind::F32, numbers.len())));
        others.extend(tables.doubles.iter().map(|(name, numbers)| (*name, Kind::F64, numbers.len())));
        let step = match scene.subject {
            Subject::Walk(walker, policy) => {
                others.push(("last_action", Kind::F32, places * walker.joints.len()));
                others.push(("past", Kind::F32, places * kept(&walker.observation)));
                let networks = Networks::new(policy);
                others.push(("recurrent", Kind::F32, places * networks.remembered));
                // No replay: these are not looked at.
                others.push(("gains", Kind::F64, 0));
                if logs {
                    others.push(("starts", Kind::F32, environments * (13 + 2 * joints)));
                }
                let shared = u32::try_from(networks.shared(sizes.rows)).unwrap_or(u32::MAX);
                Step::Walk(sizes.blocks().threads(), shared)
            }
            Subject::Predict(_) => {
                others.push(("trust", Kind::F64, sizes.candidates));
                // No replay: these are not looked at.
                others.push(("gains", Kind::F64, 0));
                others.push(("starts", Kind::F32, environments * (13 + 2 * joints)));
                Step::Predict
            }
            Subject::Replay(_) => Step::Replay,
        };
        others.push(("signals", Kind::F32, environments * sizes.samples * tables.dimensions(scene.subject)));
        others.push(("ends", Kind::U32, environments));
        for (name, kind, length) in others {
            arrays.push(Array { name, kind, length });
            physics.push(None);
        }
        Self {
            program: program(scene, logs, sizes.rows, sizes.group),
            arrays,
            physics,
            sizes,
            places,
            joints,
            params: scene.params.len(),
            starts: tables.starts,
            steps: tables.steps(),
            disturbed: (!scene.spots.disturbance.is_empty()).then(|| scene.period.substeps()),
            step,
        }
    }

    /// The array of this name.
    pub fn array(&self, name: &str) -> Option<Id> {
        self.arrays.iter().position(|array| array.name == name).map(Id)
    }

    fn launch(&self, kernel: &'static str, shape: Shape, numbers: &[usize], arrays: &[&str]) -> Launch {
        let word = |&number: &usize| Value::U32(u32::try_from(number).unwrap_or(u32::MAX));
        let arrays = arrays.iter().filter_map(|name| self.array(name)).map(Value::Array);
        Launch { kernel, shape, arguments: numbers.iter().map(word).chain(arrays).collect() }
    }

    fn columns(mut launch: Launch, count: usize) -> Launch {
        launch.shape.grid[1] = u32::try_from(count).unwrap_or(1);
        launch
    }

    /// The kernels of a plan: parameters, a step, and random torques.
    pub fn kernels(&self) -> Vec<&'static str> {
        match self.step {
            Step::Walk(..) => vec!["spread", "walk", "disturb"],
            Step::Predict => vec!["spread", "predict", "disturb"],
            Step::Replay => vec!["spread", "replay"],
        }
    }

    /// Bytes of shared memory of a block of the policy's kernel.
    pub fn shared(&self) -> usize {
        if let Step::Walk(_, shared) = self.step { shared as usize } else { 0 }
    }

    /// Before the first step: every environment's parameters.
    pub fn spread(&self) -> Launch {
        let numbers = [self.sizes.environments(), self.places, self.sizes.recordings];
        let arrays = ["numbers", "factors", "gains", "robot_params"];
        Self::columns(
            self.launch("spread", Shape::cover(self.places, THREADS), &numbers, &arrays),
            self.params,
        )
    }

    /// The launch that records and sends at sample `sample`, before the physics of its control period.
    pub fn step(&self, sample: usize) -> Launch {
        let Sizes { recordings, samples, .. } = self.sizes;
        let numbers = [sample, self.sizes.environments(), self.places, recordings, samples];
        let blocks = self.sizes.blocks().count(self.places);
        match self.step {
            Step::Walk(threads, shared) => {
                let shape = Shape { shared, ..Shape::new(blocks, threads) };
                let arrays = [
                    "lengths",
                    "commands",
                    "starts",
                    "begins",
                    "states",
                    "actions",
                    "every",
                    "imus",
                    "network",
                    "robot_params",
                    "robot_report",
                    "robot_state",
                    "robot_targets",
                    "robot_memory",
                    "last_action",
                    "past",
                    "recurrent",
                    "signals",
                    "ends",
                    // Launches leave out arrays that a plan does not have.
                    "motion_places",
                ];
                let numbers = [&numbers[..], &[self.starts]].concat();
                self.launch("walk", shape, &numbers, &arrays)
            }
            Step::Predict => {
                let arrays = [
                    "lengths",
                    "every",
                    "logged",
                    "readings",
                    "legs",
                    "trust",
                    "starts",
                    "factors",
                    "imus",
                    "robot_params",
                    "robot_report",
                    "robot_state",
                    "robot_targets",
                    "robot_memory",
                    "signals",
                    "ends",
                ];
                self.launch("predict", Shape::new(blocks, THREADS_OF_PREDICTIONS), &numbers, &arrays)
            }
            Step::Replay => {
                let shape = Shape::cover(self.places * self.joints, THREADS);
                let arrays = [
                    "lengths",
                    "logged",
                    "velocities",
                    "rest",
                    "factors",
                    "gains",
                    "robot_params",
                    "robot_state",
                    "robot_targets",
                    "robot_memory",
                    "signals",
                    "ends",
                ];
                self.launch("replay", shape, &numbers, &arrays)
            }
        }
    }

    /// Random torques of the control period after sample `sample`, where there are some.
    pub fn disturb(&self, sample: usize) -> Option<Launch> {
        let substeps = self.disturbed?;
        let Sizes { recordings, tiles, .. } = self.sizes;
        let numbers = [sample, self.sizes.environments(), self.places, recordings, tiles];
        let arrays = ["seeds", "deviation", "robot_disturbance"];
        let launch = self.launch("disturb", Shape::cover(self.places, THREADS), &numbers, &arrays);
        Some(Self::columns(launch, substeps))
    }
}
