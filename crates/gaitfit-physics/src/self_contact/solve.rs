//! Self-contacts in Newton's method: forces, the correction of a step, the line search.
//!
//! With H₀ the Hessian along the tree, C = JᵀWJ of these contacts and g the gradient, the tree gives s₀ = −H₀⁻¹ g.
//! The step is s = −(H₀ + C)⁻¹ g = s₀ − (H₀ + C)⁻¹ C s₀. H₀ is put together as composite rigid bodies make a mass
//! matrix (Featherstone 2008, table 6.2), with the Hessians of the ground's contacts among what a link carries.

use crate::Real;
use crate::cone::{Kinks, ellipse, ellipse_line, pyramid, pyramid_line};
use crate::coupling::{self, distant};
use crate::segment::joint_row;
use crate::self_contact::sparsity::{Sparsity, at};
use crate::self_contact::{SelfContactPair, SelfContactPairWork};
use crate::separate::separate;
use crate::spatial::{Articulated, V6, add6, dot6, dot6_add, zero6};
use crate::state::{State, Work};
use crate::tree::Tree;

separate! {
    /// Forces and Hessians of the contacts at their residuals, and the torques of them and of distant couplings on the joints.
    pub(crate) fn terms<T>(tree: &Tree<T::K>, state: &State<T>, work: &mut Work<T>) {
        // Distant couplings act also where nothing touches, so the torques are set in any case.
        for torque in &mut work.self_contact.torque {
            *torque = T::zero();
        }
        distant::add_torques(tree, state, work);
        let contacts = &mut work.self_contact;
        if apart::<T>(contacts.touching) {
            return;
        }
        for index in 0..tree.self_contact.pairs.len() {
            let pair = &tree.self_contact.pairs[index];
            let SelfContactPairWork { active, friction } = contacts.pairs[index];
            if !T::enter(active) {
                continue;
            }
            let joints = &tree.self_contact.joints[pair.joints.clone()];
            // The region adds to copies, which are merged after it.
            for (sum, joint) in contacts.sums.iter_mut().zip(joints) {
                *sum = contacts.torque[joint.joint];
            }
            for number in 0..pair.points.len() {
                let point = &mut contacts.points[pair.points.start + number];
                let (force, weight) = cone(tree, pair, &friction, point.d, &point.residual);
                point.force = force;
                let start = pair.weights + number * pair.dims * pair.dims;
                for k in 0..pair.dims {
                    for l in 0..pair.dims {
                        contacts.weights[start + k * pair.dims + l] = weight[k][l];
                    }
                }
                let rows = pair.rows + number * pair.dims * joints.len();
                for k in 0..pair.dims {
                    for place in 0..joints.len() {
                        let row = contacts.rows[rows + k * joints.len() + place];
                        contacts.sums[place] = row.fma(force[k], contacts.sums[place]);
                    }
                }
            }
            T::leave(active);
            for (sum, joint) in contacts.sums.iter().zip(joints) {
                contacts.torque[joint.joint] = sum.merge(active, contacts.torque[joint.joint]);
            }
        }
    }
}

/// Whether nothing touches in any lane, so that no pair needs a look. A recording looks at all pairs.
#[inline(always)]
fn apart<T: Real>(touching: T::Guard) -> bool {
    let entered = T::enter(touching);
    if entered {
        T::leave(touching);
    }
    !entered
}

/// Negative force and Hessian of one point.
#[inline(always)]
fn cone<T: Real>(
    tree: &Tree<T::K>,
    pair: &SelfContactPair<T::K>,
    mu: &[T; 5],
    d: T,
    j: &[T; 6],
) -> ([T; 6], [[T; 6]; 6]) {
    let z = T::zero();
    if pair.condim == 1 {
        // Without friction only the normal acts, and it only pushes: its row must be negative.
        let s = T::select_lt(j[0], z, d, z);
        let (mut force, mut weight) = ([z; 6], [[z; 6]; 6]);
        force[0] = s * j[0];
        weight[0][0] = s;
        (force, weight)
    } else if tree.elliptic {
        ellipse(pair.condim, mu, tree.impratio, d, j)
    } else {
        pyramid(pair.condim, mu, d, j)
    }
}

