//! A C++17 header that holds a policy: networks, normaliser, observation and targets, with everything that it remembers.

use super::layers::{Perceptron, Remembering, array, literal, perceptron, remembering};
use super::{number, render};
use gaitfit_policy::invalid;
use gaitfit_policy::observation::{Layout, Slot};
use gaitfit_policy::{Front, HistoryStart, Latent, Policy, PolicyError, Quantity, Source, Term, Width};
use serde::Serialize;

/// Max number of parameters of all networks: compilers take minutes and gigabytes for more.
const MAX_NUMBERS: usize = 2 << 20;

/// Names in the template; lists, strings and numbers are C++ already.
#[derive(Serialize)]
struct Page {
    version: &'static str,
    robot: String,
    joints: usize,
    names: Vec<String>,
    width: usize,
    control_dt: String,
    gait_frequency: Option<String>,
    pose: String,
    action_scale: String,
    action_clip: String,
    kp: String,
    kd: String,
    /// Whether each joint's target is a velocity; absent if none is.
    velocities: Option<String>,
    effort_limit: Option<String>,
    held: Vec<Held>,
    slots: Vec<Seen>,
    scale: String,
    has_past: bool,
    zeros: bool,
    /// Members of `Sensed` that a robot has no sensors for.
    unmeasured: Vec<Member>,
    normaliser: Option<[String; 2]>,
    cell: Option<&'static str>,
    memory: Vec<Remembering>,
    encoder: Option<TwoPart>,
    actor: Perceptron,
}

#[derive(Serialize)]
struct Held {
    joint: String,
    numbers: String,
}

/// A member of the class that holds what is sensed.
#[derive(Serialize)]
struct Member {
    what: &'static str,
    kind: String,
    name: &'static str,
}

/// A term of the observation.
#[derive(Serialize)]
struct Seen {
    quantity: &'static str,
    present: usize,
    width: usize,
    count: usize,
    frames: String,
    /// C++ expression of its number `i`, before the scale.
    value: &'static str,
}

#[derive(Serialize)]
struct TwoPart {
    network: Perceptron,
    passed: String,
    count: usize,
    /// Where code and passed numbers begin in what the actor sees, and how many that are.
    code_at: usize,
    passed_at: usize,
    seen: usize,
}

/// The text of the header, of a policy that passes [`Policy::check`].
/// `efforts`: the effort limit of each joint that it moves, N·m.
pub(super) fn header(policy: &Policy, efforts: Option<&[f64]>) -> Result<String, PolicyError> {
    policy.refuse_function("a header")?;
    if matches!(policy.front, Some(Front::Graph(_))) {
        return Err(invalid(
            "it is a graph of operators, which is not written as C++: run its own ONNX file on the robot",
        ));
    }
    let earlier = |term: &Term| term.quantity == Quantity::EarlierAction;
    if policy.interface.observation.iter().any(earlier) {
        return Err(invalid("it observes earlier_action, which the header does not hold; use the ONNX file"));
    }
    let count = numbers_of(policy);
    if count > MAX_NUMBERS {
        return Err(invalid(format!(
            "its networks have {count} numbers, and compilers take long for more than {MAX_NUMBERS} in one file; use the \
             ONNX file"
        )));
    }
    let interface = &policy.interface;
    let joints = interface.joints.len();
    let layout = Layout::new(interface, &interface.observation);
    let single = |values: &[f64]| array(&values.iter().map(|&value| value as f32).collect::<Vec<_>>());
    // No number is written for infinity.
    let clip = |joint| interface.clip(joint).min(f64::from(f32::MAX)) as f32;
    let held = |held: &gaitfit_policy::Held| Held {
        joint: string(&held.joint),
        numbers: [held.position, held.kp, held.kd].map(|value| literal(value as f32)).join(", "),
    };
    let (cell, memory) = match &policy.front {
        Some(Front::Recurrent(recurrent)) => {
            let gates = recurrent.cell.gates();
            let layers = recurrent.layers.iter().map(|layer| remembering(layer, gates));
            (Some(recurrent.cell.name()), layers.collect())
        }
        // An encoder has no memory, and `two_part` writes it. Other fronts were refused above.
        _ => (None, Vec::new()),
    };
    let page = Page {
        version: env!("CARGO_PKG_VERSION"),
        robot: string(&interface.robot),
        joints,
        names: interface.joints.iter().map(|name| string(name)).collect(),
        width: layout.width(),
        control_dt: number(interface.control_dt),
        gait_frequency: interface.gait_frequency.map(number),
        pose: single(&interface.default_pose),
        action_scale: single(&interface.action_scale),
        action_clip: array(&(0..joints).map(clip).collect::<Vec<_>>()),
        kp: single(&interface.kp),
        kd: single(&interface.kd),
        velocities: (!interface.velocity_joints.is_empty()).then(|| {
            let kinds = interface.velocity_targets();
            kinds.iter().map(bool::to_string).collect::<Vec<_>>().join(", ")
        }),
        effort_limit: efforts.map(single),
        held: interface.held.iter().map(held).collect(),
        slots: layout.slots().iter().map(seen).collect(),
        scale: array(&layout.scales()),
        has_past: layout.frames() > 1,
        zeros: interface.history.start == HistoryStart::Zeros,
        unmeasured: unmeasured(&layout),
        // Factor and offset save the robot the square root and the division.
        normaliser: policy.normaliser.as_ref().map(|normaliser| {
            let (factor, offset): (Vec<f32>, Vec<f32>) = normaliser.scale().into_iter().unzip();
            [factor, offset].map(|values| array(&values))
        }),
        cell,
        memory,
        encoder: two_part(policy),
        actor: perceptron("actor", &policy.actor),
    };
    render(include_str!("policy.hpp.jinja"), page)
}

