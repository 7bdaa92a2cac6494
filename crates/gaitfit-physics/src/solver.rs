//! Newton's method on MuJoCo's convex problem, with the Hessian factored along the tree.
//!
//! The problem (MuJoCo, "Primal problem"): minimise over a ½ (a − a₀)ᵀ M (a − a₀) + s(J a − aref). A contact
//! with the ground adds JᵀWJ, which is the inertia a body would have with a 3 × 3 "mass" W at the contact
//! point: so M + JᵀWJ is the mass matrix of the same tree with other body inertias, and one Newton step is the
//! articulated-body recursion (Featherstone 2008, table 7.1) on those inertias, with joint rows added to the
//! armature. No matrix is formed and nothing fills in, whatever the tree.

use core::ops::Range;

use crate::cone::{ellipse, pyramid, pyramid3, pyramid3_line};
use crate::contact::components;
use crate::spatial::{Articulated, V6, add6, axpy6, dot6, dot6_add, zero6};
use crate::state::{Point, State, Work};
use crate::tree::{Pair, Tree};
use crate::vec3::*;
use crate::{Damping, Real};

/// Runs the iterations asked for by the settings; the solution is left in `state`'s accelerations. `work`'s
/// wrenches and residuals belong to it if something still needs them (see [`implicit_damping`]).
#[inline(always)]
pub(crate) fn solve<T: Real>(tree: &Tree<T::K>, state: &mut State<T>, work: &mut Work<T>) {
    let settings = &tree.settings;
    for iteration in 0..settings.iterations {
        let last = iteration + 1 == settings.iterations && settings.damping != Damping::Implicit;
        contacts::<T, true>(tree, work);
        let root = backward::<T, true>(tree, state, work);
        if settings.line_search == 0 {
            full_step(tree, root, last, state, work);
        } else {
            let (slope, curvature) = direction(tree, root, work);
            let alpha = line_search(tree, slope, curvature, state, work);
            advance(tree, alpha, last, state, work);
        }
    }
}

/// Change of acceleration when the integrator sees M + h·B instead of M: solves
/// (M + hB) δ = −∇ − hB a, leaving base and joint parts in `work`'s steps.
#[inline(always)]
pub(crate) fn implicit_damping<T: Real>(tree: &Tree<T::K>, state: &State<T>, work: &mut Work<T>) -> V6<T> {
    contacts::<T, false>(tree, work);
    let (art, pa) = backward::<T, false>(tree, state, work);
    let base = root_step(tree, &art, pa);
    work.steps[0] = base;
    for &i in &tree.order {
        let link = &tree.links[i];
        let mut a = work.steps[link.parent_chain];
        let joint = &mut work.joints[i - 1];
        joint.step = joint.inv_d * (joint.e - dot6(work.links[i].u, a));
        a = axpy6(joint.step, work.links[i].axis, a);
        if !link.leaf {
            work.steps[link.chain] = a;
        }
    }
    base
}

