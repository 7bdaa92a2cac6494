//! A model as one MJCF file: without includes, meshes, default classes and whatever else it was read from.

use std::fmt::Write as _;

use crate::joint_kind::JointKind;
use crate::looks::SOURCE;
use crate::model::{Actuator, Cone, ContactPair, Coupling, Geom, Integrator, Joint, Model, Root, Shape};
use crate::rotation::IDENTITY;
use crate::spec::{SOLIMP, SOLREF};
use crate::terrain::{Ground, ObstacleShape};

/// Why a model is not written.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum WriteError {
    /// It has a height field.
    #[error("height field \"{0}\" cannot be written into the robot's file; take a scene with a flat floor")]
    HeightField(String),
}

impl Model {
    /// The robot as MJCF, which reads as this model again: the same tree, masses, joints, actuators, contacts with the ground,
    /// options, keyframes and sites. `comments` are lines at its beginning; `source` names the file with its meshes, as seen
    /// from the file that is written. Contacts are explicit pairs, so that no parameter is mixed; parts of the robot do not
    /// touch each other.
    ///
    /// # Errors
    /// A model with a height field.
    pub fn to_mjcf(&self, comments: &[String], source: Option<&str>) -> Result<String, WriteError> {
        let mut text = String::from("<?xml version=\"1.0\"?>\n");
        if !comments.is_empty() {
            text.push_str("<!--\n");
            for line in comments {
                // Two hyphens would end the comment. The second pass takes those that the first leaves of longer rows.
                let line = line.replace("--", "- -").replace("--", "- -");
                // Writing to a text cannot fail, so results are passed over here and below.
                let _ = writeln!(text, "  {line}");
            }
            text.push_str("-->\n");
        }
        let _ = writeln!(text, "<mujoco model={}>", quoted(&self.name));
        // Bodies state their masses, and geoms must not add to them.
        text.push_str("  <compiler angle=\"radian\" inertiafromgeom=\"false\"/>\n");
        self.write_options(&mut text);
        text.push_str("  <worldbody>\n");
        self.write_world(&mut text)?;
        self.write_bodies(&mut text);
        text.push_str("  </worldbody>\n");
        section(&mut text, "contact", self.pairs.iter().map(|pair| self.pair(pair)));
        section(&mut text, "actuator", self.actuators.iter().map(|actuator| self.actuator(actuator)));
        section(&mut text, "equality", self.couplings.iter().map(|coupling| self.coupling(coupling)));
        section(
            &mut text,
            "keyframe",
            self.keyframes.iter().map(|key| {
                let mut line = format!("<key name={}", quoted(&key.name));
                for (name, values) in [("qpos", &key.qpos), ("qvel", &key.qvel), ("ctrl", &key.ctrl)] {
                    if !values.is_empty() {
                        attribute(&mut line, name, values);
                    }
                }
                line + "/>"
            }),
        );
        // MJCF has no attribute for speed limits: they go into a tuple that the reader knows.
        let limits = self.joints.iter().filter_map(|joint| Some((joint, joint.velocity_limit?)));
        let limits: Vec<String> = limits
            .map(|(joint, limit)| {
                format!("  <element objtype=\"joint\" objname={} prm=\"{limit}\"/>", quoted(&joint.name))
            })
            .collect();
        let mut custom: Vec<String> =
            source.iter().map(|file| format!("<text name=\"{SOURCE}\" data={}/>", quoted(file))).collect();
        if !limits.is_empty() {
            custom.push("<tuple name=\"velocity_limit\">".to_owned());
            custom.extend(limits);
            custom.push("</tuple>".to_owned());
        }
        section(&mut text, "custom", custom.into_iter());
        text.push_str("</mujoco>\n");
        Ok(text)
    }

    fn write_options(&self, text: &mut String) {
        let options = &self.options;
        let cone = match options.cone {
            Cone::Pyramidal => "pyramidal",
            Cone::Elliptic => "elliptic",
        };
        let integrator = match options.integrator {
            Integrator::Euler => "Euler",
            Integrator::ImplicitFast => "implicitfast",
        };
        let mut line = "  <option".to_owned();
        attribute(&mut line, "timestep", &[options.timestep]);
        attribute(&mut line, "gravity", &options.gravity);
        attribute(&mut line, "impratio", &[options.impratio]);
        let _ = write!(
            line,
            " cone=\"{cone}\" integrator=\"{integrator}\" iterations=\"{}\" ls_iterations=\"{}\"",
            options.iterations, options.ls_iterations
        );
        text.push_str(&line);
        text.push_str(match options.eulerdamp {
            true => "/>\n",
            false => ">\n    <flag eulerdamp=\"disable\"/>\n  </option>\n",
        });
    }

