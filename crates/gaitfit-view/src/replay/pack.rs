//! A replay as the page's script reads it: JSON with the motion in sixteen bits a number.

use super::{Frame, Geom, Ground, Mesh, Replay, ReplayRobot, Shape};
use crate::format::clean;
use base64::{Engine, engine::general_purpose::STANDARD};
use serde::Serialize;

/// Largest code; a channel's range is spread over −32767 … 32767, steps finer than a pixel shows.
const LARGEST: f64 = i16::MAX as f64;

/// How much larger the mesh of a foot is drawn. Otherwise the leg's mesh, which often has the same surface, hides its colour in
/// patches.
const FOOT: f64 = 1.04;

#[derive(Serialize)]
pub(super) struct Packed {
    dt: f64,
    robots: Vec<PackedRobot>,
    /// The meshes of all robots, each once.
    meshes: Vec<PackedMesh>,
}

#[derive(Serialize)]
struct PackedMesh {
    /// A coordinate is `offset + scale · code`.
    offset: [f64; 3],
    scale: [f64; 3],
    /// Codes, little-endian, base64: all x, then all y, then all z.
    vertices: String,
    /// Three corners a triangle, 16 bits each, little-endian, base64.
    triangles: String,
}

#[derive(Serialize)]
struct PackedRobot {
    name: String,
    bodies: Vec<PackedBody>,
    geoms: Vec<PackedGeom>,
    feet: Vec<String>,
    /// Frames and joint angles a frame.
    frames: usize,
    joints: usize,
    /// A channel's value is `offset + scale · code`. Channels are base position, base quaternion wxyz, joint angles,
    /// command and velocity.
    offset: Vec<f64>,
    scale: Vec<f64>,
    /// Codes, little-endian, base64: all frames of the first channel, then of the second, …
    motion: String,
    /// One byte a foot and frame, base64: all feet of the first frame, then of the second, …
    contacts: String,
    #[serde(skip_serializing_if = "Option::is_none")]
    ground: Option<PackedGround>,
}

#[derive(Serialize)]
struct PackedGround {
    corner: [f64; 2],
    step: f64,
    columns: usize,
    /// A height is `offset + scale · code`.
    offset: f64,
    scale: f64,
    /// Codes, little-endian, base64, as the heights lie.
    heights: String,
}

#[derive(Serialize)]
struct PackedBody {
    /// −1 for the base.
    parent: i64,
    position: [f64; 3],
    quaternion: [f64; 4],
    #[serde(skip_serializing_if = "Option::is_none")]
    joint: Option<PackedJoint>,
}

#[derive(Serialize)]
struct PackedJoint {
    axis: [f64; 3],
    anchor: [f64; 3],
    index: usize,
    #[serde(skip_serializing_if = "std::ops::Not::not")]
    slides: bool,
}

#[derive(Serialize)]
struct PackedGeom {
    body: usize,
    shape: &'static str,
    /// Half lengths; radius twice and half length for cylinders and capsules; factors of a mesh.
    size: [f64; 3],
    position: [f64; 3],
    quaternion: [f64; 4],
    /// −1 if it is no foot.
    foot: i64,
    /// Number of a mesh among the page's.
    #[serde(skip_serializing_if = "Option::is_none")]
    mesh: Option<usize>,
}

pub(super) fn pack(replay: &Replay) -> Packed {
    // Robots beside each other often share meshes: each is written once.
    let mut meshes: Vec<&Mesh> = Vec::new();
    let robots = replay.robots.iter().map(|one| {
        let places = one.meshes.iter().map(|mesh| {
            meshes.iter().position(|known| *known == mesh).unwrap_or_else(|| {
                meshes.push(mesh);
                meshes.len() - 1
            })
        });
        let places: Vec<usize> = places.collect();
        robot(one, &places)
    });
    Packed { dt: replay.dt, robots: robots.collect(), meshes: meshes.into_iter().map(mesh).collect() }
}

/// A robot; `meshes`: the page's numbers of its meshes.
fn robot(robot: &ReplayRobot, meshes: &[usize]) -> PackedRobot {
    let bodies = robot.bodies.iter().map(|b| PackedBody {
        parent: b.parent.map_or(-1, |p| p as i64),
        position: b.position,
        quaternion: b.quaternion,
        joint: b.joint.as_ref().map(|j| PackedJoint {
            axis: j.axis,
            anchor: j.anchor,
            index: j.index,
            slides: j.slides,
        }),
    });
    let joints = robot.frames.first().map_or(0, |f| f.joints.len());
    // Beside joints a frame has position (3), quaternion (4), command (3) and velocity (3), each of two bytes.
    let mut codes = Vec::with_capacity(robot.frames.len() * (joints + 13) * 2);
    let (mut offset, mut scale) = (Vec::new(), Vec::new());
    // Each channel has a range of its own, so two bytes resolve small motions as finely as large ones.
    for mut channel in channels(&robot.frames, joints) {
        hold(&mut channel);
        let (middle, step) = coded(&channel, &mut codes);
        offset.push(middle);
        scale.push(step);
    }
    let contacts: Vec<u8> =
        robot.frames.iter().flat_map(|f| f.contacts.iter().map(|touches| u8::from(*touches))).collect();
    PackedRobot {
        name: clean(&robot.name),
        bodies: bodies.collect(),
        geoms: robot.geoms.iter().map(|one| geom(one, meshes)).collect(),
        feet: robot.feet.iter().map(|f| clean(f)).collect(),
        frames: robot.frames.len(),
        joints,
        offset,
        scale,
        motion: STANDARD.encode(codes),
        contacts: STANDARD.encode(contacts),
        ground: robot.ground.as_ref().map(ground),
    }
}

