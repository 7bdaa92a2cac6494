//! State of one block of environments and the scratch of one step. Made once by the caller.

use crate::Real;
use crate::coupling::CouplingWork;
use crate::free::FreeWork;
use crate::self_contact::SelfContactWork;
use crate::spatial::{Articulated, Rigid, V6, zero6};
use crate::tree::{SEGMENT, Tree};
use crate::vec3::*;
use crate::visit::{Owner, Slot, all, visit_methods};

/// Motion state, with the last acceleration as the solver's warm start.
#[derive(Clone, Debug)]
pub struct State<T> {
    /// Position of the floating base, m, world frame.
    pub base_position: V3<T>,
    /// Orientation of the floating base, wxyz, unit.
    pub base_quaternion: [T; 4],
    /// Linear velocity of the base's origin, m/s, world frame.
    pub base_linear: V3<T>,
    /// Angular velocity of the base, rad/s, body frame.
    pub base_angular: V3<T>,
    /// Joint positions, rad, of slides m.
    pub qpos: Vec<T>,
    /// Joint velocities, rad/s, of slides m/s.
    pub qvel: Vec<T>,
    /// Base acceleration of the last step: angular (rad/s²) and linear (m/s²), world frame.
    pub base_acceleration: [V3<T>; 2],
    /// Joint accelerations of the last step, rad/s², of slides m/s².
    pub qacc: Vec<T>,
}

impl<T: Real> State<T> {
    /// At rest at the origin with all joint angles zero.
    pub fn new<K>(tree: &Tree<K>) -> Self {
        let zeros = vec![T::zero(); tree.joints()];
        Self {
            base_position: zero3(),
            base_quaternion: [T::lit(1.0), T::zero(), T::zero(), T::zero()],
            base_linear: zero3(),
            base_angular: zero3(),
            qpos: zeros.clone(),
            qvel: zeros.clone(),
            base_acceleration: zero6(),
            qacc: zeros,
        }
    }
}

macro_rules! state_numbers {
    ($state:ident, $visit:ident, $numbers:ident, [$($reference:tt)+]) => {
        let base = |name| Slot::new(Owner::Base, name);
        all(&mut $visit, base("position"), $($reference)+ $state.base_position);
        all(&mut $visit, base("quaternion"), $($reference)+ $state.base_quaternion);
        all(&mut $visit, base("linear"), $($reference)+ $state.base_linear);
        all(&mut $visit, base("angular"), $($reference)+ $state.base_angular);
        for (j, angle) in ($($reference)+ $state.qpos).into_iter().enumerate() {
            $visit(Slot::new(Owner::Joint(j), "qpos"), angle);
        }
        for (j, velocity) in ($($reference)+ $state.qvel).into_iter().enumerate() {
            $visit(Slot::new(Owner::Joint(j), "qvel"), velocity);
        }
        for (j, acceleration) in ($($reference)+ $state.qacc).into_iter().enumerate() {
            $visit(Slot::new(Owner::Joint(j), "qacc"), acceleration);
        }
        let acceleration = ($($reference)+ $state.base_acceleration).into_iter().flatten();
        all(&mut $visit, base("acceleration"), acceleration);
    };
}

impl<T> State<T> {
    visit_methods!(state_numbers);
}

/// Pose and motion of a link, about the reference point (the base's origin), world axes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion<T> {
    pub rotation: M3<T>,
    /// Link origin from the reference point.
    pub position: V3<T>,
    /// Velocity with the base's linear velocity taken away (Galilean boost: forces do not depend on it).
    pub velocity: V6<T>,
    /// Acceleration with velocity products, the current `qacc`, and minus gravity.
    pub acceleration: V6<T>,
}

/// Pose of a link about the reference point, world axes.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Pose<T> {
    pub rotation: M3<T>,
    pub position: V3<T>,
}

