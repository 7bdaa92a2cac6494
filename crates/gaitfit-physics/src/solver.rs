//! Newton's method on MuJoCo's convex problem, with the Hessian factored along the tree.
//!
//! The problem (MuJoCo, "Primal problem"): minimise over a ½ (a − a₀)ᵀ M (a − a₀) + s(J a − aref). Contacts with
//! the ground and joint rows leave the Hessian M + JᵀDJ the sparsity of the mass matrix, whatever the tree, so
//! its factorisation fills nothing in: each segment of up to three joints is eliminated onto the node that
//! carries it ([`crate::segment`]), nodes onto their own segments, and the root's 6 × 6 system remains.

use core::ops::Range;

use crate::cone::{Kinks, ellipse, ellipse_line, ellipse3, pyramid, pyramid_line, pyramid3, pyramid3_line};
use crate::contact::components;
use crate::coupling;
use crate::free;
use crate::segment::{Wanted, back_substitute, eliminate};
use crate::self_contact;
use crate::separate::separate;
use crate::spatial::{Articulated, V6, add6, axpy6, dot6, dot6_add, merge6, zero6};
use crate::state::{PairWork, Point, State, Work};
use crate::tree::{Pair, Tree};
use crate::vec3::*;
use crate::{Damping, Real};

/// Runs the iterations asked for by the settings; the solution is left in `state`'s accelerations. `work`'s
/// residuals belong to it if something still needs them (see [`implicit_damping`]).
#[inline(always)]
pub(crate) fn solve<T: Real>(tree: &Tree<T::K>, state: &mut State<T>, work: &mut Work<T>) {
    for turn in 0..tree.settings.iterations {
        iterate(tree, turn + 1 == tree.settings.iterations, state, work);
    }
}

/// One iteration. After the `last` one only what the integrator reads is left behind; leaving everything behind is
/// correct too.
#[inline(always)]
pub(crate) fn iterate<T: Real>(tree: &Tree<T::K>, last: bool, state: &mut State<T>, work: &mut Work<T>) {
    // Implicit damping solves once more with the residuals, so its last iteration leaves them behind.
    let last = last && tree.settings.damping != Damping::Implicit;
    let search = tree.settings.line_search > 0;
    // Slopes serve the line search, and steps of the residuals serve the next iteration.
    let wanted = if last && !search { Wanted::Step } else { Wanted::Everything };
    let smooth = direction(tree, true, wanted, state, work);
    let mut alpha = T::lit(1.0);
    if search {
        alpha = line_search(tree, smooth, state, work);
    }
    advance(tree, alpha, last, state, work);
}

/// Change of acceleration when the integrator sees M + h·B instead of M: solves (M + hB) δ = −∇ − hB a.
/// The root's part is returned, the joints' are their `step`s.
#[inline(always)]
pub(crate) fn implicit_damping<T: Real>(tree: &Tree<T::K>, state: &State<T>, work: &mut Work<T>) -> V6<T> {
    direction(tree, false, Wanted::Step, state, work);
    work.nodes[0].step
}

