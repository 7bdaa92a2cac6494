//! The simulated robot that a policy is run on: robot file, task, fitted parameters, springs, noise.

use crate::Error;
use crate::robot::{self, Hold};
use crate::settings::PresetName;
use crate::theta;
use gaitfit_learn::evaluate::Subject;
use gaitfit_learn::task::{Task, TaskSettings, preset};
use gaitfit_model::Model;
use gaitfit_policy::Policy;
use gaitfit_sim::Candidate;
use std::path::PathBuf;

/// A policy and the simulator it runs in.
#[derive(Clone, Debug)]
pub struct WorldSettings {
    /// The policy's file.
    pub policy: PathBuf,
    /// Robot file; the built-in Go2 without one.
    pub robot: Option<PathBuf>,
    /// Drop what the engine does not honour in the robot file, instead of refusing it.
    pub lenient: bool,
    /// Task: `velocity`, `biped`, or a file with a task's settings; the policy's own without one.
    pub task: Option<String>,
    /// Fitted parameters, a theta.toml.
    pub theta: Option<PathBuf>,
    /// Springs on joints: `JOINT=STIFFNESS` or `JOINT=STIFFNESS@REST`, N·m/rad and rad.
    pub spring: Vec<String>,
    /// Standard deviation of Gaussian torques at every joint and physics step, N·m.
    pub torque_noise: f64,
    /// Vary robots, starts and observations as in training, with pushes.
    pub randomised: bool,
    /// Solver effort.
    pub preset: PresetName,
    /// Seed of commands, starts and noise.
    pub seed: u64,
    /// Threads; none takes one a core.
    pub threads: Option<std::num::NonZeroUsize>,
}

/// A policy and the simulator it runs in.
pub struct World {
    /// The policy.
    pub policy: Policy,
    /// Task and simulator.
    pub scene: Task,
    /// The robot, fitted parameters and noise included.
    pub candidate: Candidate,
    /// What differs from the nominal robot, for reports.
    pub changes: Vec<String>,
    /// Things to know before trusting what it shows.
    pub warnings: Vec<String>,
}

impl World {
    /// Reads everything the arguments name.
    pub fn open(args: &WorldSettings) -> Result<Self, Error> {
        let policy = gaitfit_policy::read(&args.policy).map_err(Error::failed)?;
        let settings = task(args, &policy)?;
        Self::with_task(args, policy, if args.randomised { settings } else { settings.calm() })
    }

    /// The simulator that the arguments name, for a policy and a task that are read already.
    pub fn with_task(args: &WorldSettings, policy: Policy, settings: TaskSettings) -> Result<Self, Error> {
        let mut changes = Vec::new();
        if args.randomised {
            changes.push("randomised as in training".to_owned());
        }
        let mut model = match &args.robot {
            Some(path) => robot::read(path, args.lenient, Hold::File)?,
            None => robot::go2()?,
        };
        let interface = &policy.interface;
        let joints = interface.resolve(&model).map_err(Error::failed)?;
        for text in &args.spring {
            let spring = Spring::parse(text)?;
            let joint =
                model.find_joint(&spring.joint).ok_or_else(|| no_joint(&model, &spring.joint, "--spring"))?;
            let home =
                joints.iter().position(|&index| index == joint).map(|index| interface.default_pose[index]);
            let rest = spring.rest.or(home).unwrap_or(0.0);
            let joint = &mut model.joints[joint];
            joint.stiffness = spring.stiffness;
            joint.springref = rest;
            changes.push(format!("spring {} N·m/rad about {rest} rad on {}", spring.stiffness, joint.name));
        }
        let theta = args.theta.as_deref().map(|path| Ok((path, theta::read(path)?))).transpose()?;
        let mut candidate = match &theta {
            Some((path, file)) => {
                changes.push(format!("parameters of {}", path.display()));
                theta::candidate(file, path, &model)?
            }
            None => Candidate::nominal(&model),
        };
        if !(0.0..=1000.0).contains(&args.torque_noise) {
            return Err(Error::settings(format!(
                "--torque-noise {} must be from 0 to 1000 N·m",
                args.torque_noise
            )));
        }
        if args.torque_noise > 0.0 {
            changes.push(format!("torque noise of {} N·m", args.torque_noise));
        }
        // Of independent torques the variances add.
        candidate.torque_noise = candidate.torque_noise.hypot(args.torque_noise);
        let delay = longest_delay(&candidate);
        let scene = Task::with_interface(&model, &settings, interface.clone(), args.preset.into(), delay)
            .map_err(Error::failed)?;
        let doubt =
            theta.and_then(|(path, file)| Some((path, file.step_doubt(scene.walker.physics_step())?)));
        let warnings = doubt.map(|(path, doubt)| format!("{}: {doubt}", path.display()));
        Ok(Self { policy, scene, candidate, changes, warnings: warnings.into_iter().collect() })
    }

