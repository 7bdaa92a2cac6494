//! A model compiled for stepping: links with one joint each, contact shapes in link frames, row constants.
//!
//! Every joint becomes a link whose frame sits at the joint's anchor, with the joint's axis along one of its axes.
//! Bodies without a joint are welded into the link that carries them. Link 0 is the root: the floating base,
//! or the world. Link `i` moves with joint `i − 1`; parents come before children.

use std::ops::Range;

use gaitfit_model::JointKind;

use crate::Settings;
use crate::self_contact::SelfContacts;
use crate::terrain::{Block, Field};

/// Smallest positive number MuJoCo divides by (`mjMINVAL`).
pub(crate) const TINY: f64 = 1e-15;

/// Axis of a link frame that its joint turns about or slides along.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axis {
    X,
    Y,
    Z,
}

/// Impedance as a function of violation (MuJoCo, "Solver parameters"): d(x) = dmin + y(x)·(dmax − dmin).
#[derive(Clone, Debug)]
pub(crate) struct Impedance<K> {
    pub dmin: K,
    pub rise: K,
    pub per_width: K,
    pub midpoint: K,
    /// Whole part of the power.
    pub power: u32,
    /// Binary digits of the power's fraction, the highest bit for a half.
    pub fraction: u64,
    /// 1 / midpoint^(power − 1).
    pub low: K,
    /// 1 / (1 − midpoint)^(power − 1).
    pub high: K,
}

/// Spring and damper of a constraint's reference acceleration: aref = −b·v − k·d·(pos − margin).
#[derive(Clone, Copy, Debug)]
pub(crate) struct Reference<K> {
    pub k: K,
    pub b: K,
    /// Factor on D of a joint limit; on 1/D of a contact.
    pub gain: K,
}

/// A joint limit.
#[derive(Clone, Debug)]
pub(crate) struct Limit<K> {
    pub lower: K,
    pub upper: K,
    pub margin: K,
    pub impedance: Impedance<K>,
    pub reference: Reference<K>,
}

/// One joint and what it carries.
#[derive(Clone, Debug)]
pub(crate) struct Link<K> {
    pub parent: usize,
    /// Anchor in the parent's frame, m.
    pub offset: [K; 3],
    /// Constant turn from the parent's frame at the joint's reference; `None` for the identity.
    pub turn: Option<[[K; 3]; 3]>,
    pub axis: Axis,
    pub kind: JointKind,
    /// Position at which the link's frame is at `offset` and `turn`, rad or m.
    pub reference: K,
    pub limit: Option<Limit<K>>,
    /// D·invweight of the friction-loss row, and its damping.
    pub friction_weight: K,
    pub friction_b: K,
    pub stiffness: K,
    pub springref: K,
    /// Whether the joint has a spring.
    pub has_spring: bool,
    /// Contact pairs of this link, and its place in `Tree::touching` if it has any.
    pub pairs: Range<usize>,
    pub touching: Option<usize>,
}

/// A joint that follows another one, or is held.
#[derive(Clone, Debug)]
pub(crate) struct Coupling<K> {
    pub follower: usize,
    pub leader: Option<usize>,
    /// Coefficients of the follower's position by powers of the leader's, both from their references.
    pub polynomial: [K; 5],
    pub impedance: Impedance<K>,
    pub reference: Reference<K>,
}

/// What resists the motion of a floating base besides its inertia, alike in its six degrees of freedom.
#[derive(Clone, Debug)]
pub(crate) struct FreeJoint<K> {
    /// Inertia, kg and kg·m².
    pub armature: K,
    /// N·s/m and N·m·s/rad.
    pub damping: K,
    /// Dry friction, N and N·m.
    pub frictionloss: K,
    /// D·invweight of a friction-loss row, and its damping.
    pub friction_weight: K,
    pub friction_b: K,
}

/// Up to three links in a row, eliminated together. Several segments may hang on one node; a node is the root
/// or the last link of a segment that carries others.
#[derive(Clone, Debug)]
pub(crate) struct Segment {
    /// First link; the others follow it directly.
    pub first: usize,
    /// Links, 1 to 3.
    pub len: usize,
    /// Node it hangs on.
    pub parent: usize,
    /// Node that its last link is, if it carries segments.
    pub node: Option<usize>,
    /// Contact pairs of its links.
    pub pairs: Range<usize>,
    /// Couplings of its joints.
    pub couplings: Range<usize>,
}

/// Max number of links in a segment.
pub(crate) const SEGMENT: usize = 3;