/// Puts the codes of finite numbers behind `codes`; returns the offset and the scale with which they come back.
fn coded(values: &[f64], codes: &mut Vec<u8>) -> (f64, f64) {
    let (low, high) = crate::chart::extent(values.iter().copied()).unwrap_or((0.0, 0.0));
    // Half the range stays finite, and so do the codes.
    let (low, high) = (low.max(-1e30), high.min(1e30));
    let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
    // A constant channel has the code 0 everywhere.
    let scale = if half > 0.0 { half / LARGEST } else { 1.0 };
    codes.extend(values.iter().flat_map(|x| (((x - middle) / scale).round() as i16).to_le_bytes()));
    (middle, scale)
}

fn ground(ground: &Ground) -> PackedGround {
    let mut codes = Vec::new();
    let (offset, scale) = coded(&ground.heights, &mut codes);
    PackedGround {
        corner: ground.corner,
        step: ground.step,
        columns: ground.columns,
        offset,
        scale,
        heights: STANDARD.encode(codes),
    }
}

fn mesh(mesh: &Mesh) -> PackedMesh {
    let mut codes = Vec::new();
    let channels = [0, 1, 2].map(|k| {
        let along: Vec<f64> = mesh.vertices.iter().map(|vertex| vertex[k]).collect();
        coded(&along, &mut codes)
    });
    let corners: Vec<u8> = mesh.triangles.iter().flatten().flat_map(|corner| corner.to_le_bytes()).collect();
    PackedMesh {
        offset: channels.map(|(offset, _)| offset),
        scale: channels.map(|(_, scale)| scale),
        vertices: STANDARD.encode(codes),
        triangles: STANDARD.encode(corners),
    }
}

fn geom(geom: &Geom, meshes: &[usize]) -> PackedGeom {
    let (shape, size) = match geom.shape {
        Shape::Box { half } => ("box", half),
        // All shapes have three factors: the script scales a shape of unit size by them.
        Shape::Sphere { radius } => ("sphere", [radius; 3]),
        Shape::Cylinder { radius, half_length } => ("cylinder", [radius, radius, half_length]),
        Shape::Capsule { radius, half_length } => ("capsule", [radius, radius, half_length]),
        Shape::Mesh { .. } => ("mesh", [if geom.foot.is_some() { FOOT } else { 1.0 }; 3]),
    };
    let mesh = match geom.shape {
        Shape::Mesh { mesh } => meshes.get(mesh).copied(),
        _ => None,
    };
    PackedGeom {
        body: geom.body,
        shape,
        size,
        position: geom.position,
        quaternion: geom.quaternion,
        foot: geom.foot.map_or(-1, |f| f as i64),
        mesh,
    }
}

/// The motion channel by channel, quaternions without jumps of sign so that frames can be blended.
fn channels(frames: &[Frame], joints: usize) -> Vec<Vec<f64>> {
    let mut channels = vec![Vec::with_capacity(frames.len()); joints + 13];
    // No rotation, until there is a quaternion that can be normalised.
    let mut last = [1.0, 0.0, 0.0, 0.0];
    for frame in frames {
        let q = &frame.base_quaternion;
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        // A quaternion that cannot be normalised repeats the last one.
        if norm.is_finite() && norm > 0.0 {
            // q and −q are the same orientation.
            let along: f64 = q.iter().zip(&last).map(|(a, b)| a * b).sum();
            let sign = if along < 0.0 { -1.0 } else { 1.0 };
            last = q.map(|x| sign * x / norm);
        }
        let numbers = frame
            .base_position
            .iter()
            .chain(&last)
            .chain(&frame.joints)
            .chain(&frame.command)
            .chain(&frame.velocity);
        for (channel, x) in channels.iter_mut().zip(numbers) {
            channel.push(*x);
        }
    }
    channels
}

