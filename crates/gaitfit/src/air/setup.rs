//! Everything a fit needs, read and checked before anything is written.

use super::logs::{self, Log};
use crate::Error;
use crate::search::Fitting;
use crate::settings::{AdaptConfig, check};
use crate::{machine, paths, robot};
use gaitfit_adapt::cost::{Cost, CostError, CostKind, MatchO, Recorded, Target, Wass, Weights};
use gaitfit_adapt::fit::FitOptions;
use gaitfit_adapt::{Quantity, ReplaySimulator, Theta};
use gaitfit_log::Severity;
use gaitfit_model::Model;
use gaitfit_sim::ReplayOptions;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// A set of logs with the simulator that replays them and the robot side of every cost.
pub struct LogSet {
    /// The logs.
    pub logs: Vec<Log>,
    /// Replays them.
    pub simulator: ReplaySimulator,
    /// Their measured side.
    pub target: Arc<Target>,
}

/// Everything a fit needs.
pub struct Setup {
    /// Where the robot was found.
    pub robot_path: PathBuf,
    /// The robot, clamped.
    pub model: Model,
    /// What is fitted.
    pub theta: Theta,
    /// The logs that are fitted.
    pub fit: LogSet,
    /// The logs that are not, a set each: they may differ in sample rate.
    pub validate: Vec<LogSet>,
    /// The costs, in the configuration's order.
    pub costs: Vec<Box<dyn Cost>>,
    /// Optimiser settings.
    pub options: FitOptions,
    /// Things to know before trusting the result.
    pub warnings: Vec<String>,
}

impl Setup {
    /// The fit of the logs.
    pub fn fitting(&self, config: &AdaptConfig) -> Fitting<'_> {
        Fitting {
            simulator: &self.fit.simulator,
            theta: &self.theta,
            costs: &self.costs,
            options: &self.options,
            max_seconds: config.optimizer.max_seconds,
            checkpoint_seconds: config.checkpoint_seconds,
        }
    }
}

/// Reads robot and logs and checks the settings.
pub fn setup(config: &AdaptConfig, config_path: &Path, threads: Option<usize>) -> Result<Setup, Error> {
    check::check(config, config_path)?;
    let robot_path = paths::find(&config.robot, "robot", config_path)?;
    let model = robot::read(&robot_path, config.lenient, robot::Hold::Clamped)?;
    let joints: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
    let groups: Vec<(String, Vec<String>)> =
        config.groups.iter().map(|(name, patterns)| (name.clone(), patterns.clone())).collect();
    let theta = Theta::from_rules(&config.parameter, &groups, &joints)
        .map_err(|error| Error::settings(format!("{}: {error}", config_path.display())))?;

    let read = |named: &String, gains| logs::read(named, config_path, config, &model, gains);
    let fit_logs = config.logs.iter().map(|named| read(named, &[])).collect::<Result<Vec<_>, _>>()?;
    let validate_logs = config
        .validate
        .iter()
        .map(|named| read(named, &config.validate_gains))
        .collect::<Result<Vec<_>, _>>()?;
    let mut warnings = unused(config, &theta, &validate_logs)?;
    for log in &validate_logs {
        if fit_logs.iter().any(|fitted| fitted.path == log.path) {
            warnings.push(format!("{} is fitted and validated on: its error there proves nothing", log.name));
        }
    }

    let threads = threads.or(Some(config.simulation.threads).filter(|&threads| threads > 0));
    let threads = threads.unwrap_or_else(machine::threads);
    let set = |logs: Vec<Log>| log_set(config, &model, &theta, &joints, threads, logs);
    for log in fit_logs.iter().chain(&validate_logs) {
        let findings = log.findings.iter().filter(|finding| finding.severity != Severity::Note);
        warnings.extend(findings.map(|finding| format!("{}: {finding}", log.name)));
    }
    let fit = set(fit_logs)?;
    let validate = validate_logs.into_iter().map(|log| set(vec![log])).collect::<Result<Vec<_>, _>>()?;
    for (signal, joint) in fit.target.constant() {
        warnings.push(format!("{signal} of joint {joint} is constant in the logs and left out of the costs"));
    }
    let costs = config.costs.iter().map(|&name| cost(name, &fit.target)).collect::<Result<Vec<_>, _>>();
    let costs = costs.map_err(|error| Error::failed(format!("the logs cannot be compared: {error}")))?;
    Ok(Setup { robot_path, model, theta, fit, validate, costs, options: check::options(config, 0), warnings })
}

