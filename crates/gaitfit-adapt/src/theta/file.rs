//! `theta.toml`: what a fit found, for programs that use it.

use super::{Found, NetworkName, Theta, checksum, joint_parameters, networks, robot_numbers};
use gaitfit_model::patterns::{PatternError, covered};
use gaitfit_model::{Model, SelfContact, escaped, shown, shown_number};
use gaitfit_sim::Candidate;
use serde::{Deserialize, Serialize};
use std::collections::HashSet;

/// Version of the format. 1 had no networks.
const FORMAT: u32 = 2;

/// The result of a fit: a file that can be written, read and applied to a robot.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ThetaFile {
    /// Version of the format.
    pub format: u32,
    /// The checksum in a text that is being read; `None` everywhere else: [`Self::to_toml`] computes it.
    #[serde(default, skip_serializing)]
    pub checksum: Option<String>,
    /// Robot name.
    #[serde(default)]
    pub robot: String,
    /// The cost it minimises.
    #[serde(default)]
    pub cost_name: String,
    /// Its value.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub cost: Option<f64>,
    /// Physics step of the fit, s. What `resid_act` remembers is in steps, so another step gives another network.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub physics_step: Option<f64>,
    /// Contacts between parts of the robot that the fit simulated; absent if there were none.
    #[serde(default, skip_serializing_if = "SelfContact::is_off")]
    pub self_contact: SelfContact,
    /// Why walks that were not fitted contradict the fit, in words; absent if they do not, or there were none.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub contradicted: Option<String>,
    /// Single numbers.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub parameter: Vec<SavedParameter>,
    /// Networks, one a joint.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub network: Vec<SavedNetwork>,
}

/// A number.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedParameter {
    /// Name.
    pub name: String,
    /// The quantity that it changes, for example `frictionloss`.
    pub kind: String,
    /// The joints it covers, by name or, in a file written by hand, by pattern (`*_hip*`, `{FL,FR}_*`); empty for what is not a joint's.
    #[serde(default)]
    pub joints: Vec<String>,
    /// Value.
    pub value: f64,
    /// Unit.
    #[serde(default)]
    pub unit: String,
    /// Standard deviation over seeds.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub spread: Option<f64>,
    /// Lower bound of the search.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub lower: Option<f64>,
    /// Upper bound of the search.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub upper: Option<f64>,
    /// Whether the value rests on one.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub at_bound: Option<bool>,
    /// The values that fit as well: lower and upper end; absent where it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub interval: Option<[f64; 2]>,
    /// Whether the logs determine it; absent where it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub identified: Option<bool>,
}

/// A joint's network.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedNetwork {
    /// Name, for example `resid_act_RR_calf`.
    pub name: String,
    /// The quantity that the network corrects.
    pub kind: NetworkName,
    /// The joint.
    pub joint: String,
    /// Angle at which the position inputs are 0, rad.
    pub rest: f64,
    /// Factor on the joint's angle, 1/rad.
    pub position_scale: f64,
    /// Factor on the joint's velocity, s/rad.
    pub velocity_scale: f64,
    /// Output for a last layer of weight 1, rad or N·m.
    pub output_scale: f64,
    /// Weights: layer by layer (6 × 8, 8 × 4, 4 × 1), `inputs × outputs` row-major, then biases.
    pub weights: Vec<f64>,
}

/// Most characters of a file's reason that are shown.
const MAX_REASON: usize = 1000;

/// Largest value of any number: beyond it no robot is meant, and single precision may overflow.
pub(super) const MAX_VALUE: f64 = 1e6;

