//! `gaitfit bench`: speed.

mod measured;
mod physics;
mod physics_cuda;
mod train;
mod train_cuda;

use crate::cli::Bench;
use crate::exit::Failure;

/// Measures and prints.
pub fn run(args: &Bench) -> Result<(), Failure> {
    match args {
        Bench::Physics(args) => physics::run(args),
        Bench::Train(args) => train::run(args),
    }
}
