//! Every command that a message, a help text or a page of the documentation gives can be given: it is extracted from
//! there and parsed as the program would, and its settings are read.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use super::Cli;
use clap::CommandFactory;
use clap::error::ErrorKind;
use gaitfit::settings::{AdaptConfig, Configuration, FinetuneConfig, LoopConfig, TrainConfig, load};
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// A command as it stands somewhere.
#[derive(Debug)]
struct Advice {
    file: String,
    /// Its words, `gaitfit` first.
    words: Vec<String>,
    /// Whether it is a line to copy, which must be complete; a sentence may name a command by a part of it.
    whole: bool,
}

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..").canonicalize().unwrap()
}

/// All files below `folder` with one of the endings.
fn files(folder: &Path, endings: &[&str], paths: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        let name = path.file_name().unwrap().to_string_lossy().into_owned();
        let left_out = ["target", "tests", "fixtures", "node_modules"].contains(&name.as_str());
        if path.is_dir() && !left_out && !name.starts_with('.') {
            files(&path, endings, paths);
        } else if endings.iter().any(|ending| name.ends_with(ending)) && !name.ends_with("_test.rs") {
            paths.push(path);
        }
    }
}

/// The text of a source with sentences in one line: continued strings and comments are joined.
fn joined(text: &str) -> String {
    let mut out = String::new();
    for line in text.lines() {
        let bare = line.trim_start();
        let comment = ["/// ", "//! ", "// "].iter().find_map(|start| bare.strip_prefix(start));
        match (comment, out.ends_with('\\')) {
            (_, true) => {
                out.pop();
                out.push_str(bare);
            }
            (Some(rest), _) => {
                out.push(' ');
                out.push_str(rest);
            }
            (None, _) => {
                out.push('\n');
                out.push_str(line);
            }
        }
    }
    out
}

/// The words of a command line; quotes hold words together, and comments, redirections and variables go.
fn words(line: &str) -> Vec<String> {
    let mut all: Vec<String> = Vec::new();
    let (mut word, mut quote, mut open) = (String::new(), None, false);
    for letter in line.chars().chain([' ']) {
        match (letter, quote) {
            ('\'' | '"', None) => (quote, open) = (Some(letter), true),
            (letter, Some(end)) if letter == end => quote = None,
            (letter, None) if letter.is_whitespace() => {
                if open || !word.is_empty() {
                    all.push(std::mem::take(&mut word));
                }
                open = false;
            }
            (letter, _) => word.push(letter),
        }
    }
    let end =
        all.iter().position(|word| ["#", ">", "|", "&&", "…"].contains(&word.as_str())).unwrap_or(all.len());
    all.truncate(end);
    // A variable of the shell is an option's value, or options.
    let value = |at: usize| at > 0 && all[at - 1].starts_with("--");
    let kept = (0..all.len()).filter(|&at| !all[at].starts_with('$') || value(at));
    let all: Vec<String> = kept.map(|at| all[at].replace('$', "")).collect();
    // What a message fills in.
    all.into_iter()
        .map(|word| if word.contains('{') && !word.contains(',') { "FILLED".to_owned() } else { word })
        .collect()
}

/// The commands in a text.
fn commands(file: &str, text: &str) -> Vec<Advice> {
    let names = |one: &clap::Command| {
        let aliases = one.get_all_aliases().map(str::to_owned);
        aliases.chain([one.get_name().to_owned()]).collect::<Vec<_>>()
    };
    let known: Vec<String> = Cli::command().get_subcommands().flat_map(names).collect();
    let mut advice = Vec::new();
    let mut add = |line: &str, whole: bool| {
        let words = words(line);
        let command = words.get(1).is_some_and(|word| known.contains(word) || word.starts_with("--"));
        if command {
            advice.push(Advice { file: file.to_owned(), words, whole });
        }
    };
    if file.ends_with(".md") {
        let mut inside = false;
        for line in text.lines().map(str::trim) {
            if line.starts_with("```") {
                inside = !inside;
            } else if inside {
                let line = line.replace("cargo run --release -- ", "gaitfit ");
                if line.starts_with("gaitfit ") {
                    add(&line, true);
                }
            }
        }
    }
    let text = joined(text);
    for (start, _) in text.match_indices("gaitfit ") {
        let before = text[..start].trim_end_matches(' ').chars().next_back();
        let rest = &text[start..];
        let end = match before {
            Some('`') => rest.find('`'),
            Some(':' | '(' | '"' | '|') => rest.find(['`', '"', '\n', ';', ')', '\\']),
            _ => continue,
        };
        add(&rest[..end.unwrap_or(rest.len())], false);
    }
    advice
}

/// All commands of messages, help texts and documentation.
fn all() -> Vec<Advice> {
    let root = root();
    let mut paths = Vec::new();
    files(&root.join("crates"), &[".rs", ".toml", ".jinja"], &mut paths);
    files(&root.join("docs"), &[".md"], &mut paths);
    files(&root.join("examples"), &[".md", ".toml"], &mut paths);
    for name in ["README.md", "CONTRIBUTING.md", "ARCHITECTURE.md"] {
        paths.push(root.join(name));
    }
    let mut advice = Vec::new();
    for path in paths {
        let name = path.strip_prefix(&root).unwrap().display().to_string();
        advice.extend(commands(&name, &std::fs::read_to_string(&path).unwrap()));
    }
    advice
}

