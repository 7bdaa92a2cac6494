//! The robot's MJCF with the fitted numbers.

use super::joint::JointNumbers;
use super::xml::{Edits, number, numbers, parse};
use super::{COMMON, link_kinds};
use gaitfit_adapt::JointParameter;
use gaitfit_model::Model;
use gaitfit_settings::Error;
use gaitfit_sim::Candidate;
use roxmltree::{Document, Node};

/// How a robot of several files becomes one file.
pub(super) const ONE_FILE: &str = "Save the robot as one file: python -c \"import mujoco; s = \
    mujoco.MjSpec.from_file('in.xml'); s.compile(); open('out.xml', 'w').write(s.to_xml())\"";

/// Kinds of parameters that the file says; a spring's torque only of joints with a stiffness
/// ([`JointNumbers::has_constant_torque`]).
pub(super) fn said(gains: bool, base: bool, links: bool) -> Vec<&'static str> {
    let mut said = COMMON.to_vec();
    said.extend(["armature", "stiffness", "spring_torque"]);
    if gains {
        said.extend(["encoder_bias", "torque_scale", "torque_offset", "kp_scale", "kd_scale"]);
    }
    if links {
        said.extend(link_kinds());
    }
    if base {
        said.extend([
            "base_mass",
            "base_com_x",
            "base_com_y",
            "base_com_z",
            "payload_mass",
            "payload_x",
            "payload_y",
            "payload_z",
        ]);
    }
    said
}

/// Whether the base's mass is a number in the file: an explicit inertial that the compiler takes as it is.
pub(super) fn says_base(text: &str, model: &Model) -> Result<bool, Error> {
    let document = parse(text)?;
    Ok(base_inertial(&document, model).is_some())
}

/// Whether the mass of every body whose link the fit changes is a number in the file.
pub(super) fn says_links(text: &str, model: &Model, candidate: &Candidate) -> Result<bool, Error> {
    let document = parse(text)?;
    let changes = candidate.robot.body_changes(model);
    let mut changed = model.bodies.iter().zip(&changes).filter(|(_, change)| change.changed());
    Ok(changed.all(|(body, _)| inertial(&document, &body.name).is_some()))
}

fn base_inertial<'a, 'i>(document: &'a Document<'i>, model: &Model) -> Option<Node<'a, 'i>> {
    inertial(document, &model.bodies.first()?.name)
}

/// A body's inertial that the compiler takes as it is.
fn inertial<'a, 'i>(document: &'a Document<'i>, name: &str) -> Option<Node<'a, 'i>> {
    // With these settings the compiler computes or scales masses, and the file's numbers are not the robot's.
    let scaled = compiler(document, "settotalmass")
        .is_some_and(|mass| mass.trim().parse::<f64>().is_ok_and(|mass| mass > 0.0));
    if scaled || compiler(document, "inertiafromgeom") == Some("true") {
        return None;
    }
    body(document, name)?.children().find(|node| node.has_tag_name("inertial"))
}

/// A setting of the compiler. Of several, the last one in the file counts, as in MuJoCo.
fn compiler<'a>(document: &'a Document<'_>, name: &str) -> Option<&'a str> {
    let mut sections = document.root_element().children().rev().filter(|node| node.has_tag_name("compiler"));
    sections.find_map(|node| node.attribute(name))
}

fn body<'a, 'i>(document: &'a Document<'i>, name: &str) -> Option<Node<'a, 'i>> {
    document.descendants().find(|node| node.has_tag_name("body") && node.attribute("name") == Some(name))
}

