//! Checks that refuse settings of a task.

use gaitfit_model::{Model, shown, shown_number};
use gaitfit_policy::{Interface, Source};

use super::error::refuse;
use super::{CommandSettings, JointNumber, TaskError, TaskSettings};

/// Max number of feet of a robot.
const MAX_FEET: usize = 8;

/// Refuses scales and clocks that do not fit, by setting.
pub(super) fn check_terms(interface: &Interface) -> Result<(), TaskError> {
    for term in interface.observation.iter().chain(&interface.critic_observation) {
        let width = term.quantity.width(interface.joints.len());
        // No scale means 1, and one number scales all elements.
        if !matches!(term.scale.len(), 0 | 1) && term.scale.len() != width {
            let what = format!(
                "scales {} by {} numbers; give one or {width}",
                term.quantity.name(),
                term.scale.len()
            );
            return refuse("policy.observation", what);
        }
        if term.quantity.is_of_clock() && interface.gait_frequency.is_none() {
            return refuse(
                "policy.gait_frequency",
                format!("is missing, and the policy observes {}", term.quantity.name()),
            );
        }
    }
    Ok(())
}

/// Tolerance of a joint's default angle outside its range, rad: ranges and poses of files are rounded.
const ROUNDED: f64 = 0.05;

/// Refuses a default pose that a joint cannot be in.
pub(super) fn check_pose(model: &Model, pose: &[f64]) -> Result<(), TaskError> {
    for (index, (joint, &angle)) in model.joints.iter().zip(pose).enumerate() {
        if let Some([low, high]) = joint.range
            && let rounded = joint.kind.like("rad", ROUNDED)
            && !(low - rounded..=high + rounded).contains(&angle)
        {
            let unit = joint.kind.unit("rad");
            // The user did not state this angle. It follows from the joint that this one is coupled to.
            if model.only_follows(index) {
                return Err(TaskError::Coupling {
                    joint: shown(&joint.name),
                    at: format!("{} {unit}", shown_number(angle)),
                    range: format!("{} to {} {unit}", shown_number(low), shown_number(high)),
                });
            }
            let what = format!(
                "puts `{}` at {} {unit}, and its range is {} to {} {unit}; a joint that no pattern covers is at 0",
                shown(&joint.name),
                shown_number(angle),
                shown_number(low),
                shown_number(high)
            );
            return refuse("policy.default_pose", what);
        }
    }
    Ok(())
}

/// Refuses a robot that does not fall down: postures, heights and feet are judged along z.
pub(super) fn check_gravity(model: &Model) -> Result<(), TaskError> {
    let [x, y, z] = model.options.gravity;
    // A millionth to the side is rounding.
    if z < 0.0 && x.abs().max(y.abs()) <= 1e-6 * z.abs() {
        return Ok(());
    }
    Err(TaskError::Gravity { robot: shown(&model.name), gravity: [x, y, z].map(shown_number).join(" ") })
}

/// Shortest control period, s: replays and gaits take some seconds of them.
const MIN_CONTROL_DT: f64 = 1e-3;

/// Longest delay that robots are given at random, s.
const LONGEST_DELAY: f64 = 0.5;

/// Refuses numbers of joints out of range, by setting and pattern.
fn check_joint_numbers(settings: &TaskSettings) -> Result<(), TaskError> {
    let policy = &settings.policy;
    let numbers = [
        ("policy.action_scale", Some(&policy.action_scale), 1e3),
        ("policy.action_clip", policy.action_clip.as_ref(), 1e6),
        ("policy.kp", Some(&policy.kp), 1e5),
        ("policy.kd", Some(&policy.kd), 1e4),
    ];
    for (setting, number, max) in numbers {
        for (pattern, value) in number.into_iter().flat_map(JointNumber::entries) {
            // Stiffness may be 0 joint by joint; with none at all the legs could not carry the robot.
            let zero = setting == "policy.kd" || setting == "policy.kp" && pattern.is_some();
            if value > 0.0 && value <= max || zero && value == 0.0 {
                continue;
            }
            let suffix = pattern.map(|pattern| format!(" for `{}`", shown(pattern))).unwrap_or_default();
            let must = if zero { format!("from 0 to {max}") } else { format!("above 0 and at most {max}") };
            return refuse(setting, format!("is {}{suffix}; it must be {must}", shown_number(value)));
        }
    }
    Ok(())
}