/// Numbers of all networks that act.
fn numbers_of(policy: &Policy) -> usize {
    // Passed numbers are a table in the header, and count as well.
    let front = match &policy.front {
        None | Some(Front::Function(_) | Front::Graph(_)) => 0,
        Some(Front::Recurrent(recurrent)) => recurrent.parameters().map(<[f32]>::len).sum(),
        Some(Front::Encoder(encoder)) => encoder.network.parameters.len() + encoder.passed.len(),
    };
    front + policy.actor.parameters.len()
}

fn two_part(policy: &Policy) -> Option<TwoPart> {
    let Some(Front::Encoder(encoder)) = &policy.front else { return None };
    let (count, code) = (encoder.passed.len(), encoder.network.shape.outputs);
    // The actor sees the encoder's output before or behind the passed numbers.
    let [code_at, passed_at] = match encoder.latent {
        Latent::First => [0, code],
        Latent::Last => [count, 0],
    };
    let passed: Vec<String> = encoder.passed.iter().map(usize::to_string).collect();
    Some(TwoPart {
        network: perceptron("encoder", &encoder.network),
        passed: passed.join(", "),
        count,
        code_at,
        passed_at,
        seen: count + code,
    })
}

/// The observed quantities that robots do not measure, each once.
fn unmeasured(layout: &Layout) -> Vec<Member> {
    let seen = |quantity: &&Quantity| layout.slots().iter().any(|slot| slot.quantity == **quantity);
    // The header cannot fill these from sensors, so its user must, and each becomes a member.
    let simulated = Quantity::ALL.iter().filter(|quantity| quantity.source() == Source::Simulation);
    let member = |quantity: &Quantity| Member {
        what: quantity.doc().split(';').next().unwrap_or_default(),
        kind: match quantity.numbers() {
            Width::Numbers(1) => "float".to_owned(),
            Width::Numbers(count) => format!("std::array<float, {count}>"),
            Width::Joints => "std::array<float, kJoints>".to_owned(),
        },
        name: quantity.name(),
    };
    simulated.filter(seen).map(member).collect()
}

fn seen(slot: &Slot) -> Seen {
    let frames: Vec<String> = slot.frames.iter().map(usize::to_string).collect();
    Seen {
        quantity: slot.quantity.name(),
        present: slot.present.start,
        width: slot.present.len(),
        count: frames.len(),
        frames: frames.join(", "),
        value: slot.quantity.cxx(),
    }
}

/// A string literal. All but plain letters, digits and signs are octal, so that no name ends the literal or means more.
fn string(text: &str) -> String {
    // An octal escape has three digits, so a digit behind it stays one; `?` would begin a trigraph where they
    // are kept.
    let byte = |byte: u8| match byte {
        b'"' | b'\\' | b'?' => format!("\\{byte:03o}"),
        b' '..=b'~' => char::from(byte).to_string(),
        _ => format!("\\{byte:03o}"),
    };
    format!("\"{}\"", text.bytes().map(byte).collect::<String>())
}
