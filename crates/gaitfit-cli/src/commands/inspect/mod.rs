//! `gaitfit inspect`: what a robot file or a log holds.

mod folder;
pub(super) mod log;
mod plot;
mod robot;
pub(super) mod swings;

use super::policy::{document, text};
use crate::cli::Inspect;
use crate::exit::Failure;
use crate::output;
use gaitfit::policy_file::{self, PolicyFile};
use gaitfit_model::{argument, significant, with_decimals};

/// Tells robots, logs and policies by the file's ending, and prints what they hold; a folder is one of logs.
pub fn run(args: &Inspect) -> Result<(), Failure> {
    std::fs::metadata(&args.file)
        .map_err(|error| Failure::failed(format!("cannot read {}: {error}", args.file.display())))?;
    let path = &args.file;
    // A folder with CSV files is one of logs, whatever else is in it.
    if path.is_dir()
        && policy_file::holds_policy(path)
        && gaitfit_log::csv_files(path).is_ok_and(|all| all.is_empty())
    {
        return policy(args);
    }
    if args.file.is_dir() {
        if args.policy.is_some() {
            return Err(Failure::usage("--policy is for one log (.csv); `gaitfit new` compares a folder"));
        }
        if args.plot.is_some() || (args.lenient && args.robot.is_none()) {
            return Err(Failure::usage("--plot is for one log (.csv), --lenient for robot files"));
        }
        return folder::run(args);
    }
    let is_csv = args.file.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("csv"));
    if args.policy.is_some() && !is_csv {
        return Err(Failure::usage("--policy is for one log (.csv)"));
    }
    let ending = args.file.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    // Told apart by name and not by content, so that a message can say what the name promises.
    match ending.as_deref() {
        // A xacro file is refused by what reads robots, with the command that expands it.
        Some("xml" | "mjcf" | "urdf" | "xacro") => {
            if args.plot.is_some() || args.robot.is_some() {
                return Err(Failure::usage("--plot and --robot are for logs (.csv)"));
            }
            robot::run(args)
        }
        Some("csv") => {
            // A policy may remember a robot file.
            if args.lenient && args.robot.is_none() && args.policy.is_none() {
                return Err(Failure::usage("--lenient is for robot files"));
            }
            log::run(args)
        }
        Some("safetensors" | "onnx" | "toml") => policy(args),
        // Refused with the lines that convert it.
        Some("pth" | "jit" | "ptl") => policy(args),
        Some("pt") => policy(args).map_err(|mut failure| {
            failure.message.push_str("\nIf it is a recording, read it with `gaitfit import`.");
            failure
        }),
        Some(
            "npz" | "npy" | "mcap" | "db3" | "pkl" | "pickle" | "parquet" | "feather" | "arrow" | "h5"
            | "hdf5" | "mat" | "bag",
        ) => Err(Failure::usage(format!(
            "{}: this seems to be a recording of another program; `gaitfit import {} --out log.csv` makes a log of it",
            args.file.display(),
            argument(&args.file)
        ))),
        _ => Err(Failure::usage(format!(
            "{}: neither a robot (.xml, .mjcf, .urdf), a log (.csv), a folder of logs, nor a policy (.safetensors, \
             .onnx, .toml)",
            args.file.display()
        ))),
    }
}

/// Prints what a policy sees and does.
fn policy(args: &Inspect) -> Result<(), Failure> {
    if args.plot.is_some() || args.robot.is_some() || args.lenient || args.policy.is_some() {
        return Err(Failure::usage("--plot, --robot, --policy and --lenient are for robots and logs"));
    }
    let PolicyFile { path, note } = policy_file::find(&args.file)?;
    note.iter().for_each(|note| output::note(note));
    let policy = gaitfit_policy_files::read(&path).map_err(Failure::failed)?;
    let unsealed = gaitfit_policy_files::unsealed(&path).map_err(Failure::failed)?;
    let document = document(&policy, Vec::new()).unsealed(&unsealed);
    if args.json { output::print_json(&document) } else { output::print(&text(&document)) }
}

/// A number for a table: up to four digits that matter, "–" for none.
fn number(value: Option<f64>) -> String {
    match value {
        None => "–".to_owned(),
        // Written out, such numbers would be wider than the rest of their table.
        Some(value) if value.abs() >= 1e9 => significant(value, 4),
        Some(value) => {
            let text = with_decimals(value, 4);
            if text.contains('.') {
                text.trim_end_matches('0').trim_end_matches('.').to_owned()
            } else {
                text
            }
        }
    }
}

/// An interval for a table.
fn interval(range: Option<[f64; 2]>) -> String {
    range.map_or_else(
        || "–".to_owned(),
        |[low, high]| format!("[{}, {}]", number(Some(low)), number(Some(high))),
    )
}
