//! Reads what a view needs, and simulates it.

use super::{AdaptConfig, Base, Error, Model, Path, ReadOptions, Shown, Simulated, Trajectory, ViewSettings};
use crate::adapt::{Method, Robot, ValidationLogs, read_logs, simulated};
use crate::log::Log;
use crate::robot::Hold;
use crate::walk::recorder::Recorder;
use crate::{log_joints, robot_file};
use gaitfit_adapt::fit::simulate_one;
use gaitfit_adapt::{Resets, Theta};
use gaitfit_log::CheckSpec;
use gaitfit_sim::Candidate;
use std::sync::Arc;

/// The robots of a view, before they are simulated.
pub(super) enum Robots {
    /// A log that is simulated.
    Both(Box<Both>),
    /// A log that cannot be simulated, and why.
    LogAlone(Box<Shown>),
}

/// A log, and how it is simulated.
pub(super) struct Both {
    method: Method,
    log: Log,
    base: Candidate,
    fitted: Option<Candidate>,
    warnings: Vec<String>,
}

impl Robots {
    /// Reads robot, log, policy and parameters.
    pub fn open(settings: &ViewSettings) -> Result<Self, Error> {
        let (mut config, path) = super::config(settings)?;
        robot_file::of_policy(&mut config, &path)?;
        let first = super::read_csv(&settings.log, &ReadOptions::default())?;
        // Only a Go2's log may go without a robot file.
        if config.robot.is_empty() {
            let go2 = super::robot::go2()?;
            if let Some(joint) = first.joints.iter().find(|joint| go2.find_joint(joint).is_none()) {
                return Err(Error::settings(format!(
                    "missing: --robot FILE, the robot's MJCF or URDF file; the log's joint `{joint}` is none of the \
                     built-in Go2"
                )));
            }
        }
        let walked = first.command.as_ref().is_some_and(|all| all.iter().any(|part| part.abs() > 0.0));
        // Reasons that are known before anything is simulated; without one a failed simulation is an error.
        let alone = match (&config.policy, config.base) {
            (None, _) if walked => {
                Some("the robot walked; give --policy, the policy that walked, to simulate it")
            }
            (None, Base::Fixed) if first.target.is_none() => Some(
                "the log has no position targets (columns qdes_…), which a simulation of a clamped robot needs",
            ),
            _ => None,
        };
        if let Some(why) = alone {
            let base = if walked { Base::Free } else { Base::Fixed };
            return log_alone(&mut config, base, &path, settings, first, why);
        }
        both(&config, &path, settings)
    }

    /// Simulates the log.
    pub fn simulate(self) -> Result<Shown, Error> {
        match self {
            Self::LogAlone(shown) => Ok(*shown),
            Self::Both(both) => both.simulate(),
        }
    }
}

fn log_alone(
    config: &mut AdaptConfig,
    base: Base,
    path: &Path,
    settings: &ViewSettings,
    first: Trajectory,
    why: &str,
) -> Result<Robots, Error> {
    config.base = base;
    let hold = if base == Base::Free { Hold::File } else { Hold::Clamped };
    let model = match config.robot.as_str() {
        "" => super::robot::go2()?,
        named => super::robot::read(&crate::paths::find(named, "robot", path)?, config.lenient, hold)?,
    };
    // Only joints that the log has: alone it may show a part of the robot.
    let there: Vec<usize> = (0..model.joints.len())
        .filter(|&joint| first.joints.iter().any(|name| model.find_joint(name) == Some(joint)))
        .collect();
    let (log, _) = log_joints::of_robot(&first, &settings.log, &config.joint_names, &model, &there)?;
    let findings = gaitfit_log::check(&log, &CheckSpec::of_robot(&model, &log.joints));
    let mut warnings = vec![format!("the log is shown alone: {why}")];
    warnings.extend(
        findings.iter().filter(|one| one.severity == gaitfit_log::Severity::Error).map(ToString::to_string),
    );
    // Frames are drawn at even times, so lost rows are filled.
    let log = log.regular().map_err(|error| Error::failed(format!("{}: {error}", settings.log.display())))?;
    Ok(Robots::LogAlone(Box::new(Shown {
        name: settings.log.display().to_string(),
        rest: model.joints.iter().map(|joint| joint.reference).collect(),
        joints: there,
        log: log.trajectory,
        nominal: None,
        fitted: None,
        clamped: base == Base::Fixed,
        warnings,
        model,
    })))
}

