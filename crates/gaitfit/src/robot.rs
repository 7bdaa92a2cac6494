//! Reading robot files.

use crate::Error;
use gaitfit_learn::task::TaskSettings;
use gaitfit_model::patterns::plain;
use gaitfit_model::{Model, ReadOptions, Root};
use std::path::Path;

/// The built-in Go2.
pub fn go2() -> Result<Model, Error> {
    Ok(gaitfit_model::builtin::go2()?)
}

/// Whether a robot is the built-in Go2 or a file of it: the built-in tasks are that robot's.
pub fn is_go2(model: &Model) -> bool {
    let Ok(go2) = gaitfit_model::builtin::go2() else { return false };
    let names = |model: &Model| -> Vec<String> {
        let mut names: Vec<_> = model.joints.iter().map(|joint| plain(&joint.name).to_owned()).collect();
        names.sort_unstable();
        names
    };
    model.name == go2.name && names(model) == names(&go2)
}

/// The task of a robot whose policy says none: the built-in one of the Go2, and of another robot what `gaitfit init`
/// finds.
///
/// # Errors
/// A robot in which no legs are found.
pub fn usual_task(model: &Model) -> Result<TaskSettings, Error> {
    if is_go2(model) {
        return Ok(TaskSettings::default());
    }
    Ok(crate::init::look(model).map_err(Error::failed)?.settings)
}

/// How the robot's base hangs in the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Hold {
    /// As the file says.
    File,
    /// Clamped.
    Clamped,
}

/// Reads an MJCF or URDF robot for a world of its own: a floating robot whose file has no floor gets one.
pub fn read(path: &Path, lenient: bool, hold: Hold) -> Result<Model, Error> {
    let root = match hold {
        Hold::File => None,
        Hold::Clamped => Some(Root::Fixed),
    };
    Ok(gaitfit_model::read(path, &ReadOptions { lenient, root, add_floor: true })?)
}

/// Reads an MJCF or URDF robot as MuJoCo reads it: without a floor that the file does not have.
pub fn as_written(path: &Path, lenient: bool) -> Result<Model, Error> {
    Ok(gaitfit_model::read(path, &ReadOptions { lenient, root: None, add_floor: false })?)
}

/// What to know of a robot that was read, before trusting what it shows: what was added or mended, what a lenient
/// reading took away, what bounds no torque or touches no ground.
pub fn remarks(model: &Model) -> Vec<String> {
    let changed = model.changed.iter().map(|change| format!("{} {}", change.what, change.how));
    changed.chain(model.warnings()).collect()
}
