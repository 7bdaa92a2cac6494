//! `gaitfit config`: every setting with its default.

use crate::cli::ConfigOf;
use crate::exit::Failure;
use crate::output;
use gaitfit::settings::{DEFAULTS, FINETUNE_DEFAULTS, LOOP_DEFAULTS, train_defaults};

/// Prints the settings of a command, commented, as a file to start from.
pub fn run(args: &crate::cli::Config) -> Result<(), Failure> {
    match args.of {
        ConfigOf::Fit => output::print(DEFAULTS),
        ConfigOf::Finetune => output::print(FINETUNE_DEFAULTS),
        ConfigOf::Loop => output::print(LOOP_DEFAULTS),
        ConfigOf::Train => output::print(&train_defaults(args.task.into())),
    }
}
