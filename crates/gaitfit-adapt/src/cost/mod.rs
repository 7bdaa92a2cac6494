//! How far simulated joint signals are from the robot's.
//!
//! The robot side is prepared once ([`Reference`]); a [`Cost`] compares candidates with it. A new cost implements
//! [`Cost`] and [`Accumulator`] and touches nothing else.
//!
//! ```no_run
//! # use gaitfit_adapt::{Signals, cost::*};
//! # use std::sync::Arc;
//! # fn f(reference: Reference, runs: Vec<Vec<f32>>) -> Result<(), CostError> {
//! let reference = Arc::new(reference);
//! let cost = Wass::new(Arc::clone(&reference), Weights::from_reference(&reference))?;
//! let mut accumulator = cost.begin();
//! for (recording, run) in runs.iter().enumerate() {
//!     accumulator.add(recording, Signals::of_joints(run, run))?;
//! }
//! println!("{}", accumulator.finish()?.total);
//! # Ok(()) }
//! ```

mod aligned;
mod breakdown;
mod differences;
mod error;
mod kind;
mod match_r;
mod pieces;
mod reference;
mod rmse;
mod signal;
mod time_aligned;
mod wass;
mod wasserstein1;

pub use breakdown::{Breakdown, GroupCost};
pub use differences::Differences;
pub use error::CostError;
pub use kind::{CostKind, UnknownCost};
pub use match_r::MatchR;
pub use pieces::{Compared, Pieces};
pub use reference::{Dimension, Recorded, Reference};
pub use rmse::{PositionRmse, position_rmse};
pub use signal::{Signal, Weights};
pub use time_aligned::TimeAligned;
pub use wass::Wass;
pub use wasserstein1::{sort_f32, wasserstein1, wasserstein1_of_columns};

use crate::{Resets, Signals};

/// The scaled error of a sample that a fall lost: the robot's whole range. A candidate whose signals stay within the
/// robot's ranges cannot do worse.
pub(crate) const LOST: f64 = 2.0;

/// A distance between simulated and recorded joint signals. Shared by worker threads; each thread, or each
/// candidate, has its own [`Accumulator`].
pub trait Cost: Send + Sync {
    /// Short name, as in configuration files.
    fn name(&self) -> &str;

    /// The parts of the recording that the simulated robot gets.
    fn resets(&self) -> Resets {
        Resets::Never
    }

    /// The cost of a candidate that falls at once and has no sample to compare. A candidate whose signals stay within
    /// the robot's ranges costs no more.
    fn lost(&self) -> f64;

    /// The same cost, in the same scaling, against some of the recordings, which are numbered anew in the order given;
    /// `None` if there is no such cost: then gaitfit does not measure how well the logs identify a parameter.
    fn subset(&self, _recordings: &[usize]) -> Option<Box<dyn Cost>> {
        None
    }

    /// The differences that it sums, sample by sample; `None` of costs that compare distributions.
    fn differences(&self) -> Option<Differences<'_>> {
        None
    }

    /// The numbers from which it is computed, for simulators that compare signals themselves; `None` if they cannot.
    fn pieces(&self) -> Option<Pieces<'_>> {
        None
    }

    /// The recordings that it compares with, and how signals are weighted: a checkpoint is resumed only where both are the
    /// same. `None` if the cost has no [`Reference`].
    fn compared(&self) -> Option<Compared<'_>> {
        self.pieces().map(|pieces| pieces.compared())
    }

    /// An empty accumulator for one candidate. It can be reused for the next after [`Accumulator::finish`], which
    /// saves its allocations.
    fn begin(&self) -> Box<dyn Accumulator + '_>;
}

/// Collects the simulated recordings of one candidate.
pub trait Accumulator: Send {
    /// Adds the simulated signals of reference recording number `recording` (from 0), pre-roll included. The order of
    /// the calls does not change the result.
    ///
    /// # Errors
    /// [`CostError::NotFinite`] if a sample is NaN or infinite, and shape errors. The accumulator is then empty.
    fn add(&mut self, recording: usize, simulated: Signals<'_>) -> Result<(), CostError>;

    /// The cost of everything added since the last `finish`, smaller is closer; leaves the accumulator empty.
    ///
    /// # Errors
    /// If recordings the cost needs were not added.
    fn finish(&mut self) -> Result<Breakdown, CostError>;
}
