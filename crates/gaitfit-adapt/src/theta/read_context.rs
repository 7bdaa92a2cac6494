//! The robot that values of a file are read for.

use super::saved::MAX_VALUE;
use super::{SavedParameter, ThetaFileError};
use gaitfit_model::Model;
use gaitfit_model::patterns::covered;

/// The data that readers of single modifications need.
pub(super) struct ReadContext<'a> {
    /// The robot.
    pub model: &'a Model,
    /// The robot that the file was fitted to; empty where it does not say.
    pub fitted: &'a str,
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
    pub fn named(&self, parameter: &SavedParameter) -> Result<SavedParameter, ThetaFileError> {
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
        // Many parameters have no smallest value. The format's limit then counts.
        let min = min.max(-MAX_VALUE);
        if (min..=max).contains(value) {
            return Ok(());
        }
        Err(ThetaFileError::Value { name: name.clone(), value: *value, min, max })
    }
}

impl SavedParameter {
    /// Refuses a value beyond the file's own bounds, by more than rounding.
    pub(super) fn check_bounds(&self) -> Result<(), ThetaFileError> {
        let (Some(lower), Some(upper)) = (self.lower, self.upper) else { return Ok(()) };
        let slack = 1e-6 * (upper - lower);
        if self.value >= lower - slack && self.value <= upper + slack {
            return Ok(());
        }
        Err(ThetaFileError::OutOfBounds { name: self.name.clone(), value: self.value, lower, upper })
    }
}