/// Why a command cannot be given, if it cannot.
fn wrong(advice: &Advice) -> Option<String> {
    let arguments: Vec<OsString> = advice.words.iter().map(OsString::from).collect();
    let error = Cli::read(&arguments).err()?;
    let last_is_option = advice.words.last().is_some_and(|word| word.starts_with("--"));
    let placeholder = |word: &String| {
        word.len() > 1 && word.chars().all(|letter| letter.is_uppercase() || "_|.,".contains(letter))
    };
    let filled = advice.words.iter().any(placeholder);
    let fine = match error.kind() {
        ErrorKind::DisplayHelp | ErrorKind::DisplayVersion => true,
        // A part of a command that a sentence names.
        ErrorKind::MissingRequiredArgument | ErrorKind::MissingSubcommand => !advice.whole,
        ErrorKind::DisplayHelpOnMissingArgumentOrSubcommand => !advice.whole,
        ErrorKind::InvalidValue | ErrorKind::ValueValidation => filled || (!advice.whole && last_is_option),
        _ => false,
    };
    (!fine).then(|| error.to_string())
}

/// Reads settings as the configuration of a command; `None` for a command without one.
fn read_settings(command: &str, sets: &[String]) -> Option<Result<(), String>> {
    fn read<C: Configuration>(sets: &[String]) -> Result<(), String> {
        read_upon::<C>(None, sets)
    }
    fn read_upon<C: Configuration>(file: Option<&Path>, sets: &[String]) -> Result<(), String> {
        load::<C>(file, sets).map(|_| ()).map_err(|error| error.to_string())
    }
    Some(match command {
        "fit" | "adapt" | "sensitivity" | "validate" => read::<AdaptConfig>(sets),
        "train" => read::<TrainConfig>(sets),
        "finetune" => read::<FinetuneConfig>(sets),
        // A loop's settings need a target to change.
        "loop" | "reproduce" => {
            let file = root().join("experiments/spring-residact-wass.toml");
            read_upon::<LoopConfig>(Some(&file), sets)
        }
        _ => return None,
    })
}

/// The settings that words give by `--set`.
fn sets(words: &[String]) -> Vec<String> {
    let pairs = words
        .windows(2)
        .filter(|pair| pair[0] == "--set" && pair[1].contains('=') && pair[1] != "<KEY=VALUE>");
    pairs.map(|pair| pair[1].trim_end_matches([')', ',', '.']).to_owned()).collect()
}

#[test]
fn every_command_of_messages_help_and_documentation_can_be_given() {
    let all = all();
    assert!(all.len() > 100, "only {} commands were found", all.len());
    for command in ["fit", "export", "finetune", "init", "loop", "run", "train"] {
        let named = all.iter().any(|advice| advice.words[1] == command && advice.words.len() > 2);
        assert!(named, "no `gaitfit {command}` with arguments was found");
    }
    let mut failures = Vec::new();
    for advice in &all {
        if let Some(why) = wrong(advice) {
            failures.push(format!("{}: {}\n{why}", advice.file, advice.words.join(" ")));
        }
        if let Some(Err(why)) = read_settings(&advice.words[1], &sets(&advice.words)) {
            failures.push(format!("{}: {}\n{why}", advice.file, advice.words.join(" ")));
        }
    }
    assert!(failures.is_empty(), "{} commands fail:\n{}", failures.len(), failures.join("\n"));
}

#[test]
fn the_settings_that_help_texts_give_as_examples_are_those_of_the_command() {
    let mut tried = Vec::new();
    for mut command in Cli::command().get_subcommands().cloned().collect::<Vec<_>>() {
        let name = command.get_name().to_owned();
        let help = words(&command.render_long_help().to_string().replace('\'', " "));
        let sets = sets(&help);
        if let Some(read) = read_settings(&name, &sets) {
            assert!(read.is_ok(), "gaitfit {name} --help: {sets:?}: {read:?}");
            tried.extend(sets.iter().map(|set| format!("{name} {set}")));
        }
    }
    for wanted in ["fit optimizer.seeds=3", "train train.iterations=600", "finetune train.iterations=300"] {
        assert!(tried.iter().any(|one| one == wanted), "`{wanted}` is not in {tried:?}");
    }
}

#[test]
fn what_cannot_be_given_is_seen() {
    let is_wrong = |file: &str, text: &str| -> Vec<bool> {
        commands(file, text).iter().map(|advice| wrong(advice).is_some()).collect()
    };
    let source =
        "\"try `gaitfit train \\\n    --sedes 3`, or `gaitfit train`; then: gaitfit export --rebot x\"";
    assert_eq!(is_wrong("a.rs", source), [true, false, true]);
    let page = "```sh\ngaitfit adapt\ngaitfit adapt a.toml   # a comment\ngaitfit config train > a.toml\n```\nwith `gaitfit adapt`";
    assert_eq!(is_wrong("a.md", page), [true, false, false, false]);
    assert_eq!(sets(&words("gaitfit train --set 'a=[1, 2]' --set b=1 # x")), ["a=[1, 2]", "b=1"]);
    assert!(read_settings("train", &["optimizer.seeds=3".to_owned()]).unwrap().is_err());
}
