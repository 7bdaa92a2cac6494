//! The program `gaitfit`, see `lib.rs`.

use std::process::ExitCode;

fn main() -> ExitCode {
    let mut arguments = std::env::args_os();
    let called = arguments.next();
    // A loop starts the program again by this path. The word by which it was called need not be a path.
    let executable = std::env::current_exe().map(Into::into).ok().or(called);
    ExitCode::from(gaitfit_cli::program(executable.into_iter().chain(arguments)))
}
