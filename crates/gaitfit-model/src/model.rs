//! The compiled robot: a tree of bodies below one root, hinges and slides, ground contacts, actuators.
//!
//! SI units, radians. Quaternions are wxyz, unit length. Poses are of the child in the parent's frame.
//! Bodies, joints and geoms keep the file's depth-first order, which is MuJoCo's order, so that arrays
//! over `qpos`, `qvel` and `ctrl` mean the same in both engines.

use serde::{Deserialize, Serialize};

use crate::joint_kind::JointKind;
use crate::looks::Source;
use crate::outline::Outline;
use crate::self_contact::{Parts, SelfPair};
use crate::terrain::{Ground, Obstacle};

/// How the robot's first body hangs in the world.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Root {
    /// Six free degrees of freedom: `qpos` starts with position (3, world) and quaternion (4, wxyz);
    /// `qvel` with linear velocity (3, world frame) and angular velocity (3, body frame).
    Floating,
    /// Welded to the world at the body's own pose.
    Fixed,
}

/// Armature, damping and friction loss of a free joint: the same for each of its six degrees of freedom, as in MuJoCo.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct FreeJoint {
    /// Inertia added to each, kg and kg·m².
    pub armature: f64,
    /// Force against the velocity of each, N·s/m and N·m·s/rad.
    pub damping: f64,
    /// Dry friction of each, N and N·m.
    pub frictionloss: f64,
    /// `solref` of the friction loss.
    pub solref_friction: [f64; 2],
    /// `solimp` of the friction loss.
    pub solimp_friction: [f64; 5],
}

impl FreeJoint {
    /// Whether nothing resists the motion.
    pub fn is_plain(&self) -> bool {
        [self.armature, self.damping, self.frictionloss] == [0.0; 3]
    }
}

/// A robot ready for simulation. Immutable; per-environment changes live in the simulator's parameters.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Model {
    /// Model name from the file, or the file's stem.
    pub name: String,
    /// Solver and integration options.
    pub options: Options,
    /// How `bodies[0]` is attached to the world.
    pub root: Root,
    /// Bodies in depth-first order; `bodies[0]` is the root body; the world is not listed.
    pub bodies: Vec<Body>,
    /// Hinges and slides in depth-first order: one scalar each of `qpos` and `qvel` after the root's.
    pub joints: Vec<Joint>,
    /// Collision geoms fixed to bodies (visual geoms are not kept).
    pub geoms: Vec<Geom>,
    /// Static ground planes.
    pub planes: Vec<Plane>,
    /// Static boxes and height fields that the robot may touch.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub obstacles: Vec<Obstacle>,
    /// Pairs of a geom and a plane or an obstacle that may touch, with their mixed contact parameters, in MuJoCo's order.
    pub pairs: Vec<ContactPair>,
    /// Pairs of own parts that may touch each other: none as a file is read, see [`Model::touching_itself`].
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub self_pairs: Vec<SelfPair>,
    /// Shapes of the robot with what the file's filters say about contacts between them.
    #[serde(skip)]
    pub parts: Parts,
    /// What resists the motion of a floating base besides its inertia; absent where nothing does.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub free_joint: Option<FreeJoint>,
    /// Actuators in file order: one scalar each of `ctrl`.
    pub actuators: Vec<Actuator>,
    /// Joints that follow other joints, by soft constraints.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub couplings: Vec<Coupling>,
    /// Named states.
    pub keyframes: Vec<Keyframe>,
    /// Named points on bodies.
    pub sites: Vec<Site>,
    /// Shapes that are shown or collide in the file and are not simulated: kept by a mending reading alone.
    #[serde(skip)]
    pub outlines: Vec<Outline>,
    /// Where its meshes are, for pictures.
    #[serde(skip)]
    pub source: Source,
    /// What the file says and this model leaves out (lenient reading, visuals, self-collision).
    pub dropped: Vec<Dropped>,
    /// What reading added or mended: a floor, a root link folded into its child, an inertia that cannot be.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub changed: Vec<Changed>,
    /// Joints whose targets are velocities, by index; see [`Model::with_velocity_targets`]. None as a file is read.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub velocity_targets: Vec<usize>,
}

impl Model {
    /// The robot with motors that get a target velocity (rad/s, of slides m/s) on `joints`, by index, such as those of wheels. The motors
    /// of all other joints get a target position.
    #[must_use]
    pub fn with_velocity_targets(&self, joints: &[usize]) -> Self {
        Self { velocity_targets: joints.to_vec(), ..self.clone() }
    }
}

/// Solver and integration options (MuJoCo's names).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Options {
    /// Integration step, s.
    pub timestep: f64,
    /// Gravity, m/s², world frame.
    pub gravity: [f64; 3],
    /// Friction cone.
    pub cone: Cone,
    /// Ratio of frictional to normal constraint impedance.
    pub impratio: f64,
    /// Integrator.
    pub integrator: Integrator,
    /// Newton iterations asked for by the file.
    pub iterations: u32,
    /// Line-search evaluations per iteration asked for by the file.
    pub ls_iterations: u32,
    /// `flag eulerdamp`: joint damping is integrated implicitly by the Euler integrator.
    pub eulerdamp: bool,
}