/// Leaves to root: articulated inertias and residual wrenches. With `HESSIAN` the constraints' Hessians are
/// included; without, the matrix is M + h·B and the residual that of the integrator.
#[inline(always)]
fn backward<T: Real, const HESSIAN: bool>(
    tree: &Tree<T::K>,
    state: &State<T>,
    work: &mut Work<T>,
) -> (Articulated<T>, V6<T>) {
    for &i in tree.order.iter().rev() {
        let link = &tree.links[i];
        let mut art = Articulated::from_rigid(&work.links[i].rigid);
        let mut pa = work.links[i].wrench;
        if !link.leaf {
            let gathered = &work.articulated[link.chain];
            art.add(&gathered.0);
            pa = add6(pa, gathered.1);
        }
        if let Some(slot) = link.contact {
            add_contact::<T, HESSIAN>(&work.contacts[slot], &mut art, &mut pa);
        }

        let joint = &mut work.joints[i - 1];
        let qacc = state.qacc[i - 1];
        let z = T::zero();
        let slip = joint.friction_d * (qacc - joint.friction_aref);
        let loss = joint.frictionloss;
        let mut row = slip.clamp(-loss, loss);
        let mut diagonal = joint.armature;
        let mut residual = joint.armature.fma(qacc, -joint.tau);
        if HESSIAN {
            diagonal = diagonal + T::select_lt(slip.abs(), loss, joint.friction_d, z);
        } else {
            diagonal = diagonal + joint.implicit;
            residual = joint.implicit.fma(qacc, residual);
        }
        if joint.limited {
            let gap = joint.limit_sign.fma(qacc, -joint.limit_aref);
            let d = T::select_lt(gap, z, joint.limit_d, z);
            row = (joint.limit_sign * d).fma(gap, row);
            if HESSIAN {
                diagonal = diagonal + d;
            }
        }
        joint.row = row;
        let axis = work.links[i].axis;
        let u = art.mul(axis);
        let inv_d = dot6_add(axis, u, diagonal).recip();
        let e = -dot6_add(axis, pa, residual + row);
        joint.inv_d = inv_d;
        joint.e = e;
        work.links[i].u = u;
        art.sub_rank_one(u, inv_d);
        pa = axpy6(e * inv_d, u, pa);
        let gathered = &mut work.articulated[link.parent_chain];
        if link.first {
            *gathered = (art, pa);
        } else {
            gathered.0.add(&art);
            gathered.1 = add6(gathered.1, pa);
        }
    }
    let (mut art, mut pa) = work.articulated[0];
    if tree.links[0].leaf {
        (art, pa) = (Articulated::zero(), zero6());
    }
    if tree.floating {
        art.add_rigid(&work.links[0].rigid);
        pa = add6(pa, work.links[0].wrench);
        if let Some(slot) = tree.links[0].contact {
            add_contact::<T, HESSIAN>(&work.contacts[slot], &mut art, &mut pa);
        }
    }
    (art, pa)
}

#[inline(always)]
fn add_contact<T: Real, const HESSIAN: bool>(
    contact: &(Articulated<T>, V6<T>, bool),
    art: &mut Articulated<T>,
    pa: &mut V6<T>,
) {
    let (inertia, wrench, active) = contact;
    if *active {
        *pa = add6(*pa, *wrench);
        if HESSIAN {
            art.add(inertia);
        }
    }
}

#[inline(always)]
fn root_step<T: Real>(tree: &Tree<T::K>, art: &Articulated<T>, pa: V6<T>) -> V6<T> {
    if tree.floating { art.solve_neg(pa) } else { zero6() }
}

/// Contact forces, and with `HESSIAN` contact inertias, of every link with pairs.
#[inline(always)]
fn contacts<T: Real, const HESSIAN: bool>(tree: &Tree<T::K>, work: &mut Work<T>) {
    for slot in 0..tree.contact_links.len() {
        let mut first = true;
        for index in tree.links[tree.contact_links[slot]].pairs.clone() {
            let pair = &tree.pairs[index];
            if !work.pairs[index].active {
                continue;
            }
            let mu = work.pairs[index].friction;
            for point in &mut work.points[pair.points.clone()] {
                let out = &mut work.contacts[slot];
                if pair.condim > 3 || (tree.elliptic && pair.condim == 3) {
                    if first {
                        *out = (Articulated::zero(), zero6(), true);
                    }
                    add_general::<T, HESSIAN>(tree, pair, &mu, point, &mut out.0, &mut out.1);
                } else {
                    let (force, w) = pyramid3(pair.condim, &mu, point.d, point.residual[0]);
                    point.force[0] = force;
                    let (f, w) = to_world(pair, &point.frame, force, w);
                    let wrench = [cross(point.x, f), f];
                    if first {
                        out.1 = wrench;
                        if HESSIAN {
                            out.0 = Articulated::point(point.x, &w);
                        }
                    } else {
                        out.1 = add6(out.1, wrench);
                        if HESSIAN {
                            out.0.add(&Articulated::point(point.x, &w));
                        }
                    }
                }
                first = false;
            }
        }
        work.contacts[slot].2 = !first;
    }
}

