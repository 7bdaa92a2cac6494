//! Joints that follow others: MuJoCo's equality constraints of joints.
//!
//! The row of a coupling is J a − aref with J = 1 at the follower and −s at the leader, s the slope of its polynomial at the
//! leader's position. It is always active. `mj_diagApprox` takes the sum of both joints' `dof_invweight0`, without s.
//!
//! A coupling of joints in one segment is part of the segment's block. All others are distant: the tree's factorisation
//! does not know them, and the correction of self-contacts takes them ([`distant`]).

mod compile;
pub(crate) mod distant;

use crate::contact::impedance;
use crate::separate::separate;
use crate::state::{State, Work};
use crate::tree::{Coupling, Tree};
use crate::{Params, Real};

pub(crate) use compile::{Spans, compile};

/// The row of a coupling during one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct CouplingWork<T> {
    /// Weight D of the row, kg·m² or kg.
    pub d: T,
    /// Minus the row's reference acceleration.
    pub bias: T,
    /// How far the follower moves for a unit of the leader.
    pub slope: T,
}

impl<T: Real> CouplingWork<T> {
    pub fn zero() -> Self {
        let z = T::zero();
        Self { d: z, bias: z, slope: z }
    }
}

separate! {
    /// Rows of all couplings at the state's pose and velocity.
    pub(crate) fn prepare<T>(tree: &Tree<T::K>, params: &Params<T>, state: &State<T>, work: &mut Work<T>) {
        for (index, coupling) in tree.couplings.iter().enumerate() {
            let moved = |joint: usize| state.qpos[joint] - T::k(tree.links[joint + 1].reference);
            // The gap is the follower's position less the polynomial of the leader's, and is to be zero.
            let mut gap = moved(coupling.follower) - T::k(coupling.polynomial[0]);
            let mut velocity = state.qvel[coupling.follower];
            let mut weight = params.joints[coupling.follower].weight;
            let mut slope = T::zero();
            if let Some(leader) = coupling.leader {
                let x = moved(leader);
                // The constant term is part of the gap already, and the slope does not need it.
                let [_, linear, square, cube, fourth] = coupling.polynomial.map(|c| T::k(c));
                gap = x.fnma(x.fma(x.fma(x.fma(fourth, cube), square), linear), gap);
                let [square, cube, fourth] = [T::lit(2.0) * square, T::lit(3.0) * cube, T::lit(4.0) * fourth];
                // The same polynomial's derivative.
                slope = x.fma(x.fma(x.fma(fourth, cube), square), linear);
                velocity = slope.fnma(state.qvel[leader], velocity);
                // The reciprocal of the sum of both joints' inverse inertias.
                let other = params.joints[leader].weight;
                weight = weight * other * (weight + other).recip();
            }
            let reference = &coupling.reference;
            let imp = impedance(&coupling.impedance, gap);
            // MuJoCo's D is d / ((1 − d) · invweight), and `weight` is the reciprocal of the inverse weight.
            let d = imp * weight * T::k(reference.gain) * (T::lit(1.0) - imp).recip();
            let bias = T::k(reference.b).fma(velocity, T::k(reference.k) * imp * gap);
            work.couplings[index] = CouplingWork { d, bias, slope };
        }
    }
}

/// The row's Jacobian times accelerations or steps; `joint`: those of a joint.
#[inline(always)]
fn along_row<T: Real>(coupling: &Coupling<T::K>, row: &CouplingWork<T>, joint: impl Fn(usize) -> T) -> T {
    let follower = joint(coupling.follower);
    coupling.leader.map_or(follower, |leader| row.slope.fnma(joint(leader), follower))
}

/// What a coupling adds to the system that is solved, as `(joint, other joint, number)`.
pub(crate) struct Terms<T> {
    /// Negative torques.
    pub torques: [Option<(usize, T)>; 2],
    /// Elements of the Hessian, on and below the diagonal.
    pub hessian: [Option<(usize, usize, T)>; 3],
}

/// A coupling's terms at the present accelerations.
#[inline(always)]
pub(crate) fn terms<T: Real>(tree: &Tree<T::K>, index: usize, state: &State<T>, work: &Work<T>) -> Terms<T> {
    let coupling = &tree.couplings[index];
    let row = work.couplings[index];
    let follower = coupling.follower;
    let force = row.d * (along_row(coupling, &row, |joint| state.qacc[joint]) + row.bias);
    let Some(leader) = coupling.leader else {
        return Terms {
            torques: [Some((follower, force)), None],
            hessian: [Some((follower, follower, row.d)), None, None],
        };
    };
    // The Hessian is Jᵀ D J with J = (1, −slope).
    let mixed = -(row.slope * row.d);
    Terms {
        torques: [Some((follower, force)), Some((leader, -(row.slope * force)))],
        hessian: [
            Some((follower, follower, row.d)),
            Some((leader, leader, -(row.slope * mixed))),
            // Below the diagonal: the later joint is the row.
            Some((follower.max(leader), follower.min(leader), mixed)),
        ],
    }
}

/// The terms of a coupling within one segment. Its torques are also added to the joints' rows.
#[inline(always)]
pub(crate) fn near_terms<T: Real>(
    tree: &Tree<T::K>,
    index: usize,
    state: &State<T>,
    work: &mut Work<T>,
) -> Terms<T> {
    let terms = terms(tree, index, state, work);
    for &(joint, torque) in terms.torques.iter().flatten() {
        // The slope of the rows' cost along a step is read from the joints' rows.
        let joint = &mut work.joints[joint];
        joint.row = joint.row + torque;
    }
    terms
}

separate! {
    /// `g` with the first and second derivative of the rows' cost at `alpha` along the step.
    pub(crate) fn along<T>(
        tree: &Tree<T::K>,
        alpha: T,
        state: &State<T>,
        work: &Work<T>,
        before: (T, T),
    ) -> (T, T) {
        let mut g = before;
        for (coupling, row) in tree.couplings.iter().zip(&work.couplings) {
            let step = along_row(coupling, row, |joint| work.joints[joint].step);
            let now = along_row(coupling, row, |joint| state.qacc[joint]) + row.bias;
            let curve = row.d * step;
            // The row acts at both signs of the residual, so its cost is one parabola without a case
            // distinction.
            g.0 = curve.fma(alpha.fma(step, now), g.0);
            g.1 = curve.fma(step, g.1);
        }
        g
    }
}