/// Why a file of found values cannot be used.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum ThetaFileError {
    /// It is not such a file.
    #[error("{0}; give the theta.toml of a `gaitfit fit` run")]
    Syntax(String),
    /// The file has a table that belongs to a configuration.
    #[error(
        "it has a table [[number]], which only configurations have. Here a number of the whole robot is a [[parameter]] without \
         `joints`: name, kind (for example \"ground_softness\") and value"
    )]
    Number,
    /// It is not what was written.
    #[error(
        "its checksum does not fit the rest of it: the file was damaged, or edited by hand. If you edited it, delete the \
         line that begins with `checksum`; if not, restore the file or fit again"
    )]
    Checksum,
    /// It is of another version.
    #[error("it has format {0}, and this program reads 1 and 2")]
    Format(u32),
    /// A kind that this program does not know.
    #[error("parameter `{name}` is of kind `{kind}`, which this program does not know")]
    Kind {
        /// Parameter.
        name: String,
        /// Its kind.
        kind: String,
    },
    /// A value without a meaning.
    #[error("`{}` is {}; it must be a number from {min} to {}", shown(name), shown_number(*value), short(*max))]
    Value {
        /// Parameter.
        name: String,
        /// Its value.
        value: f64,
        /// Smallest value with a meaning.
        min: f64,
        /// Largest value that can be simulated.
        max: f64,
    },
    /// A value that the search cannot have found.
    #[error(
        "`{}` is {}, which is not between its `lower` {} and `upper` {}; correct the value, or remove both bounds if it \
         is meant",
        shown(name),
        shown_number(*value),
        shown_number(*lower),
        shown_number(*upper)
    )]
    OutOfBounds {
        /// Parameter.
        name: String,
        /// Its value.
        value: f64,
        /// Lower bound of the search.
        lower: f64,
        /// Upper bound of the search.
        upper: f64,
    },
    /// A joint's parameter of no joint.
    #[error("`{name}` names no joints; give `joints`")]
    NoJoints {
        /// Parameter.
        name: String,
    },
    /// A pattern that covers no joint of the robot.
    #[error("`{}`: {source}", shown(name))]
    Pattern {
        /// Parameter.
        name: String,
        /// The pattern, and what is wrong with it.
        source: PatternError,
    },
    /// A joint that the robot lacks.
    #[error("{robot} has no joint `{}`; it has {joints}{}", shown(joint), of_another(fitted, robot))]
    NoJoint {
        /// The robot that the file was fitted to; empty where it does not say.
        fitted: String,
        /// Robot.
        robot: String,
        /// The joint sought.
        joint: String,
        /// The joints it has.
        joints: String,
    },
    /// A network with a wrong number of weights, or numbers that are not finite.
    #[error("network `{name}` has {count} weights; it needs 97, and all of its numbers finite")]
    Network {
        /// Network.
        name: String,
        /// Weights found.
        count: usize,
    },
    /// Two networks or parameters do the same to one joint.
    #[error("`{name}` is the second of its kind on joint `{joint}`; remove one")]
    Twice {
        /// Network or parameter.
        name: String,
        /// Joint.
        joint: String,
    },
    /// It cannot be written.
    #[error("it cannot be written: {0}")]
    Write(String),
}

/// The data that readers of single modifications need.
pub(super) struct ReadContext<'a> {
    model: &'a Model,
    fitted: &'a str,
}

/// A bound in few digits.
pub(super) fn short(bound: f64) -> String {
    if bound == MAX_VALUE { format!("{bound:e}") } else { bound.to_string() }
}

/// A sentence if the file is of another robot.
fn of_another(fitted: &str, robot: &str) -> String {
    if fitted.is_empty() || fitted == robot {
        return String::new();
    }
    format!(". The file was fitted to `{}`: give one that was fitted to {robot}", shown(fitted))
}

