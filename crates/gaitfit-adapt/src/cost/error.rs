//! Errors of the two sides of a comparison.

use super::Signal;

/// Why a cost could not be computed. Recordings, samples and columns count from 0; samples include the pre-roll.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CostError {
    /// The simulation of this candidate diverged. The one error that speaks of the candidate, not of the setup:
    /// rank it last and continue.
    #[error("simulated {signal} of {of} is not finite at sample {sample} of recording {recording}")]
    NotFinite {
        /// The simulated signal.
        signal: Signal,
        /// The signal's dimension, for example `joint FL_hip` or `axis x`.
        of: String,
        /// Recording number.
        recording: usize,
        /// Sample number.
        sample: usize,
    },
    /// The robot's log holds NaN or infinity.
    #[error(
        "recorded {signal} of {of} is not finite at sample {sample} of recording {recording}; cut or repair the log"
    )]
    ReferenceNotFinite {
        /// The recorded signal.
        signal: Signal,
        /// The signal's dimension, for example `joint FL_hip` or `axis x`.
        of: String,
        /// Recording number.
        recording: usize,
        /// Sample number.
        sample: usize,
    },
    /// No recordings, no joints, or nothing left after the pre-roll.
    #[error("the reference is empty: {0}")]
    EmptyReference(String),
    /// A matrix is not `samples × joints`, or `samples × 3` for the base.
    #[error("{signal} of recording {recording} has {len} values, which is not {expected}")]
    Shape {
        /// The signal whose matrix it is.
        signal: Signal,
        /// Recording number.
        recording: usize,
        /// Values found.
        len: usize,
        /// The number of values it should have, in words.
        expected: String,
    },
    /// A signal has a positive weight but one of the sides lacks it.
    #[error("{signal} has a positive weight but {side} has no {signal}; set its weight to 0 or supply it")]
    MissingSignal {
        /// The weighted signal.
        signal: Signal,
        /// The side that lacks it, in words.
        side: String,
    },
    /// A privileged cost meets a log without the base's state.
    #[error(
        "{cost} compares the base's position and velocity, and the robot's log has no {signal}; it needs a log of a \
         simulator or of motion capture, or take matcho or wass"
    )]
    Privileged {
        /// The cost.
        cost: String,
        /// The base's signal that the log lacks.
        signal: Signal,
    },
    /// Every dimension of a weighted signal is constant on the robot, so there is no scale.
    #[error(
        "recorded {0} is constant in every dimension and has no scale; set its weight to 0 or use a log that moves"
    )]
    AllConstant(Signal),
    /// A weight is negative or not finite, or all are zero.
    #[error(
        "weights of position, velocity, action, base position and base velocity must be finite, not negative and not \
         all zero, but are {0:?}"
    )]
    Weights([f64; 5]),
    /// A log lacks a joint.
    #[error("recording {recording} has no joint {joint}; it has {available}")]
    UnknownJoint {
        /// Recording number.
        recording: usize,
        /// The joint sought.
        joint: String,
        /// The joints found.
        available: String,
    },
    /// Recording number beyond the reference's.
    #[error("recording {recording} was simulated, but the reference has {count}")]
    UnknownRecording {
        /// Recording number.
        recording: usize,
        /// Number of recordings of the reference.
        count: usize,
    },
    /// A time-aligned cost got a recording twice.
    #[error("recording {0} was added twice for one candidate")]
    Repeated(usize),
    /// A time-aligned cost lacks a recording, or a pooled one has no samples at all.
    #[error("recording {0} was not added for this candidate")]
    Missing(usize),
}

impl CostError {
    /// Whether the candidate, not the setup, is at fault; such candidates are ranked last.
    pub fn is_candidate_failure(&self) -> bool {
        matches!(self, Self::NotFinite { .. })
    }

    /// The number of the recording that is at fault, where it is one.
    pub fn recording(&self) -> Option<usize> {
        match *self {
            Self::NotFinite { recording, .. }
            | Self::ReferenceNotFinite { recording, .. }
            | Self::Shape { recording, .. }
            | Self::UnknownJoint { recording, .. }
            | Self::UnknownRecording { recording, .. }
            | Self::Repeated(recording)
            | Self::Missing(recording) => Some(recording),
            _ => None,
        }
    }
}
