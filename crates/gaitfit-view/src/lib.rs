//! Pictures of what gaitfit measured: charts, self-contained pages, pictures of gaits and logs, and 3-D replays.
//!
//! The crate knows nothing of simulators, optimisers or learning. Callers fill in plain data ([`FitReport`],
//! [`TrainingReport`], [`EvaluationReport`], [`LoopReport`], [`GaitPicture`], [`LogPicture`], [`Replay`],
//! [`SideBySide`], [`RunsReport`]) and get text
//! back; writing it to disk is theirs. All drawing is done with the kit in [`chart`].
//!
//! Conventions of all data: an unknown number is NaN (shown as "–", written to JSON as `null`); an empty list or `None`
//! leaves its section out. Names are untrusted, because they come from files: pages escape them and leave out control
//! characters. Every list that speaks of joints carries their names.

pub mod chart;
pub mod evaluation;
pub mod fit;
mod format;
pub mod gait;
pub mod log_picture;
pub mod loop_report;
mod nullable;
mod page;
pub mod replay;
pub mod runs;
pub mod side_by_side;
pub mod training;

pub use evaluation::{EvaluationReport, evaluation_html};
pub use fit::{FitReport, fit_html};
pub use gait::GaitPicture;
pub use log_picture::{LogPicture, log_picture_html, log_picture_svg};
pub use loop_report::{LoopReport, loop_html};
pub use page::{Doubt, DoubtKind, Link, ReportError, Setting};
pub use replay::{Replay, ReplayError, replay_html};
pub use runs::{RunsReport, runs_html};
pub use side_by_side::{SideBySide, side_by_side_html};
pub use training::{TrainingReport, training_report};
