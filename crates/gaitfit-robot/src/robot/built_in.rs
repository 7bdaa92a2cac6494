//! The robots that the program knows.

use super::Robot;
use crate::RobotError;

/// Names of the built-in robots, as `--robot` takes them, and their files.
pub const BUILT_IN: [(&str, &str); 5] = [
    ("unitree-go2", include_str!("../../robots/go2.toml")),
    ("unitree-go2w", include_str!("../../robots/go2w.toml")),
    ("unitree-b2", include_str!("../../robots/b2.toml")),
    ("unitree-g1", include_str!("../../robots/g1.toml")),
    ("unitree-h1-2", include_str!("../../robots/h1_2.toml")),
];

impl Robot {
    /// The built-in robot of this name.
    ///
    /// # Errors
    /// A name that is none of [`BUILT_IN`].
    pub fn built_in(name: &str) -> Result<Self, RobotError> {
        let text = BUILT_IN.iter().find(|(known, _)| *known == name).map(|(_, text)| *text);
        let Some(text) = text else {
            let names: Vec<&str> = BUILT_IN.iter().map(|(name, _)| *name).collect();
            return Err(RobotError::File {
                file: name.to_owned(),
                problem: format!("is no built-in robot; they are {}, or name a .toml file", names.join(", ")),
            });
        };
        Self::parse(text, name)
    }
}
