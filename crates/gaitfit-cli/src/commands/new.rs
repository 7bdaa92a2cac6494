//! `gaitfit new`: a configuration for a robot's logs. Recordings of other programs become logs first.

use super::import;
use crate::cli::New;
use crate::exit::{Exit, Failure};
use crate::output;
use gaitfit::files::{self, Output};
use gaitfit::new::{self, NewSettings, Written};
use gaitfit_log::ReadOptions;
use gaitfit_model::{shown, shown_path};
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// Endings of recordings in a folder; a folder of a ROS 2 bag is one recording.
const RECORDINGS: [&str; 11] =
    ["mcap", "db3", "bag", "parquet", "arrow", "feather", "h5", "hdf5", "npz", "pkl", "pt"];

/// Writes the configuration and prints what was assumed.
pub fn run(args: &New) -> Result<(), Failure> {
    let mut settings = NewSettings {
        robot: args.robot.clone(),
        policy: args.policy.clone(),
        logs: Vec::new(),
        out: args.out.clone(),
        kp: args.kp.clone().map(|gain| gain.0),
        kd: args.kd.clone().map(|gain| gain.0),
        lenient: args.lenient,
    };
    let mut assumed = Vec::new();
    if let Some(out) = &args.out {
        let inputs = args.logs.iter().chain(&args.robot).chain(&args.policy).chain(&args.mapping);
        let asked = Output { path: out, option: "--out", ending: Some("toml") };
        files::check(&[asked], inputs.map(PathBuf::as_path))?;
        if out.exists() && !args.force {
            return Err(Failure::usage(format!(
                "{} exists already; give another --out, or --force to overwrite it",
                out.display()
            )));
        }
        for path in &args.logs {
            settings.logs.extend(logs(path, args, out, &mut assumed)?);
        }
    } else {
        settings.logs.clone_from(&args.logs);
    }
    let mut written = new::write(&settings)?;
    written.warnings.splice(0..0, assumed);
    if args.json { output::print_json(&written) } else { output::print(&text(&written)) }?;
    match written.problem {
        None => Ok(()),
        Some(problem) => Err(Failure {
            exit: Exit::Check,
            message: format!("{} is written, but cannot be run yet: {problem}", written.file),
        }),
    }
}

/// The logs at a path: a log itself, or what its recordings become, in a folder beside the configuration.
fn logs(path: &Path, args: &New, out: &Path, assumed: &mut Vec<String>) -> Result<Vec<PathBuf>, Failure> {
    let ending = |path: &Path| path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    if !path.exists() {
        return Err(Failure::usage(format!("--logs {}: there is no such file or folder", path.display())));
    }
    let recordings: Vec<PathBuf> = match path.is_dir() {
        // A .csv file of another program is a recording.
        false if ending(path).as_deref() == Some("csv") && is_log(path, args) => {
            return Ok(vec![path.to_owned()]);
        }
        false => vec![path.to_owned()],
        true if path.join("metadata.yaml").is_file() => vec![path.to_owned()],
        true => {
            let unreadable = |error| Failure::failed(format!("cannot read {}: {error}", path.display()));
            let mut inside = Vec::new();
            for entry in std::fs::read_dir(path).map_err(unreadable)? {
                let file = entry.map_err(unreadable)?.path();
                if ending(&file).is_some_and(|ending| RECORDINGS.contains(&ending.as_str())) {
                    inside.push(file);
                }
            }
            if inside.is_empty() {
                return Ok(vec![path.to_owned()]);
            }
            inside.sort();
            inside
        }
    };
    let folder = out.with_extension("logs");
    std::fs::create_dir_all(&folder)
        .map_err(|error| Failure::failed(format!("cannot make {}: {error}", folder.display())))?;
    let mut logs = Vec::new();
    for recording in recordings {
        let name = recording.file_stem().unwrap_or_default().to_string_lossy().into_owned();
        let log = folder.join(format!("{name}.csv"));
        for line in import::convert(&recording, &log, args)? {
            assumed.push(format!("{}: {line}", shown_path(&recording)));
        }
        logs.push(log);
    }
    Ok(logs)
}

/// Whether a .csv file is a log as it stands, not one of another program.
fn is_log(path: &Path, args: &New) -> bool {
    args.mapping.is_none() && gaitfit_log::read_csv(path, &ReadOptions::default()).is_ok()
}

fn text(written: &Written) -> String {
    let mut text = format!("{}\n", shown(&written.file));
    for line in &written.assumed {
        let _ = writeln!(text, "  {:<9}{}", line.what, line.value);
    }
    for warning in &written.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    if written.problem.is_none() {
        let _ = writeln!(text, "next: {}", written.next);
    }
    text
}
