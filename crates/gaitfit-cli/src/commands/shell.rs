//! `gaitfit completions` and `gaitfit man`: what shells and manuals know of the program.

use super::folder;
use crate::cli::{Completions, Man, command};
use crate::exit::Failure;
use crate::output;

/// Prints what completes commands in a shell.
pub fn completions(args: &Completions) -> Result<(), Failure> {
    let mut script = Vec::new();
    clap_complete::generate(args.shell, &mut command(true), "gaitfit", &mut script);
    output::print_bytes(&script)
}

/// Writes a manual page for the program and each of its commands.
pub fn man(args: &Man) -> Result<(), Failure> {
    folder(&args.folder, "the manual pages go")?;
    let unwritable = |error: std::io::Error| {
        Failure::failed(format!("cannot write manual pages into {}: {error}", args.folder.display()))
    };
    std::fs::create_dir_all(&args.folder).map_err(unwritable)?;
    clap_mangen::generate_to(command(true), &args.folder).map_err(unwritable)
}
