//! Fitted parameters for other simulators.

use crate::cli::Export;
use crate::commands::folder;
use crate::exit::Failure;
use crate::output;
use crate::table::table;
use gaitfit::export_theta::{ExportSettings, Row};
use gaitfit::files::{self, Output};
use gaitfit_log::PerJoint;
use gaitfit_model::shown;
use serde::Serialize;
use std::fmt::Write;
use std::path::PathBuf;

/// The written files, as `--json` prints them.
#[derive(Serialize)]
struct Document {
    written: Vec<String>,
    parameters: Vec<Row>,
    notes: Vec<String>,
}

/// Writes the files and prints which of them says which parameter.
pub fn run(args: &Export) -> Result<(), Failure> {
    let out = super::needed(args, "for-simulators")?;
    folder(out, "the files go")?;
    let settings = ExportSettings {
        theta: args.file.clone(),
        robot: args.robot.clone(),
        lenient: args.lenient,
        kp: args.kp.map(PerJoint::All),
        kd: args.kd.map(PerJoint::All),
        policy: args.policy.clone(),
        step: args.step,
    };
    // Everything is made before anything is written.
    let exported = gaitfit::export_theta(&settings)?;
    let paths: Vec<PathBuf> = exported.files.iter().map(|(name, _)| out.join(name)).collect();
    let outputs: Vec<Output<'_>> =
        paths.iter().map(|path| Output { path, option: "--out", ending: None }).collect();
    let inputs = [Some(&args.file), args.robot.as_ref(), args.policy.as_ref()];
    // Before the check, which looks whether the folder of the outputs is there.
    std::fs::create_dir_all(out)
        .map_err(|error| Failure::failed(format!("cannot make {}: {error}", out.display())))?;
    // A file of the robot's in the same folder may have a name of these.
    files::check(&outputs, inputs.into_iter().flatten().map(PathBuf::as_path))?;
    let mut written = Vec::new();
    for (path, (_, bytes)) in paths.iter().zip(&exported.files) {
        files::write(path, bytes)?;
        written.push(path.display().to_string());
    }
    let document = Document { written, parameters: exported.rows, notes: exported.notes };
    if args.json { output::print_json(&document) } else { output::print(&text(&document)) }
}

fn text(document: &Document) -> String {
    let mut rows = table(&["parameter", "value", "unit", "interval", "identified", "said by"], &[1]);
    for row in &document.parameters {
        rows.add_row([
            shown(&row.name),
            format!("{:.5}", row.value),
            row.unit.clone(),
            row.interval.map_or("–".to_owned(), |[low, high]| format!("{low:.5} to {high:.5}")),
            row.identified.map_or("–", |is| if is { "yes" } else { "no" }).to_owned(),
            if row.in_robot_file { "the robot's file" } else { "theta.json and code" }.to_owned(),
        ]);
    }
    let mut text = format!("{rows}\n\n");
    for note in &document.notes {
        let _ = writeln!(text, "note: {note}");
    }
    for path in &document.written {
        let _ = writeln!(text, "{path}");
    }
    text
}
