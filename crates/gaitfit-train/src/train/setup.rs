//! Everything a training needs, read and checked before anything is written.

use super::results::Parent;
use crate::Error;
use crate::device::Devices;
use crate::robot::Hold;
use crate::run::inputs::Inputs;
use crate::settings::{MAX_SEED, Preset, TrainConfig};
use crate::{paths, robot, robot_file};
use gaitfit_learn::ppo::{self, Learner};
use gaitfit_learn::task::Task;
use gaitfit_learn::{Origin, Training, TrainingError, TrainingSettings};
use gaitfit_model::{Cone, Model};
use gaitfit_policy::{Policy, RobotFile};
use gaitfit_sim::Candidate;
use serde::Serialize;
use std::path::Path;
use toml::Table;

/// Everything a training needs, from nothing or from a policy.
pub struct Setup {
    /// The plan of the training.
    pub plan: Plan,
    /// The robot.
    pub model: Model,
    /// The robot around which robots are varied; that of the file if there is none.
    pub candidate: Option<Candidate>,
    /// Robots that they are varied around instead, each robot of the training around one of them; none without draws of
    /// fitted parameters.
    pub drawn: Vec<Candidate>,
    /// The task on it.
    pub scene: Task,
    /// Policy that the training continues from.
    pub start: Option<Start>,
    /// Inputs that the result depends on.
    pub inputs: Inputs,
    /// The robot's file, for the policies; absent for the built-in robot.
    pub robot_file: Option<RobotFile>,
    /// Threads.
    pub threads: usize,
    /// What computes; several share the seeds.
    pub devices: Devices,
    /// Things to know before the training.
    pub warnings: Vec<String>,
}

/// Plan of a training, whichever command asks for it.
pub struct Plan {
    /// Name of the run.
    pub name: String,
    /// Folder that holds the run folders.
    pub runs: String,
    /// One training each.
    pub seeds: Vec<u64>,
    /// Seconds between checkpoints.
    pub checkpoint_seconds: f64,
    /// Solver effort of the physics.
    pub preset: Preset,
    /// How much is trained.
    pub train: TrainingSettings,
    /// Networks and optimisation.
    pub ppo: ppo::Settings,
    /// The task's name.
    pub task: String,
    /// All settings.
    pub configuration: Table,
}

/// Policy that a training continues from.
pub struct Start {
    /// The policy.
    pub policy: Policy,
    /// Where it and the simulator come from.
    pub parent: Parent,
}

/// Max number of seeds in one call.
const MAX_SEEDS: usize = 1000;

