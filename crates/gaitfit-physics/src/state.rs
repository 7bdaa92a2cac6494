//! State of one block of environments and the scratch of one step. Made once by the caller.

use crate::Real;
use crate::spatial::{Articulated, Rigid, V6, zero6};
use crate::tree::Tree;
use crate::vec3::*;

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
    /// Joint angles, rad.
    pub q: Vec<T>,
    /// Joint velocities, rad/s.
    pub qd: Vec<T>,
    /// Base acceleration of the last step: angular (rad/s²) and linear (m/s²), world frame.
    pub base_acceleration: [V3<T>; 2],
    /// Joint accelerations of the last step, rad/s².
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
            q: zeros.clone(),
            qd: zeros.clone(),
            base_acceleration: zero6(),
            qacc: zeros,
        }
    }
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
    /// `J qacc` alone.
    pub jacobian_acceleration: V6<T>,
}

/// A link during one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct LinkWork<T> {
    /// Motion subspace of the hinge.
    pub axis: V6<T>,
    pub rigid: Rigid<T>,
    /// Inertial wrench at the current acceleration, velocity products and gravity included.
    pub wrench: V6<T>,
    /// Inertial wrench of the Newton step (kept for the line search).
    pub step_wrench: V6<T>,
    /// `H_articulated · axis`.
    pub u: V6<T>,
}

/// A joint's rows and unknowns during one step.
#[derive(Clone, Copy, Debug)]
pub(crate) struct JointWork<T> {
    /// Applied torque: drive, damping and spring.
    pub tau: T,
    /// Armature in the solver's mass matrix.
    pub armature: T,
    /// Timestep times the damping that the integrator treats implicitly.
    pub implicit: T,
    pub friction_d: T,
    pub friction_aref: T,
    pub frictionloss: T,
    /// +1 near the lower limit, −1 near the upper.
    pub limit_sign: T,
    pub limit_d: T,
    pub limit_aref: T,
    /// Whether any lane may be beyond the limit.
    pub limited: bool,
    /// Negative of the rows' torque.
    pub row: T,
    pub inv_d: T,
    pub e: T,
    pub step: T,
}

/// Constraint state of one contact pair.
#[derive(Clone, Copy, Debug)]
pub(crate) struct PairWork<T> {
    /// Whether any lane may touch.
    pub active: bool,
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
    /// Rows: normal and tangents, world axes.
    pub frame: M3<T>,
}

/// Scratch of one step for one block of environments.
#[derive(Clone, Debug)]
pub struct Work<T> {
    pub(crate) motion: Vec<Motion<T>>,
    pub(crate) links: Vec<LinkWork<T>>,
    pub(crate) joints: Vec<JointWork<T>>,
    pub(crate) pairs: Vec<PairWork<T>>,
    pub(crate) points: Vec<Point<T>>,
    /// Sine and cosine of the joint angles.
    pub(crate) turns: Vec<(T, T)>,
    pub(crate) articulated: Vec<(Articulated<T>, V6<T>)>,
    /// Contact inertia and negative contact wrench of each link with pairs, and whether any lane touches.
    pub(crate) contacts: Vec<(Articulated<T>, V6<T>, bool)>,
    pub(crate) steps: Vec<V6<T>>,
}

impl<T: Real> Work<T> {
    /// Scratch for `tree`.
    pub fn new<K>(tree: &Tree<K>) -> Self {
        let z = T::zero();
        let rigid = Rigid { m: z, h: zero3(), i: [z; 6] };
        let link = LinkWork { axis: zero6(), rigid, wrench: zero6(), step_wrench: zero6(), u: zero6() };
        let joint = JointWork {
            tau: z,
            armature: z,
            implicit: z,
            friction_d: z,
            friction_aref: z,
            frictionloss: z,
            limit_sign: z,
            limit_d: z,
            limit_aref: z,
            limited: false,
            row: z,
            inv_d: z,
            e: z,
            step: z,
        };
        let point = Point {
            x: zero3(),
            distance: z,
            d: z,
            residual: zero6(),
            step: zero6(),
            force: zero6(),
            frame: [zero3(); 3],
        };
        let motion = Motion {
            rotation: [zero3(); 3],
            position: zero3(),
            velocity: zero6(),
            acceleration: zero6(),
            jacobian_acceleration: zero6(),
        };
        Self {
            motion: vec![motion; tree.chains],
            links: vec![link; tree.links.len()],
            joints: vec![joint; tree.joints()],
            pairs: vec![PairWork { active: false, friction: [z; 5] }; tree.pairs.len()],
            points: vec![point; tree.points],
            turns: vec![(z, z); tree.joints()],
            contacts: vec![(Articulated::zero(), zero6(), false); tree.contact_links.len()],
            articulated: vec![(Articulated::zero(), zero6()); tree.chains],
            steps: vec![zero6(); tree.chains],
        }
    }

    /// Normal stiffness of every contact point in the last step, zero where nothing touched.
    pub fn contact_stiffness(&self) -> impl Iterator<Item = T> + '_ {
        let owner = |k: usize| self.points[k].d;
        (0..self.points.len()).map(owner)
    }
}
