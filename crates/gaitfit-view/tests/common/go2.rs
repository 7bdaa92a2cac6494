//! The Go2 of `assets/go2.xml` as a replay draws it, trotting along an invented path.
#![allow(clippy::unwrap_used)] // Test data: a panic is the report.

use gaitfit_view::gait::{FootTrack, GaitPicture, TorqueSpectrum, VelocityTrack};
use gaitfit_view::replay::{Body, Frame, Geom, Joint, ReplayRobot, Shape};
use roxmltree::{Document, Node};
use std::collections::HashMap;
use std::f64::consts::{PI, TAU};

pub const DT: f64 = 0.02;
const LINK: f64 = 0.213;
const HEIGHT: f64 = 0.30;
/// Stride frequency, Hz, and the share of it that a foot stands.
const FREQUENCY: f64 = 2.2;
const STANCE: f64 = 0.58;

/// Attributes by class and tag, inherited classes already merged in.
type Classes<'a> = HashMap<String, HashMap<&'a str, HashMap<&'a str, &'a str>>>;

fn read_classes<'a>(
    node: Node<'a, 'a>,
    inherited: &HashMap<&'a str, HashMap<&'a str, &'a str>>,
    to: &mut Classes<'a>,
) {
    let mut own = inherited.clone();
    for child in node.children().filter(|n| n.is_element() && !n.has_tag_name("default")) {
        let tag = own.entry(child.tag_name().name()).or_default();
        tag.extend(child.attributes().map(|a| (a.name(), a.value())));
    }
    // After the attributes of this class, because nested classes inherit all of them.
    for child in node.children().filter(|n| n.has_tag_name("default")) {
        read_classes(child, &own, to);
    }
    to.insert(node.attribute("class").unwrap_or("main").to_string(), own);
}

struct Reader<'a> {
    classes: Classes<'a>,
    robot: ReplayRobot,
}

impl<'a> Reader<'a> {
    fn attribute(&self, node: Node<'a, 'a>, class: &str, name: &str) -> Option<&'a str> {
        let class = node.attribute("class").unwrap_or(class);
        let inherited = || self.classes.get(class)?.get(node.tag_name().name())?.get(name).copied();
        node.attribute(name).or_else(inherited)
    }

    fn numbers<const N: usize>(
        &self,
        node: Node<'a, 'a>,
        class: &str,
        name: &str,
        default: [f64; N],
    ) -> [f64; N] {
        let mut numbers = default;
        let text = self.attribute(node, class, name).unwrap_or("");
        for (to, from) in numbers.iter_mut().zip(text.split_whitespace()) {
            *to = from.parse().unwrap();
        }
        numbers
    }

    fn body(&mut self, node: Node<'a, 'a>, parent: Option<usize>, class: &str) {
        // In MJCF a childclass holds for all bodies below, until another one replaces it.
        let class = node.attribute("childclass").unwrap_or(class);
        let index = self.robot.bodies.len();
        let joint = node.children().find(|n| n.has_tag_name("joint")).map(|n| Joint {
            name: n.attribute("name").unwrap().to_string(),
            axis: self.numbers(n, class, "axis", [0.0, 0.0, 1.0]),
            anchor: self.numbers(n, class, "pos", [0.0; 3]),
            index: self.robot.bodies.iter().filter(|b| b.joint.is_some()).count(),
            slides: false,
        });
        self.robot.bodies.push(Body {
            name: node.attribute("name").unwrap().to_string(),
            parent,
            position: self.numbers(node, class, "pos", [0.0; 3]),
            quaternion: self.numbers(node, class, "quat", [1.0, 0.0, 0.0, 0.0]),
            joint,
        });
        for geom in node.children().filter(|n| n.has_tag_name("geom")) {
            let size: [f64; 3] = self.numbers(geom, class, "size", [0.0; 3]);
            let [radius, half_length, _] = size;
            let name = geom.attribute("name").unwrap();
            let foot = name.strip_suffix("_foot").map(|leg| {
                self.robot.feet.push(leg.to_string());
                self.robot.feet.len() - 1
            });
            self.robot.geoms.push(Geom {
                body: index,
                shape: match self.attribute(geom, class, "type").unwrap() {
                    "box" => Shape::Box { half: size },
                    "sphere" => Shape::Sphere { radius },
                    "cylinder" => Shape::Cylinder { radius, half_length },
                    other => panic!("{other}"),
                },
                position: self.numbers(geom, class, "pos", [0.0; 3]),
                quaternion: self.numbers(geom, class, "quat", [1.0, 0.0, 0.0, 0.0]),
                foot,
            });
        }
        for child in node.children().filter(|n| n.has_tag_name("body")) {
            self.body(child, Some(index), class);
        }
    }
}

/// The robot without frames.
pub fn robot(name: &str) -> ReplayRobot {
    let path = concat!(env!("CARGO_MANIFEST_DIR"), "/../../assets/go2.xml");
    let text = std::fs::read_to_string(path).unwrap();
    let document = Document::parse(&text).unwrap();
    let mut classes = Classes::new();
    for node in document.root_element().children().filter(|n| n.has_tag_name("default")) {
        read_classes(node, &HashMap::new(), &mut classes);
    }
    let mut reader = Reader { classes, robot: ReplayRobot { name: name.into(), ..ReplayRobot::default() } };
    let base = document.descendants().find(|n| n.attribute("name") == Some("base")).unwrap();
    reader.body(base, None, "main");
    reader.robot
}

