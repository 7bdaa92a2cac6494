//! The interface of a policy as parameters of a ROS 2 node, in the manner of ros2_control's controllers.

use super::{Efforts, NETWORK, efforts, list, number, numbers, quoted, render, scale_of, unmeasured};
use gaitfit_model::Model;
use gaitfit_policy::observation::Layout;
use gaitfit_policy::{FrameOrder, HistoryStart, Policy, PolicyError};
use serde::Serialize;

/// Names in the template; lists and strings are YAML already.
#[derive(Serialize)]
struct Page {
    version: &'static str,
    robot: String,
    network: String,
    control_rate: String,
    joints: String,
    default_position: String,
    action_scale: String,
    action_clip: Option<String>,
    kp: String,
    kd: String,
    velocity_joints: Option<String>,
    effort_limit: Option<String>,
    held: Option<Held>,
    width: usize,
    terms: String,
    widths: String,
    first: String,
    history: String,
    scale: String,
    order: &'static str,
    start: &'static str,
    gait_frequency: Option<String>,
}

#[derive(Serialize)]
struct Held {
    joints: String,
    position: String,
    kp: String,
    kd: String,
    effort_limit: Option<String>,
}

/// The text of `controller.yaml`.
///
/// # Errors
/// A robot that lacks a joint of the policy.
pub(super) fn write(
    policy: &Policy,
    model: Option<&Model>,
    unsaid: &mut Vec<String>,
) -> Result<String, PolicyError> {
    let interface = &policy.interface;
    let layout = Layout::new(interface, &interface.observation);
    let Efforts { moved, held } = efforts("controller.yaml", policy, model, unsaid)?;
    let terms = &interface.observation;
    let joints = interface.joints.len();
    unsaid.extend(unmeasured(interface).map(|why| format!("controller.yaml: {why}")));
    unsaid.push(
        "controller.yaml: no controller type and no update_rate of the controller_manager, as ros2_control has no \
         controller that plays a network"
            .to_owned(),
    );
    // `dyn`, because the two lists of names come from different iterators.
    let names = |of: &mut dyn Iterator<Item = &String>| list(of.map(|name| quoted(name)));
    let of_held = &interface.held;
    render(
        include_str!("controller.yaml.jinja"),
        Page {
            version: env!("CARGO_PKG_VERSION"),
            robot: quoted(&interface.robot),
            network: quoted(NETWORK),
            control_rate: number(1.0 / interface.control_dt),
            joints: names(&mut interface.joints.iter()),
            default_position: numbers(&interface.default_pose),
            action_scale: numbers(&interface.action_scale),
            action_clip: interface
                .action_clip
                .as_ref()
                .map(|clip| numbers((0..joints).map(|joint| clip.limit(joint)))),
            kp: numbers(&interface.kp),
            kd: numbers(&interface.kd),
            velocity_joints: (!interface.velocity_joints.is_empty())
                .then(|| names(&mut interface.velocity_joints.iter())),
            effort_limit: moved.map(numbers),
            held: (!of_held.is_empty()).then(|| Held {
                joints: names(&mut of_held.iter().map(|held| &held.joint)),
                position: numbers(of_held.iter().map(|held| held.position)),
                kp: numbers(of_held.iter().map(|held| held.kp)),
                kd: numbers(of_held.iter().map(|held| held.kd)),
                effort_limit: held.map(numbers),
            }),
            width: layout.width(),
            terms: list(terms.iter().map(|term| quoted(term.quantity.name()))),
            widths: list(terms.iter().map(|term| term.quantity.width(joints))),
            first: list(layout.slots().iter().map(|slot| slot.present.start)),
            history: list(terms.iter().map(|term| term.history)),
            // A term may have one factor for all its numbers; the file lists one for each.
            scale: numbers(terms.iter().flat_map(|term| scale_of(policy, term))),
            order: match interface.history.order {
                FrameOrder::Terms => "terms",
                FrameOrder::Frames => "frames",
                FrameOrder::NewestFirst => "newest_first",
            },
            start: match interface.history.start {
                HistoryStart::First => "first",
                HistoryStart::Zeros => "zeros",
            },
            gait_frequency: interface.gait_frequency.map(number),
        },
    )
}
