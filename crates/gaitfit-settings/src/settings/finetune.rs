//! The configuration of `gaitfit finetune`: its settings and their defaults. `gaitfit config finetune` prints them.

use super::Preset;
use super::load::{CLEAR, Configuration, merge};
use crate::Spring;
use gaitfit_learn::TrainingSettings;
use gaitfit_learn::ppo;
use serde::{Deserialize, Serialize};
use toml::de::DeTable;
use toml::{Spanned, Table, Value};

/// The defaults, as `gaitfit config finetune` prints them.
pub const FINETUNE_DEFAULTS: &str = include_str!("finetune.toml");

/// All settings of one fine-tuning.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FinetuneConfig {
    /// Name of the run and of its folder; the configuration file's stem, or else `finetune`, when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub name: Option<String>,
    /// The policy to train further.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub policy: Option<String>,
    /// SHA-256 that the policy must have, as `gaitfit_policy_files::weights::write` writes it, hexadecimal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub policy_sha256: Option<String>,
    /// Fitted parameters, a `theta.toml`; the robot of the file when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub theta: Option<String>,
    /// SHA-256 that the file of fitted parameters must have, hexadecimal.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub theta_sha256: Option<String>,
    /// Robot file (MJCF or URDF); the built-in Go2 when absent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub robot: Option<String>,
    /// Drop what the engine cannot simulate in the robot file instead of refusing it.
    pub lenient: bool,
    /// Findings that a training may pass over, by name: `contradicted`, that walks contradict the fit.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub allow: Vec<String>,
    /// Whether each robot takes a row of `draws.csv` beside the fitted parameters instead of these.
    #[serde(default, skip_serializing_if = "is_off")]
    pub randomise_theta: bool,
    /// Springs on joints, written `JOINT=STIFFNESS` or `JOINT=STIFFNESS@REST`, N·m/rad and rad.
    pub spring: Vec<Spring>,
    /// Standard deviation of Gaussian torques at every joint and physics step, N·m.
    pub torque_noise: f64,
    /// Folder that holds the run folders.
    pub runs: String,
    /// One training each, one after the other.
    pub seeds: Vec<u64>,
    /// Seconds between checkpoints.
    pub checkpoint_seconds: f64,
    /// Solver effort of the physics.
    #[serde(with = "super::preset")]
    pub preset: Preset,
    /// How much is trained.
    pub train: TrainingSettings,
    /// Optimisation.
    pub ppo: ppo::Settings,
    /// What differs from the policy's own task; all of the task in the file of a run folder.
    pub task: Table,
}

/// Settings that are off are left out, so that trainings without them keep their hash.
fn is_off(asked: &bool) -> bool {
    !asked
}

impl Configuration for FinetuneConfig {
    const PRINTED_BY: &'static str = "gaitfit config finetune";
    const EXAMPLE: &'static str = "train.iterations=300";

    /// Lays the settings upon the defaults, which are not those of [`ppo::Settings`] and [`TrainingSettings`].
    fn complete(table: &mut DeTable<'_>) {
        // The text is a part of the program and is read by a test, so parsing it does not fail.
        let mut defaults = DeTable::parse(FINETUNE_DEFAULTS).map(Spanned::into_inner).unwrap_or_default();
        let given = std::mem::take(table);
        // A table in the place of a number or the other way round keeps its own place and is refused when it is read.
        merge(&mut defaults, given);
        *table = defaults;
    }
}

/// `changes` laid upon `task`, key by key; tables are merged, everything else is replaced. With `clear = true` a table
/// leaves nothing of the one that it is laid upon.
pub fn changed(mut task: Table, changes: &Table) -> Table {
    if changes.get(CLEAR).and_then(Value::as_bool) == Some(true) {
        task = Table::new();
    }
    for (key, change) in changes.iter().filter(|(key, change)| *key != CLEAR || !change.is_bool()) {
        match (task.get_mut(key), change) {
            // In place, so that the table keeps its position among the others.
            (Some(Value::Table(inner)), Value::Table(change)) => {
                *inner = changed(std::mem::take(inner), change);
            }
            // Laid upon an empty table, so that a `clear` in it does not become a setting.
            (_, Value::Table(change)) => {
                task.insert(key.clone(), changed(Table::new(), change).into());
            }
            _ => {
                task.insert(key.clone(), change.clone());
            }
        }
    }
    task
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::settings::load;
    use std::io::Write;

    #[test]
    fn the_printed_defaults_are_the_defaults_and_complete() {
        let defaults: FinetuneConfig = load(None, &[]).unwrap();
        let mut file = tempfile::NamedTempFile::new().unwrap();
        file.write_all(FINETUNE_DEFAULTS.as_bytes()).unwrap();
        assert_eq!(load::<FinetuneConfig>(Some(file.path()), &[]).unwrap(), defaults);
        assert_eq!((defaults.ppo.fixed_std, defaults.ppo.entropy_coefficient), (Some(0.5), 0.0));
        let printed: Table = toml::from_str(FINETUNE_DEFAULTS).unwrap();
        for (key, value) in Table::try_from(&defaults).unwrap() {
            for (inner, _) in value.as_table().into_iter().flatten() {
                // What only new networks have.
                let of_networks =
                    ["actor_hidden", "critic_hidden", "activation", "output_gain", "initial_std"];
                let known = printed[&key].get(inner).is_some() || of_networks.contains(&inner.as_str());
                assert!(known, "`{key}.{inner}` is missing");
            }
            assert!(printed.contains_key(&key), "`{key}` is missing");
        }
    }

    #[test]
    fn changes_keep_the_order_and_the_rest() {
        let table = |text: &str| toml::from_str::<Table>(text).unwrap();
        let task = table("a = 1\npose = { x = 1, y = 2 }\nlist = [1, 2]\n");
        let got = changed(task, &table("list = [3]\npose = { y = 5, z = 6 }\nb = 2\n"));
        let want = table("a = 1\npose = { x = 1, y = 5, z = 6 }\nlist = [3]\nb = 2\n");
        assert_eq!(got.to_string(), want.to_string());
        let task = table("a = 1\npose = { x = 1, y = 2 }\n");
        let got = changed(task, &table("pose = { clear = true, z = 6 }\nnew = { clear = true }\n"));
        assert_eq!(got.to_string(), table("a = 1\npose = { z = 6 }\nnew = {}\n").to_string());
    }
}
