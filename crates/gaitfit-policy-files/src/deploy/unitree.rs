//! `deploy.yaml`, which unitree_rl_lab's C++ program reads beside a policy: joints by their places in Unitree's SDK, gains in
//! the SDK's order, everything else in the policy's.

use super::{list, number, numbers, quoted, render, scale_of, unmeasured};
use crate::foreign::sdk;
use gaitfit_policy::{FrameOrder, HistoryStart, Interface, Policy, PolicyError, Quantity};
use serde::Serialize;

/// Names in the template; lists are YAML already.
#[derive(Serialize)]
struct Page {
    version: &'static str,
    joint_ids_map: String,
    step_dt: String,
    stiffness: String,
    damping: String,
    pose: String,
    ranges: [String; 3],
    clip: Option<String>,
    scale: String,
    frames: bool,
    terms: Vec<Term>,
}

#[derive(Serialize)]
struct Term {
    name: &'static str,
    params: String,
    scale: String,
    history: usize,
}

/// Why unitree_rl_lab cannot run a policy with this interface; none where it can.
pub(super) fn obstacle(interface: &Interface) -> Option<String> {
    if places(interface).is_none() {
        return Some("its joints are not all those of one of Unitree's robots (Go2, H1, G1)".to_owned());
    }
    if let Some(joint) = interface.velocity_joints.first() {
        return Some(format!(
            "the targets of {joint} are velocities, and its JointPositionAction takes positions"
        ));
    }
    if let Some(why) = unmeasured(interface) {
        return Some(why);
    }
    let terms = &interface.observation;
    let others = [Quantity::GaitSine, Quantity::Constant, Quantity::EarlierAction];
    if let Some(term) = terms.iter().find(|term| others.contains(&term.quantity)) {
        return Some(format!("unitree_rl_lab has no term for {}", term.quantity.name()));
    }
    let many = terms.iter().any(|term| term.history > 1);
    if many && interface.history.order == FrameOrder::NewestFirst {
        return Some("unitree_rl_lab has no history whose newest frame comes first".to_owned());
    }
    // The last obstacle: without a term that is there twice, `?` says that there is none.
    let twice = (1..terms.len())
        .find(|&index| terms[..index].iter().any(|term| term.quantity == terms[index].quantity))?;
    Some(format!(
        "it observes {} twice, and unitree_rl_lab takes each term once",
        terms[twice].quantity.name()
    ))
}

fn places(interface: &Interface) -> Option<sdk::Places> {
    let held = interface.held.iter().map(|held| held.joint.as_str());
    sdk::with_joints(interface.joints.iter().map(String::as_str).chain(held))
}

/// The text of `deploy.yaml`, for a policy without an [`obstacle`].
pub(super) fn write(policy: &Policy, unsaid: &mut Vec<String>) -> Result<String, PolicyError> {
    let interface = &policy.interface;
    // An interface without places has an `obstacle`, and no text is written of it.
    let (robot, places) = places(interface).unwrap_or_default();
    let place = |name: &str| places.iter().position(|&joint| joint == name);
    let ids: Vec<usize> = interface.joints.iter().filter_map(|name| place(name)).collect();
    // One gain for each place of the SDK. Places without a motor keep 0.
    let [mut stiffness, mut damping] = [vec![0.0; places.len()], vec![0.0; places.len()]];
    let moved = ids.iter().copied().zip(interface.kp.iter().copied().zip(interface.kd.iter().copied()));
    let held = interface.held.iter().filter_map(|held| Some((place(&held.joint)?, (held.kp, held.kd))));
    for (at, (kp, kd)) in moved.chain(held) {
        stiffness[at] = kp;
        damping[at] = kd;
    }
    // Its program clips targets. The policy's clip bounds actions, which then are scaled and added to the
    // pose.
    let clip = interface.action_clip.as_ref().map(|clip| {
        let bounds = interface.default_pose.iter().zip(&interface.action_scale).enumerate();
        list(bounds.map(|(joint, (pose, scale))| {
            let max = scale.abs() * clip.limit(joint);
            numbers([pose - max, pose + max])
        }))
    });
    let ranges = ranges(&policy.provenance.task);
    say(interface, robot, ranges.is_some(), unsaid);
    let many = interface.observation.iter().any(|term| term.history > 1);
    let term = |term: &gaitfit_policy::Term| Term {
        // unitree_rl_lab's name; the others are of other programs.
        name: term.quantity.foreign()[0],
        params: match (term.quantity, interface.gait_frequency) {
            (Quantity::Command, _) => format!("{{command_name: {}}}", quoted("base_velocity")),
            (Quantity::GaitPhase, Some(frequency)) => format!("{{period: {}}}", number(1.0 / frequency)),
            _ => "{}".to_owned(),
        },
        scale: numbers(scale_of(policy, term)),
        history: term.history,
    };
    render(
        include_str!("deploy.yaml.jinja"),
        Page {
            version: env!("CARGO_PKG_VERSION"),
            joint_ids_map: list(ids),
            step_dt: number(interface.control_dt),
            stiffness: numbers(stiffness),
            damping: numbers(damping),
            pose: numbers(&interface.default_pose),
            ranges: ranges.unwrap_or([[-1.0, 1.0]; 3]).map(numbers),
            clip,
            scale: numbers(&interface.action_scale),
            frames: many && interface.history.order == FrameOrder::Frames,
            terms: interface.observation.iter().map(term).collect(),
        },
    )
}

/// Adds what the file does not say.
fn say(interface: &Interface, robot: &str, ranges: bool, unsaid: &mut Vec<String>) {
    let mut add = |what: String| unsaid.push(format!("params/deploy.yaml: {what}"));
    add(format!("joint names, only places in Unitree's SDK, here those of the {robot}; and effort limits"));
    let seen = |quantity| interface.observation.iter().any(|term| term.quantity == quantity);
    if !ranges && seen(Quantity::Command) {
        add("the commands that the policy was trained on are not known; -1 to 1 is written, all that the remote gives"
            .to_owned());
    }
    for held in &interface.held {
        add(format!(
            "the angle of held joint {}, {} rad: it stays where the state before left it",
            held.joint, held.position
        ));
    }
    let many = interface.observation.iter().any(|term| term.history > 1);
    if many && interface.history.start == HistoryStart::Zeros {
        add("that frames before the first observation are zeros; unitree_rl_lab fills them with the first"
            .to_owned());
    }
    if many && interface.history.order == FrameOrder::Frames {
        add("use_gym_history, which it says, is known to newer versions of unitree_rl_lab only".to_owned());
    }
    if seen(Quantity::GaitPhase) {
        add("where the gait clock begins: unitree_rl_lab has moved it on before the first observation"
            .to_owned());
    }
}

/// The commands of the task that the policy was trained on: forward, left, yaw rate.
fn ranges(task: &str) -> Option<[[f64; 2]; 3]> {
    let task: toml::Table = task.parse().ok()?;
    let command = task.get("command")?;
    let range = |name: &str| {
        let pair: [f64; 2] = command.get(name)?.clone().try_into().ok()?;
        pair.iter().all(|bound| bound.is_finite()).then_some(pair)
    };
    Some([range("x")?, range("y")?, range("yaw")?])
}
