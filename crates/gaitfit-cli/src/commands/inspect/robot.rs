//! A robot file at a glance.

use super::{interval, number};
use crate::cli::Inspect;
use crate::exit::Failure;
use crate::output;
use crate::table::table;
use gaitfit::robot;
use gaitfit_model::{JointKind, Root, Summary};
use std::fmt::Write;

/// Prints bodies, joints, actuators, contact geoms and what was left out.
pub fn run(args: &Inspect) -> Result<(), Failure> {
    let summary = robot::read(&args.file, args.lenient, robot::Hold::File)?.summary();
    if args.json {
        return output::print_json(&summary);
    }
    output::print(&text(&summary))?;
    output::next(&[format!(
        "gaitfit new --robot {} --logs LOGS --out my-robot.toml",
        gaitfit_model::argument(&args.file)
    )])
}

fn text(summary: &Summary) -> String {
    let root = match summary.root {
        Root::Floating => "floating",
        Root::Fixed => "fixed",
    };
    let mut text = format!(
        "{}: {root} base, {} kg, {} bodies, {} joints, {} actuators (nq {}, nv {}, nu {})\n",
        summary.name,
        number(Some(summary.total_mass)),
        summary.bodies.len(),
        summary.joints.len(),
        summary.actuators.len(),
        summary.nq,
        summary.nv,
        summary.nu
    );
    let mut bodies =
        table(&["body", "parent", "mass kg", "centre of mass m", "principal inertia kg·m²"], &[2]);
    for body in &summary.bodies {
        bodies.add_row([
            body.name.clone(),
            body.parent.clone().unwrap_or_else(|| "–".to_owned()),
            number(Some(body.mass)),
            body.com.map(|value| format!("{value:.4}")).join(" "),
            // Inertias of base and feet differ by orders of magnitude, so they have an exponent.
            body.inertia.map(|value| format!("{value:.3e}")).join(" "),
        ]);
    }
    // Hinges and slides have other units, so each kind has a table.
    let [hinges, slides] = [JointKind::Hinge, JointKind::Slide].map(|kind| joints(summary, kind));
    let slides_at = |name: &String| {
        summary.joints.iter().any(|joint| joint.name == *name && joint.kind == JointKind::Slide)
    };
    // The unit is in the header, and only robots with slides need the second one.
    let forces = summary.actuators.iter().any(|actuator| slides_at(&actuator.joint));
    let force = if forces { "force range N·m (slides: N)" } else { "force range N·m" };
    let mut actuators = table(&["actuator", "joint", "kind", "gear", "control range", force], &[3]);
    for actuator in &summary.actuators {
        actuators.add_row([
            actuator.name.clone(),
            actuator.joint.clone(),
            actuator.kind.to_owned(),
            number(Some(actuator.gear)),
            interval(actuator.ctrlrange),
            interval(actuator.forcerange),
        ]);
    }
    let mut geoms = table(&["contact geom", "body", "shape", "planes", "condim", "friction"], &[3, 4, 5]);
    for geom in &summary.geoms {
        geoms.add_row([
            geom.name.clone(),
            geom.body.clone(),
            geom.shape.to_owned(),
            geom.pairs.to_string(),
            geom.condim.to_string(),
            number(geom.friction),
        ]);
    }
    for part in [bodies, hinges, slides, actuators, geoms].iter().filter(|part| part.row_count() > 0) {
        let _ = writeln!(text, "\n{part}");
    }
    if !summary.couplings.is_empty() {
        let couplings = summary.couplings.join("\n  ");
        let _ = writeln!(
            text,
            "\ncoupled joints (x: the other joint's distance from its reference):\n  {couplings}"
        );
    }
    if !summary.keyframes.is_empty() {
        let _ = writeln!(text, "\nkeyframes: {}", summary.keyframes.join(", "));
    }
    remarks(&mut text, summary);
    text
}

/// The joints of one kind.
fn joints(summary: &Summary, kind: JointKind) -> comfy_table::Table {
    let units = ["rad", "N·m", "rad/s", "kg·m²", "N·m·s/rad", "N·m"].map(|unit| kind.unit(unit));
    let [position, effort, speed, armature, damping, friction] = units;
    let header = [
        if kind.is_hinge() { "joint" } else { "slide" }.to_owned(),
        "axis".to_owned(),
        format!("limits {position}"),
        format!("effort {effort}"),
        format!("speed {speed}"),
        format!("armature {armature}"),
        format!("damping {damping}"),
        format!("frictionloss {friction}"),
    ];
    let mut joints = table(&header.each_ref().map(String::as_str), &[3, 4, 5, 6, 7]);
    for joint in summary.joints.iter().filter(|joint| joint.kind == kind) {
        joints.add_row([
            joint.name.clone(),
            joint.axis.map(|value| number(Some(value))).join(" "),
            interval(joint.range),
            number(joint.effort),
            number(joint.velocity_limit),
            number(Some(joint.armature)),
            number(Some(joint.damping)),
            number(Some(joint.frictionloss)),
        ]);
    }
    joints
}

/// What of the file is not as the robot is: parts left out, changes, warnings.
fn remarks(text: &mut String, summary: &Summary) {
    if !summary.left_out.is_empty() {
        text.push_str("\nleft out:\n");
    }
    for group in &summary.left_out {
        let place = match (group.line, group.last_line) {
            // Line 0: it has no place in the file.
            (0, _) => String::new(),
            (first, last) if first == last => format!(" (line {first})"),
            (first, last) => format!(" (lines {first} to {last})"),
        };
        let _ = writeln!(text, "  {}: {}{place}", group.what, group.why);
    }
    if !summary.changed.is_empty() {
        text.push_str("\nadded or corrected:\n");
    }
    for change in &summary.changed {
        let place = if change.line > 0 { format!(" (line {})", change.line) } else { String::new() };
        let _ = writeln!(text, "  {}: {}{place}", change.what, change.how);
    }
    if !summary.warnings.is_empty() {
        text.push_str("\nwarnings:\n");
    }
    for warning in &summary.warnings {
        let _ = writeln!(text, "  {warning}");
    }
}
