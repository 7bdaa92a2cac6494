//! The simulated robot that a policy is run on: robot file, task, fitted parameters, springs, noise.

use crate::Error;
use crate::Spring;
use crate::draws;
use crate::policy_file;
use crate::robot::{self, Hold};
use crate::robot_file;
use crate::settings::{Preset, check_torque_noise, load_task};
use crate::theta;
use gaitfit_learn::evaluate::Subject;
use gaitfit_learn::task::{CommandSettings, Task, TaskSettings, preset};
use gaitfit_model::{Model, shown};
use gaitfit_policy::Policy;
use gaitfit_sim::Candidate;
use std::path::{Path, PathBuf};

/// A policy and the simulator it runs in.
#[derive(Clone, Debug)]
pub struct WorldSettings {
    /// The policy's file, or the run folder of its training.
    pub policy: PathBuf,
    /// Robot file; that of the policy's training without one, or else the built-in Go2.
    pub robot: Option<PathBuf>,
    /// Drop what the engine cannot simulate in the robot file, instead of refusing it.
    pub lenient: bool,
    /// Task: `velocity`, `biped`, or a file with a task's settings; the policy's own without one.
    pub task: Option<String>,
    /// Fitted parameters, a theta.toml.
    pub theta: Option<PathBuf>,
    /// Springs on joints.
    pub spring: Vec<Spring>,
    /// Standard deviation of Gaussian torques at every joint and physics step, N·m.
    pub torque_noise: f64,
    /// Vary robots, starts and observations as in training, with pushes.
    pub randomised: bool,
    /// Solver effort.
    pub preset: Preset,
    /// Seed of commands, starts and noise.
    pub seed: u64,
    /// Threads; none takes one a core.
    pub threads: Option<std::num::NonZeroUsize>,
}

impl WorldSettings {
    /// A wrong setting of the task, said of where the task is from; other errors as they are.
    pub fn of_task(&self, error: Error) -> Error {
        match &self.task {
            _ if !error.is_of_task() => error,
            Some(name) => error.within(format!("--task {name}:")),
            None => error
                .within(format!("{}: the policy's own task (--task gives another):", self.policy.display())),
        }
    }

    /// The task with the robots that are asked for: randomised, or the nominal one.
    pub fn of_robots(&self, settings: TaskSettings) -> TaskSettings {
        if self.randomised { settings } else { settings.nominal() }
    }

    /// Threads asked for, or one a core.
    pub fn threads(&self) -> usize {
        self.threads.map_or_else(crate::machine::threads, std::num::NonZeroUsize::get)
    }
}

/// A policy and the simulator it runs in.
pub struct World {
    /// The policy.
    pub policy: Policy,
    /// The robot, springs included, on the ground of its file.
    pub model: Model,
    /// Task and simulator.
    pub scene: Task,
    /// The robot, fitted parameters and noise included.
    pub candidate: Candidate,
    /// Robots drawn from what a fit leaves open; none where that was not asked for.
    pub drawn: Vec<Candidate>,
    /// Differences from the nominal robot, for reports.
    pub changes: Vec<String>,
    /// Things to know before trusting what it shows.
    pub warnings: Vec<String>,
}

impl World {
    /// Reads everything the arguments name.
    pub fn open(args: &WorldSettings) -> Result<Self, Error> {
        let policy_file = policy_file::find(&args.policy)?;
        let args = WorldSettings { policy: policy_file.path, ..args.clone() };
        let mut world = Self::new(&args, gaitfit_policy_files::read(&args.policy)?)?;
        world.warnings.splice(0..0, policy_file.note);
        Ok(world)
    }

    /// As [`World::open`], for a policy that is read already; the arguments say what it is called.
    pub fn new(args: &WorldSettings, policy: Policy) -> Result<Self, Error> {
        let (args, notes) = robot_file::settled(args, &policy)?;
        let args = &args;
        let mut settings = task(args, &policy)?;
        // Uneven ground is measured on its own.
        settings.terrain = None;
        let world = Self::with_task(args, policy, args.of_robots(settings));
        let mut world = world.map_err(|error| args.of_task(error))?;
        world.warnings.splice(0..0, notes);
        Ok(world)
    }

    /// The simulator that the arguments name, for a policy and a task that are read already.
    pub fn with_task(args: &WorldSettings, policy: Policy, settings: TaskSettings) -> Result<Self, Error> {
        Self::among(args, policy, settings, None)
    }

