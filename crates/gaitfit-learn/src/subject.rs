//! What an evaluation tests.

use crate::task::Task;
use gaitfit_policy::Policy;
use gaitfit_sim::Candidate;

/// A policy, the task and robot that it is tested on, and the seed of the test.
#[derive(Clone, Copy)]
pub struct Subject<'a> {
    /// The task and the simulator.
    pub task: &'a Task,
    /// The policy; its interface is the task's.
    pub policy: &'a Policy,
    /// The robot; the one of the file if none is given.
    pub candidate: Option<&'a Candidate>,
    /// Seed of commands, starts and noise.
    pub seed: u64,
    /// Whether to stop, asked at each control period of a tile, from any thread; once true it must stay true. Simulations
    /// then end with [`crate::task::TaskError::Interrupted`]. `None` never stops.
    pub cancel: Option<&'a (dyn Fn() -> bool + Sync)>,
    /// For progress: called after each control period of a tile, from any thread, with the number of robots that it moved. `None`
    /// if nobody wants to know.
    pub moved: Option<&'a (dyn Fn(usize) + Sync)>,
}

impl Subject<'_> {
    /// Reports that this many robots have each been moved by one control period.
    pub fn count(&self, robots: usize) {
        if let Some(moved) = self.moved {
            moved(robots);
        }
    }
}
