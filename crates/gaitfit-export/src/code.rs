//! Python code that says what robot files cannot.

use super::joint::JointNumbers;
use super::remarks::remarks;
use gaitfit_model::{Model, Root, shown, shown_number};
use gaitfit_sim::Candidate;
use std::fmt::Write;

/// Reads theta.json and puts it into a MuJoCo model (also MJX and MuJoCo Playground, before `put_model`).
pub(super) const LOADER: &str = include_str!("load_theta.py");
/// The PD controller with delay, bias, factors, noise and networks.
pub(super) const DRIVE: &str = include_str!("drive.py");

/// A text as Python writes it. Names have no control characters.
fn python(text: &str) -> String {
    format!("\"{}\"", text.replace('\\', "\\\\").replace('"', "\\\""))
}

/// A regular expression, as Python writes it, that covers the name alone.
fn regex(name: &str) -> String {
    let mut text = String::with_capacity(name.len());
    for c in name.chars() {
        // The characters of Python's `re.escape` but `-`, which means nothing outside of brackets.
        if r"()[]{}?*+|^$\.&~# ".contains(c) {
            text.push('\\');
        }
        text.push(c);
    }
    python(&text)
}

/// `{"a": 1.0, "b": 2.0}` of a number of each joint; one number where all are the same.
fn table(joints: &[JointNumbers], number: impl Fn(&JointNumbers) -> f64) -> String {
    let first = joints.first().map_or(0.0, &number);
    if joints.iter().all(|joint| number(joint) == first) {
        // `{:?}` writes as many digits as Python needs to read the same number.
        return format!("{first:?}");
    }
    let entries: Vec<String> =
        joints.iter().map(|joint| format!("{}: {:?}", regex(&joint.name), number(joint))).collect();
    format!("{{{}}}", entries.join(", "))
}

/// A delay that is written as another one: below this part of a physics step it is rounding.
const EXACT_LAG: f64 = 0.02;

/// That actuators with delays of whole physics steps cannot have the fitted delays, with the numbers and what to do; `None`
/// where they can.
pub(super) fn lag_note(joints: &[JointNumbers], step: f64) -> Option<String> {
    // All joints get one lag; the joint that it suits least decides the note.
    let written = lag(joints, step) as f64 * step;
    let off = |joint: &JointNumbers| (joint.delay - written).abs();
    let farthest = joints.iter().max_by(|a, b| off(a).total_cmp(&off(b)))?;
    if off(farthest) <= EXACT_LAG * step {
        return None;
    }
    let head = format!(
        "DELAY ROUNDED: isaac_lab.py and mjlab_robot.py write {:.2} ms ({} physics steps of {:.2} ms)",
        1e3 * written,
        lag(joints, step),
        1e3 * step
    );
    let delays = || joints.iter().map(|joint| joint.delay);
    let (least, longest) = (delays().fold(f64::INFINITY, f64::min), delays().fold(0.0, f64::max));
    // A step that divides the delay of one joint leaves the others as wrong as before.
    if longest - least > EXACT_LAG * step {
        return Some(format!(
            "{head} for all joints, and the fitted delays are {:.2} to {:.2} ms. Their actuators have one delay here, \
             so no --step suits all joints; drive.py and theta.json have the exact values",
            1e3 * least,
            1e3 * longest
        ));
    }
    Some(format!(
        "{head}, and the fitted delay is {:.2} ms. Their actuators use whole steps only. Take a physics step that \
         divides the delay and give it here, for example --step {}; drive.py and theta.json have the exact value",
        1e3 * farthest.delay,
        // The longest step up to the present one that divides the delay, in whole µs.
        shown_number((1e6 * farthest.delay / (farthest.delay / step).ceil().max(1.0)).round() / 1e6)
    ))
}

/// Limit of a joint that has none, N·m, where other joints have one.
const UNLIMITED: f64 = 1e9;

/// Physics steps of the longest delay.
fn lag(joints: &[JointNumbers], step: f64) -> usize {
    // One lag serves all joints.
    let longest = joints.iter().map(|joint| joint.delay).fold(0.0, f64::max);
    if step > 0.0 { (longest / step).round() as usize } else { 0 }
}