/// Reads the robot and checks the settings of a training from nothing.
pub fn setup(
    config: &TrainConfig,
    name: &str,
    path: Option<&Path>,
    threads: usize,
    devices: &Devices,
) -> Result<Setup, Error> {
    let printed_by = "gaitfit config train";
    let mut config = config.clone();
    let mut plan = Plan {
        name: name.to_owned(),
        runs: config.runs.clone(),
        seeds: config.seeds.clone(),
        checkpoint_seconds: config.checkpoint_seconds,
        preset: config.preset,
        train: config.train.clone(),
        ppo: config.ppo.clone(),
        task: config.task.base.name().to_owned(),
        configuration: Table::new(),
    };
    plan.check().map_err(|wrong| Error::settings(advice(path, &wrong.to_string(), printed_by)))?;
    // Seeds beyond TOML's numbers are refused by name before they are written.
    plan.configuration = table(&config)?;
    let robot_path = match &config.robot {
        Some(named) => Some(paths::find(named, "robot", path.unwrap_or(Path::new("--set")))?),
        None => None,
    };
    let mut model = match &robot_path {
        Some(path) => robot::read(path, config.lenient, Hold::File)?,
        None => robot::go2()?,
    };
    if let Some(cone) = config.cone {
        model.options.cone = cone;
        if cone == Cone::Pyramidal {
            // A file's large `impratio` is meant for its elliptic cones, and scales pyramidal edges too.
            model.options.impratio = 1.0;
        }
    }
    let settled = config.task.settle(&model, config.robot.as_deref());
    settled.map_err(|wrong| Error::settings(advice(path, &wrong, printed_by)))?;
    // Again: `settle` has chosen between the Go2's settings and the robot's own.
    plan.configuration = table(&config)?;
    let refused = |error: TrainingError| refused(path, &error, printed_by);
    let scene =
        Task::new(&model, &config.task.settings, config.preset).map_err(|error| refused(error.into()))?;
    if scene.walker.interface.critic_observation.is_empty() {
        let wrong = "task.policy.critic_observation has no terms; list what the critic sees";
        return Err(Error::settings(advice(path, wrong, printed_by)));
    }
    let inputs = Inputs::new(robot_path.as_deref(), &model, &settings(&config))?;
    let robot_file =
        robot_path.as_deref().map(|path| robot_file::record(path, config.lenient)).transpose()?;
    let mut warnings = robot::remarks(&model);
    warnings.extend(scene.remarks.iter().cloned());
    let mut setup = Setup {
        plan,
        model,
        candidate: None,
        drawn: Vec::new(),
        scene,
        start: None,
        inputs,
        robot_file,
        threads,
        devices: devices.clone(),
        warnings,
    };
    // Any seed: this only shows whether the settings fit.
    setup.learner(0).map_err(refused)?;
    setup.settle_device()?;
    Ok(setup)
}

/// The settings without those that do not change what an iteration does: where results go, how often they are
/// saved, how many seeds and iterations there are. The robot counts as what it is, not by its file's name.
fn settings(config: &TrainConfig) -> TrainConfig {
    let mut settings = config.clone();
    settings.name = None;
    settings.robot = None;
    settings.lenient = false;
    settings.runs = String::new();
    settings.seeds = Vec::new();
    settings.checkpoint_seconds = 0.0;
    settings.train.iterations = 0;
    settings
}

/// A configuration as a TOML table.
pub fn table<C: Serialize>(config: &C) -> Result<Table, Error> {
    Table::try_from(config).map_err(|error| Error::failed(format!("cannot write the configuration: {error}")))
}

impl Setup {
    /// Origin of the checkpoints of `seed`.
    pub fn origin(&self, seed: u64) -> Origin {
        Origin {
            robot: self.model.name.clone(),
            model: self.inputs.model.clone(),
            settings: self.inputs.settings.clone(),
            seed,
        }
    }

    /// Takes the processor where `auto` found a GPU that does not train what is asked for, and of several GPUs those that
    /// have a seed to train, alone or with others.
    ///
    /// # Errors
    /// A GPU that was asked for and does not; robots that GPUs cannot share evenly.
    pub(crate) fn settle_device(&mut self) -> Result<(), Error> {
        let candidates = if self.drawn.is_empty() { self.candidate.as_slice() } else { &self.drawn };
        let (device, note) = self.devices.first().for_training(&self.scene, candidates)?;
        self.warnings.splice(0..0, note);
        // The first device decides for all: where it cannot train this, the others are not asked.
        if !self.devices.are_gpus() || device.gpu().is_none() {
            self.devices = device.into();
            return Ok(());
        }
        // Seeds run side by side, each on a group of GPUs; groups of one size finish together.
        let (asked, seeds) = (self.devices.all().len(), self.plan.seeds.len());
        self.devices = self.devices.in_groups(seeds);
        let used = self.devices.all().len();
        if used < asked {
            self.warnings.push(format!(
                "each of the {seeds} seeds is trained on equally many GPUs: of {asked} GPUs {} are used",
                self.devices
            ));
        }
        let (each, robots) = (used / self.devices.groups(seeds).len(), self.plan.train.environments);
        if !robots.is_multiple_of(each) {
            let fewer = robots / each * each;
            let fewer = if fewer > 0 { format!("{fewer} or ") } else { String::new() };
            return Err(Error::settings(format!(
                "train.environments = {robots} robots cannot be shared evenly among {each} GPUs ({}); take {fewer}{}, or \
                 name other GPUs with --device",
                self.devices,
                robots / each * each + each
            )));
        }
        Ok(())
    }

