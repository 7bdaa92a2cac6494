//! The forward pass of a step: poses, velocities, inertias, inertial wrenches, and every constraint's rows.
//!
//! Everything is in world axes about one reference point, the base's origin. With the base's linear velocity
//! boosted away, the classical acceleration of a point x is `A_lin + α × x + ω × (v + ω × x)`, so a body's
//! inertial wrench needs only the acceleration of its centre of mass (Newton–Euler, Featherstone 2008, ch. 5).

use gaitfit_model::JointKind;

use crate::contact::{impedance, link_contacts};
use crate::coupling;
use crate::drive::Drive;
use crate::free;
use crate::self_contact::self_contacts;
use crate::spatial::{Rigid, V6, add6, axpy6, dot6, dot6_add, zero6};
use crate::state::{JointWork, Motion, Pose, State, Work};
use crate::tree::{Axis, Link, Tree};
use crate::vec3::*;
use crate::{Damping, JointParams, LinkInertia, Params, Real};

/// What a pass over the tree reads, besides `work`.
pub(crate) struct Pass<'a, T: Real> {
    pub tree: &'a Tree<T::K>,
    pub params: &'a Params<T>,
    pub state: &'a State<T>,
}

/// Fills `work` for the state's pose, velocity and current acceleration.
#[inline(always)]
pub(crate) fn smooth<T: Real>(
    tree: &Tree<T::K>,
    params: &Params<T>,
    state: &State<T>,
    drives: &[Drive<T>],
    work: &mut Work<T>,
) {
    // Apart from the walk over the tree, so that neighbouring joints overlap, and before the root, whose
    // quaternion comes last from the step before.
    for j in 0..work.displacements.len() {
        work.displacements[j] = displacement(&tree.links[j + 1], state.qpos[j]);
    }
    // Slices of one length, which is looked at once.
    let n = work.joints.len();
    let (links, joints, drives) = (&tree.links[1..1 + n], &params.joints[..n], &drives[..n]);
    let (qpos, qvel, limited) = (&state.qpos[..n], &state.qvel[..n], &mut work.limited[..n]);
    for j in 0..n {
        let motion = (qpos[j], qvel[j]);
        joint_rows(tree, &links[j], &joints[j], motion, &drives[j], &mut work.joints[j], &mut limited[j]);
    }
    if !tree.couplings.is_empty() {
        coupling::prepare(tree, params, state, work);
    }
    let root = root_motion(tree, state);
    let (origin, origin_velocity) = if tree.floating {
        (state.base_position, state.base_linear)
    } else {
        (k3::<T>(&tree.root_position), zero3())
    };
    let pass = Pass { tree, params, state };
    // Segments add to the node that they hang on, so all nodes begin at zero.
    for node in &mut work.nodes {
        node.rigid = Rigid::zero();
        node.wrench = zero6();
    }
    if tree.floating {
        let (rigid, wrench) = inertial(&params.links[0], &root);
        work.nodes[0].rigid = rigid;
        work.nodes[0].wrench = wrench;
    }
    if let Some(touching) = tree.links[0].touching {
        work.touching[touching] = Pose { rotation: root.rotation, position: root.position };
    }
    work.nodes[0].motion = root;
    work.nodes[0].jacobian_acceleration = state.base_acceleration;
    for index in 0..tree.segments.len() {
        match tree.segments[index].len {
            1 => walk::<T, 1>(&pass, index, work),
            2 => walk::<T, 2>(&pass, index, work),
            _ => walk::<T, 3>(&pass, index, work),
        }
    }
    // After the walk: the root's inertia and wrench then hold all that hangs on it, and armature adds to them.
    free::prepare(tree, params, state, work);
    for index in 0..tree.touching.len() {
        link_contacts(&pass, index, origin, origin_velocity, work);
    }
    if !tree.self_contact.is_empty() {
        self_contacts(&pass, work);
    }
}

