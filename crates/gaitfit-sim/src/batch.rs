//! Many floating robots under position targets: what policies are trained, evaluated and logged on.

use gaitfit_isa::selected;
use gaitfit_model::Model;
use gaitfit_physics::{Damping, IMU_PERIODS, Isa, Params, Preset, Settings, Tree, compile, delay_taps};

use crate::SimError;
use crate::motion::Motion;

/// Settings of a batch's integration.
#[derive(Clone, Debug, PartialEq)]
pub struct BatchOptions {
    /// Time between targets, s.
    pub control_dt: f64,
    /// Physics steps per control period.
    pub substeps: usize,
    /// Solver effort.
    pub preset: Preset,
    /// Physics step of the robot that the batch stands for, s; see [`Settings::emulated_step`]. Motions then report
    /// velocities as that robot's at the same moment. `None`: the batch is its own robot.
    pub emulated_step: Option<f64>,
    /// Largest actuation delay any robot may have, s (sizes the target history).
    pub max_delay: f64,
    /// Names of geoms whose positions are reported.
    pub tracked: Vec<String>,
    /// Instruction set; `None` takes the program's (see [`gaitfit_isa`]).
    pub isa: Option<Isa>,
}

impl Default for BatchOptions {
    fn default() -> Self {
        Self {
            control_dt: 0.02,
            substeps: 4,
            preset: Preset::Fast,
            emulated_step: None,
            max_delay: 0.0,
            tracked: Vec::new(),
            isa: None,
        }
    }
}

/// Max number of physics steps in a control period.
pub const MAX_SUBSTEPS: usize = 1000;
/// Longest control period and actuation delay, s.
const MAX_SECONDS: f64 = 1.0;

/// A compiled robot, from which an [`Engine`](crate::engine::Engine) makes tiles of environments. Robots of a tile may differ in all their
/// parameters; the tree is one.
pub struct Batch {
    model: Model,
    pub(crate) tree: Tree<f32>,
    isa: Isa,
    options: BatchOptions,
    pub(crate) taps: usize,
    /// Compiled pairs of the tracked geoms.
    pub(crate) tracked: Vec<usize>,
    geoms: Vec<usize>,
}

impl Batch {
    /// Compiles `model` for batches.
    ///
    /// # Errors
    /// Options out of range, an instruction set the machine lacks, a tracked geom that touches nothing, or a
    /// robot that cannot be stepped.
    pub fn new(model: &Model, options: BatchOptions) -> Result<Self, SimError> {
        let refuse = |option, value: String, must| Err(SimError::Option { option, value, must });
        if options.substeps == 0 || options.substeps > MAX_SUBSTEPS {
            // The texts repeat `MAX_SUBSTEPS` and `MAX_SECONDS`.
            return refuse("substeps", options.substeps.to_string(), "from 1 to 1000");
        }
        // Written with `!`, so that NaN is refused too.
        if !(options.control_dt > 0.0 && options.control_dt <= MAX_SECONDS) {
            return refuse("control_dt", options.control_dt.to_string(), "above 0 and at most 1 s");
        }
        if !(0.0..=MAX_SECONDS).contains(&options.max_delay) {
            return refuse("max_delay", options.max_delay.to_string(), "from 0 to 1 s");
        }
        let isa = options.isa.map_or_else(selected, Isa::checked)?;
        let plain = Settings::new(&model.options, options.preset);
        // Forces that act later than this step's velocities depend on its accelerations, whatever the file says of its own.
        let damping = match plain.damping {
            Damping::Explicit if options.emulated_step.is_some() => Damping::Folded,
            other => other,
        };
        let settings = Settings {
            timestep: options.control_dt / options.substeps as f64,
            emulated_step: options.emulated_step,
            implicit_actuators: plain.implicit_actuators || options.emulated_step.is_some(),
            damping,
            ..plain
        };
        let tree = compile::<f32>(model, &settings)?;
        // One entry a compiled pair: forces and places are reported pair by pair.
        let geoms: Vec<usize> = tree.model_pairs().iter().map(|&pair| model.pairs[pair].geom).collect();
        let mut tracked = Vec::with_capacity(options.tracked.len());
        for name in &options.tracked {
            // A geom that meets several grounds has its place in the first of its pairs.
            match geoms.iter().position(|&geom| model.geoms[geom].name == *name) {
                Some(pair) => tracked.push(pair),
                None => return refuse("a tracked geom", name.clone(), "a geom that may touch the ground"),
            }
        }
        // With an emulated step a drive reaches half a period further back.
        let taps = delay_taps(options.max_delay, options.control_dt, settings.emulated_step.is_some());
        Ok(Self { model: model.clone(), tree, isa, options, taps, tracked, geoms })
    }

    /// Refuses robots whose inertial units are later than the batch can have them: two control periods.
    ///
    /// # Errors
    /// Such a robot.
    pub fn check_imu_delay(&self, robots: &[Params<f64>]) -> Result<(), SimError> {
        let delay = robots.iter().fold(0.0f64, |max, robot| max.max(robot.robot.imu_delay));
        // 1e-9 accepts a delay of exactly two periods that rounding made longer.
        if delay <= IMU_PERIODS as f64 * self.options.control_dt * (1.0 + 1e-9) {
            return Ok(());
        }
        let must = "at most two control periods; lower the value, or the upper bound of `imu_delay` in a fit";
        Err(SimError::Option { option: "a robot's imu_delay (s)", value: delay.to_string(), must })
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Settings of its integration.
    pub fn options(&self) -> &BatchOptions {
        &self.options
    }

    /// Settings of the physics.
    pub fn settings(&self) -> &Settings {
        self.tree.settings()
    }

    /// Sent targets that a robot remembers.
    pub fn taps(&self) -> usize {
        self.taps
    }

    /// Places in [`Batch::contact_geoms`] of the geoms whose positions are reported.
    pub fn tracked(&self) -> &[usize] {
        &self.tracked
    }

    /// Instruction set in use.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Geoms that may touch the ground, by index in the model, in the order of [`Motion::normal_force`].
    pub fn contact_geoms(&self) -> &[usize] {
        &self.geoms
    }

    /// A motion's arrays for `environments` robots.
    pub fn motion(&self, environments: usize) -> Motion {
        Motion::new(environments, self.model.joints.len(), self.geoms.len(), self.tracked.len())
    }
}