/// Isaac Lab's actuators with the fitted numbers. `joints`: those with a motor; `all`: of the robot.
pub(super) fn isaac_lab(
    joints: &[JointNumbers],
    all: &[JointNumbers],
    gains: bool,
    step: f64,
    model: &Model,
    candidate: &Candidate,
) -> String {
    let names: Vec<String> = joints.iter().map(|joint| regex(&joint.name)).collect();
    let (lag, rounded) = (lag(joints, step), lag_note(joints, step));
    let gain =
        |number: fn(&JointNumbers) -> f64| if gains { table(joints, number) } else { "None".to_owned() };
    let limited = |joint: &JointNumbers| joint.torque_limit.is_finite();
    let limits = joints.iter().map(|joint| {
        let limit = if limited(joint) { joint.torque_limit } else { UNLIMITED };
        format!("{}: {limit:?}", regex(&joint.name))
    });
    let limits: Vec<String> = limits.collect();
    let mut text = String::from(
        "\"\"\"Actuators of an Isaac Lab articulation with fitted numbers: ArticulationCfg(..., \
         actuators=ACTUATORS).\n\nFriction is an effort, N·m, in Isaac Sim 5 and later; in 4.5 it is a coefficient, \
         and these numbers do not fit.\nNone keeps the asset's value.\n\"\"\"\n\nfrom isaaclab.actuators import \
         DelayedPDActuatorCfg\n\n",
    );
    // Writing into a text cannot fail, so the results are not looked at.
    let _ = writeln!(text, "# Lags are in physics steps of this length, s.\nPHYSICS_STEP = {step:?}\n");
    if let Some(note) = rounded {
        let _ = writeln!(text, "# {note}.\n");
    }
    let _ = writeln!(text, "ACTUATORS = {{\n    \"joints\": DelayedPDActuatorCfg(");
    let _ = writeln!(text, "        joint_names_expr=[{}],", names.join(", "));
    let _ = writeln!(text, "        stiffness={},", gain(|joint| joint.kp));
    let _ = writeln!(text, "        damping={},", gain(|joint| joint.kd));
    // Without any limit they are left to the asset. Isaac Lab gives joints that the table leaves out a limit of 0.
    if joints.iter().any(limited) {
        if !joints.iter().all(limited) {
            let _ = writeln!(text, "        # {UNLIMITED:?}: no limit.");
        }
        let _ = writeln!(text, "        effort_limit={{{}}},", limits.join(", "));
    }
    let _ = writeln!(text, "        armature={},", table(joints, |joint| joint.armature));
    // Isaac's friction is that at rest, and its dynamic friction that in motion; stiction is what breaks away
    // on top.
    let _ =
        writeln!(text, "        friction={},", table(joints, |joint| joint.frictionloss + joint.stiction));
    let _ = writeln!(text, "        dynamic_friction={},", table(joints, |joint| joint.frictionloss));
    let _ = writeln!(text, "        viscous_friction={},", table(joints, |joint| joint.damping));
    let _ = writeln!(text, "        min_delay={lag},\n        max_delay={lag},\n    ),\n}}");
    let mut rest: Vec<String> = remarks(model, candidate).into_iter().map(str::to_owned).collect();
    let others = all.iter().filter(|joint| joint.named && !joint.motor);
    let others: Vec<String> = others.map(|joint| format!("`{}`", shown(&joint.name))).collect();
    if !others.is_empty() {
        rest.push(format!("armature, friction and damping of joints without a motor: {}", others.join(", ")));
    }
    if !rest.is_empty() {
        text.push_str("\n# Not among an actuator's settings; the numbers are in theta.json:\n");
        rest.into_iter().for_each(|line| text.push_str(&format!("# - {line}\n")));
    }
    text
}

