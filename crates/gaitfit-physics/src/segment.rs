//! One segment of up to three joints in the Newton system.
//!
//! With the node's acceleration a and the joints' q̈ the segment's block of the system is
//! [H Fᵀ; F A] [q̈; a] = −[r; p]: H the joints' mass matrix with constraint Hessians, F their coupling to the
//! node, A and p the node's articulated inertia and residual wrench. Eliminating q̈ leaves A − F H⁻¹ Fᵀ and
//! p − F H⁻¹ r on the node.

use core::ops::Range;

use crate::Real;
use crate::coupling::{self, Terms};
use crate::separate::separate;
use crate::solver::set_step;
use crate::spatial::{Articulated, V6, add6, axpy6, dot6, dot6_add, merge6};
use crate::state::{JointWork, State, Work};
use crate::tree::{SEGMENT, Segment, Tree};
use crate::vec3::*;

/// How much of a Newton step is needed.
#[derive(Clone, Copy, PartialEq, Eq)]
pub(crate) enum Wanted {
    /// Accelerations alone.
    Step,
    /// Also what a line search or a further iteration reads.
    Everything,
}

/// The block of one segment while it is put together.
#[derive(Clone, Copy)]
struct Block<T> {
    /// 00, 11, 22, 10, 20, 21.
    h: [T; 6],
    f: [V6<T>; SEGMENT],
    r: [T; SEGMENT],
}

/// Place of element (k, i), k > i, in a packed symmetric 3 × 3 matrix.
#[inline(always)]
fn below(k: usize, i: usize) -> usize {
    2 + k + i
}

impl<T: Real> Block<T> {
    /// After a region that added to the block: see [`Real::merge`].
    #[inline(always)]
    fn merge(&mut self, guard: T::Guard, before: &Self) {
        merge_all(&mut self.h, guard, &before.h);
        merge_all(&mut self.r, guard, &before.r);
        for k in 0..SEGMENT {
            merge6(&mut self.f[k], guard, &before.f[k]);
        }
    }

    /// Adds an inertia and a residual wrench that the segment's link `member` carries.
    #[inline(always)]
    fn carry<const N: usize>(
        &mut self,
        member: usize,
        axis: &[V6<T>; SEGMENT],
        inertia: &Articulated<T>,
        wrench: V6<T>,
    ) {
        for k in 0..N {
            // Joints further out than the member do not move what it carries.
            if k <= member {
                let force = inertia.mul(axis[k]);
                self.f[k] = add6(self.f[k], force);
                self.h[k] = dot6_add(axis[k], force, self.h[k]);
                for i in 0..k {
                    self.h[below(k, i)] = dot6_add(axis[i], force, self.h[below(k, i)]);
                }
                self.r[k] = dot6_add(axis[k], wrench, self.r[k]);
            }
        }
    }
}

/// Eliminates segment `index` onto its node; returns rᵀH⁻¹r, its part of the squared Newton decrement.
#[inline(always)]
pub(crate) fn eliminate<T: Real>(
    tree: &Tree<T::K>,
    (index, segment): (usize, &Segment),
    hessian: bool,
    state: &State<T>,
    work: &mut Work<T>,
) -> T {
    match segment.len {
        1 => eliminate_joints::<T, 1>(tree, (index, segment), hessian, state, work),
        2 => eliminate_joints::<T, 2>(tree, (index, segment), hessian, state, work),
        // A segment has at most `SEGMENT` joints, which is 3.
        _ => eliminate_joints::<T, 3>(tree, (index, segment), hessian, state, work),
    }
}

