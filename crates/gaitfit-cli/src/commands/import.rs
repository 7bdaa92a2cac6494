//! `gaitfit import`: any recording as a log.

use crate::cli::{Import, New};
use crate::exit::{Exit, Failure};
use crate::output;
use crate::table::table;
use gaitfit::files::{self, Output};
use gaitfit::robot::{self, Hold};
use gaitfit_import::{ImportError, ImportReport, Imported, MOST_MAPPING_BYTES, Mapping, Options};
use gaitfit_log::{CheckSpec, Finding, Severity, check, write_csv};
use gaitfit_model::{shown, shown_path};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// What was read, as `--json` prints it.
#[derive(Serialize)]
struct Document {
    written: String,
    samples: usize,
    duration_s: f64,
    rate_hz: f64,
    joints: Vec<String>,
    #[serde(flatten)]
    report: ImportReport,
    findings: Vec<Finding>,
}

/// Reads the recording, writes the log, prints what was assumed and what is wrong with it.
pub fn run(args: &Import) -> Result<(), Failure> {
    let mapping = mapping(args)?;
    let inputs = args.files.iter().chain(&args.mapping).chain(&args.robot).map(PathBuf::as_path);
    files::check(&[Output { path: &args.out, option: "--out", ending: Some("csv") }], inputs)?;
    let options = Options { mapping, ..Options::default() };
    let imported = read(&args.files, &options)?;
    let log = &imported.trajectory;
    write_csv(&args.out, log).map_err(Failure::failed)?;
    let document = Document {
        written: args.out.display().to_string(),
        samples: log.len(),
        duration_s: log.duration(),
        rate_hz: log.rate_hz,
        joints: log.joints.clone(),
        report: imported.report,
        findings: check(log, &CheckSpec::default()),
    };
    if args.json { output::print_json(&document) } else { output::print(&text(&document)) }?;
    let errors = document.findings.iter().filter(|finding| finding.severity == Severity::Error).count();
    if errors > 0 {
        let message = format!("{} is written, and {errors} finding(s) forbid using it", document.written);
        return Err(Failure { exit: Exit::Check, message });
    }
    if args.json {
        return Ok(());
    }
    let robot = args.robot.as_ref().map_or("ROBOT".into(), |robot| robot.to_string_lossy());
    output::next(&[format!("gaitfit inspect {} --robot {robot} --plot log.svg", document.written)])
}

/// Reads a recording; what the caller must state is wrong usage.
fn read(files: &[PathBuf], options: &Options) -> Result<Imported, Failure> {
    gaitfit_import::import(files, options).map_err(|error| match error {
        ImportError::Mapping { .. }
        | ImportError::NoJointNames { .. }
        | ImportError::MotorsBeyond { .. }
        | ImportError::NoSuchStream { .. }
        | ImportError::NothingToShift
        | ImportError::Ambiguous { .. } => Failure::usage(error),
        error => Failure::failed(error),
    })
}

/// Writes `recording` as the log `out` for `gaitfit new`, and gives what was assumed and left out.
pub fn convert(recording: &Path, out: &Path, args: &New) -> Result<Vec<String>, Failure> {
    let mapping = mapping(&Import {
        mapping: args.mapping.clone(),
        robot: args.robot.clone(),
        lenient: args.lenient,
        ..Import::default()
    })?;
    let options = Options { mapping, ..Options::default() };
    let imported = read(&[recording.to_owned()], &options)?;
    write_csv(out, &imported.trajectory).map_err(Failure::failed)?;
    let left_out = imported.report.left_out.iter().map(|line| format!("left out: {line}"));
    Ok(imported.report.assumed.iter().cloned().chain(left_out).collect())
}

/// The mapping of the file and what the command line says beside it.
fn mapping(args: &Import) -> Result<Mapping, Failure> {
    let mut mapping = match &args.mapping {
        None => Mapping::default(),
        Some(path) => {
            let text = files::read_text(path, MOST_MAPPING_BYTES)
                .map_err(|error| Failure::usage(format!("cannot read {}: {error}", path.display())))?;
            Mapping::parse(&text).map_err(|error| Failure::usage(format!("{}: {error}", path.display())))?
        }
    };
    if let Some(path) = &args.robot {
        let model = robot::read(path, args.lenient, Hold::File)?;
        let joints = model.joints.iter().map(|joint| joint.name.clone()).collect();
        mapping.joints = mapping.joints.or(Some(joints));
        mapping.robot = mapping.robot.or(Some(model.name.clone()));
    }
    if !args.take.is_empty() {
        mapping.streams.take.clone_from(&args.take);
    }
    mapping.clock_offset_s = args.clock_offset.or(mapping.clock_offset_s);
    mapping.rate_hz = args.rate.or(mapping.rate_hz);
    if let Some(rate) = args.rate.filter(|rate| !(rate.is_finite() && *rate > 0.0)) {
        return Err(Failure::usage(format!("--rate {rate}: give a positive number of samples a second")));
    }
    if let Some(offset) = args.clock_offset.filter(|offset| !offset.is_finite()) {
        return Err(Failure::usage(format!("--clock-offset {offset}: give seconds")));
    }
    Ok(mapping)
}

fn text(document: &Document) -> String {
    let mut text = String::new();
    for (path, kind) in &document.report.files {
        let _ = writeln!(text, "{}: {kind}", shown_path(path));
    }
    let mut streams =
        table(&["stream", "samples", "Hz", "from s", "to s", "clock", "quantities"], &[1, 2, 3, 4]);
    for stream in &document.report.streams {
        streams.add_row([
            shown(&stream.name),
            stream.samples.to_string(),
            format!("{:.1}", stream.rate_hz),
            format!("{:.3}", stream.span_s[0]),
            format!("{:.3}", stream.span_s[1]),
            stream.clock.to_owned(),
            stream.quantities.iter().map(|name| shown(name)).collect::<Vec<_>>().join(", "),
        ]);
    }
    let _ = writeln!(text, "\n{streams}\n");
    for stream in &document.report.streams {
        for finding in &stream.findings {
            let _ = writeln!(text, "{}: {finding}", shown(&stream.name));
        }
    }
    for line in &document.report.assumed {
        let _ = writeln!(text, "assumed: {line}");
    }
    for line in &document.report.left_out {
        let _ = writeln!(text, "left out: {line}");
    }
    let [before, after] = document.report.dropped;
    if before + after > 0 {
        let _ = writeln!(
            text,
            "dropped: {before} samples before the other streams begin and {after} after they end"
        );
    }
    for finding in &document.findings {
        let _ = writeln!(text, "{finding}");
    }
    let _ = writeln!(
        text,
        "{}: {} joints, {} samples at {} Hz, {:.2} s",
        document.written,
        document.joints.len(),
        document.samples,
        document.rate_hz,
        document.duration_s
    );
    text
}
