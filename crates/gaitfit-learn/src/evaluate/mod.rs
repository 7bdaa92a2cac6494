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

pub use crate::subject::Subject;
