//! `gaitfit import`: any recording as a log.

use crate::cli::{Import, New};
use crate::exit::{Exit, Failure};
use crate::output;
use crate::table::table;
use gaitfit::files::{self, Output};
use gaitfit::robot;
use gaitfit::weight::{self, Order};
use gaitfit_import::{
    ImportError, ImportReport, Imported, MAX_MAPPING_BYTES, Mapping, ObservedNumber, Options,
};
use gaitfit_log::{CheckSpec, Finding, FindingKind, Severity, check, write_csv};
use gaitfit_model::{Model, argument, shown, shown_path};
use gaitfit_policy::observation::Layout;
use gaitfit_policy::{Interface, Quantity};
use serde::Serialize;
use std::fmt::Write;
use std::path::{Path, PathBuf};

/// The result, as `--json` prints it.
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
    let model = match &args.robot {
        Some(path) => Some(robot::named(path, args.lenient)?),
        None => None,
    };
    let (mapping, order_is_assumed) = mapping(args, model.as_ref())?;
    // Whatever is read must not be overwritten by the log.
    let inputs =
        args.files.iter().chain(&args.mapping).chain(&args.robot).chain(&args.policy).map(PathBuf::as_path);
    // Before the recording is read, which may take long.
    files::check(&[Output { path: &args.out, option: "--out", ending: Some("csv") }], inputs)?;
    let (imported, order) = in_order(&args.files, mapping, model.as_ref().filter(|_| order_is_assumed))?;
    let log = &imported.trajectory;
    let spec =
        model.as_ref().map_or_else(CheckSpec::default, |model| CheckSpec::of_robot(model, &log.joints));
    let mut findings = imported.report.noticed.clone();
    findings.extend(order);
    // Gains that change within a log have no place in it, so the log would be wrong without a sign of it.
    let lost =
        |finding: &&Finding| finding.severity == Severity::Error && finding.kind == FindingKind::GainsChange;
    if let Some(lost) = findings.iter().find(lost) {
        let message = format!(
            "{}: {}. Nothing was written. If the gains of the first sample hold, give allow = [\"{}\"] in a mapping file",
            lost.kind, lost.message, lost.kind
        );
        return Err(Failure { exit: Exit::Check, message });
    }
    findings.extend(check(log, &spec));
    findings.extend(model.iter().flat_map(|model| weight::signs(log, model)));
    findings.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    // Written even with errors in it, so that a person can look at the log.
    write_csv(&args.out, log).map_err(Failure::failed)?;
    let document = Document {
        written: args.out.display().to_string(),
        samples: log.len(),
        duration_s: log.duration(),
        rate_hz: log.rate_hz,
        joints: log.joints.clone(),
        report: imported.report,
        findings,
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
    let robot = args.robot.as_ref().map_or(String::new(), |robot| format!(" --robot {}", argument(robot)));
    output::next(&[format!("gaitfit inspect {}{robot} --plot log.svg", argument(&args.out))])
}

/// Reads a recording. Where nobody states the order of its numbered joints, `assumed` is the robot whose order was taken:
/// then limits and the weight of the legs decide, and a finding says what they showed.
fn in_order(
    files: &[PathBuf],
    mut mapping: Mapping,
    assumed: Option<&Model>,
) -> Result<(Imported, Option<Finding>), Failure> {
    // Read once as assumed: only the numbers show whether the order fits.
    let imported = read(files, mapping.clone())?;
    let numbered = imported.report.assumed.iter().any(|line| line.starts_with(NUMBERED));
    // Joints with names are matched by name, so their order does not matter.
    let Some(model) = assumed.filter(|_| numbered) else { return Ok((imported, None)) };
    match weight::order(&imported.trajectory, model) {
        Order::Shown => Ok((imported, None)),
        Order::Unknown => {
            let message = "nothing in the recording shows whether its numbered joints are in the order of the robot's file, as \
                           was assumed; many robots number them FR, FL, RR, RL or by joint type. State it: `joints = [...]` \
                           of a mapping file";
            Ok((imported, Some(finding(Severity::Warning, message.to_owned()))))
        }
        Order::Other(joints) => {
            let message = format!(
                "the numbered joints are not in the order of the robot's file: limits and the weight of the legs fit the \
                 order {}, which was taken. State it: `joints = [...]` of a mapping file",
                joints.join(", ")
            );
            mapping.joints = Some(joints);
            // Read again with the order that the weight of the legs shows.
            Ok((read(files, mapping)?, Some(finding(Severity::Warning, message))))
        }
    }
}

