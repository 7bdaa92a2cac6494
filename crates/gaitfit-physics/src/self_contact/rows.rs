//! The rows of self-contacts.

use crate::Real;
use crate::contact::{impedance, row_scale};
use crate::self_contact::narrow::{Spot, center, spots};
use crate::self_contact::{MAX_POINTS, SelfContactPair, SelfContactPoint};
use crate::separate::separate;
use crate::smooth::Pass;
use crate::state::Work;
use crate::vec3::*;
use gaitfit_model::MIN_FRICTION;

separate! {
    /// Contact points of all self-contact pairs.
    pub(crate) fn self_contacts<T>(pass: &Pass<'_, T>, work: &mut Work<T>) {
        let Pass { tree, params, .. } = *pass;
        let contacts = &tree.self_contact;
        // How far the surfaces are from a contact, where they are nearest to one. Distant couplings always act.
        let mut gap = T::lit(if contacts.couplings.is_empty() { 1.0 } else { -1.0 });
        for index in 0..contacts.pairs.len() {
            let pair = &contacts.pairs[index];
            let [first, second] = &pair.shapes;
            let poses = [&work.touching[first.pose], &work.touching[second.pose]];
            let centers = [center(first, poses[0]), center(second, poses[1])];
            // The balls about both shapes first: they spare distant pairs the search for the nearest points.
            let between = sub(centers[1], centers[0]);
            let near = (dot(between, between) - T::k(pair.reach2)).unless_ge(T::zero());
            let mut spots_of_pair = [Spot::far(); MAX_POINTS];
            if T::enter(near) {
                let new = spots(pair, poses, centers);
                T::leave(near);
                for k in 0..pair.points.len() {
                    spots_of_pair[k] = new[k].merge(near, &spots_of_pair[k]);
                }
            }
            let mut closest = spots_of_pair[0].distance;
            for spot in &spots_of_pair[1..pair.points.len()] {
                closest = closest.min(spot.distance);
            }
            closest = closest - T::k(pair.margin);
            gap = gap.min(closest);
            let active = closest.unless_ge(T::zero());
            work.self_contact.pairs[index].active = active;
            if !T::enter(active) {
                continue;
            }
            for k in 0..5 {
                let mu = params.robot.friction_scale * T::k(pair.friction[k]);
                work.self_contact.pairs[index].friction[k] = mu.max(T::lit(MIN_FRICTION));
            }
            let friction = work.self_contact.pairs[index].friction[0];
            let weight = params.pairs[tree.pairs.len() + index].translation;
            let inverse_scale = row_scale(tree, pair.condim, friction, weight) * T::k(pair.reference.gain);
            for number in 0..pair.points.len() {
                point(pass, pair, number, &spots_of_pair[number], inverse_scale, work);
            }
            T::leave(active);
        }
        work.self_contact.touching = gap.unless_ge(T::zero());
    }
}

/// Rows, D and residual `J a − aref` of one point.
#[inline(always)]
fn point<T: Real>(
    pass: &Pass<'_, T>,
    pair: &SelfContactPair<T::K>,
    number: usize,
    spot: &Spot<T>,
    inverse_scale: T,
    work: &mut Work<T>,
) {
    let Pass { tree, state, .. } = *pass;
    let frame = spot.frame();
    let joints = &tree.self_contact.joints[pair.joints.clone()];
    let count = joints.len();
    let start = pair.rows + number * pair.dims * count;
    // Joints that carry both links, and the base, move both points alike: they are not among `joints`.
    let (mut v, mut a) = ([T::zero(); 6], [T::zero(); 6]);
    for (place, contacts) in joints.iter().enumerate() {
        let (segment, member) = tree.self_contact.homes[contacts.joint];
        let axis = work.segments[segment].axis[member];
        // A row is the velocity of the second link's point less that of the first's.
        let sign = T::lit(if contacts.second { 1.0 } else { -1.0 });
        let linear = scale(sign, rotate(&frame, cross_add(axis[0], spot.x, axis[1])));
        let angular = scale(sign, rotate(&frame, axis[0]));
        let (qd, qacc) = (state.qvel[contacts.joint], state.qacc[contacts.joint]);
        for k in 0..pair.dims {
            let row = if k < 3 { linear[k] } else { angular[k - 3] };
            work.self_contact.rows[start + k * count + place] = row;
            v[k] = qd.fma(row, v[k]);
            a[k] = qacc.fma(row, a[k]);
        }
    }
    let depth = spot.distance - T::k(pair.margin);
    let imp = impedance(&pair.impedance, depth);
    // As in `contact::point_rows`.
    let d = imp * ((T::lit(1.0) - imp) * inverse_scale).recip();
    let (b, bf) = (T::k(pair.reference.b), T::k(pair.friction_b));
    let spring = T::k(pair.reference.k) * (imp * depth);
    let z = T::zero();
    let mut residual = [z; 6];
    residual[0] = b.fma(v[0], a[0] + spring);
    for k in 1..pair.dims {
        residual[k] = bf.fma(v[k], a[k]);
    }
    work.self_contact.points[pair.points.start + number] =
        SelfContactPoint { d: T::select_lt(depth, z, d, z), residual, step: [z; 6], force: [z; 6] };
}
