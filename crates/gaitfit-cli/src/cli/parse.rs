//! The words of a command line: how they are read, and what is said of those that cannot be.

use super::Cli;
use super::groups::{ALL, command};
use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue};
use clap::{Command, FromArgMatches};
use std::error::Error as _;
use std::ffi::OsString;
use std::num::{IntErrorKind, ParseFloatError, ParseIntError};

impl Cli {
    /// Reads the command line.
    ///
    /// # Errors
    /// Help that was asked for, or what is wrong with a word.
    pub fn read(arguments: &[OsString]) -> Result<Self, clap::Error> {
        // clap knows `--help` only. The options must be shown before it renders the help, so the word is looked for
        // first.
        let end = arguments.iter().position(|word| word == "--").unwrap_or(arguments.len());
        let (options, values) = arguments.split_at(end);
        let all = options.iter().any(|word| word == ALL);
        let known = options.iter().map(|word| if word == ALL { "--help".into() } else { word.clone() });
        // Words after `--` are values, whatever they look like.
        let words = known.chain(values.iter().cloned());
        let matches = negative(command(all)).try_get_matches_from(words).map_err(advised)?;
        Self::from_arg_matches(&matches)
    }
}

/// A negative number after an option is its value, which the option's own check then refuses or takes.
fn negative(command: Command) -> Command {
    command
        .mut_args(|option| match option.is_positional() || !option.get_action().takes_values() {
            true => option,
            false => option.allow_negative_numbers(true),
        })
        .mut_subcommands(negative)
}

/// The error with what to give instead of a word that is no number.
fn advised(mut error: clap::Error) -> clap::Error {
    let advice = error.source().and_then(|source| match source.downcast_ref::<ParseIntError>() {
        Some(wrong) => match wrong.kind() {
            IntErrorKind::PosOverflow => Some("give a smaller number"),
            // Numbers of a `NonZero` type.
            IntErrorKind::Zero => Some("give 1 or more"),
            _ => Some("give a whole number, not negative"),
        },
        None => source.is::<ParseFloatError>().then_some("give a number, for example 0.5"),
    });
    if let Some(advice) = advice {
        error.insert(ContextKind::Suggested, ContextValue::StyledStrs(vec![StyledStr::from(advice)]));
    }
    error
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::cli;
    use clap::error::ErrorKind;

    #[test]
    fn after_two_hyphens_the_word_for_all_help_is_a_value() {
        let read = |words: &[&str]| Cli::read(&words.iter().map(OsString::from).collect::<Vec<_>>());
        let named = read(&["gaitfit", "inspect", "--", ALL]).unwrap();
        assert!(matches!(&named.command, cli::Command::Inspect(args) if args.file.as_os_str() == ALL));
        let help = read(&["gaitfit", "inspect", ALL]).unwrap_err();
        assert_eq!(help.kind(), ErrorKind::DisplayHelp);
    }
}
