//! Pictures of what gaitfit measured: charts, self-contained pages, pictures of gaits and logs, and 3-D replays.
//!
//! Without the feature `pages` the crate has only data that results keep: doubts, estimates, drift, replays.
//!
//! The crate knows nothing of simulators, optimisers or learning. Callers fill in plain data ([`FitReport`],
//! [`TrainingReport`], [`EvaluationReport`], [`LoopReport`], [`GaitPicture`], [`LogPicture`], [`Replay`],
//! [`SideBySide`], [`RunsReport`]) and get text
//! back; writing it to disk is theirs. All drawing is done with the kit in [`chart`].
//!
//! Conventions of all data: an unknown number is NaN (shown as "–"); an empty list or `None` leaves its section out.
//! Names are untrusted, because they come from files: pages escape them and leave out control characters. Every list
//! that speaks of joints carries their names.

#[cfg(feature = "pages")]
pub mod chart;
mod data;
#[cfg(feature = "pages")]
pub mod evaluation;
#[cfg(feature = "pages")]
pub mod fit;
#[cfg(feature = "pages")]
mod format;
#[cfg(feature = "pages")]
pub mod gait;
#[cfg(feature = "pages")]
pub mod log_picture;
#[cfg(feature = "pages")]
pub mod loop_report;
#[cfg(feature = "pages")]
mod page;
pub mod replay;
#[cfg(feature = "pages")]
pub mod runs;
#[cfg(feature = "pages")]
pub mod side_by_side;
#[cfg(feature = "pages")]
pub mod training;

pub use data::{Doubt, DoubtKind, Drift, Estimate, Link, ReportError, Setting};
pub use replay::{Replay, ReplayError};
#[cfg(feature = "pages")]
pub use {
    evaluation::{EvaluationReport, evaluation_html},
    fit::{FitReport, fit_html},
    gait::GaitPicture,
    log_picture::{LogPicture, log_picture_html, log_picture_svg},
    loop_report::{LoopReport, loop_html},
    replay::replay_html,
    runs::{RunsReport, runs_html},
    side_by_side::{SideBySide, side_by_side_html},
    training::{TrainingReport, training_report},
};
