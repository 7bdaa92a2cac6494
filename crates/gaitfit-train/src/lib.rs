//! Trainings of policies and their evaluation.
//!
//! [`train`] trains by PPO in run folders, [`finetune`] continues in a fitted simulator, [`evaluate`] measures how well a policy
//! walks and compares policies. [`crew`] does several tasks at once.

pub mod crew;
pub mod evaluate;
pub mod finetune;
pub mod gait;
pub mod train;

use gaitfit_fit::{adapt, arrangement};
#[cfg(feature = "report")]
use gaitfit_run::machine;
use gaitfit_run::{ErrorKind, files, policy_file, run, tensorboard, watch};
use gaitfit_settings::{Error, paths, robot, settings};
#[cfg(feature = "report")]
use gaitfit_world::replay;
use gaitfit_world::{device, draws, robot_file, theta, world};
