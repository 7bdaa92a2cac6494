//! Errors of settings, answers and saved states.

/// Why the optimiser refuses to start, continue or resume.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum CmaError {
    /// No coordinate to optimise.
    #[error("nothing to optimise: the start has no coordinates")]
    NoCoordinates,
    /// A vector of the settings has the wrong length.
    #[error("{what} has {len} entries but the start has {expected}")]
    Length {
        /// Name of the vector.
        what: &'static str,
        /// Its length.
        len: usize,
        /// Number of coordinates.
        expected: usize,
    },
    /// A number of the settings is out of range.
    #[error("{what} of coordinate {index} is {value}; it must be {requirement}")]
    Coordinate {
        /// Name of the setting.
        what: &'static str,
        /// Coordinate, from 0.
        index: usize,
        /// The value.
        value: f64,
        /// The condition that it must fulfil, in words.
        requirement: &'static str,
    },
    /// A scalar of the settings is out of range.
    #[error("{what} is {value}; it must be {requirement}")]
    Setting {
        /// Name of the setting.
        what: &'static str,
        /// The value.
        value: f64,
        /// The condition that it must fulfil, in words.
        requirement: &'static str,
    },
    /// The start lies outside its bounds.
    #[error(
        "start {start} of coordinate {index} lies outside its bounds [{lower}, {upper}]; move the start or the bound"
    )]
    StartOutsideBounds {
        /// Coordinate, from 0.
        index: usize,
        /// Start.
        start: f64,
        /// Lower bound.
        lower: f64,
        /// Upper bound.
        upper: f64,
    },
    /// The caller reported another number of costs than there are candidates.
    #[error("got {got} costs for {expected} candidates")]
    CostCount {
        /// Number of reported costs.
        got: usize,
        /// Population size.
        expected: usize,
    },
    /// The caller reported the costs of another generation.
    #[error("the population told belongs to generation {got}, but generation {expected} is due; ask again")]
    Generation {
        /// The population's generation.
        got: u32,
        /// The optimiser's generation.
        expected: u32,
    },
    /// The caller reported costs after the last run had ended.
    #[error("all runs of the search have ended; nothing more can be told")]
    Finished,
    /// A saved state does not belong to the settings or is damaged.
    #[error("the saved optimiser state cannot be resumed: {0}; start afresh or restore the checkpoint")]
    State(String),
}
