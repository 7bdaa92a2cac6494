//! Reading robot files.

use crate::Error;
use gaitfit_model::{Model, ReadOptions, Root};
use std::path::Path;

/// The built-in Go2.
pub fn go2() -> Result<Model, Error> {
    Ok(gaitfit_model::builtin::go2()?)
}

/// How the robot's base hangs in the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// As the file says.
    File,
    /// Clamped.
    Clamped,
}

/// Reads an MJCF or URDF robot.
pub fn read(path: &Path, lenient: bool, hold: Hold) -> Result<Model, Error> {
    let root = match hold {
        Hold::File => None,
        Hold::Clamped => Some(Root::Fixed),
    };
    Ok(gaitfit_model::read(path, &ReadOptions { lenient, root })?)
}
