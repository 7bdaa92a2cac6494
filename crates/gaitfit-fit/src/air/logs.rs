//! From log files to samples in the robot's joint order, with gains, and to what the simulator replays.

use crate::Error;
use crate::log::Log;
use crate::settings::{AdaptConfig, FileGains};
use crate::{log_check, log_joints, paths, weight};
use gaitfit_log::{
    CheckSpec, PerJoint, ReadOptions, ReadReport, Regular, Severity, Trajectory, check, read_csv_report,
};
use gaitfit_model::{Model, listed, shown, shown_number};
use gaitfit_sim::Recording;
use globset::Glob;
use std::path::Path;

/// Fewest samples of a log: fewer do not show how a joint moves.
const MIN_SAMPLES: usize = 20;
/// Gains that differ by a smaller part are rounded.
const SAME_GAIN: f64 = 1e-3;
/// Max number of joints that a sentence names.
const MAX_NAMED: usize = 6;

/// Reads the log `named` for a robot, and gives what its checks doubt, each in a sentence. `override_gains` are gains
/// that win over the log's own.
pub fn read(
    named: &str,
    config_path: &Path,
    config: &AdaptConfig,
    model: &Model,
    override_gains: &[FileGains],
) -> Result<(Log, Vec<String>), Error> {
    let path = paths::find(named, "log", config_path)?;
    // Gains come from `validate_gains`, from the log, or from [gains], in this order. The last ones need a
    // second reading.
    let gains = matching(override_gains, named, &path)?;
    // Gains that the configuration states for this log win over the log's own.
    let options =
        gains.map_or_else(ReadOptions::default, |gains| with_gains(gains.kp.clone(), gains.kd.clone()));
    let (mut trajectory, mut report) = open(&path, &options)?;
    // The log states none, so it is read again with those of the configuration.
    if trajectory.gains.is_none() {
        if config.gains.kp.is_none() || config.gains.kd.is_none() {
            return Err(Error::settings(format!(
                "{}: the log does not state its PD gains, and neither does the configuration. Give `kp` and `kd` \
                 in [gains] (for example --set gains.kp=25 --set gains.kd=0.5), in the log's header, or in a file \
                 {} beside it.",
                path.display(),
                path.with_extension("toml").display()
            )));
        }
        (trajectory, report) = open(&path, &with_gains(config.gains.kp.clone(), config.gains.kd.clone()))?;
    }
    // Gains that the configuration states for this log are meant to differ.
    let contradiction = gains.is_none().then(|| contradiction(&trajectory, config)).flatten();
    if trajectory.len() < MIN_SAMPLES {
        return Err(Error::failed(format!(
            "{}: {} samples are too few to compare with a simulation; give at least {MIN_SAMPLES}, better some \
             seconds of motion.",
            path.display(),
            trajectory.len()
        )));
    }
    // A replay needs all joints of the robot.
    let all: Vec<usize> = (0..model.joints.len()).collect();
    let (trajectory, joints) = log_joints::of_robot(&trajectory, &path, &config.joint_names, model, &all)?;
    let mut findings = report.findings();
    findings.extend(check(&trajectory, &CheckSpec::of_robot(model, &trajectory.joints)));
    findings.extend(weight::signs(&trajectory, model));
    // Called for its errors alone.
    recording(&trajectory, &path)?;
    let findings = log_check::allowed(findings, &config.allow, &report.allowed);
    log_check::refuse(&findings, &path, &[])?;
    // A replay has a row every interval: what was lost would shift all that follows.
    let Regular { mut trajectory, filled, .. } =
        trajectory.regular().map_err(|error| Error::failed(format!("{}: {error}", path.display())))?;
    let doubts = findings.iter().filter(|finding| finding.severity != Severity::Note);
    let mut doubts: Vec<String> = doubts.map(|finding| format!("{named}: {finding}")).collect();
    if trajectory.command.as_ref().is_some_and(|command| command.iter().any(|part| part.abs() > 0.0)) {
        doubts.push(format!(
            "{named}: the log has commands, as walks have, and is replayed as that of a clamped robot; if the robot walked, add \
             base = \"free\" and `policy`"
        ));
    }
    doubts.extend(contradiction.map(|doubt| format!("{named}: {doubt}")));
    doubts.extend(release(&mut trajectory, model).map(|doubt| format!("{named}: {doubt}")));
    let (name, sidecars) = (named.to_owned(), report.sidecars);
    Ok((Log { name, path, sidecars, joints, trajectory, mounting: None, filled }, doubts))
}

