//! A motion that a policy follows: joint angles and the orientation of one body over time.

use gaitfit_log::Trajectory;
use gaitfit_model::rotation::{axis_angle, blend, heading, inverse, normalize, product, turn, unit};
use serde::{Deserialize, Serialize};

use crate::observation::Sensed;
use crate::{Interface, InterfaceError, Quantity, Term};

/// Max number of samples times joints of a motion.
const MAX_NUMBERS: usize = 1 << 20;
/// Max number of control periods that a motion is read ahead.
const MAX_AHEAD: usize = 1000;

/// A motion that a policy follows. Before its beginning and after its end it stands still.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Reference {
    /// Samples a second, Hz.
    pub rate_hz: f64,
    /// Joint angles, rad, policy order; `samples × joints`.
    pub position: Vec<f32>,
    /// Joint velocities, rad/s, policy order; `samples × joints`.
    pub velocity: Vec<f32>,
    /// Orientation of the anchor, wxyz; `samples × 4`; empty if the motion has none.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub orientation: Vec<f32>,
    /// The joints between the base and the anchor, from the base on; without any the base is the anchor. Their links must
    /// not be turned where their angles are 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub anchor: Vec<AnchorJoint>,
    /// The anchor's name, where the policy's file has it; a robot on which it is elsewhere is refused.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub anchor_body: Option<String>,
}

/// A joint between the base and the anchor of a motion.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct AnchorJoint {
    /// Its name, one of the policy's joints.
    pub joint: String,
    /// Its axis in the frame of its link.
    pub axis: [f64; 3],
}

/// The place of a robot in a motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct MotionPlace {
    /// Time since the motion's beginning, s.
    pub time: f64,
    /// Angle about the vertical by which the motion is turned, rad.
    pub heading: f64,
}

impl Reference {
    /// A time this near to a sample's, in samples, is taken as that sample's: times are sums of rounded numbers.
    pub const SAME_SAMPLE: f64 = 1e-4;

    /// The motion of a log: its joint positions, velocities and, if it has some, orientations.
    ///
    /// # Errors
    /// A log that lacks one of `joints`.
    pub fn from_log(
        log: &Trajectory,
        joints: &[String],
        anchor: Vec<AnchorJoint>,
    ) -> Result<Self, InterfaceError> {
        let lacks = |joint: &String| {
            InterfaceError(format!(
                "the reference motion has no column q_{joint}; it needs q_ and dq_ columns of all the policy's joints"
            ))
        };
        let places: Vec<usize> = joints
            .iter()
            .map(|joint| log.joint(joint).ok_or_else(|| lacks(joint)))
            .collect::<Result<_, _>>()?;
        let in_order = |values: &[f64]| -> Vec<f32> {
            // A log without joints has no rows, and chunks of length 0 would panic.
            let rows = values.chunks_exact(log.joints.len().max(1));
            rows.flat_map(|row| places.iter().map(|&place| row[place] as f32)).collect()
        };
        let quaternion = log.base.as_ref().and_then(|base| base.quaternion.as_deref());
        Ok(Self {
            rate_hz: log.rate_hz,
            position: in_order(&log.position),
            velocity: in_order(&log.velocity),
            orientation: quaternion.unwrap_or_default().iter().map(|&x| x as f32).collect(),
            anchor,
            anchor_body: None,
        })
    }

