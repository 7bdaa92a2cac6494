//! A log as fits take it.

use gaitfit_log::Trajectory;
use std::path::PathBuf;

/// A log, or a stretch of one, ready to be compared with simulations.
#[derive(Clone, Debug)]
pub struct Log {
    /// As the configuration leads to it; stretches of a log that was cut say where they begin.
    pub name: String,
    /// Where it was found.
    pub path: PathBuf,
    /// Files beside it that were read too.
    pub sidecars: Vec<PathBuf>,
    /// The log's own names of its joints, in the trajectory's order.
    pub joints: Vec<String>,
    /// Its samples, under the robot's names: all joints in the robot's order for a clamped robot, the policy's joints in
    /// the policy's order and at the policy's rate for a walking one. Parts of the base's state that are not finite are
    /// absent.
    pub trajectory: Trajectory,
}
