//! Position servos whose damping is given as a ratio (`dampratio`), and springs that are given by a time constant.
//!
//! MuJoCo 4.0 turns the ratio ζ into a velocity gain once, at the reference pose: kv = 2 ζ √(kp m / gear²),
//! where 1 / m is the joint's diagonal entry of the inverse mass matrix (`dof_invweight0`).

use crate::cholesky::Cholesky;
use crate::inertia::rotated;
use crate::joint_kind::{JointAxis, JointKind};
use crate::kinematics::{Frame, rest_frames};
use crate::model::{Joint, Model, Root};
use crate::rotation::{Vec3, dot, product};

/// Replaces positive third bias parameters of position-like actuators by the damping they stand for.
pub(crate) fn resolve_damping_ratios(model: &mut Model) {
    // MuJoCo marks a ratio so: a velocity bias above zero, where that of a damper is below.
    let is_ratio = |gain: f64, bias: [f64; 3]| gain == -bias[1] && bias[2] > 0.0;
    if !model.actuators.iter().any(|a| is_ratio(a.gain, a.bias)) {
        return;
    }
    let factor = factored_mass_matrix(model);
    // The joints' degrees of freedom come behind those of a floating base.
    let first_joint = model.nv() - model.joints.len();
    for actuator in &mut model.actuators {
        if is_ratio(actuator.gain, actuator.bias) {
            let gear2 = actuator.gear * actuator.gear;
            let inverse = factor.inverse_diagonal(first_joint + actuator.joint);
            // A transmission without leverage feels no inertia (MuJoCo's `mjMINVAL`).
            let inertia = if gear2 > 1e-15 { 1.0 / (inverse.max(1e-15) * gear2) } else { 0.0 };
            actuator.bias[2] *= -2.0 * (actuator.gain.abs() * inertia).sqrt();
        }
    }
}

/// Replaces negative stiffness and damping of joints, which stand for a spring's time constant T and damping ratio ζ
/// (`springdamper`), by k = I / (T² ζ²) and d = 2 I / T, with I the joint's inertia as above.
pub(crate) fn resolve_springs(model: &mut Model) {
    let given = |joint: &Joint| joint.stiffness < 0.0 && joint.damping < 0.0;
    if !model.joints.iter().any(given) {
        return;
    }
    let factor = factored_mass_matrix(model);
    let first_joint = model.nv() - model.joints.len();
    for (index, joint) in model.joints.iter_mut().enumerate().filter(|(_, joint)| given(joint)) {
        // The floors keep masses and time constants near 0 from a division by 0 (MuJoCo's `mjMINVAL`).
        let inertia = 1.0 / factor.inverse_diagonal(first_joint + index).max(1e-15);
        let (time, ratio) = (-joint.stiffness, -joint.damping);
        (joint.stiffness, joint.damping) =
            (inertia / (time * time * ratio * ratio).max(1e-15), 2.0 * inertia / time.max(1e-15));
    }
}

/// A degree of freedom, world frame.
struct Dof {
    body: usize,
    axis: JointAxis,
    armature: f64,
}

/// Factor of the dense mass matrix (nv × nv) with every joint at its reference: M = Σ m JvᵀJv + JωᵀIJω over the bodies
/// (Featherstone, Rigid Body Dynamics Algorithms, 2008, section 6.1), and armature on the diagonal.
fn factored_mass_matrix(model: &Model) -> Cholesky {
    let frames = rest_frames(model);
    let dofs = degrees_of_freedom(model, &frames);
    let count = dofs.len();
    let mut m = vec![0.0; count * count];
    // Each body adds to the degrees of freedom that carry it.
    for (index, body) in model.bodies.iter().enumerate() {
        let frame = &frames[index];
        let centre = frame.point(body.ipos);
        let [xx, yy, zz, xy, xz, yz] = rotated(body.inertia, product(frame.quaternion, body.iquat));
        let carried = dofs.iter().enumerate().filter(|(_, d)| is_ancestor(model, d.body, index));
        let columns: Vec<(usize, Vec3, Vec3)> =
            carried.map(|(k, d)| (k, d.axis.lever(centre), d.axis.turn())).collect();
        for &(i, velocity_i, spin_i) in &columns {
            let momentum: Vec3 =
                [dot([xx, xy, xz], spin_i), dot([xy, yy, yz], spin_i), dot([xz, yz, zz], spin_i)];
            for &(j, velocity_j, spin_j) in &columns {
                m[i * count + j] += body.mass * dot(velocity_i, velocity_j) + dot(momentum, spin_j);
            }
        }
    }
    for (k, dof) in dofs.iter().enumerate() {
        m[k * count + k] += dof.armature;
    }
    Cholesky::new(m, count)
}

fn degrees_of_freedom(model: &Model, frames: &[Frame]) -> Vec<Dof> {
    let mut dofs = Vec::with_capacity(model.nv());
    if let (Root::Floating, Some(base)) = (model.root, frames.first()) {
        let armature = model.free_joint.map_or(0.0, |free| free.armature);
        // A free joint: three translations, then three rotations, about the base's origin. Armature is alike on all.
        for kind in [JointKind::Slide, JointKind::Hinge] {
            for axis in [[1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]] {
                let axis = JointAxis { kind, axis, anchor: base.position };
                dofs.push(Dof { body: 0, axis, armature });
            }
        }
    }
    for joint in &model.joints {
        let axis = joint.axis_at(&frames[joint.body]);
        dofs.push(Dof { body: joint.body, axis, armature: joint.armature });
    }
    dofs
}

fn is_ancestor(model: &Model, ancestor: usize, mut body: usize) -> bool {
    // Depth first: a parent has a smaller number than its children.
    while body > ancestor {
        match model.bodies[body].parent {
            Some(parent) => body = parent,
            None => return false,
        }
    }
    body == ancestor
}
