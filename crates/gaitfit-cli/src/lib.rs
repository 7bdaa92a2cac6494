//! `gaitfit`: fits a legged robot's simulator to the real robot from its joint sensors.
//!
//! The program is here, so that its file and the Python package start the same one.

mod cli;
mod commands;
mod exit;
mod interrupt;
mod keyboard;
mod output;
mod progress;
mod signals;
mod swings;
mod table;
mod viewer;
mod watcher;

pub use commands::explain::ExplainInput;

use cli::{Cli, Command};
use exit::{Exit, Failure};
use gaitfit::watch::Watch;
use std::ffi::OsString;
use std::io::Write;
use std::path::PathBuf;
use std::sync::OnceLock;

/// The command that starts this program again.
static SELF: OnceLock<PathBuf> = OnceLock::new();

/// Runs the program: what starts it, then its arguments. The exit code.
///
/// It listens for signals and may end the process; call it once, before there are other threads.
pub fn program(arguments: impl IntoIterator<Item = OsString>) -> u8 {
    // Before any thread is started, because threads inherit which signals are blocked.
    signals::outlive_file_limit();
    let arguments: Vec<OsString> = arguments.into_iter().collect();
    SELF.get_or_init(|| arguments.first().map_or_else(|| "gaitfit".into(), PathBuf::from));
    let done = match Cli::read(&arguments) {
        Ok(cli) => run(&cli),
        Err(asked) => return usage(&asked),
    };
    match done {
        Ok(()) => 0,
        Err(failure) => {
            output::note(&format!("error: {failure}"));
            failure.exit as u8
        }
    }
}

/// Effects that a robot has and its model lacks, as logs of walks show them: the document of `gaitfit explain --json`.
///
/// # Errors
/// Files that cannot be used, in a sentence.
pub fn explain(input: ExplainInput<'_>, watch: &Watch<'_>) -> Result<String, gaitfit::Error> {
    commands::explain::document(input, watch).map_err(|failure| gaitfit::Error::failed(failure.message))
}

/// Prints help that was asked for, or what is wrong with the command line.
fn usage(asked: &clap::Error) -> u8 {
    // Help and version, which were asked for, go to standard output and are no error.
    if asked.use_stderr() {
        let text = asked.render().to_string();
        if let Some(variable) = cli::from_variable(asked) {
            let text =
                format!("{}\n\nThe value is that of the environment variable {variable}.\n", text.trim_end());
            output::note(&gaitfit::brief(&text));
            return Exit::Usage as u8;
        }
        if let Some(meant) = cli::meant(asked) {
            let text = format!("{}\n\ndid you mean `gaitfit {meant}`?", text.trim_end());
            output::note(&gaitfit::brief(&text));
            return Exit::Usage as u8;
        }
        match gaitfit::brief(&text) {
            // In colour, where the terminal has it.
            brief if brief == text => drop(asked.print()),
            brief => output::note(&brief),
        }
        return Exit::Usage as u8;
    }
    let printed = asked.print().and_then(|()| std::io::stdout().flush());
    match printed {
        // A reader that went away (`gaitfit --help | head`) is no failure.
        Err(error) if error.kind() != std::io::ErrorKind::BrokenPipe => {
            output::note(&format!("error: cannot write to standard output: {error}"));
            Exit::Failed as u8
        }
        _ => 0,
    }
}

fn run(cli: &Cli) -> Result<(), Failure> {
    if let Some(isa) = cli.isa {
        // Before any command: the first use of the engine fixes the instructions for the process.
        gaitfit_isa::select(isa)
            .map_err(|error| Failure { exit: Exit::Missing, message: format!("--isa: {error}") })?;
    }
    match &cli.command {
        Command::Config(args) => commands::config::run(args),
        Command::Doctor(args) => commands::doctor::run(args),
        Command::Inspect(args) => commands::inspect::run(args),
        Command::Explain(args) => commands::explain::run(args),
        Command::Preflight(args) => commands::preflight::run(args),
        Command::Record(args) => commands::record::run(args),
        Command::Import(args) => commands::import::run(args),
        Command::New(args) => commands::new::run(args),
        Command::View(args) => commands::view::run(args),
        Command::Runs(args) => commands::runs::run(args),
        Command::Init(args) => commands::init::run(args),
        Command::Fit(args) => commands::adapt::run(args),
        Command::Sensitivity(args) => commands::sensitivity::run(args),
        Command::Excite(args) => commands::excite::run(args),
        Command::Validate(args) => commands::validate::run(args),
        Command::Train(args) => commands::train::run(args),
        Command::Finetune(args) => commands::finetune::run(args),
        Command::Loop(args) => commands::loop_::run(args),
        Command::Reproduce(args) => commands::reproduce::run(args),
        Command::Forward(args) => commands::forward::run(args),
        Command::Export(args) => commands::export::run(args),
        Command::Evaluate(args) => commands::evaluate::run(args),
        Command::Collect(args) => commands::collect::run(args),
        Command::Run(args) => commands::run::run(args),
        Command::Drift(args) => commands::drift::run(args),
        Command::Bench(args) => commands::bench::run(args),
        Command::Completions(args) => commands::shell::completions(args),
        Command::Man(args) => commands::shell::man(args),
    }
}
