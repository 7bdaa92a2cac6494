//! A spring on a joint, as settings and command lines write it.

use gaitfit_model::{Model, shown, shown_number};
use serde::{Deserialize, Serialize};
use std::fmt;
use std::str::FromStr;

/// Stiffest spring, N·m/rad.
const STIFFEST: f64 = 1e5;
/// Largest resting angle either way, rad.
const MAX_REST: f64 = 100.0;

/// A spring on a joint: `JOINT=STIFFNESS` or `JOINT=STIFFNESS@REST`.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Spring {
    /// The joint's name.
    pub joint: String,
    /// Torque by angle, N·m/rad.
    pub stiffness: f64,
    /// Angle without torque, rad; the policy's default pose when absent.
    pub rest: Option<f64>,
}

/// Reasons why a text is no spring.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
pub enum SpringError {
    /// It is not written like one.
    #[error(
        "`spring` is \"{0}\"; give JOINT=STIFFNESS (N·m/rad) or JOINT=STIFFNESS@REST (rad), for example \
         RR_calf_joint=75"
    )]
    Form(String),
    /// A number is out of range.
    #[error(
        "`spring` is \"{text}\": its {what} {} must be from {min} to {max} {unit}",
        shown_number(*value)
    )]
    Range {
        /// The whole text.
        text: String,
        /// Which number.
        what: &'static str,
        /// Its value.
        value: f64,
        /// Smallest value.
        min: f64,
        /// Largest value.
        max: f64,
        /// Unit of these.
        unit: &'static str,
    },
    /// The robot lacks the joint.
    #[error("`spring`: {robot} has no joint `{joint}`; it has {joints}")]
    Joint {
        /// The robot.
        robot: String,
        /// The joint asked for.
        joint: String,
        /// Those it has.
        joints: String,
    },
}

impl FromStr for Spring {
    type Err = SpringError;

    fn from_str(text: &str) -> Result<Self, SpringError> {
        // The text may be long or hold control characters. `shown` cuts and escapes it.
        let wrong = || SpringError::Form(shown(text));
        let (joint, numbers) = text.split_once('=').ok_or_else(wrong)?;
        let (stiffness, rest) = match numbers.split_once('@') {
            Some((stiffness, rest)) => (stiffness, Some(rest)),
            None => (numbers, None),
        };
        let number = |number: &str, what, min: f64, max: f64, unit| {
            let value: f64 = number.trim().parse().map_err(|_| wrong())?;
            // NaN lies in no range, so it is refused too.
            if (min..=max).contains(&value) {
                return Ok(value);
            }
            Err(SpringError::Range { text: shown(text), what, value, min, max, unit })
        };
        let joint = joint.trim().to_owned();
        if joint.is_empty() {
            return Err(wrong());
        }
        let stiffness = number(stiffness, "stiffness", 0.0, STIFFEST, "N·m/rad")?;
        let rest = rest.map(|rest| number(rest, "resting angle", -MAX_REST, MAX_REST, "rad")).transpose()?;
        Ok(Self { joint, stiffness, rest })
    }
}

impl TryFrom<String> for Spring {
    type Error = SpringError;

    fn try_from(text: String) -> Result<Self, SpringError> {
        text.parse()
    }
}

impl From<Spring> for String {
    fn from(spring: Spring) -> Self {
        spring.to_string()
    }
}

impl fmt::Display for Spring {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        write!(f, "{}={}", self.joint, self.stiffness)?;
        self.rest.map_or(Ok(()), |rest| write!(f, "@{rest}"))
    }
}

impl Spring {
    /// Puts the spring on its joint; `home`: the angle of a spring without one, by joint. Gives the angle, rad.
    ///
    /// # Errors
    /// A joint that the robot lacks.
    pub fn put_on(&self, model: &mut Model, home: impl Fn(usize) -> Option<f64>) -> Result<f64, SpringError> {
        let Some(index) = model.find_joint(&self.joint) else {
            let joints: Vec<&str> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
            return Err(SpringError::Joint {
                robot: model.name.clone(),
                joint: shown(&self.joint),
                joints: joints.join(", "),
            });
        };
        // A spring without an angle of its own is at rest where the robot stands.
        let rest = self.rest.or(home(index)).unwrap_or(0.0);
        let joint = &mut model.joints[index];
        // The spring replaces one that the robot's file may have; both together would have another angle of
        // rest.
        joint.stiffness = self.stiffness;
        joint.springref = rest;
        Ok(rest)
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn a_spring_is_written_as_it_is_read() {
        for text in ["RR_calf_joint=75", "RR_calf_joint=0.5@-2.2"] {
            assert_eq!(text.parse::<Spring>().unwrap().to_string(), text);
        }
        let spring: Spring = " knee = 7.50 @ 1 ".parse().unwrap();
        assert_eq!(spring, Spring { joint: "knee".to_owned(), stiffness: 7.5, rest: Some(1.0) });
    }

    #[test]
    fn what_is_no_spring_is_named_and_cut() {
        for (text, words) in [
            ("knee", ["`spring`", "JOINT=STIFFNESS"]),
            ("=3", ["`spring`", "JOINT=STIFFNESS"]),
            ("knee=stiff", ["`spring`", "JOINT=STIFFNESS"]),
            ("knee=-1", ["stiffness -1", "from 0 to 100000"]),
            ("knee=1e300", ["stiffness 1e300", "from 0 to 100000"]),
            ("knee=nan", ["stiffness NaN", "from 0 to 100000"]),
            ("knee=5@1e9", ["resting angle 1000000000", "rad"]),
        ] {
            let error = text.parse::<Spring>().unwrap_err().to_string();
            assert!(words.iter().all(|word| error.contains(word)), "{text}: {error}");
        }
        let long = format!("knee\u{1b}={}", "9".repeat(300));
        let error = long.parse::<Spring>().unwrap_err().to_string();
        assert!(error.len() < 300 && !error.contains('\u{1b}'), "{error}");
    }
}
