//! The policy that a path names: a file, or a run folder whose policy is taken.

use crate::files::read_text;
use crate::run::protocol::RESULT;
use crate::{Error, files};
use serde::Deserialize;
use std::path::{Path, PathBuf};

/// The policy's file in the folder of a seed.
const POLICY: &str = "policy.safetensors";
/// Max number of entries of a folder that are looked at.
const MAX_ENTRIES: usize = 10_000;

/// A policy's file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct PolicyFile {
    /// Where it is.
    pub path: PathBuf,
    /// Which of several policies was taken, in words.
    pub note: Option<String>,
}

/// Part of `result.json` that shows which policy is the best.
#[derive(Deserialize)]
struct Results {
    results: Outcome,
}

/// The result of a training, which has seeds, or of a loop, which names its policy.
#[derive(Deserialize)]
struct Outcome {
    policy: Option<String>,
    #[serde(default)]
    seeds: Vec<Seed>,
}

#[derive(Deserialize)]
struct Seed {
    seed: u64,
    linear_velocity_error: f64,
}

/// A policy's name for people: its file's stem, or in a run folder those of the run and the seed (`walk, seed-1`).
pub fn title(path: &Path) -> String {
    let part = |path: &Path| path.file_name().map(|name| name.to_string_lossy().into_owned());
    let stem = path.file_stem().map(|stem| stem.to_string_lossy().into_owned());
    if stem.as_deref() != Path::new(POLICY).file_stem().map(|stem| stem.to_string_lossy()).as_deref() {
        return stem.unwrap_or_else(|| path.display().to_string());
    }
    // Every training calls its file `policy`, so the folders of run and seed make the name.
    let above = path.parent().into_iter().flat_map(|seed| [seed.parent(), Some(seed)]);
    let named: Vec<String> = above.flatten().filter_map(part).collect();
    if named.is_empty() { "policy".to_owned() } else { named.join(", ") }
}

/// The policy's file that `path` names: itself, or if it is the folder of a seed, a training, a fine-tuning or a loop, the
/// policy that came out of it. Of several seeds it is the one whose policy followed commands best at the end of its training.
///
/// # Errors
/// A folder without a policy.
pub fn find(path: &Path) -> Result<PolicyFile, Error> {
    if !path.is_dir() {
        return Ok(PolicyFile { path: path.to_owned(), note: None });
    }
    let file = |path: PathBuf| PolicyFile { path, note: None };
    // The nearest place first: the folder of one seed, then that of a loop, then a training with several seeds.
    if path.join(POLICY).is_file() {
        return Ok(file(path.join(POLICY)));
    }
    let results = results(path);
    // A loop names its policy as it was seen from where the loop ran; the folder may have moved.
    let named = results.as_ref().and_then(|results| Path::new(results.policy.as_ref()?).file_name());
    if let Some(policy) = named.map(|name| path.join("policies").join(name)).filter(|policy| policy.is_file())
    {
        let note = Some(format!("the policy of {} is {}, its best", path.display(), policy.display()));
        return Ok(PolicyFile { path: policy, note });
    }
    let seeds = seeds(path);
    let at = |seed: u64| path.join(format!("seed-{seed}")).join(POLICY);
    // A training that goes on or was interrupted has policies of its last checkpoints.
    match seeds[..] {
        [] => Err(none(path)),
        [one] => Ok(file(at(one))),
        [first, ..] => {
            // Velocity errors stand in the results of a finished training only.
            let known = results.map(|results| results.seeds).unwrap_or_default();
            let best = known
                .iter()
                // A seed whose folder was removed cannot be taken.
                .filter(|one| seeds.contains(&one.seed) && one.linear_velocity_error.is_finite())
                .min_by(|a, b| a.linear_velocity_error.total_cmp(&b.linear_velocity_error));
            let (seed, why) = match best {
                Some(best) => (best.seed, "which followed commands best in its training"),
                None => (first, "the first, as the training is not finished"),
            };
            let note = format!(
                "{} has policies of {} seeds; seed {seed} is taken, {why}. Name another by its folder, such as {}",
                path.display(),
                seeds.len(),
                path.join(format!("seed-{}", seeds.iter().find(|&&one| one != seed).unwrap_or(&first)))
                    .display()
            );
            Ok(PolicyFile { path: at(seed), note: Some(note) })
        }
    }
}

/// Whether a folder is a run's or a seed's that has a policy.
pub fn holds_policy(folder: &Path) -> bool {
    folder.is_dir() && find(folder).is_ok()
}

