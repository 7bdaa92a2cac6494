//! Where a model's bodies sit in the links of the compiled tree.

use gaitfit_model::{Body, Model, Root};

use crate::tree::Axis;
use crate::vec3::*;

/// Where a body sits in its link.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Seat {
    pub link: usize,
    pub rotation: M3<f64>,
    pub position: V3<f64>,
}

/// A joint's link: parent link, anchor, turn, axis.
pub(crate) type Mount = (usize, V3<f64>, M3<f64>, Axis);

pub(crate) const IDENTITY: M3<f64> = [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]];

pub(crate) fn transpose(m: &M3<f64>) -> M3<f64> {
    [[m[0][0], m[1][0], m[2][0]], [m[0][1], m[1][1], m[2][1]], [m[0][2], m[1][2], m[2][2]]]
}

pub(crate) fn mat_mul(a: &M3<f64>, b: &M3<f64>) -> M3<f64> {
    let t = transpose(b);
    each3!(i => each3!(j => dot(a[i], t[j])))
}

/// The axis of a joint, and the rotation whose columns are a frame with that axis along it.
fn axis_frame(axis: V3<f64>) -> (Axis, M3<f64>) {
    // A joint along a coordinate axis needs no turn. The tolerance is for the rounding of a normalised axis.
    for (index, name) in [Axis::X, Axis::Y, Axis::Z].into_iter().enumerate() {
        if (axis[index] - 1.0).abs() < 1e-14 {
            return (name, IDENTITY);
        }
    }
    // z along the axis, x across it.
    // The coordinate axis furthest from the joint's makes the longest cross product.
    let smallest = if axis[0].abs() <= axis[1].abs() && axis[0].abs() <= axis[2].abs() {
        [1.0, 0.0, 0.0]
    } else if axis[1].abs() <= axis[2].abs() {
        [0.0, 1.0, 0.0]
    } else {
        [0.0, 0.0, 1.0]
    };
    let x = unit(cross(smallest, axis));
    let y = cross(axis, x);
    (Axis::Z, transpose(&[x, y, axis]))
}

pub(crate) fn unit(v: V3<f64>) -> V3<f64> {
    scale(1.0 / dot(v, v).sqrt(), v)
}

/// Seats of all bodies, and each joint's link constants (parent, anchor, turn, axis).
pub(crate) fn seats(model: &Model) -> (Vec<Seat>, Vec<Mount>) {
    let mut seats: Vec<Seat> = Vec::with_capacity(model.bodies.len());
    let mut mounts = Vec::with_capacity(model.joints.len());
    for (index, body) in model.bodies.iter().enumerate() {
        let pose = quat_matrix(&body.quat);
        let mut seat = match body.parent {
            Some(parent) => {
                let p: Seat = seats[parent];
                Seat {
                    link: p.link,
                    rotation: mat_mul(&p.rotation, &pose),
                    position: add(p.position, rotate(&p.rotation, body.pos)),
                }
            }
            // The floating base is link 0 itself; a fixed root hangs in the world, which is link 0.
            None if model.root == Root::Floating => Seat { link: 0, rotation: IDENTITY, position: [0.0; 3] },
            None => Seat { link: 0, rotation: pose, position: body.pos },
        };
        // Each joint of a body makes a link of its own; the body sits in the last one.
        for joint in model.joints.iter().filter(|joint| joint.body == index) {
            let anchor = add(seat.position, rotate(&seat.rotation, joint.pos));
            let (axis, frame) = axis_frame(joint.axis);
            mounts.push((seat.link, anchor, mat_mul(&seat.rotation, &frame), axis));
            // The body as the new link sees it.
            let back = transpose(&frame);
            // The frame is the joint's, so a body without further joints sits turned back in it.
            seat =
                Seat { link: mounts.len(), rotation: back, position: scale(-1.0, rotate(&back, joint.pos)) };
        }
        seats.push(seat);
    }
    (seats, mounts)
}

/// Body inertia about its centre of mass, body axes.
pub(crate) fn body_inertia(body: &Body) -> Sym3<f64> {
    let diagonal = [body.inertia[0], body.inertia[1], body.inertia[2], 0.0, 0.0, 0.0];
    sym_rotate(&quat_matrix(&body.iquat), &diagonal)
}

/// −1 for joints to the right of the base's middle plane at the reference pose (y below −1 mm), else 1.
pub(crate) fn sides(model: &Model) -> Vec<f64> {
    let (_, mounts) = seats(model);
    let mut poses = vec![([0.0; 3], IDENTITY)];
    for (parent, anchor, turn, _) in &mounts {
        let (position, rotation): (V3<f64>, M3<f64>) = poses[*parent];
        poses.push((add(position, rotate(&rotation, *anchor)), mat_mul(&rotation, turn)));
    }
    // Of a fixed root the links are in the world's axes.
    let base = &model.bodies[0];
    let (place, axes) = match model.root {
        Root::Floating => ([0.0; 3], IDENTITY),
        Root::Fixed => (base.pos, quat_matrix(&base.quat)),
    };
    let left = |position: V3<f64>| rotate_back(&axes, sub(position, place))[1];
    // A joint within 1 mm of the middle counts as left, so that rounding does not choose its side.
    poses[1..].iter().map(|(position, _)| if left(*position) < -1e-3 { -1.0 } else { 1.0 }).collect()
}