/// Walks one segment of `N` links outward, then gathers its inertia inward.
#[inline(always)]
fn walk<T: Real, const N: usize>(pass: &Pass<'_, T>, index: usize, work: &mut Work<T>) {
    let segment = &pass.tree.segments[index];
    let first = segment.first;
    // Written out, so that the links stay in registers.
    let (mut motion, axis) = outward(pass, first, &work.nodes[segment.parent].motion, work);
    work.segments[index].axis[0] = axis;
    let inner = inertial(&pass.params.links[first], &motion);
    touch(pass, first, &motion, work);
    // In shorter segments nothing reads the values of the links that they lack.
    let (mut middle, mut outer) = (inner, inner);
    if N > 1 {
        let axis;
        (motion, axis) = outward(pass, first + 1, &motion, work);
        work.segments[index].axis[1] = axis;
        middle = inertial(&pass.params.links[first + 1], &motion);
        touch(pass, first + 1, &motion, work);
    }
    if N > 2 {
        let axis;
        (motion, axis) = outward(pass, first + 2, &motion, work);
        work.segments[index].axis[2] = axis;
        outer = inertial(&pass.params.links[first + 2], &motion);
        touch(pass, first + 2, &motion, work);
    }
    if let Some(node) = segment.node {
        // Without velocity products and gravity: rows of contacts need J q̈ alone.
        let mut a = work.nodes[segment.parent].jacobian_acceleration;
        for k in 0..N {
            a = axpy6(pass.state.qacc[first + k - 1], work.segments[index].axis[k], a);
        }
        work.nodes[node].motion = motion;
        work.nodes[node].jacobian_acceleration = a;
    }
    // From the last link inward, each joint takes up the sum of all links that it carries in the segment.
    let mut total = match N {
        1 => inner,
        2 => middle,
        _ => outer,
    };
    if N > 2 {
        gather(pass, index, 2, &total, work);
        total = joined(&total, &middle);
    }
    if N > 1 {
        gather(pass, index, 1, &total, work);
        total = joined(&total, &inner);
    }
    gather(pass, index, 0, &total, work);
    let parent = &mut work.nodes[segment.parent];
    (parent.rigid, parent.wrench) = joined(&(parent.rigid, parent.wrench), &total);
}

/// Inertia and wrench of two bodies together.
#[inline(always)]
fn joined<T: Real>(a: &(Rigid<T>, V6<T>), b: &(Rigid<T>, V6<T>)) -> (Rigid<T>, V6<T>) {
    (a.0.add(&b.0), add6(a.1, b.1))
}

/// Row of joint `k` in its segment's block, from the inertia and wrench of everything it carries there: the force
/// of its unit acceleration and what the joints inward of it feel of that.
#[inline(always)]
fn gather<T: Real>(
    pass: &Pass<'_, T>,
    index: usize,
    k: usize,
    (rigid, wrench): &(Rigid<T>, V6<T>),
    work: &mut Work<T>,
) {
    let j = pass.tree.segments[index].first + k - 1;
    let joint = &work.joints[j];
    let out = &mut work.segments[index];
    let axis = out.axis[k];
    let force = rigid.mul(axis);
    out.force[k] = force;
    out.mass[k] = dot6_add(axis, force, joint.armature);
    // Behind the diagonal the packed matrix has its elements 10, 20 and 21.
    for i in 0..k {
        out.mass[2 + k + i] = dot6(out.axis[i], force);
    }
    // The applied torque counts with a minus sign: the residual is what is left to be balanced.
    let inertial = joint.armature.fma(pass.state.qacc[j], -joint.tau);
    out.residual[k] = dot6_add(axis, *wrench, inertial);
}

/// Keeps the motion of a link with contact pairs.
#[inline(always)]
fn touch<T: Real>(pass: &Pass<'_, T>, link: usize, motion: &Motion<T>, work: &mut Work<T>) {
    if let Some(touching) = pass.tree.links[link].touching {
        work.touching[touching] = Pose { rotation: motion.rotation, position: motion.position };
    }
}

