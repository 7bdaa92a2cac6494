//! The tasks that come with the program.

use super::TaskSettings;

/// Velocity tracking on flat ground at a trot.
const VELOCITY: &str = include_str!("velocity.toml");
/// Walking on the hind legs.
const BIPED: &str = include_str!("biped.toml");

/// Settings of the task called `name` (`velocity` or `biped`), with their comments, as TOML.
pub fn preset(name: &str) -> Option<&'static str> {
    match name {
        "velocity" => Some(VELOCITY),
        "biped" => Some(BIPED),
        _ => None,
    }
}

impl Default for TaskSettings {
    /// Velocity tracking.
    fn default() -> Self {
        match toml::from_str(VELOCITY) {
            Ok(settings) => settings,
            Err(error) => unreachable!("a test reads the built-in tasks: {error}"),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::task::reward;

    #[test]
    fn built_in_tasks_read_and_list_known_rewards_in_their_order() {
        for name in ["velocity", "biped"] {
            let task: TaskSettings = toml::from_str(preset(name).unwrap()).unwrap();
            // A term that a task does not list weighs nothing.
            let place = |name: &String| reward::TERMS.iter().position(|term| term.name == name);
            let places: Vec<usize> = task.rewards.keys().map(|name| place(name).unwrap()).collect();
            assert!(!places.is_empty() && places.is_sorted(), "{name}: {places:?}");
        }
    }
}
