//! Files of a preflight: the result, the logs, and the lines for a fit.

use super::Document;
use crate::cli::Preflight;
use crate::exit::Failure;
use gaitfit::walk::swing::prior_key;
use gaitfit_robot::Robot;
use gaitfit_robot::preflight::{
    Flown, Heard, JointMotion, Measured, Moved, SampledStates, listening_csv, motion_csv,
};
use std::fmt::Write;

/// The result.
pub const RESULT: &str = "preflight.json";
/// The configuration of a fit of the motion.
const FIT: &str = "preflight.toml";
/// The built-in Go2, for that fit.
const GO2: &str = "go2.xml";
/// The log of the motion, and the file beside it that states how its inertial unit is mounted.
const MOTION: &str = "motion.csv";
const SIDECAR: &str = "motion.toml";
/// The messages while nothing was sent. They have their own folder, because no fit can read them.
const LISTENING: &str = "listening/listening.csv";
/// Largest dry friction that is searched, in parts of the strongest motor's torque, as `gaitfit new` has it.
const FRICTION: f32 = 0.05;
/// Least standard error of friction and armature, in parts of them.
const ROUGH: f64 = 0.1;
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
    // Only a motion that reached the hanging pose gives a log, and a fit without a log cannot run.
    let has_log = document.written.iter().any(|name| name == MOTION);
    // Made before the lines below change the list of written files.
    let fit = fit(args, robot, document, has_log);
    let mut put = |name: &str, text: &str| -> Result<(), Failure> {
        gaitfit::files::write(&args.out.join(name), text.as_bytes())?;
        document.written.push(name.to_owned());
        Ok(())
    };
    let built_in = args.model.as_ref().is_none_or(|path| path.as_os_str() == gaitfit::robot::GO2);
    if has_log && built_in && robot.name == "go2" {
        put(GO2, gaitfit_model::builtin::GO2)?;
    }
    put(FIT, &fit)?;
    // Listed before it is written, so that the result names itself too.
    document.written.push(RESULT.to_owned());
    let text = serde_json::to_vec_pretty(document)
        .map_err(|error| Failure::failed(format!("cannot write the result: {error}")))?;
    Ok(gaitfit::files::write(&args.out.join(RESULT), &text)?)
}

/// The configuration of a fit of the motion, with priors. Lines for fits of walks are comments.
fn fit(args: &Preflight, robot: &Robot, document: &Document, has_log: bool) -> String {
    let mut text = format!("# By gaitfit preflight of a {}.\n", robot.title);
    if has_log {
        let model = match &args.model {
            Some(path) if path.as_os_str() == gaitfit::robot::GO2 => GO2.to_owned(),
            // Absolute: the configuration is in another folder than the one in which the command was typed.
            Some(path) => std::path::absolute(path).unwrap_or_else(|_| path.clone()).display().to_string(),
            None if robot.name == "go2" => GO2.to_owned(),
            None => String::new(),
        };
        if model.is_empty() {
            text.push_str("# Name the robot's description (MJCF or URDF) in `robot`.\n");
        }
        // Escapes of Rust are not all TOML's.
        let model = toml::Value::from(model);
        let _ = writeln!(text, "robot = {model}\nlogs = [{MOTION:?}]\n");
        parameters(&mut text, robot);
        let _ = writeln!(
            text,
            "[simulation]\ntimestep = {STEP}\n\n[optimizer]\nmethod = \"least-squares\"\nseeds = 1\n"
        );
        if let Some(moved) = &document.moved {
            priors(&mut text, robot, moved);
        }
    }
    walks(&mut text, document);
    text
}

/// Joint groups that a fit has by itself, if they cover all joints of the robot.
fn groups(robot: &Robot) -> Option<[&'static str; 3]> {
    let groups = ["hip", "thigh", "calf"];
    let covered = |joint: &str| groups.iter().any(|group| joint.ends_with(&format!("_{group}")));
    robot.motors.iter().all(|motor| covered(&motor.joint)).then_some(groups)
}

/// The fitted parameters: friction, armature, damping and the delay.
fn parameters(text: &mut String, robot: &Robot) {
    let per = if groups(robot).is_some() { "group" } else { "joint" };
    let strongest = robot.motors.iter().map(|motor| motor.torque).fold(0.0, f32::max);
    // In N·m. A bound much below it could cut off the friction of a small robot's gears.
    let friction = f64::from(FRICTION * strongest).max(0.5);
    let _ = writeln!(
        text,
        "[[parameter]]\nkind = \"frictionloss\"\nper = \"{per}\"\nupper = {friction:.2}\n\n\
         [[parameter]]\nkind = \"armature\"\nper = \"{per}\"\n\n\
         [[parameter]]\nkind = \"damping\"\nper = \"{per}\"\n\n\
         [[parameter]]\nkind = \"delay\"\nper = \"all\"\n"
    );
}