/// Replaces what is not finite by the last number that is, or the first to come, or zero.
fn hold(channel: &mut [f64]) {
    // A channel may begin with gaps; they get the first number that comes.
    let mut last = channel.iter().copied().find(|x| x.is_finite()).unwrap_or(0.0);
    for x in channel {
        if x.is_finite() {
            last = *x;
        } else {
            *x = last;
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used)] // A test that panics has failed.
mod tests {
    use super::*;

    fn unpack(packed: &PackedRobot, channel: usize, frame: usize) -> f64 {
        let bytes = STANDARD.decode(&packed.motion).unwrap();
        let at = 2 * (channel * packed.frames + frame);
        let code = i16::from_le_bytes([bytes[at], bytes[at + 1]]);
        packed.offset[channel] + packed.scale[channel] * f64::from(code)
    }

    #[test]
    fn heights_come_back_to_sixteen_bits_of_their_range() {
        let heights: Vec<f64> = (0..12).map(|k| 0.1 * f64::from(k) - 0.4).collect();
        let packed = ground(&Ground { columns: 4, step: 0.05, corner: [1.0, 2.0], heights: heights.clone() });
        let bytes = STANDARD.decode(&packed.heights).unwrap();
        assert_eq!(bytes.len(), 24);
        for (k, wanted) in heights.iter().enumerate() {
            let code = i16::from_le_bytes([bytes[2 * k], bytes[2 * k + 1]]);
            let height = packed.offset + packed.scale * f64::from(code);
            assert!((height - wanted).abs() < 1.1 / 65534.0, "{k}: {height}, not {wanted}");
        }
    }

    #[test]
    fn robots_share_equal_meshes() {
        let vertices: Vec<[f64; 3]> = (0..4).map(|k| [f64::from(k), -0.5 * f64::from(k * k), 2.0]).collect();
        let one = Mesh { vertices: vertices.clone(), triangles: vec![[0, 1, 2], [3, 2, 1]] };
        let other = Mesh { triangles: vec![[0, 1, 3]], ..one.clone() };
        let robot = |meshes: &[&Mesh]| ReplayRobot {
            meshes: meshes.iter().map(|&mesh| mesh.clone()).collect(),
            geoms: vec![Geom {
                body: 0,
                shape: Shape::Mesh { mesh: meshes.len() - 1 },
                position: [0.0; 3],
                quaternion: [1.0, 0.0, 0.0, 0.0],
                foot: None,
            }],
            ..ReplayRobot::default()
        };
        let packed =
            pack(&Replay { robots: vec![robot(&[&one]), robot(&[&other, &one])], ..Replay::default() });
        assert_eq!(packed.meshes.len(), 2);
        assert!(packed.robots.iter().all(|robot| robot.geoms[0].mesh == Some(0)), "the same of both");
        let (codes, corners) = (
            STANDARD.decode(&packed.meshes[0].vertices).unwrap(),
            STANDARD.decode(&packed.meshes[0].triangles).unwrap(),
        );
        assert_eq!(corners, [0, 0, 1, 0, 2, 0, 3, 0, 2, 0, 1, 0]);
        for (k, vertex) in vertices.iter().enumerate() {
            for (axis, wanted) in vertex.iter().enumerate() {
                let at = 2 * (axis * vertices.len() + k);
                let code = f64::from(i16::from_le_bytes([codes[at], codes[at + 1]]));
                let coordinate = packed.meshes[0].offset[axis] + packed.meshes[0].scale[axis] * code;
                assert!((coordinate - wanted).abs() < 5.0 / 65534.0, "{k}: {coordinate}, not {wanted}");
            }
        }
    }

    #[test]
    fn numbers_come_back_to_sixteen_bits_of_their_range() {
        let frame = |i: usize| Frame {
            base_position: [0.02 * i as f64, -1.0, 0.3],
            // The sign flips every other frame; the orientation does not.
            base_quaternion: [2.0, 0.0, 0.0, 0.0].map(|x| if i.is_multiple_of(2) { x } else { -x }),
            joints: vec![(i as f64 * 0.1).sin(), if i == 7 { f64::NAN } else { i as f64 }],
            contacts: vec![i.is_multiple_of(2)],
            command: [0.5, 0.0, -1.0],
            velocity: [f64::INFINITY; 3],
        };
        let robot = ReplayRobot {
            feet: vec!["FL".into()],
            frames: (0..500).map(frame).collect(),
            ..ReplayRobot::default()
        };
        let packed = super::robot(&robot, &[]);
        for i in [0, 1, 250, 499] {
            assert!((unpack(&packed, 0, i) - 0.02 * i as f64).abs() < 10.0 / 65534.0);
            assert!((unpack(&packed, 7, i) - (i as f64 * 0.1).sin()).abs() < 2.0 / 65534.0);
            assert_eq!(unpack(&packed, 3, i), 1.0, "the quaternion keeps its sign");
            assert_eq!(unpack(&packed, 9, i), 0.5);
            assert_eq!(unpack(&packed, 12, i), 0.0, "no number at all is zero");
        }
        assert!((unpack(&packed, 8, 7) - 6.0).abs() < 0.01, "a missing number repeats the last");
        assert_eq!(STANDARD.decode(&packed.contacts).unwrap()[..4], [1, 0, 1, 0]);
        assert_eq!(packed.offset.len(), 2 + 13);
    }
}