    /// Checks the motion against the policy's joints.
    ///
    /// # Errors
    /// The first contradiction.
    pub fn check(&self, joints: &[String]) -> Result<(), InterfaceError> {
        let refuse = |what: String| Err(InterfaceError(format!("the reference motion {what}")));
        if !(self.rate_hz.is_finite() && self.rate_hz > 0.0) {
            return refuse(format!("has a rate of {} Hz; give a positive number", self.rate_hz));
        }
        let (angles, width) = (self.position.len(), joints.len().max(1));
        if angles == 0 || angles % width != 0 || self.velocity.len() != angles {
            return refuse(format!(
                "has {angles} angles and {} velocities for {width} joints; give as many rows of both",
                self.velocity.len()
            ));
        }
        if angles > MAX_NUMBERS {
            let (rows, max) = (angles / width, MAX_NUMBERS / width);
            return refuse(format!(
                "has {rows} rows of {width} joints, and at most {max} rows are read; take fewer, for example with `gaitfit import \
                 FILE --every {} --out LESS.csv`",
                rows.div_ceil(max.max(1))
            ));
        }
        if !self.orientation.is_empty() && self.orientation.len() != 4 * (angles / width) {
            return refuse(format!(
                "has {} numbers of orientations for {} samples",
                self.orientation.len(),
                angles / width
            ));
        }
        let all = || self.position.iter().chain(&self.velocity).chain(&self.orientation);
        if let Some(bad) = all().find(|value| !value.is_finite()) {
            return refuse(format!("holds {bad}; its numbers must be finite"));
        }
        // Quaternions are normalised when they are read. Shorter than half a unit they are no rounded unit
        // quaternions.
        if self.orientation.chunks_exact(4).any(|q| q.iter().map(|x| x * x).sum::<f32>() < 0.25) {
            return refuse("has orientations that are not unit quaternions".to_owned());
        }
        for (place, AnchorJoint { joint, axis }) in self.anchor.iter().enumerate() {
            if self.anchor[..place].iter().any(|other| other.joint == *joint) {
                return refuse(format!("names `{joint}` twice in `anchor`; name each joint once"));
            }
            if !joints.contains(joint) {
                return refuse(format!("names `{joint}` in `anchor`, which is not a joint of the policy"));
            }
            if unit(*axis).is_none() || axis.iter().any(|x| !x.is_finite()) {
                return refuse(format!("gives `{joint}` in `anchor` an axis without a direction"));
            }
        }
        Ok(())
    }

    /// The anchor's joints, from the base on: place among `joints`, the policy's, and axis (unit, frame of the link).
    /// Joints that [`Reference::check`] refuses are left out.
    pub fn anchor_axes(&self, joints: &[String]) -> Vec<(usize, [f64; 3])> {
        let place = |one: &AnchorJoint| {
            let place = joints.iter().position(|joint| *joint == one.joint)?;
            Some((place, unit(one.axis)?))
        };
        self.anchor.iter().filter_map(place).collect()
    }

    /// Samples.
    pub fn samples(&self, joints: usize) -> usize {
        self.position.len() / joints.max(1)
    }
}

impl Interface {
    /// Whether the policy observes a command. One that follows a motion, as a rule, does not.
    pub fn observes_command(&self) -> bool {
        self.observation.iter().any(|term| term.quantity == Quantity::Command)
    }

    /// Whether a term has the motion that it needs.
    pub(crate) fn check_reference(&self, name: &str, term: &Term) -> Result<(), InterfaceError> {
        let quantity = term.quantity.name();
        if !term.quantity.is_of_reference() {
            return match term.ahead {
                0 => Ok(()),
                _ => Err(InterfaceError(format!(
                    "{quantity} in {name} has `ahead`, which only quantities of a reference motion have; leave it out"
                ))),
            };
        }
        if term.ahead > MAX_AHEAD {
            let ahead = term.ahead;
            return Err(InterfaceError(format!(
                "ahead of {quantity} in {name} is {ahead}; at most {MAX_AHEAD}"
            )));
        }
        let Some(reference) = &self.reference else {
            return Err(InterfaceError(format!(
                "{name} holds {quantity}, and there is no motion to follow: describe the policy in a TOML file with `file` and \
                 `reference = \"MOTION.csv\"` (docs/policies-motion.md). gaitfit does not train such policies"
            )));
        };
        if term.quantity == Quantity::ReferenceOrientation && reference.orientation.is_empty() {
            return Err(InterfaceError(format!(
                "{name} holds {quantity}, and the reference motion has no orientations; add columns base_quat_w, base_quat_x, \
                 base_quat_y, base_quat_z to its file"
            )));
        }
        Ok(())
    }
}

/// A motion as observations read it.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Follower {
    reference: Reference,
    joints: usize,
    /// The anchor's joints: place among the policy's, and axis.
    anchor: Vec<(usize, [f64; 3])>,
    control_dt: f64,
}

impl Follower {
    /// The motion of `interface`; `None` if it has none.
    pub fn new(interface: &Interface) -> Option<Self> {
        let reference = interface.reference.clone()?;
        Some(Self {
            anchor: reference.anchor_axes(&interface.joints),
            joints: interface.joints.len(),
            control_dt: interface.control_dt,
            reference,
        })
    }

