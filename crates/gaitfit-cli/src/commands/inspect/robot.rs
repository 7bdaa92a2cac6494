//! A robot file at a glance.

use super::{interval, number};
use crate::cli::Inspect;
use crate::exit::Failure;
use crate::output;
use crate::table::table;
use gaitfit::robot;
use gaitfit_model::{Root, Summary};
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
            body.inertia.map(|value| format!("{value:.3e}")).join(" "),
        ]);
    }
    let mut joints = table(
        &[
            "joint",
            "axis",
            "limits rad",
            "effort N·m",
            "speed rad/s",
            "armature kg·m²",
            "damping N·m·s/rad",
            "frictionloss N·m",
        ],
        &[3, 4, 5, 6, 7],
    );
    for joint in &summary.joints {
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
    let mut actuators =
        table(&["actuator", "joint", "kind", "gear", "control range", "force range N·m"], &[3]);
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
    for part in [bodies, joints, actuators, geoms].iter().filter(|part| part.row_count() > 0) {
        let _ = writeln!(text, "\n{part}");
    }
    if !summary.keyframes.is_empty() {
        let _ = writeln!(text, "\nkeyframes: {}", summary.keyframes.join(", "));
    }
    if !summary.left_out.is_empty() {
        text.push_str("\nleft out:\n");
    }
    for group in &summary.left_out {
        let place = match (group.line, group.last_line) {
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
    text
}
