//! `gaitfit new`: a configuration for a robot's logs. Recordings of other programs become logs first.

use super::import;
use crate::cli::New;
use crate::exit::{Exit, Failure};
use crate::output;
use gaitfit::files::{self, Output};
use gaitfit::new::{self, NewSettings, Written};
use gaitfit_log::{LogError, ReadOptions, csv_files};
use gaitfit_model::{shown, shown_path};
use gaitfit_robot::run::WHOLE;
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
    let mut converted = Converted::new(args.out.as_deref());
    if let Some(out) = &args.out {
        let inputs = args.logs.iter().chain(&args.robot).chain(&args.policy).chain(&args.mapping);
        let asked = Output { path: out, option: "--out", ending: Some("toml") };
        files::check(&[asked], inputs.map(PathBuf::as_path))?;
        if out.exists() && !args.force {
            return Err(exists(out));
        }
        for path in &args.logs {
            settings.logs.extend(converted.logs(path, args, &mut assumed)?);
        }
    } else {
        settings.logs.clone_from(&args.logs);
    }
    // Converted recordings are removed again if this fails; `keep` below makes them stay.
    let mut written = new::write(&settings)?;
    converted.keep();
    // In front: a wrong unit or order of joints makes all later warnings meaningless.
    written.warnings.splice(0..0, assumed);
    if args.json { output::print_json(&written) } else { output::print(&text(&written)) }?;
    match written.problem {
        None => Ok(()),
        Some(mut problem) => Err(Failure {
            exit: Exit::Check,
            message: {
                if !problem.ends_with(['.', '!', '?']) {
                    problem.push('.');
                }
                format!(
                    "{} is written, but cannot be run yet: {problem} Correct the file, or the cause and run `gaitfit new` again with --force.",
                    written.file
                )
            },
        }),
    }
}

fn exists(file: &Path) -> Failure {
    Failure::usage(format!(
        "{} exists already; give another --out, or --force to overwrite it",
        file.display()
    ))
}

/// Logs that recordings become, in a folder beside the configuration. What a call that fails wrote is removed.
struct Converted {
    folder: PathBuf,
    /// Logs of this call, also those that replace older files.
    logs: Vec<PathBuf>,
    /// Files to remove if the call fails.
    files: Vec<PathBuf>,
    /// Whether this call made the folder.
    made: bool,
}

impl Converted {
    fn new(out: Option<&Path>) -> Self {
        // Without `--out` nothing is converted, so the empty path is never used.
        let folder = out.map(|out| out.with_extension("logs")).unwrap_or_default();
        Self { folder, logs: Vec::new(), files: Vec::new(), made: false }
    }

    /// The call did not fail: the logs stay.
    fn keep(&mut self) {
        self.files.clear();
        self.made = false;
    }

    /// The file for a recording's log. Recordings of other folders or formats may have the same name; they get numbers.
    fn file(&self, recording: &Path) -> PathBuf {
        let name = recording.file_stem().unwrap_or_default().to_string_lossy();
        let mut file = self.folder.join(format!("{name}.csv"));
        // The first log of a name has no number, so the next one gets 2.
        let mut number = 1;
        while self.logs.contains(&file) {
            number += 1;
            file = self.folder.join(format!("{name}-{number}.csv"));
        }
        file
    }

    /// The logs at a path: a log itself, or what its recordings become.
    fn logs(&mut self, path: &Path, args: &New, assumed: &mut Vec<String>) -> Result<Vec<PathBuf>, Failure> {
        if !path.exists() {
            return Err(Failure::usage(format!(
                "--logs {}: there is no such file or folder",
                path.display()
            )));
        }
        // A file may be a log or a recording, a folder a bag, a folder of recordings, or one of logs.
        let recordings: Vec<PathBuf> = match path.is_dir() {
            // A .csv file of another program is a recording.
            false if has_ending(path, &["csv"]) && is_log(path, args)? => return Ok(vec![path.to_owned()]),
            false => vec![path.to_owned()],
            // The file that every ROS 2 bag has. The folder is one recording, whatever it holds.
            true if path.join("metadata.yaml").is_file() => vec![path.to_owned()],
            true => {
                let mut inside = recordings(path)?;
                if inside.is_empty() {
                    inside = csv_files(path).map_err(Failure::failed)?;
                    // One that is a log shows that all are: another program writes its own columns into each.
                    let logs = match inside.first() {
                        Some(first) => is_log(first, args)?,
                        None => true,
                    };
                    if logs {
                        return Ok(vec![path.to_owned()]);
                    }
                }
                if let Some(logs) = logs_beside(path, &inside, args)? {
                    return Ok(logs);
                }
                inside
            }
        };
        if !self.folder.is_dir() {
            std::fs::create_dir_all(&self.folder).map_err(|error| {
                Failure::failed(format!("cannot make {}: {error}", self.folder.display()))
            })?;
            self.made = true;
        }
        let mut logs = Vec::new();
        for recording in recordings {
            let log = self.file(&recording);
            let asked = Output { path: &log, option: "--out", ending: None };
            files::check(&[asked], [recording.as_path()])?;
            // Only files that this run made may be removed after a failure.
            let new = !log.exists();
            if !new && !args.force {
                return Err(exists(&log));
            }
            for line in import::convert(&recording, &log, args)? {
                assumed.push(format!("{}: {line}", shown_path(&recording)));
            }
            self.files.extend(new.then(|| log.clone()));
            self.logs.push(log.clone());
            logs.push(log);
        }
        Ok(logs)
    }
}