/// Friction cone of the contact model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Cone {
    /// Pyramid: two edges for each friction dimension.
    Pyramidal,
    /// Elliptic cone.
    Elliptic,
}

/// Time integrator.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Integrator {
    /// Semi-implicit Euler, joint damping implicit.
    Euler,
    /// Semi-implicit Euler, velocity derivatives of damping and actuators implicit.
    ImplicitFast,
}

/// A rigid body.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Body {
    /// Name (made up from the index when the file has none).
    pub name: String,
    /// Parent body; `None` for the root body.
    pub parent: Option<usize>,
    /// Position in the parent's frame (world for the root), m.
    pub pos: [f64; 3],
    /// Orientation in the parent's frame (world for the root), wxyz.
    pub quat: [f64; 4],
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the body frame, m.
    pub ipos: [f64; 3],
    /// Orientation of the principal axes in the body frame, wxyz.
    pub iquat: [f64; 4],
    /// Principal moments of inertia about the centre of mass, kg·m².
    pub inertia: [f64; 3],
}

/// A joint: a hinge or a slide. Units are those of hinges; of slides, those that [`JointKind::unit`] gives for them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Joint {
    /// Name.
    pub name: String,
    /// Whether it turns or slides.
    #[serde(skip_serializing_if = "JointKind::is_hinge")]
    pub kind: JointKind,
    /// The body it moves. Several joints of one body act in list order (MuJoCo).
    pub body: usize,
    /// Anchor in the body frame, m.
    pub pos: [f64; 3],
    /// Axis in the body frame, unit length.
    pub axis: [f64; 3],
    /// `qpos` value at which the body has the pose of the file (MuJoCo's `ref`), rad.
    pub reference: f64,
    /// Limits, rad, if limited.
    pub range: Option<[f64; 2]>,
    /// Distance from the limit at which it becomes active, rad.
    pub margin: f64,
    /// Limit reference (time constant s, damping ratio), or direct stiffness/damping if negative.
    pub solref_limit: [f64; 2],
    /// Limit impedance (dmin, dmax, width, midpoint, power).
    pub solimp_limit: [f64; 5],
    /// Friction-loss reference.
    pub solref_friction: [f64; 2],
    /// Friction-loss impedance.
    pub solimp_friction: [f64; 5],
    /// Reflected rotor inertia, kg·m².
    pub armature: f64,
    /// Viscous damping, N·m·s/rad.
    pub damping: f64,
    /// Dry (Coulomb) friction torque, N·m.
    pub frictionloss: f64,
    /// Stiffness of the joint spring, N·m/rad.
    pub stiffness: f64,
    /// Rest angle of the joint spring, rad.
    pub springref: f64,
    /// Clamp on the sum of all actuator torques on this joint, N·m (`actuatorfrcrange`).
    pub actuatorfrcrange: Option<[f64; 2]>,
    /// Speed limit of the actuator, rad/s (URDF `velocity`; informative).
    pub velocity_limit: Option<f64>,
}

/// A collision shape fixed to a body.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Geom {
    /// Name (made up from the index when the file has none).
    pub name: String,
    /// The body it belongs to.
    pub body: usize,
    /// Shape and size.
    pub shape: Shape,
    /// Position in the body frame, m.
    pub pos: [f64; 3],
    /// Orientation in the body frame, wxyz.
    pub quat: [f64; 4],
}

/// Shape of a geom; sizes in metres. Long axes are the geom's z.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum Shape {
    /// Sphere.
    Sphere {
        /// Radius.
        radius: f64,
    },
    /// Capsule: cylinder with half-sphere caps; `half_length` excludes the caps.
    Capsule {
        /// Radius.
        radius: f64,
        /// Half length of the cylindrical part.
        half_length: f64,
    },
    /// Cylinder.
    Cylinder {
        /// Radius.
        radius: f64,
        /// Half length.
        half_length: f64,
    },
    /// Box.
    Box {
        /// Half sizes along the geom's axes.
        half_size: [f64; 3],
    },
}

/// A static infinite plane; its normal is the z axis of its frame.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Plane {
    /// Name.
    pub name: String,
    /// A point of the plane, world frame, m.
    pub pos: [f64; 3],
    /// Orientation in the world, wxyz.
    pub quat: [f64; 4],
}

/// Contact parameters of one geom against one plane or obstacle, mixed as MuJoCo mixes them.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ContactPair {
    /// Index into `geoms`.
    pub geom: usize,
    /// The plane or obstacle.
    #[serde(rename = "plane")]
    pub ground: Ground,
    /// Contact dimension: 1, 3, 4 or 6.
    pub condim: u8,
    /// Friction: tangential ×2, torsional, rolling ×2.
    pub friction: [f64; 5],
    /// Reference.
    pub solref: [f64; 2],
    /// Reference of the friction dimensions (elliptic cones; zeros: same as `solref`).
    pub solreffriction: [f64; 2],
    /// Impedance.
    pub solimp: [f64; 5],
    /// Distance below which the contact's constraint is active, m (MuJoCo's `includemargin`).
    pub margin: f64,
    /// Distance beyond `margin` within which MuJoCo 4 lists the contact without a force, m; it does not
    /// change the motion.
    pub gap: f64,
}