/// A node during one step: the root, or a link that carries segments.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Node<T> {
    pub motion: Motion<T>,
    /// `J qacc` alone.
    pub jacobian_acceleration: V6<T>,
    /// Rigid inertia of the segments that hang here, and at the root the base's own.
    pub rigid: Rigid<T>,
    /// Their inertial wrench at the current acceleration, velocity products and gravity included.
    pub wrench: V6<T>,
    /// Articulated inertia and residual wrench of one Newton step.
    pub inertia: Articulated<T>,
    pub residual: V6<T>,
    /// Acceleration of the Newton step.
    pub step: V6<T>,
    /// Inertial wrench of the Newton step.
    pub step_wrench: V6<T>,
}

impl<T: Real> Node<T> {
    /// Adds a contact point's force, and its Hessian if asked.
    #[inline(always)]
    pub fn push(&mut self, point: &Point<T>, hessian: bool) {
        let (x, f) = (point.x, point.world_force);
        self.residual = [cross_add(x, f, self.residual[0]), add(self.residual[1], f)];
        if hessian {
            self.inertia.add_point(x, &point.weight);
        }
    }
}

/// A segment during one step. Arrays are as long as the longest segment.
#[derive(Clone, Copy, Debug)]
pub(crate) struct SegmentWork<T> {
    /// Motion subspaces of the hinges.
    pub axis: [V6<T>; SEGMENT],
    /// Mass matrix of the segment's joints (00, 11, 22, 10, 20, 21), armature included.
    pub mass: [T; 6],
    /// Its coupling to the node's acceleration.
    pub force: [V6<T>; SEGMENT],
    /// Inertial and bias torque minus applied torque at the current acceleration.
    pub residual: [T; SEGMENT],
    /// The same for the Newton step.
    pub step_residual: [T; SEGMENT],
    /// Of LDLᵀ: unit lower factor (10, 20, 21), L⁻¹ of the coupling, D⁻¹, and D⁻¹L⁻¹ of the residual.
    pub lower: [T; 3],
    pub coupling: [V6<T>; SEGMENT],
    pub inverse: [T; SEGMENT],
    pub solved: [T; SEGMENT],
}

/// A joint's rows and step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JointWork<T> {
    /// Applied torque: drive, damping and spring.
    pub tau: T,
    /// Armature in the solver's mass matrix.
    pub armature: T,
    /// Timestep times the damping that the integrator treats implicitly.
    pub implicit: T,
    /// D of the friction-loss row, minus D times its aref.
    pub friction_d: T,
    pub friction_bias: T,
    pub frictionloss: T,
    /// +1 near the lower limit, −1 near the upper.
    pub limit_sign: T,
    pub limit_d: T,
    /// Minus aref.
    pub limit_bias: T,
    /// Negative of the rows' torque.
    pub row: T,
    /// Newton step.
    pub step: T,
}

/// Constraint state of one contact pair.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PairWork<T: Real> {
    /// Guards what is only needed where a lane may touch.
    pub active: T::Guard,
    pub friction: [T; 5],
}

/// One contact point during one step. Contact components are in the order normal, tangents, and the same
/// of the rotation.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Point<T> {
    /// From the reference point, m.
    pub x: V3<T>,
    pub distance: T,
    /// D of the normal (elliptic) or of every edge (pyramidal); zero without contact.
    pub d: T,
    /// `J a − aref`.
    pub residual: [V3<T>; 2],
    /// `J` of the Newton step.
    pub step: [V3<T>; 2],
    /// Negative of the contact force.
    pub force: [V3<T>; 2],
    /// The same of three components in world axes, and their Hessian; zero where a contact has more
    /// ([`Work::spins`] holds those).
    pub world_force: V3<T>,
    pub weight: Sym3<T>,
    /// Velocity of the point for a unit rate of each joint of its segment, world axes.
    pub columns: [V3<T>; SEGMENT],
    /// Rows: normal and tangents, world axes.
    pub frame: M3<T>,
}

