//! Goes on training a policy by PPO in an adapted simulator.

mod policy;
mod setup;

pub use setup::{Files, Request, check, setup};
