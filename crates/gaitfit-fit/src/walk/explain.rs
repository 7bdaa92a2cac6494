//! A ranked list of what a robot has and its model lacks, as walks show it without a simulation, with evidence.
//!
//! A cause is named if the logs show it surely, if it explains a good part of the signal that shows it, and if it is
//! large enough to change how a robot walks. Causes are ranked by their size divided by the smallest size that changes
//! a walk. The limits were set with robots in MuJoCo that have one cause each (`tools/mujoco_effects.py`). With these
//! limits gaitfit names nothing on a robot without such a cause.

pub use super::cause::{Cause, CauseKind};
use super::cause::{matters, of_effect};
use super::swing::{Estimate, SwingFindings};
use gaitfit_adapt::{Entry, JointParameter, Theta};
use gaitfit_sim::Candidate;
use gaitfit_swing::{Effect, EffectKind, usual_group};

/// A tilt must be surer than other effects of sensors: on soft ground standing feet show one of a few errors.
const SUREST: f64 = 10.0;

/// The causes that `findings` show, the largest weight first.
pub fn causes(findings: &SwingFindings) -> Vec<Cause> {
    let mut causes = sensors(findings);
    let shown = |effect: &Effect| of_effect(effect, findings.swings.as_ref());
    // `Strength` shows play of a gear, see `play_of_swings`. It is looked at last, because other causes look
    // like it.
    let (swings, others): (Vec<&Effect>, Vec<&Effect>) =
        findings.effects.iter().partition(|effect| effect.kind == EffectKind::Strength);
    causes.extend(others.into_iter().filter_map(shown));
    // Friction under load makes a joint look as if it had play. If joints twist, the robot leans, and any joint can
    // look so.
    let others: Vec<(CauseKind, String)> = causes
        .iter()
        .filter(|cause| matches!(cause.kind, CauseKind::Elasticity | CauseKind::LoadFriction))
        .map(|cause| (cause.kind, cause.of.clone()))
        .collect();
    let explained =
        |play: &Cause| others.iter().any(|(kind, of)| *kind == CauseKind::Elasticity || *of == play.of);
    causes.retain(|cause| cause.kind != CauseKind::Backlash || !explained(cause));
    // Swings show play too, but not its size. If a gear rubs under load, its links respond less to their motors as
    // well, and one group seldom rubs alone.
    if others.is_empty() {
        let is_new = |play: &Cause| !causes.iter().any(|old| old.kind == play.kind && old.of == play.of);
        let plays = swings.into_iter().filter_map(shown);
        let plays: Vec<Cause> = plays.filter(is_new).collect();
        causes.extend(plays);
    }
    causes.sort_by(|a, b| b.weight.total_cmp(&a.weight));
    causes
}

/// A sentence about the effects that the fitted simulator lacks; absent if it lacks none. `base`: the robot that θ
/// changes, with its known values; `joints`: names of all its joints.
pub fn missing(causes: &[Cause], theta: &Theta, base: &Candidate, joints: &[String]) -> Option<String> {
    // No fitted value of a joint compensates for these.
    let harmless = [CauseKind::GyroBias, CauseKind::EncoderStep];
    let listed: Vec<&str> = causes
        .iter()
        .filter(|cause| !harmless.contains(&cause.kind) && !covered(cause, theta, base, joints))
        .take(NAMED)
        .map(|cause| cause.text.as_str())
        .collect();
    (!listed.is_empty()).then(|| {
        format!(
            "The logs show effects that the fitted simulator lacks: {}. Its values compensate for them.",
            listed.join("; ")
        )
    })
}

/// Whether the fitted simulator has an effect: θ contains its parameters, or `base` has values for them. `joints`:
/// names of all joints of the robot.
pub fn covered(cause: &Cause, theta: &Theta, base: &Candidate, joints: &[String]) -> bool {
    let Candidate { robot, sensors, .. } = base;
    let some = |numbers: &[f64]| numbers.iter().any(|number| *number != 0.0);
    let has = |kind: &str| theta.entries().iter().any(|entry| entry.kind == kind);
    let alone = |kind: JointParameter| {
        theta.entries().iter().any(|entry| entry.kind == kind.name() && entry.joints == [cause.of.as_str()])
    };
    // A spring or strength of one joint does not cover another joint's.
    let known = |numbers: &[f64], without: f64| {
        joints.iter().zip(numbers).any(|(joint, number)| *joint == cause.of && *number != without)
    };
    // A parameter of one joint group does not cover another group's effect either.
    let of_group = |kind: JointParameter| {
        let in_group = |joint: &&String| usual_group(joint) == cause.of;
        joints.iter().filter(in_group).any(|joint| has_joint(kind, joint, theta, base, joints))
    };
    // A stated value counts as much as a fitted one: the simulator has both.
    match cause.kind {
        CauseKind::GyroBias => {
            ["gyro_bias_x", "gyro_bias_y", "gyro_bias_z"].iter().all(|kind| has(kind))
                || some(&sensors.gyro_bias)
        }
        // The simulator's encoders have no steps, so nothing covers this.
        CauseKind::EncoderStep => false,
        CauseKind::VelocityLag => has("velocity_lag") || robot.velocity_lag != 0.0,
        CauseKind::Tilt => (has("imu_roll") && has("imu_pitch")) || some(&sensors.imu_tilt),
        CauseKind::LoadFriction => of_group(JointParameter::LoadFriction),
        CauseKind::OddFriction => alone(JointParameter::FrictionLoss),
        CauseKind::OddSpring => {
            let of_joint = |entry: &Entry| {
                let kinds = [JointParameter::Stiffness, JointParameter::SpringTorque];
                kinds.iter().any(|kind| kind.name() == entry.kind) && entry.joints.contains(&cause.of)
            };
            theta.entries().iter().any(of_joint) || known(&robot.stiffness, 0.0)
        }
        CauseKind::OddStrength => alone(JointParameter::TorqueScale) || known(&robot.torque_scale, 1.0),
        CauseKind::Backlash => of_group(JointParameter::Play),
        CauseKind::Elasticity => of_group(JointParameter::Compliance),
        CauseKind::Ground => has("ground_softness") || robot.ground_softness != 0.0,
    }
}