separate! {
    /// The Newton step p of the current accelerations, left in `work`. If everything is `wanted`, returns the slope
    /// and the curvature along it of the cost's smooth part: −∇ᵀH⁻¹∇ less the rows' slope, and pᵀMp.
    /// Without `hessian` the matrix is M + h·B and the residual that of the integrator.
    fn direction<T>(
        tree: &Tree<T::K>,
        hessian: bool,
        wanted: Wanted,
        state: &State<T>,
        work: &mut Work<T>,
    ) -> (T, T) {
        for node in &mut work.nodes {
            // Each iteration builds the Hessian anew: which rows act depends on the accelerations.
            node.inertia = Articulated::from_rigid(&node.rigid);
            node.residual = node.wrench;
        }
        contact_terms(tree, hessian, work);
        if !tree.self_contact.is_empty() {
            self_contact::terms(tree, state, work);
        }
        let mut slope = T::zero();
        // The outermost segments first: an eliminated one adds to the node that it hangs on.
        for segment in tree.segments.iter().enumerate().rev() {
            slope = slope - eliminate(tree, segment, hessian, state, work);
        }
        let mut step = zero6();
        // A fixed root gathers what its segments push on it: start afresh, or one diverged environment would leave its
        // NaN to those that later use the same scratch.
        work.nodes[0].step_wrench = zero6();
        if tree.floating {
            free::terms(tree, hessian, state, work);
            let root = &work.nodes[0];
            step = root.inertia.solve_neg(root.residual);
            // The root's part of −∇ᵀH⁻¹∇: the step is −H⁻¹ times the residual.
            slope = slope + dot6(root.residual, step);
        }
        // The tree alone lacks the self-contacts' Hessian: its step is completed, then corrected, before
        // anything else reads it.
        let touching = work.self_contact.touching;
        let mut corrected = None;
        if hessian && !tree.self_contact.is_empty() && T::enter(touching) {
            work.nodes[0].step = step;
            for segment in tree.segments.iter().enumerate() {
                back_substitute(tree, segment, Wanted::Step, None, work);
            }
            let changed = slope + self_contact::correct(tree, state, work);
            let root = work.nodes[0].step;
            T::leave(touching);
            slope = changed.merge(touching, slope);
            let before = std::mem::replace(&mut step, root);
            merge6(&mut step, touching, &before);
            corrected = Some(touching);
        }
        // Contacts of the root belong to no segment, so their steps are made here.
        if tree.floating && wanted == Wanted::Everything {
            slope = slope - point_steps(tree, tree.links[0].pairs.clone(), step, work);
            if tree.free.is_some() {
                slope = slope - free::steps(step, work);
            }
            work.nodes[0].step_wrench = work.nodes[0].rigid.mul(step);
        }
        work.nodes[0].step = step;
        let mut curvature = T::zero();
        for segment in tree.segments.iter().enumerate() {
            let (rows, smooth) = back_substitute(tree, segment, wanted, corrected, work);
            slope = slope - rows;
            curvature = curvature + smooth;
        }
        if wanted == Wanted::Everything && !tree.self_contact.is_empty() {
            slope = slope - self_contact::steps(tree, state, work);
        }
        // The nodes' part of pᵀMp: rigid inertias at them and the joints' pull on them.
        for node in &work.nodes {
            curvature = dot6_add(node.step, node.step_wrench, curvature);
        }
        (slope, curvature)
    }
}

/// Computes forces and Hessians of all contacts at their residuals, keeps them in the points and adds them to the nodes; without
/// `hessian` only the forces are added.
#[inline(always)]
fn contact_terms<T: Real>(tree: &Tree<T::K>, hessian: bool, work: &mut Work<T>) {
    // Slices, looked up once: the compiler would load their addresses again after every store.
    let (pairs, all, spins) = (&work.pairs[..], &mut work.points[..], &mut work.spins[..]);
    for (index, pair) in tree.pairs.iter().enumerate() {
        let PairWork { active, friction: mu } = &pairs[index];
        if !T::enter(*active) {
            continue;
        }
        let points = &mut all[pair.points.clone()];
        let node = &mut work.nodes[pair.node];
        let before = (node.inertia, node.residual);
        // A loop for each cone: the compiler prepares in front of a loop what any of its branches might use.
        if pair.condim == 1 || (pair.condim == 3 && !tree.elliptic) {
            for point in points {
                keep(pair, point, pyramid3(pair.condim, mu, point.d, point.residual[0]));
                node.push(point, hessian);
            }
        } else if pair.condim == 3 {
            for point in points {
                keep(pair, point, ellipse3(mu, tree.impratio, point.d, point.residual[0]));
                node.push(point, hessian);
            }
        } else {
            for (number, point) in points.iter_mut().enumerate() {
                let (f, w) = cone(tree, pair, mu, point.d, &flat(&point.residual));
                point.force = [[f[0], f[1], f[2]], [f[3], f[4], f[5]]];
                let (wrench, inertia) = spin_terms(pair.condim, point, &f, &w);
                spins[pair.spin + number] = (wrench, inertia);
                node.residual = add6(node.residual, wrench);
                if hessian {
                    node.inertia.add(&inertia);
                }
            }
        }
        T::leave(*active);
        node.inertia.merge(*active, &before.0);
        merge6(&mut node.residual, *active, &before.1);
    }
}

/// Keeps a point's force and weight of three dimensions.
#[inline(always)]
fn keep<T: Real>(pair: &Pair<T::K>, point: &mut Point<T>, (force, weight): (V3<T>, Sym3<T>)) {
    point.force[0] = force;
    (point.world_force, point.weight) = to_world(pair, &point.frame, force, weight);
}

/// Wrench and 6 × 6 Hessian of a contact with spin and roll, about the reference point, world axes.
#[inline(always)]
fn spin_terms<T: Real>(
    condim: usize,
    point: &Point<T>,
    force: &[T; 6],
    w: &[[T; 6]; 6],
) -> (V6<T>, Articulated<T>) {
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
    let mut wrench = zero6();
    let mut inertia = Articulated::zero();
    for k in 0..condim {
        wrench = axpy6(force[k], wrenches[k], wrench);
        let mut v: V6<T> = zero6();
        for l in 0..condim {
            v = axpy6(w[k][l], wrenches[l], v);
        }
        inertia.add_outer(wrenches[k], v);
    }
    (wrench, inertia)
}