/// The file's text with the fitted numbers; with `gains` its actuators are PD controllers of position targets.
pub(super) fn patched(
    text: &str,
    model: &Model,
    joints: &[JointNumbers],
    candidate: &Candidate,
    gains: bool,
) -> Result<String, Error> {
    let document = parse(text)?;
    let mut edits = Edits::default();
    // MuJoCo takes angles in degrees unless the compiler says `radian`.
    let degrees = compiler(&document, "angle") != Some("radian");
    // What the file's flags switch off is 0 in the model; where the fit has some, it is switched on, and written for all.
    let flags: Vec<Node<'_, '_>> = document.descendants().filter(|node| node.has_tag_name("flag")).collect();
    let mut switch = |name: &str, needed: bool| {
        let off: Vec<_> = flags.iter().filter(|flag| flag.attribute(name) == Some("disable")).collect();
        for flag in off.iter().filter(|_| needed) {
            edits.set(text, **flag, name, "enable");
        }
        needed && !off.is_empty()
    };
    let friction = switch(
        "frictionloss",
        joints.iter().any(|joint| joint.frictionloss + joint.stiction + joint.load_friction != 0.0),
    );
    let needed = joints.iter().any(|joint| joint.damping != 0.0 || joint.has_spring);
    let [both, damper, spring] = ["passive", "damper", "spring"].map(|name| switch(name, needed));
    let passive = both || damper || spring;
    let switched = [("frictionloss", friction), ("damping", both || damper), ("stiffness", both || spring)];
    tendons(text, &document, &switched, &mut edits);
    // Only numbers that differ are written, so the file keeps its text and comments.
    for (j, (joint, own)) in joints.iter().zip(&model.joints).enumerate() {
        let fitted = [
            ("armature", joint.armature, own.armature, false),
            ("damping", joint.damping, own.damping, passive),
            ("frictionloss", joint.frictionloss, own.frictionloss, friction),
        ];
        let differ = fitted.into_iter().filter(|(_, value, before, anyway)| value != before || *anyway);
        let mut changes: Vec<(&str, f64)> = differ.map(|(name, value, ..)| (name, value)).collect();
        if joint.has_spring || passive {
            changes.push(("stiffness", joint.stiffness));
            // A slide's rest is a length: only hinges have degrees.
            let in_degrees = degrees && own.kind.is_hinge();
            let rest = joint.springref().map(|rest| if in_degrees { rest.to_degrees() } else { rest });
            changes.extend(rest.map(|rest| ("springref", rest)));
        }
        let driven = gains && (joint.kp != 0.0 || joint.kd != 0.0);
        let by_code = BY_NAME.iter().any(|one| candidate.robot.joints(*one)[j] != 0.0);
        let Some(node) = element(&document, &joint.name) else {
            // What stays as it is needs no element.
            if changes.is_empty() && !driven && !by_code {
                continue;
            }
            return Err(Error::failed(format!(
                "the robot's file has no element of its own for joint `{}`: it has no name there, or is in an included file. \
                 Give it a name. {ONE_FILE}",
                joint.name
            )));
        };
        for (name, value) in changes {
            edits.set(text, node, name, &number(value));
        }
    }
    base(text, &document, model, candidate, &mut edits);
    links(text, &document, model, candidate, &mut edits);
    if gains {
        actuators(text, &document, model, joints, &mut edits);
    }
    Ok(edits.apply(text))
}

/// What the code beside the robot's file does to a joint, which it finds by name.
const BY_NAME: [JointParameter; 6] = [
    JointParameter::Stiction,
    JointParameter::LoadFriction,
    JointParameter::Play,
    JointParameter::Compliance,
    JointParameter::EncoderBias,
    JointParameter::TorqueOffset,
];

/// A joint's element in the robot's own file.
fn element<'a, 'i>(document: &'a Document<'i>, name: &str) -> Option<Node<'a, 'i>> {
    // Elements `joint` of defaults, tendons and equalities are not joints of the tree.
    document.descendants().find(|node| {
        node.has_tag_name("joint")
            && node.attribute("name") == Some(name)
            && node.ancestors().any(|above| above.has_tag_name("worldbody"))
    })
}

/// Marks the joints that have no name in the file: its reader made up theirs.
pub(super) fn mark_unnamed(text: &str, joints: &mut [JointNumbers]) -> Result<(), Error> {
    let document = parse(text)?;
    // An included file may have a joint of such a name.
    if document.descendants().any(|node| node.has_tag_name("include")) {
        return Ok(());
    }
    for joint in joints {
        let number = joint.name.strip_prefix("joint").map(|rest| rest.trim_end_matches('_'));
        let made_up = number.is_some_and(|number| number.parse::<usize>().is_ok());
        joint.named = !made_up || element(&document, &joint.name).is_some();
    }
    Ok(())
}