/// Refuses a growth of commands that contradicts itself.
fn check_curriculum(command: &CommandSettings) -> Result<(), TaskError> {
    let Some(curriculum) = &command.curriculum else { return Ok(()) };
    let share = |setting: &str, value: f64| {
        if value > 0.0 && value <= 1.0 {
            return Ok(());
        }
        let setting = format!("command.curriculum.{setting}");
        refuse(&setting, format!("is {}; it must be above 0 and at most 1", shown_number(value)))
    };
    // The ranges in between are mixtures of these two, so no others need a check.
    let (first, last) = (command.ranges(0.0), command.ranges(1.0));
    for (k, name) in ["x", "y", "yaw"].into_iter().enumerate() {
        let ([low, high], [min, max]) = (first[k], last[k]);
        // Negated, so that NaN is refused.
        if !(low >= min && low <= high && high <= max) {
            let what = format!(
                "is [{}, {}]; it must be [smallest, largest] inside task.command.{name}, [{}, {}]",
                shown_number(low),
                shown_number(high),
                shown_number(min),
                shown_number(max)
            );
            return refuse(&format!("command.curriculum.{name}"), what);
        }
    }
    // Exactly one of the two conditions may say when to grow.
    match (curriculum.tracking, curriculum.iterations) {
        (Some(tracking), None) => share("tracking", tracking)?,
        (None, Some(0)) => {
            return refuse("command.curriculum.iterations", "is 0; it must be at least 1".to_owned());
        }
        (None, Some(_)) => {}
        _ => {
            let what = "must have one of `tracking` and `iterations`, which say when the ranges grow";
            return refuse("command.curriculum", what.to_owned());
        }
    }
    share("step", curriculum.step)
}

/// Refuses numbers out of range, by setting.
pub(super) fn check(settings: &TaskSettings) -> Result<(), TaskError> {
    check_positive(settings)?;
    check_joint_numbers(settings)?;
    check_steps(settings)?;
    check_from_zero(settings)?;
    check_places(settings)?;
    check_intervals(settings)?;
    check_curriculum(&settings.command)?;
    let longest = settings.randomisation.delay[1];
    if longest > LONGEST_DELAY {
        let what = format!("reaches {} s; it may be at most {LONGEST_DELAY} s", shown_number(longest));
        return refuse("randomisation.delay", what);
    }
    if !(0.0..=1.0).contains(&settings.command.standing) {
        return refuse(
            "command.standing",
            format!("is {}; it must be from 0 to 1", shown_number(settings.command.standing)),
        );
    }
    if let Some(terrain) = &settings.terrain {
        terrain.check()?;
    }
    let norm = settings.posture.iter().map(|x| x * x).sum::<f64>().sqrt();
    // A direction that is written with three decimals has this length to 1e-3.
    if (norm - 1.0).abs() > 1e-3 || norm.is_nan() {
        return refuse("posture", "is not a direction of length 1".to_owned());
    }
    if settings.feet.is_empty() || settings.feet.len() > MAX_FEET {
        return refuse("feet", format!("has {} names; give 1 to {MAX_FEET}", settings.feet.len()));
    }
    Ok(())
}

/// Numbers above 0.
fn check_positive(settings: &TaskSettings) -> Result<(), TaskError> {
    let positive = [
        ("episode_seconds", settings.episode_seconds, 1e4),
        ("control_dt", settings.control_dt, 1.0),
        ("tracking_width", settings.tracking_width, 1e3),
        ("yaw_tracking_width", settings.yaw_tracking_width, 1e3),
        ("swing_height", settings.swing_height, 1e3),
        ("swing_seconds", settings.swing_seconds, 1e3),
        ("command.seconds", settings.command.seconds, 1e4),
        ("fall.tilt", settings.fall.tilt, 180.0),
    ];
    for (setting, value, max) in positive {
        // Negated, so that NaN is refused; so are the intervals below.
        if !(value > 0.0 && value <= max) {
            return refuse(
                setting,
                format!("is {}; it must be above 0 and at most {max}", shown_number(value)),
            );
        }
    }
    Ok(())
}

