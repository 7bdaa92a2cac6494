//! Couplings of joints in different segments: rows that always act, in the correction of self-contacts.

use crate::Real;
use crate::coupling::{Terms, along_row, terms};
use crate::state::{State, Work};
use crate::tree::Tree;

/// `J` of the joints' steps of coupling `index`.
#[inline(always)]
fn row_step<T: Real>(tree: &Tree<T::K>, index: usize, work: &Work<T>) -> T {
    along_row(&tree.couplings[index], &work.couplings[index], |joint| work.joints[joint].step)
}

/// Adds the torque of each distant coupling to `work.self_contact.torque`, N·m.
#[inline(always)]
pub(crate) fn add_torques<T: Real>(tree: &Tree<T::K>, state: &State<T>, work: &mut Work<T>) {
    for index in tree.self_contact.couplings.clone() {
        for (joint, torque) in terms(tree, index, state, work).torques.into_iter().flatten() {
            work.self_contact.torque[joint] = work.self_contact.torque[joint] + torque;
        }
    }
}

/// Adds the couplings' Hessian C to the matrix and −C s₀ to the right side, and keeps the rows' steps at s₀.
#[inline(always)]
pub(crate) fn couple<T: Real>(tree: &Tree<T::K>, state: &State<T>, work: &mut Work<T>) {
    let sparsity = &tree.self_contact.sparsity;
    for (number, index) in tree.self_contact.couplings.clone().enumerate() {
        let Terms { hessian, .. } = terms(tree, index, state, work);
        let step = row_step(tree, index, work);
        let (coupling, row) = (&tree.couplings[index], work.couplings[index]);
        let contacts = &mut work.self_contact;
        contacts.coupling_steps[number] = step;
        for (k, i, element) in hessian.into_iter().flatten() {
            let sum = &mut contacts.matrix[sparsity.joints(k, i)];
            *sum = *sum + element;
        }
        // The right side loses Jᵀ D J s₀, with J = 1 at the follower and −slope at the leader.
        let pull = row.d * step;
        let follower = &mut contacts.change[sparsity.joint(coupling.follower)];
        *follower = *follower - pull;
        if let Some(leader) = coupling.leader {
            let leader = &mut contacts.change[sparsity.joint(leader)];
            *leader = row.slope.fma(pull, *leader);
        }
    }
}

/// What the correction of the step adds to the slope: s₀ᵀ C s.
#[inline(always)]
pub(crate) fn change_of_slope<T: Real>(tree: &Tree<T::K>, work: &Work<T>) -> T {
    let mut slope = T::zero();
    for (number, index) in tree.self_contact.couplings.clone().enumerate() {
        let weight = work.couplings[index].d * work.self_contact.coupling_steps[number];
        slope = weight.fma(row_step(tree, index, work), slope);
    }
    slope
}

/// The slope of the couplings' cost along the step.
#[inline(always)]
pub(crate) fn slope<T: Real>(tree: &Tree<T::K>, state: &State<T>, work: &Work<T>) -> T {
    let mut slope = T::zero();
    for index in tree.self_contact.couplings.clone() {
        for (joint, torque) in terms(tree, index, state, work).torques.into_iter().flatten() {
            slope = torque.fma(work.joints[joint].step, slope);
        }
    }
    slope
}
