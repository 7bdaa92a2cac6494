//! What a policy sees and what its outputs mean: the contract between a network, a robot and a simulator.

use crate::observation::Layout;
use crate::term::{Term, width};
use crate::{ActionClip, FrameOrder, Held, History, Quantity, Reference, Source};
use gaitfit_model::Model;
use serde::{Deserialize, Serialize};

/// What a policy sees and what its outputs mean. Per-joint vectors are in the order of `joints`.
///
/// target = default_pose + action_scale · clamp(action, ± action_clip), held for `control_dt` by the PD controller
/// torque = kp (target − q) − kd q̇. Held joints have a target of their own. The target of a joint of `velocity_joints` is a
/// velocity: torque = kd (target − q̇).
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Interface {
    /// Name of the robot model; empty where it is not known.
    pub robot: String,
    /// Joint names, in the policy's order.
    pub joints: Vec<String>,
    /// Pose at action zero, rad.
    pub default_pose: Vec<f64>,
    /// Target change per unit action, rad; rad/s for joints with velocity targets.
    pub action_scale: Vec<f64>,
    /// Largest action magnitude, before scaling; none is unbounded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub action_clip: Option<ActionClip>,
    /// Position gain, N·m/rad.
    pub kp: Vec<f64>,
    /// Velocity gain, N·m·s/rad.
    pub kd: Vec<f64>,
    /// Those of `joints` whose targets are velocities, rad/s, such as wheels. Their pose and their position gain are 0.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub velocity_joints: Vec<String>,
    /// Joints that the policy does not move and a PD controller holds. Joints that are neither here nor in `joints` are
    /// limp.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub held: Vec<Held>,
    /// Time between actions, s.
    pub control_dt: f64,
    /// Frequency of the gait clock, Hz; needed where [`Quantity::GaitPhase`] or [`Quantity::GaitSine`] is observed.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gait_frequency: Option<f64>,
    /// The motion that the policy follows; needed if a term is a quantity of a motion.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub reference: Option<Reference>,
    /// How past frames lie in a row, where terms have a [`Term::history`].
    #[serde(default, skip_serializing_if = "History::is_default")]
    pub history: History,
    /// The actor's observation, part by part.
    pub observation: Vec<Term>,
    /// The critic's observation, part by part; empty for policies without a critic.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub critic_observation: Vec<Term>,
}

/// An interface that contradicts itself, a network or a robot.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[error("{0}")]
pub struct InterfaceError(pub String);

/// Max number of joints, and of terms of an observation.
const MAX_JOINTS: usize = 256;
/// Max number of frames of a term, and of numbers of an observation.
const MAX_FRAMES: usize = 256;
const MAX_NUMBERS: usize = 1 << 16;
/// Longest name of a robot or a joint, bytes.
const LONGEST_NAME: usize = 200;
/// Largest magnitude of any number of an interface; beyond it lies no robot, and single precision overflows.
const LARGEST: f64 = 1e6;
/// Shortest and longest time between actions, s.
const CONTROL_DT: [f64; 2] = [1e-3, 1.0];

impl Interface {
    /// Numbers in the actor's observation.
    pub fn observation_width(&self) -> usize {
        self.width(&self.observation)
    }

    /// Numbers in the critic's observation.
    pub fn critic_width(&self) -> usize {
        self.width(&self.critic_observation)
    }

    /// Numbers in an observation of `terms`.
    pub fn width(&self, terms: &[Term]) -> usize {
        width(terms, self.joints.len())
    }

    /// Largest action magnitude of the policy's joint `index`, before scaling; infinite where it is not limited.
    pub fn clip(&self, index: usize) -> f64 {
        self.action_clip.as_ref().map_or(f64::INFINITY, |clip| clip.limit(index))
    }

    /// The first quantity of the actor's observation that a robot does not measure, if there is one.
    pub fn unmeasured(&self) -> Option<Quantity> {
        let mut seen = self.observation.iter().map(|term| term.quantity);
        seen.find(|quantity| quantity.source() == Source::Simulation)
    }

    /// The terms' scales, one for each number of `observation` (see [`Term::scale`]), for example of
    /// `self.observation`. A scale of neither one number nor the term's width, which [`Interface::check`]
    /// refuses, counts as 1.
    pub fn scales(&self, observation: &[Term]) -> Vec<f32> {
        Layout::new(self, observation).scales()
    }

