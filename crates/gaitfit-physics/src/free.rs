//! What a floating base feels besides its inertia: armature, damping and dry friction of its free joint.
//!
//! MuJoCo has them alike on six degrees of freedom: velocities of the base's origin along the world's axes, and rates
//! about the base's own axes. Armature and damping are the same about any axes; dry friction is a row for each.
//! Vectors in "joint axes" are (rates about own axes, along the world's axes).

use crate::spatial::{V6, add6, axpy6, dot6, zero6};
use crate::state::{State, Work};
use crate::tree::Tree;
use crate::vec3::*;
use crate::{Damping, Params, Real};

/// Rows and Newton step of a free joint.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FreeWork<T> {
    /// Timestep times the damping that the integrator treats implicitly.
    pub implicit: T,
    /// D of the friction-loss rows: rotation, translation.
    pub friction_d: [T; 2],
    /// Minus D times aref, joint axes.
    pub friction_bias: V6<T>,
    /// Negative of the rows' forces, joint axes.
    pub row: V6<T>,
    /// Newton step, joint axes.
    pub step: V6<T>,
}

impl<T: Real> FreeWork<T> {
    pub fn zero() -> Self {
        let z = T::zero();
        Self { implicit: z, friction_d: [z; 2], friction_bias: zero6(), row: zero6(), step: zero6() }
    }
}

/// A motion vector in joint axes.
#[inline(always)]
fn in_joint_axes<T: Real>(rotation: &M3<T>, a: V6<T>) -> V6<T> {
    [rotate_back(rotation, a[0]), a[1]]
}

/// Adds armature and damping to the root's inertia and wrench, and makes the friction-loss rows.
#[inline(always)]
pub(crate) fn prepare<T: Real>(tree: &Tree<T::K>, params: &Params<T>, state: &State<T>, work: &mut Work<T>) {
    let Some(free) = &tree.free else { return };
    let settings = &tree.settings;
    let damping = T::k(free.damping);
    // As of a joint, see `joint_rows`.
    let explicit = settings.emulated_step.is_none() && !settings.centred;
    let h = T::lit(if explicit { settings.timestep } else { settings.drive_lead() });
    let implicit = if settings.damping == Damping::Explicit { T::zero() } else { h * damping };
    let folded = if settings.damping == Damping::Folded { implicit } else { T::zero() };
    let armature = T::k(free.armature) + folded;
    // Alike on all axes, armature adds to mass and to inertia about the base's origin, which is the reference
    // point.
    let node = &mut work.nodes[0];
    node.rigid.m = node.rigid.m + armature;
    for k in 0..3 {
        node.rigid.i[k] = node.rigid.i[k] + armature;
    }
    // The root's velocity is that without the boost.
    let velocity: V6<T> = [node.motion.velocity[0], state.base_linear];
    // The wrench is the residual at the present acceleration, so it holds the armature's part too.
    node.wrench = axpy6(armature, state.base_acceleration, axpy6(damping, velocity, node.wrench));
    let scratch = &mut work.free[0];
    scratch.implicit = implicit;
    let weight = T::k(free.friction_weight);
    // The parameters begin with translation, and the work begins with rotation.
    scratch.friction_d = [params.free[1] * weight, params.free[0] * weight];
    let b = T::k(free.friction_b);
    let rates: V6<T> = [state.base_angular, state.base_linear];
    for part in 0..2 {
        scratch.friction_bias[part] = scale(scratch.friction_d[part] * b, rates[part]);
    }
}

/// Adds the rows to the root's Hessian and residual; without `hessian` the integrator's damping instead of the Hessian.
#[inline(always)]
pub(crate) fn terms<T: Real>(tree: &Tree<T::K>, hessian: bool, state: &State<T>, work: &mut Work<T>) {
    let Some(free) = &tree.free else { return };
    let z = T::zero();
    let loss = T::k(free.frictionloss);
    let node = &mut work.nodes[0];
    let scratch = &mut work.free[0];
    let rotation = node.motion.rotation;
    let a = in_joint_axes(&rotation, state.base_acceleration);
    let mut weight: V6<T> = zero6();
    for part in 0..2 {
        let d = scratch.friction_d[part];
        for k in 0..3 {
            // Dry friction: proportional to the residual up to the loss, constant and without stiffness
            // beyond it.
            let slip = d.fma(a[part][k], scratch.friction_bias[part][k]);
            scratch.row[part][k] = slip.clamp_abs(loss);
            weight[part][k] = T::select_lt(slip.abs(), loss, d, z);
        }
    }
    node.residual = add6(node.residual, [rotate(&rotation, scratch.row[0]), scratch.row[1]]);
    if hessian {
        let [x, y, w] = weight[0];
        // Rows of rotation are about the base's own axes, the inertia is in world axes.
        let turned = sym_rotate(&rotation, &[x, y, w, z, z, z]);
        for k in 0..6 {
            node.inertia.aa[k] = node.inertia.aa[k] + turned[k];
        }
        for k in 0..3 {
            node.inertia.ll[k] = node.inertia.ll[k] + weight[1][k];
        }
    } else {
        for k in 0..3 {
            node.inertia.aa[k] = node.inertia.aa[k] + scratch.implicit;
            node.inertia.ll[k] = node.inertia.ll[k] + scratch.implicit;
        }
        node.residual = axpy6(scratch.implicit, state.base_acceleration, node.residual);
    }
}

/// Keeps the root's Newton step for the rows; returns the slope of their cost along it.
#[inline(always)]
pub(crate) fn steps<T: Real>(step: V6<T>, work: &mut Work<T>) -> T {
    let rotation = work.nodes[0].motion.rotation;
    let scratch = &mut work.free[0];
    scratch.step = in_joint_axes(&rotation, step);
    dot6(scratch.row, scratch.step)
}

/// `g` with the first and second derivative of the rows' cost at `alpha` along the step.
#[inline(always)]
pub(crate) fn along<T: Real>(
    tree: &Tree<T::K>,
    alpha: T,
    state: &State<T>,
    work: &Work<T>,
    g: (T, T),
) -> (T, T) {
    let Some(free) = &tree.free else { return g };
    let loss = T::k(free.frictionloss);
    let scratch = &work.free[0];
    let a =
        axpy6(alpha, scratch.step, in_joint_axes(&work.nodes[0].motion.rotation, state.base_acceleration));
    let mut g = g;
    for part in 0..2 {
        let d = scratch.friction_d[part];
        for k in 0..3 {
            let step = scratch.step[part][k];
            // The force of `terms` at this point of the line, and its derivative.
            let slip = d.fma(a[part][k], scratch.friction_bias[part][k]);
            g.0 = step.fma(slip.clamp_abs(loss), g.0);
            let curve = T::select_lt(slip.abs(), loss, d * step, T::zero());
            g.1 = curve.fma(step, g.1);
        }
    }
    g
}