    /// The learner that `seed` begins with.
    ///
    /// # Errors
    /// PPO settings out of range, or a policy that they do not fit.
    pub fn learner(&self, seed: u64) -> Result<Learner, TrainingError> {
        match &self.start {
            Some(start) => Training::learner_from(&self.scene, &self.plan.ppo, &start.policy, seed),
            None => Training::fresh_learner(&self.scene, &self.plan.ppo, seed),
        }
    }
}

impl Plan {
    /// Whether the policy's actions change at all: in its first updates only the critic may learn.
    pub fn trains(&self) -> bool {
        self.train.iterations > self.ppo.critic_warmup.unwrap_or(0)
    }

    /// Why the policy stays as it is, if it does, and what to do.
    pub fn untrained(&self) -> Option<String> {
        let warmup = self.ppo.critic_warmup.unwrap_or(0);
        (!self.trains()).then(|| {
            format!(
                "the policy is not trained: the first {warmup} updates teach the critic alone, so {} iterations leave \
                 the policy as it was; raise train.iterations or lower ppo.critic_warmup",
                self.train.iterations
            )
        })
    }

    /// Refuses settings out of range.
    pub fn check(&self) -> Result<(), Error> {
        let seeds = &self.seeds;
        // Saturating, because both numbers come from a user and are checked only below.
        let samples = self.train.environments.saturating_mul(self.train.steps);
        let wrong = if seeds.is_empty() || seeds.len() > MAX_SEEDS {
            format!("`seeds` has {} numbers; give 1 to {MAX_SEEDS}", seeds.len())
        // Two equal seeds would write the same files.
        } else if let Some(twice) = (1..seeds.len()).find(|&index| seeds[..index].contains(&seeds[index])) {
            format!("`seeds` has {} twice", seeds[twice])
        } else if let Some(large) = seeds.iter().find(|&&seed| seed > MAX_SEED) {
            format!("`seeds` has {large}; a seed is at most {MAX_SEED}")
        } else if self.runs.is_empty() {
            "`runs` names no folder; \".\" is the current one".to_owned()
        } else if !(self.checkpoint_seconds >= 0.0 && self.checkpoint_seconds.is_finite()) {
            "`checkpoint_seconds` must be at least 0".to_owned()
        } else if self.train.iterations == 0 {
            "`train.iterations` must be at least 1".to_owned()
        // 0 samples are refused by name below.
        } else if samples > 0 && samples < self.ppo.minibatches {
            format!(
                "{samples} samples a rollout (`train.environments` × `train.steps`) cannot fill {} minibatches; raise \
                 either, or lower `ppo.minibatches`",
                self.ppo.minibatches
            )
        } else {
            let train = self.train.check();
            let memory = self.ppo.memory.map(|_| self.train.check_sequences(self.ppo.minibatches));
            return train.and(memory.unwrap_or(Ok(()))).map_err(Error::settings);
        };
        Err(Error::settings(wrong))
    }
}

/// Message about a configuration that is wrong: the file, the fault, and the command that prints a correct
/// one.
pub fn advice(path: Option<&Path>, wrong: &str, printed_by: &str) -> String {
    let wrong = wrong.trim_end_matches('.');
    let place = path.map(|path| format!("{}: ", path.display())).unwrap_or_default();
    format!("{place}{wrong}. `{printed_by}` shows every setting.")
}

/// A setting that cannot be, or a robot that does not fit the task.
pub fn refused(path: Option<&Path>, error: &TrainingError, printed_by: &str) -> Error {
    let text = match error {
        TrainingError::Learner(error) => format!("[ppo] {error}"),
        error => error.to_string(),
    };
    Error::settings(advice(path, &text, printed_by))
}
