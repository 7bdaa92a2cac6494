//! Fits of walking logs: the policy is run in the simulator under the logs' commands.

pub mod coverage;
pub mod cuts;
pub mod doubts;
pub mod fit;
pub mod imu_search;
pub mod log_files;
pub mod logs;
pub mod observation;
pub mod policy_check;
pub mod rate;
pub mod report;
pub mod results;
pub mod scan;
pub mod setup;
pub mod simulator;
pub mod tilt;

#[cfg(test)]
mod fixtures;
#[cfg(test)]
mod logs_test;
