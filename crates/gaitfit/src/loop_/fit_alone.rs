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
    // Only a look at the keys: errors of the file are reported by the reading below.
    let table = read_text(path, MAX_BYTES).ok().and_then(|text| text.parse::<toml::Table>().ok());
    let is_loop = table.is_some_and(|table| OF_LOOPS.iter().any(|key| table.contains_key(*key)));
    if !is_loop {
        return settings::load(Some(path), sets);
    }
    // A fit's setting stands in the loop's table [adapt], except those that both have.
    let of_loop = |set: &String| {
        // The first part of a dotted key is the table, or the key itself.
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
    // As seen from here: paths of the loop's file start at its own folder.
    let policy = paths::find(&config.policy, "policy", path)?.display().to_string();
    Ok(AdaptConfig {
        name: config.name.clone(),
        validate: shown(held),
        runs: config.runs.clone(),
        // Of the first round: only that one has the logs which the file names.
        ..config.adapt(1, policy, shown(fitted))
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn a_loops_file_is_a_fit_of_its_logs_with_every_fourth_kept_out() {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name);
        std::fs::create_dir(at("logs")).unwrap();
        (0..8).for_each(|log| std::fs::write(at(&format!("logs/walk_{log}.csv")), "").unwrap());
        std::fs::write(at("policy.safetensors"), "").unwrap();
        let text = "policy = \"policy.safetensors\"\nlogs = [\"logs\"]\n[adapt.optimizer]\nseed = 7\n";
        std::fs::write(at("walks.toml"), text).unwrap();
        let sets = ["optimizer.max_seconds=9.0".to_owned(), "name=\"mine\"".to_owned()];
        let config = settings(&at("walks.toml"), &sets).unwrap();
        assert_eq!((config.logs.len(), config.validate.len()), (6, 2));
        assert!(config.validate[0].ends_with("walk_3.csv"), "{:?}", config.validate);
        assert_eq!((config.optimizer.seed, config.optimizer.max_seconds), (7, 9.0));
        assert_eq!(config.name.as_deref(), Some("mine"));
        std::fs::write(at("walks.toml"), "policy = \"policy.safetensors\"\n[adapt]\n").unwrap();
        let error = settings(&at("walks.toml"), &[]).unwrap_err().to_string();
        assert!(error.contains("a loop without `logs`"), "{error}");
        std::fs::write(at("fit.toml"), "logs = [\"logs/walk_0.csv\"]\n[optimizer]\nseed = 5\n").unwrap();
        let config = settings(&at("fit.toml"), &[]).unwrap();
        assert_eq!((config.logs.len(), config.validate.len(), config.optimizer.seed), (1, 0, 5));
    }
}
