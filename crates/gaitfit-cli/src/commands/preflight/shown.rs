//! The result on the terminal: findings first.

use super::Document;
use crate::cli::Preflight;
use crate::table::table;
use gaitfit_model::{argument, significant, with_decimals};
use gaitfit_robot::preflight::{JointMotion, JointReport, Measured, Moved};
use std::fmt::Write;

/// The text.
pub fn text(args: &Preflight, document: &Document) -> String {
    let mut text = String::new();
    match document.findings.len() {
        0 => text.push_str("No finding.\n"),
        _ => document.findings.iter().for_each(|finding| {
            let _ = writeln!(text, "• {finding}");
        }),
    }
    let network = &document.listened.network;
    let lost = network.lost.map_or("not counted".to_owned(), |lost| lost.to_string());
    let _ = write!(
        text,
        "\n{} states in {:.1} s, {:.0} a second; longest gap {:.1} ms; lost {lost}, twice {}",
        network.messages, network.seconds, network.hz, network.longest_gap_ms, network.doubled
    );
    if let Some(clock) = &network.clock {
        let ppm = clock.faster_ppm;
        let _ = write!(text, "; robot's clock {:+.0} ± {:.0} ppm", ppm.value, ppm.error);
    }
    let charge = document.listened.charge.map_or("not reported".to_owned(), |charge| format!("{charge} %"));
    let _ = writeln!(text, "\nbattery {charge}");
    if let Some(unit) = &document.listened.imu {
        let angles = unit.roll_pitch_yaw.map_or("none".to_owned(), |[roll, pitch, yaw]| {
            format!("roll {roll:.1}°, pitch {pitch:.1}°, yaw {yaw:.1}°")
        });
        let apart = unit
            .apart
            .map_or(String::new(), |apart| format!(", {apart:.1}° from the accelerometer's vertical"));
        let bias: Vec<String> = unit.gyro_bias.iter().map(|bias| number(*bias, 1.0, 4)).collect();
        let _ = writeln!(
            text,
            "orientation {angles}{apart}; gravity {} m/s²\ngyro at rest {} rad/s",
            number(unit.gravity, 1.0, 3),
            bias.join(", ")
        );
    }
    for one in &document.tilted {
        let [x, y, z] = one.turn;
        let [a, b, c] = one.gyro_turn;
        let _ = writeln!(
            text,
            "{:?}: by the orientation {x:.0}°, {y:.0}°, {z:.0}° about x, y, z; by the gyro {a:.0}°, {b:.0}°, {c:.0}°",
            one.motion
        );
    }
    if !document.listened.joints.is_empty() {
        let _ = writeln!(text, "\n{}", joints(&document.listened.joints));
    }
    if let Some(moved) = &document.moved {
        motion(&mut text, moved);
    }
    let _ = writeln!(text, "\n{}: {}", args.out.display(), document.written.join(", "));
    // A fit needs the log of the motion, and a robot without faults.
    if document.moved.is_some() && document.passed {
        let _ = writeln!(text, "next: gaitfit fit {}", argument(&args.out.join("preflight.toml")));
    } else if document.passed {
        text.push_str("The joints were not moved; --move does that.\n");
    }
    text
}

fn joints(reports: &[JointReport]) -> String {
    let mut rows = table(
        &["joint", "angle rad", "room rad", "moved", "step", "dq noise", "°C", ""],
        &[1, 2, 3, 4, 5, 6],
    );
    for one in reports {
        rows.add_row([
            one.joint.clone(),
            with_decimals(one.angle, 3),
            one.room.map_or("–".to_owned(), |room| with_decimals(room, 3)),
            with_decimals(one.moved, 4),
            significant(one.step, 2),
            format!("{:.3}", one.velocity_noise),
            one.temperature.to_string(),
            if one.is_at_stop() { "at its stop".to_owned() } else { String::new() },
        ]);
    }
    rows.to_string()
}

fn motion(text: &mut String, moved: &Moved) {
    let header = [
        "joint",
        "moved",
        "follows",
        "delay ms",
        "by torque ms",
        "friction N·m",
        "inertia kg·m²",
        "torque ×",
        "zero rad",
    ];
    let mut rows = table(&header, &[1, 2, 3, 4, 5, 6, 7, 8]);
    let part = |value: Option<f64>| value.map_or("–".to_owned(), |value| format!("{value:.2}"));
    let cell = |value: Option<Measured>, factor: f64, digits: usize| {
        value.map_or("–".to_owned(), |value| number(value, factor, digits))
    };
    for one in &moved.joints {
        let JointMotion {
            joint,
            moved,
            follows,
            delay,
            torque_delay,
            friction,
            inertia,
            torque_gain,
            zero,
            ..
        } = one;
        rows.add_row([
            joint.clone(),
            format!("{moved:.3}"),
            part(*follows),
            cell(*delay, 1e3, 1),
            cell(*torque_delay, 1e3, 1),
            cell(*friction, 1.0, 2),
            cell(*inertia, 1.0, 4),
            torque_gain.map_or("–".to_owned(), |[low, high]| format!("{low:.2} to {high:.2}")),
            cell(*zero, 1.0, 2),
        ]);
    }
    let _ = writeln!(
        text,
        "\n{rows}\ndelay of all joints {} ms by the motion, {} ms by the torque; {} commands, {} changed by the guard",
        cell(moved.delay, 1e3, 1),
        cell(moved.torque_delay, 1e3, 1),
        moved.commands,
        moved.changed
    );
}

fn number(measured: Measured, factor: f64, digits: usize) -> String {
    format!("{:.digits$} ± {:.digits$}", factor * measured.value, factor * measured.error)
}
