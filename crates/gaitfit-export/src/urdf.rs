//! The robot's URDF with the fitted numbers: friction and damping of joints, masses. URDF has no more.

use super::joint::JointNumbers;
use super::xml::{Edits, number, numbers, parse};
use super::{COMMON, link_kinds};
use gaitfit_model::Model;
use gaitfit_settings::Error;
use gaitfit_sim::Candidate;
use roxmltree::{Document, Node};

/// Kinds of parameters that the file says.
pub(super) fn said(text: &str, model: &Model) -> Result<Vec<&'static str>, Error> {
    let mut said = COMMON.to_vec();
    let document = parse(text)?;
    // Base links without mass of their own are common.
    let base = model.bodies.first().and_then(|body| inertial(&document, &body.name));
    if base.is_some_and(|inertial| inertial.children().any(|child| child.has_tag_name("mass"))) {
        said.extend(["base_mass", "base_com_x", "base_com_y", "base_com_z"]);
    }
    said.extend(link_kinds());
    Ok(said)
}

/// The inertial of a link.
fn inertial<'a, 'i>(document: &'a Document<'i>, link: &str) -> Option<Node<'a, 'i>> {
    let named = |node: &Node<'_, '_>| node.has_tag_name("link") && node.attribute("name") == Some(link);
    document.root_element().children().find(named)?.children().find(|child| child.has_tag_name("inertial"))
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
        // Joints that the fit left alone keep their text.
        if joint.damping == own.damping && joint.frictionloss == own.frictionloss {
            continue;
        }
        // Elements `joint` of transmissions and of `ros2_control` are not joints of the tree.
        let node = document
            .root_element()
            .children()
            .find(|node| node.has_tag_name("joint") && node.attribute("name") == Some(joint.name.as_str()))
            .ok_or_else(|| Error::failed(format!("the robot's file has no joint `{}`", joint.name)))?;
        let (damping, friction) = (number(joint.damping), number(joint.frictionloss));
        match child(node, "dynamics").and_then(|id| document.get_node(id)) {
            Some(dynamics) => {
                edits.set(text, dynamics, "damping", &damping);
                edits.set(text, dynamics, "friction", &friction);
            }
            None => {
                let dynamics = format!("  <dynamics damping=\"{damping}\" friction=\"{friction}\"/>\n  ");
                edits.append(text, node, dynamics);
            }
        }
    }
    let robot = &candidate.robot;
    let base = model.bodies.first().map_or("", |body| body.name.as_str());
    if let Some(inertial) = inertial(&document, base) {
        if robot.base_mass != 0.0
            && let Some(mass) = child(inertial, "mass").and_then(|id| document.get_node(id))
            && let Some([value]) = numbers(mass, "value").as_deref()
        {
            edits.set(text, mass, "value", &number(value + robot.base_mass));
        }
        if robot.base_com != [0.0; 3] {
            shift(text, inertial, robot.base_com, &mut edits);
        }
    }
    for (body, change) in model.bodies.iter().zip(robot.body_changes(model)).filter(|(_, one)| one.changed())
    {
        // A link without one has no mass that could change.
        let Some(inertial) = inertial(&document, &body.name) else { continue };
        let within = |name: &str| child(inertial, name).and_then(|id| document.get_node(id));
        for (name, attributes) in
            [("mass", &["value"][..]), ("inertia", &["ixx", "ixy", "ixz", "iyy", "iyz", "izz"])]
        {
            for attribute in attributes {
                // Mass and inertia grow by the same factor, as the shape stays.
                if let Some(node) = within(name).filter(|_| change.factor != 1.0)
                    && let Some([value]) = numbers(node, attribute).as_deref()
                {
                    edits.set(text, node, attribute, &number(change.factor * value));
                }
            }
        }
        if change.shift != [0.0; 3] {
            shift(text, inertial, change.shift, &mut edits);
        }
    }
    Ok(edits.apply(text))
}

/// Moves the centre of mass of an inertial by `by`, m, axes of the link.
fn shift(text: &str, inertial: Node<'_, '_>, by: [f64; 3], edits: &mut Edits) {
    // Without an origin the centre of mass is the link's own origin, by URDF.
    match inertial.children().find(|child| child.has_tag_name("origin")) {
        Some(origin) => {
            // An origin may state angles alone. Its place is then 0, by URDF.
            let place = numbers(origin, "xyz").unwrap_or_else(|| vec![0.0; 3]);
            let place: Vec<String> = place.iter().zip(by).map(|(place, by)| number(place + by)).collect();
            edits.set(text, origin, "xyz", &place.join(" "));
        }
        None => edits.append(text, inertial, format!("<origin xyz=\"{}\"/>", by.map(number).join(" "))),
    }
}