/// An actuator on a joint: torque, of a slide force, = gear · clamp(gain·u + bias₀ + bias₁·gear·q + bias₂·gear·q̇).
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Actuator {
    /// Name.
    pub name: String,
    /// Index into `joints`.
    pub joint: usize,
    /// Transmission ratio.
    pub gear: f64,
    /// Clamp on the control, if any.
    pub ctrlrange: Option<[f64; 2]>,
    /// Clamp on the actuator's scalar force, if any.
    pub forcerange: Option<[f64; 2]>,
    /// Fixed gain on the control.
    pub gain: f64,
    /// Affine bias: constant, on length, on velocity.
    pub bias: [f64; 3],
}

/// A joint that follows another one, or that is held: MuJoCo's equality constraint of joints, which is soft.
///
/// It pulls the follower's distance from its reference to Σₖ cₖ xᵏ, with x the leader's distance from its own reference.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Coupling {
    /// The joint that follows: index into `joints`.
    pub follower: usize,
    /// The joint that it follows; `None`: it is held at c₀.
    pub leader: Option<usize>,
    /// c₀ to c₄: rad and m, by powers of the leader's rad or m.
    pub polynomial: [f64; 5],
    /// Reference (time constant s, damping ratio), or direct stiffness and damping if negative.
    pub solref: [f64; 2],
    /// Impedance (dmin, dmax, width, midpoint, power).
    pub solimp: [f64; 5],
}

impl Coupling {
    /// The follower's distance from its reference where the leader is `x` from its own.
    pub fn follow(&self, x: f64) -> f64 {
        // Horner's scheme, from the highest power down.
        self.polynomial.iter().rev().fold(0.0, |sum, c| sum * x + c)
    }

    /// The follower's velocity over the leader's, where the leader is `x` from its reference.
    pub fn slope(&self, x: f64) -> f64 {
        // Horner's scheme on the derivative.
        (1..self.polynomial.len()).rev().fold(0.0, |sum, k| sum * x + k as f64 * self.polynomial[k])
    }
}

/// A named state.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Keyframe {
    /// Name.
    pub name: String,
    /// Positions, `nq` long (MuJoCo's layout).
    pub qpos: Vec<f64>,
    /// Velocities, `nv` long.
    pub qvel: Vec<f64>,
    /// Controls, `nu` long.
    pub ctrl: Vec<f64>,
}

/// A named point on a body.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Site {
    /// Name.
    pub name: String,
    /// The body it belongs to.
    pub body: usize,
    /// Position in the body frame, m.
    pub pos: [f64; 3],
    /// Orientation in the body frame, wxyz.
    pub quat: [f64; 4],
}

/// Something of the file that the model does not carry.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Dropped {
    /// What, for example `geom "shell" (mesh, visual)`.
    pub what: String,
    /// Why.
    pub why: String,
    /// Line in the file, from 1 (0: not from one place).
    pub line: u32,
    /// Column in the file, from 1.
    pub column: u32,
    /// Whether the file is read so even strictly; else it was left out because the reading was lenient.
    #[serde(skip)]
    pub harmless: bool,
}

/// Something that the file says otherwise, or does not say.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Changed {
    /// What, for example `floor "floor"`.
    pub what: String,
    /// How, and why.
    pub how: String,
    /// Line in the file, from 1 (0: not from one place).
    pub line: u32,
    /// Column in the file, from 1.
    pub column: u32,
}

impl Shape {
    /// `sphere`, `capsule`, `cylinder` or `box`.
    pub fn name(&self) -> &'static str {
        match self {
            Shape::Sphere { .. } => "sphere",
            Shape::Capsule { .. } => "capsule",
            Shape::Cylinder { .. } => "cylinder",
            Shape::Box { .. } => "box",
        }
    }
}

impl Model {
    /// Length of `qpos`: 7 for a floating root, then one a joint.
    pub fn nq(&self) -> usize {
        self.joints.len() + if self.root == Root::Floating { 7 } else { 0 }
    }

    /// Length of `qvel`: 6 for a floating root, then one a joint.
    pub fn nv(&self) -> usize {
        self.joints.len() + if self.root == Root::Floating { 6 } else { 0 }
    }

    /// Length of `ctrl`.
    pub fn nu(&self) -> usize {
        self.actuators.len()
    }

    /// Index of the joint called `name`.
    pub fn joint(&self, name: &str) -> Option<usize> {
        self.joints.iter().position(|joint| joint.name == name)
    }

    /// Index of the body called `name`.
    pub fn body(&self, name: &str) -> Option<usize> {
        self.bodies.iter().position(|body| body.name == name)
    }

    /// The keyframe called `name`.
    pub fn keyframe(&self, name: &str) -> Option<&Keyframe> {
        self.keyframes.iter().find(|key| key.name == name)
    }
}