/// The result of a finished run.
fn results(folder: &Path) -> Option<Outcome> {
    let text = read_text(&folder.join(RESULT), files::MAX_BYTES).ok()?;
    serde_json::from_str::<Results>(&text).ok().map(|file| file.results)
}

/// Seeds whose folders have a policy, in order.
fn seeds(folder: &Path) -> Vec<u64> {
    // Entries that cannot be read are left out, as if they were not there.
    let entries = std::fs::read_dir(folder).into_iter().flatten().flatten().take(MAX_ENTRIES);
    let seed = |entry: std::fs::DirEntry| {
        let seed = entry.file_name().to_str()?.strip_prefix("seed-")?.parse().ok()?;
        entry.path().join(POLICY).is_file().then_some(seed)
    };
    let mut seeds: Vec<u64> = entries.filter_map(seed).collect();
    seeds.sort_unstable();
    seeds
}

/// Makes the error of a folder without a policy.
fn none(folder: &Path) -> Error {
    let shown = folder.display();
    let fit = folder.join("theta.toml").is_file();
    Error::settings(match fit {
        true => format!(
            "{shown}: the run folder of a fit, which has no policy; name a policy's file or the run folder of a training"
        ),
        false => format!(
            "{shown}: a folder without a policy. A training's run folder has seed-1/{POLICY}; name that folder, or a policy's \
             file (.safetensors, .onnx, .toml)"
        ),
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    fn folder(files: &[(&str, &str)]) -> tempfile::TempDir {
        let folder = tempfile::tempdir().unwrap();
        for (name, text) in files {
            let path = folder.path().join(name);
            std::fs::create_dir_all(path.parent().unwrap()).unwrap();
            std::fs::write(path, text).unwrap();
        }
        folder
    }

    #[test]
    fn a_file_is_itself_and_a_folder_is_the_policy_in_it() {
        assert_eq!(find(Path::new("none.onnx")).unwrap().path, Path::new("none.onnx"));
        let run = folder(&[("seed-4/policy.safetensors", ""), ("seed-5/metrics.jsonl", "")]);
        let policy = run.path().join("seed-4/policy.safetensors");
        for path in [run.path().to_owned(), run.path().join("seed-4")] {
            assert_eq!(find(&path).unwrap(), PolicyFile { path: policy.clone(), note: None });
        }
    }

    #[test]
    fn of_several_seeds_the_one_that_follows_commands_best_is_taken_and_named() {
        let result = r#"{"results":{"seeds":[{"seed":1,"linear_velocity_error":0.3,"reward":1.0},
            {"seed":2,"linear_velocity_error":0.1,"reward":1.0},{"seed":9,"linear_velocity_error":0.0}]}}"#;
        let files =
            [("seed-1/policy.safetensors", ""), ("seed-2/policy.safetensors", ""), ("result.json", result)];
        let run = folder(&files);
        let policy = find(run.path()).unwrap();
        assert_eq!(policy.path, run.path().join("seed-2/policy.safetensors"));
        let note = policy.note.unwrap();
        assert!(note.contains("seed 2 is taken") && note.contains("seed-1"), "{note}");
        let policy = find(folder(&files[..2]).path()).unwrap();
        assert!(
            policy.path.ends_with("seed-1/policy.safetensors")
                && policy.note.unwrap().contains("not finished")
        );
    }

    #[test]
    fn a_policy_has_a_name() {
        let title = |path: &str| super::title(Path::new(path));
        assert_eq!(title("assets/go2-walk.safetensors"), "go2-walk");
        assert_eq!(title("runs/walk/seed-1/policy.safetensors"), "walk, seed-1");
        assert_eq!(title("runs/walk"), "walk");
        assert_eq!(title("policy.safetensors"), "policy");
    }

    #[test]
    fn a_loops_best_policy_is_taken_and_folders_without_one_are_named() {
        let result = r#"{"results":{"policy":"runs/old/policies/policy-1.safetensors"}}"#;
        let run = folder(&[("result.json", result), ("policies/policy-1.safetensors", "")]);
        assert_eq!(find(run.path()).unwrap().path, run.path().join("policies/policy-1.safetensors"));
        let empty = folder(&[]);
        assert!(find(empty.path()).unwrap_err().to_string().contains("a folder without a policy"));
        let fit = folder(&[("theta.toml", "")]);
        assert!(find(fit.path()).unwrap_err().to_string().contains("the run folder of a fit"));
        assert!(!holds_policy(fit.path()) && holds_policy(run.path()));
    }
}
