//! One robot's control period as a program for a GPU.

use gaitfit_model::Model;
use gaitfit_physics::trace::{Input, Known, PeriodGraph, Report, Traced, record_period_with};
use gaitfit_physics::{JointModification, SensorPlaces, Settings, Slot, compile};

use super::{DeviceError, Shared};
use crate::emit::{EmitOptions, KERNEL, Layout, PeriodProgram, Seating, cuda, has_two_texts, tables};
use crate::runtime::Program;

/// Threads of a block. Two warps: the number makes no difference up to 128.
pub(super) const BLOCK: usize = 64;
/// Threads that a multiprocessor runs at once, for a step takes all registers that a thread may have (255 of 65,536).
const THREADS_PER_PROCESSOR: usize = 256;

/// Settings of a period's program.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PeriodOptions {
    /// Physics steps in the period.
    pub substeps: usize,
    /// Sent targets that act in it; more than one for delays (see [`gaitfit_physics::delay_taps`]).
    pub taps: usize,
    /// Threads of an environment at most: 4, 2 or 1.
    pub lanes: usize,
    /// Options for making the text.
    pub emit: EmitOptions,
}

/// Max number of operations of a program for two threads an environment: text much longer than this does not fit the
/// GPU's cache of instructions, nor its numbers the registers.
const LONGEST_FOR_TWO: usize = 6000;

/// The program of one robot's control period.
#[derive(Clone, Debug)]
pub struct Period {
    pub(crate) graph: PeriodGraph,
    pub(super) shared: PeriodProgram,
    pub(super) layout: Layout,
    /// Whether each number that networks remember is of a network asked for.
    pub(crate) memory: Vec<bool>,
    /// Whether each weight of networks is of a network asked for.
    pub(super) weights: Vec<bool>,
    /// Parameters that are constants of the program.
    pub(super) fixed: Vec<(Slot, f64)>,
    joints: usize,
    taps: usize,
    substeps: usize,
    sensors: SensorPlaces,
    text: String,
}

impl Period {
    /// Writes the program. Where limbs cannot be shared among as many threads as asked for, fewer are taken. Networks may
    /// be on the joints of one limb alone.
    ///
    /// # Errors
    /// A robot that cannot be stepped.
    pub fn new(
        model: &Model,
        settings: &Settings,
        options: PeriodOptions,
        modifications: &[JointModification<Known>],
    ) -> Result<Self, DeviceError> {
        Self::reporting(model, settings, options, modifications, &Report::default())
    }

    /// As [`Period::new`], and the program also writes what `report` asks for.
    ///
    /// # Errors
    /// As there.
    pub fn reporting(
        model: &Model,
        settings: &Settings,
        options: PeriodOptions,
        modifications: &[JointModification<Known>],
        report: &Report,
    ) -> Result<Self, DeviceError> {
        let tree = compile::<Traced>(model, settings)?;
        let outline = tree.outline();
        let alone = Seating::alone(&outline);
        // The most lanes first: if its limbs turn out unlike, fewer lanes or one may still fit.
        let lanes = [4, 2].into_iter().filter(|&lanes| lanes <= options.lanes);
        let seatings: Vec<Seating> = lanes.filter_map(|lanes| Seating::shared(&outline, lanes)).collect();
        let whole = Shared::new(modifications, seatings.first().unwrap_or(&alone), tree.joints());
        let Shared { modifications, memory, weights } = whole;
        let sensors = SensorPlaces::new(&modifications);
        let graph = record_period_with(&tree, options.taps, options.substeps, &modifications, report)?;
        let program = |seating: &Seating| PeriodProgram::new(&graph, seating, options.emit);
        let shared = match seatings.iter().find_map(|seating| program(seating).ok()) {
            Some(shared) => shared,
            None => program(&alone)?,
        };
        let layout = Layout::new(&graph, &shared)?;
        let text = cuda(&shared, &layout, BLOCK);
        Ok(Self {
            graph,
            shared,
            layout,
            memory,
            weights,
            fixed: report.fixed.clone(),
            joints: tree.joints(),
            taps: options.taps,
            substeps: options.substeps,
            sensors,
            text,
        })
    }

    /// The program for this many environments: four threads each until two would occupy three quarters of the GPU, for
    /// few environments want many threads, of which each has less to do, and many want few, with fewer sums over
    /// threads. Long programs, of all of a robot's geoms, keep four. `options.lanes` is not looked at. `processors`: the
    /// GPU's multiprocessors.
    ///
    /// # Errors
    /// As [`Period::new`].
    pub fn for_environments(
        model: &Model,
        settings: &Settings,
        options: PeriodOptions,
        modifications: &[JointModification<Known>],
        report: &Report,
        environments: usize,
        processors: usize,
    ) -> Result<Self, DeviceError> {
        let period = |lanes| {
            Self::reporting(model, settings, PeriodOptions { lanes, ..options }, modifications, report)
        };
        let threads = THREADS_PER_PROCESSOR * processors;
        if 2 * environments >= threads - threads / 4 {
            let two = period(2)?;
            if two.operations() <= LONGEST_FOR_TWO {
                return Ok(two);
            }
        }
        period(4)
    }

    /// Threads of an environment.
    pub fn lanes(&self) -> usize {
        self.layout.lanes
    }

    /// Joints of the robot.
    pub fn joints(&self) -> usize {
        self.joints
    }

    /// Sent targets that act in the period.
    pub fn taps(&self) -> usize {
        self.taps
    }

    /// Physics steps in the period.
    pub fn substeps(&self) -> usize {
        self.substeps
    }

    /// Returns the places of the sensors among the numbers that modifications remember.
    pub(crate) fn sensors(&self) -> SensorPlaces {
        self.sensors
    }

    /// Inputs of the program, in the recording's order.
    pub fn inputs(&self) -> impl Iterator<Item = &Input> {
        self.graph.inputs.iter()
    }

    /// Returns the places of the numbers.
    pub fn layout(&self) -> &Layout {
        &self.layout
    }

    /// Operations of the program as it stands, for records.
    pub fn operations(&self) -> usize {
        self.shared.program.nodes.iter().filter(|node| node.op.arity() > 0).count()
    }

    /// The program for the device's compiler. Numbers too small for single precision's full range count as zero, as
    /// the fast reciprocals take them. Two texts of a loop must have the same bits: in them only what the text says is fused.
    pub fn program(&self) -> Program {
        let mut program = Program::new(KERNEL, self.text.clone()).option("-ftz=true");
        for (name, table) in tables(&self.graph.graph) {
            let numbers: Vec<f32> = table.iter().map(|&number| number as f32).collect();
            program = program.table(name, numbers);
        }
        if has_two_texts(&self.shared, &self.layout) { program.option("-fmad=false") } else { program }
    }
}
