//! The simulated robots that a loop fine-tunes policies on.

use super::settled;
use crate::settings::{ControlsConfig, TargetConfig, TruthConfig};
use crate::{Error, Spring};
use std::path::{Path, PathBuf};

/// The simulated robot that a policy is fine-tuned on.
#[derive(Clone, Debug, Default)]
pub struct TrainingRobot {
    /// Its numbers; those of the robot's file without any.
    pub theta: Option<PathBuf>,
    /// Settings that differ from the task's.
    pub task: toml::Table,
    /// Its springs.
    pub spring: Vec<Spring>,
    /// Its torque noise, N·m.
    pub torque_noise: f64,
    /// Whether its numbers are those of a fit.
    pub fitted: bool,
    /// Kinds of its parameters that are known, so that trainings do not draw them at random.
    pub settled: Vec<String>,
    /// Whether each robot takes other numbers of the fit's joint intervals.
    pub drawn: bool,
    /// Factor on the iterations that the settings ask for.
    pub times: u32,
}

impl TrainingRobot {
    /// A simulated target, whose numbers stand in a file.
    pub fn target(theta: PathBuf, target: &TargetConfig) -> Self {
        let (spring, torque_noise) = (target.spring.clone(), target.torque_noise);
        Self { theta: Some(theta), spring, torque_noise, times: 1, ..Self::default() }
    }

    /// The robot of the file, which nothing was fitted to.
    pub fn nominal() -> Self {
        Self { times: 1, ..Self::default() }
    }

    /// Robots that differ at random.
    pub fn randomised(controls: &ControlsConfig) -> Self {
        let (task, torque_noise) = (controls.randomisation(), controls.torque_noise);
        Self { task, torque_noise, ..Self::nominal() }
    }

    /// The robot of a fit, which has determined these kinds of parameters.
    pub fn fitted(theta: PathBuf, settled: Vec<String>) -> Self {
        Self { theta: Some(theta), fitted: true, settled, times: 1, ..Self::default() }
    }

    /// Robots of its joint intervals.
    pub fn drawn(self) -> Self {
        Self { drawn: true, ..self }
    }

    /// The robot whose numbers are known.
    ///
    /// # Errors
    /// A file that cannot be read.
    pub fn known(theta: &Path, truth: &TruthConfig) -> Result<Self, Error> {
        let (spring, torque_noise) = (truth.spring.clone(), truth.torque_noise);
        let settled = settled::of_file(theta)?;
        Ok(Self { theta: Some(theta.to_owned()), spring, torque_noise, settled, ..Self::nominal() })
    }
}