/// Phase of a foot in its stride, 0 … 1; it stands below [`STANCE`].
fn phase(time: f64, foot: usize) -> f64 {
    // In a trot diagonal legs step together: FL with RR, FR with RL.
    (time * FREQUENCY + if foot == 0 || foot == 3 { 0.0 } else { 0.5 }).fract()
}

/// Where the foot is below its hip: forward share of half a step, and height.
fn foot_path(phase: f64) -> (f64, f64) {
    if phase < STANCE {
        (1.0 - 2.0 * phase / STANCE, 0.0)
    } else {
        let swing = (phase - STANCE) / (1.0 - STANCE);
        (-(swing * PI).cos(), 0.06 * (swing * PI).sin().powi(2))
    }
}

/// Command at a time: walk, walk sideways, turn, stand.
fn command(time: f64) -> [f64; 3] {
    [[0.6, 0.0, 0.0], [0.5, 0.0, 0.8], [0.0, 0.3, 0.0], [0.8, 0.0, -0.5]][(time / 2.5) as usize % 4]
}

/// A trot of `count` frames; `skill` below one lags behind the command.
pub fn trot(name: &str, count: usize, skill: f64) -> ReplayRobot {
    let mut robot = robot(name);
    let (mut x, mut y, mut yaw) = (0.0, 0.0, 0.0_f64);
    let mut velocity = [0.0; 3];
    robot.frames = (0..count)
        .map(|i| {
            let time = i as f64 * DT;
            let asked = command(time);
            for (v, c) in velocity.iter_mut().zip(asked) {
                // A lag of first order: 0.08 of the rest in each frame of 20 ms is a time constant of 0.25 s.
                *v += 0.08 * (skill * c - *v);
            }
            // The base sways twice a stride, once for each pair of legs.
            let wobble = 0.03 * (TAU * 2.0 * FREQUENCY * time).sin();
            let measured = [velocity[0] + wobble, velocity[1] + 0.5 * wobble, velocity[2] - wobble];
            yaw += velocity[2] * DT;
            x += (velocity[0] * yaw.cos() - velocity[1] * yaw.sin()) * DT;
            y += (velocity[0] * yaw.sin() + velocity[1] * yaw.cos()) * DT;
            let roll = 0.02 * (TAU * FREQUENCY * time).sin();
            let (half, lean) = (yaw / 2.0, roll / 2.0);
            let joints = (0..4).flat_map(|foot| {
                let (forward, lift) = foot_path(phase(time, foot));
                let step = STANCE / FREQUENCY / 2.0;
                // Left feet have even numbers.
                let side = if foot % 2 == 0 { 1.0 } else { -1.0 };
                let along = (velocity[0] - side * velocity[2] * 0.15) * step * forward - 0.02;
                let across = (velocity[1] + if foot < 2 { 0.2 } else { -0.2 } * velocity[2]) * step * forward;
                let height = HEIGHT - 0.022 - lift;
                let reach = (along * along + height * height).sqrt();
                // Two links of one length: the law of cosines gives the knee, and half of its bend the hip.
                let knee = (1.0 - reach * reach / (2.0 * LINK * LINK)).clamp(-1.0, 1.0).acos();
                let hip = -(reach / (2.0 * LINK)).clamp(-1.0, 1.0).acos();
                let outward = (across / height).atan() + side * 0.05;
                [outward, (-along).atan2(height) - hip, knee - PI]
            });
            Frame {
                base_position: [x, y, HEIGHT + 0.006 * (TAU * 2.0 * FREQUENCY * time).cos()],
                // The product of a turn about z (yaw) and one about x (roll).
                base_quaternion: [
                    half.cos() * lean.cos(),
                    half.cos() * lean.sin(),
                    half.sin() * lean.sin(),
                    half.sin() * lean.cos(),
                ],
                joints: joints.collect(),
                contacts: (0..4).map(|foot| phase(time, foot) < STANCE).collect(),
                command: asked,
                velocity: measured,
            }
        })
        .collect();
    robot
}

/// The gait of the first `count` frames of a trot.
pub fn gait(count: usize) -> GaitPicture {
    let robot = trot("go2", count, 0.95);
    let feet = robot.feet.iter().enumerate().map(|(foot, name)| FootTrack {
        name: name.clone(),
        contact: robot.frames.iter().map(|f| f.contacts[foot]).collect(),
        height_m: (0..count).map(|i| foot_path(phase(i as f64 * DT, foot)).1).collect(),
    });
    let track = |k: usize| VelocityTrack {
        command: robot.frames.iter().map(|f| f.command[k]).collect(),
        measured: robot.frames.iter().map(|f| f.velocity[k]).collect(),
    };
    // Peaks at the step frequency and its multiples, above noise that falls off.
    let spectra = [("hip", 2.0), ("thigh", 5.0), ("calf", 9.0)].map(|(group, amplitude)| {
        let frequency_hz: Vec<f64> = (1..=128).map(|bin| bin as f64 * 200.0 / 256.0).collect();
        let peak = |f: f64, k: f64| (-((f - k * FREQUENCY) / 0.8).powi(2)).exp() / k.powi(4);
        let at = |f: f64| peak(f, 1.0) + peak(f, 2.0) + peak(f, 3.0) + 1e-3 / (1.0 + f * f / 100.0);
        let density = frequency_hz.iter().map(|&f| amplitude * amplitude * at(f)).collect();
        TorqueSpectrum { group: group.to_string(), slides: false, frequency_hz, density }
    });
    GaitPicture {
        time_s: (0..count).map(|i| i as f64 * DT).collect(),
        feet: feet.collect(),
        velocity: [track(0), track(1), track(2)],
        spectra: spectra.to_vec(),
    }
}
