//! Replaying logged position targets on candidate robots: the in-air identification experiment.

use gaitfit_isa::selected;
use gaitfit_model::{Cone, Model};
use gaitfit_physics::{Damping, Isa, Preset, Robot, Settings, Tree, compile, delay_taps};

use crate::SimError;
use crate::batch::MAX_SUBSTEPS;

/// One log to replay, in the MODEL's joint order.
#[derive(Clone, Debug, PartialEq)]
pub struct Recording {
    /// Control period, s: target `i` is sent at sample `i` and held until sample `i + 1`.
    pub dt: f64,
    /// Joint positions at sample 0 as the encoders report them, rad; one a joint.
    pub q0: Vec<f64>,
    /// Joint velocities at sample 0, rad/s; one a joint.
    pub dq0: Vec<f64>,
    /// Position targets, rad; `samples × joints`, row-major.
    pub target: Vec<f64>,
    /// Position gain while recording, N·m/rad; one a joint.
    pub kp: Vec<f64>,
    /// Velocity gain while recording, N·m·s/rad; one a joint.
    pub kd: Vec<f64>,
}

/// Settings of a replay's integration.
#[derive(Clone, Debug, PartialEq)]
pub struct ReplayOptions {
    /// Physics steps per control period.
    pub substeps: usize,
    /// Solver effort.
    pub preset: Preset,
    /// Largest actuation delay any candidate may have, s (sizes the target history).
    pub max_delay: f64,
    /// Instruction set; `None` takes the program's (see [`gaitfit_isa`]).
    pub isa: Option<Isa>,
}

impl Default for ReplayOptions {
    fn default() -> Self {
        Self { substeps: 1, preset: Preset::Fast, max_delay: 0.0, isa: None }
    }
}

/// Simulated joint signals of one candidate on one recording; `samples × joints`, row-major, model joint order.
/// Row 0 is the initial state. A simulation that diverged holds values that are not finite.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct JointSignals {
    /// Encoder positions (true position plus encoder bias), rad.
    pub position: Vec<f32>,
    /// Joint velocities, rad/s.
    pub velocity: Vec<f32>,
}

/// A robot and a direction in which it changes, given by two robots close to it: on its two sides, or it and one beside.
/// Their numbers, not their simulations, are taken for the rate at which the robot changes.
#[derive(Clone, Debug, PartialEq)]
pub struct Direction {
    /// The robot.
    pub robot: Robot,
    /// A robot further along.
    pub ahead: Robot,
    /// A robot before.
    pub behind: Robot,
    /// Distance of `ahead` from `behind`, in the unit of the direction.
    pub distance: f64,
}

/// Max number of samples of one recording.
const MAX_SAMPLES: usize = 10_000_000;
/// Longest actuation delay, s.
const MAX_DELAY: f64 = 1.0;

/// A robot and the recordings to replay on its candidates, which an [`Engine`](crate::engine::Engine) does.
///
/// The PD controller and joint damping are integrated centred in time and implicitly: light joints with high
/// gains stay stable at the logs' own rate, and fitted inertias and dampings do not absorb the step's length.
pub struct Replay {
    pub(crate) model: Model,
    pub(crate) recordings: Vec<Recording>,
    pub(crate) options: ReplayOptions,
    pub(crate) tree: Tree<f32>,
    isa: Isa,
    pub(crate) taps: usize,
}

impl Replay {
    /// Checks the recordings against the model and compiles it.
    ///
    /// # Errors
    /// [`SimError::Recording`] names the recording and what is wrong with it.
    pub fn new(model: &Model, recordings: Vec<Recording>, options: ReplayOptions) -> Result<Self, SimError> {
        if options.substeps == 0 || options.substeps > MAX_SUBSTEPS {
            // The texts repeat `MAX_SUBSTEPS` and `MAX_DELAY`.
            let value = options.substeps.to_string();
            return Err(SimError::Option { option: "substeps", value, must: "from 1 to 1000" });
        }
        if !(0.0..=MAX_DELAY).contains(&options.max_delay) {
            let value = options.max_delay.to_string();
            return Err(SimError::Option { option: "max_delay", value, must: "from 0 to 1 s" });
        }
        let isa = options.isa.map_or_else(selected, Isa::checked)?;
        // Without a recording there is no period to compile the robot for.
        let first = recordings.first().ok_or(SimError::Recording {
            index: 0,
            what: "there are no recordings; give at least one log".to_owned(),
        })?;
        let dt = first.dt;
        for (index, recording) in recordings.iter().enumerate() {
            check(recording, model.joints.len(), dt).map_err(|what| SimError::Recording { index, what })?;
        }
        let settings = Settings {
            // All recordings share one compiled robot, and its step has the period of the first one.
            timestep: dt / options.substeps as f64,
            cone: Cone::Pyramidal,
            damping: Damping::Folded,
            centred: true,
            implicit_actuators: true,
            ..Settings::new(&model.options, options.preset)
        };
        let tree = compile::<f32>(model, &settings)?;
        // Centred drives reach half a period further back.
        let taps = delay_taps(options.max_delay, dt, true);
        Ok(Self { model: model.clone(), recordings, options, tree, isa, taps })
    }

    /// The recordings.
    pub fn recordings(&self) -> &[Recording] {
        &self.recordings
    }

    /// The robot.
    pub fn model(&self) -> &Model {
        &self.model
    }

    /// Settings of its integration.
    pub fn options(&self) -> &ReplayOptions {
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

    /// Instruction set in use.
    pub fn isa(&self) -> Isa {
        self.isa
    }

    /// Physics steps that one candidate costs.
    pub fn steps_per_candidate(&self) -> usize {
        let joints = self.model.joints.len();
        // A recording of n samples has n − 1 periods.
        self.recordings.iter().map(|r| (r.target.len() / joints - 1) * self.options.substeps).sum()
    }
}

fn check(recording: &Recording, joints: usize, dt: f64) -> Result<(), String> {
    // The divisor is kept from 0; the next line refuses a robot without joints.
    let samples = recording.target.len() / joints.max(1);
    if joints == 0 || !recording.target.len().is_multiple_of(joints) {
        return Err(format!("{} target values are not rows of {joints} joints", recording.target.len()));
    }
    // Row 0 is the initial state, which matches in any case.
    if samples < 2 {
        return Err("fewer than two samples; nothing can be compared".to_owned());
    }
    if samples > MAX_SAMPLES {
        return Err(format!("{samples} samples are more than {MAX_SAMPLES}; cut the log"));
    }
    for (name, values) in
        [("q0", &recording.q0), ("dq0", &recording.dq0), ("kp", &recording.kp), ("kd", &recording.kd)]
    {
        if values.len() != joints {
            return Err(format!("{name} has {} entries for {joints} joints", values.len()));
        }
    }
    let numbers = [&recording.q0, &recording.dq0, &recording.kp, &recording.kd, &recording.target];
    if numbers.into_iter().flatten().any(|x| !x.is_finite()) {
        return Err("a value is not finite; cut the samples or fill the gap".to_owned());
    }
    if !(recording.dt.is_finite() && recording.dt > 0.0) {
        return Err(format!("sample period {} s is not positive", recording.dt));
    }
    // All recordings run with the first one's period, so a larger difference would shift their times.
    if (recording.dt / dt - 1.0).abs() > 0.01 {
        return Err(format!(
            "sample period {} s differs from the first recording's {dt} s; resample the log",
            recording.dt
        ));
    }
    Ok(())
}
