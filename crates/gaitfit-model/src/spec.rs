//! What both readers fill: bodies below the world, resolved to SI units, before one robot is chosen.

use crate::inertia::Inertial;
use crate::joint_kind::JointKind;
use crate::model::{Actuator, ContactPair, Coupling, FreeJoint, Joint, Options, Shape, Site};
use crate::outline::{MeshFile, Outline};
use crate::rotation::{IDENTITY, Quat, Vec3};
use crate::terrain::{Ground, HeightField};
use crate::xml::At;

/// Max number of bodies of one file.
pub(crate) const MAX_BODIES: usize = 256;
/// Max number of hinges and slides of one file.
pub(crate) const MAX_JOINTS: usize = 256;
/// Max number of geoms, sites, pairs, excludes, actuators or keyframes of one file.
pub(crate) const MAX_ITEMS: usize = 2048;
/// Max number of geom–plane pairs of a model.
pub(crate) const MAX_PAIRS: usize = 4096;

/// A file's content.
#[derive(Debug)]
pub(crate) struct Spec {
    /// Model name, if the file has one.
    pub name: Option<String>,
    pub options: Options,
    /// Parts of the physics that the file switches off.
    pub disabled: Disabled,
    /// The world (index 0), then all bodies depth first: MuJoCo's body numbers.
    pub bodies: Vec<BodySpec>,
    /// Height fields of the assets.
    pub fields: Vec<HeightField>,
    /// Body pairs that never collide.
    pub excludes: Vec<(usize, usize)>,
    /// Explicit pairs.
    pub pairs: Vec<PairSpec>,
    /// Actuators with the joint's index in file order.
    pub actuators: Vec<Actuator>,
    /// Joints that follow others; joints by their index in file order.
    pub couplings: Vec<Coupling>,
    pub keys: Vec<KeySpec>,
    /// Masses are scaled to this sum (`compiler settotalmass`), kg.
    pub total_mass: Option<f64>,
}

/// Constraint families switched off by `option flag`.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Disabled {
    pub contact: bool,
    pub equality: bool,
    pub limit: bool,
    pub frictionloss: bool,
    pub spring: bool,
    pub damper: bool,
    pub gravity: bool,
    pub clampctrl: bool,
    /// Neighbouring bodies may collide (`filterparent` off).
    pub filterparent: bool,
}

/// A body, or the world.
#[derive(Clone, Debug)]
pub(crate) struct BodySpec {
    pub name: String,
    pub at: At,
    pub parent: usize,
    pub pos: Vec3,
    pub quat: Quat,
    pub inertial: Inertial,
    /// Position of the free joint element, if any.
    pub free: Option<At>,
    /// What resists the motion of the free joint.
    pub free_joint: Option<FreeJoint>,
    /// Hinges; `body` is not set yet.
    pub joints: Vec<(Joint, At)>,
    pub geoms: Vec<GeomSpec>,
    /// Sites; `body` is not set yet.
    pub sites: Vec<Site>,
    /// What a URDF shows of the link; kept by a mending reading.
    pub outlines: Vec<Outline>,
}

/// A geom in its body's frame.
#[derive(Clone, Debug)]
pub(crate) struct GeomSpec {
    pub name: String,
    pub at: At,
    pub pos: Vec3,
    pub quat: Quat,
    pub kind: GeomKind,
    pub surface: Surface,
    /// The mesh that it is, or that its size is from; kept by a mending reading.
    pub mesh: Option<MeshFile>,
}

/// The shape of a geom.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum GeomKind {
    /// Infinite plane.
    Plane,
    /// A height field: index into `Spec::fields`.
    Field(usize),
    /// A shape the engine collides with planes.
    Solid(Shape),
    /// A shape it does not: its name.
    Other(&'static str),
}

/// Contact properties of one geom (MuJoCo's names and defaults).
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Surface {
    pub contype: i32,
    pub conaffinity: i32,
    pub condim: u8,
    pub priority: i32,
    pub friction: [f64; 3],
    pub solmix: f64,
    pub solref: [f64; 2],
    pub solimp: [f64; 5],
    pub margin: f64,
    pub gap: f64,
}

/// MuJoCo's default reference: time constant 0.02 s, critically damped.
pub(crate) const SOLREF: [f64; 2] = [0.02, 1.0];
/// MuJoCo's default impedance.
pub(crate) const SOLIMP: [f64; 5] = [0.9, 0.95, 0.001, 0.5, 2.0];

impl Default for Surface {
    fn default() -> Self {
        Self {
            // One bit on both sides: by default every geom collides with every other one.
            contype: 1,
            conaffinity: 1,
            condim: 3,
            priority: 0,
            // Sliding has no unit; spinning and rolling are lengths, m.
            friction: [1.0, 0.005, 0.0001],
            solmix: 1.0,
            solref: SOLREF,
            solimp: SOLIMP,
            margin: 0.0,
            gap: 0.0,
        }
    }
}

impl Surface {
    /// Neither collides with anything nor is collided with.
    pub fn is_visual(&self) -> bool {
        self.contype == 0 && self.conaffinity == 0
    }

    /// MuJoCo's bit test.
    pub fn may_touch(&self, other: &Surface) -> bool {
        self.contype & other.conaffinity != 0 || other.contype & self.conaffinity != 0
    }
}

/// An explicit pair: geoms by their number in file order over all bodies, world included.
/// `parameters.geom` and `parameters.ground` are not set yet.
#[derive(Clone, Debug)]
pub(crate) struct PairSpec {
    pub geoms: [usize; 2],
    pub parameters: ContactPair,
}

/// A keyframe as written; missing arrays mean MuJoCo's defaults.
#[derive(Clone, Debug)]
pub(crate) struct KeySpec {
    pub at: At,
    pub name: String,
    pub qpos: Option<Vec<f64>>,
    pub qvel: Option<Vec<f64>>,
    pub ctrl: Option<Vec<f64>>,
}

impl BodySpec {
    /// A body without mass at its parent's frame.
    pub fn new(name: String, at: At, parent: usize) -> Self {
        Self {
            name,
            at,
            parent,
            pos: [0.0; 3],
            quat: IDENTITY,
            inertial: crate::inertia::MASSLESS,
            free: None,
            free_joint: None,
            joints: Vec::new(),
            geoms: Vec::new(),
            sites: Vec::new(),
            outlines: Vec::new(),
        }
    }
}

/// A hinge with MuJoCo's defaults, about z, without limits.
pub(crate) fn default_joint() -> Joint {
    Joint {
        name: String::new(),
        kind: JointKind::Hinge,
        body: 0,
        pos: [0.0; 3],
        // MuJoCo's default. URDF's is x, which its reader sets.
        axis: [0.0, 0.0, 1.0],
        reference: 0.0,
        range: None,
        margin: 0.0,
        solref_limit: SOLREF,
        solimp_limit: SOLIMP,
        solref_friction: SOLREF,
        solimp_friction: SOLIMP,
        armature: 0.0,
        damping: 0.0,
        frictionloss: 0.0,
        stiffness: 0.0,
        springref: 0.0,
        actuatorfrcrange: None,
        velocity_limit: None,
    }
}

/// Contact parameters of an explicit pair before attributes: MuJoCo's fixed values, not the geoms'.
pub(crate) fn default_pair() -> ContactPair {
    ContactPair {
        geom: 0,
        ground: Ground::Plane(0),
        condim: 3,
        friction: [1.0, 1.0, 0.005, 0.0001, 0.0001],
        solref: SOLREF,
        solreffriction: [0.0; 2],
        solimp: SOLIMP,
        margin: 0.0,
        gap: 0.0,
    }
}