impl Drop for Converted {
    fn drop(&mut self) {
        // A file that cannot be removed stays in the folder, where the user sees it.
        self.files.iter().for_each(|file| drop(std::fs::remove_file(file)));
        if self.made {
            let _ = std::fs::remove_dir(&self.folder);
        }
    }
}

/// The logs of a folder in which each recording has a log of its name beside it, as `gaitfit collect --robot` writes them; the
/// folder if it holds nothing else. The logs contain more than the recordings.
fn logs_beside(folder: &Path, recordings: &[PathBuf], args: &New) -> Result<Option<Vec<PathBuf>>, Failure> {
    if !recordings.iter().all(|recording| recording.with_extension("csv").is_file()) {
        return Ok(None);
    }
    let files = csv_files(folder).map_err(Failure::failed)?;
    let is_whole = |path: &&PathBuf| path.file_name().is_some_and(|name| name == WHOLE);
    let logs: Vec<PathBuf> = files.iter().filter(|path| !is_whole(path)).cloned().collect();
    for log in &logs {
        if !is_log(log, args)? {
            return Ok(None);
        }
    }
    Ok(Some(if files.len() == logs.len() { vec![folder.to_owned()] } else { logs }))
}

fn has_ending(path: &Path, endings: &[&str]) -> bool {
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    ending.is_some_and(|ending| endings.contains(&ending.as_str()))
}

/// The recordings of a folder that are not text, by name.
fn recordings(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let unreadable = |error| Failure::failed(format!("cannot read {}: {error}", folder.display()));
    let mut inside = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let file = entry.map_err(unreadable)?.path();
        if has_ending(&file, &RECORDINGS) {
            inside.push(file);
        }
    }
    // The file system's order differs between machines, and it would decide the order of the logs.
    inside.sort();
    Ok(inside)
}

/// Whether a .csv file is a log, not a recording of another program, which has other columns. A mapping is for the latter.
///
/// # Errors
/// A log with a fault, by line and column.
fn is_log(path: &Path, args: &New) -> Result<bool, Failure> {
    if args.mapping.is_some() {
        return Ok(false);
    }
    match gaitfit_log::read_csv(path, &ReadOptions::default()) {
        Ok(_) => Ok(true),
        Err(
            // Faults that a table of another program has too: its columns have other names, or it is no table of
            // numbers.
            LogError::MissingColumn { .. }
            | LogError::DuplicateColumn { .. }
            | LogError::RowLength { .. }
            | LogError::NotUtf8 { .. }
            | LogError::LineTooLong { .. },
        ) => Ok(false),
        Err(fault) => Err(Failure::failed(fault)),
    }
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::cli::{Cli, Command};
    use clap::Parser;

    #[test]
    fn a_folder_of_foreign_csv_is_imported_and_a_call_that_fails_leaves_nothing() {
        let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name).display().to_string();
        for name in ["mine", "other"] {
            std::fs::create_dir(path(name)).unwrap();
        }
        let text = std::fs::read_to_string(root.join("examples/go2-demo/fit.csv")).unwrap();
        let mut lines = text.lines().filter(|line| !line.starts_with('#'));
        let header = lines.next().unwrap().replace("qdes_", "to_").replace("dq_", "speed_");
        let header = header.replace("q_", "angle_").replace("time", "stamp");
        let rows: Vec<&str> = lines.collect();
        for name in ["mine/a.csv", "mine/b.csv", "other/a.csv"] {
            std::fs::write(path(name), format!("{header}\n{}\n", rows.join("\n"))).unwrap();
        }
        let mapping = "kp = 25\nkd = 0.5\n[time]\ncolumn = \"stamp\"\n[columns]\nposition = \"angle_{joint}\"\n\
                       velocity = \"speed_{joint}\"\ntarget = \"to_{joint}\"\n";
        std::fs::write(path("map.toml"), mapping).unwrap();
        let robot = root.join("assets/go2.xml").display().to_string();
        let called = |more: &[&str]| {
            let (logs, out) = (path("mine"), path("new.toml"));
            let words = ["gaitfit", "new", "--robot", &robot, "--logs", &logs, "--out", &out];
            let cli = Cli::try_parse_from(words.iter().chain(more)).unwrap();
            let Command::New(args) = cli.command else { panic!("another command") };
            super::run(&args)
        };
        assert!(called(&[]).is_err(), "nothing names its columns");
        assert!(!Path::new(&path("new.logs")).exists() && !Path::new(&path("new.toml")).exists());
        called(&["--mapping", &path("map.toml"), "--logs", &path("other")]).unwrap();
        let written = std::fs::read_to_string(path("new.toml")).unwrap();
        for name in ["a", "b", "a-2"] {
            let log = format!("new.logs/{name}.csv");
            assert!(Path::new(&path(&log)).exists() && written.contains(&log), "{log}: {written}");
        }
        // Logs of an earlier call are kept, too.
        std::fs::remove_file(path("new.toml")).unwrap();
        let refused = called(&["--mapping", &path("map.toml")]).unwrap_err().message;
        assert!(refused.contains("a.csv exists already"), "{refused}");
        assert!(Path::new(&path("new.logs/a.csv")).exists());
    }
}