    /// Sentence part for errors: `45 numbers (3 base_angular_velocity + 3 projected_gravity + …)`.
    pub fn describe(&self, observation: &[Term]) -> String {
        let joints = self.joints.len();
        let parts: Vec<String> = observation
            .iter()
            .map(|term| {
                let frames = if term.history == 1 { String::new() } else { format!("{} × ", term.history) };
                format!("{frames}{} {}", term.quantity.width(joints), term.quantity.name())
            })
            .collect();
        format!("{} numbers ({})", width(observation, joints), parts.join(" + "))
    }

    /// Checks the interface against itself: names, lengths, signs, sizes.
    ///
    /// # Errors
    /// The first contradiction, with the field's name and what would be right.
    pub fn check(&self) -> Result<(), InterfaceError> {
        // Names come first, because the messages below print them.
        self.check_names()?;
        let joints = self.joints.len();
        let per_joint = [
            ("default_pose", &self.default_pose),
            ("action_scale", &self.action_scale),
            ("kp", &self.kp),
            ("kd", &self.kd),
        ];
        for (name, values) in per_joint {
            if values.len() != joints {
                let count = values.len();
                return Err(InterfaceError(format!(
                    "{name} has {count} numbers for {joints} joints; give one a joint, in the order of joints"
                )));
            }
            for (joint, &value) in self.joints.iter().zip(values) {
                // A negative gain would push a joint away from its target; a pose or a scale may be negative.
                let gain = name == "kp" || name == "kd";
                if !(value.is_finite() && value.abs() <= LARGEST) || gain && value < 0.0 {
                    let kind = if gain { "a finite number, not negative" } else { "a finite number" };
                    return Err(InterfaceError(format!("{name} of {joint} is {value}; give {kind}")));
                }
            }
        }
        self.check_velocity_joints()?;
        // A joint with a velocity target acts through its kd alone.
        if self.kp.iter().all(|&kp| kp == 0.0) && self.velocity_joints.is_empty() {
            return Err(InterfaceError("kp is zero for every joint: no action would have an effect".into()));
        }
        let [min, max] = CONTROL_DT;
        if !(min..=max).contains(&self.control_dt) {
            let dt = self.control_dt;
            return Err(InterfaceError(format!("control_dt is {dt} s; give {min} to {max} s")));
        }
        if let Some(ActionClip::Each(clips)) = &self.action_clip
            && clips.len() != joints
        {
            let count = clips.len();
            return Err(InterfaceError(format!(
                "action_clip has {count} numbers for {joints} joints; give one number, or one a joint"
            )));
        }
        for &clip in self.action_clip.iter().flat_map(ActionClip::values) {
            positive("action_clip", Some(clip))?;
        }
        self.check_held()?;
        // The motion is checked before the terms that read it.
        if let Some(reference) = &self.reference {
            reference.check(&self.joints)?;
        }
        positive("gait_frequency", self.gait_frequency)?;
        if self.observation.is_empty() {
            return Err(InterfaceError("observation has no terms; list what the policy sees".into()));
        }
        let follows = |terms: &[Term]| terms.iter().any(|term| term.quantity.is_of_reference());
        if self.reference.is_some() && !follows(&self.observation) && !follows(&self.critic_observation) {
            return Err(InterfaceError(
                "`reference` names a motion, and no term of the observation reads it; leave `reference` out, or list what the \
                 policy observes of it, such as reference_joint_position"
                    .to_owned(),
            ));
        }
        self.check_terms("observation", &self.observation)?;
        self.check_terms("critic_observation", &self.critic_observation)
    }

    fn check_held(&self) -> Result<(), InterfaceError> {
        if self.held.len() > MAX_JOINTS {
            let count = self.held.len();
            return Err(InterfaceError(format!("held has {count} joints; at most {MAX_JOINTS}")));
        }
        for (index, Held { joint, position, kp, kd }) in self.held.iter().enumerate() {
            check_name("held", joint)?;
            if self.joints.contains(joint) || self.held[..index].iter().any(|other| other.joint == *joint) {
                return Err(InterfaceError(format!(
                    "held joint {joint} is listed twice, or is one that the policy moves"
                )));
            }
            for (name, value, min) in [("position", position, -LARGEST), ("kp", kp, 0.0), ("kd", kd, 0.0)] {
                if !(min..=LARGEST).contains(value) {
                    let kind = if min < 0.0 { "a finite number" } else { "a finite number, not negative" };
                    return Err(InterfaceError(format!(
                        "{name} of held joint {joint} is {value}; give {kind}"
                    )));
                }
            }
        }
        Ok(())
    }