/// mjlab's robot: the exported robot file and an actuator for each set of joints with the same numbers. `joints`: those
/// with a motor; `all`: of the robot; `urdf`: how the robot hangs in the world, if its file is a URDF.
pub(super) fn mjlab(
    joints: &[JointNumbers],
    all: &[JointNumbers],
    gains: bool,
    step: f64,
    urdf: Option<Root>,
) -> String {
    let lag = lag(joints, step);
    let mut text = String::from(
        "\"\"\"The fitted robot for mjlab: EntityCfg(spec_fn=spec, articulation=EntityArticulationInfoCfg(actuators=ACTUATORS)).\n\n",
    );
    text.push_str(match urdf {
        None => "Armature, damping, friction loss and springs are in robot.xml.",
        Some(_) => {
            "Damping and friction loss are in robot.urdf, and spec() adds the armature. Springs: see theta.json."
        }
    });
    text.push_str(
        " Bias, offset, noise, networks and torque that falls with speed: see drive.py. Friction at rest: \
         load_theta.stribeck.\n\
         For mjlab 1.6, whose actuators have their delay themselves.\n\"\"\"\n\n\
         import pathlib\n\nimport mujoco\nfrom mjlab.actuator import BuiltinPositionActuatorCfg\n\n",
    );
    let _ = writeln!(
        text,
        "# Lags are in physics steps of this length, s.\nPHYSICS_STEP = {step:?}\nLAG = {lag}\n"
    );
    if let Some(note) = lag_note(joints, step) {
        let _ = writeln!(text, "# {note}.\n");
    }
    text.push_str(&spec(all, urdf));
    text.push_str(
        "def servo(joints, kp, kd, limit):\n    return BuiltinPositionActuatorCfg(target_names_expr=joints, stiffness=kp, \
         damping=kd,\n                                      effort_limit=limit, delay_min_lag=LAG, delay_max_lag=LAG)\n\n\n",
    );
    if !gains {
        text.push_str("# Write your gains: servo((\".*\",), kp=25.0, kd=0.5, limit=None)\nACTUATORS = ()\n");
        return text;
    }
    text.push_str("ACTUATORS = (\n");
    // Equal numbers make one actuator. Their bits are compared, as floats have no equality to rely on.
    let mut done: Vec<[u64; 3]> = Vec::new();
    for joint in joints {
        let key = [joint.kp, joint.kd, joint.torque_limit].map(f64::to_bits);
        if done.contains(&key) {
            continue;
        }
        let same =
            joints.iter().filter(|other| [other.kp, other.kd, other.torque_limit].map(f64::to_bits) == key);
        // The comma at the end makes a tuple of a single name too.
        let names: String = same.map(|other| format!("{}, ", regex(&other.name))).collect();
        let limit =
            if joint.torque_limit.is_finite() { format!("{:?}", joint.torque_limit) } else { "None".into() };
        let _ = writeln!(text, "    servo(({names}), kp={:?}, kd={:?}, limit={limit}),", joint.kp, joint.kd);
        done.push(key);
    }
    text.push_str(")\n");
    text
}

/// The function of mjlab's robot that reads the robot file. A URDF has no armature, and MuJoCo fixes its base.
fn spec(joints: &[JointNumbers], urdf: Option<Root>) -> String {
    let file = if urdf.is_some() { "robot.urdf" } else { "robot.xml" };
    let mut text = String::new();
    if urdf.is_some() {
        let entries = joints.iter().map(|joint| format!("{}: {:?}", python(&joint.name), joint.armature));
        let _ = writeln!(text, "ARMATURE = {{{}}}\n", entries.collect::<Vec<_>>().join(", "));
    }
    let _ = writeln!(
        text,
        "\ndef spec():\n    spec = mujoco.MjSpec.from_file(str(pathlib.Path(__file__).with_name(\"{file}\")))"
    );
    text.push_str(match urdf {
        None => {
            "    for actuator in list(spec.actuators):  # mjlab makes its own\n        spec.delete(actuator)\n"
        }
        Some(_) => {
            "    for name, armature in ARMATURE.items():\n        spec.joint(name).armature = armature\n"
        }
    });
    if urdf == Some(Root::Floating) {
        text.push_str(
            "    # MuJoCo joins the base of a URDF to the world.\n    spec.compiler.fusestatic = False\n    base = \
             spec.worldbody.first_body()\n    if base.first_joint() is None:\n        base.add_freejoint()\n",
        );
    }
    text.push_str("    return spec\n\n\n");
    text
}
