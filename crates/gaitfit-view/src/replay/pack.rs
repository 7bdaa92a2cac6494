//! A replay as the page's script reads it: JSON with the motion in sixteen bits a number.

use super::{Frame, Geom, Ground, Replay, ReplayRobot, Shape};
use crate::format::clean;
use base64::{Engine, engine::general_purpose::STANDARD};
use serde::Serialize;

/// Largest code; a channel's range is spread over −32767 … 32767.
const LARGEST: f64 = i16::MAX as f64;

#[derive(Serialize)]
pub(super) struct Packed {
    dt: f64,
    robots: Vec<PackedRobot>,
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
    /// Half lengths; radius twice and half length for cylinders and capsules.
    size: [f64; 3],
    position: [f64; 3],
    quaternion: [f64; 4],
    /// −1 if it is no foot.
    foot: i64,
}

pub(super) fn pack(replay: &Replay) -> Packed {
    Packed { dt: replay.dt, robots: replay.robots.iter().map(robot).collect() }
}

fn robot(robot: &ReplayRobot) -> PackedRobot {
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
    let mut codes = Vec::with_capacity(robot.frames.len() * (joints + 13) * 2);
    let (mut offset, mut scale) = (Vec::new(), Vec::new());
    for mut channel in channels(&robot.frames, joints) {
        hold(&mut channel);
        let (low, high) = crate::chart::extent(channel.iter().copied()).unwrap_or((0.0, 0.0));
        let (low, high) = (low.max(-1e30), high.min(1e30));
        let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
        let step = if half > 0.0 { half / LARGEST } else { 1.0 };
        codes.extend(channel.iter().flat_map(|x| (((x - middle) / step).round() as i16).to_le_bytes()));
        offset.push(middle);
        scale.push(step);
    }
    let contacts: Vec<u8> =
        robot.frames.iter().flat_map(|f| f.contacts.iter().map(|touches| u8::from(*touches))).collect();
    PackedRobot {
        name: clean(&robot.name),
        bodies: bodies.collect(),
        geoms: robot.geoms.iter().map(geom).collect(),
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

fn ground(ground: &Ground) -> PackedGround {
    let (low, high) = crate::chart::extent(ground.heights.iter().copied()).unwrap_or((0.0, 0.0));
    let (low, high) = (low.max(-1e30), high.min(1e30));
    let (middle, half) = ((low + high) / 2.0, (high - low) / 2.0);
    let scale = if half > 0.0 { half / LARGEST } else { 1.0 };
    let code = |height: &f64| (((height - middle) / scale).round() as i16).to_le_bytes();
    let codes: Vec<u8> = ground.heights.iter().flat_map(code).collect();
    PackedGround {
        corner: ground.corner,
        step: ground.step,
        columns: ground.columns,
        offset: middle,
        scale,
        heights: STANDARD.encode(codes),
    }
}

fn geom(geom: &Geom) -> PackedGeom {
    let (shape, size) = match geom.shape {
        Shape::Box { half } => ("box", half),
        Shape::Sphere { radius } => ("sphere", [radius; 3]),
        Shape::Cylinder { radius, half_length } => ("cylinder", [radius, radius, half_length]),
        Shape::Capsule { radius, half_length } => ("capsule", [radius, radius, half_length]),
    };
    PackedGeom {
        body: geom.body,
        shape,
        size,
        position: geom.position,
        quaternion: geom.quaternion,
        foot: geom.foot.map_or(-1, |f| f as i64),
    }
}

/// The motion channel by channel, quaternions without jumps of sign so that frames can be blended.
fn channels(frames: &[Frame], joints: usize) -> Vec<Vec<f64>> {
    let mut channels = vec![Vec::with_capacity(frames.len()); joints + 13];
    let mut last = [1.0, 0.0, 0.0, 0.0];
    for frame in frames {
        let q = &frame.base_quaternion;
        let norm = q.iter().map(|x| x * x).sum::<f64>().sqrt();
        if norm.is_finite() && norm > 0.0 {
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
            let found = packed.offset + packed.scale * f64::from(code);
            assert!((found - wanted).abs() < 1.1 / 65534.0, "{k}: {found}, not {wanted}");
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
        let packed = super::robot(&robot);
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