/// A number of a joint's own motion.
type Number = fn(&JointMotion) -> Option<Measured>;

/// Priors from each joint's own motion, under the names of the fit's parameters.
fn priors(text: &mut String, robot: &Robot, moved: &Moved) {
    text.push_str("# By each joint's own motion.\n[prior]\n");
    let mut put = |name: &str, value: f64, deviation: f64| {
        // Noise can make an estimate negative, and none of these parameters may be.
        let (name, value) = (prior_key(name), value.max(0.0));
        let _ = writeln!(text, "{name} = {{ value = {value:.5}, deviation = {deviation:.5} }}");
    };
    if let Some(Measured { value, error }) = moved.delay.or(moved.torque_delay) {
        // A deviation close to 0 would make the prior outweigh the log, so it is at least 1 ms.
        put("delay", value, error.max(0.001));
    }
    let names: Vec<String> = match groups(robot) {
        Some(groups) => groups.map(str::to_owned).to_vec(),
        None => robot.motors.iter().map(|motor| motor.joint.clone()).collect(),
    };
    for name in names {
        // Groups are named by the ends of their joints' names.
        let of_group = |one: &&JointMotion| one.joint == name || one.joint.ends_with(&format!("_{name}"));
        let kinds: [(&str, Number); 2] =
            [("frictionloss", |one| one.friction), ("armature", |one| one.armature)];
        for (kind, number) in kinds {
            let estimates: Vec<Measured> = moved.joints.iter().filter(of_group).filter_map(number).collect();
            if estimates.is_empty() {
                continue;
            }
            let (value, deviation) = together(&estimates);
            put(&format!("{kind}_{name}"), value, deviation);
        }
    }
}

/// The number of a group, from those of its joints, and its standard error.
fn together(estimates: &[Measured]) -> (f64, f64) {
    let count = estimates.len().max(1) as f64;
    // Noise can make estimates negative. Their distance from 0, the smallest possible value, is then an error too.
    let value = (estimates.iter().map(|one| one.value).sum::<f64>() / count).max(0.0);
    // The spread of the joints and the error of each: a group's number must allow for both.
    let scatter =
        estimates.iter().map(|one| (one.value - value).powi(2) + one.error.powi(2)).sum::<f64>() / count;
    // As for the delay: a deviation near 0 would outweigh the log.
    (value, scatter.sqrt().max(ROUGH * value).max(0.001))
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
                // Listening for long gives tiny errors, and a prior with such a deviation would outweigh the walks.
                error.max(0.0005)
            );
        }
    }
    if let Some(mounting) = document.mounting {
        let _ = writeln!(text, "# For log.toml beside logs of walks:\n# [imu]\n# mounting = {mounting:?}");
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn priors_of_any_name_of_a_joint_are_keys() {
        let mut robot = Robot::built_in("unitree-go2").unwrap();
        robot.motors[0].joint = "leg.1/hip \"a\"".to_owned();
        let joint = |name: &str| JointMotion {
            joint: name.to_owned(),
            moved: 0.2,
            asked: 0.2,
            other: None,
            follows: None,
            delay: None,
            torque_delay: None,
            friction: Some(Measured { value: 0.3, error: 0.01 }),
            damping: None,
            inertia: None,
            armature: None,
            torque_gain: None,
            zero: None,
        };
        let names = [robot.motors[0].joint.clone(), robot.motors[1].joint.clone()];
        let moved = Moved {
            reason: None,
            commands: 0,
            changed: 0,
            joints: names.iter().map(|name| joint(name)).collect(),
            delay: None,
            torque_delay: None,
            mass_factor: None,
        };
        let mut text = String::new();
        priors(&mut text, &robot, &moved);
        let table: toml::Table = text.parse().unwrap();
        for name in &names {
            assert_eq!(
                table["prior"][&format!("frictionloss_{name}")]["value"].as_float(),
                Some(0.3),
                "{text}"
            );
        }
        assert!(text.contains(&format!("\nfrictionloss_{} = ", names[1])), "{text}");
    }

    #[test]
    fn a_prior_at_0_is_as_unsure_as_its_negative_estimates() {
        let measured = |value: f64| Measured { value, error: 0.002 };
        let (value, deviation) = together(&[measured(-0.01), measured(-0.01)]);
        assert_eq!(value, 0.0);
        assert!((deviation - 0.01_f64.hypot(0.002)).abs() < 1e-12, "{deviation}");
        let (value, deviation) = together(&[measured(0.01), measured(0.03)]);
        assert!((value - 0.02).abs() < 1e-12 && (deviation - 0.01_f64.hypot(0.002)).abs() < 1e-12);
    }
}
