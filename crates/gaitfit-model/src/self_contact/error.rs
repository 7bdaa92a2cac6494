//! Errors of a choice of own parts.

use super::MAX_PAIRS;
use crate::shown::shown;

/// Why own parts cannot touch as asked for.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SelfContactError {
    /// Not a pattern.
    #[error(
        "self_contact: `{}` is no pattern: {reason}; write a name with * for what may be anything",
        shown(pattern)
    )]
    Syntax {
        /// The pattern.
        pattern: String,
        /// What is wrong with it.
        reason: String,
    },
    /// No geom or body of that name.
    #[error(
        "self_contact: `{}` is no geom or body of {} with a shape; the nearest names are {nearest}",
        shown(name),
        shown(robot)
    )]
    Unknown {
        /// The name.
        name: String,
        /// The robot.
        robot: String,
        /// Names that are there, for the message.
        nearest: String,
    },
    /// Nothing is left of what was asked for.
    #[error("self_contact: nothing of {} can touch: {why}", shown(what))]
    Nothing {
        /// What was asked for.
        what: String,
        /// Why nothing is left.
        why: String,
    },
    /// More pairs than are computed.
    #[error(
        "self_contact: more than {MAX_PAIRS} pairs of geoms; name fewer, for example only feet and shanks"
    )]
    TooMany,
}