separate! {
    /// Corrects the step in `work` for the contacts' Hessian; returns what the slope along it changes by. Called in the region
    /// in which the steps of all joints and of the root were made.
    pub(crate) fn correct<T>(tree: &Tree<T::K>, state: &State<T>, work: &mut Work<T>) -> T {
        hessian(tree, state, work);
        couple(tree, work);
        distant::couple(tree, state, work);
        let sparsity = &tree.self_contact.sparsity;
        solve(sparsity, work);
        // The solution is −(H₀ + C)⁻¹ C s₀, which s₀ lacks.
        for j in 0..tree.joints() {
            work.joints[j].step = work.joints[j].step + work.self_contact.change[sparsity.joint(j)];
        }
        if tree.floating {
            let step = &mut work.nodes[0].step;
            for k in 0..6 {
                step[k / 3][k % 3] = step[k / 3][k % 3] + work.self_contact.change[sparsity.base(k)];
            }
        }
        change_of_slope(tree, work) + distant::change_of_slope(tree, work)
    }
}

/// Change of the slope by the correction of the step: gᵀ(s − s₀) = s₀ᵀ C s. The points' steps are still those of s₀.
#[inline(always)]
fn change_of_slope<T: Real>(tree: &Tree<T::K>, work: &Work<T>) -> T {
    let mut slope = T::zero();
    for index in 0..tree.self_contact.pairs.len() {
        let pair = &tree.self_contact.pairs[index];
        let active = work.self_contact.pairs[index].active;
        if !T::enter(active) {
            continue;
        }
        let sum = slope;
        for number in 0..pair.points.len() {
            let before = work.self_contact.points[pair.points.start + number].step;
            let after = point_step(tree, pair, number, work);
            let start = pair.weights + number * pair.dims * pair.dims;
            for k in 0..pair.dims {
                for l in 0..pair.dims {
                    let weight = work.self_contact.weights[start + k * pair.dims + l];
                    slope = (weight * before[k]).fma(after[l], slope);
                }
            }
        }
        T::leave(active);
        slope = slope.merge(active, sum);
    }
    slope
}

/// `J` of the joints' steps at one point.
#[inline(always)]
fn point_step<T: Real>(
    tree: &Tree<T::K>,
    pair: &SelfContactPair<T::K>,
    number: usize,
    work: &Work<T>,
) -> [T; 6] {
    let joints = &tree.self_contact.joints[pair.joints.clone()];
    let start = pair.rows + number * pair.dims * joints.len();
    let mut step = [T::zero(); 6];
    for k in 0..pair.dims {
        for (place, joint) in joints.iter().enumerate() {
            let row = work.self_contact.rows[start + k * joints.len() + place];
            step[k] = row.fma(work.joints[joint.joint].step, step[k]);
        }
    }
    step
}

/// The tree's Hessian, in `work.self_contact.matrix`.
#[inline(always)]
fn hessian<T: Real>(tree: &Tree<T::K>, state: &State<T>, work: &mut Work<T>) {
    let joints = tree.joints();
    let sparsity = &tree.self_contact.sparsity;
    // Only these elements are read: the others are zero in the factor too.
    for place in sparsity.places() {
        work.self_contact.matrix[place] = T::zero();
    }
    for carried in &mut work.self_contact.carried {
        *carried = Articulated::zero();
    }
    // A node's rigid inertia is that of the segments that hang on it; links within a segment are in its mass
    // matrix.
    for (node, &link) in work.nodes.iter().zip(&tree.nodes) {
        work.self_contact.carried[link] = Articulated::from_rigid(&node.rigid);
    }
    for index in 0..tree.pairs.len() {
        let pair = &tree.pairs[index];
        let active = work.pairs[index].active;
        if !T::enter(active) {
            continue;
        }
        let link = tree.self_contact.ground_links[index];
        let before = work.self_contact.carried[link];
        for (number, point) in work.points[pair.points.clone()].iter().enumerate() {
            if pair.condim > 3 {
                work.self_contact.carried[link].add(&work.spins[pair.spin + number].1);
            } else {
                work.self_contact.carried[link].add_point(point.x, &point.weight);
            }
        }
        T::leave(active);
        work.self_contact.carried[link].merge(active, &before);
    }
    // Children first, so that what a link carries is complete when its joint is reached.
    for link in (1..=joints).rev() {
        let j = link - 1;
        let (curvature, _) = joint_row(&mut work.joints[j], work.limited[j], state.qacc[j]);
        let (home, member) = tree.self_contact.homes[j];
        let segment = &work.segments[home];
        let axis = segment.axis[member];
        let carried = work.self_contact.carried[link];
        let force = carried.mul(axis);
        work.self_contact.matrix[sparsity.joints(j, j)] =
            dot6_add(axis, force, segment.mass[member] + curvature);
        // Inner joints of the same segment: the rigid part of their element is in the segment's mass matrix.
        let first = tree.segments[home].first;
        for i in 0..member {
            // A segment's mass matrix is kept in the order 00, 11, 22, 10, 20, 21.
            let inner = dot6_add(segment.axis[i], force, segment.mass[2 + member + i]);
            work.self_contact.matrix[sparsity.joints(j, first + i - 1)] = inner;
        }
        // For joints further in, the segment's own links count as well.
        let force = add6(force, segment.force[member]);
        let mut outer = tree.links[first].parent;
        // Along the chain of links to the root: only joints that carry this one have an element with it.
        while outer > 0 {
            let (home, member) = tree.self_contact.homes[outer - 1];
            let inner = dot6(work.segments[home].axis[member], force);
            work.self_contact.matrix[sparsity.joints(j, outer - 1)] = inner;
            outer = tree.links[outer].parent;
        }
        if tree.floating {
            for k in 0..6 {
                work.self_contact.matrix[sparsity.base_and_joint(k, j)] = force[k / 3][k % 3];
            }
        }
        work.self_contact.carried[tree.links[link].parent].add(&carried);
    }
    // The near couplings. `distant::couple` adds the others.
    for number in 0..tree.self_contact.couplings.start {
        let terms = coupling::near_terms(tree, number, state, work);
        for (k, i, element) in terms.hessian.into_iter().flatten() {
            let place = &mut work.self_contact.matrix[sparsity.joints(k, i)];
            *place = *place + element;
        }
    }
    if tree.floating {
        let root = work.self_contact.carried[0];
        for k in 0..6 {
            let mut unit: V6<T> = zero6();
            unit[k / 3][k % 3] = T::lit(1.0);
            let force = root.mul(unit);
            // The lower triangle is all that the factorisation reads.
            for i in k..6 {
                work.self_contact.matrix[sparsity.bases(i, k)] = force[i / 3][i % 3];
            }
        }
    }
}

