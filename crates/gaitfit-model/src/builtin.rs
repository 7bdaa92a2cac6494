//! Robots that come with the library, so that nothing needs a file.

use crate::error::ModelError;
use crate::model::Model;
use crate::read::{ReadOptions, read_mjcf_str};

/// The Unitree Go2 in MJCF; the file names its sources.
pub const GO2: &str = include_str!("../robots/go2.xml");

/// The Unitree Go2: a floating trunk, twelve motors, spheres as feet on a level floor.
///
/// # Errors
/// None that a file which comes with the library and is read in its tests can give.
pub fn go2() -> Result<Model, ModelError> {
    read_mjcf_str(GO2, &ReadOptions::default())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn the_go2_has_twelve_motors() {
        let model = go2().unwrap();
        assert_eq!((model.name.as_str(), model.nq(), model.nv(), model.nu()), ("go2", 19, 18, 12));
        assert!(model.joint("FL_calf_joint").is_some() && !model.pairs.is_empty());
    }
}
