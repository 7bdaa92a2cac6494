//! Settings of the fit that wrote the parameters: its `config.toml` lies beside them.

use super::ExportSettings;
use super::joint::has_motor;
use gaitfit_log::{Gains, ReadOptions, csv_files, read_csv};
use gaitfit_model::{Model, shown, shown_number, shown_path};
use gaitfit_policy::{Held, Policy};
use gaitfit_settings::settings::{self, AdaptConfig, Base};
use gaitfit_settings::{Error, paths};
use gaitfit_world::{log_joints, robot_file};
use std::path::{Path, PathBuf};

/// The settings of a fit, and where they were read.
pub(super) struct Fit {
    config: AdaptConfig,
    path: PathBuf,
}

impl Fit {
    /// The fit that wrote the parameters at `theta`; absent if no `config.toml` lies beside them.
    ///
    /// # Errors
    /// A file that cannot be read; a robot of the policy's training that is not there any more.
    pub fn beside(theta: &Path) -> Result<Option<Self>, Error> {
        let path = theta.with_file_name("config.toml");
        if !path.is_file() {
            return Ok(None);
        }
        let mut config: AdaptConfig = settings::load(Some(&path), &[])?;
        robot_file::of_policy(&mut config, &path).map_err(advised)?;
        Ok(Some(Self { config, path }))
    }

    /// The robot file, and whether it is read leniently; absent if the fit is of the built-in Go2.
    ///
    /// # Errors
    /// A file that is not there any more.
    pub fn robot(&self, settings: &ExportSettings) -> Result<Option<(PathBuf, bool)>, Error> {
        if self.config.robot.is_empty() {
            return Ok(None);
        }
        let path = paths::find(&self.config.robot, "robot", &self.path).map_err(advised)?;
        Ok(Some((path, settings.lenient || self.config.lenient)))
    }

    /// The gains of the robot's joints, as the first log, the configuration or the policy states them; in fits of walks
    /// the policy comes first. Absent where none of them can be read any more.
    pub fn gains(&self, model: &Model) -> Option<Stated> {
        let policy = || self.of_policy(model);
        // The robots that a fit of walks simulates have the policy's gains, whatever its logs state.
        let walked = (self.config.base == Base::Free).then(policy).flatten();
        // A source that cannot be read is no error here: files of a fit move, and the next source is as good.
        let (mut stated, place) =
            walked.or_else(|| self.of_log(model)).or_else(|| self.of_config(model)).or_else(policy)?;
        stated.notes.insert(0, format!("the PD gains come from {place}; --kp and --kd give others"));
        Some(stated)
    }

    /// Returns the gains that the first log states.
    fn of_log(&self, model: &Model) -> Option<(Stated, String)> {
        let first = paths::find(self.config.logs.first()?, "log", &self.path).ok()?;
        let file = if first.is_dir() { csv_files(&first).ok()?.into_iter().next()? } else { first };
        let log = read_csv(&file, &ReadOptions::default()).ok()?;
        let names = &self.config.joint_names;
        let logged: Vec<Option<usize>> =
            log.joints.iter().map(|name| model.find_joint(names.get(name).unwrap_or(name))).collect();
        let wanted: Vec<usize> =
            (0..model.joints.len()).filter(|joint| logged.contains(&Some(*joint))).collect();
        let (log, _) = log_joints::of_robot(&log, &file, names, model, &wanted).ok()?;
        // A log may lack joints of the robot. Its gains are those of its own joints.
        let gains = spread(&log.gains?, &wanted, model);
        Some((of_motors(gains, model), format!("the log {}", shown_path(&file))))
    }

    /// Returns the gains of `[gains]`.
    fn of_config(&self, model: &Model) -> Option<(Stated, String)> {
        let names: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
        let gains = &self.config.gains;
        let kp = gains.kp.as_ref()?.resolve("kp", &names).ok()?;
        let kd = gains.kd.as_ref()?.resolve("kd", &names).ok()?;
        Some((of_motors(Gains { kp, kd }, model), format!("[gains] of {}", shown_path(&self.path))))
    }

    /// Returns the gains of the policy that walked.
    fn of_policy(&self, model: &Model) -> Option<(Stated, String)> {
        let named = paths::find(self.config.policy.as_ref()?, "policy", &self.path).ok()?;
        let file = gaitfit_run::policy_file::find(&named).ok()?.path;
        let policy = gaitfit_policy_files::read(&file).ok()?;
        Some((of_policy(&policy, &file, model).ok()?, format!("the policy {}", shown_path(&file))))
    }
}

fn advised(error: Error) -> Error {
    error.advised("Or give the robot's file with --robot.")
}

/// Gains of the joints `driven` of the robot; 0 for the others, which nothing drives.
fn spread(gains: &Gains, driven: &[usize], model: &Model) -> Gains {
    let joints = model.joints.len();
    let mut spread = Gains { kp: vec![0.0; joints], kd: vec![0.0; joints] };
    for (at, &joint) in driven.iter().enumerate() {
        spread.kp[joint] = gains.kp.get(at).copied().unwrap_or_default();
        spread.kd[joint] = gains.kd.get(at).copied().unwrap_or_default();
    }
    spread
}

/// Gains of all joints of a robot, and notes on them.
pub(super) struct Stated {
    pub gains: Gains,
    pub notes: Vec<String>,
}

/// `gains` without those of joints that have no motor in the robot's file.
pub(super) fn of_motors(mut gains: Gains, model: &Model) -> Stated {
    let mut names = Vec::new();
    for (j, joint) in model.joints.iter().enumerate().filter(|(j, _)| !has_motor(model, *j)) {
        if gains.kp[j] != 0.0 || gains.kd[j] != 0.0 {
            names.push(format!("`{}`", shown(&joint.name)));
        }
        (gains.kp[j], gains.kd[j]) = (0.0, 0.0);
    }
    let notes = match names.is_empty() {
        true => Vec::new(),
        false => vec![format!(
            "joints without a motor in the robot's file get no controller: {}",
            names.join(", ")
        )],
    };
    Stated { gains, notes }
}

/// The gains of the policy read from `path`, for the joints that it moves or holds.
///
/// # Errors
/// A joint that the robot lacks.
pub(super) fn of_policy(policy: &Policy, path: &Path, model: &Model) -> Result<Stated, Error> {
    let interface = &policy.interface;
    if let Some(joint) = interface.velocity_joints.first() {
        return Err(Error::settings(format!(
            "{}: the policy gives `{joint}` velocities, and the files for other simulators have position controllers only; \
             leave --policy out, and write the controllers yourself",
            path.display()
        )));
    }
    let place = |joint: &String| {
        model
            .find_joint(joint)
            .ok_or_else(|| Error::settings(format!("{}: the robot has no joint `{joint}`", path.display())))
    };
    let held = &interface.held;
    let named = interface.joints.iter().chain(held.iter().map(|one| &one.joint));
    let joints: Vec<usize> = named.map(place).collect::<Result<_, _>>()?;
    let kp = interface.kp.iter().copied().chain(held.iter().map(|one| one.kp)).collect();
    let kd = interface.kd.iter().copied().chain(held.iter().map(|one| one.kd)).collect();
    let targets = |one: &Held| format!("`{}` {}", shown(&one.joint), shown_number(one.position));
    let notes = match held.is_empty() {
        true => Vec::new(),
        false => vec![format!(
            "the policy holds joints; send their controllers these targets: {}",
            held.iter().map(targets).collect::<Vec<_>>().join(", ")
        )],
    };
    Ok(Stated { gains: spread(&Gains { kp, kd }, &joints, model), notes })
}