/// Adds the contacts' Hessian C to the matrix, and puts −C s₀ on the right side; keeps the points' steps at s₀.
#[inline(always)]
fn couple<T: Real>(tree: &Tree<T::K>, work: &mut Work<T>) {
    let sparsity = &tree.self_contact.sparsity;
    for number in &mut work.self_contact.change {
        *number = T::zero();
    }
    for index in 0..tree.self_contact.pairs.len() {
        let pair = &tree.self_contact.pairs[index];
        let active = work.self_contact.pairs[index].active;
        if !T::enter(active) {
            continue;
        }
        let joints = &tree.self_contact.joints[pair.joints.clone()];
        let count = joints.len();
        // The region's sums begin with the values so far: right sides in `row`, elements of the matrix in `sums`.
        let elements = || (0..count).flat_map(|place| (place..count).map(move |other| (place, other)));
        let element =
            |(place, other): (usize, usize)| sparsity.joints(joints[other].joint, joints[place].joint);
        let contacts = &mut work.self_contact;
        for (place, joint) in joints.iter().enumerate() {
            contacts.row[place] = contacts.change[sparsity.joint(joint.joint)];
        }
        for (sum, places) in contacts.sums.iter_mut().zip(elements()) {
            *sum = contacts.matrix[element(places)];
        }
        for number in 0..pair.points.len() {
            let step = point_step(tree, pair, number, work);
            let contacts = &mut work.self_contact;
            contacts.points[pair.points.start + number].step = step;
            let rows = pair.rows + number * pair.dims * count;
            let weights = pair.weights + number * pair.dims * pair.dims;
            let mut sum = 0;
            for place in 0..count {
                // The column W J of this joint.
                let mut column = [T::zero(); 6];
                for k in 0..pair.dims {
                    for l in 0..pair.dims {
                        let weight = contacts.weights[weights + k * pair.dims + l];
                        column[k] = weight.fma(contacts.rows[rows + l * count + place], column[k]);
                    }
                }
                for k in 0..pair.dims {
                    contacts.row[place] = column[k].fnma(step[k], contacts.row[place]);
                }
                for other in place..count {
                    for k in 0..pair.dims {
                        let row = contacts.rows[rows + k * count + other];
                        contacts.sums[sum] = row.fma(column[k], contacts.sums[sum]);
                    }
                    sum += 1;
                }
            }
        }
        T::leave(active);
        let contacts = &mut work.self_contact;
        for (place, joint) in joints.iter().enumerate() {
            let change = &mut contacts.change[sparsity.joint(joint.joint)];
            *change = contacts.row[place].merge(active, *change);
        }
        for (sum, places) in contacts.sums.iter().zip(elements()) {
            let place = element(places);
            contacts.matrix[place] = sum.merge(active, contacts.matrix[place]);
        }
    }
}

