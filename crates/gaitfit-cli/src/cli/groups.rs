//! The commands in groups, and options that only `--help-all` lists.

use super::Cli;
use clap::builder::StyledStr;
use clap::error::{ContextKind, ContextValue};
use clap::{Command, CommandFactory};
use std::fmt::Write;

/// The option that lists all options of a command.
pub(super) const ALL: &str = "--help-all";

/// Commands in the order of work.
const GROUPS: [(&str, &[&str]); 5] = [
    ("Look", &["inspect", "explain", "record", "import", "view", "runs", "doctor"]),
    ("Fit", &["new", "fit", "sensitivity", "excite", "validate"]),
    ("Train", &["init", "train", "finetune", "loop"]),
    ("Measure", &["evaluate", "drift"]),
    ("Deploy", &["preflight", "collect", "run", "export"]),
];
/// Commands of which the help shows the names alone.
const MORE: [&str; 7] = ["config", "forward", "bench", "reproduce", "completions", "man", "help"];

/// The command line with grouped help; with `all` no option is hidden.
pub fn command(all: bool) -> Command {
    let shown = |command: Command| match all {
        true => command.mut_args(|option| option.hide(false)),
        false => hint(command),
    };
    let plain = Cli::command();
    let groups = groups(&plain);
    shown(plain.mut_subcommands(shown)).override_help(groups)
}

/// The command that an unknown one has the letters of, where nothing nearer is suggested: `fti` is `fit`.
pub fn meant(error: &clap::Error) -> Option<String> {
    // clap suggests by similar spelling. Its suggestion is better than ours if it has one.
    let suggested = error.get(ContextKind::SuggestedSubcommand).is_some();
    let Some(ContextValue::String(unknown)) =
        error.get(ContextKind::InvalidSubcommand).filter(|_| !suggested)
    else {
        return None;
    };
    let letters = |word: &str| {
        let mut letters: Vec<char> = word.chars().collect();
        // Two words with the same letters are equal once the letters are sorted.
        letters.sort_unstable();
        letters
    };
    let program = Cli::command();
    let names = program.get_subcommands().map(Command::get_name);
    names.into_iter().find(|name| letters(name) == letters(unknown)).map(str::to_owned)
}

/// The environment variable whose value was refused, if the value was not on the command line.
pub fn from_variable(error: &clap::Error) -> Option<&'static str> {
    let text = |kind| match error.get(kind) {
        Some(ContextValue::String(text)) => Some(text.as_str()),
        _ => None,
    };
    // The argument is reported with its placeholder: `--isa <SET>`.
    let option = text(ContextKind::InvalidArg)?.starts_with("--isa");
    // clap reports a value from the environment as if it were on the command line. So it is the variable's only if
    // the option is absent and the values agree.
    let value = std::env::var(gaitfit_isa::VARIABLE).ok()?;
    // `args` panics at an argument that is not UTF-8.
    let given = std::env::args_os().any(|argument| argument.to_string_lossy().starts_with("--isa"));
    (option && !given && text(ContextKind::InvalidValue) == Some(value.as_str()))
        .then_some(gaitfit_isa::VARIABLE)
}

/// The number of a `--seed`.
pub fn seed(text: &str) -> Result<u64, String> {
    text.parse().map_err(|_| "give a whole number, 0 or more".to_owned())
}

/// Names the option that lists the options that this help leaves out.
fn hint(command: Command) -> Command {
    // `--isa` is hidden and belongs to all commands. It alone is no reason to point at more options.
    let rare = command.get_arguments().any(|option| option.is_hide_set() && !option.is_global_set());
    if !rare {
        return command;
    }
    let name = command.get_name().to_owned();
    command.after_help(format!("More options: gaitfit {name} {ALL}"))
}

/// The help of the program itself.
fn groups(program: &Command) -> StyledStr {
    let mut text = format!(
        "{}\n\nUsage: gaitfit COMMAND ...\n",
        program.get_about().map(ToString::to_string).unwrap_or_default()
    );
    for (group, commands) in GROUPS {
        let mut heading = group;
        text.push('\n');
        for name in commands {
            let about = program.find_subcommand(name).and_then(Command::get_about);
            let _ = writeln!(
                text,
                // Widths of the longest heading and the longest name, and two spaces. The test below keeps lines
                // within 80 characters.
                "{heading:<9}{name:<13}{}",
                about.map(ToString::to_string).unwrap_or_default()
            );
            // The heading stands in the first row of its group only.
            heading = "";
        }
    }
    let _ = write!(
        text,
        "\nMore     {}\n\n\
         Start with `gaitfit new`, or try `gaitfit loop examples/go2-ground/loop.toml`.\n\
         Help on a command: gaitfit COMMAND --help; with all options: {ALL}.\n\
         Options of all: -h, --help; -V, --version; --isa SET (avx512, avx2, portable).\n\
         Results go to standard output, progress to standard error.\n\
         Exit codes: 0 done, 1 failed or broken input, 2 wrong usage or configuration,\n\
         3 a check failed or a fit is wrong, 4 hardware or library missing,\n\
         130 interrupted.\n",
        MORE.join(", ")
    );
    StyledStr::from(text)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn every_command_is_in_one_group_and_the_help_fits_a_screen() {
        let mut listed: Vec<&str> =
            GROUPS.iter().flat_map(|(_, commands)| commands.iter()).chain(&MORE).copied().collect();
        let text = command(false).render_help().to_string();
        let lines: Vec<&str> = text.lines().collect();
        assert!(lines.len() <= 40, "{} lines", lines.len());
        let widest = lines.iter().max_by_key(|line| line.chars().count()).unwrap();
        assert!(widest.chars().count() <= 80, "{widest}");
        let program = Cli::command();
        let mut there: Vec<&str> = program.get_subcommands().map(Command::get_name).collect();
        there.push("help");
        listed.sort_unstable();
        there.sort_unstable();
        assert_eq!(listed, there);
    }

    #[test]
    fn letters_in_another_order_are_understood() {
        let asked = |word: &str| meant(&command(false).try_get_matches_from(["gaitfit", word]).unwrap_err());
        assert_eq!(asked("fti").as_deref(), Some("fit"));
        assert_eq!(asked("xyz"), None);
    }

    #[test]
    fn rare_options_stand_in_the_whole_help_alone() {
        for (name, option) in [
            ("evaluate", "--preset"),
            ("collect", "--log-shift"),
            ("excite", "--margin"),
            ("run", "--domain"),
        ] {
            let help = |all: bool| {
                let mut program = command(all);
                program.find_subcommand_mut(name).unwrap().render_long_help().to_string()
            };
            assert!(
                !help(false).contains(option) && help(false).contains(&format!("{name} {ALL}")),
                "{name}"
            );
            assert!(help(true).contains(option), "{name}");
        }
    }
}