/// The physics steps, and the control period.
fn check_steps(settings: &TaskSettings) -> Result<(), TaskError> {
    if let Some(step) = settings.robot_timestep {
        // Readings are (h − step) / 2 later than the velocities of a simulation with step h: here half a step
        // earlier.
        let max = 2.0 * settings.control_dt / settings.substeps.max(1) as f64;
        if !(0.0..=max).contains(&step) {
            let what =
                format!("is {}; it must be from 0 to {max} s, twice the physics step", shown_number(step));
            return refuse("robot_timestep", what);
        }
    }
    if settings.control_dt < MIN_CONTROL_DT {
        return refuse(
            "control_dt",
            format!("is {} s; it must be at least {MIN_CONTROL_DT} s", shown_number(settings.control_dt)),
        );
    }
    Ok(())
}

/// Refuses sizes of random draws that are below 0.
fn check_from_zero(settings: &TaskSettings) -> Result<(), TaskError> {
    let ranges = [
        ("start.joint_position", settings.start.joint_position),
        ("start.joint_velocity", settings.start.joint_velocity),
        ("start.linear_velocity", settings.start.linear_velocity),
        ("start.angular_velocity", settings.start.angular_velocity),
        ("start.tilt", settings.start.tilt),
        ("start.yaw", settings.start.yaw),
        ("push.seconds", settings.push.seconds),
        ("push.velocity", settings.push.velocity),
        ("randomisation.base_com", settings.randomisation.base_com),
    ];
    for (setting, value) in ranges {
        // The range contains no NaN, so NaN is refused too.
        if !(0.0..=1e4).contains(&value) {
            return refuse(setting, format!("is {}; it must be from 0 to 10000", shown_number(value)));
        }
    }
    for (quantity, &half_range) in &settings.noise.half_ranges {
        let setting = format!("noise.{}", quantity.name());
        if quantity.source() == Source::Policy {
            return refuse(&setting, "is no reading of a sensor; leave it out".to_owned());
        }
        if !(0.0..=1e4).contains(&half_range) {
            return refuse(&setting, format!("is {}; it must be from 0 to 10000", shown_number(half_range)));
        }
    }
    Ok(())
}

/// Heights and tilts, which may be below 0.
fn check_places(settings: &TaskSettings) -> Result<(), TaskError> {
    // A base's origin may lie below the floor; a robot that stands is above where it counts as fallen.
    let below_floor = settings.height < 0.0 && settings.height > settings.fall.height;
    if !(below_floor || (0.0..=1e4).contains(&settings.height)) {
        return refuse("height", format!("is {}; it must be from 0 to 10000", shown_number(settings.height)));
    }
    for (setting, value) in [("start.pitch", settings.start.pitch), ("fall.height", settings.fall.height)] {
        if !(-1e4..=1e4).contains(&value) {
            return refuse(setting, format!("is {}; it must be from -10000 to 10000", shown_number(value)));
        }
    }
    Ok(())
}

/// Intervals that are drawn from.
fn check_intervals(settings: &TaskSettings) -> Result<(), TaskError> {
    let r = &settings.randomisation;
    let c = &settings.command;
    let intervals = [
        ("command.x", c.x, -100.0),
        ("command.y", c.y, -100.0),
        ("command.yaw", c.yaw, -100.0),
        ("randomisation.base_mass", r.base_mass, -1e4),
        ("randomisation.kp", r.kp, 0.0),
        ("randomisation.kd", r.kd, 0.0),
        ("randomisation.floor_friction", r.floor_friction, 1e-3),
        ("randomisation.frictionloss", r.frictionloss, 0.0),
        ("randomisation.armature", r.armature, 0.0),
        ("randomisation.delay", r.delay, 0.0),
    ];
    for (setting, [low, high], min) in intervals {
        if !(low >= min && low <= high && high <= 1e4) {
            return refuse(
                setting,
                format!(
                    "is [{}, {}]; it must be [smallest, largest], from {min} to 10000",
                    shown_number(low),
                    shown_number(high)
                ),
            );
        }
    }
    Ok(())
}
