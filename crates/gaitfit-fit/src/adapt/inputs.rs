//! The inputs of a fit: the robot, the policy that walked, and the logs.

use super::method::Method;
use crate::air::{Clamped, logs as air_logs};
use crate::log::{self, Log};
use crate::robot::Hold;
use crate::settings::{AdaptConfig, Base};
use crate::walk::falling::Falling;
use crate::walk::logs::{self as walk_logs, LogNotes, Purpose};
use crate::walk::walking::Walking;
use crate::{Error, machine, paths, policy_file, robot, theta};
use gaitfit_adapt::{Theta, ThetaFile};
use gaitfit_model::patterns::plain;
use gaitfit_model::{Model, shown};
use gaitfit_policy::Policy;
use gaitfit_policy_files as policy;
use gaitfit_sim::Candidate;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// The robot of a configuration.
pub struct Robot {
    /// Its model.
    pub model: Model,
    /// The policy that walked.
    pub policy: Option<Policy>,
    /// The robot that θ changes: the model, with what is known already.
    pub base: Candidate,
    /// The file of what is known, and its contents; absent if nothing was known before the fit.
    pub known: Option<(PathBuf, ThetaFile)>,
    /// Every file that was read.
    pub files: Vec<PathBuf>,
}

impl Robot {
    /// Reads robot, policy (unless it is `given`) and what is known.
    pub fn read(config: &AdaptConfig, config_path: &Path, given: Option<&Policy>) -> Result<Self, Error> {
        let mut files = Vec::new();
        // A clamped robot's base does not move, whatever its file says.
        let hold = match config.base {
            Base::Fixed => Hold::Clamped,
            Base::Free => Hold::File,
        };
        let model = match config.robot.as_str() {
            "" => robot::go2()?,
            named => {
                let path = paths::find(named, "robot", config_path)?;
                let model = robot::read(&path, config.lenient, hold)?;
                files.push(path);
                model
            }
        };
        // A clamped robot has only this setting; a walking robot may have it from its task too.
        let model = match &config.simulation.self_contact {
            Some(chosen) => model.touching_itself(chosen).map_err(Error::settings)?.0,
            None => model,
        };
        // Every file goes into the list of inputs, which a resumed run compares.
        let mut read = |named: &String, what: &str| -> Result<PathBuf, Error> {
            let mut path = paths::find(named, what, config_path)?;
            if what == "policy" {
                path = policy_file::find(&path)?.path;
            }
            files.push(path.clone());
            Ok(path)
        };
        // A policy in memory replaces its file, which then is not read.
        let policy = match &config.policy {
            Some(_) if given.is_some() => given.cloned(),
            Some(named) => Some(policy::read(&read(named, "policy")?).map_err(Error::failed)?),
            None => None,
        };
        let mut base = Candidate::nominal(&model);
        let mut known = None;
        if let Some(named) = &config.known {
            let path = read(named, "known")?;
            let file = theta::read(&path)?;
            base = theta::candidate(&file, &path, &model)?;
            known = Some((path, file));
        }
        Ok(Self { model, policy, base, known, files })
    }
}

/// How the configuration's logs are simulated.
pub fn method(
    config: &AdaptConfig,
    policy: Option<Policy>,
    model: Model,
    theta: &Theta,
    base: &Candidate,
    threads: Option<usize>,
) -> Result<Method, Error> {
    // 0 in the settings means as many threads as the machine has.
    let threads = threads.or(Some(config.simulation.threads).filter(|&threads| threads > 0));
    let threads = threads.unwrap_or_else(machine::threads);
    Ok(match policy {
        Some(policy) => Method::Walk(Arc::new(Walking::new(config, policy, &model, theta, base, threads)?)),
        None => Method::Replay(Box::new(Clamped::new(config, model, theta, base, threads))),
    })
}

/// The logs of a configuration.
pub(super) struct Logs {
    /// Those that are fitted.
    pub fit: Vec<Log>,
    /// Those that are not, in sets that are compared together.
    pub validate: Vec<Vec<Log>>,
    /// Notes on the walking logs that are fitted.
    pub notes: Option<LogNotes>,
    /// Falls of the robot in all logs, and its time on its feet.
    pub falling: Falling,
    /// Doubts, each one sentence.
    pub warnings: Vec<String>,
}

