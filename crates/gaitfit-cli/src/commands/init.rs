//! `gaitfit init`: looks at a robot and writes a task for it.

use crate::cli::Init;
use crate::exit::Failure;
use crate::output;
use gaitfit::files::{self, Output};
use gaitfit::init::{Guess, look};
use gaitfit::paths;
use gaitfit::robot::{self, Hold};
use serde::Serialize;
use std::path::PathBuf;

/// What was found, as `--json` prints it.
#[derive(Serialize)]
struct Document {
    robot: String,
    written: String,
    guesses: Vec<Guess>,
    warnings: Vec<String>,
}

/// Writes the configuration and prints what was guessed.
pub fn run(args: &Init) -> Result<(), Failure> {
    if robot::is_built_in(&args.robot) {
        return Err(Failure::usage(
            "the built-in Go2 needs no configuration: `gaitfit train` trains a policy for it, and `gaitfit config train` prints the settings",
        ));
    }
    let model = robot::read(&args.robot, args.lenient, Hold::File)?;
    let out = args.out.clone().unwrap_or_else(|| file_for(&model.name));
    let asked = Output { path: &out, option: "--out", ending: Some("toml") };
    files::check(&[asked], [args.robot.as_path()])?;
    if out.exists() && !args.force {
        return Err(Failure::usage(format!(
            "{} exists already; give another --out, or --force to overwrite it",
            out.display()
        )));
    }
    let found =
        look(&model).map_err(|error| Failure::failed(format!("{}: {error}", args.robot.display())))?;
    let text = found.configuration(&paths::named(&args.robot, &out), args.lenient);
    files::write(&out, text.as_bytes())?;
    let document = Document {
        robot: model.name.clone(),
        written: out.display().to_string(),
        guesses: found.guesses,
        warnings: robot::remarks(&model),
    };
    if args.json { output::print_json(&document) } else { output::print(&shown(&document)) }
}

/// The robot's name as a file in the current folder.
fn file_for(robot: &str) -> PathBuf {
    let plain = |letter: char| {
        if letter.is_ascii_alphanumeric() || "_-.".contains(letter) { letter } else { '-' }
    };
    let name: String = robot.chars().map(plain).take(64).collect();
    let name = name.trim_matches(['.', '-']);
    PathBuf::from(format!("{}.toml", if name.is_empty() { "robot" } else { name }))
}

fn shown(document: &Document) -> String {
    let mut text = format!("{}: {}\n", document.robot, document.written);
    for guess in &document.guesses {
        text.push_str(&format!("  {:<10}{}\n", guess.what, guess.found));
    }
    for warning in &document.warnings {
        text.push_str(&format!("note: {warning}\n"));
    }
    text.push_str(&format!("next: gaitfit train {}\n", document.written));
    text
}
