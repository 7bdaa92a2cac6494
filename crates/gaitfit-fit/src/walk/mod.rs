//! Walking logs: reading them, and running the policy in the simulator under their commands.

pub mod cause;
mod counted;
pub mod coverage;
pub mod cuts;
pub mod doubts;
pub mod explain;
pub mod falling;
pub mod findings;
pub mod imu_search;
pub mod log_files;
pub mod logs;
pub mod mounting;
pub mod observation;
pub mod policy_check;
pub mod rate;
mod recorded;
pub mod recorder;
pub(crate) mod reference;
pub mod remedy;
pub(crate) mod rule_joints;
pub mod self_contact;
pub mod simulator;
pub mod singles;
pub mod sized;
pub mod swing;
pub mod swing_numbers;
pub mod tilt;
pub mod walking;
pub(crate) mod wheels;

#[cfg(test)]
pub(crate) mod fixtures;
#[cfg(test)]
mod logs_test;
#[cfg(test)]
mod times_test;
