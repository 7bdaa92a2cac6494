//! Everything a fit of walking logs needs, read and checked before anything is written.

use super::logs::{self, LogNotes};
use super::simulator::GroundSimulator;
use crate::Error;
use crate::settings::{AdaptConfig, check};
use crate::{machine, paths, robot};
use gaitfit_adapt::cost::{Cost, Recorded, Target};
use gaitfit_adapt::fit::FitOptions;
use gaitfit_adapt::{Quantity, Theta, ThetaFile};
use gaitfit_learn::task::{Task, TaskSettings};
use gaitfit_log::Trajectory;
use gaitfit_model::Model;
use gaitfit_policy::Policy;
use gaitfit_sim::Candidate;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A fit of walking logs.
pub struct Ground {
    /// The policy that walked.
    pub policy: Policy,
    /// Its task, without noise, pushes and variety, and the simulator.
    pub scene: Task,
    /// The robot that θ changes.
    pub base: Candidate,
    /// What is fitted.
    pub theta: Theta,
    /// The logs, and what was found in them.
    pub notes: LogNotes,
    /// The measured side of every cost.
    pub target: Arc<Target>,
    /// Optimiser settings.
    pub options: FitOptions,
    /// Threads.
    pub threads: usize,
    /// Every file that was read.
    pub files: Vec<PathBuf>,
    /// Things to know before trusting the result.
    pub warnings: Vec<String>,
}

impl Ground {
    /// Reads policy, robot and logs and checks the settings.
    pub fn open(config: &AdaptConfig, config_path: &Path, threads: Option<usize>) -> Result<Self, Error> {
        check::check(config, config_path)?;
        let usage =
            |error: &dyn std::fmt::Display| Error::settings(format!("{}: {error}", config_path.display()));
        let mut files = Vec::new();
        let model = match config.robot.as_str() {
            "" => robot::go2()?,
            named => {
                let path = paths::find(named, "robot", config_path)?;
                let model = robot::read(&path, config.lenient, robot::Hold::File)?;
                files.push(path);
                model
            }
        };
        let named = config.policy.as_deref().unwrap_or_default();
        let policy_path = paths::find(named, "policy", config_path)?;
        let policy = gaitfit_policy::read(&policy_path).map_err(Error::failed)?;
        files.push(policy_path);
        let mut known = None;
        let mut base = Candidate::nominal(&model);
        if let Some(named) = &config.known {
            let path = paths::find(named, "known", config_path)?;
            let file = theta_file(&path)?;
            base = candidate(&file, &path, &model)?;
            files.push(path.clone());
            known = Some((path, file));
        }

        let joints: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
        let rest = rest_angles(&policy, &model)?;
        let theta = config.rules().theta(&config.groups(), &joints, &rest).map_err(|error| usage(&error))?;
        let scene = scene(config, &policy, &model, &theta, &base)?;
        let notes = logs::read(config, config_path, &policy, &scene)?;
        for log in &notes.logs {
            files.push(log.path.clone());
            files.extend(log.sidecars.iter().cloned());
        }
        let target = target(config, &notes, &scene)?;
        let mut warnings = notes.warnings.clone();
        if let Some((path, doubt)) =
            known.and_then(|(path, file)| Some((path, file.step_doubt(scene.walker.physics_step())?)))
        {
            warnings.push(format!("{}: {doubt}", path.display()));
        }
        for (signal, column) in target.constant() {
            warnings.push(format!("{signal} {column} is constant in the logs and left out of the costs"));
        }
        for name in config.truth.keys().chain(config.published.keys()) {
            if theta.entries().iter().all(|entry| entry.name != *name) {
                warnings.push(format!("[truth] or [published] has `{name}`, which is not fitted"));
            }
        }
        let threads = threads.or(Some(config.simulation.threads).filter(|&threads| threads > 0));
        Ok(Self {
            options: check::options(config, notes.falls()),
            threads: threads.unwrap_or_else(machine::threads),
            policy,
            scene,
            base,
            theta,
            notes,
            target: Arc::new(target),
            files,
            warnings,
        })
    }