/// A three-dimensional force and weight (nn, 11, 22, n1, n2, 12) in world axes.
#[inline(always)]
fn to_world<T: Real>(pair: &Pair<T::K>, frame: &M3<T>, f: V3<T>, w: Sym3<T>) -> (V3<T>, Sym3<T>) {
    if pair.aligned {
        // The normal lies along z and the tangents along y and x, so the numbers only change places.
        ([f[2], f[1], f[0]], [w[2], w[1], w[0], w[5], w[4], w[3]])
    } else {
        let columns = each3!(i => each3!(j => frame[j][i]));
        (rotate_back(frame, f), sym_rotate(&columns, &w))
    }
}

#[inline(always)]
fn flat<T: Real>([a, b]: &[V3<T>; 2]) -> [T; 6] {
    [a[0], a[1], a[2], b[0], b[1], b[2]]
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

/// Steps of contact points that move with the motion vector `a`; returns the slope of their cost.
#[inline(always)]
fn point_steps<T: Real>(tree: &Tree<T::K>, range: Range<usize>, a: V6<T>, work: &mut Work<T>) -> T {
    let mut slope = T::zero();
    for index in range {
        let pair = &tree.pairs[index];
        let active = work.pairs[index].active;
        if T::enter(active) {
            let before = slope;
            for point in &mut work.points[pair.points.clone()] {
                slope = slope + set_step(pair, point, cross_add(a[0], point.x, a[1]), a[0]);
            }
            T::leave(active);
            slope = slope.merge(active, before);
        }
    }
    slope
}

/// Keeps a point's step in contact components; returns the slope of its cost along it.
#[inline(always)]
pub(crate) fn set_step<T: Real>(pair: &Pair<T::K>, point: &mut Point<T>, linear: V3<T>, angular: V3<T>) -> T {
    point.step[0] = components(pair, &point.frame, linear);
    let mut slope = dot(point.force[0], point.step[0]);
    if pair.condim > 3 {
        point.step[1] = components(pair, &point.frame, angular);
        slope = dot_add(point.force[1], point.step[1], slope);
    }
    slope
}

separate! {
    /// Bracketed one-dimensional Newton search on the exact cost along the step, from the full step (as `rtsafe`, Press
    /// et al., Numerical Recipes, section 9.4).
    fn line_search<T>(
        tree: &Tree<T::K>,
        smooth: (T, T),
        state: &State<T>,
        work: &Work<T>,
    ) -> T {
        let (slope, curvature) = smooth;
        let z = T::zero();
        let mut alpha = T::lit(1.0);
        let mut lower = z;
        // The full Newton step is 1. The search never goes farther than this many steps; the next iteration can.
        let farthest = T::lit(16.0);
        let mut upper = farthest;
        // Twice the farthest place, so that the first move does not count as slow.
        let mut moved = T::lit(32.0);
        for _ in 0..tree.settings.line_search {
            let mut kinks = Kinks::none();
            let (g, h) = rows_along(tree, alpha, state, work, &mut kinks);
            let g = alpha.fma(curvature, slope) + g;
            // Where nothing bends the division would be by 0; the move then leaves the bracket and is replaced.
            let h = (h + curvature).max(T::lit(1e-30));
            // The cost is convex: the slope's sign tells the side of the minimum.
            lower = T::select_lt(g, z, alpha, lower);
            upper = T::select_lt(g, z, upper, alpha);
            // Not a product with the reciprocal: where nothing bends, the derivative of 1/h is more than `f32` holds.
            let change = g.div(h);
            let newton = alpha - change;
            let middle = T::lit(0.5) * (lower + upper);
            // Across a narrow kink Newton's method jumps to and fro between the ends: halve where it arrives at the
            // far one, or does not move less than half as far as before.
            let room = T::lit(1e-3) * (upper - lower);
            let low = T::select_lt(g, z, lower, lower + room);
            let high = T::select_lt(g, z, upper - room, upper);
            let mut next = T::select_lt(newton, low, middle, newton);
            next = T::select_lt(high, newton, middle, next);
            // Without a found end there is nothing to halve: the middle lies far beyond what was looked at.
            let halved = T::select_lt(moved, T::lit(2.0) * change.abs(), middle, next);
            next = T::select_lt(upper, farthest, halved, next);
            if tree.elliptic {
                // Newton's method does not see a kink that it steps across, and it may be narrow: look there first.
                let below = T::select_lt(lower, kinks.below, kinks.below, newton);
                let above = T::select_lt(kinks.above, upper, kinks.above, newton);
                let falling = T::select_lt(above, newton, above, next);
                next = T::select_lt(g, z, falling, T::select_lt(newton, below, below, next));
            }
            // Rounding moves a found minimum by less than the last number.
            moved = (next - alpha).abs().max(T::lit(1e-5));
            alpha = next;
        }
        alpha
    }
}

/// First and second derivative of the rows' cost at `alpha` along the step; elliptic contacts tell their `kinks`.
#[inline(always)]
fn rows_along<T: Real>(
    tree: &Tree<T::K>,
    alpha: T,
    state: &State<T>,
    work: &Work<T>,
    kinks: &mut Kinks<T>,
) -> (T, T) {
    let z = T::zero();
    let mut g = (z, z);
    for ((joint, &qacc), &limited) in work.joints.iter().zip(&state.qacc).zip(&work.limited) {
        let step = joint.step;
        let a = alpha.fma(step, qacc);
        // Dry friction: beyond the loss the force is constant, so the curvature is zero.
        let slip = joint.friction_d.fma(a, joint.friction_bias);
        let loss = joint.frictionloss;
        g.0 = step.fma(slip.clamp_abs(loss), g.0);
        let curve = T::select_lt(slip.abs(), loss, joint.friction_d * step, z);
        g.1 = curve.fma(step, g.1);
        if T::enter(limited) {
            let before = g;
            // A limit only pushes: where its row is positive it adds neither force nor curvature.
            let gap = joint.limit_sign.fma(a, joint.limit_bias);
            let curve = T::select_lt(gap, z, joint.limit_d * step, z);
            g.0 = (joint.limit_sign * curve).fma(gap, g.0);
            g.1 = curve.fma(step, g.1);
            T::leave(limited);
            g = (g.0.merge(limited, before.0), g.1.merge(limited, before.1));
        }
    }
    if !tree.couplings.is_empty() {
        g = coupling::along(tree, alpha, state, work, g);
    }
    for (index, pair) in tree.pairs.iter().enumerate() {
        let PairWork { active, friction: mu } = &work.pairs[index];
        let active = *active;
        if !T::enter(active) {
            continue;
        }
        let before = (g, *kinks);
        let points = &work.points[pair.points.clone()];
        // A loop for each cone, as in `contact_terms`.
        if pair.condim == 1 || (pair.condim == 3 && !tree.elliptic) {
            for point in points {
                g = pyramid3_line(pair.condim, mu, point.d, point.residual[0], point.step[0], alpha, g);
            }
        } else if tree.elliptic {
            for point in points {
                let (j, step) = (flat(&point.residual), flat(&point.step));
                g = ellipse_line(pair.condim, mu, tree.impratio, point.d, (&j, &step), alpha, g, kinks);
            }
        } else {
            for point in points {
                g = pyramid_line(
                    pair.condim,
                    mu,
                    point.d,
                    (&flat(&point.residual), &flat(&point.step)),
                    alpha,
                    g,
                );
            }
        }
        T::leave(active);
        g = (g.0.merge(active, before.0.0), g.1.merge(active, before.0.1));
        kinks.merge(active, &before.1);
    }
    if tree.free.is_some() {
        g = free::along(tree, alpha, state, work, g);
    }
    if !tree.self_contact.is_empty() {
        g = self_contact::points_along(tree, alpha, work, g, kinks);
    }
    g
}

/// Takes `alpha` of the step; after the `last` one the residuals stay as they were.
#[inline(always)]
fn advance<T: Real>(tree: &Tree<T::K>, alpha: T, last: bool, state: &mut State<T>, work: &mut Work<T>) {
    if tree.floating {
        state.base_acceleration = axpy6(alpha, work.nodes[0].step, state.base_acceleration);
    }
    for (qacc, joint) in state.qacc.iter_mut().zip(&work.joints) {
        *qacc = alpha.fma(joint.step, *qacc);
    }
    if last {
        // Only a further iteration reads the residuals, so their update is saved here.
        return;
    }
    for node in &mut work.nodes {
        node.wrench = axpy6(alpha, node.step_wrench, node.wrench);
    }
    for segment in &mut work.segments {
        segment.residual = axpy(alpha, segment.step_residual, segment.residual);
    }
    let (pairs, points) = (&work.pairs[..], &mut work.points[..]);
    for (index, pair) in tree.pairs.iter().enumerate() {
        let active = pairs[index].active;
        if !T::enter(active) {
            continue;
        }
        for point in &mut points[pair.points.clone()] {
            point.residual[0] = axpy(alpha, point.step[0], point.residual[0]);
            if pair.condim > 3 {
                point.residual[1] = axpy(alpha, point.step[1], point.residual[1]);
            }
        }
        T::leave(active);
    }
    if !tree.self_contact.is_empty() {
        self_contact::advance(tree, alpha, work);
    }
}