    fn check_names(&self) -> Result<(), InterfaceError> {
        let joints = self.joints.len();
        if joints == 0 || joints > MAX_JOINTS {
            return Err(InterfaceError(format!(
                "joints names {joints} joints; give between 1 and {MAX_JOINTS}"
            )));
        }
        if !self.robot.is_empty() {
            check_name("robot", &self.robot)?;
        }
        for name in &self.joints {
            check_name("joints", name)?;
        }
        // Only equal names are found here. Names that differ by `_joint` are found on the model, in
        // `resolve`.
        let twice = (1..joints).find(|&index| self.joints[..index].contains(&self.joints[index]));
        twice
            .map_or(Ok(()), |index| Err(InterfaceError(format!("joints names {} twice", self.joints[index]))))
    }

    fn check_terms(&self, name: &str, terms: &[Term]) -> Result<(), InterfaceError> {
        if terms.len() > MAX_JOINTS {
            return Err(InterfaceError(format!("{name} has {} terms; at most {MAX_JOINTS}", terms.len())));
        }
        for term in terms {
            let quantity = term.quantity.name();
            let wanted = term.quantity.width(self.joints.len());
            let count = term.scale.len();
            if count > 1 && count != wanted {
                return Err(InterfaceError(format!(
                    "scale of {quantity} in {name} has {count} numbers; give none, 1 or {wanted}"
                )));
            }
            if let Some(bad) =
                term.scale.iter().find(|&&scale| scale.is_nan() || f64::from(scale).abs() > LARGEST)
            {
                return Err(InterfaceError(format!(
                    "scale of {quantity} in {name} is {bad}; give finite numbers"
                )));
            }
            if term.quantity.is_of_clock() && self.gait_frequency.is_none() {
                return Err(InterfaceError(format!(
                    "{name} holds {quantity}, but gait_frequency is missing; give the gait clock's Hz"
                )));
            }
            self.check_reference(name, term)?;
            // It is found in the row before, as that row's last action.
            let is_last = |term: &Term| term.quantity == Quantity::LastAction;
            let mut last = terms.iter().filter(|term| is_last(term));
            // The earlier action is divided by the factor of the last one, which must not be 0.
            let has_last = last.next().is_some_and(|last| !last.scale.contains(&0.0));
            if term.quantity == Quantity::EarlierAction && !(has_last && last.next().is_none()) {
                return Err(InterfaceError(format!(
                    "{name} holds {quantity}, which needs last_action there too, once and with factors other than 0"
                )));
            }
        }
        self.check_history(name, terms)
    }

    fn check_history(&self, name: &str, terms: &[Term]) -> Result<(), InterfaceError> {
        for term in terms {
            let (quantity, frames) = (term.quantity.name(), term.history);
            if !(1..=MAX_FRAMES).contains(&frames) {
                return Err(InterfaceError(format!(
                    "history of {quantity} in {name} is {frames}; give 1 to {MAX_FRAMES} frames"
                )));
            }
            // In the order of terms each term has a block of its own, so histories may differ there.
            if self.history.order != FrameOrder::Terms && frames != terms[0].history {
                return Err(InterfaceError(format!(
                    "history of {quantity} in {name} is {frames}, of {} {}; whole frames need the same of every term",
                    terms[0].quantity.name(),
                    terms[0].history
                )));
            }
        }
        // Widths and histories may come from a file: the sum saturates and does not wrap.
        let numbers = width(terms, self.joints.len());
        if numbers > MAX_NUMBERS {
            return Err(InterfaceError(format!("{name} has {numbers} numbers; at most {MAX_NUMBERS}")));
        }
        Ok(())
    }

    /// Note for a `model` that has another name than the policy's robot. Related robots share joint names, so
    /// a policy may run on a robot that it was not trained for.
    pub fn other_robot(&self, model: &Model) -> Option<String> {
        (!self.robot.is_empty() && self.robot != model.name).then(|| {
            format!(
                "the policy was trained for robot `{}` and runs on `{}`, which has its joints",
                self.robot, model.name
            )
        })
    }

