//! A second forward kinematics, body by body from the model file's own frames, to hold the engine against.

use gaitfit_model::{JointKind, Model, Root};

type V = [f64; 3];
type Q = [f64; 4];

pub fn add(a: V, b: V) -> V {
    [a[0] + b[0], a[1] + b[1], a[2] + b[2]]
}

pub fn sub(a: V, b: V) -> V {
    [a[0] - b[0], a[1] - b[1], a[2] - b[2]]
}

pub fn scale(s: f64, a: V) -> V {
    a.map(|x| s * x)
}

pub fn cross(a: V, b: V) -> V {
    [a[1] * b[2] - a[2] * b[1], a[2] * b[0] - a[0] * b[2], a[0] * b[1] - a[1] * b[0]]
}

/// Hamilton product, wxyz.
pub fn product(a: Q, b: Q) -> Q {
    [
        a[0] * b[0] - a[1] * b[1] - a[2] * b[2] - a[3] * b[3],
        a[0] * b[1] + a[1] * b[0] + a[2] * b[3] - a[3] * b[2],
        a[0] * b[2] - a[1] * b[3] + a[2] * b[0] + a[3] * b[1],
        a[0] * b[3] + a[1] * b[2] - a[2] * b[1] + a[3] * b[0],
    ]
}

/// `v` turned by the unit quaternion `q`.
pub fn turn(q: Q, v: V) -> V {
    let p = product(product(q, [0.0, v[0], v[1], v[2]]), [q[0], -q[1], -q[2], -q[3]]);
    [p[1], p[2], p[3]]
}

/// World pose of every body at `qpos`.
pub fn poses(model: &Model, qpos: &[f64]) -> Vec<(V, Q)> {
    let floating = model.root == Root::Floating;
    let angles = &qpos[if floating { 7 } else { 0 }..];
    let mut poses: Vec<(V, Q)> = Vec::new();
    for (index, body) in model.bodies.iter().enumerate() {
        let (mut position, mut quat) = match body.parent {
            Some(parent) => {
                let (p, q) = poses[parent];
                (add(p, turn(q, body.pos)), product(q, body.quat))
            }
            None if floating => ([qpos[0], qpos[1], qpos[2]], [qpos[3], qpos[4], qpos[5], qpos[6]]),
            None => (body.pos, body.quat),
        };
        for (j, joint) in model.joints.iter().enumerate().filter(|(_, joint)| joint.body == index) {
            if joint.kind == JointKind::Slide {
                let by = angles[j] - joint.reference;
                position = add(position, turn(quat, joint.axis.map(|x| x * by)));
                continue;
            }
            // A hinge turns the body about its anchor, which stays where it is.
            let anchor = add(position, turn(quat, joint.pos));
            let (s, c) = (0.5 * (angles[j] - joint.reference)).sin_cos();
            quat = product(quat, [c, s * joint.axis[0], s * joint.axis[1], s * joint.axis[2]]);
            position = sub(anchor, turn(quat, joint.pos));
        }
        poses.push((position, quat));
    }
    poses
}

/// Total mass, kg.
pub fn mass(model: &Model) -> f64 {
    model.bodies.iter().map(|body| body.mass).sum()
}

/// Centre of mass of the whole robot, m, world.
pub fn center(model: &Model, qpos: &[f64]) -> V {
    let moments = model
        .bodies
        .iter()
        .zip(poses(model, qpos))
        .fold([0.0; 3], |sum, (body, (p, q))| add(sum, scale(body.mass, add(p, turn(q, body.ipos)))));
    scale(1.0 / mass(model), moments)
}

/// Gravitational and spring energy, J.
pub fn potential(model: &Model, qpos: &[f64]) -> f64 {
    let c = center(model, qpos);
    let g = model.options.gravity;
    let first = qpos.len() - model.joints.len();
    let springs = model.joints.iter().zip(&qpos[first..]);
    let springs: f64 = springs.map(|(j, q)| 0.5 * j.stiffness * (q - j.springref).powi(2)).sum();
    springs - mass(model) * (g[0] * c[0] + g[1] * c[1] + g[2] * c[2])
}

/// `M v`.
pub fn momenta(mass_matrix: &[f64], qvel: &[f64]) -> Vec<f64> {
    let n = qvel.len();
    (0..n).map(|i| (0..n).map(|k| mass_matrix[i * n + k] * qvel[k]).sum()).collect()
}

/// `½ vᵀ M v`, J.
pub fn kinetic(mass_matrix: &[f64], qvel: &[f64]) -> f64 {
    0.5 * momenta(mass_matrix, qvel).iter().zip(qvel).map(|(p, v)| p * v).sum::<f64>()
}

/// Linear momentum (world) and angular momentum about the centre of mass (world) of a floating robot.
pub fn momentum(model: &Model, mass_matrix: &[f64], qpos: &[f64], qvel: &[f64]) -> (V, V) {
    let p = momenta(mass_matrix, qvel);
    let linear = [p[0], p[1], p[2]];
    let about_base = turn([qpos[3], qpos[4], qpos[5], qpos[6]], [p[3], p[4], p[5]]);
    let arm = sub(center(model, qpos), [qpos[0], qpos[1], qpos[2]]);
    (linear, sub(about_base, cross(arm, linear)))
}