impl ReadContext<'_> {
    /// The index of the joint called `name`.
    pub fn joint(&self, name: &str) -> Result<usize, ThetaFileError> {
        self.model.find_joint(name).ok_or_else(|| ThetaFileError::NoJoint {
            fitted: self.fitted.to_owned(),
            robot: self.model.name.clone(),
            joint: name.to_owned(),
            joints: self.model.joints.iter().map(|joint| joint.name.as_str()).collect::<Vec<_>>().join(", "),
        })
    }

    /// The parameter with the joints' names instead of patterns.
    fn named(&self, parameter: &SavedParameter) -> Result<SavedParameter, ThetaFileError> {
        let joints: Vec<&str> = self.model.joints.iter().map(|joint| joint.name.as_str()).collect();
        // A joint may be called as a pattern is written: it is that joint.
        let patterned =
            |name: &str| name.contains(['*', '?', '[', '{']) && self.model.find_joint(name).is_none();
        let (patterns, names): (Vec<&String>, Vec<&String>) =
            parameter.joints.iter().partition(|name| patterned(name));
        let places = covered(&patterns, &self.model.name, &joints)
            .map_err(|source| ThetaFileError::Pattern { name: parameter.name.clone(), source })?;
        let mut named = SavedParameter { joints: names.into_iter().cloned().collect(), ..parameter.clone() };
        // A pattern may also cover joints that are already named.
        let known: Vec<Option<usize>> = named.joints.iter().map(|name| self.model.find_joint(name)).collect();
        let more = places.into_iter().filter(|place| !known.contains(&Some(*place)));
        named.joints.extend(more.map(|place| joints[place].to_owned()));
        Ok(named)
    }

    /// Whether the value has a meaning, and can be simulated.
    pub fn check(&self, parameter: &SavedParameter, min: f64, max: f64) -> Result<(), ThetaFileError> {
        let SavedParameter { name, value, .. } = parameter;
        let min = min.max(-MAX_VALUE);
        if (min..=max).contains(value) {
            return Ok(());
        }
        Err(ThetaFileError::Value { name: name.clone(), value: *value, min, max })
    }
}

impl SavedParameter {
    /// Refuses a value beyond the file's own bounds, by more than rounding.
    fn check_bounds(&self) -> Result<(), ThetaFileError> {
        let (Some(lower), Some(upper)) = (self.lower, self.upper) else { return Ok(()) };
        let slack = 1e-6 * (upper - lower);
        if self.value >= lower - slack && self.value <= upper + slack {
            return Ok(());
        }
        Err(ThetaFileError::OutOfBounds { name: self.name.clone(), value: self.value, lower, upper })
    }
}

