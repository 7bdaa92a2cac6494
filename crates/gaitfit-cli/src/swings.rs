//! Tables of what logs show of joints and sensors without a simulation.

use crate::table::table;
use gaitfit::walk::explain::Cause;
use gaitfit::walk::swing::{Beside, Estimate, FrictionLaw, SwingFindings, SwingReport, prior_toml};
use gaitfit_model::significant;
use std::fmt::Write;

/// Usual physics step of a fit, s.
const STEP_S: f64 = 0.005;

/// Sensors, then joints, then `causes`; `beside`: values of a fit that swings say something of.
pub fn text(findings: &SwingFindings, causes: &[Cause], beside: &[Beside]) -> String {
    let mut text = sensors(findings);
    for sentence in &findings.taken_out {
        let _ = writeln!(text, "corrected before the legs were examined: {sentence}");
    }
    text += &left_out(findings);
    match (findings.best(), &findings.why_not) {
        (Some(report), _) => joints(&mut text, findings, report, beside),
        (None, Some(why)) => {
            let _ = writeln!(text, "\nlegs in the air: {why}");
        }
        (None, None) => {}
    }
    if let Some(why) = &findings.not_corrected {
        let _ = writeln!(text, "legs in the air are not corrected by simulated walks: {why}");
    }
    if !causes.is_empty() {
        let _ = write!(text, "\n{}", self::causes(causes));
    }
    text.trim_end().to_owned()
}

/// The joints that estimates from legs in the air leave out; empty if there are none.
pub fn left_out(findings: &SwingFindings) -> String {
    let line = |joints: &[String], what: &str| match joints {
        [] => String::new(),
        joints => format!("estimates from legs in the air {what}: {}\n", joints.join(", ")),
    };
    line(&findings.slides, "are only for hinges; they leave out these slides")
        + &line(&findings.coupled, "leave out these coupled joints")
}

/// The effects that the robot has and its model lacks, one line for each.
pub fn causes(causes: &[Cause]) -> String {
    if causes.is_empty() {
        return "gaitfit finds no effect in these logs that the model lacks.\n".to_owned();
    }
    let mut text = "The logs show effects that the model lacks, the largest first:\n".to_owned();
    for (number, cause) in causes.iter().enumerate() {
        let _ = writeln!(text, "{}. {}", number + 1, cause.text);
    }
    text
}

/// A value and its error with as many decimals as `decimals`, in `unit` times `scale`.
fn number(estimate: Estimate, scale: f64, decimals: usize) -> String {
    format!("{:.decimals$} ± {:.decimals$}", scale * estimate.value, scale * estimate.error)
}

fn sensors(findings: &SwingFindings) -> String {
    let mut rows = table(&["sensors, from the logs alone", "", "unit"], &[1]);
    let sensors = &findings.sensors;
    if let Some(lag) = sensors.velocity_lag {
        rows.add_row([
            "joint velocities later than positions".to_owned(),
            number(lag, 1e3, 2),
            "ms".to_owned(),
        ]);
    }
    for (axis, bias) in ["x", "y", "z"].iter().zip(sensors.gyro_bias.iter().flatten()) {
        rows.add_row([format!("gyro bias, {axis}"), number(*bias, 1.0, 4), "rad/s".to_owned()]);
    }
    for (axis, tilt) in ["roll", "pitch"].iter().zip(findings.tilt().iter().flatten()) {
        let name = format!("orientation against standing feet, {axis}");
        rows.add_row([name, number(*tilt, 1f64.to_degrees(), 2), "°".to_owned()]);
    }
    for (name, value, unit) in [
        ("smallest step of joint positions", sensors.position_step, "rad"),
        ("noise of joint velocities, at most", sensors.velocity_noise, "rad/s"),
        ("noise of the gyro, at most", sensors.gyro_noise, "rad/s"),
    ] {
        if let Some(value) = value {
            rows.add_row([name.to_owned(), significant(value, 3), unit.to_owned()]);
        }
    }
    format!("{rows}\n")
}

fn joints(text: &mut String, findings: &SwingFindings, report: &SwingReport, beside: &[Beside]) {
    let legs = if findings.corrected.is_some() {
        "legs in the air, corrected by simulated walks"
    } else {
        "legs in the air"
    };
    let mut rows = table(
        &[legs, "friction N·m", "damping N·m·s/rad", "armature kg·m²", "left N·m", "swings"],
        &[1, 2, 3, 4, 5],
    );
    for group in &report.groups {
        rows.add_row([
            group.group.clone(),
            number(group.friction, 1.0, 3),
            number(group.damping, 1.0, 3),
            number(group.armature, 1.0, 4),
            format!("{:.2}", group.residual),
            group.swings.to_string(),
        ]);
    }
    let law = match report.law {
        FrictionLaw::Coulomb => "friction reverses with the joint",
        FrictionLaw::Engine => "friction reverses a little before the joint, as in MuJoCo and this engine",
    };
    let _ = writeln!(
        text,
        "\n{rows}\ndelay of targets {} ms; strength of motors {}; {law}; {} log{}, feet {:.0} mm or more above the lowest",
        number(report.delay, 1e3, 1),
        number(report.strength, 1.0, 2),
        report.logs,
        if report.logs == 1 { "" } else { "s" },
        1e3 * report.clearance_m
    );
    if !report.unseen.is_empty() {
        let _ = writeln!(text, "not in the air long enough: {}", report.unseen.join(", "));
    }
    // Without a fit there is nothing to compare with, but the estimates can be priors of one.
    if beside.is_empty() {
        let _ = writeln!(text, "\n{}", prior_toml(findings, report, STEP_S));
        return;
    }
    let mut rows = table(&["parameter", "fitted", "in swings", "unit", ""], &[1, 2]);
    for one in beside {
        rows.add_row([
            one.name.clone(),
            format!("{:.4}", one.fitted),
            number(one.swings, 1.0, 4),
            one.unit.clone(),
            if one.differ { "differ".to_owned() } else { String::new() },
        ]);
    }
    let _ = writeln!(text, "\n{rows}");
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn joints_that_are_left_out_are_named() {
        assert_eq!(left_out(&SwingFindings::default()), "");
        let coupled = vec!["left_knee".to_owned(), "right_knee".to_owned()];
        let text = left_out(&SwingFindings { coupled, ..SwingFindings::default() });
        assert!(text.contains("coupled joints: left_knee, right_knee"), "{text}");
    }
}
