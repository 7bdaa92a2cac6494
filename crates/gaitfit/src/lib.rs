//! The method of gaitfit as a library: fits of a robot's simulator to its logs, training and fine-tuning of policies,
//! and the loop that joins them.
//!
//! Every stage is a function of typed settings ([`settings`]) that returns a typed result or an [`Error`] that names the
//! object and the remedy. Stages report progress and may be stopped through one callback ([`watch::Watch`]). What they
//! compute lies in run folders ([`run::RunFolder`]), from which an interrupted stage goes on to the same bits.

pub mod adapt;
pub mod air;
pub mod arrangement;
pub mod collect;
mod crew;
pub mod device;
mod draws;
mod error;
pub mod evaluate;
pub mod excite;
pub mod export_theta;
pub mod finetune;
pub mod gait;
mod gpu;
pub mod init;
pub mod log;
pub mod log_check;
pub mod log_folder;
mod log_joints;
pub mod loop_;
pub mod new;
pub mod paths;
mod pieces;
pub mod replay;
pub mod reproduce;
pub mod robot;
pub mod robot_file;
pub mod runs;
pub mod settings;
mod skeleton;
mod spring;
pub mod target;
mod theta;
pub mod train;
pub mod view;
pub mod walk;
pub mod weight;
pub mod world;

pub use collect::{CollectSettings, collect, collect_in};
pub use error::Error;
pub use evaluate::{EvaluateSettings, evaluate, evaluate_in};
pub use export_theta::{ExportSettings, export_theta};
pub use gaitfit_run::Error as RunError;
use gaitfit_run::tensorboard;
pub use gaitfit_run::{Access, ErrorKind, brief, files, machine, policy_file, run, short_numbers, watch};
pub use spring::{Spring, SpringError};
