//! How well a policy walks: trajectories with random commands, drift under constant ones, its gait, and crossings of
//! uneven ground.

mod crossings;
mod drift;
mod gait;
mod spectrum;
mod trajectories;

pub use crossings::{
    Crossing, CrossingRecorder, CrossingSummary, crossing_environment, crossing_size, crossings,
    ground_place, summarise_crossings,
};
pub use drift::{DriftRecorder, DriftTrial, drift, drift_environment, drift_periods, ground_pose};
pub use gait::{GaitRecord, GaitSummary, record_gait, record_gait_on};
pub use spectrum::power_spectrum;
pub use trajectories::{Trial, TrialSummary, Trials, run_trials, summarise, trial_environments, trial_steps};

use gaitfit_sim::Candidate;

use crate::task::Task;
use gaitfit_policy::Policy;

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
