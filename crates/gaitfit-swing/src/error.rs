//! Why logs say nothing of joints.

/// Why an estimate cannot be made.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum SwingError {
    /// A log without a signal that is needed.
    #[error("{log}: legs in the air say something of the joints only with {what}; record them next time")]
    Lacks {
        /// The log.
        log: String,
        /// The signals that are missing, in words.
        what: &'static str,
    },
    /// A log in which targets are velocities, as of wheels.
    #[error(
        "{log}: legs in the air cannot be evaluated, because the targets of joint `{joint}` are velocities"
    )]
    VelocityTargets {
        /// The log.
        log: String,
        /// One of these joints.
        joint: String,
    },
    /// A joint that the robot lacks.
    #[error("{log}: the robot has no joint `{joint}`; use the robot file that the log was made with")]
    NoSuchJoint {
        /// The log.
        log: String,
        /// The joint.
        joint: String,
    },
    /// Too few samples.
    #[error("{log}: {samples} samples are too few; record at least a second")]
    Short {
        /// The log.
        log: String,
        /// Its samples.
        samples: usize,
    },
    /// Too many samples: one signal of all joints would take more than 400 MB on the grid.
    #[error("{log}: {seconds} s are too long for one log; cut it")]
    Long {
        /// The log.
        log: String,
        /// Its length.
        seconds: f64,
    },
    /// The caller asked to stop.
    #[error("stopped")]
    Stopped,
    /// No leg was seen in the air.
    #[error("no leg is in the air long enough in {logs} logs: legs must swing for {least_ms:.0} ms or more")]
    NoSwings {
        /// Number of logs that were searched.
        logs: usize,
        /// Length of a swing that counts, ms.
        least_ms: f64,
    },
}
