//! Hinges and slides: how a joint moves what it carries, and in which units.

use serde::{Deserialize, Serialize};

use crate::kinematics::Frame;
use crate::model::{Joint, Model};
use crate::rotation::{Vec3, axis_angle, cross, dot, product, rotate, sub};

/// How a joint moves its body. Positions, velocities and forces of a hinge are in rad, rad/s and N·m, those of a slide in m,
/// m/s and N.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum JointKind {
    /// It turns about its axis.
    #[default]
    Hinge,
    /// It slides along its axis (URDF: prismatic).
    Slide,
}

/// How many rad of a leg's hinge correspond to 1 m of a slide, for a lever of 0.1 m.
const PER_METRE: f64 = 10.0;

/// Units of hinges, what slides have in their place, and the power of [`PER_METRE`] by which their numbers differ.
const UNITS: [(&str, &str, i32); 7] = [
    ("rad", "m", 1),
    ("rad/s", "m/s", 1),
    ("N·m", "N", -1),
    ("N·m/rad", "N/m", -2),
    ("N·m·s/rad", "N·s/m", -2),
    ("kg·m²", "kg", -2),
    ("rad/(N·m)", "m/N", 2),
];

impl JointKind {
    /// Whether it is a hinge: what a model's file leaves out.
    pub fn is_hinge(&self) -> bool {
        *self == Self::Hinge
    }

    /// `hinge` or `slide`, as MJCF has it.
    pub fn name(self) -> &'static str {
        match self {
            Self::Hinge => "hinge",
            Self::Slide => "slide",
        }
    }

    /// The unit of a joint of this kind where a hinge has `unit`: m for rad, N·s/m for N·m·s/rad. A unit that does not depend
    /// on the kind stays.
    pub fn unit(self, unit: &str) -> &str {
        let slides = UNITS.iter().find(|(hinge, ..)| *hinge == unit).map(|(_, slide, _)| *slide);
        slides.filter(|_| self == Self::Slide).unwrap_or(unit)
    }

    /// The number for a joint of this kind that corresponds to `value` (in `unit`) for a hinge of a leg: 10 N for 1 N·m. Guesses
    /// and bounds use it if the robot's file states no number.
    pub fn like(self, unit: &str, value: f64) -> f64 {
        let power = UNITS.iter().find(|(hinge, ..)| *hinge == unit).map_or(0, |(.., power)| *power);
        match power {
            _ if self.is_hinge() => value,
            // Division by 10 keeps round numbers round; multiplication by 0.1 does not.
            power if power > 0 => value / PER_METRE.powi(power),
            power => value * PER_METRE.powi(-power),
        }
    }
}

/// A joint's axis at one pose. It gives the velocities of points that the joint moves, and the joint's generalized force.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct JointAxis {
    /// Whether the joint turns about the axis or slides along it.
    pub kind: JointKind,
    /// Direction of the axis, a unit vector.
    pub axis: Vec3,
    /// A point on the axis, m.
    pub anchor: Vec3,
}

impl JointAxis {
    /// Velocity that the joint alone, at 1 rad/s or 1 m/s, gives to a point of what it carries, m/s.
    pub fn lever(&self, point: Vec3) -> Vec3 {
        match self.kind {
            JointKind::Hinge => cross(self.axis, sub(point, self.anchor)),
            JointKind::Slide => self.axis,
        }
    }

    /// Angular velocity that it gives to what it carries at 1 rad/s or 1 m/s, rad/s.
    pub fn turn(&self) -> Vec3 {
        match self.kind {
            JointKind::Hinge => self.axis,
            // What slides does not turn.
            JointKind::Slide => [0.0; 3],
        }
    }

    /// Generalized force on the joint of a force and of its moment about the frame's origin, N·m (slides: N).
    pub fn share_of(&self, force: Vec3, moment: Vec3) -> f64 {
        match self.kind {
            // The moment is taken about the anchor; its part along the axis drives the hinge.
            JointKind::Hinge => dot(self.axis, sub(moment, cross(self.anchor, force))),
            JointKind::Slide => dot(self.axis, force),
        }
    }
}

impl Model {
    /// Whether a joint of the robot slides.
    pub fn has_slides(&self) -> bool {
        self.joints.iter().any(|joint| joint.kind == JointKind::Slide)
    }

    /// Whether the joint that a log calls so slides; false of a joint that the robot lacks.
    pub fn slides(&self, log_name: &str) -> bool {
        self.find_joint(log_name).is_some_and(|joint| self.joints[joint].kind == JointKind::Slide)
    }

    /// The unit of all joints where a hinge has `unit`, for the head of a table or a comment: `rad (slides: m)` of a robot
    /// with both.
    pub fn units(&self, unit: &str) -> String {
        // A unit without a partner, such as s, is the same for both kinds.
        let slide = JointKind::Slide.unit(unit);
        let hinges = self.joints.iter().any(|joint| joint.kind.is_hinge());
        match (self.has_slides() && slide != unit, hinges) {
            (true, true) => format!("{unit} (slides: {slide})"),
            (true, false) => slide.to_owned(),
            (false, _) => unit.to_owned(),
        }
    }
}

impl Joint {
    /// The frame of the joint's body after this joint alone moved to `position` (rad or m); `frame`: that before it.
    pub fn moved(&self, frame: &Frame, position: f64) -> Frame {
        self.moved_by(frame, position - self.reference)
    }

    /// As [`Joint::moved`], for a joint that moved by `by` (rad or m) from its reference.
    pub(crate) fn moved_by(&self, frame: &Frame, by: f64) -> Frame {
        match self.kind {
            JointKind::Hinge => {
                // A turn about the anchor: the anchor stays where it is.
                let anchor = frame.point(self.pos);
                let quaternion = product(frame.quaternion, axis_angle(self.axis, by));
                Frame { position: sub(anchor, rotate(quaternion, self.pos)), quaternion }
            }
            JointKind::Slide => Frame { position: frame.point(self.axis.map(|x| x * by)), ..*frame },
        }
    }

    /// The joint's axis where its body has `frame`.
    pub fn axis_at(&self, frame: &Frame) -> JointAxis {
        JointAxis {
            kind: self.kind,
            axis: rotate(frame.quaternion, self.axis),
            anchor: frame.point(self.pos),
        }
    }
}
