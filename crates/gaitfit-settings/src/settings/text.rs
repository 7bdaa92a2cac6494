//! The text `gaitfit config` prints.

use super::TaskName;
use gaitfit_learn::task::preset;

/// A configuration with every setting at its default, commented. `robot` and `logs` have no default.
pub const DEFAULTS: &str = include_str!("adapt.toml");

/// A configuration of `gaitfit train` with every setting at its default, commented, for a built-in task.
pub fn train_defaults(task: TaskName) -> String {
    let mut text = include_str!("train.toml").to_owned();
    text.push_str(&format!("base = \"{}\"\n", task.name()));
    for line in preset(task.name()).unwrap_or_default().lines() {
        // A table of the task's own file is one of [task] here.
        match line.strip_prefix('[') {
            Some(table) => text.push_str(&format!("[task.{table}\n")),
            None => text.push_str(&format!("{line}\n")),
        }
    }
    text
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::settings::{AdaptConfig, TrainConfig, load};
    use std::io::Write;

    #[test]
    fn the_printed_defaults_are_the_defaults() {
        let parsed: AdaptConfig = toml::from_str(DEFAULTS).unwrap();
        assert_eq!(parsed, AdaptConfig::default());
    }

    #[test]
    fn every_setting_is_printed() {
        let table: toml::Table = toml::from_str(DEFAULTS).unwrap();
        for (key, value) in toml::Table::try_from(AdaptConfig::default()).unwrap() {
            let printed = table.get(&key).unwrap_or_else(|| panic!("`{key}` is missing"));
            for (inner, _) in value.as_table().into_iter().flatten() {
                assert!(printed.get(inner).is_some(), "`{key}.{inner}` is missing");
            }
        }
        for optional in
            ["name", "kp", "kd", "validate_gains", "rmse_rad", "truth", "published", "lower", "upper"]
        {
            assert!(DEFAULTS.contains(optional), "`{optional}` is not mentioned");
        }
    }

    #[test]
    fn the_printed_training_defaults_are_the_defaults_and_complete() {
        for task in [TaskName::Velocity, TaskName::Biped] {
            let text = train_defaults(task);
            let mut file = tempfile::NamedTempFile::new().unwrap();
            file.write_all(text.as_bytes()).unwrap();
            let parsed: TrainConfig = load(Some(file.path()), &[]).unwrap();
            let defaults: TrainConfig = load(None, &[format!("task.base={}", task.name())]).unwrap();
            assert_eq!(parsed, defaults);
            let printed: toml::Table = toml::from_str(&text).unwrap();
            missing("", &toml::Table::try_from(&defaults).unwrap(), &printed);
        }
        assert_eq!(load::<TrainConfig>(None, &[]).unwrap(), TrainConfig::default());
    }

    fn missing(path: &str, settings: &toml::Table, printed: &toml::Table) {
        for (key, value) in settings {
            let written = printed.get(key).unwrap_or_else(|| panic!("`{path}{key}` is missing"));
            if let (Some(inner), Some(written)) = (value.as_table(), written.as_table()) {
                missing(&format!("{path}{key}."), inner, written);
            }
        }
    }
}