/// Motion of link `i` from its parent's, and its joint's motion subspace.
#[inline(always)]
fn outward<T: Real>(pass: &Pass<'_, T>, i: usize, parent: &Motion<T>, work: &Work<T>) -> (Motion<T>, V6<T>) {
    let j = i - 1;
    let (rotation, position, axis) =
        joint_pose(&pass.tree.links[i], work.displacements[j], &parent.rotation, parent.position);
    let motion = joint_motion(axis, pass.state.qvel[j], pass.state.qacc[j], rotation, position, parent);
    (motion, axis)
}

/// Motion after a joint with subspace `axis`, rate `qd` and acceleration `qacc`.
#[inline(always)]
pub(crate) fn joint_motion<T: Real>(
    axis: V6<T>,
    qd: T,
    qacc: T,
    rotation: M3<T>,
    position: V3<T>,
    parent: &Motion<T>,
) -> Motion<T> {
    // The velocity product V × S q̇ uses the parent's velocity: S × S vanishes.
    let v = parent.velocity;
    let turn = scale(qd, axis[0]);
    let shift = scale(qd, axis[1]);
    let a = parent.acceleration;
    let product = [cross_add(v[0], turn, a[0]), cross_add(v[0], shift, cross_add(v[1], turn, a[1]))];
    Motion {
        rotation,
        position,
        velocity: [add(v[0], turn), add(v[1], shift)],
        acceleration: axpy6(qacc, axis, product),
    }
}

/// Motion of link 0.
#[inline(always)]
pub(crate) fn root_motion<T: Real>(tree: &Tree<T::K>, state: &State<T>) -> Motion<T> {
    // Gravity enters as an opposite acceleration of the root, so no link needs a force of its own
    // (Featherstone 2008, ch. 5).
    let gravity = k3::<T>(&tree.gravity);
    if tree.floating {
        let rotation = quat_matrix(&state.base_quaternion);
        let a = state.base_acceleration;
        let spin: V6<T> = [rotate(&rotation, state.base_angular), zero3()];
        Motion { rotation, position: zero3(), velocity: spin, acceleration: [a[0], sub(a[1], gravity)] }
    } else {
        let (z, one) = (T::zero(), T::lit(1.0));
        Motion {
            rotation: [[one, z, z], [z, one, z], [z, z, one]],
            // The reference point is the fixed body's origin, so the world's lies at the negative of its
            // place.
            position: scale(T::lit(-1.0), k3::<T>(&tree.root_position)),
            velocity: zero6(),
            acceleration: [zero3(), scale(T::lit(-1.0), gravity)],
        }
    }
}

/// Sine and cosine of a hinge's angle from its reference; of a slide how far it is from its own, m, and zero.
#[inline(always)]
pub(crate) fn displacement<T: Real>(link: &Link<T::K>, q: T) -> (T, T) {
    let from_reference = q - T::k(link.reference);
    match link.kind {
        JointKind::Hinge => from_reference.sin_cos(),
        JointKind::Slide => (from_reference, T::zero()),
    }
}

