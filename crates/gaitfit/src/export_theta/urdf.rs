//! The robot's URDF with the fitted numbers: friction and damping of joints, masses. URDF has no more.

use super::joint::JointNumbers;
use super::xml::{Edits, number, numbers, parse};
use super::{COMMON, link_kinds};
use crate::Error;
use gaitfit_model::Model;
use gaitfit_sim::Candidate;
use roxmltree::Node;

/// Kinds of parameters that the file says.
pub(super) fn said() -> Vec<&'static str> {
    let mut said = COMMON.to_vec();
    said.extend(["base_mass", "base_com_x", "base_com_y", "base_com_z"]);
    said.extend(link_kinds());
    said
}

/// The file's text with the fitted numbers.
pub(super) fn patched(
    text: &str,
    model: &Model,
    joints: &[JointNumbers],
    candidate: &Candidate,
) -> Result<String, Error> {
    let document = parse(text)?;
    let mut edits = Edits::default();
    let child = |node: Node<'_, '_>, name: &str| {
        node.children().find(|child| child.has_tag_name(name)).map(|child| child.id())
    };
    for (joint, own) in joints.iter().zip(&model.joints) {
        if joint.damping == own.damping && joint.frictionloss == own.frictionloss {
            continue;
        }
        let node = document
            .descendants()
            .find(|node| node.has_tag_name("joint") && node.attribute("name") == Some(joint.name.as_str()))
            .ok_or_else(|| Error::failed(format!("the robot's file has no joint `{}`", joint.name)))?;
        let (damping, friction) = (number(joint.damping), number(joint.frictionloss));
        match child(node, "dynamics").and_then(|id| document.get_node(id)) {
            Some(dynamics) => {
                edits.set(text, dynamics, "damping", &damping);
                edits.set(text, dynamics, "friction", &friction);
            }
            None => {
                let at = node.range().end - "</joint>".len();
                edits.insert(at, format!("  <dynamics damping=\"{damping}\" friction=\"{friction}\"/>\n  "));
            }
        }
    }
    let robot = &candidate.robot;
    let base = model.bodies.first().map_or("", |body| body.name.as_str());
    let link =
        document.descendants().find(|node| node.has_tag_name("link") && node.attribute("name") == Some(base));
    if let Some(inertial) = link.and_then(|link| document.get_node(child(link, "inertial")?)) {
        if robot.base_mass != 0.0
            && let Some(mass) = child(inertial, "mass").and_then(|id| document.get_node(id))
            && let Some([value]) = numbers(mass, "value").as_deref()
        {
            edits.set(text, mass, "value", &number(value + robot.base_mass));
        }
        if robot.base_com != [0.0; 3]
            && let Some(origin) = child(inertial, "origin").and_then(|id| document.get_node(id))
            && let Some([x, y, z]) = numbers(origin, "xyz").as_deref()
        {
            let [dx, dy, dz] = robot.base_com;
            edits.set(text, origin, "xyz", &[x + dx, y + dy, z + dz].map(number).join(" "));
        }
    }
    for (body, change) in model.bodies.iter().zip(robot.body_changes(model)).filter(|(_, one)| one.changed())
    {
        let link = document
            .descendants()
            .find(|node| node.has_tag_name("link") && node.attribute("name") == Some(body.name.as_str()));
        // A link without one has no mass that could change.
        let Some(inertial) = link.and_then(|link| document.get_node(child(link, "inertial")?)) else {
            continue;
        };
        let within = |name: &str| child(inertial, name).and_then(|id| document.get_node(id));
        for (name, attributes) in
            [("mass", &["value"][..]), ("inertia", &["ixx", "ixy", "ixz", "iyy", "iyz", "izz"])]
        {
            for attribute in attributes {
                if let Some(node) = within(name).filter(|_| change.factor != 1.0)
                    && let Some([value]) = numbers(node, attribute).as_deref()
                {
                    edits.set(text, node, attribute, &number(change.factor * value));
                }
            }
        }
        if change.shift != [0.0; 3] {
            match within("origin") {
                Some(origin) => {
                    let place = numbers(origin, "xyz").unwrap_or_else(|| vec![0.0; 3]);
                    let place: Vec<String> =
                        place.iter().zip(change.shift).map(|(place, shift)| number(place + shift)).collect();
                    edits.set(text, origin, "xyz", &place.join(" "));
                }
                None => {
                    let at = inertial.range().end - "</inertial>".len();
                    edits.insert(at, format!("<origin xyz=\"{}\"/>", change.shift.map(number).join(" ")));
                }
            }
        }
    }
    Ok(edits.apply(text))
}