/// A three-dimensional force and weight (nn, 11, 22, n1, n2, 12) in world axes.
#[inline(always)]
fn to_world<T: Real>(pair: &Pair<T::K>, frame: &M3<T>, f: V3<T>, w: Sym3<T>) -> (V3<T>, Sym3<T>) {
    if pair.aligned {
        ([f[2], f[1], f[0]], [w[2], w[1], w[0], w[5], w[4], w[3]])
    } else {
        let columns = each3!(i => each3!(j => frame[j][i]));
        (rotate_back(frame, f), sym_rotate(&columns, &w))
    }
}

/// Contacts with spin and roll, and elliptic cones.
#[inline(always)]
fn add_general<T: Real, const HESSIAN: bool>(
    tree: &Tree<T::K>,
    pair: &Pair<T::K>,
    mu: &[T; 5],
    point: &mut Point<T>,
    art: &mut Articulated<T>,
    pa: &mut V6<T>,
) {
    let j = flat(&point.residual);
    let (force, w) = cone(tree, pair, mu, point.d, &j);
    point.force = [[force[0], force[1], force[2]], [force[3], force[4], force[5]]];
    if pair.condim == 3 {
        let w = [w[0][0], w[1][1], w[2][2], w[0][1], w[0][2], w[1][2]];
        let (f, w) = to_world(pair, &point.frame, point.force[0], w);
        *pa = [cross_add(point.x, f, pa[0]), add(pa[1], f)];
        if HESSIAN {
            art.add(&Articulated::point(point.x, &w));
        }
        return;
    }
    // Wrench directions of the contact's axes: a force through x, then a pure moment.
    let z = zero3();
    let f = &point.frame;
    let wrenches: [V6<T>; 6] = [
        [cross(point.x, f[0]), f[0]],
        [cross(point.x, f[1]), f[1]],
        [cross(point.x, f[2]), f[2]],
        [f[0], z],
        [f[1], z],
        [f[2], z],
    ];
    for k in 0..pair.condim {
        *pa = axpy6(force[k], wrenches[k], *pa);
    }
    if HESSIAN {
        for k in 0..pair.condim {
            let mut v: V6<T> = zero6();
            for l in 0..pair.condim {
                v = axpy6(w[k][l], wrenches[l], v);
            }
            art.add_outer(wrenches[k], v);
        }
    }
}

#[inline(always)]
fn flat<T: Real>(v: &[V3<T>; 2]) -> [T; 6] {
    [v[0][0], v[0][1], v[0][2], v[1][0], v[1][1], v[1][2]]
}

#[inline(always)]
fn cone<T: Real>(
    tree: &Tree<T::K>,
    pair: &Pair<T::K>,
    mu: &[T; 5],
    d: T,
    j: &[T; 6],
) -> ([T; 6], [[T; 6]; 6]) {
    if tree.elliptic { ellipse(pair.condim, mu, tree.impratio, d, j) } else { pyramid(pair.condim, mu, d, j) }
}

/// Root to leaves: takes the Newton step. The `last` one leaves forces and residuals behind.
#[inline(always)]
fn full_step<T: Real>(
    tree: &Tree<T::K>,
    (art, pa): (Articulated<T>, V6<T>),
    last: bool,
    state: &mut State<T>,
    work: &mut Work<T>,
) {
    let base = root_step(tree, &art, pa);
    work.steps[0] = base;
    if tree.floating {
        state.base_acceleration = add6(state.base_acceleration, base);
        if !last {
            let root = &mut work.links[0];
            root.wrench = add6(root.wrench, root.rigid.mul(base));
            step_contacts(tree, tree.links[0].pairs.clone(), base, work);
        }
    }
    for &i in &tree.order {
        let link = &tree.links[i];
        let above = work.steps[link.parent_chain];
        let entry = &mut work.links[i];
        let joint = &work.joints[i - 1];
        let step = joint.inv_d * (joint.e - dot6(entry.u, above));
        state.qacc[i - 1] = state.qacc[i - 1] + step;
        if last && link.leaf {
            continue;
        }
        let a = axpy6(step, entry.axis, above);
        if !last {
            entry.wrench = add6(entry.wrench, entry.rigid.mul(a));
            if link.contact.is_some() {
                step_contacts(tree, link.pairs.clone(), a, work);
            }
        }
        if !link.leaf {
            work.steps[link.chain] = a;
        }
    }
}

