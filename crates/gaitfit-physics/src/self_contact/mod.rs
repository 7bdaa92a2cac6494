//! Contact between the robot's own parts: spheres, capsules and boxes of different links, chosen pairs of them.
//!
//! A contact's rows are the difference of the velocities of two links at one point. The joints that carry both links
//! cancel in it, and so does the base; what is left couples two limbs, which the tree's factorisation does not know.
//! So a Newton step is solved along the tree first, with the contacts' forces but without their Hessian JᵀWJ. Where
//! something touches, H s = H s₀ − JᵀWJ s₀ corrects it, with the whole Hessian as one sparse matrix ([`solve`]). Where
//! nothing does the correction is zero, and it is left out if that is so in all lanes.
//!
//! Couplings of joints in different segments ([`crate::coupling::distant`]) are rows that always act: the correction takes
//! them too.
//!
//! A robot with neither does none of this.

mod compile;
mod narrow;
mod rows;
mod solve;
mod sparsity;

use std::ops::Range;

use crate::Real;
use crate::spatial::Articulated;
use crate::tree::{Impedance, Reference};

pub(crate) use compile::compile;
pub(crate) use rows::self_contacts;
pub(crate) use solve::{advance, correct, points_along, steps, terms};
pub(crate) use sparsity::Sparsity;

/// A shape in its link's frame.
#[derive(Clone, Debug)]
pub(crate) struct SelfContactShape<K> {
    /// Place of its link's pose among those of links that touch.
    pub pose: usize,
    pub center: [K; 3],
    pub radius: K,
    pub form: Form<K>,
}

/// What a shape is, beside its radius.
#[derive(Clone, Debug)]
pub(crate) enum Form<K> {
    Ball,
    /// The half axis, m.
    Rod([K; 3]),
    /// Unit axes, and half sizes, m.
    Block([[K; 3]; 3], [K; 3]),
}

/// Two shapes that may touch, in the order of MuJoCo's geom types.
#[derive(Clone, Debug)]
pub(crate) struct SelfContactPair<K> {
    pub shapes: [SelfContactShape<K>; 2],
    /// Square of the distance of the centres beyond which they cannot touch, m².
    pub reach2: K,
    pub condim: usize,
    pub friction: [K; 5],
    pub margin: K,
    pub impedance: Impedance<K>,
    pub reference: Reference<K>,
    /// Damping of the friction dimensions (elliptic cones).
    pub friction_b: K,
    pub points: Range<usize>,
    /// Components that a point's rows have: 3, or 6 with spin.
    pub dims: usize,
    /// Of the joints that carry one of the two alone, in rising order.
    pub joints: Range<usize>,
    /// Places of the first point's rows and weights. A point has `dims × joints` and `dims × dims`.
    pub rows: usize,
    pub weights: usize,
}

/// A joint of a pair, and whether it moves the second shape.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SelfContactJoint {
    pub joint: usize,
    pub second: bool,
}

/// All self-contact pairs of a tree, and which of its couplings are corrected for beside them.
#[derive(Clone, Debug)]
pub(crate) struct SelfContacts<K> {
    pub pairs: Vec<SelfContactPair<K>>,
    pub joints: Vec<SelfContactJoint>,
    /// Segment of each joint and its place there.
    pub homes: Vec<(usize, usize)>,
    /// Link of each pair with the ground.
    pub ground_links: Vec<usize>,
    /// Numbers of all points, rows and weights.
    pub points: usize,
    pub rows: usize,
    pub weights: usize,
    /// The distant ones of the tree's couplings.
    pub couplings: Range<usize>,
    /// The nonzero pattern of the Hessian.
    pub sparsity: Sparsity,
}

impl<K> SelfContacts<K> {
    /// Whether there are neither pairs nor distant couplings.
    pub fn is_empty(&self) -> bool {
        self.pairs.is_empty() && self.couplings.is_empty()
    }
}

/// Most points of a pair.
pub(crate) const MAX_POINTS: usize = 2;

/// One point of self-contact. Components are in the order normal, tangents, and the same of the rotation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SelfContactPoint<T> {
    /// D of the normal (elliptic) or of every edge (pyramidal); zero without contact.
    pub d: T,
    /// `J a − aref`.
    pub residual: [T; 6],
    /// `J` of the Newton step.
    pub step: [T; 6],
    /// Negative of the contact force.
    pub force: [T; 6],
}

/// A pair in the current step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SelfContactPairWork<T: Real> {
    /// Guards the numbers of the pair: active unless its two shapes are at least the margin apart.
    pub active: T::Guard,
    pub friction: [T; 5],
}

/// Scratch of the self-contacts; empty for robots without.
#[derive(Clone, Debug)]
pub(crate) struct SelfContactWork<T: Real> {
    pub pairs: Vec<SelfContactPairWork<T>>,
    /// Valid only where the guard of their pair is active.
    pub points: Vec<SelfContactPoint<T>>,
    /// Rows of the Jacobian over the pair's joints, and the Hessians of the cones.
    pub rows: Vec<T>,
    pub weights: Vec<T>,
    /// Guards what is only needed where something touches; active if there are distant couplings.
    pub touching: T::Guard,
    /// Negative torque of the contacts and the distant couplings on each joint, N·m.
    pub torque: Vec<T>,
    /// Lower triangle of the Hessian, in the order of [`Sparsity`].
    pub matrix: Vec<T>,
    /// Values of a region until they are merged; and a right side in the same order.
    pub row: Vec<T>,
    pub change: Vec<T>,
    /// Rows of the distant couplings times the step before its correction.
    pub coupling_steps: Vec<T>,
    /// Sums that the guarded region of a pair computes, until they are merged.
    pub sums: Vec<T>,
    /// Inertia that each link carries beyond its own segment, contacts with the ground included.
    pub carried: Vec<Articulated<T>>,
}

impl<T: Real> SelfContactWork<T> {
    /// Scratch for the pairs of a tree with so many links; `floating`: whether the base moves.
    pub fn new<K>(contacts: &SelfContacts<K>, links: usize, floating: bool) -> Self {
        let z = T::zero();
        // A robot whose parts do not touch needs no room for this.
        let some = |count: usize| if contacts.is_empty() { 0 } else { count };
        // No joint moves link 0, which is the root.
        let joints = links - 1;
        let n = some(joints + if floating { 6 } else { 0 });
        let point = SelfContactPoint { d: z, residual: [z; 6], step: [z; 6], force: [z; 6] };
        Self {
            pairs: vec![SelfContactPairWork { active: T::never(), friction: [z; 5] }; contacts.pairs.len()],
            points: vec![point; contacts.points],
            rows: vec![z; contacts.rows],
            weights: vec![z; contacts.weights],
            touching: T::never(),
            torque: vec![z; some(joints)],
            // Room for a full lower triangle, the largest pattern that there can be.
            matrix: vec![z; n * (n + 1) / 2],
            row: vec![z; n],
            change: vec![z; n],
            coupling_steps: vec![z; contacts.couplings.len()],
            sums: vec![z; n * (n + 1) / 2],
            carried: vec![Articulated::zero(); some(links)],
        }
    }
}