/// Solves the matrix for the right side in `change`, by LDLᵀ.
#[inline(always)]
fn solve<T: Real>(sparsity: &Sparsity, work: &mut Work<T>) {
    let contacts = &mut work.self_contact;
    // The diagonal becomes D⁻¹, the rest L.
    for (k, below) in sparsity.columns() {
        let inverse = contacts.matrix[at(k, k)].recip();
        contacts.matrix[at(k, k)] = inverse;
        let right = contacts.change[k];
        for (number, &j) in below.iter().enumerate() {
            let lower = contacts.matrix[at(j, k)] * inverse;
            contacts.change[j] = lower.fnma(right, contacts.change[j]);
            // Elements of this column at and below row j still contain D.
            for &i in &below[number..] {
                contacts.matrix[at(i, j)] = lower.fnma(contacts.matrix[at(i, k)], contacts.matrix[at(i, j)]);
            }
            contacts.matrix[at(j, k)] = lower;
        }
    }
    // Back substitution with D⁻¹ and Lᵀ: each unknown needs those that were eliminated after it.
    for (k, below) in sparsity.columns().rev() {
        let mut x = contacts.matrix[at(k, k)] * contacts.change[k];
        for &j in below {
            x = contacts.matrix[at(j, k)].fnma(contacts.change[j], x);
        }
        contacts.change[k] = x;
    }
}

separate! {
    /// Keeps the points' steps; returns the slope of their cost and of that of the distant couplings.
    pub(crate) fn steps<T>(tree: &Tree<T::K>, state: &State<T>, work: &mut Work<T>) -> T {
        let mut slope = distant::slope(tree, state, work);
        if apart::<T>(work.self_contact.touching) {
            return slope;
        }
        for index in 0..tree.self_contact.pairs.len() {
            let pair = &tree.self_contact.pairs[index];
            let active = work.self_contact.pairs[index].active;
            if !T::enter(active) {
                continue;
            }
            let before = slope;
            for number in 0..pair.points.len() {
                let step = point_step(tree, pair, number, work);
                let point = &mut work.self_contact.points[pair.points.start + number];
                point.step = step;
                for k in 0..pair.dims {
                    slope = point.force[k].fma(step[k], slope);
                }
            }
            T::leave(active);
            slope = slope.merge(active, before);
        }
        slope
    }
}

separate! {
    /// First and second derivative of the contacts' cost at `alpha` along the step, added to `g`.
    pub(crate) fn points_along<T>(
        tree: &Tree<T::K>,
        alpha: T,
        work: &Work<T>,
        before: (T, T),
        kinks: &mut Kinks<T>,
    ) -> (T, T) {
        let mut g = before;
        if apart::<T>(work.self_contact.touching) {
            return g;
        }
        for index in 0..tree.self_contact.pairs.len() {
            let pair = &tree.self_contact.pairs[index];
            let SelfContactPairWork { active, friction: mu } = work.self_contact.pairs[index];
            if !T::enter(active) {
                continue;
            }
            let before = (g, *kinks);
            for point in &work.self_contact.points[pair.points.clone()] {
                if pair.condim == 1 {
                    // Without friction: the normal alone, a parabola where it presses.
                    let j = alpha.fma(point.step[0], point.residual[0]);
                    let push = T::select_lt(j, T::zero(), point.d * point.step[0], T::zero());
                    g = (push.fma(j, g.0), push.fma(point.step[0], g.1));
                } else if tree.elliptic {
                    let along = (&point.residual, &point.step);
                    g = ellipse_line(pair.condim, &mu, tree.impratio, point.d, along, alpha, g, kinks);
                } else {
                    g = pyramid_line(pair.condim, &mu, point.d, (&point.residual, &point.step), alpha, g);
                }
            }
            T::leave(active);
            g = (g.0.merge(active, before.0.0), g.1.merge(active, before.0.1));
            kinks.merge(active, &before.1);
        }
        g
    }
}

separate! {
    /// Moves the residuals by `alpha` of the step.
    pub(crate) fn advance<T>(tree: &Tree<T::K>, alpha: T, work: &mut Work<T>) {
        if apart::<T>(work.self_contact.touching) {
            return;
        }
        for index in 0..tree.self_contact.pairs.len() {
            let pair = &tree.self_contact.pairs[index];
            let active = work.self_contact.pairs[index].active;
            if !T::enter(active) {
                continue;
            }
            for point in &mut work.self_contact.points[pair.points.clone()] {
                for k in 0..pair.dims {
                    point.residual[k] = alpha.fma(point.step[k], point.residual[k]);
                }
            }
            T::leave(active);
        }
    }
}