/// A contact shape in its link's frame.
#[derive(Clone, Debug)]
pub(crate) enum LinkShape<K> {
    Sphere,
    /// Unit axis.
    Capsule {
        axis: [K; 3],
        half_length: K,
    },
    /// Unit axis, unit x axis.
    Cylinder {
        axis: [K; 3],
        x_axis: [K; 3],
        half_length: K,
    },
    /// Half edges.
    Box {
        edges: [[K; 3]; 3],
    },
}

/// A static plane in world axes.
#[derive(Clone, Debug)]
pub(crate) struct GroundPlane<K> {
    /// Unit normal and MuJoCo's two tangents.
    pub frame: [[K; 3]; 3],
    /// Distance of the plane from the world's origin along the normal, m.
    pub offset: K,
}

/// What a pair's shape may touch: a place among the tree's planes, blocks or fields.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Touched {
    Plane(usize),
    Block(usize),
    Field(usize),
}

/// A shape that may touch a plane or an obstacle.
#[derive(Clone, Debug)]
pub(crate) struct Pair<K> {
    /// Index of the pair in `Model::pairs`.
    pub model_pair: usize,
    /// Place of the first point among the points with spin.
    pub spin: usize,
    /// Place of the pair's link in its segment.
    pub member: usize,
    /// Node that carries the segment.
    pub node: usize,
    pub touched: Touched,
    pub shape: LinkShape<K>,
    pub center: [K; 3],
    pub radius: K,
    /// Radius of a sphere about `center` that holds the shape, plus the margin.
    pub reach: K,
    pub condim: usize,
    pub friction: [K; 5],
    /// Whether the contact frame may be taken as the world's axes (normal z).
    pub aligned: bool,
    pub margin: K,
    pub impedance: Impedance<K>,
    pub reference: Reference<K>,
    /// Damping of the friction dimensions (elliptic cones).
    pub friction_b: K,
    pub points: Range<usize>,
}

/// A compiled robot with the constants of one step. Made once; shared by all environments.
#[derive(Clone, Debug)]
pub struct Tree<K> {
    pub(crate) floating: bool,
    /// What resists the base's motion; absent where nothing does.
    pub(crate) free: Option<FreeJoint<K>>,
    pub(crate) root_position: [K; 3],
    pub(crate) gravity: [K; 3],
    pub(crate) links: Vec<Link<K>>,
    /// Parents before children.
    pub(crate) segments: Vec<Segment>,
    /// Joints that follow others: those of each segment, then the distant ones (`self_contact.couplings`).
    pub(crate) couplings: Vec<Coupling<K>>,
    /// Link of each node; node 0 is the root.
    pub(crate) nodes: Vec<usize>,
    pub(crate) planes: Vec<GroundPlane<K>>,
    pub(crate) blocks: Vec<Block<K>>,
    pub(crate) fields: Vec<Field<K>>,
    pub(crate) pairs: Vec<Pair<K>>,
    pub(crate) points: usize,
    /// Points with spin.
    pub(crate) spins: usize,
    /// Links with contact pairs or in self-contact, and the segment of each (none for the root).
    pub(crate) touching: Vec<(usize, Option<usize>)>,
    /// Contact between the robot's own parts.
    pub(crate) self_contact: SelfContacts<K>,
    pub(crate) impratio: f64,
    pub(crate) elliptic: bool,
    /// For each joint, whether its target is a velocity.
    pub(crate) velocity_targets: Vec<bool>,
    pub(crate) settings: Settings,
}

impl<K> Tree<K> {
    /// Hinges and slides.
    pub fn joints(&self) -> usize {
        self.links.len() - 1
    }

    /// Length of `qpos` in MuJoCo's layout.
    pub fn nq(&self) -> usize {
        self.joints() + if self.floating { 7 } else { 0 }
    }

    /// Length of `qvel` in MuJoCo's layout.
    pub fn nv(&self) -> usize {
        self.joints() + if self.floating { 6 } else { 0 }
    }

    /// Numbers of a robot's [`crate::Params::free`].
    pub(crate) fn free_weights(&self) -> usize {
        if self.free.is_some() { 2 } else { 0 }
    }

    /// For each compiled contact pair, its index in `Model::pairs`.
    pub fn model_pairs(&self) -> Vec<usize> {
        self.pairs.iter().map(|pair| pair.model_pair).collect()
    }

    /// Number of contact pairs: those with the ground, then those of self-contact.
    pub(crate) fn all_pairs(&self) -> usize {
        self.pairs.len() + self.self_contact.pairs.len()
    }

    /// Settings it was compiled with.
    pub fn settings(&self) -> &Settings {
        &self.settings
    }
}