/// Says that [gains] of the configuration are others than the log's, which count. The log has its own joints.
fn contradiction(trajectory: &Trajectory, config: &AdaptConfig) -> Option<String> {
    let gains = trajectory.gains.as_ref()?;
    for (what, own, stated) in [("kp", &gains.kp, &config.gains.kp), ("kd", &gains.kd, &config.gains.kd)] {
        // Where [gains] do not fit the log's joints, they are of other logs.
        let Some(stated) = stated.as_ref().and_then(|stated| stated.resolve(what, &trajectory.joints).ok())
        else {
            continue;
        };
        let mut pairs = trajectory.joints.iter().zip(own.iter().zip(&stated));
        if let Some((joint, (own, stated))) =
            pairs.find(|(_, (own, stated))| (*own - *stated).abs() > SAME_GAIN * own.abs())
        {
            return Some(format!(
                "the log states {what} {} of joint {}, and [gains] of the configuration {}: the log's gains count",
                shown_number(*own),
                shown(joint),
                shown_number(*stated)
            ));
        }
    }
    None
}

/// Takes away the gains of joints to which the robot file gives no motor, while it gives others one, and says so. The log has
/// the model's joints.
fn release(trajectory: &mut Trajectory, model: &Model) -> Option<String> {
    let gains = trajectory.gains.as_mut()?;
    let mut released = Vec::new();
    for (joint, (kp, kd)) in gains.kp.iter_mut().zip(&mut gains.kd).enumerate() {
        if !model.is_driven(joint) && (*kp, *kd) != (0.0, 0.0) {
            // A joint that only follows another one needs no motor.
            if !model.only_follows(joint) {
                let name = shown(&model.joints[joint].name);
                released.push(format!("{name} (kp {}, kd {})", shown_number(*kp), shown_number(*kd)));
            }
            (*kp, *kd) = (0.0, 0.0);
        }
    }
    (!released.is_empty()).then(|| {
        format!(
            "the log states gains of joints that have no motor in the robot file, and are replayed without torque: {}; if \
             motors drive them, give them actuators there",
            listed(released, MAX_NAMED)
        )
    })
}

fn open(path: &Path, options: &ReadOptions) -> Result<(Trajectory, ReadReport), Error> {
    read_csv_report(path, options).map_err(Error::failed)
}

fn with_gains(kp: Option<PerJoint>, kd: Option<PerJoint>) -> ReadOptions {
    ReadOptions { kp, kd, ..ReadOptions::default() }
}

/// The first entry with a pattern that matches the path, as named or as found, or the file's name.
pub fn matching<'a>(
    gains: &'a [FileGains],
    named: &str,
    path: &Path,
) -> Result<Option<&'a FileGains>, Error> {
    let file = path.file_name().map(Path::new);
    for entry in gains {
        for pattern in &entry.files {
            let glob = Glob::new(pattern).map_err(|error| {
                Error::settings(format!("validate_gains: `{pattern}` is no file pattern: {}", error.kind()))
            })?;
            let glob = glob.compile_matcher();
            if pattern == named || glob.is_match(named) || file.is_some_and(|file| glob.is_match(file)) {
                return Ok(Some(entry));
            }
        }
    }
    Ok(None)
}