    fn write_world(&self, text: &mut String) -> Result<(), WriteError> {
        for plane in &self.planes {
            // A plane without sizes has no end; the third number spaces the lines that a viewer draws, and MuJoCo
            // wants it above zero.
            let mut line = format!("    <geom name={} type=\"plane\" size=\"0 0 1\"", quoted(&plane.name));
            pose(&mut line, plane.pos, plane.quat);
            let _ = writeln!(text, "{line}/>");
        }
        for obstacle in &self.obstacles {
            let ObstacleShape::Box { half_size } = &obstacle.shape else {
                return Err(WriteError::HeightField(obstacle.name.clone()));
            };
            let mut line = format!("    <geom name={} type=\"box\"", quoted(&obstacle.name));
            attribute(&mut line, "size", half_size);
            pose(&mut line, obstacle.pos, obstacle.quat);
            let _ = writeln!(text, "{line}/>");
        }
        Ok(())
    }

    /// Bodies stand depth first: each closes when the next is no descendant of it.
    fn write_bodies(&self, text: &mut String) {
        // Bodies that are begun and not yet closed, from the root down.
        let mut open: Vec<usize> = Vec::new();
        let close = |text: &mut String, depth: usize| {
            let _ = writeln!(text, "{}</body>", "  ".repeat(depth + 2));
        };
        for (index, body) in self.bodies.iter().enumerate() {
            // Bodies that do not carry this one end here.
            while open.last().copied() != body.parent {
                if open.pop().is_none() {
                    break;
                }
                close(text, open.len());
            }
            let indent = "  ".repeat(open.len() + 2);
            let mut line = format!("{indent}<body name={}", quoted(&body.name));
            pose(&mut line, body.pos, body.quat);
            let _ = writeln!(text, "{line}>");
            let mut inner = |line: String| {
                let _ = writeln!(text, "{indent}  {line}");
            };
            if index == 0 && self.root == Root::Floating {
                inner(match &self.free_joint {
                    None => "<freejoint/>".to_owned(),
                    Some(free) => {
                        let mut line = "<joint type=\"free\"".to_owned();
                        attribute(&mut line, "armature", &[free.armature]);
                        attribute(&mut line, "damping", &[free.damping]);
                        attribute(&mut line, "frictionloss", &[free.frictionloss]);
                        attribute(&mut line, "solreffriction", &free.solref_friction);
                        attribute(&mut line, "solimpfriction", &free.solimp_friction);
                        line + "/>"
                    }
                });
            }
            // Without an inertial the frame of the masses is the body's own pose.
            let massless = body.mass == 0.0 && body.inertia == [0.0; 3];
            if !massless || (body.ipos, body.iquat) != (body.pos, body.quat) {
                let mut line = "<inertial".to_owned();
                attribute(&mut line, "pos", &body.ipos);
                if body.iquat != IDENTITY {
                    attribute(&mut line, "quat", &body.iquat);
                }
                attribute(&mut line, "mass", &[body.mass]);
                attribute(&mut line, "diaginertia", &body.inertia);
                inner(line + "/>");
            }
            self.joints.iter().filter(|joint| joint.body == index).for_each(|joint| inner(moving(joint)));
            self.geoms.iter().filter(|geom| geom.body == index).for_each(|geom| inner(solid(geom)));
            for site in self.sites.iter().filter(|site| site.body == index) {
                let mut line = format!("<site name={}", quoted(&site.name));
                pose(&mut line, site.pos, site.quat);
                inner(line + "/>");
            }
            open.push(index);
        }
        while open.pop().is_some() {
            close(text, open.len());
        }
    }

    fn pair(&self, pair: &ContactPair) -> String {
        let ground = match pair.ground {
            Ground::Plane(plane) => &self.planes[plane].name,
            Ground::Obstacle { obstacle } => &self.obstacles[obstacle].name,
        };
        let (first, second) = (quoted(ground), quoted(&self.geoms[pair.geom].name));
        let mut line = format!("<pair geom1={first} geom2={second} condim=\"{}\"", pair.condim);
        attribute(&mut line, "friction", &pair.friction);
        attribute(&mut line, "solref", &pair.solref);
        attribute(&mut line, "solimp", &pair.solimp);
        // Zeros say the same as no attribute: friction has the contact's `solref`.
        if pair.solreffriction != [0.0; 2] {
            attribute(&mut line, "solreffriction", &pair.solreffriction);
        }
        unless(&mut line, "margin", pair.margin, 0.0);
        unless(&mut line, "gap", pair.gap, 0.0);
        line + "/>"
    }

    fn coupling(&self, coupling: &Coupling) -> String {
        let name = |joint: usize| quoted(&self.joints[joint].name);
        let mut line = format!("<joint joint1={}", name(coupling.follower));
        if let Some(leader) = coupling.leader {
            let _ = write!(line, " joint2={}", name(leader));
        }
        attribute(&mut line, "polycoef", &coupling.polynomial);
        attribute(&mut line, "solref", &coupling.solref);
        attribute(&mut line, "solimp", &coupling.solimp);
        line + "/>"
    }

