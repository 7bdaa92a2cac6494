//! The method of gaitfit as a library: fits of a robot's simulator to its logs, training and fine-tuning of policies,
//! and the loop that joins them.
//!
//! Every stage is a function of typed settings ([`settings`]) that returns a typed result or an [`Error`] that names the
//! object and the remedy. Stages report progress and may be stopped through one callback ([`watch::Watch`]). What they
//! compute lies in run folders ([`run::RunFolder`]), from which an interrupted stage resumes to the same bits.
//!
//! Most stages live in crates of their own, which this one names in one place: `gaitfit-run`, `gaitfit-settings`,
//! `gaitfit-world`, `gaitfit-fit`, `gaitfit-train`, `gaitfit-excite` and `gaitfit-export`.

pub mod collect;
#[cfg(test)]
mod devices_test;
pub mod log_folder;
pub mod loop_;
pub mod new;
pub mod reproduce;
pub mod runs;
pub mod target;

pub use collect::{CollectSettings, collect, collect_in};
pub use gaitfit_excite as excite;
pub use gaitfit_export as export_theta;
pub use gaitfit_export::{ExportSettings, export_theta};
#[cfg(feature = "report")]
pub use gaitfit_fit::view;
pub use gaitfit_fit::{adapt, air, arrangement, log, log_check, walk, weight};
pub use gaitfit_run::Error as RunError;
pub use gaitfit_run::{Access, ErrorKind, brief, files, machine, policy_file, run, short_numbers, watch};
pub use gaitfit_settings::{Error, Spring, SpringError, paths, robot, settings};
pub use gaitfit_train::evaluate::{EvaluateSettings, evaluate, evaluate_in};
pub use gaitfit_train::{evaluate, finetune, gait, train};
pub use gaitfit_world::{device, init, replay, robot_file, theta, world};

#[cfg(feature = "report")]
use gaitfit_fit::pieces;
use gaitfit_train::crew;
