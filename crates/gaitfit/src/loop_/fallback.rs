//! The simulator that a round trains in: that of its fit, or where walks contradict the fit that of the last one which they
//! did support, or else the robot's file.

use super::results::RoundResult;
use super::settled;
use super::stages::Stages;
use super::training_robot::TrainingRobot;
use crate::Error;
use crate::adapt::{AdaptResults, CONTRADICTED, Standing};
use gaitfit_adapt::ThetaFile;
use std::path::{Path, PathBuf};

/// The simulator of a round.
pub struct Model {
    /// The robot that policies are trained on.
    pub robot: TrainingRobot,
    /// The file of its numbers.
    pub theta: PathBuf,
    /// Why it is not the fit's, and whose it is; absent if it is.
    pub fallback: Option<String>,
}

/// The simulator to train in after the fit `results` of `theta`; `before`: the rounds before.
///
/// # Errors
/// Files that cannot be read or written.
pub fn model(
    stages: &Stages<'_>,
    round: &str,
    results: &AdaptResults,
    theta: &Path,
    before: &[RoundResult],
) -> Result<Model, Error> {
    // Someone has looked at the contradiction and wants the fit used.
    let allowed = stages.setup.config.finetune.allow.iter().any(|name| name == CONTRADICTED);
    if results.standing != Standing::Contradicted || allowed {
        let robot = TrainingRobot::fitted(theta.to_owned(), settled::of_fit(results, theta)?);
        return Ok(Model { robot, theta: theta.to_owned(), fallback: None });
    }
    let why = results.contradiction().unwrap_or_default();
    // The last fit that walks support is the next best; without one there is only the robot's file.
    if let Some(supported) = supported(before) {
        let theta = PathBuf::from(&supported.theta);
        let robot = TrainingRobot::fitted(theta.clone(), settled::of_round(supported)?);
        let fallback = format!("the policy is trained in the simulator of round {}: {why}", supported.round);
        return Ok(Model { robot, theta, fallback: Some(fallback) });
    }
    // The robot of the file, as a file of numbers without any.
    let name = format!("{round}/nominal.toml");
    let file = ThetaFile { robot: results.robot.clone(), ..ThetaFile::nominal() };
    let text = file.to_toml().map_err(|error| Error::failed(format!("cannot write {name}: {error}")))?;
    stages.folder.write(&name, text.as_bytes())?;
    let fallback = format!("the policy is trained in the simulator of the robot's file: {why}");
    Ok(Model { robot: TrainingRobot::nominal(), theta: stages.path(&name), fallback: Some(fallback) })
}

/// The last round whose fit walks did not contradict.
fn supported(before: &[RoundResult]) -> Option<&RoundResult> {
    before.iter().rev().find(|round| round.adapt.standing != Standing::Contradicted)
}