/// As [`eliminate`], of a segment of `N` joints.
#[inline(always)]
fn eliminate_joints<T: Real, const N: usize>(
    tree: &Tree<T::K>,
    (index, segment): (usize, &Segment),
    hessian: bool,
    state: &State<T>,
    work: &mut Work<T>,
) -> T {
    let joints = segment.first - 1..segment.first - 1 + N;
    let (curvatures, rows) = joint_rows::<T, N>(joints.clone(), hessian, state, work);
    // The block begins with the segment's mass matrix. Rows, self-contacts, couplings, what hangs on it and
    // contacts add to it.
    let scratch = &work.segments[index];
    let mut block = Block { h: scratch.mass, f: scratch.force, r: scratch.residual };
    for k in 0..N {
        block.h[k] = block.h[k] + curvatures[k];
        block.r[k] = block.r[k] + rows[k];
    }
    if !tree.self_contact.is_empty() {
        let torques = &work.self_contact.torque[joints];
        for k in 0..N {
            block.r[k] = block.r[k] + torques[k];
        }
    }
    if !segment.couplings.is_empty() {
        let (h, r) = couplings(tree, index, hessian, state, work);
        // By constant places: others would keep the block in memory for all robots.
        for k in 0..h.len() {
            block.h[k] = block.h[k] + h[k];
        }
        for k in 0..N {
            block.r[k] = block.r[k] + r[k];
        }
    }
    // Segments further out have been eliminated onto this node already. Its inertia is moved by the segment's
    // joints and, about the same reference point, by the parent.
    if let Some(node) = segment.node {
        let (inertia, residual) = (work.nodes[node].inertia, work.nodes[node].residual);
        block.carry::<N>(N - 1, &work.segments[index].axis, &inertia, residual);
        let parent = &mut work.nodes[segment.parent];
        parent.inertia.add(&inertia);
        parent.residual = add6(parent.residual, residual);
    }
    segment_contacts::<T, N>(tree, (index, segment), hessian, &mut block, work);
    let Block { h, f, r } = block;

    // LDLᵀ of H, applied to [Fᵀ | r] on the way.
    let out = &mut work.segments[index];
    // H is a mass matrix plus positive terms, so the factorisation needs no exchange of rows.
    let (mut y, mut e, mut d) = (f, r, r);
    d[0] = h[0].recip();
    if N > 1 {
        let l10 = h[3] * d[0];
        d[1] = l10.fnma(h[3], h[1]).recip();
        y[1] = axpy6(-l10, y[0], f[1]);
        e[1] = l10.fnma(e[0], r[1]);
        out.lower[0] = l10;
        if N > 2 {
            let l20 = h[4] * d[0];
            let t = l20.fnma(h[3], h[5]);
            let l21 = t * d[1];
            d[2] = l21.fnma(t, l20.fnma(h[4], h[2])).recip();
            y[2] = axpy6(-l21, y[1], axpy6(-l20, y[0], f[2]));
            e[2] = l21.fnma(e[1], l20.fnma(e[0], r[2]));
            out.lower[1] = l20;
            out.lower[2] = l21;
        }
    }
    let parent = &mut work.nodes[segment.parent];
    // A − F H⁻¹ Fᵀ and p − F H⁻¹ r, one outer product a joint.
    let (mut z, mut part, mut residual) = (y, T::zero(), parent.residual);
    for k in 0..N {
        let solved = d[k] * e[k];
        part = e[k].fma(solved, part);
        out.coupling[k] = y[k];
        out.inverse[k] = d[k];
        out.solved[k] = solved;
        // y is L⁻¹F and z is D⁻¹L⁻¹F: their outer products sum up to F H⁻¹ Fᵀ.
        z[k] = times(d[k], y[k]);
        residual = axpy6(-solved, y[k], residual);
    }
    parent.residual = residual;
    parent.inertia.sub_outers::<N>(&y, &z);
    part
}

#[inline(always)]
fn times<T: Real>(s: T, v: V6<T>) -> V6<T> {
    [scale(s, v[0]), scale(s, v[1])]
}

/// Hessians and negative torques of the rows of the `N` joints of a segment; without `hessian` the integrator's damping
/// instead.
#[inline(always)]
fn joint_rows<T: Real, const N: usize>(
    joints: Range<usize>,
    hessian: bool,
    state: &State<T>,
    work: &mut Work<T>,
) -> ([T; N], [T; N]) {
    let (limited, accelerations) = (&work.limited[joints.clone()], &state.qacc[joints.clone()]);
    let joints = &mut work.joints[joints];
    let (mut curvatures, mut rows) = ([T::zero(); N], [T::zero(); N]);
    for k in 0..N {
        (curvatures[k], rows[k]) = joint_row(&mut joints[k], limited[k], accelerations[k]);
    }
    // The integrator's matrix M + h·B has the dampers' curvature in place of the rows'.
    if !hessian {
        for k in 0..N {
            curvatures[k] = joints[k].implicit;
            rows[k] = joints[k].implicit.fma(accelerations[k], rows[k]);
        }
    }
    (curvatures, rows)
}