/// Pose of a link and its joint's motion subspace from the parent's pose and the joint's [`displacement`].
#[inline(always)]
pub(crate) fn joint_pose<T: Real>(
    link: &Link<T::K>,
    (s, c): (T, T),
    rotation: &M3<T>,
    position: V3<T>,
) -> (M3<T>, V3<T>, V6<T>) {
    let position = rotate_k_add(rotation, &link.offset, position);
    let mut rotation = *rotation;
    if let Some(turn) = &link.turn {
        let columns = [
            [T::k(turn[0][0]), T::k(turn[1][0]), T::k(turn[2][0])],
            [T::k(turn[0][1]), T::k(turn[1][1]), T::k(turn[2][1])],
            [T::k(turn[0][2]), T::k(turn[1][2]), T::k(turn[2][2])],
        ];
        rotation = each3!(i => each3!(c => dot(rotation[i], columns[c])));
    }
    if link.kind == JointKind::Slide {
        let column = link.axis as usize;
        let axis = each3!(i => rotation[i][column]);
        return (rotation, axpy(s, axis, position), [zero3(), axis]);
    }
    // A turn about one axis mixes the two other columns: (a, b) → (c a + s b, c b − s a).
    let r = rotation;
    let (columns, axis) = match link.axis {
        Axis::X => {
            let [y, z] = mixed(&r, s, c, 1, 2);
            let x = each3!(i => r[i][0]);
            ([x, y, z], x)
        }
        Axis::Y => {
            let [z, x] = mixed(&r, s, c, 2, 0);
            let y = each3!(i => r[i][1]);
            ([x, y, z], y)
        }
        Axis::Z => {
            let [x, y] = mixed(&r, s, c, 0, 1);
            let z = each3!(i => r[i][2]);
            ([x, y, z], z)
        }
    };
    let rotation = each3!(i => each3!(j => columns[j][i]));
    (rotation, position, [axis, cross(position, axis)])
}

#[inline(always)]
fn mixed<T: Real>(r: &M3<T>, s: T, c: T, a: usize, b: usize) -> [V3<T>; 2] {
    [each3!(i => s.fma(r[i][b], c * r[i][a])), each3!(i => s.fnma(r[i][a], c * r[i][b]))]
}

/// World inertia and inertial wrench of a link that moves with `m`.
#[inline(always)]
pub(crate) fn inertial<T: Real>(p: &LinkInertia<T>, m: &Motion<T>) -> (Rigid<T>, V6<T>) {
    let c = rotate_add(&m.rotation, p.com, m.position);
    let central = inertia_rotate(&m.rotation, &p.inertia);
    let h = scale(p.mass, c);
    // Moved from the centre of mass to the reference point (parallel axes): m (c·c 1 − c cᵀ) is added.
    let rigid = Rigid {
        m: p.mass,
        h,
        i: [
            h[1].fma(c[1], h[2].fma(c[2], central[0])),
            h[0].fma(c[0], h[2].fma(c[2], central[1])),
            h[0].fma(c[0], h[1].fma(c[1], central[2])),
            h[0].fnma(c[1], central[3]),
            h[0].fnma(c[2], central[4]),
            h[1].fnma(c[2], central[5]),
        ],
    };
    // Newton and Euler about the centre of mass; the moment is then taken about the reference point.
    let (w, a) = (m.velocity[0], m.acceleration);
    let v = cross_add(w, c, m.velocity[1]);
    let f = scale(p.mass, cross_add(w, v, cross_add(a[0], c, a[1])));
    let n = cross_add(w, sym_mul(&central, w), sym_mul(&central, a[0]));
    (rigid, [cross_add(c, f, n), f])
}