    fn actuator(&self, actuator: &Actuator) -> String {
        let Actuator { gain, bias, .. } = *actuator;
        // `position` takes no negative kp and kv.
        let position = bias[0] == 0.0 && bias[1] == -gain && gain >= 0.0 && bias[2] <= 0.0;
        let kind = match () {
            () if gain == 1.0 && bias == [0.0; 3] => "motor",
            () if position => "position",
            () => "general",
        };
        let joint = quoted(&self.joints[actuator.joint].name);
        let mut line = format!("<{kind} name={} joint={joint}", quoted(&actuator.name));
        match kind {
            "motor" => {}
            "position" => {
                attribute(&mut line, "kp", &[gain]);
                // Not `-bias[2]`: that would write −0 for 0.
                attribute(&mut line, "kv", &[0.0 - bias[2]]);
            }
            _ => {
                attribute(&mut line, "gainprm", &[gain]);
                line.push_str(" biastype=\"affine\"");
                attribute(&mut line, "biasprm", &bias);
            }
        }
        unless(&mut line, "gear", actuator.gear, 1.0);
        if let Some(range) = actuator.ctrlrange {
            attribute(&mut line, "ctrlrange", &range);
        }
        if let Some(range) = actuator.forcerange {
            attribute(&mut line, "forcerange", &range);
        }
        line + "/>"
    }
}

fn moving(joint: &Joint) -> String {
    let mut line = format!("<joint name={}", quoted(&joint.name));
    if joint.kind == JointKind::Slide {
        line.push_str(" type=\"slide\"");
    }
    if joint.pos != [0.0; 3] {
        attribute(&mut line, "pos", &joint.pos);
    }
    attribute(&mut line, "axis", &joint.axis);
    if let Some(range) = joint.range {
        attribute(&mut line, "range", &range);
        // A range of zeros would count as none.
        line.push_str(" limited=\"true\"");
    }
    for (name, value) in [
        ("ref", joint.reference),
        ("margin", joint.margin),
        ("armature", joint.armature),
        ("damping", joint.damping),
        ("frictionloss", joint.frictionloss),
        ("stiffness", joint.stiffness),
        ("springref", joint.springref),
    ] {
        unless(&mut line, name, value, 0.0);
    }
    if let Some(range) = joint.actuatorfrcrange {
        attribute(&mut line, "actuatorfrcrange", &range);
    }
    // Only what differs from MuJoCo's defaults is written.
    for (name, values) in [("solreflimit", joint.solref_limit), ("solreffriction", joint.solref_friction)] {
        if values != SOLREF {
            attribute(&mut line, name, &values);
        }
    }
    for (name, values) in [("solimplimit", joint.solimp_limit), ("solimpfriction", joint.solimp_friction)] {
        if values != SOLIMP {
            attribute(&mut line, name, &values);
        }
    }
    line + "/>"
}

fn solid(geom: &Geom) -> String {
    let mut line = format!("<geom name={} type=\"{}\"", quoted(&geom.name), geom.shape.name());
    match geom.shape {
        Shape::Sphere { radius } => attribute(&mut line, "size", &[radius]),
        Shape::Capsule { radius, half_length } | Shape::Cylinder { radius, half_length } => {
            attribute(&mut line, "size", &[radius, half_length]);
        }
        Shape::Box { half_size } => attribute(&mut line, "size", &half_size),
    }
    pose(&mut line, geom.pos, geom.quat);
    // The explicit pairs are all of the contacts.
    line + " contype=\"0\" conaffinity=\"0\"/>"
}

fn pose(line: &mut String, pos: [f64; 3], quat: [f64; 4]) {
    if pos != [0.0; 3] {
        attribute(line, "pos", &pos);
    }
    if quat != IDENTITY {
        attribute(line, "quat", &quat);
    }
}

fn attribute(line: &mut String, name: &str, values: &[f64]) {
    // `to_string` writes the fewest digits that read as the same number again.
    let words: Vec<String> = values.iter().map(|value| value.to_string()).collect();
    let _ = write!(line, " {name}=\"{}\"", words.join(" "));
}

fn unless(line: &mut String, name: &str, value: f64, usual: f64) {
    if value != usual {
        attribute(line, name, &[value]);
    }
}

fn section(text: &mut String, name: &str, lines: impl Iterator<Item = String>) {
    let lines: String = lines.map(|line| format!("    {line}\n")).collect();
    if !lines.is_empty() {
        let _ = write!(text, "  <{name}>\n{lines}  </{name}>\n");
    }
}

/// An attribute's value in quotes.
fn quoted(text: &str) -> String {
    let mut out = String::from("\"");
    for letter in text.chars() {
        match letter {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '"' => out.push_str("&quot;"),
            letter => out.push(letter),
        }
    }
    out.push('"');
    out
}