/// Hessian and negative torque of a joint's rows.
#[inline(always)]
pub(crate) fn joint_row<T: Real>(joint: &mut JointWork<T>, limited: T::Guard, qacc: T) -> (T, T) {
    let z = T::zero();
    let slip = joint.friction_d.fma(qacc, joint.friction_bias);
    let loss = joint.frictionloss;
    let mut row = slip.clamp_abs(loss);
    // Beyond the loss the friction is constant, so it has no curvature there.
    let mut curvature = T::select_lt(slip.abs(), loss, joint.friction_d, z);
    if T::enter(limited) {
        let gap = joint.limit_sign.fma(qacc, joint.limit_bias);
        let d = T::select_lt(gap, z, joint.limit_d, z);
        let with_limit = ((joint.limit_sign * d).fma(gap, row), curvature + d);
        T::leave(limited);
        row = with_limit.0.merge(limited, row);
        curvature = with_limit.1.merge(limited, curvature);
    }
    joint.row = row;
    (curvature, row)
}

separate! {
    /// What the couplings of segment `index` add to its block: to the packed matrix, and to the residuals.
    fn couplings<T>(
        tree: &Tree<T::K>,
        index: usize,
        hessian: bool,
        state: &State<T>,
        work: &mut Work<T>,
    ) -> ([T; 6], [T; SEGMENT]) {
        let segment = &tree.segments[index];
        let first = segment.first - 1;
        let (mut h, mut r) = ([T::zero(); 6], [T::zero(); SEGMENT]);
        for number in segment.couplings.clone() {
            let Terms { torques, hessian: elements } = coupling::near_terms(tree, number, state, work);
            for (joint, torque) in torques.into_iter().flatten() {
                r[joint - first] = r[joint - first] + torque;
            }
            for (k, i, element) in elements.into_iter().flatten().filter(|_| hessian) {
                let place = if k == i { k - first } else { below(k - first, i - first) };
                h[place] = h[place] + element;
            }
        }
        (h, r)
    }
}

/// Adds the contacts of the segment's links to its block.
#[inline(always)]
fn segment_contacts<T: Real, const N: usize>(
    tree: &Tree<T::K>,
    (index, segment): (usize, &Segment),
    hessian: bool,
    block: &mut Block<T>,
    work: &Work<T>,
) {
    let axis = &work.segments[index].axis;
    let (all, pairs, points, spins) = (&tree.pairs[..], &work.pairs[..], &work.points[..], &work.spins[..]);
    for number in segment.pairs.clone() {
        let (pair, active) = (&all[number], pairs[number].active);
        if !T::enter(active) {
            continue;
        }
        let before = *block;
        for (place, point) in points[pair.points.clone()].iter().enumerate() {
            // With spin a contact has a 6 × 6 Hessian; without, one of three dimensions at its point, which
            // is cheaper.
            if pair.condim > 3 {
                let (wrench, inertia) = &spins[pair.spin + place];
                let inertia = if hessian { *inertia } else { Articulated::zero() };
                block.carry::<N>(pair.member, axis, &inertia, *wrench);
                continue;
            }
            for k in 0..N {
                // Joints of the segment further out do not move this link.
                if k <= pair.member {
                    let g = point.columns[k];
                    block.r[k] = dot_add(g, point.world_force, block.r[k]);
                    if hessian {
                        let y = sym_mul(&point.weight, g);
                        block.f[k] = [cross_add(point.x, y, block.f[k][0]), add(block.f[k][1], y)];
                        block.h[k] = dot_add(g, y, block.h[k]);
                        for i in 0..k {
                            let place = below(k, i);
                            block.h[place] = dot_add(point.columns[i], y, block.h[place]);
                        }
                    }
                }
            }
        }
        T::leave(active);
        block.merge(active, &before);
    }
}

