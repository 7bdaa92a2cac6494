//! The fit of a loop's logs without the rest of the loop: `gaitfit fit` of a loop's configuration.

use super::rounds::split;
use crate::files::{MAX_BYTES, read_text};
use crate::settings::{self, AdaptConfig, LoopConfig, OF_LOOPS};
use crate::walk::log_files;
use crate::{Error, paths};
use std::path::Path;

/// Settings of the fit that stand at the top of a loop's configuration.
const SHARED: [&str; 7] = ["name", "policy", "robot", "lenient", "runs", "logs", "checkpoint_seconds"];

/// The settings of the fit at `path`: a fit's configuration, or the first round of a loop's, with the logs that the loop
/// keeps out. `sets` are as for a fit (`optimizer.seeds=3`), with either file.
///
/// # Errors
/// A file that cannot be read, unknown settings, a loop without logs.
pub fn settings(path: &Path, sets: &[String]) -> Result<AdaptConfig, Error> {
    let table = read_text(path, MAX_BYTES).ok().and_then(|text| text.parse::<toml::Table>().ok());
    let is_loop = table.is_some_and(|table| OF_LOOPS.iter().any(|key| table.contains_key(*key)));
    if !is_loop {
        return settings::load(Some(path), sets);
    }
    let of_loop = |set: &String| {
        let key = set.split(['.', '=']).next().unwrap_or_default().trim();
        let stays = SHARED.contains(&key) || OF_LOOPS.contains(&key) || key == "held_out";
        if stays { set.clone() } else { format!("adapt.{set}") }
    };
    let sets: Vec<String> = sets.iter().map(of_loop).collect();
    let config: LoopConfig = settings::load(Some(path), &sets)?;
    if config.logs.is_empty() {
        return Err(Error::settings(format!(
            "{}: a loop without `logs` collects its own; name the logs to fit, or run `gaitfit loop`",
            path.display()
        )));
    }
    let (files, _) = log_files::find(&config.logs, path)?;
    let (fitted, held) = split(files.into_iter().map(|file| file.path).collect(), config.held_out)?;
    let shown =
        |logs: Vec<_>| logs.iter().map(|log: &std::path::PathBuf| log.display().to_string()).collect();
    let policy = paths::find(&config.policy, "policy", path)?.display().to_string();
    Ok(AdaptConfig {
        name: config.name.clone(),
        validate: shown(held),
        runs: config.runs.clone(),
        ..config.adapt(1, policy, shown(fitted))
    })
}