    /// The trajectories that are compared.
    pub fn trajectories(&self) -> Vec<&Trajectory> {
        self.notes.logs.iter().map(|log| &log.trajectory).collect()
    }

    /// Runs the policy on candidates.
    pub fn simulator(&self) -> GroundSimulator<'_> {
        let base = self.base.clone();
        GroundSimulator::new(&self.scene.walker, &self.policy, base, &self.trajectories(), self.threads)
    }

    /// The costs, in the configuration's order.
    pub fn costs(
        &self,
        config: &AdaptConfig,
        simulator: &GroundSimulator<'_>,
    ) -> Result<Vec<Box<dyn Cost>>, Error> {
        let build = |kind: &gaitfit_adapt::cost::CostKind| kind.build(&self.target, simulator);
        let costs = config.costs.iter().map(build).collect::<Result<_, _>>();
        costs.map_err(|error| Error::failed(format!("the logs cannot be compared: {error}")))
    }
}

/// Reads a theta.toml.
pub fn theta_file(path: &Path) -> Result<ThetaFile, Error> {
    let text = std::fs::read_to_string(path)
        .map_err(|error| Error::failed(format!("cannot read {}: {error}", path.display())))?;
    ThetaFile::parse(&text).map_err(|error| Error::failed(format!("{}: {error}", path.display())))
}

/// The robot of `model` as the file at `path` has it.
pub fn candidate(file: &ThetaFile, path: &Path, model: &Model) -> Result<Candidate, Error> {
    file.candidate(model).map_err(|error| Error::failed(format!("{}: {error}", path.display())))
}

/// The policy's default pose in the model's order, rad.
fn rest_angles(policy: &Policy, model: &Model) -> Result<Vec<f64>, Error> {
    let mut rest = vec![0.0; model.joints.len()];
    let joints = policy.interface.resolve(model).map_err(Error::failed)?;
    for (&joint, &angle) in joints.iter().zip(&policy.interface.default_pose) {
        rest[joint] = angle;
    }
    Ok(rest)
}

fn scene(
    config: &AdaptConfig,
    policy: &Policy,
    model: &Model,
    theta: &Theta,
    base: &Candidate,
) -> Result<Task, Error> {
    let task = &policy.provenance.task;
    let mut settings = if task.is_empty() {
        TaskSettings::default()
    } else {
        let wrong = |error| Error::failed(format!("the task in the policy's file: {error}"));
        toml::from_str(task).map_err(wrong)?
    };
    let interface = policy.interface.clone();
    // A period of 20 ms and a step of 5 ms mean four steps, whatever the last digit says.
    let steps = (interface.control_dt / config.simulation.timestep - 0.01).ceil().max(1.0);
    settings.substeps = steps as usize;
    let delay = base.robot.delay.iter().fold(0.0f64, |most, &delay| most.max(delay));
    let delay = delay.max(theta.largest(Quantity::Delay).unwrap_or(0.0));
    Task::with_interface(model, &settings.calm(), interface, config.simulation.preset.into(), delay)
        .map_err(Error::failed)
}

fn target(config: &AdaptConfig, notes: &LogNotes, scene: &Task) -> Result<Target, Error> {
    let model = scene.walker.batch.model();
    let joints: Vec<String> =
        scene.walker.joints.iter().map(|&joint| model.joints[joint].name.clone()).collect();
    let recorded = notes
        .logs
        .iter()
        .enumerate()
        .map(|(number, log)| Recorded::from_trajectory(&log.trajectory, &joints, number))
        .collect::<Result<Vec<Recorded>, _>>();
    let skip = (config.skip_seconds() / scene.walker.interface.control_dt).round() as usize;
    recorded
        .and_then(|recorded| Target::new(joints, &recorded, skip))
        .map_err(|error| Error::failed(format!("the logs cannot be compared: {error}")))
}
