//! Pictures of what gaitfit measured: self-contained reports, pictures of gaits, and 3-D replays.
//!
//! The crate knows nothing of simulators, optimisers or learning. Callers fill in plain data ([`AdaptReport`],
//! [`TrainingReport`], [`EvaluationReport`], [`LoopReport`], [`GaitPicture`], [`Replay`]) and get text back; writing
//! it to disk is theirs.

mod charts;
pub mod evaluation;
mod format;
pub mod gait;
mod log_picture;
pub mod loop_report;
mod nullable;
mod page;
pub mod replay;
pub mod report;
pub mod training;

pub use evaluation::{EvaluationReport, evaluation_html};
pub use gait::{GaitPicture, gait_picture_svg};
pub use log_picture::{log_picture_svg, log_picture_text};
pub use loop_report::{LoopReport, loop_html};
pub use replay::{Replay, ReplayError, replay_html};
pub use report::{AdaptReport, ReportError, render};
pub use training::{TrainingReport, training_report};
