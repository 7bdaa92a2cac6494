//! A training's state handed to another machine's simulation, and taken back.

use std::sync::PoisonError;

use crate::curriculum::Growth;
use crate::ppo::Learner;
use crate::task::{Snapshot, TaskError};
use crate::training::{TILE, Training};
use gaitfit_sim::Candidate;

impl Training<'_> {
    /// Environments of a tile: the learner numbers samples tile by tile.
    pub const TILE: usize = TILE;

    /// Seed of all draws.
    pub fn seed(&self) -> u64 {
        self.seed
    }

    /// Candidates that robots are varied around: robot number `e` around number `e` modulo their count.
    pub fn candidates(&self) -> &[Candidate] {
        &self.candidates
    }

    /// All environments as they are.
    pub fn snapshots(&mut self) -> Vec<Snapshot> {
        let mut snapshots = Vec::new();
        for runner in &mut self.runners {
            let runner = runner.get_mut().unwrap_or_else(PoisonError::into_inner);
            for index in 0..runner.environment.count() {
                let returns = runner.returns[index];
                snapshots.push(Snapshot { returns, ..runner.environment.snapshot(index) });
            }
        }
        snapshots
    }

    /// Goes on from environments, an iteration and commands' growth that were reached elsewhere; the learner takes its state by
    /// [`Training::learner_mut`].
    ///
    /// # Errors
    /// Snapshots of another robot or number.
    pub fn set_snapshots(
        &mut self,
        iteration: u32,
        growth: Growth,
        snapshots: &[Snapshot],
    ) -> Result<(), TaskError> {
        let mut left = snapshots.iter();
        for runner in &mut self.runners {
            let runner = runner.get_mut().unwrap_or_else(PoisonError::into_inner);
            for index in 0..runner.environment.count() {
                let Some(snapshot) = left.next() else {
                    // Environments before this one have already changed.
                    let what = "are of fewer environments".to_owned();
                    return Err(TaskError::Setting { setting: "the robots' states".to_owned(), what });
                };
                runner.environment.set_snapshot(index, snapshot)?;
                runner.returns[index] = snapshot.returns;
            }
            // Once a tile, after its last robot: it computes the motion of all of them.
            runner.environment.refresh();
        }
        self.iteration = iteration;
        self.growth = growth;
        Ok(())
    }

    /// Memories of the actor and of the critic, a row an environment; empty without recurrent layers.
    pub fn memories(&mut self) -> [Vec<f32>; 2] {
        let mut memories = [Vec::new(), Vec::new()];
        for runner in &mut self.runners {
            let runner = runner.get_mut().unwrap_or_else(PoisonError::into_inner);
            runner.recorder.append_memories(&self.learner, runner.environment.count(), &mut memories);
        }
        memories
    }

    /// Takes up what [`Training::memories`] gave elsewhere.
    ///
    /// # Errors
    /// Rows of other memories or of another number of environments.
    pub fn set_memories(&mut self, [actor, critic]: &[Vec<f32>; 2]) -> Result<(), TaskError> {
        let mut rest = [&actor[..], &critic[..]];
        let mut fits = true;
        for runner in &mut self.runners {
            let runner = runner.get_mut().unwrap_or_else(PoisonError::into_inner);
            fits &= runner.recorder.take_memories(&self.learner, runner.environment.count(), &mut rest);
        }
        // Rows that are left after the last tile mean a training of more environments.
        if fits && rest.iter().all(|rest| rest.is_empty()) {
            return Ok(());
        }
        let what = "remember something else than this policy does".to_owned();
        Err(TaskError::Setting { setting: "the robots' memories".to_owned(), what })
    }

    /// The learner, to be given a state that was reached elsewhere.
    pub fn learner_mut(&mut self) -> &mut Learner {
        &mut self.learner
    }
}
