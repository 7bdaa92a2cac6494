//! Fitted parameters for other simulators: files that hold a theta.toml's numbers as MuJoCo, Isaac Lab and mjlab name
//! them. What a file cannot say, the Python code beside it does.

mod checks;
mod code;
mod document;
mod fit;
mod included;
mod joint;
mod mjcf;
mod networks;
mod remarks;
mod urdf;
mod xml;

use document::document;
use fit::{Fit, Stated};
use gaitfit_adapt::{JointParameter, ThetaFile};
use gaitfit_log::{Gains, PerJoint};
use gaitfit_model::{Model, builtin};
use gaitfit_run::files;
use gaitfit_settings::Error;
use gaitfit_settings::robot::{self, Hold};
use gaitfit_sim::Candidate;
use gaitfit_world::theta;
use serde::Serialize;
use std::path::PathBuf;

/// Largest robot file, bytes.
const MAX_BYTES: u64 = 64 << 20;

/// Settings of an export: parameters, robot and controller.
#[derive(Clone, Debug)]
pub struct ExportSettings {
    /// Fitted parameters, a theta.toml.
    pub theta: PathBuf,
    /// Robot file; without one that of `config.toml` beside the parameters, or the built-in Go2.
    pub robot: Option<PathBuf>,
    /// Drop what the engine cannot simulate in the robot file, instead of refusing it.
    pub lenient: bool,
    /// Position gains of the controller, N·m/rad, for the exported robot's PD controllers. Without them and without a policy
    /// they are those of the fit beside the parameters, if it states them.
    pub kp: Option<PerJoint>,
    /// Velocity gains, N·m·s/rad.
    pub kd: Option<PerJoint>,
    /// A policy whose gains these are, instead.
    pub policy: Option<PathBuf>,
    /// Physics step of the simulator that takes the files, s; that of the fit, or else of the robot file, when absent. Delays
    /// are written in such steps where a simulator knows no others.
    pub step: Option<f64>,
}

/// A parameter and where it is said.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Row {
    /// Name.
    pub name: String,
    /// Value.
    pub value: f64,
    /// Unit.
    pub unit: String,
    /// The values that fit as well.
    pub interval: Option<[f64; 2]>,
    /// Whether the logs determine it.
    pub identified: Option<bool>,
    /// Whether the robot file says it; else the code beside it does.
    pub in_robot_file: bool,
}

/// Files for other simulators.
#[derive(Clone, Debug)]
pub struct Exported {
    /// Names and contents.
    pub files: Vec<(String, Vec<u8>)>,
    /// The parameters.
    pub rows: Vec<Row>,
    /// Warnings to know before trusting the files.
    pub notes: Vec<String>,
}

/// Reads the parameters and the robot, and makes the files.
///
/// # Errors
/// Files that cannot be read, parameters that do not fit the robot, gains that do not fit its joints, robot files that
/// cannot be changed as text.
pub fn export_theta(settings: &ExportSettings) -> Result<Exported, Error> {
    let file = theta::read(&settings.theta)?;
    let asked = settings.robot.clone().map(|path| (path, settings.lenient));
    // If the caller names the robot, the fit's files are not needed and may be gone.
    let stated = settings.kp.is_some() || settings.kd.is_some() || settings.policy.is_some();
    let fit = match asked.is_some() {
        true => Fit::beside(&settings.theta).unwrap_or_default(),
        false => Fit::beside(&settings.theta)?,
    };
    let fitted = match (asked, &fit) {
        (Some(asked), _) => Some(asked),
        (None, Some(fit)) => fit.robot(settings)?,
        (None, None) => None,
    };
    // The model as the file has it, not as a fit holds the base: only its numbers are changed.
    let (model, text, is_urdf) = match &fitted {
        None => (robot::go2()?, builtin::GO2.to_owned(), false),
        Some((path, lenient)) => {
            let model =
                robot::as_written(path, *lenient).or_else(|_| robot::read(path, *lenient, Hold::File))?;
            let text = files::read_text(path, MAX_BYTES).map_err(|source| Error::unreadable(path, source))?;
            let is_urdf = path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("urdf"));
            (model, text, is_urdf)
        }
    };
    // Before anything is made of the values.
    checks::parameters(&file, &settings.theta, &model)?;
    let candidate = theta::candidate(&file, &settings.theta, &model)?;
    // The caller's gains come first. Without them the gains of the fit are taken, and a note says so.
    let stated = match fit.filter(|_| !stated).and_then(|fit| fit.gains(&model)) {
        Some(found) => Some(found),
        None => gains(settings, &model)?,
    };
    let (gains, notes) = stated.map(|Stated { gains, notes }| (gains, notes)).unzip();
    // The step of the fit comes before the file's: the fitted numbers belong to it.
    let step = checks::step(settings.step)?.or(file.physics_step).unwrap_or(model.options.timestep);
    if let (Some((path, _)), false) = (&fitted, is_urdf) {
        included::check(&text, path, gains.is_some())?;
    }
    let mut exported = files_of(&file, &model, &text, is_urdf, &candidate, gains.as_ref(), step)?;
    exported.notes.extend(notes.into_iter().flatten());
    exported.notes.extend(theta::doubts(&file, &settings.theta, &model, None));
    Ok(exported)
}

