//! `theta.toml`: what a fit found, for programs that use it.

use super::read_context::ReadContext;
use super::saved::FORMAT;
use super::{
    Found, NetworkName, SavedParameter, Theta, ThetaFile, ThetaFileError, checksum, joint_parameters,
    networks, robot_numbers,
};
use gaitfit_model::{Model, escaped, shown};
use gaitfit_sim::Candidate;
use std::collections::HashSet;

/// Max number of characters of a file's reason that are shown.
pub const MAX_REASON: usize = 1000;

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
        // These act only in a pair: one without the other changes nothing in the simulation.
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
    /// [`ThetaFileError::Checksum`] of a file that has a checksum and is not as it was written; [`ThetaFileError::SameName`].
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
        // Taken out: outside of a text the field is `None`.
        if file.checksum.take().is_some_and(|sum| sum != checksum::digest(text)) {
            return Err(ThetaFileError::Checksum);
        }
        match file.repeated_name() {
            Some(name) => Err(ThetaFileError::SameName(name)),
            None => Ok(file),
        }
    }

    /// A name of more than one parameter.
    fn repeated_name(&self) -> Option<String> {
        let mut names = HashSet::new();
        let repeated = self.parameter.iter().find(|parameter| !names.insert(parameter.name.as_str()));
        repeated.map(|parameter| parameter.name.clone())
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
        // The same joint may be named twice only by different kinds.
        let mut seen = HashSet::new();
        let named: Vec<SavedParameter> =
            self.parameter.iter().map(|one| context.named(one)).collect::<Result<_, _>>()?;
        for parameter in &named {
            for joint in &parameter.joints {
                if !seen.insert((parameter.kind.as_str(), context.joint(joint)?)) {
                    return Err(ThetaFileError::Twice { name: parameter.name.clone(), joint: joint.clone() });
                }
            }
            // Each reader knows its kinds; the first that does reads the parameter.
            let applied = READERS.iter().find_map(|read| read(parameter, &context, &mut candidate));
            applied.unwrap_or_else(|| {
                Err(ThetaFileError::Kind { name: parameter.name.clone(), kind: parameter.kind.clone() })
            })?;
            // The search's own bounds come last: a value without any meaning is refused by its reader first.
            parameter.check_bounds()?;
        }
        for network in &self.network {
            networks::read(network, &context, &mut candidate)?;
        }
        Ok(candidate)
    }
}