/// Scratch of one step for one block of environments.
#[derive(Clone, Debug)]
pub struct Work<T: Real> {
    pub(crate) nodes: Vec<Node<T>>,
    pub(crate) segments: Vec<SegmentWork<T>>,
    pub(crate) joints: Vec<JointWork<T>>,
    /// Rows of joints that follow others.
    pub(crate) couplings: Vec<CouplingWork<T>>,
    /// Guards what is only needed where a lane may be beyond the joint's limit; apart, for it would take a joint a
    /// whole vector.
    pub(crate) limited: Vec<T::Guard>,
    /// How far each joint is from its reference (`smooth::displacement`): sine and cosine of a hinge's angle; of a slide the
    /// distance, m, and zero.
    pub(crate) displacements: Vec<(T, T)>,
    pub(crate) pairs: Vec<PairWork<T>>,
    pub(crate) points: Vec<Point<T>>,
    /// Negative wrench and 6 × 6 Hessian of each point with spin (condim above 3), in point order.
    pub(crate) spins: Vec<(V6<T>, Articulated<T>)>,
    /// Pose of each link with contact pairs.
    pub(crate) touching: Vec<Pose<T>>,
    /// Of a free joint that resists the base's motion; empty without one.
    pub(crate) free: Vec<FreeWork<T>>,
    /// Self-contact. `visit` leaves it out: what is recorded has none.
    pub(crate) self_contact: SelfContactWork<T>,
}

