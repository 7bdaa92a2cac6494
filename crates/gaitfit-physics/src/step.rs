//! One physics step, and a control period of them.

use crate::drive::Drive;
use crate::modify::JointModification;
use crate::phase;
use crate::smooth::smooth;
use crate::solver::{implicit_damping, solve};
use crate::state::{State, Work};
use crate::tree::Tree;
use crate::vec3::*;
use crate::{Damping, Params, Real};

/// Advances `state` by one physics step under the given drives (one a joint).
#[inline(always)]
pub fn step<T: Real>(
    tree: &Tree<T::K>,
    params: &Params<T>,
    drives: &[Drive<T>],
    state: &mut State<T>,
    work: &mut Work<T>,
) {
    accelerate(tree, params, drives, state, work);
    integrate(tree, state, work);
}

/// Accelerations of `state` under the given drives, warm-started from the accelerations it holds.
#[inline(always)]
pub fn accelerate<T: Real>(
    tree: &Tree<T::K>,
    params: &Params<T>,
    drives: &[Drive<T>],
    state: &mut State<T>,
    work: &mut Work<T>,
) {
    smooth(tree, params, state, drives, work);
    solve(tree, state, work);
}

/// Semi-implicit Euler from the accelerations just solved for.
#[inline(always)]
pub(crate) fn integrate<T: Real>(tree: &Tree<T::K>, state: &mut State<T>, work: &mut Work<T>) {
    let h = T::lit(tree.settings.timestep);
    // A copy: the state keeps the solver's own accelerations, from which the next step starts.
    let mut base = state.base_acceleration;
    let implicit = tree.settings.damping == Damping::Implicit;
    if implicit {
        let change = implicit_damping(tree, state, work);
        base = [add(base[0], change[0]), add(base[1], change[1])];
    }
    // Slices of one length, which is looked at once.
    let n = work.joints.len();
    let (qpos, qvel, qacc) = (&mut state.qpos[..n], &mut state.qvel[..n], &state.qacc[..n]);
    for j in 0..n {
        let mut a = qacc[j];
        if implicit {
            a = a + work.joints[j].step;
        }
        qvel[j] = h.fma(a, qvel[j]);
        // The new velocity moves the position: semi-implicit Euler, which is stable for stiff springs.
        qpos[j] = h.fma(qvel[j], qpos[j]);
    }
    if !tree.floating {
        return;
    }
    // The angular velocity is kept in body axes: its derivative is the world acceleration turned back.
    let rotation = quat_matrix(&state.base_quaternion);
    state.base_angular = axpy(h, rotate_back(&rotation, base[0]), state.base_angular);
    state.base_linear = axpy(h, base[1], state.base_linear);
    state.base_position = axpy(h, state.base_linear, state.base_position);
    // Turn by the vector w h: quaternion (cos t, sin t · w/|w|) with t = |w| h/2. The series in t² are exact to
    // rounding for t < 0.3 and to 3e-10 for t = 0.5; no square root, no branch at zero.
    let half = scale(T::lit(0.5) * h, state.base_angular);
    let t2 = dot(half, half);
    let s = t2.fma(T::lit(1.0 / 362_880.0), T::lit(-1.0 / 5_040.0));
    let s = t2.fma(t2.fma(t2.fma(s, T::lit(1.0 / 120.0)), T::lit(-1.0 / 6.0)), T::lit(1.0));
    let c = t2.fma(T::lit(1.0 / 40_320.0), T::lit(-1.0 / 720.0));
    let c = t2.fma(t2.fma(t2.fma(c, T::lit(1.0 / 24.0)), T::lit(-0.5)), T::lit(1.0));
    let v = scale(s, half);
    let q = quat_mul(&state.base_quaternion, &[c, v[0], v[1], v[2]]);
    // Newton's step for 1/√n from 1: n leaves 1 by rounding alone, and comes back from afar too (n < 3).
    let norm2 = q[0].fma(q[0], q[1].fma(q[1], q[2].fma(q[2], q[3] * q[3])));
    let inverse = norm2.fma(T::lit(-0.5), T::lit(1.5));
    state.base_quaternion = [q[0] * inverse, q[1] * inverse, q[2] * inverse, q[3] * inverse];
}

/// Everything one block of environments needs for a control period.
pub struct Period<'a, T: Real> {
    /// The compiled robot.
    pub tree: &'a Tree<T::K>,
    /// Parameters of the block's environments.
    pub params: &'a Params<T>,
    /// Sent position targets, newest first, `taps × joints` (rad). The newest are about to be sent, and become
    /// what modifications make of them.
    pub targets: &'a mut [T],
    /// Torques added to the PD torques after their limits, N·m, `substeps × joints`; empty for none.
    pub disturbance: &'a [T],
    /// Changes of what drives the joints.
    pub modifications: &'a [JointModification<T::K>],
    /// What they remember, [`memory_of`](crate::memory_of) numbers.
    pub memory: &'a mut [T],
    /// Physics steps in the period.
    pub substeps: usize,
    /// Motion state; advanced.
    pub state: &'a mut State<T>,
    /// Scratch.
    pub work: &'a mut Work<T>,
    /// Scratch for torques, one a joint.
    pub drives: &'a mut [Drive<T>],
}

/// Runs a control period: PD torques and one physics step, `substeps` times.
#[inline(always)]
pub fn control_period<T: Real>(p: &mut Period<'_, T>) {
    let (n, iterations) = (p.drives.len(), p.tree.settings.iterations);
    phase::begin(p);
    for substep in 0..p.substeps {
        let all = p.disturbance;
        // An empty list means that nothing disturbs; there is no row to cut from it.
        let disturbance = if all.is_empty() { all } else { &all[substep * n..][..n] };
        phase::before(p, T::lit(substep as f64), disturbance);
        for turn in 0..iterations {
            phase::iterate(p, turn + 1 == iterations);
        }
        phase::after(p);
    }
}
