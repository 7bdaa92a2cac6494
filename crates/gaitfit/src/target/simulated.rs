//! A robot in this engine, with other numbers than the file's.

use super::PolicyFiles;
use crate::Error;
use crate::collect::walks;
use crate::device::Device;
use crate::evaluate::{Evaluation, Plan, measure};
use crate::log_folder::write_logs;
use crate::paths;
use crate::settings::{LoopConfig, TargetConfig};
use crate::theta;
use crate::watch::Watch;
use crate::world::{World, WorldSettings};
use gaitfit_adapt::{Found, ParameterRule, RobotRule, Rules, SavedParameter, Sharing, ThetaFile};
use gaitfit_learn::collect::CollectOptions;
use gaitfit_learn::evaluate::{GaitRecord, record_gait};
use gaitfit_learn::task::TaskSettings;
use gaitfit_model::Model;
use std::path::{Path, PathBuf};

/// The robot.
pub struct Simulated {
    /// The simulator's arguments; the policy's are those of no policy.
    pub arguments: WorldSettings,
    /// The task that every policy is tested on.
    task: TaskSettings,
    options: CollectOptions,
    description: String,
    threads: usize,
    device: Device,
}

/// The numbers in which the target differs from the robot's file, and what to doubt of the file that they are from.
///
/// # Errors
/// A file that cannot be read, patterns that cover no joint, values without a meaning.
pub fn truth(config: &TargetConfig, path: &Path, model: &Model) -> Result<(ThetaFile, Vec<String>), Error> {
    let mut doubts = Vec::new();
    let wrong =
        |error: &dyn std::fmt::Display| Error::settings(format!("{}: [target] {error}", path.display()));
    let mut file = match &config.theta {
        Some(named) => {
            let named = paths::find(named, "target.theta", path)?;
            let file = theta::read(&named)?;
            // By its own name; the joints of another robot are refused here.
            theta::candidate(&file, &named, model)?;
            doubts = theta::doubts(&file, &named, model, None);
            file
        }
        // A file of numbers that changes nothing.
        None => ThetaFile::parse("format = 2").map_err(|error| wrong(&error))?,
    };
    // The target's own numbers come on top of the file's, in the form in which a fit writes its results.
    let joints: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
    let rules = Rules {
        parameter: config
            .parameter
            .iter()
            .map(|one| ParameterRule {
                // One value for all joints of the rule, so each rule has exactly one entry in `values` below.
                per: Sharing::All,
                joints: one.joints.clone(),
                ..ParameterRule::new(one.kind)
            })
            .collect(),
        network: Vec::new(),
        robot: config.number.iter().map(|one| RobotRule::new(one.kind)).collect(),
    };
    let values =
        config.parameter.iter().map(|one| one.value).chain(config.number.iter().map(|one| one.value));
    let values: Vec<Found> = values.map(|value| Found { value, spread: None }).collect();
    if !values.is_empty() {
        let theta = rules.by_kind(model).and_then(|rules| rules.theta(&[], &joints, &[]));
        let theta = theta.map_err(|error| wrong(&error))?;
        let named = ThetaFile::new(&theta, &values, &model.name, "", 0.0);
        for mut parameter in named.parameter {
            // True values were not searched, so they have no bounds.
            (parameter.lower, parameter.upper, parameter.at_bound) = (None, None, None);
            // A number of the whole robot replaces the file's. Those of joints stand beside it, under other names.
            let replaced = |other: &SavedParameter| other.joints.is_empty() && other.kind == parameter.kind;
            file.parameter.retain(|other| !replaced(other));
            while file.parameter.iter().any(|other| other.name == parameter.name) {
                parameter.name.push('_');
            }
            file.parameter.push(parameter);
        }
    }
    file.robot = model.name.clone();
    (file.cost_name, file.cost) = (String::new(), None);
    // Tried on the robot now, so that a value without a meaning is refused before any walk.
    file.candidate(model).map_err(|error| wrong(&error))?;
    Ok((file, doubts))
}