/// Reads a recording; what the caller must state is wrong usage.
fn read(files: &[PathBuf], mapping: Mapping) -> Result<Imported, Failure> {
    let options = Options { mapping, ..Options::default() };
    gaitfit_import::import(files, &options).map_err(|error| match error {
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
    let model = match &args.robot {
        Some(path) => Some(robot::named(path, args.lenient)?),
        None => None,
    };
    let (mapping, order_is_assumed) = mapping(
        &Import {
            mapping: args.mapping.clone(),
            policy: args.policy.clone(),
            robot: args.robot.clone(),
            lenient: args.lenient,
            ..Import::default()
        },
        model.as_ref(),
    )?;
    let assumed = model.as_ref().filter(|_| order_is_assumed);
    let (imported, order) = in_order(&[recording.to_owned()], mapping, assumed).map_err(|mut failure| {
        let name = shown_path(recording);
        // Some errors name the recording already.
        if !failure.message.contains(&name) {
            failure.message = format!("{name}: {}", failure.message);
        }
        failure
    })?;
    write_csv(out, &imported.trajectory).map_err(Failure::failed)?;
    let left_out = imported.report.left_out.iter().map(|line| format!("left out: {line}"));
    let order = order.map(|finding| finding.message);
    Ok(imported.report.assumed.iter().cloned().chain(left_out).chain(order).collect())
}

/// The beginning of the line about numbered joints.
const NUMBERED: &str = "joints 0 to ";

fn finding(severity: Severity, message: String) -> Finding {
    Finding { kind: FindingKind::JointOrder, severity, joints: Vec::new(), span: None, message }
}

/// The mapping of the file and what the command line says beside it; and whether the order of numbered joints is the
/// robot's because nobody states one.
fn mapping(args: &Import, model: Option<&Model>) -> Result<(Mapping, bool), Failure> {
    let mut mapping = match &args.mapping {
        None => Mapping::default(),
        Some(path) => {
            let text = files::read_text(path, MAX_MAPPING_BYTES)
                .map_err(|error| Failure::usage(format!("cannot read {}: {error}", path.display())))?;
            Mapping::parse(&text).map_err(|error| Failure::usage(format!("{}: {error}", path.display())))?
        }
    };
    // The policy that walked knows order, rate and robot better than the robot's file.
    if let Some(path) = &args.policy {
        let policy = gaitfit_policy_files::read(path).map_err(Failure::failed)?;
        let interface = &policy.interface;
        mapping.observation = Some(observed(interface));
        mapping.usual_rate_hz = Some(1.0 / interface.control_dt);
        mapping.joints = mapping.joints.or_else(|| Some(interface.joints.clone()));
        mapping.robot =
            mapping.robot.or_else(|| Some(interface.robot.clone()).filter(|robot| !robot.is_empty()));
    }
    // Noted before the robot's own order is filled in.
    let assumed = mapping.joints.is_none() && model.is_some();
    if let Some(model) = model {
        let joints = model.joints.iter().map(|joint| joint.name.clone()).collect();
        // Only the order of numbered joints: a recording with names keeps its own.
        mapping.joints = mapping.joints.or(Some(joints));
        mapping.robot = mapping.robot.or(Some(model.name.clone()));
        let slides = model.joints.iter().filter(|joint| !joint.kind.is_hinge());
        mapping.slides = Some(slides.map(|joint| joint.name.clone()).collect());
    }
    // The list of the command line replaces the one of the file: two lists together would take more than either
    // asks for.
    if !args.take.is_empty() {
        mapping.streams.take.clone_from(&args.take);
    }
    // The command line wins over the mapping file.
    mapping.clock_offset_s = args.clock_offset.or(mapping.clock_offset_s);
    mapping.every = args.every.map(|every| every as usize).or(mapping.every);
    mapping.rate_hz = args.rate.or(mapping.rate_hz);
    if let Some(rate) = args.rate.filter(|rate| !(rate.is_finite() && *rate > 0.0)) {
        return Err(Failure::usage(format!("--rate {rate}: give a positive number of samples a second")));
    }
    if let Some(offset) = args.clock_offset.filter(|offset| !offset.is_finite()) {
        return Err(Failure::usage(format!("--clock-offset {offset}: give seconds")));
    }
    Ok((mapping, assumed))
}

/// The log's columns that the numbers of a policy's observation hold: those of the present, and none for its last action,
/// gait clock and velocity, which logs have otherwise or not at all.
fn observed(interface: &Interface) -> Vec<Option<ObservedNumber>> {
    let layout = Layout::new(interface, &interface.observation);
    let scales = layout.scales();
    let mut parts: Vec<Option<ObservedNumber>> = vec![None; layout.width()];
    for slot in layout.slots() {
        // Such numbers have no column in a log.
        let Some(names) = slot.quantity.log_columns(&interface.joints) else { continue };
        for (number, (place, column)) in slot.present.clone().zip(names).enumerate() {
            let is_position = slot.quantity == Quantity::JointPosition;
            // Policies observe positions from the default pose; logs have absolute ones.
            let offset = if is_position { interface.default_pose[number] } else { 0.0 };
            let scale = f64::from(scales[place]);
            // A scale of 0 hides the quantity from the policy, so the recorded 0 shows nothing of it.
            parts[place] = (scale != 0.0).then_some(ObservedNumber { column, scale, offset });
        }
    }
    parts
}

fn text(document: &Document) -> String {
    let mut text = String::new();
    for (path, kind) in &document.report.files {
        let _ = writeln!(text, "{}: {kind}", shown_path(path));
    }
    // In the order in which a reader checks a recording: what was read, what was assumed, what was dropped, what is
    // wrong.
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
    if let Some(lead) = &document.report.lead {
        let _ = writeln!(
            text,
            "targets: stamped {:.3} ms after their rows (±{:.3} ms)",
            1e3 * lead.seconds,
            1e3 * lead.spread
        );
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

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_policy::observation::Sensed;

    /// The parts of a policy's observation are recovered from it.
    #[test]
    fn an_observation_is_unpacked_into_what_was_sensed() {
        let policy = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2-walk.safetensors");
        let policy = gaitfit_policy_files::read(policy.as_ref()).unwrap();
        let interface = &policy.interface;
        let joints = interface.joints.len();
        let ramp = |start: f32| (0..joints).map(|joint| start + 0.1 * joint as f32).collect::<Vec<f32>>();
        let sensed = Sensed {
            base_angular_velocity: [0.1, -0.2, 0.3],
            projected_gravity: [0.0, 0.1, -0.99],
            command: [0.5, 0.1, -0.4],
            joint_position: ramp(-0.5),
            joint_velocity: ramp(2.0),
            last_action: ramp(0.0),
            ..Sensed::new(joints)
        };
        let layout = Layout::new(interface, &interface.observation);
        let mut row = vec![0.0f32; layout.width()];
        layout.write(&sensed, None, |_, _| (), &mut row);
        let parts = observed(interface);
        assert_eq!(parts.len(), row.len());
        let reading = |column: &str| {
            let place = parts
                .iter()
                .position(|part| part.as_ref().is_some_and(|part| part.column == column))
                .unwrap();
            let part = parts[place].as_ref().unwrap();
            f64::from(row[place]) / part.scale + part.offset
        };
        for (joint, name) in interface.joints.iter().enumerate() {
            assert!((reading(&format!("q_{name}")) - f64::from(sensed.joint_position[joint])).abs() < 1e-5);
            assert!((reading(&format!("dq_{name}")) - f64::from(sensed.joint_velocity[joint])).abs() < 1e-5);
        }
        for (column, value) in
            [("wy", -0.2), ("projected_gravity_z", -0.99), ("vx_cmd", 0.5), ("wz_cmd", -0.4)]
        {
            assert!((reading(column) - value).abs() < 1e-6, "{column}");
        }
    }
}