/// Applied torque, friction-loss row and limit row of the joint of `link` at position `q` and velocity `qd`.
#[inline(always)]
fn joint_rows<T: Real>(
    tree: &Tree<T::K>,
    link: &Link<T::K>,
    p: &JointParams<T>,
    (q, qd): (T, T),
    drive: &Drive<T>,
    out: &mut JointWork<T>,
    limited: &mut T::Guard,
) {
    let z = T::zero();
    let one = T::lit(1.0);
    let pull = match &drive.gear {
        // The rotor's damping acts behind the gear.
        Some(gear) => gear.resistance.fnma(qd, gear.torque),
        None => p.damping.fnma(qd, drive.torque),
    };
    out.tau = pull + p.stiffness.fnma(q, p.spring_torque);
    // The model's own spring; the one before it is a parameter of the robot.
    if link.has_spring {
        out.tau = T::k(link.stiffness).fnma(q - T::k(link.springref), out.tau);
    }
    // Damping that is integrated implicitly. Behind a gear it is part of the gear's resistance already.
    let implicit = match tree.settings.damping {
        Damping::Explicit => z,
        _ if drive.gear.is_some() => z,
        _ if tree.settings.implicit_actuators => p.damping + drive.damping,
        _ => p.damping,
    };
    let settings = &tree.settings;
    // Time from the step's start to the velocity that damping acts on: the whole step in MuJoCo's way, else
    // the lead.
    let explicit = settings.emulated_step.is_none() && !settings.centred;
    let h = T::lit(if explicit { settings.timestep } else { settings.drive_lead() });
    out.implicit = h * implicit;
    let folded = if tree.settings.damping == Damping::Folded { implicit } else { z };
    // The link behind a gear feels the gear's resistance over the step instead of the rotor's inertia.
    out.armature = match &drive.gear {
        Some(gear) => T::lit(settings.timestep) * gear.resistance,
        None => p.armature + h * (folded + drive.resistance),
    };

    out.friction_d = p.weight * T::k(link.friction_weight);
    out.friction_bias = out.friction_d * (T::k(link.friction_b) * qd);
    // Behind a gear dry friction acts on the rotor and not on the link.
    out.frictionloss = if drive.gear.is_some() { z } else { dry_friction(p, qd, drive.torque) };
    if let Some(limit) = &link.limit {
        let (low, high) = (q - T::k(limit.lower), T::k(limit.upper) - q);
        // Only the nearer limit can act: `compile_limit` refuses ranges in which both could.
        let sign = T::select_lt(high, low, -one, one);
        let depth = low.min(high) - T::k(limit.margin);
        *limited = depth.unless_ge(z);
        if !T::enter(*limited) {
            return;
        }
        let imp = impedance(&limit.impedance, depth);
        let d = (imp * (p.weight * T::k(limit.reference.gain))) * (one - imp).recip();
        out.limit_sign = sign;
        out.limit_d = T::select_lt(depth, z, d, z);
        out.limit_bias = T::k(limit.reference.b).fma(sign * qd, T::k(limit.reference.k) * (imp * depth));
        T::leave(*limited);
    }
}

/// Largest dry friction of a joint at velocity `qd` whose motor gives `torque`, N·m.
///
/// Gears that carry more rub more (Hamon, Gautier and Garrec 2010): the torque is that of the motor in this step.
#[inline(always)]
pub(crate) fn dry_friction<T: Real>(p: &JointParams<T>, qd: T, torque: T) -> T {
    let mut bound = p.frictionloss;
    let sticky = p.stiction.unless_zero();
    if T::enter(sticky) {
        let stuck = friction_bound(p, qd);
        T::leave(sticky);
        bound = stuck.merge(sticky, p.frictionloss);
    }
    let loaded = p.load_friction.unless_zero();
    if T::enter(loaded) {
        let more = p.load_friction.fma(torque.abs(), bound);
        T::leave(loaded);
        bound = more.merge(loaded, bound);
    }
    bound
}

/// Largest dry friction at velocity `qd`: frictionloss + stiction · exp(−(q̇/v)²), v the Stribeck velocity
/// (Armstrong-Hélouvry, Dupont and Canudas de Wit 1994, eq. 5, with their δ = 2). MuJoCo's bound is constant; here it is
/// that of the velocity at the step's start.
#[inline(always)]
fn friction_bound<T: Real>(p: &JointParams<T>, qd: T) -> T {
    let one = T::lit(1.0);
    let x = qd.div(p.stribeck_velocity);
    // exp(−2y) = (1 − tanh y)/(1 + tanh y): a scalar has a hyperbolic tangent and no exponential.
    let y = (T::lit(0.5) * x * x).tanh();
    // Rounding may take tanh a little above 1, and friction must not fall below that in motion.
    let left = (one - y).max(T::zero()) * (one + y).recip();
    p.stiction.fma(left, p.frictionloss)
}