    /// For each of `joints`, its index in `model.joints`. A `_joint` suffix on either side does not matter.
    ///
    /// # Errors
    /// A joint that the robot lacks (with the nearest name), or two names for one joint. Robots' names may differ
    /// ([`Interface::other_robot`]).
    pub fn resolve(&self, model: &Model) -> Result<Vec<usize>, InterfaceError> {
        let mut indices = Vec::with_capacity(self.joints.len());
        for name in &self.joints {
            let index = find(model, "joints", name)?;
            if let Some(other) = indices.iter().position(|&other| other == index) {
                return Err(InterfaceError(format!(
                    "joints: `{}` and `{name}` are both joint `{}` of robot `{}`; name every joint once",
                    self.joints[other], model.joints[index].name, model.name
                )));
            }
            indices.push(index);
        }
        Ok(indices)
    }

    /// For each of `held`, its index in `model.joints`. `joints`: those of [`Interface::resolve`].
    ///
    /// # Errors
    /// A joint that the robot lacks, or that the policy moves or another entry holds.
    pub fn resolve_held(&self, model: &Model, joints: &[usize]) -> Result<Vec<usize>, InterfaceError> {
        let mut indices = Vec::with_capacity(self.held.len());
        for Held { joint, .. } in &self.held {
            let index = find(model, "held", joint)?;
            if joints.contains(&index) || indices.contains(&index) {
                return Err(InterfaceError(format!(
                    "held joint `{joint}` of robot `{}` is held twice, or moved by the policy",
                    model.name
                )));
            }
            indices.push(index);
        }
        Ok(indices)
    }

    /// Angles of all joints of `model` at action zero, its order, rad. Joints that are neither moved nor held follow others or are
    /// at 0.
    ///
    /// # Errors
    /// As [`Interface::resolve`] and [`Interface::resolve_held`].
    pub fn model_pose(&self, model: &Model) -> Result<Vec<f64>, InterfaceError> {
        let joints = self.resolve(model)?;
        let held = self.resolve_held(model, &joints)?.into_iter().zip(&self.held);
        let moved = joints.iter().copied().zip(self.default_pose.iter().copied());
        let stated = moved.chain(held.map(|(joint, held)| (joint, held.position)));
        let (joints, angles): (Vec<usize>, Vec<f64>) = stated.unzip();
        let mut pose = vec![0.0; model.joints.len()];
        joints.iter().zip(angles).for_each(|(&joint, angle)| pose[joint] = angle);
        // Joints that follow others take their angles from the stated ones.
        model.couple_others(&mut pose, &joints);
        Ok(pose)
    }
}

fn find(model: &Model, field: &str, name: &str) -> Result<usize, InterfaceError> {
    model.find_joint(name).ok_or_else(|| {
        let near = nearest(name, model.joints.iter().map(|joint| joint.name.as_str()));
        InterfaceError(format!("{field}: robot `{}` has no joint `{name}`{near}", model.name))
    })
}

fn check_name(field: &str, name: &str) -> Result<(), InterfaceError> {
    if name.is_empty() || name.len() > LONGEST_NAME || name.chars().any(char::is_control) {
        // A refused name may be huge or hold control characters, which must not reach a terminal.
        let shown: String = name.chars().take(40).flat_map(char::escape_debug).collect();
        return Err(InterfaceError(format!(
            "{field}: `{shown}` is no name; give 1 to {LONGEST_NAME} printable bytes"
        )));
    }
    Ok(())
}

fn positive(name: &str, value: Option<f64>) -> Result<(), InterfaceError> {
    match value {
        // The negation also refuses NaN.
        Some(value) if !(value > 0.0 && value <= LARGEST) => {
            Err(InterfaceError(format!("{name} is {value}; give a positive number")))
        }
        _ => Ok(()),
    }
}

/// Advice for an unknown name: the known one that is nearest, or what there is.
fn nearest<'a>(unknown: &str, known: impl Iterator<Item = &'a str>) -> String {
    // Jaro-Winkler favours names that begin alike, as the joints of one leg do.
    let scored = known.map(|name| (strsim::jaro_winkler(unknown, name), name));
    match scored.max_by(|a, b| a.0.total_cmp(&b.0)) {
        Some((_, name)) => format!("; the nearest name is `{name}`"),
        None => "; it has no joints".to_owned(),
    }
}
