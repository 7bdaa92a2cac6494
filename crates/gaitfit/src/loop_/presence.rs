//! The robot of a loop, if it is there: found out once, when the loop begins. A loop that went on without it measures
//! elsewhere, so it does not change its mind when it is resumed.

use super::files;
use super::setup::Setup;
use crate::Error;
use crate::run::RunFolder;
use crate::settings::{TargetConfig, TargetKind};
use crate::target::{Presence, Target, asks_for_python, probe};
use crate::watch::Watch;

const PRESENCE: &str = "target.json";

/// The robot, or why there is none though the settings name one.
///
/// # Errors
/// A robot that must be there, or was when the loop began, and is not.
pub fn target(
    setup: &Setup,
    folder: &RunFolder,
    watch: &Watch<'_>,
) -> Result<(Option<Target>, Option<String>), Error> {
    let Some(target) = &setup.config.target else { return Ok((None, None)) };
    let theta = files::truth(folder);
    let words = words(target);
    // Made only once it is known that the robot is there and which Python runs it.
    let run = |python: Option<&str>| -> Result<Option<Target>, Error> {
        let target = setup.target(target, theta.clone(), python)?;
        if let Target::Command(command) = &target {
            // A later round would find out only after hours.
            command.check_programs()?;
        }
        Ok(Some(target))
    };
    // Nothing can be asked, so the robot counts as there.
    if words.is_empty() {
        return Ok((run(None)?, None));
    }
    // A resumed run keeps to what it found at first: rounds with and without a robot cannot be compared.
    let began = began(folder)?;
    if let Some(Presence { there: false, why }) = began {
        watch.note(&format!("this run began without its robot ({why}) and ends without it"));
        return Ok((None, Some(why)));
    }
    let answer = probe(&words, target.timeout_seconds, watch);
    // An interruption ends the probe too, and it must not be taken for an absent robot.
    if watch.stop() {
        return Err(Error::interrupted_with_nothing("interrupted"));
    }
    let why = match answer {
        Ok(python) => {
            folder.write_json(PRESENCE, &Presence { there: true, why: String::new() })?;
            return Ok((run(python.as_deref())?, None));
        }
        Err(why) => why,
    };
    // A robot that was there and is not now would leave some of the rounds unmeasured.
    if began.is_some() {
        return Err(missing(format!(
            "{}: the robot was present when this run began and is absent now: {why}. Connect it, or start afresh \
             without --resume.",
            folder.path().display()
        )));
    }
    // Without a probe the words were only looked through for Python, so its lack is no absent robot.
    if target.probe.is_empty() {
        return Err(missing(format!(
            "{}: no Python for the words of [target]: {why}. Install one, or name it in GAITFIT_PYTHON.",
            setup.config_path.display()
        )));
    }
    folder.write_json(PRESENCE, &Presence { there: false, why: why.clone() })?;
    watch
        .note(&format!("the robot is absent ({why}); policies are measured in the fitted simulator instead"));
    Ok((None, Some(why)))
}

/// Command that tells whether the robot is there, and which Python runs it; empty if neither is asked for.
fn words(target: &TargetConfig) -> Vec<String> {
    let python = asks_for_python(&target.collect) || asks_for_python(&target.evaluate);
    match target.kind {
        TargetKind::Command if !target.probe.is_empty() => target.probe.clone(),
        TargetKind::Command if python => ["{python}", "--version"].map(str::to_owned).to_vec(),
        _ => Vec::new(),
    }
}

fn began(folder: &RunFolder) -> Result<Option<Presence>, Error> {
    let Some(text) = folder.read(PRESENCE)? else { return Ok(None) };
    serde_json::from_str(&text).map(Some).map_err(|error| {
        let problem = format!("{error}. Restore it, or start afresh without --resume.");
        Error::content(&folder.path().join(PRESENCE), problem)
    })
}

fn missing(message: String) -> Error {
    Error::Missing(message)
}