impl Simulated {
    /// The target whose numbers stand in `theta` (see [`truth`]). `task`: that of the loop's first policy;
    /// `privileged`: whether logs have the base's position and velocity; `device` simulates the logs.
    pub fn new(
        config: &LoopConfig,
        target: &TargetConfig,
        robot: Option<PathBuf>,
        theta: PathBuf,
        task: TaskSettings,
        privileged: bool,
        threads: usize,
        device: Device,
    ) -> Self {
        let mut parts: Vec<String> = Vec::new();
        let value =
            |name: &str, joints: &[String], value: f64| format!("{name} {value} on {}", joints.join(", "));
        parts.extend(target.theta.iter().map(|path| format!("parameters of {path}")));
        parts.extend(target.parameter.iter().map(|one| value(one.kind.name(), &one.joints, one.value)));
        parts.extend(target.number.iter().map(|one| format!("{} {}", one.kind.name(), one.value)));
        parts.extend(target.spring.iter().map(|spring| format!("spring {spring}")));
        if target.torque_noise > 0.0 {
            parts.push(format!("torque noise {} N·m", target.torque_noise));
        }
        let description = if parts.is_empty() { "the nominal robot".to_owned() } else { parts.join("; ") };
        Self {
            arguments: WorldSettings {
                policy: PathBuf::new(),
                robot,
                lenient: config.lenient,
                task: None,
                theta: Some(theta),
                spring: target.spring.clone(),
                torque_noise: target.torque_noise,
                randomised: false,
                preset: target.preset,
                seed: 0,
                threads: None,
            },
            // Policies are measured on one robot without pushes, so that only they differ.
            task: task.calm(),
            options: CollectOptions {
                count: target.trajectories,
                seconds: target.seconds,
                shift: target.log_shift,
                privileged,
            },
            description,
            threads,
            device,
        }
    }

    /// The policy on the target.
    ///
    /// # Errors
    /// A policy or a spring that does not fit the robot.
    pub fn world(&self, policy: &PolicyFiles) -> Result<World, Error> {
        World::with_task(&self.arguments, policy.policy.clone(), self.task.clone())
    }

    /// Records logs into a folder.
    ///
    /// # Errors
    /// As [`Simulated::world`], a folder that cannot be written, or an interruption.
    pub fn collect(
        &self,
        policy: &PolicyFiles,
        seed: u64,
        folder: &Path,
        watch: &Watch<'_>,
    ) -> Result<(), Error> {
        // A fit starts its robots so, and its logs must begin alike.
        let world = self.world(policy)?.with_plain_starts();
        let subject = world.subject(seed);
        let logs = walks(&subject, &self.options, self.threads, self.device, watch)?;
        for number in write_logs(folder, &logs)?.without {
            watch.note(&format!("trajectory {number} fell before its log began; it has no file"));
        }
        Ok(())
    }

    /// Measures the policy.
    ///
    /// # Errors
    /// As [`Simulated::world`].
    pub fn evaluate(
        &self,
        policy: &PolicyFiles,
        plan: &Plan,
        watch: &Watch<'_>,
    ) -> Result<Evaluation, Error> {
        let evaluation = measure(&self.world(policy)?, &policy.name, plan, watch)?.evaluation;
        // Not where its file of numbers lies: documents are the same wherever the run's folder is.
        Ok(Evaluation { simulator: self.description(), ..evaluation })
    }

    /// The policy under a row of commands (seconds, command).
    ///
    /// # Errors
    /// As [`Simulated::world`].
    pub fn record(
        &self,
        policy: &PolicyFiles,
        commands: &[(f64, [f64; 3])],
        seed: u64,
    ) -> Result<GaitRecord, Error> {
        Ok(record_gait(&self.world(policy)?.subject(seed), commands)?)
    }

    /// In which numbers it differs.
    pub fn description(&self) -> String {
        self.description.clone()
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn the_targets_numbers_stand_beside_those_of_its_file_under_other_names() {
        let folder = tempfile::tempdir().unwrap();
        let theta = folder.path().join("theta.toml");
        let saved = |kind: &str, joints: &str| {
            format!("[[parameter]]\nname = \"{kind}\"\nkind = \"{kind}\"\njoints = [{joints}]\nvalue = 0.1\n")
        };
        let text = format!("format = 2\n{}{}", saved("base_mass", ""), saved("frictionloss", "\"*_hip\""));
        std::fs::write(&theta, text).unwrap();
        let text = format!(
            "kind = \"simulated\"\ntheta = {:?}\n[[parameter]]\nkind = \"frictionloss\"\njoints = [\"*_calf\"]\n\
             value = 0.2\n[[number]]\nkind = \"base_mass\"\nvalue = 0.2\n",
            theta.display().to_string()
        );
        let config: TargetConfig = toml::from_str(&text).unwrap();
        let model = gaitfit_model::builtin::go2().unwrap();
        let (file, _) = truth(&config, Path::new("loop.toml"), &model).unwrap();
        let again = ThetaFile::parse(&file.to_toml().unwrap()).unwrap().candidate(&model).unwrap();
        assert_eq!(file.parameter.len(), 3);
        assert_eq!((again.robot.base_mass, again.robot.frictionloss[0]), (0.2, 0.1));
    }
}
