//! Files of a preflight: the result, the logs, and the lines for a fit.

use super::Document;
use crate::cli::Preflight;
use crate::exit::Failure;
use gaitfit_robot::Robot;
use gaitfit_robot::preflight::{Flown, Heard, Measured, SampledStates, listening_csv, motion_csv};
use std::fmt::Write;

/// The result.
pub const RESULT: &str = "preflight.json";
/// The configuration of a fit of the motion.
const FIT: &str = "preflight.toml";
/// The motion, and what states its inertial unit beside it.
const MOTION: &str = "motion.csv";
const SIDECAR: &str = "motion.toml";
/// The messages while nothing was sent; in a folder of its own, because no fit can read them.
const LISTENING: &str = "listening/listening.csv";
/// Physics step of the fit, s.
const STEP: f64 = 0.002;

/// Writes them and lists them in `document`.
pub fn write(
    args: &Preflight,
    robot: &Robot,
    heard: &[Heard],
    flight: Option<(&Flown, &SampledStates)>,
    document: &mut Document,
) -> Result<(), Failure> {
    let mut put = |name: &str, text: &str| -> Result<(), Failure> {
        let path = args.out.join(name);
        if let Some(folder) = path.parent() {
            std::fs::create_dir_all(folder)
                .map_err(|error| Failure::failed(format!("cannot make {}: {error}", folder.display())))?;
        }
        gaitfit::files::write(&path, text.as_bytes())?;
        document.written.push(name.to_owned());
        Ok(())
    };
    put(LISTENING, &listening_csv(heard, robot))?;
    if let Some(log) = flight.and_then(|(flown, rows)| motion_csv(flown, rows, robot)) {
        put(MOTION, &log)?;
        if let Some(mounting) = document.mounting {
            put(SIDECAR, &format!("[imu]\nmounting = {mounting:?}\n"))?;
        }
    }
    let has_log = document.written.iter().any(|name| name == MOTION);
    let fit = fit(args, robot, document, has_log);
    put_fit(args, &fit, document)?;
    document.written.push(RESULT.to_owned());
    let text = serde_json::to_vec_pretty(document)
        .map_err(|error| Failure::failed(format!("cannot write the result: {error}")))?;
    Ok(gaitfit::files::write(&args.out.join(RESULT), &text)?)
}

fn put_fit(args: &Preflight, text: &str, document: &mut Document) -> Result<(), Failure> {
    gaitfit::files::write(&args.out.join(FIT), text.as_bytes())?;
    document.written.push(FIT.to_owned());
    Ok(())
}

/// The configuration of a fit of the motion, with what is known; lines for fits of walks are comments.
fn fit(args: &Preflight, robot: &Robot, document: &Document, has_log: bool) -> String {
    let mut text = format!("# By gaitfit preflight of a {}.\n", robot.title);
    if has_log {
        let model = match &args.model {
            Some(path) => std::path::absolute(path).unwrap_or_else(|_| path.clone()).display().to_string(),
            None if robot.name == "go2" => gaitfit::robot::GO2.to_owned(),
            None => String::new(),
        };
        if model.is_empty() {
            text.push_str("# Name the robot's description (MJCF or URDF) in `robot`.\n");
        }
        let _ = writeln!(text, "robot = {model:?}\nlogs = [{MOTION:?}]\n");
        // Groups of other robots: one value for all joints of a name, on whichever side.
        let legs = |kind: &str| robot.motors.iter().any(|motor| motor.joint.ends_with(kind));
        let quadruped = ["_hip", "_thigh", "_calf"].into_iter().all(legs);
        if !quadruped {
            for kind in ["frictionloss", "armature"] {
                let _ = writeln!(text, "[[parameter]]\nkind = {kind:?}\nper = \"joint\"\n");
            }
            text.push_str("[[parameter]]\nkind = \"delay\"\nper = \"all\"\n\n");
        }
        let _ = writeln!(text, "[simulation]\ntimestep = {STEP}\n");
        if let Some(delay) = document.moved.as_ref().and_then(|moved| moved.delay.or(moved.torque_delay)) {
            let Measured { value, error } = delay;
            let _ = writeln!(
                text,
                "[prior]\n# By each joint's own motion.\ndelay = {{ value = {:.5}, deviation = {:.5} }}\n",
                value.max(0.0),
                error.max(0.0005)
            );
        }
    }
    walks(&mut text, document);
    text
}

/// Lines for fits of walks, and for the sidecar files of their logs.
fn walks(text: &mut String, document: &Document) {
    if let Some(unit) = &document.listened.imu {
        text.push_str("# For fits of walks that fit the gyro's bias ([[number]] kind = \"gyro_bias_x\", …), in their [prior]:\n");
        for (axis, bias) in ["x", "y", "z"].iter().zip(&unit.gyro_bias) {
            let Measured { value, error } = bias;
            let _ = writeln!(
                text,
                "# gyro_bias_{axis} = {{ value = {value:.5}, deviation = {:.5} }}",
                error.max(0.0005)
            );
        }
    }
    if let Some(mounting) = document.mounting {
        let _ = writeln!(text, "# For log.toml beside logs of walks:\n# [imu]\n# mounting = {mounting:?}");
    }
}