/// Most physics steps a sample, as the replay has it.
const MOST_SUBSTEPS: usize = 1000;
/// Longest actuation delay, s, as the replay has it.
const MOST_DELAY: f64 = 1.0;

/// Settings that name something this run does not have: harmless, or a slip of the pen.
fn unused(config: &AdaptConfig, theta: &Theta, validate: &[Log]) -> Result<Vec<String>, Error> {
    let mut found = Vec::new();
    let fitted = |name: &String| theta.entries().iter().any(|entry| entry.name == *name);
    let known = config.truth.keys().map(|name| ("truth", name));
    for (table, name) in known.chain(config.published.keys().map(|name| ("published", name))) {
        if !fitted(name) {
            found.push(format!("[{table}] has `{name}`, which is not fitted"));
        }
    }
    for entry in &config.validate_gains {
        let mut used = false;
        for log in validate {
            used |= logs::matching(std::slice::from_ref(entry), &log.name, &log.path)?.is_some();
        }
        if !used {
            found.push(format!("validate_gains for {:?} matches no validation log", entry.files));
        }
    }
    Ok(found)
}

/// Replays logs that share a sample rate closely enough to share a number of substeps.
fn log_set(
    config: &AdaptConfig,
    model: &Model,
    theta: &Theta,
    joints: &[String],
    threads: usize,
    logs: Vec<Log>,
) -> Result<LogSet, Error> {
    let longest = logs.iter().map(|log| log.recording.dt).fold(0.0, f64::max);
    // A log at 5.001 ms and a step of 5 ms mean one step a sample: a percent is clock error, not a finer rate.
    let substeps = (longest / config.simulation.timestep - 0.01).ceil().max(1.0) as usize;
    if substeps > MOST_SUBSTEPS {
        return Err(Error::settings(format!(
            "`simulation.timestep` {} s splits a sample of {longest} s into {substeps} steps, more than \
             {MOST_SUBSTEPS}; raise it (for example --set simulation.timestep=0.001)",
            config.simulation.timestep
        )));
    }
    let max_delay = theta.largest(Quantity::Delay).unwrap_or(0.0);
    if max_delay > MOST_DELAY {
        return Err(Error::settings(format!(
            "the `delay` parameter's upper bound is {max_delay} s; at most {MOST_DELAY} s can be replayed: \
             lower `upper`"
        )));
    }
    let options = ReplayOptions { substeps, preset: config.simulation.preset.into(), max_delay, isa: None };
    let recordings = logs.iter().map(|log| log.recording.clone()).collect();
    let names = logs.iter().map(|log| log.name.as_str()).collect::<Vec<_>>().join(", ");
    let simulator = ReplaySimulator::new(model, recordings, options, threads)
        .map_err(|error| Error::failed(format!("{names}: {error}.")))?;
    let recorded = |(number, log): (usize, &Log)| Recorded::from_trajectory(&log.trajectory, joints, number);
    let target = || -> Result<Target, CostError> {
        let recorded = logs.iter().enumerate().map(recorded).collect::<Result<Vec<_>, _>>()?;
        let skip = (config.skip_seconds() / longest).round() as usize;
        Target::new(joints.to_vec(), &recorded, skip)
    };
    let target = target().map_err(|error| Error::failed(format!("{names}: {error}.")))?;
    Ok(LogSet { logs, simulator, target: Arc::new(target) })
}

/// Actions carry no weight: a replay sends the log's own targets, so both sides act the same and the action's
/// part of either cost is zero.
fn cost(kind: CostKind, target: &Arc<Target>) -> Result<Box<dyn Cost>, CostError> {
    let weights = Weights::JOINTS;
    let target = Arc::clone(target);
    Ok(match kind {
        CostKind::Wass => Box::new(Wass::new(target, weights)?),
        // `check` has refused costs that need the base's state.
        CostKind::MatchO | CostKind::MatchS(_) => Box::new(MatchO::new(target, weights)?),
    })
}
