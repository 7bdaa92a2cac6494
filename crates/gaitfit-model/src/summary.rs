//! What there is to say about a model at a glance, and joints found by a log's names.

use serde::Serialize;

use crate::joint_kind::JointKind;
use crate::listing::{LeftOut, symmetric};
use crate::model::{Changed, Dropped, Model, Root};
use crate::patterns::plain;

/// Totals and tables of a model, for `gaitfit inspect`.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Summary {
    /// Model name.
    pub name: String,
    /// How the root is attached.
    pub root: Root,
    /// Length of `qpos`.
    pub nq: usize,
    /// Length of `qvel`.
    pub nv: usize,
    /// Length of `ctrl`.
    pub nu: usize,
    /// Sum of all masses, kg.
    pub total_mass: f64,
    /// Bodies in model order.
    pub bodies: Vec<BodySummary>,
    /// Joints in model order.
    pub joints: Vec<JointSummary>,
    /// Actuators in model order.
    pub actuators: Vec<ActuatorSummary>,
    /// Joints that follow others, in words; x is the other joint's distance from its reference.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub couplings: Vec<String>,
    /// Contact geoms in model order.
    pub geoms: Vec<GeomSummary>,
    /// Ground planes.
    pub planes: Vec<String>,
    /// Boxes and height fields of the world.
    pub obstacles: Vec<String>,
    /// Number of pairs of a geom and a plane or obstacle.
    pub pairs: usize,
    /// Keyframe names.
    pub keyframes: Vec<String>,
    /// Site names.
    pub sites: Vec<String>,
    /// What was left out.
    pub dropped: Vec<Dropped>,
    /// What was left out, things of one kind together.
    pub left_out: Vec<LeftOut>,
    /// What was added or mended.
    pub changed: Vec<Changed>,
    /// What to know before trusting a simulation.
    pub warnings: Vec<String>,
}

/// A body's row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct BodySummary {
    /// Name.
    pub name: String,
    /// Name of the parent body; `None` for the root.
    pub parent: Option<String>,
    /// Mass, kg.
    pub mass: f64,
    /// Centre of mass in the body frame, m.
    pub com: [f64; 3],
    /// Principal moments of inertia, kg·m².
    pub inertia: [f64; 3],
}

/// A joint's row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct JointSummary {
    /// Name.
    pub name: String,
    /// Whether it turns or slides; units below are those of hinges, see [`JointKind::unit`].
    #[serde(skip_serializing_if = "JointKind::is_hinge")]
    pub kind: JointKind,
    /// Name of the body it moves.
    pub body: String,
    /// Axis in the body frame.
    pub axis: [f64; 3],
    /// Limits, rad.
    pub range: Option<[f64; 2]>,
    /// Largest torque that its actuators can give, N·m, where anything bounds it.
    pub effort: Option<f64>,
    /// Speed limit, rad/s, where the file has one.
    pub velocity_limit: Option<f64>,
    /// Armature, kg·m².
    pub armature: f64,
    /// Viscous damping, N·m·s/rad.
    pub damping: f64,
    /// Dry friction, N·m.
    pub frictionloss: f64,
}

/// An actuator's row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ActuatorSummary {
    /// Name.
    pub name: String,
    /// Name of its joint.
    pub joint: String,
    /// `motor` (torque = gear · gain · u), `position`, `velocity`, or `affine` for anything else.
    pub kind: &'static str,
    /// Transmission ratio.
    pub gear: f64,
    /// Clamp on the control.
    pub ctrlrange: Option<[f64; 2]>,
    /// Clamp on the force.
    pub forcerange: Option<[f64; 2]>,
}

/// A contact geom's row.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct GeomSummary {
    /// Name.
    pub name: String,
    /// Name of its body.
    pub body: String,
    /// `sphere`, `capsule`, `cylinder` or `box`.
    pub shape: &'static str,
    /// Number of planes and obstacles it may touch.
    pub pairs: usize,
    /// Largest contact dimension among its pairs (0: none).
    pub condim: u8,
    /// Sliding friction of its first pair.
    pub friction: Option<f64>,
}

impl Model {
    /// Sum of all masses, kg.
    pub fn total_mass(&self) -> f64 {
        self.bodies.iter().map(|b| b.mass).sum()
    }

    /// The joint that a log calls `log_name`: the same name, or the same up to a `_joint` suffix on
    /// either side (`FL_hip` and `FL_hip_joint`).
    pub fn find_joint(&self, log_name: &str) -> Option<usize> {
        self.joint(log_name).or_else(|| {
            let wanted = plain(log_name);
            // Only after the full name: a joint that is called so goes before one that differs by its suffix.
            let mut matches = (0..self.joints.len()).filter(|&j| plain(&self.joints[j].name) == wanted);
            // Two joints that differ only by the suffix are told apart by their full names alone.
            matches.next().filter(|_| matches.next().is_none())
        })
    }