    /// As [`World::with_task`], with the robots of a file of draws, which belongs to the fitted parameters.
    pub fn among(
        args: &WorldSettings,
        policy: Policy,
        mut settings: TaskSettings,
        draws: Option<&Path>,
    ) -> Result<Self, Error> {
        let mut changes = Vec::new();
        if args.randomised {
            changes.push("randomised as in training".to_owned());
        }
        // Read once: its rotors, its self-contact and its numbers are all needed below.
        let theta =
            args.theta.as_deref().map(|path| Ok::<_, Error>((path, theta::read(path)?))).transpose()?;
        // An evaluation adds the smallest rotor of the training, unless the fit has found one.
        if let Some((_, file)) = theta.as_ref().filter(|_| !args.randomised) {
            theta::keep_rotors(file, &mut settings);
        }
        if !args.randomised && settings.randomisation.armature[0] > 0.0 {
            let smallest = settings.randomisation.armature[0];
            changes.push(format!(
                "rotor inertia of {smallest} kg·m² added to each joint, the smallest of the training"
            ));
        }
        let mut model = match &args.robot {
            Some(path) => robot::read(path, args.lenient, Hold::File)?,
            None => robot::go2()?,
        };
        let mut warnings = robot::remarks(&model);
        // The pose shows first whether the policy's joints are on this robot.
        let interface = &policy.interface;
        let pose = interface.model_pose(&model).map_err(|error| match &args.robot {
            Some(_) => error.into(),
            None => Error::from(error).advised(
                "this policy was trained on another robot than the built-in Go2: name its file with --robot",
            ),
        })?;
        // Springs change the model itself, so they come before θ is applied to it.
        for spring in &args.spring {
            let rest = spring.put_on(&mut model, |joint| pose.get(joint).copied())?;
            let joint = model.find_joint(&spring.joint);
            let kind = joint.map(|joint| model.joints[joint].kind).unwrap_or_default();
            let (per, unit) = (kind.unit("N·m/rad"), kind.unit("rad"));
            changes
                .push(format!("spring {} {per} about {rest} {unit} on {}", spring.stiffness, spring.joint));
        }
        let mut candidate = match &theta {
            Some((path, file)) => {
                theta::add_self_contact(file, &mut settings);
                changes.push(format!("parameters of {}", path.display()));
                theta::candidate(file, path, &model)?
            }
            None => Candidate::nominal(&model),
        };
        // Each drawn robot starts from the nominal one: a draw has all the fit's numbers.
        let mut drawn = match (draws, &theta) {
            (Some(draws), Some((path, file))) => {
                let robots = draws::candidates(draws, &Candidate::nominal(&model), file, path, &model)?;
                changes.push(format!("{} draws of {}", robots.len(), draws.display()));
                robots
            }
            // Draws belong to a fit; without one there is nothing to draw.
            _ => Vec::new(),
        };
        check_torque_noise("torque_noise", args.torque_noise).map_err(Error::settings)?;
        if args.torque_noise > 0.0 {
            changes.push(format!("torque noise of {} N·m", args.torque_noise));
        }
        // Variances of independent torques add.
        for candidate in drawn.iter_mut().chain([&mut candidate]) {
            candidate.torque_noise = candidate.torque_noise.hypot(args.torque_noise);
        }
        // The task keeps as many past targets as the longest delay of any robot needs.
        let delay = drawn.iter().map(longest_delay).fold(longest_delay(&candidate), f64::max);
        let scene = Task::with_interface(&model, &settings, interface.clone(), args.preset, delay)?;
        let step = Some(scene.walker.physics_step());
        warnings.extend(scene.remarks.iter().cloned());
        warnings.extend(policy.notes.iter().cloned());
        warnings.extend(policy.interface.other_robot(scene.walker.model()));
        if let Some((path, file)) = theta {
            warnings.extend(theta::doubts(&file, path, &model, step));
        }
        Ok(Self { policy, model, scene, candidate, drawn, changes, warnings })
    }

    /// With robots that begin where a fit of their logs lets them begin: upright, facing along x (pyramidal friction
    /// cones are not quite the same in all directions), joints in the start's pose.
    pub fn with_plain_starts(mut self) -> Self {
        let start = &mut self.scene.settings.start;
        (start.yaw, start.tilt, start.joint_position) = (0.0, 0.0, 0.0);
        self
    }

