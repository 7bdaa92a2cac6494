//! Checks of a theta.toml and a command line: other simulators would take wrong numbers in silence.

use super::joint::JointNumbers;
use gaitfit_adapt::{RobotNumber, SavedParameter, ThetaFile};
use gaitfit_model::patterns::covered;
use gaitfit_model::{JointKind, Model, shown, shown_number};
use gaitfit_physics::JointParameter;
use gaitfit_settings::Error;
use std::path::Path;

/// Largest gain, N·m/rad or N·m·s/rad.
const MAX_GAIN: f64 = 1e6;

/// Refuses invalid intervals, bases without mass, and units that differ from the parameter's unit: other programs would
/// misread the values.
pub(super) fn parameters(file: &ThetaFile, path: &Path, model: &Model) -> Result<(), Error> {
    let refuse = |parameter: &SavedParameter, what: String| {
        Err(Error::failed(format!("{}: `{}` {what}", path.display(), shown(&parameter.name))))
    };
    // A file of θ may be written by hand, so its numbers are not trusted.
    for parameter in &file.parameter {
        if let Some([low, high]) = parameter.interval
            && !(low.is_finite() && high.is_finite() && low <= high)
        {
            let (low, high) = (shown_number(low), shown_number(high));
            let what =
                "has the interval [{low}, {high}]; give its lower end first, then its upper end, both finite";
            return refuse(parameter, what.replace("{low}", &low).replace("{high}", &high));
        }
        let base = model.bodies.first().map_or(0.0, |body| body.mass);
        if parameter.kind == "base_mass" && parameter.value < 0.0 && base + parameter.value <= 0.0 {
            let (value, least) = (shown_number(parameter.value), shown_number(0.0 - base));
            let what = "is {value} kg, and the base would have no mass; give more than {least} kg";
            return refuse(parameter, what.replace("{value}", &value).replace("{least}", &least));
        }
        let Some(unit) = unit(parameter, model) else { continue };
        if !parameter.unit.is_empty() && parameter.unit != unit {
            let written = shown(&parameter.unit);
            let what = format!("is in `{written}`, and {} is in `{unit}`", shown(&parameter.kind));
            return refuse(parameter, format!("{what}; convert value and interval, and write that unit"));
        }
    }
    Ok(())
}

/// Unit of a parameter, that of slides if it covers none but slides; `None` for kinds that are not known.
fn unit(parameter: &SavedParameter, model: &Model) -> Option<&'static str> {
    let kind = parameter.kind.as_str();
    let names: Vec<&str> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
    // Patterns that do not fit are refused where the values are applied.
    let places = covered(&parameter.joints, &model.name, &names).unwrap_or_default();
    let slides = !places.is_empty() && places.iter().all(|&joint| !model.joints[joint].kind.is_hinge());
    let joint_kind = if slides { JointKind::Slide } else { JointKind::Hinge };
    let joints = JointParameter::ALL.iter().find(|one| one.name() == kind);
    let joints = joints.map(|one| joint_kind.unit(one.unit()));
    joints.or_else(|| RobotNumber::ALL.iter().find(|one| one.name() == kind).map(|one| one.unit()))
}

/// Refuses motors whose torque falls with speed from none: no simulator has such.
pub(super) fn motors(joints: &[JointNumbers]) -> Result<(), Error> {
    let wrong =
        joints.iter().find(|joint| joint.no_load_speed.is_finite() && joint.stall_torque.is_infinite());
    let Some(JointNumbers { name, .. }) = wrong else { return Ok(()) };
    Err(Error::failed(format!(
        "joint `{}` has a no_load_speed and no stall_torque, and the robot's file has no torque limit to take instead: give \
         the parameters a stall_torque of this joint, or the file the limit",
        shown(name)
    )))
}

/// Refuses a physics step that no simulator takes.
pub(super) fn step(given: Option<f64>) -> Result<Option<f64>, Error> {
    match given.filter(|step| !(1e-5..=0.1).contains(step)) {
        Some(step) => Err(Error::settings(format!(
            "--step {}: give the simulator's physics step in seconds, from 0.00001 to 0.1",
            shown_number(step)
        ))),
        None => Ok(given),
    }
}

/// Refuses gains that no controller has.
pub(super) fn gains(option: &str, gains: &[f64]) -> Result<(), Error> {
    // NaN lies in no range, so it is refused too.
    let Some(wrong) = gains.iter().find(|gain| !(0.0..=MAX_GAIN).contains(*gain)) else { return Ok(()) };
    Err(Error::settings(format!("{option} {}: give a gain from 0 to {MAX_GAIN:e}", shown_number(*wrong))))
}