    /// With robots that begin where a fit of their logs lets them begin: upright, facing along x (pyramidal friction
    /// cones are not quite the same in all directions), joints in the start's pose.
    pub fn with_plain_starts(mut self) -> Self {
        let start = &mut self.scene.settings.start;
        (start.yaw, start.tilt, start.joint_position) = (0.0, 0.0, 0.0);
        self
    }

    /// Who is tested on what.
    pub fn subject(&self, seed: u64) -> Subject<'_> {
        Subject { task: &self.scene, policy: &self.policy, candidate: Some(&self.candidate), seed }
    }

    /// Threads asked for, or one a core.
    pub fn threads(args: &WorldSettings) -> usize {
        args.threads.map_or_else(crate::machine::threads, std::num::NonZeroUsize::get)
    }

    /// The simulator in a few words.
    pub fn description(&self) -> String {
        let robot = &self.scene.walker.batch.model().name;
        if self.changes.is_empty() {
            format!("{robot}, nominal")
        } else {
            format!("{robot}: {}", self.changes.join(", "))
        }
    }
}

/// The longest actuation delay of a joint, s.
pub fn longest_delay(candidate: &Candidate) -> f64 {
    candidate.robot.delay.iter().fold(0.0, |most, &delay| most.max(delay))
}

/// The task: as asked for, as the policy remembers it, or the built-in one.
pub fn task(args: &WorldSettings, policy: &Policy) -> Result<TaskSettings, Error> {
    let parse = |text: &str, what: &str| {
        toml::from_str::<TaskSettings>(text).map_err(|error| Error::settings(format!("{what}: {error}")))
    };
    match &args.task {
        Some(name) => match preset(name) {
            Some(text) => parse(text, name),
            None => {
                let text = std::fs::read_to_string(name).map_err(|error| {
                    Error::settings(format!(
                        "--task {name}: {error}; give `velocity`, `biped` or a file with a task's settings"
                    ))
                })?;
                parse(&text, name)
            }
        },
        None if policy.provenance.task.is_empty() => Ok(TaskSettings::default()),
        None => parse(&policy.provenance.task, "the task in the policy's file"),
    }
}

/// `JOINT=STIFFNESS` or `JOINT=STIFFNESS@REST`.
struct Spring {
    joint: String,
    stiffness: f64,
    rest: Option<f64>,
}

impl Spring {
    fn parse(text: &str) -> Result<Self, Error> {
        let wrong = || {
            Error::settings(format!(
                "--spring {text}: give JOINT=STIFFNESS (N·m/rad) or JOINT=STIFFNESS@REST (rad), for example \
                 RR_calf_joint=75"
            ))
        };
        let (joint, numbers) = text.split_once('=').ok_or_else(wrong)?;
        let (stiffness, rest) = match numbers.split_once('@') {
            Some((stiffness, rest)) => (stiffness, Some(rest)),
            None => (numbers, None),
        };
        let number = |text: &str| text.trim().parse::<f64>().ok().filter(|x| x.is_finite()).ok_or_else(wrong);
        let stiffness = number(stiffness)?;
        if !(0.0..=1e5).contains(&stiffness) {
            return Err(wrong());
        }
        Ok(Self { joint: joint.trim().to_owned(), stiffness, rest: rest.map(number).transpose()? })
    }
}

fn no_joint(model: &Model, name: &str, whose: &str) -> Error {
    let joints: Vec<&str> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
    Error::settings(format!("{whose}: {} has no joint `{name}`; it has {}", model.name, joints.join(", ")))
}