    /// Writes the value of `quantity` at `ahead` control periods after the present place in the motion. It writes nothing if this is
    /// not a quantity of a motion.
    pub fn write(&self, quantity: Quantity, ahead: usize, sensed: &Sensed, out: &mut [f32]) {
        let time = sensed.motion.time + ahead as f64 * self.control_dt;
        match quantity {
            Quantity::ReferenceJointPosition => self.position(time, out),
            Quantity::ReferenceJointVelocity => self.velocity(time, out),
            Quantity::ReferenceOrientation => self.difference(time, sensed, out),
            Quantity::ReferencePhase => out.fill(self.phase(time)),
            _ => {}
        }
    }

    /// The samples about `time` and the share of the second; whether the motion moves then.
    fn about(&self, time: f64) -> ([usize; 2], f64, bool) {
        let last = self.reference.samples(self.joints).saturating_sub(1);
        let place = time * self.reference.rate_hz;
        // Without this, a time that is rounded up would be after the last sample, where the velocity is 0.
        let near = place.round();
        let place = if (place - near).abs() < Reference::SAME_SAMPLE { near } else { place };
        let moves = place >= 0.0 && place <= last as f64;
        // Before its beginning the motion stands at the first sample, after its end at the last one.
        let place = place.clamp(0.0, last as f64);
        let low = (place.floor() as usize).min(last);
        // At the end of the motion both samples are the last one.
        ([low, (low + 1).min(last)], place - low as f64, moves)
    }

    fn mix(&self, values: &[f32], time: f64, out: &mut [f32]) -> bool {
        let ([low, high], share, moves) = self.about(time);
        let row = |sample: usize| &values[sample * self.joints..(sample + 1) * self.joints];
        for ((out, &a), &b) in out.iter_mut().zip(row(low)).zip(row(high)) {
            *out = (f64::from(a) + share * (f64::from(b) - f64::from(a))) as f32;
        }
        moves
    }

    /// Joint angles at `time`, rad.
    pub fn position(&self, time: f64, out: &mut [f32]) {
        self.mix(&self.reference.position, time, out);
    }

    /// Joint velocities at `time`, rad/s; 0 outside the motion.
    fn velocity(&self, time: f64, out: &mut [f32]) {
        if !self.mix(&self.reference.velocity, time, out) {
            out.fill(0.0);
        }
    }

    /// Share of the motion that is over at `time`, 0 to 1.
    fn phase(&self, time: f64) -> f32 {
        let last = self.reference.samples(self.joints).saturating_sub(1);
        // A motion of one sample is over from the beginning.
        if last == 0 { 1.0 } else { (time * self.reference.rate_hz / last as f64).clamp(0.0, 1.0) as f32 }
    }

    /// Orientation of the anchor in the motion, unturned.
    fn orientation(&self, time: f64) -> Option<[f64; 4]> {
        let ([low, high], share, _) = self.about(time);
        let row = |sample: usize| -> Option<[f64; 4]> {
            let row = self.reference.orientation.get(4 * sample..4 * sample + 4)?;
            Some(normalize(std::array::from_fn(|k| f64::from(row[k]))))
        };
        Some(blend(row(low)?, row(high)?, share))
    }

    /// Orientation of the robot's anchor.
    fn anchor(&self, base: [f32; 4], joint_position: &[f32]) -> [f64; 4] {
        let base = normalize(base.map(f64::from));
        // From the base on, each joint turns the frame in which the next one stands.
        self.anchor.iter().fold(base, |frame, &(joint, axis)| {
            product(frame, axis_angle(axis, f64::from(joint_position[joint])))
        })
    }

    /// The angle by which the motion is turned to face at `time` as a robot does, rad; 0 of a motion without orientations.
    pub fn heading(&self, time: f64, base: [f32; 4], joint_position: &[f32]) -> f64 {
        let Some(in_motion) = self.orientation(time) else { return 0.0 };
        heading(self.anchor(base, joint_position)) - heading(in_motion)
    }

    /// Rotation from the robot's anchor to the motion's, which is turned by the robot's place in it: the first two columns of its
    /// matrix, row by row.
    fn difference(&self, time: f64, sensed: &Sensed, out: &mut [f32]) {
        let Some(in_motion) = self.orientation(time) else { return out.fill(0.0) };
        let wanted = product(turn(2, sensed.motion.heading), in_motion);
        let anchor = self.anchor(sensed.orientation, &sensed.joint_position);
        let relative = product(inverse(anchor), wanted);
        let matrix = gaitfit_model::rotation::matrix(relative);
        // Two columns are enough: the third is their cross product.
        for (k, out) in out.iter_mut().enumerate() {
            *out = matrix[k / 2][k % 2] as f32;
        }
    }
}
