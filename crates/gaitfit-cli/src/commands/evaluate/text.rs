//! The result on a terminal.

use crate::table::table;
use gaitfit::evaluate::{Evaluation, Verdict};
use gaitfit_model::{shown_number, significant};
use gaitfit_view::DoubtKind;
use gaitfit_view::Estimate;
use std::fmt::Write as _;

fn shown(estimate: Estimate, digits: usize) -> String {
    match estimate {
        Estimate { mean, .. } if mean.is_nan() => "–".to_owned(),
        // One trajectory has a mean and no interval.
        Estimate { mean, ci95 } if ci95.is_nan() => format!("{mean:.digits$}"),
        Estimate { mean, ci95 } => format!("{mean:.digits$} ± {ci95:.digits$}"),
    }
}

/// The row of a policy that follows a motion.
pub const MOTION: &str = "distance from the motion";

/// The measurements: name, mean, digits and unit.
pub fn rows(document: &Evaluation) -> Vec<(&'static str, Estimate, usize, &'static str)> {
    let falls = document.fall_rate;
    let percent = Estimate { mean: 100.0 * falls.mean, ci95: 100.0 * falls.ci95 };
    let motion = |error| vec![(MOTION, error, 4, "rad")];
    let commands = || {
        vec![
            ("linear-velocity error", document.linear_velocity_error, 4, "m/s"),
            ("angular-velocity error", document.angular_velocity_error, 4, "rad/s"),
        ]
    };
    // A policy that follows a motion has no commands, so it has no error of them.
    let followed = document.motion_error.map_or_else(commands, motion);
    let others = [("falls", percent, 2, "%"), ("action rate", document.action_rate, 4, "a step")];
    let reward = [("summed reward", document.reward, 3, "")];
    reward.into_iter().chain(followed).chain(others).collect()
}

fn trajectories(count: usize) -> String {
    if count == 1 { "1 trajectory".to_owned() } else { format!("{count} trajectories") }
}

/// The doubts, then tables of means, drift and gait.
pub fn text(document: &Evaluation, verdict: Option<&Verdict>, wall_seconds: f64) -> String {
    let summary = document;
    let diverged = document.divergence().map(|message| format!("DIVERGED: {message}"));
    let verdict = verdict.map(|Verdict { walks, text, .. }| match walks {
        true => text.clone(),
        false => format!("{}: {text}", DoubtKind::NoWalk.headline().to_uppercase()),
    });
    // What must not be overlooked comes before the tables.
    let mut out: String = diverged.into_iter().chain(verdict).map(|line| format!("{line}\n\n")).collect();
    let _ = write!(
        out,
        "{} in {}: {} of {} s {}\n\n",
        document.policy,
        document.simulator,
        trajectories(summary.trajectories),
        shown_number(document.seconds),
        match document.motion_seconds {
            Some(motion) => format!("along a motion of {} s", significant(motion, 4)),
            None => "with random commands".to_owned(),
        }
    );
    let mut means = table(&["", "mean ± 95 %", "unit"], &[1]);
    for (name, estimate, digits, unit) in rows(document) {
        means.add_row([name, &shown(estimate, digits), unit]);
    }
    let _ = writeln!(out, "{means}");
    // Under a constant command small errors of the velocity add up, so the place at the end shows them best.
    if !document.drift.is_empty() {
        let mut drift =
            table(&["command", "x error, m", "y error, m", "yaw error, rad", "falls, %"], &[1, 2, 3, 4]);
        for trial in &document.drift {
            let name = trial.label();
            let falls = format!("{:.0}", 100.0 * trial.fall_rate.mean);
            drift.add_row([name, shown(trial.x, 3), shown(trial.y, 3), shown(trial.yaw, 3), falls]);
        }
        let _ = writeln!(
            out,
            "\nDrift: stand, command for 4 s, stand; final place minus the place of the command\n{drift}"
        );
    }
    // Levels get harder from row to row, so the table shows where a policy begins to fail.
    if !document.ground.is_empty() {
        let header = ["ground", "level", "", "robots", "crossed, %", "falls, %", "speed, m/s"];
        let mut ground = table(&header, &[1, 3, 4, 5, 6]);
        for row in &document.ground {
            ground.add_row([
                row.ground.clone(),
                row.level.to_string(),
                row.difficulty_text(),
                row.robots.to_string(),
                format!("{:.0}", 100.0 * row.crossed.mean),
                format!("{:.0}", 100.0 * row.fall_rate.mean),
                format!("{:.2}", row.speed.mean),
            ]);
        }
        let _ = writeln!(
            out,
            "\nUneven ground: robots start in the middle of their cells and walk straight ahead; a robot that leaves \
             its cell without a fall has crossed it\n{ground}"
        );
    }
    // How the robot walks: errors alone do not show feet that drag or motors that shake.
    if let Some(gait) = &document.gait {
        let _ = writeln!(
            out,
            "\nGait ahead: {:.0} % of the time on one foot group, {:.1} steps/s a foot, duty {:.2}, feet lifted {:.3} m,\n\
             action rate {:.3} a step, torque {:.1} N·m rms, {:.1} % of its power above 10 Hz",
            100.0 * gait.alternation,
            gait.step_frequency,
            gait.duty_factor,
            gait.foot_lift,
            gait.action_rate,
            gait.torque,
            100.0 * gait.torque_power_above_10_hz
        );
    }
    let _ = writeln!(out, "{:.1} s", wall_seconds);
    out
}
