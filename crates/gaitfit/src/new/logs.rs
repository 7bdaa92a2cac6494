//! The logs of a new configuration, at a glance.

use crate::Error;
use gaitfit_log::{CheckSpec, FindingKind, ReadOptions, Severity, check, csv_files, read_csv_report};
use gaitfit_model::{Model, shown};
use gaitfit_policy::Policy;
use std::path::{Path, PathBuf};

/// Contents of the logs.
#[derive(Debug)]
pub struct Logs {
    /// The files, one a log.
    pub files: Vec<PathBuf>,
    /// Whether all state their PD gains.
    pub gains: bool,
    /// Whether one of them has a command that is not zero.
    pub commands: bool,
    /// The simulated step that each states; `None` of a log that states none.
    steps: Vec<Option<f64>>,
    /// What reading them assumed, each in a sentence.
    pub assumed: Vec<String>,
    imu: bool,
    seconds: f64,
    rates: Vec<f64>,
    joints: Vec<String>,
}

impl Logs {
    /// Reads the logs and compares their joints with the robot's. Joints that the policy holds may be missing.
    ///
    /// # Errors
    /// A file or folder that cannot be read, or without logs; joints that are not the robot's.
    pub fn read(named: &[PathBuf], model: &Model, policy: Option<&Policy>) -> Result<Self, Error> {
        let mut files = Vec::new();
        for path in named {
            if path.is_dir() {
                let inside = csv_files(path)?;
                if inside.is_empty() {
                    return Err(Error::settings(format!(
                        "{}: the folder holds no logs (.csv) of a robot. chirp.csv and expected.csv of `gaitfit excite` are \
                         none: play.py writes log.csv",
                        path.display()
                    )));
                }
                files.extend(inside);
            } else {
                files.push(path.clone());
            }
        }
        let mut logs = Self {
            files,
            gains: true,
            commands: false,
            steps: Vec::new(),
            assumed: Vec::new(),
            imu: true,
            seconds: 0.0,
            rates: Vec::new(),
            joints: Vec::new(),
        };
        for file in logs.files.clone() {
            logs.add(&file, model, policy)?;
        }
        logs.rates.sort_by(f64::total_cmp);
        Ok(logs)
    }

    fn add(&mut self, file: &Path, model: &Model, policy: Option<&Policy>) -> Result<(), Error> {
        let (mut log, report) = read_csv_report(file, &ReadOptions::default())?;
        // A log need not state what the policy states: wheels have other targets. The fit refuses a log that contradicts it.
        if let Some(policy) = policy.filter(|_| log.velocity_joints.is_empty()) {
            let wheels: Vec<Option<usize>> =
                policy.interface.velocity_joints.iter().map(|joint| model.find_joint(joint)).collect();
            let is_wheel = |joint: &&String| wheels.contains(&model.find_joint(joint));
            log.velocity_joints = log.joints.iter().filter(is_wheel).cloned().collect();
        }
        // A robot may report a wheel's angle within one turn; the checks would take the jumps for faults.
        log.unwrap_wheels();
        // All of them at once, so that one mapping file mends the log.
        let strange: Vec<&str> =
            log.joints.iter().filter(|name| model.find_joint(name).is_none()).map(String::as_str).collect();
        if !strange.is_empty() {
            let other =
                log.robot.as_ref().filter(|name| **name != model.name).map_or(String::new(), |name| {
                    format!(
                        "the log is of robot `{}`, and the file is of `{}`: ",
                        shown(name),
                        shown(&model.name)
                    )
                });
            let robot: Vec<&str> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
            return Err(Error::settings(format!(
                "{}: {other}the robot has no joints {}; it has {}. Give the robot's names in [joint_names] of a --mapping \
                 file (docs/import.md), or the robot file of this log",
                file.display(),
                strange.join(", "),
                robot.join(", ")
            )));
        }
        let mut findings = report.findings();
        findings.extend(check(&log, &CheckSpec::of_robot(model, &log.joints)));
        // Findings that would make every number of a fit wrong by a factor, or leave a joint out.
        let assumptions = [
            FindingKind::TimeUnit,
            FindingKind::SuspectUnit,
            FindingKind::RateMismatch,
            FindingKind::MissingJoint,
        ];
        // Joints that the policy holds need not be in its logs.
        let held = |joint: &String| policy.is_some_and(|policy| !policy.interface.joints.contains(joint));
        findings.retain(|one| one.kind != FindingKind::MissingJoint || !one.joints.iter().all(held));
        // Only what makes the numbers doubtful; the fit reports the rest.
        for finding in
            findings.iter().filter(|one| assumptions.contains(&one.kind) || one.severity == Severity::Error)
        {
            self.assumed.push(format!("{}: {finding}", file.display()));
        }
        let base = log.base.as_ref();
        // What one log lacks, the fit cannot count on.
        self.imu &= base.is_some_and(|base| base.quaternion.is_some() && base.angular_velocity.is_some());
        self.gains &= log.gains.is_some();
        self.commands |= log.command.as_ref().is_some_and(|all| all.iter().any(|part| part.abs() > 0.0));
        self.seconds += log.duration();
        self.rates.push(log.rate_hz);
        self.steps.push(log.simulated_step);
        // The first log's order is the one that is reported.
        if self.joints.is_empty() {
            self.joints = log.joints;
        }
        Ok(())
    }

    /// The physics step of the simulator that made them, s, if all state the same one.
    pub fn simulated_step(&self) -> Option<f64> {
        let first = self.steps.first().copied().flatten()?;
        self.steps.iter().all(|step| *step == Some(first)).then_some(first)
    }

    /// Number, length, rate and sensors.
    pub fn text(&self) -> String {
        let rate = match (self.rates.first(), self.rates.last()) {
            // Clocks of robots differ by less than 1 %, so such rates are one nominal rate.
            (Some(low), Some(high)) if (high / low - 1.0).abs() < 0.01 => format!("{low:.0} Hz"),
            (Some(low), Some(high)) => format!("{low:.0} to {high:.0} Hz"),
            _ => String::new(),
        };
        let imu = if self.imu { "with an IMU" } else { "without an IMU" };
        let many = if self.files.len() == 1 { "log" } else { "logs" };
        format!("{} {many}, {:.1} s in all at {rate}, {imu}", self.files.len(), self.seconds)
    }

    /// Describes how the joints of the logs match those of the robot.
    pub fn joints_text(&self, model: &Model) -> String {
        let order: Vec<Option<usize>> = self.joints.iter().map(|name| model.find_joint(name)).collect();
        let same = order.iter().enumerate().all(|(place, joint)| *joint == Some(place));
        match same {
            true => format!("{} matched by name, in the robot's order", self.joints.len()),
            false => format!("matched by name; the logs have the order {}", self.joints.join(", ")),
        }
    }
}
