//! `gaitfit finetune`: goes on training a policy by PPO in an adapted simulator.

mod policy;
mod setup;

pub use setup::{check, setup};

use super::train;
use crate::cli;
use crate::exit::Failure;
use crate::interrupt;

/// Trains all seeds, or continues them, and reports what came out.
pub fn run(args: &cli::Finetune) -> Result<(), Failure> {
    let setup = setup(args)?;
    interrupt::listen()?;
    train::print(&train::train(&setup, args.resume)?, args.json)
}
