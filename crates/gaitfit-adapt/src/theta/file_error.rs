//! Why a file of found values cannot be used.

use super::saved::MAX_VALUE;
use gaitfit_model::patterns::PatternError;
use gaitfit_model::{shown, shown_number};

/// Why a file of found values cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ThetaFileError {
    /// It is not such a file.
    #[error("{0}; give the theta.toml of a `gaitfit fit` run")]
    Syntax(String),
    /// The file has a table that belongs to a configuration.
    #[error(
        "it has a table [[number]], which only configurations have. Here a number of the whole robot is a [[parameter]] without \
         `joints`: name, kind (for example \"ground_softness\") and value"
    )]
    Number,
    /// It is not what was written.
    #[error(
        "its checksum does not fit the rest of it: the file was damaged, or edited by hand. If you edited it, delete the \
         line that begins with `checksum`; if not, restore the file or fit again"
    )]
    Checksum,
    /// It is of another version.
    #[error("it has format {0}, and this program reads 1 and 2")]
    Format(u32),
    /// Two parameters have the same name.
    #[error("two parameters are called `{}`; give each a name of its own", shown(.0))]
    SameName(String),
    /// A kind that this program does not know.
    #[error("parameter `{name}` is of kind `{kind}`, which this program does not know")]
    Kind {
        /// Parameter.
        name: String,
        /// Its kind.
        kind: String,
    },
    /// A value without a meaning.
    #[error("`{}` is {}; it must be a number from {min} to {}", shown(name), shown_number(*value), short(*max))]
    Value {
        /// Parameter.
        name: String,
        /// Its value.
        value: f64,
        /// Smallest value with a meaning.
        min: f64,
        /// Largest value that can be simulated.
        max: f64,
    },
    /// A value that the search cannot have found.
    #[error(
        "`{}` is {}, which is not between its `lower` {} and `upper` {}; correct the value, or remove both bounds if it \
         is meant",
        shown(name),
        shown_number(*value),
        shown_number(*lower),
        shown_number(*upper)
    )]
    OutOfBounds {
        /// Parameter.
        name: String,
        /// Its value.
        value: f64,
        /// Lower bound of the search.
        lower: f64,
        /// Upper bound of the search.
        upper: f64,
    },
    /// A joint's parameter of no joint.
    #[error("`{name}` names no joints; give `joints`")]
    NoJoints {
        /// Parameter.
        name: String,
    },
    /// A pattern that covers no joint of the robot.
    #[error("`{}`: {source}", shown(name))]
    Pattern {
        /// Parameter.
        name: String,
        /// The pattern, and what is wrong with it.
        source: PatternError,
    },
    /// A joint that the robot lacks.
    #[error("{robot} has no joint `{}`; it has {joints}{}", shown(joint), of_another(fitted, robot))]
    NoJoint {
        /// The robot that the file was fitted to; empty where it does not say.
        fitted: String,
        /// Robot.
        robot: String,
        /// The joint sought.
        joint: String,
        /// The joints it has.
        joints: String,
    },
    /// A network with a wrong number of weights, or numbers that are not finite.
    #[error("network `{name}` has {count} weights; it needs 97, and all of its numbers finite")]
    Network {
        /// Network.
        name: String,
        /// Weights found.
        count: usize,
    },
    /// Two networks or parameters do the same to one joint.
    #[error("`{name}` is the second of its kind on joint `{joint}`; remove one")]
    Twice {
        /// Network or parameter.
        name: String,
        /// Joint.
        joint: String,
    },
    /// It cannot be written.
    #[error("it cannot be written: {0}")]
    Write(String),
}

/// A bound in few digits.
pub(super) fn short(bound: f64) -> String {
    if bound == MAX_VALUE { format!("{bound:e}") } else { bound.to_string() }
}

/// A sentence if the file is of another robot.
fn of_another(fitted: &str, robot: &str) -> String {
    if fitted.is_empty() || fitted == robot {
        return String::new();
    }
    format!(". The file was fitted to `{}`: give one that was fitted to {robot}", shown(fitted))
}