    /// Largest torque (N·m; of a slide force, N) that the actuators of joint `index` can give, which the simulation clamps to on both sides: of an
    /// uneven range the smaller bound, or the larger one if the other side gives nothing. `None` when nothing bounds it.
    pub fn effort(&self, index: usize) -> Option<f64> {
        let joint = self.joints.get(index)?;
        let clamp = joint.actuatorfrcrange.map(symmetric);
        // One actuator without a bound leaves the whole sum without one.
        let mut sum = Some(0.0);
        for actuator in self.actuators.iter().filter(|a| a.joint == index) {
            // The control of a servo is no torque, so its range bounds none.
            let by_control = actuator
                .ctrlrange
                .filter(|_| actuator.bias == [0.0; 3])
                .map(|range| actuator.gain.abs() * symmetric(range));
            let by_force = actuator.forcerange.map(symmetric);
            let bound = match (by_control, by_force) {
                (Some(a), Some(b)) => Some(a.min(b)),
                (a, b) => a.or(b),
            };
            sum = sum.zip(bound).map(|(total, b): (f64, f64)| total + actuator.gear.abs() * b);
        }
        let driven = self.actuators.iter().any(|a| a.joint == index);
        // A joint without actuators has a sum of 0, which is no bound.
        match (clamp, sum.filter(|_| driven)) {
            (Some(a), Some(b)) => Some(a.min(b)),
            (a, b) => a.or(b),
        }
    }

    /// Totals and tables.
    pub fn summary(&self) -> Summary {
        let body_name = |index: usize| self.bodies[index].name.clone();
        Summary {
            name: self.name.clone(),
            root: self.root,
            nq: self.nq(),
            nv: self.nv(),
            nu: self.nu(),
            total_mass: self.total_mass(),
            bodies: self
                .bodies
                .iter()
                .map(|b| BodySummary {
                    name: b.name.clone(),
                    parent: b.parent.map(body_name),
                    mass: b.mass,
                    com: b.ipos,
                    inertia: b.inertia,
                })
                .collect(),
            joints: self
                .joints
                .iter()
                .enumerate()
                .map(|(index, j)| JointSummary {
                    name: j.name.clone(),
                    kind: j.kind,
                    body: body_name(j.body),
                    axis: j.axis,
                    range: j.range,
                    effort: self.effort(index),
                    velocity_limit: j.velocity_limit,
                    armature: j.armature,
                    damping: j.damping,
                    frictionloss: j.frictionloss,
                })
                .collect(),
            actuators: self
                .actuators
                .iter()
                .map(|a| ActuatorSummary {
                    name: a.name.clone(),
                    joint: self.joints[a.joint].name.clone(),
                    kind: kind(a),
                    gear: a.gear,
                    ctrlrange: a.ctrlrange,
                    forcerange: a.forcerange,
                })
                .collect(),
            couplings: self.couplings_in_words(),
            geoms: self
                .geoms
                .iter()
                .enumerate()
                .map(|(index, g)| {
                    let pairs = || self.pairs.iter().filter(move |p| p.geom == index);
                    GeomSummary {
                        name: g.name.clone(),
                        body: body_name(g.body),
                        shape: g.shape.name(),
                        pairs: pairs().count(),
                        condim: pairs().map(|p| p.condim).max().unwrap_or(0),
                        friction: pairs().next().map(|p| p.friction[0]),
                    }
                })
                .collect(),
            planes: self.planes.iter().map(|p| p.name.clone()).collect(),
            obstacles: self.obstacles.iter().map(|o| o.name.clone()).collect(),
            pairs: self.pairs.len(),
            keyframes: self.keyframes.iter().map(|k| k.name.clone()).collect(),
            sites: self.sites.iter().map(|s| s.name.clone()).collect(),
            dropped: self.dropped.clone(),
            left_out: self.left_out(),
            changed: self.changed.clone(),
            warnings: self.warnings(),
        }
    }
}

fn kind(actuator: &crate::model::Actuator) -> &'static str {
    match actuator.bias {
        [0.0, 0.0, 0.0] => "motor",
        // The force is gain · (control − position), less some damping.
        [0.0, stiffness, _] if stiffness == -actuator.gain => "position",
        [0.0, 0.0, damping] if damping == -actuator.gain => "velocity",
        _ => "affine",
    }
}
