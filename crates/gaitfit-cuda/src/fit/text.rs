//! The kernels' text: numbers and tables of what is simulated, then the files.

use gaitfit_policy::network::{Activation, Layer};
use gaitfit_policy::walker::Walker;
use gaitfit_policy::{Policy, Term};

use super::scene::{Scene, Subject};
use crate::emit::Class;
use crate::runtime::Program;
use crate::words::{Words, double, single};

/// The program of a scene, `rows` robots of a block together, `group` of a thread. Products and sums are rounded one by one, as the CPU does it.
pub(super) fn program(scene: &Scene<'_>, rows: usize, group: usize) -> Program {
    let mut text = String::from(include_str!("../common.cuh"));
    text.push_str(include_str!("../rollout/kernels/structs.cu"));
    let mut words = Words { text };
    sizes(&mut words, scene);
    let parts: &[&str] = match scene.subject {
        Subject::Walk(walker, policy) => {
            walk(&mut words, walker);
            network(&mut words, policy, rows);
            words.define("GROUP", group);
            &[
                include_str!("../rollout/kernels/draws.cu"),
                include_str!("../rollout/kernels/robot.cu"),
                include_str!("../rollout/kernels/sensors.cu"),
                include_str!("../rollout/kernels/observe.cu"),
                include_str!("kernels/places.cu"),
                include_str!("kernels/network.cu"),
                include_str!("kernels/walk.cu"),
            ]
        }
        Subject::Replay(replay) => {
            lead(&mut words, 0.0);
            words.define("HAS_CLOCK", 0);
            words.define("HALF_STEP", single(0.5 * replay.settings().timestep as f32));
            &[
                include_str!("../rollout/kernels/robot.cu"),
                include_str!("kernels/places.cu"),
                include_str!("kernels/replay.cu"),
            ]
        }
    };
    for part in parts {
        words.text.push_str(part);
    }
    Program::new("fit", words.text).option("-fmad=false")
}

fn lead(words: &mut Words, lead: f32) {
    words.define("LEAD", single(lead));
    words.define("HAS_LEAD", u32::from(lead != 0.0));
}

fn sizes(words: &mut Words, scene: &Scene<'_>) {
    for (name, value) in [
        ("PER_TILE", scene.period.layout().environments()),
        ("STATE_SIZE", scene.size(Class::State)),
        ("PARAMS_SIZE", scene.size(Class::Params)),
        ("TARGETS_SIZE", scene.size(Class::Targets)),
        ("MEMORY_SIZE", scene.size(Class::Memory)),
        ("REPORT_SIZE", scene.size(Class::Report)),
        ("DISTURBANCE_SIZE", scene.size(Class::Disturbance)),
        ("SUBSTEPS", scene.period.substeps()),
        ("JOINTS", scene.joints()),
        ("TAPS", scene.period.taps()),
        ("PARAMS", scene.params.len()),
        ("MEMORY", scene.memory.len()),
        ("DISTURBED", scene.disturbance.len()),
        ("REPLAYS", usize::from(matches!(scene.subject, Subject::Replay(_)))),
    ] {
        words.define(name, value);
    }
    words.spots("STATE_SPOTS", &scene.state);
    words.spots("PARAM_SPOTS", &scene.params);
    words.spots("BIAS_SPOTS", &scene.bias);
    words.spots("TARGET_SPOTS", &scene.targets);
    words.spots("MEMORY_SPOTS", &scene.memory);
    words.integers("MEMORY_OF", &scene.memory_of);
    words.filter(scene.period);
    words.spots("DISTURBANCE_SPOTS", &scene.disturbance);
    words.spots("REPORT_SPOTS", &scene.report);
    let gains = scene.gains().into_iter().map(|gain| gain.map_or("-1".to_owned(), |gain| gain.to_string()));
    words.table("int", "GAIN_OF", gains.collect());
}