impl Logs {
    /// Reads them.
    pub fn read(config: &AdaptConfig, config_path: &Path, method: &Method) -> Result<Self, Error> {
        let (fit, notes, mut warnings) = match method {
            Method::Replay(clamped) => {
                let (logs, doubts) = clamped_logs(&config.logs, false, config, config_path, clamped)?;
                (logs, None, doubts)
            }
            Method::Walk(walking) => {
                let notes = walk_logs::read(
                    &config.logs,
                    Purpose::Fit,
                    config,
                    config_path,
                    &walking.policy,
                    &walking.task,
                )?;
                (notes.logs.clone(), Some(notes.clone()), notes.warnings)
            }
        };
        let mut validate = Vec::new();
        let mut doubts = Vec::new();
        // All logs are of one robot, so all its falls count.
        let mut falling = notes.as_ref().map_or_else(Falling::default, |notes| notes.falling);
        if !config.validate.is_empty() {
            let validation = validation(&config.validate, config, config_path, method)?;
            (validate, doubts) = (validation.sets, validation.doubts);
            falling = falling.and(validation.falling);
        }
        // A log in both sets would validate itself.
        for log in validate.iter().flatten() {
            if fit.iter().any(|fitted| fitted.path == log.path) {
                warnings
                    .push(format!("{} is fitted and validated on: its error there proves nothing", log.name));
            }
        }
        warnings.extend(doubts);
        warnings.extend(unused_names(config, fit.iter().chain(validate.iter().flatten())));
        let walks = method.walking().is_some();
        warnings.extend(log::lead_note(&fit, walks)?);
        // Only errors count here: the note above is about the logs that are fitted.
        for logs in &validate {
            log::lead_note(logs, walks)?;
        }
        Ok(Self { fit, validate, notes, falling, warnings })
    }

    /// Every file that was read.
    pub fn files(&self) -> Vec<PathBuf> {
        let logs = self.fit.iter().chain(self.validate.iter().flatten());
        logs.flat_map(|log| std::iter::once(&log.path).chain(&log.sidecars)).cloned().collect()
    }
}

/// Names of `[joint_names]` that no log has, though their joints are there under other names.
fn unused_names<'a>(config: &AdaptConfig, logs: impl Iterator<Item = &'a Log> + Clone) -> Vec<String> {
    let unused = config.joint_names.iter().filter(|(of_log, of_robot)| {
        let has = |names: &[String], wanted: &str| names.iter().any(|name| plain(name) == plain(wanted));
        // Joints that the fit does not use are not read.
        !logs.clone().any(|log| log.joints.contains(of_log))
            && logs.clone().any(|log| has(&log.trajectory.joints, of_robot))
    });
    unused
        .map(|(of_log, of_robot)| {
            let (of_log, of_robot) = (shown(of_log), shown(of_robot));
            format!("[joint_names] has `{of_log}`, which no log has; the logs name the robot's `{of_robot}` otherwise")
        })
        .collect()
}

/// Logs for validation.
pub struct ValidationLogs {
    /// The logs, in sets that are compared together.
    pub sets: Vec<Vec<Log>>,
    /// Doubts about them, each one sentence.
    pub doubts: Vec<String>,
    /// Falls of the robot, and its time on its feet.
    pub falling: Falling,
}

/// The logs `named` for validation.
pub fn validation(
    named: &[String],
    config: &AdaptConfig,
    config_path: &Path,
    method: &Method,
) -> Result<ValidationLogs, Error> {
    match method {
        Method::Replay(clamped) => {
            let (logs, doubts) = clamped_logs(named, true, config, config_path, clamped)?;
            // Logs of different rates cannot be replayed together, so each is a set of its own.
            let sets = logs.into_iter().map(|log| vec![log]).collect();
            Ok(ValidationLogs { sets, doubts, falling: Falling::default() })
        }
        Method::Walk(walking) => {
            let (policy, task) = (&walking.policy, &walking.task);
            let notes = walk_logs::read(named, Purpose::Validation, config, config_path, policy, task)?;
            let falling = notes.falling;
            let doubts = notes.warnings.into_iter().map(|doubt| format!("validation: {doubt}")).collect();
            Ok(ValidationLogs { sets: vec![notes.logs], doubts, falling })
        }
    }
}

fn clamped_logs(
    named: &[String],
    validation: bool,
    config: &AdaptConfig,
    config_path: &Path,
    clamped: &Clamped,
) -> Result<(Vec<Log>, Vec<String>), Error> {
    let gains = if validation { config.validate_gains.as_slice() } else { &[] };
    let (mut logs, mut doubts) = (Vec::with_capacity(named.len()), Vec::new());
    for named in named {
        let (log, log_doubts) = air_logs::read(named, config_path, config, &clamped.model, gains)?;
        logs.push(log);
        doubts.extend(log_doubts);
    }
    Ok((logs, doubts))
}
