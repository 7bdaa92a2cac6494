//! Fits of a robot's simulator to its logs.
//!
//! [`adapt`] is the one pipeline: logs, rules, searches, results. [`air`] replays logs of a clamped robot, [`walk`] lets the
//! policy walk under the commands of its logs. [`arrangement`] says why a policy does not act as its logs do, [`weight`] weighs
//! links by standing poses, [`view`] shows a log beside its simulation.

pub mod adapt;
pub mod air;
pub mod arrangement;
#[cfg(feature = "cuda")]
mod gpu;
mod gpu_ahead;
mod gpu_logs;
mod gpu_predictions;
pub mod log;
pub mod log_check;
#[cfg(feature = "report")]
pub mod pieces;
#[cfg(feature = "report")]
pub mod view;
pub mod walk;
pub mod weight;

use gaitfit_run::{files, machine, policy_file, run, watch};
use gaitfit_settings::{Error, paths, robot, settings};
use gaitfit_world::{device, init, log_joints, theta, world};
#[cfg(feature = "report")]
use gaitfit_world::{replay, robot_file};
