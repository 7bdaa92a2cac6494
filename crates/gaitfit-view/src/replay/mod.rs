//! A 3-D replay of robots in one HTML file that plays offline.

#[cfg(feature = "pages")]
mod check;
mod data;
#[cfg(feature = "pages")]
mod pack;
#[cfg(feature = "pages")]
mod player;

pub use data::{Body, Frame, Geom, Ground, Joint, Mesh, Replay, ReplayRobot, Shape};
#[cfg(feature = "pages")]
pub(crate) use player::Motion;
#[cfg(feature = "pages")]
pub use player::replay_html;

use crate::ReportError;

/// The reason why no replay came out.
#[derive(Debug, thiserror::Error)]
pub enum ReplayError {
    /// The time between frames is not a time.
    #[error("a replay needs a time between frames above zero, not {dt} s")]
    TimeStep {
        /// The time step that was given, s.
        dt: f64,
    },
    /// No robots, or too many.
    #[error("a replay shows 1 to {max} robots, not {count}; write several pages")]
    Robots {
        /// How many were given.
        count: usize,
        /// How many there may be.
        max: usize,
    },
    /// A robot or its motion contradicts itself or is too large.
    #[error("replay of robot \"{robot}\": {what}")]
    Robot {
        /// Its name.
        robot: String,
        /// The problem, in words.
        what: String,
    },
    /// The motion could not be written as JSON: a defect of this crate, not of the data.
    #[error("the replay could not be written as JSON ({0}); report this with the run's files")]
    Json(#[from] serde_json::Error),
    /// The page could not be filled in.
    #[error(transparent)]
    Page(#[from] ReportError),
}