macro_rules! work_numbers {
    ($work:ident, $visit:ident, $numbers:ident, [$($reference:tt)+], $tree:ident) => {
        let node = |link, name| Slot::new(Owner::Link(link), name);
        for (each, &link) in ($($reference)+ $work.nodes).into_iter().zip(&$tree.nodes) {
            let motion = $($reference)+ each.motion;
            all(&mut $visit, node(link, "rotation"), ($($reference)+ motion.rotation).into_iter().flatten());
            all(&mut $visit, node(link, "position"), $($reference)+ motion.position);
            all(&mut $visit, node(link, "velocity"), ($($reference)+ motion.velocity).into_iter().flatten());
            all(&mut $visit, node(link, "acceleration"), ($($reference)+ motion.acceleration).into_iter().flatten());
            let jacobian = ($($reference)+ each.jacobian_acceleration).into_iter().flatten();
            all(&mut $visit, node(link, "jacobian_acceleration"), jacobian);
            $visit(node(link, "rigid_mass"), $($reference)+ each.rigid.m);
            all(&mut $visit, node(link, "rigid_moment"), $($reference)+ each.rigid.h);
            all(&mut $visit, node(link, "rigid_inertia"), $($reference)+ each.rigid.i);
            all(&mut $visit, node(link, "wrench"), ($($reference)+ each.wrench).into_iter().flatten());
            all(&mut $visit, node(link, "inertia_angular"), $($reference)+ each.inertia.aa);
            all(&mut $visit, node(link, "inertia_mixed"), ($($reference)+ each.inertia.al).into_iter().flatten());
            all(&mut $visit, node(link, "inertia_linear"), $($reference)+ each.inertia.ll);
            all(&mut $visit, node(link, "newton_residual"), ($($reference)+ each.residual).into_iter().flatten());
            all(&mut $visit, node(link, "newton_step"), ($($reference)+ each.step).into_iter().flatten());
            all(&mut $visit, node(link, "step_wrench"), ($($reference)+ each.step_wrench).into_iter().flatten());
        }
        for (each, segment) in ($($reference)+ $work.segments).into_iter().zip(&$tree.segments) {
            // What belongs to several joints goes by the first.
            // Link 0 is the root, which no joint moves, so joint i − 1 moves link i.
            let joint = |name| Slot::new(Owner::Joint(segment.first - 1), name);
            let count = segment.len;
            let axis = ($($reference)+ each.axis).into_iter().take(count).flatten().flatten();
            all(&mut $visit, joint("axis"), axis);
            all(&mut $visit, joint("mass"), $($reference)+ each.mass);
            let force = ($($reference)+ each.force).into_iter().take(count).flatten().flatten();
            all(&mut $visit, joint("force"), force);
            all(&mut $visit, joint("residual"), ($($reference)+ each.residual).into_iter().take(count));
            all(&mut $visit, joint("step_residual"), ($($reference)+ each.step_residual).into_iter().take(count));
            all(&mut $visit, joint("lower"), $($reference)+ each.lower);
            let coupling = ($($reference)+ each.coupling).into_iter().take(count).flatten().flatten();
            all(&mut $visit, joint("coupling"), coupling);
            all(&mut $visit, joint("inverse"), ($($reference)+ each.inverse).into_iter().take(count));
            all(&mut $visit, joint("solved"), ($($reference)+ each.solved).into_iter().take(count));
        }
        for (j, each) in ($($reference)+ $work.joints).into_iter().enumerate() {
            let joint = |name| Slot::new(Owner::Joint(j), name);
            $visit(joint("tau"), $($reference)+ each.tau);
            $visit(joint("armature"), $($reference)+ each.armature);
            $visit(joint("implicit"), $($reference)+ each.implicit);
            $visit(joint("friction_d"), $($reference)+ each.friction_d);
            $visit(joint("friction_bias"), $($reference)+ each.friction_bias);
            $visit(joint("frictionloss"), $($reference)+ each.frictionloss);
            $visit(joint("limit_sign"), $($reference)+ each.limit_sign);
            $visit(joint("limit_d"), $($reference)+ each.limit_d);
            $visit(joint("limit_bias"), $($reference)+ each.limit_bias);
            $visit(joint("row"), $($reference)+ each.row);
            $visit(joint("step"), $($reference)+ each.step);
        }
        for (each, coupling) in ($($reference)+ $work.couplings).into_iter().zip(&$tree.couplings) {
            let joint = |name| Slot::new(Owner::Joint(coupling.follower), name);
            $visit(joint("coupling_d"), $($reference)+ each.d);
            $visit(joint("coupling_bias"), $($reference)+ each.bias);
            $visit(joint("coupling_slope"), $($reference)+ each.slope);
        }
        for each in $($reference)+ $work.free {
            let base = |name| Slot::new(Owner::Base, name);
            $visit(base("free_implicit"), $($reference)+ each.implicit);
            all(&mut $visit, base("free_friction_d"), $($reference)+ each.friction_d);
            all(&mut $visit, base("free_friction_bias"), ($($reference)+ each.friction_bias).into_iter().flatten());
            all(&mut $visit, base("free_row"), ($($reference)+ each.row).into_iter().flatten());
            all(&mut $visit, base("free_step"), ($($reference)+ each.step).into_iter().flatten());
        }
        for (j, (sine, cosine)) in ($($reference)+ $work.displacements).into_iter().enumerate() {
            $visit(Slot::new(Owner::Joint(j), "sine"), sine);
            $visit(Slot::new(Owner::Joint(j), "cosine"), cosine);
        }
        for (p, each) in ($($reference)+ $work.pairs).into_iter().enumerate() {
            all(&mut $visit, Slot::new(Owner::Pair(p), "friction"), $($reference)+ each.friction);
        }
        // Of each pair: its points' numbers in a row.
        let owners = $tree.pairs.iter().enumerate();
        let owners = owners.flat_map(|(p, pair)| (0..pair.points.len()).map(move |k| (p, k, pair.condim)));
        // Only points with spin have an entry here, so it goes on separately from the points.
        let mut spins = ($($reference)+ $work.spins).into_iter();
        for (each, (p, k, condim)) in ($($reference)+ $work.points).into_iter().zip(owners) {
            // All points of a pair share the pair's names, so the numbers of point k begin at k widths.
            let point = |name, width| Slot { index: k * width, ..Slot::new(Owner::Pair(p), name) };
            let parts = if condim > 3 { 2 } else { 1 };
            all(&mut $visit, point("point", 3), $($reference)+ each.x);
            $visit(point("distance", 1), $($reference)+ each.distance);
            $visit(point("d", 1), $($reference)+ each.d);
            let residual = ($($reference)+ each.residual).into_iter().take(parts).flatten();
            all(&mut $visit, point("residual", 6), residual);
            let step = ($($reference)+ each.step).into_iter().take(parts).flatten();
            all(&mut $visit, point("step", 6), step);
            let force = ($($reference)+ each.force).into_iter().take(parts).flatten();
            all(&mut $visit, point("contact_force", 6), force);
            all(&mut $visit, point("world_force", 3), $($reference)+ each.world_force);
            all(&mut $visit, point("weight", 6), $($reference)+ each.weight);
            all(&mut $visit, point("columns", 9), ($($reference)+ each.columns).into_iter().flatten());
            all(&mut $visit, point("frame", 9), ($($reference)+ each.frame).into_iter().flatten());
            if condim > 3 {
                if let Some((wrench, inertia)) = spins.next() {
                    all(&mut $visit, point("spin_wrench", 6), wrench.into_iter().flatten());
                    all(&mut $visit, point("spin_angular", 6), $($reference)+ inertia.aa);
                    all(&mut $visit, point("spin_mixed", 9), ($($reference)+ inertia.al).into_iter().flatten());
                    all(&mut $visit, point("spin_linear", 6), $($reference)+ inertia.ll);
                }
            }
        }
        // Pairs of self-contact come after those with the ground.
        let ground = $tree.pairs.len();
        let owners = $tree.self_contact.pairs.iter().enumerate();
        let owners = owners.flat_map(|(p, pair)| (0..pair.points.len()).map(move |k| (ground + p, k, pair.dims)));
        for (each, (p, k, dims)) in ($($reference)+ $work.self_contact.points).into_iter().zip(owners) {
            let slot = Slot { index: k * 6, ..Slot::new(Owner::Pair(p), "residual") };
            all(&mut $visit, slot, ($($reference)+ each.residual).into_iter().take(dims));
        }
        for (each, &(link, _)) in ($($reference)+ $work.touching).into_iter().zip(&$tree.touching) {
            all(&mut $visit, node(link, "pose_rotation"), ($($reference)+ each.rotation).into_iter().flatten());
            all(&mut $visit, node(link, "pose_position"), $($reference)+ each.position);
        }
    };
}