/// Joint steps of segment `index` from its node's step; unless this is all that is `wanted`, also those of its
/// contacts and the change of its residuals. Returns the slope of its rows' cost along the step and the curvature
/// pᵀMp of its part of the smooth cost. `corrected`: a guard; in its region the joint steps that stand in `work` were
/// corrected, and are kept where it is active.
#[inline(always)]
pub(crate) fn back_substitute<T: Real>(
    tree: &Tree<T::K>,
    (index, segment): (usize, &Segment),
    wanted: Wanted,
    corrected: Option<T::Guard>,
    work: &mut Work<T>,
) -> (T, T) {
    match segment.len {
        1 => substitute_joints::<T, 1>(tree, (index, segment), wanted, corrected, work),
        2 => substitute_joints::<T, 2>(tree, (index, segment), wanted, corrected, work),
        _ => substitute_joints::<T, 3>(tree, (index, segment), wanted, corrected, work),
    }
}

/// As [`back_substitute`], of a segment of `N` joints.
#[inline(always)]
fn substitute_joints<T: Real, const N: usize>(
    tree: &Tree<T::K>,
    (index, segment): (usize, &Segment),
    wanted: Wanted,
    corrected: Option<T::Guard>,
    work: &mut Work<T>,
) -> (T, T) {
    // Slices, looked up once: the compiler would load their addresses again after every store.
    let (all, pairs) = (&tree.pairs[..], &work.pairs[..]);
    let (nodes, points) = (&mut work.nodes[..], &mut work.points[..]);
    let joints = &mut work.joints[segment.first - 1..segment.first - 1 + N];
    let scratch = &mut work.segments[index];
    let above = nodes[segment.parent].step;
    let mut step = [T::zero(); SEGMENT];
    // q̈ = −H⁻¹ (r + Fᵀ a), by the transposed factor: the last joint first.
    for k in (0..N).rev() {
        let mut s = scratch.inverse[k].fnma(dot6(scratch.coupling[k], above), -scratch.solved[k]);
        for i in k + 1..N {
            s = scratch.lower[i + k - 1].fnma(step[i], s);
        }
        step[k] = s;
    }
    // Where own parts touch, the step corrected for them stays; the tree alone would lack their Hessian.
    if let Some(touching) = corrected
        && T::enter(touching)
    {
        // Nothing is computed here: what the region made is only merged below.
        T::leave(touching);
        for k in 0..N {
            step[k] = joints[k].step.merge(touching, step[k]);
        }
    }
    for k in 0..N {
        joints[k].step = step[k];
    }
    if let Some(node) = segment.node {
        // The node at the segment's far end moves with the near one and with all joints between them.
        let mut a = above;
        for k in 0..N {
            a = axpy6(step[k], scratch.axis[k], a);
        }
        nodes[node].step = a;
    }
    let (mut slope, mut curvature) = (T::zero(), T::zero());
    // The rest serves the line search and the residuals of a further iteration.
    if wanted == Wanted::Step {
        return (slope, curvature);
    }
    let parent = &mut nodes[segment.parent];
    let mut wrench = parent.step_wrench;
    for k in 0..N {
        wrench = axpy6(step[k], scratch.force[k], wrench);
        // Row k of M p: what a full step adds to the residual.
        let mut change = scratch.mass[k].fma(step[k], dot6(scratch.force[k], above));
        for i in 0..N {
            if i != k {
                change = scratch.mass[below(k.max(i), k.min(i))].fma(step[i], change);
            }
        }
        scratch.step_residual[k] = change;
        curvature = change.fma(step[k], curvature);
        slope = joints[k].row.fma(step[k], slope);
    }
    parent.step_wrench = wrench;
    if let Some(node) = segment.node {
        let node = &mut nodes[node];
        node.step_wrench = node.rigid.mul(node.step);
    }
    for number in segment.pairs.clone() {
        let (pair, active) = (&all[number], pairs[number].active);
        if !T::enter(active) {
            continue;
        }
        let before = slope;
        for point in &mut points[pair.points.clone()] {
            let mut linear = cross_add(above[0], point.x, above[1]);
            let mut angular = above[0];
            for k in 0..N {
                if k <= pair.member {
                    linear = axpy(step[k], point.columns[k], linear);
                    if pair.condim > 3 {
                        angular = axpy(step[k], scratch.axis[k][0], angular);
                    }
                }
            }
            slope = slope + set_step(pair, point, linear, angular);
        }
        T::leave(active);
        slope = slope.merge(active, before);
    }
    (slope, curvature)
}
