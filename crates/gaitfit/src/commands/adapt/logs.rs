//! From log files to recordings in the robot's joint order, with gains.

use crate::config::{AdaptConfig, FileGains};
use crate::exit::Failure;
use crate::paths;
use gaitfit_log::{PerJoint, ReadOptions, ReadReport, Trajectory, read_csv_report};
use gaitfit_sim::Recording;
use globset::Glob;
use std::path::{Path, PathBuf};

/// A log ready to be replayed.
#[derive(Debug)]
pub struct Log {
    /// As the configuration names it.
    pub name: String,
    /// Where it was found.
    pub path: PathBuf,
    /// Files beside it that were read too.
    pub sidecars: Vec<PathBuf>,
    /// Its samples, joints in the robot's order under the robot's names.
    pub trajectory: Trajectory,
    /// What the simulator replays.
    pub recording: Recording,
}

impl Log {
    /// Position targets, rad; `samples × joints`.
    pub fn target(&self) -> &[f64] {
        &self.recording.target
    }
}

/// Reads the log `named` for a robot with `joints`. `override_gains` are gains that win over the log's own.
pub fn read(
    named: &str,
    config_path: &Path,
    config: &AdaptConfig,
    joints: &[String],
    override_gains: &[FileGains],
) -> Result<Log, Failure> {
    let path = paths::find(named, "log", config_path)?;
    let gains = matching(override_gains, named, &path)?;
    let own = gains.map_or_else(ReadOptions::default, |gains| with_gains(gains.kp.clone(), gains.kd.clone()));
    let (mut trajectory, mut report) = open(&path, &own)?;
    if trajectory.gains.is_none() {
        if config.gains.kp.is_none() || config.gains.kd.is_none() {
            return Err(Failure::usage(format!(
                "{}: the log does not state its PD gains, and neither does the configuration. Give `kp` and `kd` \
                 in [gains] (for example --set gains.kp=25 --set gains.kd=0.5), in the log's header, or in a file \
                 {} beside it.",
                path.display(),
                path.with_extension("toml").display()
            )));
        }
        (trajectory, report) = open(&path, &with_gains(config.gains.kp.clone(), config.gains.kd.clone()))?;
    }
    let trajectory = by_robot_joints(&trajectory, &path, config, joints)?;
    let recording = recording(&trajectory, &path)?;
    Ok(Log { name: named.to_owned(), path, sidecars: report.sidecars, trajectory, recording })
}

fn open(path: &Path, options: &ReadOptions) -> Result<(Trajectory, ReadReport), Failure> {
    read_csv_report(path, options).map_err(Failure::failed)
}

fn with_gains(kp: Option<PerJoint>, kd: Option<PerJoint>) -> ReadOptions {
    ReadOptions { kp, kd, ..ReadOptions::default() }
}

/// The first entry with a pattern that matches the path, as named or as found, or the file's name.
fn matching<'a>(gains: &'a [FileGains], named: &str, path: &Path) -> Result<Option<&'a FileGains>, Failure> {
    let file = path.file_name().map(Path::new);
    for entry in gains {
        for pattern in &entry.files {
            let glob = Glob::new(pattern).map_err(|error| {
                Failure::usage(format!("validate_gains: `{pattern}` is no file pattern: {}", error.kind()))
            })?;
            let glob = glob.compile_matcher();
            if pattern == named || glob.is_match(named) || file.is_some_and(|file| glob.is_match(file)) {
                return Ok(Some(entry));
            }
        }
    }
    Ok(None)
}

/// The same samples with the robot's joint names, in the robot's order.
fn by_robot_joints(
    trajectory: &Trajectory,
    path: &Path,
    config: &AdaptConfig,
    joints: &[String],
) -> Result<Trajectory, Failure> {
    let plain = |name: &str| name.strip_suffix("_joint").unwrap_or(name).to_owned();
    let robot_name = |of_log: &String| -> Option<&String> {
        let asked = config.joint_names.get(of_log).unwrap_or(of_log);
        let exact = joints.iter().find(|joint| *joint == asked);
        exact.or_else(|| joints.iter().find(|joint| plain(joint) == plain(asked)))
    };
    let shown = path.display();
    let advice = "map names in [joint_names], or use the robot file the log was made with";
    let mut found: Vec<(&String, &String)> = Vec::new();
    for of_log in &trajectory.joints {
        let Some(joint) = robot_name(of_log) else {
            return Err(Failure::failed(format!(
                "{shown}: the log has a joint `{of_log}` that the robot lacks (it has {}); {advice}.",
                joints.join(", ")
            )));
        };
        if let Some((other, _)) = found.iter().find(|(_, known)| *known == joint) {
            return Err(Failure::failed(format!(
                "{shown}: the log's joints `{other}` and `{of_log}` are both the robot's `{joint}`; {advice}."
            )));
        }
        found.push((of_log, joint));
    }
    let mut names = Vec::with_capacity(joints.len());
    for joint in joints {
        let Some((of_log, _)) = found.iter().find(|(_, known)| *known == joint) else {
            return Err(Failure::failed(format!(
                "{shown}: the log lacks the robot's joint `{joint}` (it has {}); {advice}.",
                trajectory.joints.join(", ")
            )));
        };
        names.push(*of_log);
    }
    let mut ordered = trajectory
        .select_joints(&names)
        .map_err(|error| Failure::failed(format!("{shown}: {error}")))?;
    ordered.joints = joints.to_vec();
    Ok(ordered)
}

fn recording(trajectory: &Trajectory, path: &Path) -> Result<Recording, Failure> {
    let shown = path.display();
    let Some(target) = trajectory.target.clone() else {
        return Err(Failure::failed(format!(
            "{shown}: the log has no position targets (columns qdes_…); a replay needs what the robot was told."
        )));
    };
    let Some(gains) = trajectory.gains.clone() else {
        return Err(Failure::failed(format!("{shown}: the log has no PD gains.")));
    };
    let width = trajectory.joints.len();
    for (name, signal) in [("q", &trajectory.position), ("dq", &trajectory.velocity), ("qdes", &target)] {
        if let Some(bad) = signal.iter().position(|value| !value.is_finite()) {
            return Err(Failure::failed(format!(
                "{shown}: {name}_{} of sample {} is not a number; cut or repair the log.",
                trajectory.joints[bad % width],
                bad / width
            )));
        }
    }
    if trajectory.len() < 2 {
        return Err(Failure::failed(format!("{shown}: a single sample cannot be replayed.")));
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