impl<T: Real> Work<T> {
    visit_methods!(work_numbers, tree: &Tree<T::K>);
}

impl<T: Real> Work<T> {
    /// Scratch for `tree`.
    pub fn new<K>(tree: &Tree<K>) -> Self {
        let z = T::zero();
        let motion =
            Motion { rotation: [zero3(); 3], position: zero3(), velocity: zero6(), acceleration: zero6() };
        let pose = Pose { rotation: [zero3(); 3], position: zero3() };
        let node = Node {
            motion,
            jacobian_acceleration: zero6(),
            rigid: Rigid::zero(),
            wrench: zero6(),
            inertia: Articulated::zero(),
            residual: zero6(),
            step: zero6(),
            step_wrench: zero6(),
        };
        let segment = SegmentWork {
            axis: [zero6(); SEGMENT],
            mass: [z; 6],
            force: [zero6(); SEGMENT],
            residual: [z; SEGMENT],
            step_residual: [z; SEGMENT],
            lower: [z; 3],
            coupling: [zero6(); SEGMENT],
            inverse: [z; SEGMENT],
            solved: [z; SEGMENT],
        };
        let joint = JointWork {
            tau: z,
            armature: z,
            implicit: z,
            friction_d: z,
            friction_bias: z,
            frictionloss: z,
            limit_sign: z,
            limit_d: z,
            limit_bias: z,
            row: z,
            step: z,
        };
        let point = Point {
            x: zero3(),
            distance: z,
            d: z,
            residual: zero6(),
            step: zero6(),
            force: zero6(),
            world_force: zero3(),
            weight: [z; 6],
            columns: [zero3(); SEGMENT],
            frame: [zero3(); 3],
        };
        Self {
            nodes: vec![node; tree.nodes.len()],
            segments: vec![segment; tree.segments.len()],
            joints: vec![joint; tree.joints()],
            couplings: vec![CouplingWork::zero(); tree.couplings.len()],
            // No guard is active until the first step computes it.
            limited: vec![T::never(); tree.joints()],
            free: vec![FreeWork::zero(); usize::from(tree.free.is_some())],
            displacements: vec![(z, z); tree.joints()],
            pairs: vec![PairWork { active: T::never(), friction: [z; 5] }; tree.pairs.len()],
            points: vec![point; tree.points],
            spins: vec![(zero6(), Articulated::zero()); tree.spins],
            touching: vec![pose; tree.touching.len()],
            self_contact: SelfContactWork::new(&tree.self_contact, tree.links.len(), tree.floating),
        }
    }
}