/// The recording that the simulator replays: targets and gains of a log, and its state at the first sample.
///
/// # Errors
/// A log without targets or gains, with samples that are no numbers, or with one sample.
pub fn recording(trajectory: &Trajectory, path: &Path) -> Result<Recording, Error> {
    let shown = path.display();
    let Some(target) = trajectory.target.clone() else {
        return Err(Error::failed(format!(
            "{shown}: the log has no position targets (columns qdes_…); a replay needs the targets that the robot was sent."
        )));
    };
    if let Some(joint) = trajectory.velocity_joints.first() {
        return Err(Error::failed(format!(
            "{shown}: the targets of joint `{joint}` are velocities, which a replay cannot send yet; record with the wheels \
             held, or leave their columns out."
        )));
    }
    let Some(gains) = trajectory.gains.clone() else {
        return Err(Error::failed(format!("{shown}: the log has no PD gains.")));
    };
    // Each value goes into the replay, so one broken number is named with its column and sample.
    let width = trajectory.joints.len();
    for (name, signal) in [("q", &trajectory.position), ("dq", &trajectory.velocity), ("qdes", &target)] {
        if let Some(bad) = signal.iter().position(|value| !value.is_finite()) {
            return Err(Error::failed(format!(
                "{shown}: {name}_{} of sample {} is not a number; cut or repair the log.",
                trajectory.joints[bad % width],
                bad / width
            )));
        }
    }
    if trajectory.len() < 2 {
        return Err(Error::failed(format!(
            "{shown}: a single sample cannot be replayed; record some seconds of motion."
        )));
    }
    Ok(Recording {
        dt: trajectory.dt(),
        q0: trajectory.position[..width].to_vec(),
        dq0: trajectory.velocity[..width].to_vec(),
        target,
        kp: gains.kp,
        kd: gains.kd,
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_log::Gains;

    const LEG: &str = r#"<mujoco><worldbody><body name="base"><body name="leg"><joint name="knee"/><geom size="0.1"/>
        <body name="toe"><joint name="spring"/><geom size="0.1"/></body></body></body></worldbody>{motors}</mujoco>"#;

    #[test]
    fn joints_without_a_motor_get_no_torque_in_a_file_that_gives_others_one() {
        for (motors, kp) in [(r#"<actuator><motor joint="knee"/></actuator>"#, [20.0, 0.0]), ("", [20.0; 2])]
        {
            let text = LEG.replace("{motors}", motors);
            let model = gaitfit_model::read_mjcf_str(&text, &Default::default()).unwrap();
            let names = model.joints.iter().map(|joint| joint.name.clone()).collect();
            let mut log = Trajectory {
                gains: Some(Gains { kp: vec![20.0; 2], kd: vec![0.5; 2] }),
                ..Trajectory::of_joints(names, 100.0, Vec::new(), Vec::new(), Vec::new())
            };
            let said = release(&mut log, &model);
            assert_eq!(log.gains.unwrap().kp, kp);
            assert_eq!(said.is_some(), !motors.is_empty());
            assert!(
                said.is_none_or(|said| said.contains("spring (kp 20, kd 0.5)") && !said.contains("knee"))
            );
        }
    }

    #[test]
    fn gains_of_a_configuration_that_contradict_the_log_are_named() {
        let log = Trajectory {
            gains: Some(Gains { kp: vec![20.0], kd: vec![0.5] }),
            ..Trajectory::of_joints(vec!["knee".to_owned()], 100.0, Vec::new(), Vec::new(), Vec::new())
        };
        let mut config = AdaptConfig::default();
        config.gains.kp = Some(PerJoint::All(20.0));
        assert_eq!(contradiction(&log, &config), None);
        config.gains.kp = Some(PerJoint::All(500.0));
        let said = contradiction(&log, &config).unwrap();
        assert!(said.contains("kp 20 of joint knee") && said.contains("500"), "{said}");
    }
}