/// The gains that the settings name, one a joint of the model.
fn gains(settings: &ExportSettings, model: &Model) -> Result<Option<Stated>, Error> {
    let names: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
    match (&settings.kp, &settings.kd, &settings.policy) {
        (None, None, None) => Ok(None),
        (Some(kp), Some(kd), None) => {
            let kp = kp.resolve("--kp", &names).map_err(Error::settings)?;
            let kd = kd.resolve("--kd", &names).map_err(Error::settings)?;
            checks::gains("--kp", &kp)?;
            checks::gains("--kd", &kd)?;
            Ok(Some(fit::of_motors(Gains { kp, kd }, model)))
        }
        (None, None, Some(path)) => {
            let policy = gaitfit_policy_files::read(path)?;
            Ok(Some(fit::of_policy(&policy, path, model)?))
        }
        _ => Err(Error::settings("give `--kp` and `--kd`, or a `--policy` whose gains are used, or neither")),
    }
}

/// The files for a robot as its file's text has it.
fn files_of(
    file: &ThetaFile,
    model: &Model,
    text: &str,
    is_urdf: bool,
    candidate: &Candidate,
    gains: Option<&Gains>,
    step: f64,
) -> Result<Exported, Error> {
    let mut joints = joint::numbers(model, candidate, gains);
    if !is_urdf {
        mjcf::mark_unnamed(text, &mut joints)?;
    }
    checks::motors(&joints)?;
    let driven: Vec<_> = joints.iter().filter(|joint| joint.motor && joint.named).cloned().collect();
    let mut notes = Vec::from_iter(code::lag_note(&driven, step));
    let (robot_name, robot_text, said) = match is_urdf {
        true => ("robot.urdf", urdf::patched(text, model, &joints, candidate)?, urdf::said(text, model)?),
        false => {
            let base = mjcf::says_base(text, model)?;
            // Only the robot's own file is changed; meshes and the like are found beside it.
            if text.contains("file=\"") || text.contains("file='") {
                notes.push(
                    "robot.xml names other files as the original does: put it beside the original".to_owned(),
                );
            }
            notes.extend(joint::constant_torque_note(&joints));
            (
                "robot.xml",
                mjcf::patched(text, model, &joints, candidate, gains.is_some())?,
                mjcf::said(gains.is_some(), base, mjcf::says_links(text, model, candidate)?),
            )
        }
    };
    // Each parameter is listed with whether the robot's file can hold it; the others are in the code.
    let constant =
        |name: &String| joints.iter().any(|joint| joint.has_constant_torque() && joint.name == *name);
    let rows = file.parameter.iter().map(|parameter| Row {
        name: parameter.name.clone(),
        value: parameter.value,
        unit: parameter.unit.clone(),
        interval: parameter.interval,
        identified: parameter.identified,
        // A torque of a joint without stiffness has no place in the file (`joint::constant_torque_note`).
        in_robot_file: said.contains(&parameter.kind.as_str())
            && !(parameter.kind == "spring_torque" && parameter.joints.iter().any(constant)),
    });
    let rows: Vec<Row> = rows.collect();
    if gains.is_none() {
        notes.push("without gains the robot file has no PD controllers, and Isaac Lab's are left to its asset; give --kp \
                    and --kd, or --policy".to_owned());
    }
    if !file.network.is_empty() {
        notes.push(format!(
            "{} networks: drive.py evaluates them with the controller, networks.py alone, both in NumPy; the ONNX files \
             hold the same",
            file.network.len()
        ));
    }
    let texts = [
        (robot_name.to_owned(), robot_text),
        ("theta.json".to_owned(), document(file, &joints, model, candidate)?),
        ("load_theta.py".to_owned(), code::LOADER.to_owned()),
        ("drive.py".to_owned(), code::DRIVE.to_owned()),
        (
            "isaac_lab.py".to_owned(),
            code::isaac_lab(&driven, &joints, gains.is_some(), step, model, candidate),
        ),
        (
            "mjlab_robot.py".to_owned(),
            code::mjlab(&driven, &joints, gains.is_some(), step, is_urdf.then_some(model.root)),
        ),
    ];
    let mut files: Vec<_> = texts.into_iter().map(|(name, text)| (name, text.into_bytes())).collect();
    files.extend(networks::files(file)?);
    Ok(Exported { files, rows, notes })
}

/// Names of the kinds of parameters that all simulators know of joints.
const COMMON: [&str; 2] = ["frictionloss", "damping"];

/// Names of the kinds of parameters that change links.
fn link_kinds() -> impl Iterator<Item = &'static str> {
    JointParameter::LINKS.iter().map(|kind| kind.name())
}

#[cfg(test)]
mod tests;
