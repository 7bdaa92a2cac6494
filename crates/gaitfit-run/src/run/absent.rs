//! Error if there is no run to resume: which runs there are, and what to do.

use super::names::own_name;
use crate::Error;
use gaitfit_model::shown;
use std::collections::BTreeSet;
use std::path::Path;

/// Max number of names in a message.
const MAX_NAMED: usize = 5;
/// Likeness of names, from 0 to 1, from which one may be a slip of the other.
const ALIKE: f64 = 0.85;

/// Says that no run called `name` is in `runs`, and what is there instead.
pub fn nothing_to_resume(runs: &Path, name: &str) -> Error {
    let place = runs.display();
    let start = "leave out --resume to start one";
    // A folder may hold a run of another name, because `name` in its settings wins.
    if let Some(own) = own_name(&runs.join(name)).map(|own| shown(&own)) {
        return Error::settings(format!(
            "--resume: the folder {place}/{name} holds a run called `{own}`, by the `name` in its config.toml. Give --name \
             {own} to continue that run, or set `name` there to `{name}` to continue this folder; to begin a run, {start}"
        ));
    }
    let mut names: Vec<(f64, String)> =
        names(runs).into_iter().map(|other| (strsim::jaro_winkler(&other, name), other)).collect();
    // The nearest name first: a typing error is the usual reason.
    names.sort_by(|a, b| b.0.total_cmp(&a.0));
    let there = match names.first() {
        None => String::new(),
        Some((alike, nearest)) if *alike > ALIKE => format!(" Did you mean --name {}?", shown(nearest)),
        Some(_) => {
            let more = if names.len() > MAX_NAMED { ", …" } else { "" };
            let listed: Vec<String> = names.iter().take(MAX_NAMED).map(|(_, other)| shown(other)).collect();
            format!(" There are {}{more}.", listed.join(", "))
        }
    };
    Error::settings(format!("--resume: there is no run called `{name}` in {place}; {start}.{there}"))
}

/// The names of the runs in a folder.
fn names(runs: &Path) -> BTreeSet<String> {
    let entries = std::fs::read_dir(runs).into_iter().flatten().flatten();
    // A run folder has this file from its beginning, see `RunFolder`.
    let begun = entries.filter(|entry| entry.path().join(".lock").is_file());
    begun
        .map(|entry| {
            own_name(&entry.path()).unwrap_or_else(|| entry.file_name().to_string_lossy().into_owned())
        })
        .collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use crate::run::RunFolder;

    #[test]
    fn a_run_that_is_not_there_is_not_begun_but_named() {
        let runs = tempfile::tempdir().unwrap();
        let resumed = |name: &str| RunFolder::begin(runs.path(), name, true).unwrap_err().to_string();
        let error = resumed("walk");
        assert!(error.contains("no run called `walk`") && error.ends_with("to start one."), "{error}");
        for name in ["walk", "walk", "swim"] {
            let folder = RunFolder::begin(runs.path(), name, false).unwrap();
            folder.write("config.toml", format!("name = \"{name}\"\n").as_bytes()).unwrap();
        }
        assert!(resumed("wolk").ends_with("Did you mean --name walk?"), "{}", resumed("wolk"));
        assert!(resumed("zzz").ends_with("There are swim, walk."), "{}", resumed("zzz"));
        // A copy under another name keeps its own.
        std::fs::rename(runs.path().join("swim"), runs.path().join("copy")).unwrap();
        let error = resumed("copy");
        assert!(error.contains("holds a run called `swim`") && error.contains("Give --name swim"), "{error}");
        assert_eq!(std::fs::read_dir(runs.path()).unwrap().count(), 3, "nothing was begun");
    }
}