/// Whether `theta` has friction under load, play or compliance of a joint, or `base` has a value for it. `joints`:
/// names of all joints of the robot.
pub fn has_joint(
    kind: JointParameter,
    joint: &str,
    theta: &Theta,
    base: &Candidate,
    joints: &[String],
) -> bool {
    let numbers = match kind {
        JointParameter::LoadFriction => &base.robot.load_friction,
        JointParameter::Play => &base.robot.play,
        JointParameter::Compliance => &base.robot.compliance,
        _ => return false,
    };
    let fitted = |entry: &Entry| entry.kind == kind.name() && entry.joints.iter().any(|one| one == joint);
    let known = joints.iter().zip(numbers).any(|(one, number)| one == joint && *number != 0.0);
    known || theta.entries().iter().any(fitted)
}

/// Sentences about play that swings show and the fit with these `values` of `theta` does not find. Swings named play
/// falsely on two of fifteen robots without it (docs, "Which effect is named").
pub fn false_play(findings: &SwingFindings, theta: &Theta, values: &[f64]) -> Vec<String> {
    let groups = findings.swings.as_ref().map_or(&[][..], |report| report.groups.as_slice());
    let fitted = |cause: &Cause| -> Option<f64> {
        let group = groups.iter().find(|group| group.group == cause.of)?;
        let of_group = |entry: &Entry| {
            entry.kind == JointParameter::Play.name()
                && entry.joints.iter().any(|joint| group.joints.contains(joint))
        };
        let plays = theta.entries().iter().zip(values).filter(|(entry, _)| of_group(entry));
        plays.map(|(_, play)| *play).reduce(f64::max)
    };
    // Play that heights of feet show has a size of its own, in rad.
    let of_swings = |cause: &&Cause| cause.kind == CauseKind::Backlash && cause.unit == "-";
    let sentence = |cause: &Cause| {
        let play = fitted(cause).filter(|play| *play < matters::PLAY)?;
        Some(format!(
            "swings look like play of {} joints, but the fit finds {play:.3} rad: they probably have none",
            cause.of
        ))
    };
    causes(findings).iter().filter(of_swings).filter_map(sentence).collect()
}

/// Causes that a doubt names.
const NAMED: usize = 3;

fn sensors(findings: &SwingFindings) -> Vec<Cause> {
    let mut causes = Vec::new();
    let mut add = |kind, size: Estimate, unit: &str, matters: f64, text: String| {
        // 1 is the smallest size that changes a walk, so causes of different units can be ranked together.
        let weight = size.value.abs() / matters;
        causes.push(Cause { kind, of: String::new(), size, unit: unit.to_owned(), weight, text });
    };
    let sensors = &findings.sensors;
    if let Some(lag) = sensors.velocity_lag.filter(|lag| lag.matters(matters::LAG)) {
        let text = format!(
            "joint velocities lag positions by {:.1} ms (a filter, or a late reading; fit it: velocity_lag)",
            1e3 * lag.value
        );
        add(CauseKind::VelocityLag, lag, "s", matters::LAG, text);
    }
    let largest =
        |axes: [Estimate; 2]| if axes[0].value.abs() > axes[1].value.abs() { axes[0] } else { axes[1] };
    if let Some(bias) = sensors.gyro_bias {
        let max = largest([largest([bias[0], bias[1]]), bias[2]]);
        if max.matters(matters::GYRO) {
            let text = format!(
                "the gyro reads {:.3} rad/s at rest on one axis (fit it: gyro_bias_x, gyro_bias_y, gyro_bias_z)",
                max.value
            );
            add(CauseKind::GyroBias, max, "rad/s", matters::GYRO, text);
        }
    }
    if let Some(tilt) = findings.tilt() {
        let max = largest(tilt);
        if max.value.abs() > matters::TILT && max.value.abs() > SUREST * max.error {
            let [roll, pitch] = tilt.map(|axis| axis.value.to_degrees());
            let text = format!(
                "the inertial unit is tilted by {roll:.1}° of roll and {pitch:.1}° of pitch against the standing feet (fit \
                 it: imu_roll, imu_pitch), or the floor slopes"
            );
            add(CauseKind::Tilt, max, "rad", matters::TILT, text);
        }
    }
    if let Some(step) = sensors.position_step.filter(|step| *step >= matters::STEP) {
        let size = Estimate { value: step, error: 0.0 };
        let text = format!("joint positions come in steps of {step:.4} rad");
        add(CauseKind::EncoderStep, size, "rad", matters::STEP, text);
    }
    causes
}

#[cfg(test)]
#[path = "explain_test.rs"]
mod tests;