/// Sets to 0 what flags had switched off in tendons: the fitted robot has no tendons, and what is switched on for
/// joints must not wake them.
fn tendons(text: &str, document: &Document<'_>, switched: &[(&str, bool)], edits: &mut Edits) {
    let sections = document.root_element().children().filter(|node| node.has_tag_name("tendon"));
    for tendon in sections.flat_map(|section| section.children()).filter(Node::is_element) {
        for (name, _) in switched.iter().filter(|(_, on)| *on) {
            edits.set(text, tendon, name, "0");
        }
    }
}

/// Mass and centre of mass of the base, and a load on it.
fn base(text: &str, document: &Document<'_>, model: &Model, candidate: &Candidate, edits: &mut Edits) {
    let (robot, Some(inertial)) = (&candidate.robot, base_inertial(document, model)) else { return };
    if robot.base_mass != 0.0
        && let Some([mass]) = numbers(inertial, "mass").as_deref()
    {
        edits.set(text, inertial, "mass", &number(mass + robot.base_mass));
    }
    if robot.base_com != [0.0; 3]
        && let Some([x, y, z]) = numbers(inertial, "pos").as_deref()
    {
        let [dx, dy, dz] = robot.base_com;
        let place = [x + dx, y + dy, z + dz].map(number).join(" ");
        edits.set(text, inertial, "pos", &place);
    }
    if robot.payload_mass > 0.0 {
        // A point has no inertia of its own; MuJoCo wants a little.
        let place = robot.payload_position.map(number).join(" ");
        let load = format!(
            "\n<body name=\"gaitfit_payload\" pos=\"{place}\"><inertial pos=\"0 0 0\" mass=\"{}\" diaginertia=\"1e-6 1e-6 \
             1e-6\"/></body>",
            number(robot.payload_mass)
        );
        edits.insert(inertial.range().end, load);
    }
}

/// Masses, inertias and centres of mass of links; all of them or none.
fn links(text: &str, document: &Document<'_>, model: &Model, candidate: &Candidate, edits: &mut Edits) {
    let changes = candidate.robot.body_changes(model);
    let changed = model.bodies.iter().zip(&changes).filter(|(_, change)| change.changed());
    let inertials: Option<Vec<_>> =
        // One link without an inertial element of its own leaves all to the remarks.
        changed.map(|(body, change)| Some((inertial(document, &body.name)?, change))).collect();
    for (inertial, change) in inertials.unwrap_or_default() {
        for name in ["mass", "diaginertia", "fullinertia"] {
            if let Some(numbers) = numbers(inertial, name).filter(|_| change.factor != 1.0) {
                let scaled: Vec<String> = numbers.iter().map(|one| number(change.factor * one)).collect();
                edits.set(text, inertial, name, &scaled.join(" "));
            }
        }
        if change.shift != [0.0; 3] {
            let place = numbers(inertial, "pos").unwrap_or_else(|| vec![0.0; 3]);
            let place: Vec<String> =
                place.iter().zip(change.shift).map(|(place, shift)| number(place + shift)).collect();
            edits.set(text, inertial, "pos", &place.join(" "));
        }
    }
}

/// Elements of actuators.
const ACTUATORS: [&str; 12] = [
    "general",
    "motor",
    "position",
    "velocity",
    "intvelocity",
    "damper",
    "cylinder",
    "muscle",
    "adhesion",
    "dcmotor",
    "orientation",
    "pid",
];

