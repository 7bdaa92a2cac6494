//! Engines that simulate: the processor, or an accelerator beside it.

mod cpu;

use std::sync::{Mutex, PoisonError};

use gaitfit_physics::{Params, Robot};

pub use cpu::Cpu;

use crate::SimError;
use crate::batch::Batch;
use crate::candidate::JointNetworks;
use crate::replay::{Direction, JointSignals, Replay};
use crate::tile::Tile;

/// Takes the signals of a candidate on a recording; called from any thread, in any order, once each.
pub type ConsumeSignals<'a> = dyn Fn(usize, usize, &JointSignals) + Sync + 'a;
/// The cost of a candidate's signals on a recording, whose number comes first.
pub type SignalCost<'a> = dyn Fn(usize, &JointSignals) -> f64 + Sync + 'a;
/// Whether to give up; once it says so it must keep saying so.
pub type Cancel<'a> = dyn Fn() -> bool + Sync + 'a;

/// Simulates candidates: logs replayed on clamped robots, and tiles of floating ones under a policy's targets.
/// Results depend neither on the number of threads nor on the other candidates.
pub trait Engine: Send + Sync {
    /// Its name, for records and messages.
    fn name(&self) -> String;

    /// Simulates every candidate on every recording, with the recording's gains times the candidate's factors, and
    /// hands each result to `consume(candidate, recording, signals)`. Once `cancel` says so it returns soon, without
    /// the results that are missing.
    ///
    /// # Errors
    /// A candidate whose parameters are not a robot (negative inertia, wrong lengths).
    fn replay(
        &self,
        replay: &Replay,
        candidates: &[Robot],
        consume: &ConsumeSignals<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimError>;

    /// The derivatives of each direction's robot's signals along the direction, on every recording: those of the
    /// computation itself ([`gaitfit_physics::Dual`]), not differences of two simulations. Hands each to
    /// `consume(direction, recording, derivatives)`. A delay has derivatives too: signals are continuous in it, with kinks;
    /// at a kink the derivative is that of one side.
    ///
    /// # Errors
    /// Those of [`Engine::replay`]; a distance that is not positive.
    fn replay_along(
        &self,
        replay: &Replay,
        directions: &[Direction],
        consume: &ConsumeSignals<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimError>;

    /// The cost of every candidate on every recording, `candidates × recordings`, row-major: NaN where `cancel` left
    /// one out. Signals are looked at where they arise and not kept.
    ///
    /// # Errors
    /// Those of [`Engine::replay`].
    fn costs(
        &self,
        replay: &Replay,
        candidates: &[Robot],
        cost: &SignalCost<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<Vec<f64>, SimError> {
        let recordings = replay.recordings().len();
        // NaN stays where a result never came.
        let costs = Mutex::new(vec![f64::NAN; candidates.len() * recordings]);
        let consume = |candidate: usize, recording: usize, signals: &JointSignals| {
            let value = cost(recording, signals);
            // A panic elsewhere cannot leave a number half written, so a poisoned lock still holds good ones.
            let mut costs = costs.lock().unwrap_or_else(PoisonError::into_inner);
            costs[candidate * recordings + recording] = value;
        };
        self.replay(replay, candidates, &consume, cancel)?;
        Ok(costs.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// One tile: a robot for each of `robots`, all at rest at the world's origin until placed. The networks act on all
    /// of them alike.
    ///
    /// # Errors
    /// No robot; a delay beyond the batch's `max_delay`; networks of other joints than the robot's.
    fn tile<'a>(
        &self,
        batch: &'a Batch,
        robots: &[Params<f64>],
        networks: &[JointNetworks],
    ) -> Result<Tile<'a>, SimError>;
}