/// Root to leaves: the Newton step as a direction. Returns slope and curvature of the cost's smooth part along it.
#[inline(always)]
fn direction<T: Real>(tree: &Tree<T::K>, (art, pa): (Articulated<T>, V6<T>), work: &mut Work<T>) -> (T, T) {
    let base = root_step(tree, &art, pa);
    // The slope of the whole cost is −∇ᵀH⁻¹∇, which the recursion has in pieces; the rows' part is taken off.
    let mut slope = dot6(pa, base);
    let mut curvature = T::zero();
    work.steps[0] = base;
    if tree.floating {
        let root = &mut work.links[0];
        root.step_wrench = root.rigid.mul(base);
        curvature = dot6(base, root.step_wrench);
        slope = direction_contacts(tree, tree.links[0].pairs.clone(), base, slope, work);
    }
    for &i in &tree.order {
        let link = &tree.links[i];
        let above = work.steps[link.parent_chain];
        let entry = &mut work.links[i];
        let joint = &mut work.joints[i - 1];
        let step = joint.inv_d * (joint.e - dot6(entry.u, above));
        let a = axpy6(step, entry.axis, above);
        let wrench = entry.rigid.mul(a);
        entry.step_wrench = wrench;
        joint.step = step;
        curvature = dot6_add(a, wrench, curvature);
        curvature = (joint.armature * step).fma(step, curvature);
        slope = (joint.e * joint.inv_d).fnma(joint.e, slope);
        slope = joint.row.fnma(step, slope);
        if link.contact.is_some() {
            slope = direction_contacts(tree, link.pairs.clone(), a, slope, work);
        }
        if !link.leaf {
            work.steps[link.chain] = a;
        }
    }
    (slope, curvature)
}

/// `J a` of one contact point.
#[inline(always)]
fn point_motion<T: Real>(pair: &Pair<T::K>, point: &Point<T>, a: V6<T>) -> [V3<T>; 2] {
    let linear = components(pair, &point.frame, cross_add(a[0], point.x, a[1]));
    [linear, if pair.condim > 3 { components(pair, &point.frame, a[0]) } else { zero3() }]
}

/// Adds `J a` of a full step to the residuals of one link's contacts.
#[inline(always)]
fn step_contacts<T: Real>(tree: &Tree<T::K>, range: Range<usize>, a: V6<T>, work: &mut Work<T>) {
    for index in range {
        let pair = &tree.pairs[index];
        if !work.pairs[index].active {
            continue;
        }
        for point in &mut work.points[pair.points.clone()] {
            let motion = point_motion(pair, point, a);
            point.residual[0] = add(point.residual[0], motion[0]);
            if pair.condim > 3 {
                point.residual[1] = add(point.residual[1], motion[1]);
            }
        }
    }
}

/// Keeps `J a` of the direction at one link's contacts and takes the rows' slope off `slope`.
#[inline(always)]
fn direction_contacts<T: Real>(
    tree: &Tree<T::K>,
    range: Range<usize>,
    a: V6<T>,
    mut slope: T,
    work: &mut Work<T>,
) -> T {
    for index in range {
        let pair = &tree.pairs[index];
        if !work.pairs[index].active {
            continue;
        }
        for point in &mut work.points[pair.points.clone()] {
            let motion = point_motion(pair, point, a);
            point.step[0] = motion[0];
            slope = slope - dot(point.force[0], motion[0]);
            if pair.condim > 3 {
                point.step[1] = motion[1];
                slope = slope - dot(point.force[1], motion[1]);
            }
        }
    }
    slope
}