/// One PD controller a joint instead of the file's actuators, which keep their order and names:
/// torque = kp (target − q − bias) − kd q̇ + offset, clamped at the limit, with the fit's factors in kp and kd.
/// MuJoCo's affine actuator makes g · ctrl + b₀ + b₁ · q + b₂ · q̇, with g of `gainprm` and b of `biasprm`.
fn actuators(text: &str, document: &Document<'_>, model: &Model, joints: &[JointNumbers], edits: &mut Edits) {
    // One controller a joint: a file may have several actuators on one.
    let mut order: Vec<(usize, String)> = Vec::new();
    for actuator in &model.actuators {
        if order.iter().all(|(joint, _)| *joint != actuator.joint) {
            order.push((actuator.joint, actuator.name.clone()));
        }
    }
    // Joints that the file has no actuator for, but the fit has gains.
    for j in 0..joints.len() {
        let driven = joints[j].kp != 0.0 || joints[j].kd != 0.0;
        if driven && order.iter().all(|(joint, _)| *joint != j) {
            order.push((j, joints[j].name.clone()));
        }
    }
    keyframes(text, document, model, &order, edits);
    // What default classes say of actuators would change the controllers, also those that mjlab makes.
    let classes = document.descendants().filter(|node| node.has_tag_name("default"));
    for node in classes.flat_map(|class| class.children()) {
        if ACTUATORS.contains(&node.tag_name().name()) {
            edits.replace(node, String::new());
        }
    }
    let mut block = String::from("<actuator>");
    for (j, name) in order {
        let joint = &joints[j];
        // The bias of the encoder acts on the position term alone, so it is a constant torque.
        let constant = joint.torque_offset - joint.kp * joint.encoder_bias;
        let limit = match joint.torque_limit.is_finite() {
            true => format!(
                " forcelimited=\"true\" forcerange=\"{0:?} {1:?}\"",
                -joint.torque_limit, joint.torque_limit
            ),
            false => " forcelimited=\"false\"".to_owned(),
        };
        // Classes of an included file would change what is not written here.
        block.push_str(&format!(
            "\n    <general name=\"{}\" joint=\"{}\" gear=\"1\" dyntype=\"none\" gaintype=\"fixed\" \
             biastype=\"affine\" ctrllimited=\"false\" gainprm=\"{:?}\" biasprm=\"{:?} {:?} {:?}\"{limit}/>",
            escape(&name),
            escape(&joint.name),
            joint.kp,
            constant,
            -joint.kp,
            -joint.kd
        ));
    }
    block.push_str("\n  </actuator>");
    // A file may have several blocks of actuators: the first is replaced and the others go.
    let mut old = document.root_element().children().filter(|node| node.has_tag_name("actuator"));
    match old.next() {
        Some(first) => edits.replace(first, block),
        // Without a block of actuators, one is put before the end of the root element.
        None => edits.append(text, document.root_element(), format!("  {block}\n")),
    }
    old.for_each(|node| edits.replace(node, String::new()));
}

/// Controls of keyframes: the angles of the keyframe, because the controls were those of the file's actuators. `order`: the
/// joints of the controllers.
fn keyframes(
    text: &str,
    document: &Document<'_>,
    model: &Model,
    order: &[(usize, String)],
    edits: &mut Edits,
) {
    let count = model.joints.len();
    let sections = document.root_element().children().filter(|node| node.has_tag_name("keyframe"));
    for key in sections.flat_map(|section| section.children()) {
        if key.attribute("ctrl").is_none() {
            continue;
        }
        let stated = key.attribute("qpos").map(|_| numbers(key, "qpos").unwrap_or_default());
        let pose = stated.unwrap_or_else(|| model.joints.iter().map(|joint| joint.reference).collect());
        // The base's seven numbers come first. Other lengths are of a file with more than the robot.
        let angles = match pose.len().checked_sub(count) {
            Some(base @ (0 | 7)) => pose.get(base..),
            _ => None,
        };
        let controls: Option<Vec<String>> = angles.and_then(|angles| {
            order.iter().map(|(joint, _)| angles.get(*joint).copied().map(number)).collect()
        });
        match controls {
            Some(controls) => edits.set(text, key, "ctrl", &controls.join(" ")),
            // The file's controls would be wrong targets for the new controllers.
            None => edits.remove(key, "ctrl"),
        }
    }
}

fn escape(name: &str) -> String {
    // The ampersand first, as the others are written with one.
    name.replace('&', "&amp;").replace('<', "&lt;").replace('"', "&quot;")
}