    /// Policy, robot and task of a test.
    pub fn subject(&self, seed: u64) -> Subject<'_> {
        Subject {
            task: &self.scene,
            policy: &self.policy,
            candidate: Some(&self.candidate),
            seed,
            cancel: None,
            moved: None,
        }
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

/// The task of a robot whose policy states none: the built-in one of the Go2, and of another robot what `gaitfit init`
/// guesses.
///
/// # Errors
/// A robot in which no legs are found.
pub fn usual_task(model: &Model) -> Result<TaskSettings, Error> {
    if robot::is_go2(model) {
        return Ok(TaskSettings::default());
    }
    Ok(crate::init::look(model).map_err(Error::failed)?.settings)
}

/// The longest actuation delay of a joint, s.
pub fn longest_delay(candidate: &Candidate) -> f64 {
    candidate.robot.delay.iter().fold(0.0, |max, &delay| max.max(delay))
}

/// The task on which a policy was trained, as its file states it; absent if the file states none.
///
/// # Errors
/// Settings that no task has.
pub fn trained_task(policy: &Policy) -> Result<Option<TaskSettings>, Error> {
    let text = &policy.provenance.task;
    let wrong = |error| Error::settings(format!("the task in the policy's file: {error}"));
    if text.is_empty() { Ok(None) } else { toml::from_str(text).map(Some).map_err(wrong) }
}

/// The task: as asked for, as the policy remembers it, or the built-in one. A file's settings lie upon the task that
/// its `base` names, or else upon the policy's own.
///
/// # Errors
/// A task or a file that there is not, or settings that no task has.
pub fn task(args: &WorldSettings, policy: &Policy) -> Result<TaskSettings, Error> {
    let remembered = &policy.provenance.task;
    let model = || match &args.robot {
        Some(path) => robot::read(path, args.lenient, Hold::File),
        None => robot::go2(),
    };
    // The model is read only where it decides the task.
    let Some(name) = &args.task else {
        return match trained_task(policy)? {
            Some(task) => Ok(task),
            None => usual_task(&model()?),
        };
    };
    let model = model()?;
    if let Some(text) = preset(name) {
        if !robot::is_go2(&model) {
            return Err(Error::settings(format!(
                "--task {name}: the built-in tasks are the Go2's, and the robot is `{}`; leave --task out for the \
                 policy's own task, or give a file (`gaitfit init` writes one)",
                shown(&model.name)
            )));
        }
        return toml::from_str(text).map_err(|error| Error::settings(format!("{name}: {error}")));
    }
    // A file states only changes, so the whole task lies below it.
    let under = match remembered.is_empty() {
        true => toml::to_string(&usual_task(&model)?).map_err(|error| Error::failed(error.to_string()))?,
        false => remembered.clone(),
    };
    load_task(Path::new(name), &under, &model)
        .map_err(|error| error.within("--task takes `velocity`, `biped` or a file with settings of a task:"))
}

/// Cells along each side of the grid over which the mean of |c| is taken (midpoint rule).
const GRID: usize = 200;

/// Mean velocity error of a robot that stands still, m/s: the mean of |c| over commands c = (x, y) as they are drawn.
pub fn standing_error(command: &CommandSettings) -> f64 {
    // Midpoints: the error of the rule falls with the square of the cells' size.
    let at = |[low, high]: [f64; 2], cell: usize| low + (high - low) * (cell as f64 + 0.5) / GRID as f64;
    let sum: f64 =
        (0..GRID * GRID).map(|cell| at(command.x, cell / GRID).hypot(at(command.y, cell % GRID))).sum();
    // A robot that stands has no error where the command is zero.
    (1.0 - command.standing) * sum / (GRID * GRID) as f64
}

#[cfg(test)]
mod tests {
    use super::*;

    fn command(x: [f64; 2], y: [f64; 2], standing: f64) -> CommandSettings {
        CommandSettings { x, y, yaw: [-1.0, 1.0], seconds: 4.0, standing, curriculum: None }
    }

    #[test]
    fn standing_still_is_off_by_the_mean_command() {
        // The mean distance of the unit square's points from a corner is (√2 + asinh 1) / 3.
        let corner = (2f64.sqrt() + 1f64.asinh()) / 3.0;
        assert!((standing_error(&command([-1.0, 1.0], [-1.0, 1.0], 0.0)) - corner).abs() < 1e-4);
        assert!((standing_error(&command([0.0, 2.0], [0.0, 0.0], 0.25)) - 0.75).abs() < 1e-9);
    }
}
