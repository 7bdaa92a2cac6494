//! Robots and the worlds that they are simulated in: what evaluations, trainings and fits share.
//!
//! [`world::World`] is a policy and the simulator it runs in. [`init`] guesses a walking task for a robot. [`device`] is what
//! computes, [`theta`] and [`draws`] read the files of a fit, [`replay`] turns a robot's motion into what a page draws.

pub mod device;
pub mod draws;
mod dress;
pub mod init;
pub mod log_joints;
pub mod replay;
pub mod robot_file;
mod skeleton;
pub mod theta;
pub mod world;

#[cfg(test)]
use gaitfit_run::ErrorKind;
use gaitfit_run::{files, machine, policy_file, run};
use gaitfit_settings::{Error, Spring, paths, robot, settings};