/// Readers of single numbers: the first that knows the kind applies it.
type Reader = fn(&SavedParameter, &ReadContext<'_>, &mut Candidate) -> Option<Result<(), ThetaFileError>>;
const READERS: [Reader; 2] = [joint_parameters::read, robot_numbers::read];

impl ThetaFile {
    /// The file of what a fit of `theta` found, one an entry.
    pub fn new(theta: &Theta, estimates: &[Found], robot: &str, cost_name: &str, cost: f64) -> Self {
        let mut file = Self {
            robot: robot.to_owned(),
            cost_name: cost_name.to_owned(),
            cost: Some(cost),
            ..Self::nominal()
        };
        for (modification, part) in theta.parts() {
            if let Some(estimates) = estimates.get(part) {
                modification.save(estimates, &mut file);
            }
        }
        file
    }

    /// The file of a robot as it is, without any number of a fit.
    pub fn nominal() -> Self {
        Self {
            format: FORMAT,
            checksum: None,
            robot: String::new(),
            cost_name: String::new(),
            cost: None,
            physics_step: None,
            self_contact: SelfContact::Off,
            contradicted: None,
            parameter: Vec::new(),
            network: Vec::new(),
        }
    }

    /// A doubt, in words, about using the file's networks at a physics step of `step` s: those that act at every
    /// physics step (`resid_act`) are others there; `action_delta` acts at the policy's rate.
    pub fn step_doubt(&self, step: f64) -> Option<String> {
        let stepped = self.network.iter().any(|network| network.kind == NetworkName::ResidAct);
        let fitted = self.physics_step.filter(|_| stepped)?;
        ((fitted / step - 1.0).abs() > 0.01).then(|| {
            format!(
                "its networks were fitted at a physics step of {fitted} s and act differently at {step} s; fit again \
                 at that step, or simulate at the fit's"
            )
        })
    }

    /// Doubts, in words: that walks contradict it; parameters that do nothing without another one, and lengths and angles that
    /// no robot has.
    pub fn value_doubts(&self) -> Vec<String> {
        let has = |kind: &str| self.parameter.iter().any(|parameter| parameter.kind == kind);
        let alone = [("stall_torque", "no_load_speed"), ("stribeck_velocity", "stiction")]
            .into_iter()
            .filter(|(kind, with)| has(kind) && !has(with))
            .map(|(kind, with)| {
                format!("its {kind} acts only together with {with}, which the file does not have")
            });
        let far = self.parameter.iter().filter_map(|parameter| {
            let (max, unit) = match parameter.kind.as_str() {
                "link_com_x" | "link_com_y" | "link_com_z" => (1.0, "m"),
                "encoder_bias" | "imu_roll" | "imu_pitch" => (std::f64::consts::PI, "rad"),
                _ => return None,
            };
            (parameter.value.abs() > max).then(|| {
                format!("`{}` is {} {unit}, which no robot has", shown(&parameter.name), parameter.value)
            })
        });
        let contradicted = self
            .contradicted
            .as_ref()
            .map(|why| format!("walks that were not fitted contradict it: {}", escaped(why, MAX_REASON)));
        contradicted.into_iter().chain(alone).chain(far).collect()
    }

    /// A doubt, in words, about using the file on the robot of `model`, whose joints may have the same names.
    pub fn robot_doubt(&self, model: &Model) -> Option<String> {
        (!self.robot.is_empty() && self.robot != model.name).then(|| {
            format!(
                "it was fitted to the robot `{}`, and this is `{}`, whose joints have the same names; fit this robot if \
                 it is another one",
                shown(&self.robot),
                model.name
            )
        })
    }

    /// Reads a file's text.
    ///
    /// # Errors
    /// [`ThetaFileError::Syntax`] with line and column, also of an unknown key; [`ThetaFileError::Format`];
    /// [`ThetaFileError::Checksum`] of a file that has a checksum and is not as it was written.
    pub fn parse(text: &str) -> Result<Self, ThetaFileError> {
        let mut file: Self = toml::from_str(text).map_err(|error| {
            // Configurations have such tables.
            match error.message().contains("unknown field `number`") {
                true => ThetaFileError::Number,
                false => ThetaFileError::Syntax(checksum::at(text, &error)),
            }
        })?;
        if !(1..=FORMAT).contains(&file.format) {
            return Err(ThetaFileError::Format(file.format));
        }
        match file.checksum.take() {
            Some(sum) if sum != checksum::digest(text) => Err(ThetaFileError::Checksum),
            _ => Ok(file),
        }
    }

    /// The file's text, with its checksum.
    ///
    /// # Errors
    /// [`ThetaFileError::Write`].
    pub fn to_toml(&self) -> Result<String, ThetaFileError> {
        let text = toml::to_string(self).map_err(|error| ThetaFileError::Write(error.to_string()))?;
        Ok(checksum::sealed(&text))
    }

    /// The robot of `model` with everything the file says.
    ///
    /// # Errors
    /// [`ThetaFileError`] naming what the robot lacks or what has no meaning.
    pub fn candidate(&self, model: &Model) -> Result<Candidate, ThetaFileError> {
        self.apply(model, Candidate::nominal(model))
    }

    /// The robot `candidate` of `model` with everything the file says.
    ///
    /// # Errors
    /// As [`Self::candidate`].
    pub fn apply(&self, model: &Model, mut candidate: Candidate) -> Result<Candidate, ThetaFileError> {
        let context = ReadContext { model, fitted: &self.robot };
        let mut seen = HashSet::new();
        let named: Vec<SavedParameter> =
            self.parameter.iter().map(|one| context.named(one)).collect::<Result<_, _>>()?;
        for parameter in &named {
            for joint in &parameter.joints {
                if !seen.insert((parameter.kind.as_str(), context.joint(joint)?)) {
                    return Err(ThetaFileError::Twice { name: parameter.name.clone(), joint: joint.clone() });
                }
            }
            let applied = READERS.iter().find_map(|read| read(parameter, &context, &mut candidate));
            applied.unwrap_or_else(|| {
                Err(ThetaFileError::Kind { name: parameter.name.clone(), kind: parameter.kind.clone() })
            })?;
            parameter.check_bounds()?;
        }
        for network in &self.network {
            networks::read(network, &context, &mut candidate)?;
        }
        Ok(candidate)
    }
}
