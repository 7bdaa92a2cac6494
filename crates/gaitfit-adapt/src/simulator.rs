//! The one view this crate has of a simulator, small enough that a user's own can stand in.

use crate::Theta;

/// Simulated joint signals of one candidate on one recording; `samples × joints`, row-major, joints in the
/// order of [`Simulator::joints`], row 0 the initial state.
#[derive(Clone, Copy, Debug)]
pub struct Signals<'a> {
    /// Joint positions as the encoders report them, rad.
    pub position: &'a [f32],
    /// Joint velocities, rad/s.
    pub velocity: &'a [f32],
}

/// Takes the signals of one (candidate, recording); called from several threads, in any order, once each.
pub type Consume<'a> = dyn Fn(usize, usize, Signals<'_>) + Sync + 'a;

/// Replays a fixed set of recordings on candidate robots.
pub trait Simulator {
    /// Joint names, in the order of all signals.
    fn joints(&self) -> &[String];

    /// Number of recordings; samples of each are those of the recording.
    fn recordings(&self) -> usize;

    /// Simulates every candidate on every recording as one batch. A candidate holds one value an entry of
    /// `theta`; with an empty `theta` it is the robot as its file says. A diverging candidate shows as
    /// non-finite signals, not as an error. The signals do not depend on what else is in the batch, nor on
    /// the number of threads.
    fn simulate(
        &self,
        theta: &Theta,
        candidates: &[Vec<f64>],
        consume: &Consume<'_>,
    ) -> Result<(), SimulatorError>;
}

/// Why a batch could not be simulated: the simulator's own words.
#[derive(Debug, thiserror::Error)]
#[error("{0}")]
pub struct SimulatorError(pub String);