fn walk(words: &mut Words, walker: &Walker) {
    let interface = &walker.interface;
    let (least_uprightness, least_height, posture) = walker.fall_limits();
    lead(words, walker.batch.settings().lead() as f32);
    for (name, value) in [
        ("ACTIONS", walker.joints.len()),
        ("GEOMS", walker.batch.contact_geoms().len()),
        ("FALL_GEOMS", walker.fall_geoms().len()),
        ("HAS_CLOCK", usize::from(interface.gait_frequency.is_some())),
        ("OBSERVATION", interface.observation_width()),
    ] {
        words.define(name, value);
    }
    for (name, value) in [("MIN_UPRIGHTNESS", least_uprightness), ("MIN_HEIGHT", least_height)] {
        words.define(name, single(value));
    }
    words.define("CONTROL_DT", double(interface.control_dt));
    words.define("GAIT_FREQUENCY", double(interface.gait_frequency.unwrap_or(0.0)));
    words.singles("POSTURE", &posture);
    words.integers("FALL_GEOM", walker.fall_geoms());
    words.integers("JOINT_OF", &walker.joints);
    words.singles("DEFAULT_POSE", &walker.default_pose);
    words.singles("ACTION_SCALE", &walker.action_scale);
    words.singles("ACTION_CLIP", &walker.action_clip);
    words.define("OTHER_JOINTS", walker.other_joints.len());
    words.integers("OTHER_JOINT", &walker.other_joints);
    let home: Vec<f32> = interface.default_pose.iter().map(|&angle| angle as f32).collect();
    words.singles("HOME", &home);
    words.quantities();
    let (mut place, mut parts) = (0, Vec::new());
    for (number, Term { quantity, .. }) in interface.observation.iter().enumerate() {
        let width = quantity.width(interface.joints.len());
        parts.extend((0..width).step_by(4).map(|from| format!("{{{number}, {from}}}")));
    }
    words.define("PARTS", parts.len());
    words.text.push_str("// Four numbers of a term.\nstruct Part {\n    int term, from;\n};\n");
    words.table("Part", "PART", parts);
    let terms = interface.observation.iter().map(|Term { quantity, .. }| {
        let (from, width) = (place, quantity.width(interface.joints.len()));
        place += width;
        format!("{{{}, {from}, {width}, 0.0f}}", *quantity as usize)
    });
    let terms = terms.collect();
    words.table("Term", "TERMS", terms);
    words.singles("SCALES", &interface.scales(&interface.observation));
}

/// Largest width of a layer's input or output, a multiple of 4.
pub(super) fn widest(policy: &Policy) -> usize {
    policy.actor.shape.widest().max(policy.actor.shape.inputs).next_multiple_of(4)
}

/// Where a layer's matrix and bias begin in the kernels' copy of a network.
struct Packed {
    layer: Layer,
    weight: usize,
    bias: usize,
}

/// A network's layers in the kernels' copy, and the copy's size: weights of four inputs of an output lie together.
fn packed(policy: &Policy) -> (Vec<Packed>, usize) {
    let (mut all, mut end) = (Vec::new(), 0);
    for layer in policy.actor.shape.layers() {
        let (weight, bias) = (end, end + layer.inputs.next_multiple_of(4) * layer.outputs);
        end = (bias + layer.outputs).next_multiple_of(4);
        all.push(Packed { layer, weight, bias });
    }
    (all, end)
}

/// The kernels' copy of a policy's network: layers, then the normaliser's factors and offsets.
pub(super) fn copied(policy: &Policy) -> Vec<f32> {
    let (layers, size) = packed(policy);
    let mut copy = vec![0.0; size];
    for Packed { layer, weight, bias } in layers {
        for (number, &value) in policy.actor.parameters[layer.weight.clone()].iter().enumerate() {
            let (input, output) = (number / layer.outputs, number % layer.outputs);
            copy[weight + (input / 4 * layer.outputs + output) * 4 + input % 4] = value;
        }
        copy[bias..bias + layer.outputs].copy_from_slice(&policy.actor.parameters[layer.bias.clone()]);
    }
    if let Some(normaliser) = &policy.normaliser {
        copy.extend(normaliser.scale().into_iter().flat_map(|(factor, offset)| [factor, offset]));
    }
    copy
}

fn network(words: &mut Words, policy: &Policy, rows: usize) {
    words.define("ROWS", rows);
    words.define("WIDEST", widest(policy));
    words.define(
        "ACTIVATION",
        match policy.actor.shape.activation {
            Activation::Elu => 0,
            Activation::Relu => 1,
            // `Tables::walk` refuses other functions.
            _ => 2,
        },
    );
    words.define("NORMALISED", usize::from(policy.normaliser.is_some()));
    let (layers, size) = packed(policy);
    words.define("NORMALISER", size);
    words.text.push_str("// Inputs by four.\nstruct Layer {\n    int quads, outputs, weight, bias;\n};\n");
    words.define("LAYERS", layers.len());
    let row = |Packed { layer, weight, bias }: &Packed| {
        format!("{{{}, {}, {weight}, {bias}}}", layer.inputs.div_ceil(4), layer.outputs)
    };
    words.table("Layer", "LAYER", layers.iter().map(row).collect());
}