/// Bracketed one-dimensional Newton search on the exact cost along the step, from the full step.
#[inline(always)]
fn line_search<T: Real>(tree: &Tree<T::K>, slope: T, curvature: T, state: &State<T>, work: &Work<T>) -> T {
    let z = T::zero();
    let mut alpha = T::lit(1.0);
    let mut lower = z;
    let mut upper = T::lit(16.0);
    for _ in 0..tree.settings.line_search {
        let (g, h) = rows_along(tree, alpha, state, work);
        let g = alpha.fma(curvature, slope) + g;
        let h = (h + curvature).max(T::lit(1e-30));
        lower = T::select_lt(g, z, alpha, lower);
        upper = T::select_lt(g, z, upper, alpha);
        let newton = alpha - g.div(h);
        let middle = T::lit(0.5) * (lower + upper);
        let newton = T::select_lt(newton, lower, middle, newton);
        alpha = T::select_lt(upper, newton, middle, newton);
    }
    alpha
}

/// First and second derivative of the rows' cost at `alpha` along the step.
#[inline(always)]
fn rows_along<T: Real>(tree: &Tree<T::K>, alpha: T, state: &State<T>, work: &Work<T>) -> (T, T) {
    let z = T::zero();
    let mut g = (z, z);
    for j in 0..work.joints.len() {
        let joint = &work.joints[j];
        let step = joint.step;
        let a = alpha.fma(step, state.qacc[j]);
        let slip = joint.friction_d * (a - joint.friction_aref);
        let loss = joint.frictionloss;
        g.0 = step.fma(slip.clamp(-loss, loss), g.0);
        let curve = T::select_lt(slip.abs(), loss, joint.friction_d * step, z);
        g.1 = curve.fma(step, g.1);
        if joint.limited {
            let gap = joint.limit_sign.fma(a, -joint.limit_aref);
            let curve = T::select_lt(gap, z, joint.limit_d * step, z);
            g.0 = (joint.limit_sign * curve).fma(gap, g.0);
            g.1 = curve.fma(step, g.1);
        }
    }
    for index in 0..tree.pairs.len() {
        let pair = &tree.pairs[index];
        if !work.pairs[index].active {
            continue;
        }
        let mu = &work.pairs[index].friction;
        for point in &work.points[pair.points.clone()] {
            if pair.condim > 3 || (tree.elliptic && pair.condim == 3) {
                let step = flat(&point.step);
                let mut j = flat(&point.residual);
                for k in 0..pair.condim {
                    j[k] = alpha.fma(step[k], j[k]);
                }
                let (force, w) = cone(tree, pair, mu, point.d, &j);
                for k in 0..pair.condim {
                    let mut row = z;
                    for l in 0..pair.condim {
                        row = w[k][l].fma(step[l], row);
                    }
                    g.0 = force[k].fma(step[k], g.0);
                    g.1 = row.fma(step[k], g.1);
                }
            } else {
                g = pyramid3_line(pair.condim, mu, point.d, point.residual[0], point.step[0], alpha, g);
            }
        }
    }
    g
}

/// Takes `alpha` of the step; the `last` one leaves forces and residuals behind.
#[inline(always)]
fn advance<T: Real>(tree: &Tree<T::K>, alpha: T, last: bool, state: &mut State<T>, work: &mut Work<T>) {
    if tree.floating {
        state.base_acceleration = axpy6(alpha, work.steps[0], state.base_acceleration);
    }
    for j in 0..work.joints.len() {
        state.qacc[j] = alpha.fma(work.joints[j].step, state.qacc[j]);
    }
    if last {
        return;
    }
    for link in &mut work.links {
        link.wrench = axpy6(alpha, link.step_wrench, link.wrench);
    }
    for index in 0..tree.pairs.len() {
        let pair = &tree.pairs[index];
        if !work.pairs[index].active {
            continue;
        }
        for point in &mut work.points[pair.points.clone()] {
            point.residual[0] = axpy(alpha, point.step[0], point.residual[0]);
            if pair.condim > 3 {
                point.residual[1] = axpy(alpha, point.step[1], point.residual[1]);
            }
        }
    }
}