fn both(config: &AdaptConfig, path: &Path, settings: &ViewSettings) -> Result<Robots, Error> {
    let Robot { model, policy, base, .. } = Robot::read(config, path, None)?;
    let nothing = Theta::default();
    let mut warnings = Vec::new();
    let file =
        settings.theta.as_ref().map(|path| super::theta::read(path).map(|file| (file, path))).transpose()?;
    let fitted =
        file.as_ref().map(|(file, path)| super::theta::on(base.clone(), file, path, &model)).transpose()?;
    let method = |reach: &Candidate| {
        simulated(config, policy.clone(), model.clone(), &nothing, reach, settings.threads)
    };
    // Both robots share a simulator, which keeps as many past targets as the longer delay needs.
    let delay = |robot: &Candidate| robot.robot.delay.iter().copied().fold(0.0, f64::max);
    let longest = fitted.as_ref().filter(|fitted| delay(fitted) > delay(&base)).unwrap_or(&base);
    let method = method(longest)?;
    let ValidationLogs { sets, doubts, .. } = read_logs(&config.logs, config, Path::new("view"), &method)?;
    // Here the log is not used for validation, so messages must not say so.
    warnings.extend(doubts.into_iter().map(|doubt| doubt.trim_start_matches("validation: ").to_owned()));
    let mut logs: Vec<Log> = sets.into_iter().flatten().collect();
    // A log that was cut because of falls is several: the longest one is shown.
    logs.sort_by(|a, b| b.trajectory.duration().total_cmp(&a.trajectory.duration()));
    let pieces = logs.len();
    let Some(log) = logs.into_iter().next() else {
        return Err(Error::failed(format!(
            "{}: nothing of the log can be simulated",
            settings.log.display()
        )));
    };
    if pieces > 1 {
        warnings.push(format!("the log was cut into {pieces} pieces; the longest is shown: {}", log.name));
    }
    if let Some((file, path)) = &file {
        warnings.extend(super::theta::doubts(file, path, method.model(), method.physics_step()));
    }
    Ok(Robots::Both(Box::new(Both { method, log, base, fitted, warnings })))
}

impl Both {
    fn simulate(self) -> Result<Shown, Error> {
        let nominal = self.robot(&self.base)?;
        let fitted = self.fitted.as_ref().map(|robot| self.robot(robot)).transpose()?;
        let model: Model = self.method.model().clone();
        let (joints, rest) = match self.method.walking() {
            Some(walking) => {
                let walker = &walking.task.walker;
                (walker.joints.clone(), walker.default_pose.iter().map(|&x| f64::from(x)).collect())
            }
            // A replay's log has all joints, so none is at rest.
            None => ((0..model.joints.len()).collect(), vec![0.0; model.joints.len()]),
        };
        Ok(Shown {
            name: self.log.name,
            log: self.log.trajectory,
            joints,
            rest,
            nominal: Some(nominal),
            fitted,
            clamped: self.method.walking().is_none(),
            warnings: self.warnings,
            model,
        })
    }

    /// The log with the robot `candidate`.
    fn robot(&self, candidate: &Candidate) -> Result<Simulated, Error> {
        let wide = |values: &[f32]| -> Vec<f64> { values.iter().map(|&x| f64::from(x)).collect() };
        if let Method::Walk(walking) = &self.method {
            let recorder = Recorder::new(Arc::clone(walking), candidate.clone(), &[&self.log.trajectory]);
            let track = recorder.tracks().map_err(Error::failed)?.into_iter().next().unwrap_or_default();
            let place = |row: &[f32]| std::array::from_fn(|k| f64::from(row[k]));
            let attitude = |row: &[f32]| std::array::from_fn(|k| f64::from(row[k]));
            let bases = track.base_position.chunks_exact(3).zip(track.base_quaternion.chunks_exact(4));
            return Ok(Simulated {
                position: wide(&track.position),
                base: bases.map(|(at, turned)| (place(at), attitude(turned))).collect(),
                fell_at: track.fell_at,
            });
        }
        let simulator = self.method.simulator(candidate.clone(), std::slice::from_ref(&self.log))?;
        let predictions =
            simulate_one(simulator.as_ref(), &Theta::default(), &[], Resets::Never).map_err(Error::failed)?;
        let predicted = predictions.into_iter().next().unwrap_or_default();
        Ok(Simulated { position: wide(&predicted.position), base: Vec::new(), fell_at: predicted.fell_at })
    }
}
