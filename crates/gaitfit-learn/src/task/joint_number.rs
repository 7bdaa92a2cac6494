//! A number for every joint as a setting: one for all, or a table of joint patterns.

use std::fmt;

use gaitfit_model::{Model, patterns};
use serde::de::{Error, MapAccess, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::error::refuse;
use super::{JointTable, TaskError};

/// A number for every joint.
#[derive(Clone, Debug, PartialEq)]
pub enum JointNumber {
    /// The same for all.
    All(f64),
    /// By pattern over joint names.
    Table(JointTable),
}

impl JointNumber {
    /// Its numbers, each with the pattern that it is of.
    pub fn entries(&self) -> Vec<(Option<&str>, f64)> {
        match self {
            Self::All(value) => vec![(None, *value)],
            Self::Table(table) => {
                table.iter().map(|(pattern, value)| (Some(pattern.as_str()), *value)).collect()
            }
        }
    }

    /// One number a joint of `wanted` (indices of `model.joints`), in that order.
    ///
    /// # Errors
    /// A pattern that matches no joint of the model; a wanted joint without a number.
    pub fn of_joints(&self, model: &Model, wanted: &[usize], setting: &str) -> Result<Vec<f64>, TaskError> {
        let table = match self {
            Self::All(value) => return Ok(vec![*value; wanted.len()]),
            Self::Table(table) => by_joint(model, table, setting)?,
        };
        let number = |&joint: &usize| match table.get(joint).copied().flatten() {
            Some(value) => Ok(value),
            None => refuse(
                setting,
                format!(
                    "has no number for `{}`; add a pattern that covers it, for example \"*\" as the first",
                    model.joints[joint].name
                ),
            ),
        };
        wanted.iter().map(number).collect()
    }
}

/// Values of a table by joint of the model, where a pattern matches.
pub(super) fn by_joint(
    model: &Model,
    table: &JointTable,
    setting: &str,
) -> Result<Vec<Option<f64>>, TaskError> {
    let joints: Vec<&str> = model.joints.iter().map(|joint| joint.name.as_str()).collect();
    patterns::table(table, &model.name, &joints)
        .or_else(|error| refuse(setting, format!("is wrong: {error}")))
}

impl Serialize for JointNumber {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::All(value) => value.serialize(serializer),
            Self::Table(table) => table.serialize(serializer),
        }
    }
}

impl<'de> Deserialize<'de> for JointNumber {
    fn deserialize<D: Deserializer<'de>>(deserializer: D) -> Result<Self, D::Error> {
        struct Either;
        impl<'de> Visitor<'de> for Either {
            type Value = JointNumber;

            fn expecting(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
                f.write_str(
                    "a number, or a table of joint patterns such as { \"*_hip\" = 20, \"*_calf\" = 40 }",
                )
            }

            fn visit_f64<E: Error>(self, value: f64) -> Result<JointNumber, E> {
                Ok(JointNumber::All(value))
            }

            // A number without a point, which TOML reads as a whole number.
            fn visit_i64<E: Error>(self, value: i64) -> Result<JointNumber, E> {
                Ok(JointNumber::All(value as f64))
            }

            fn visit_u64<E: Error>(self, value: u64) -> Result<JointNumber, E> {
                Ok(JointNumber::All(value as f64))
            }

            fn visit_map<A: MapAccess<'de>>(self, mut map: A) -> Result<JointNumber, A::Error> {
                let mut table = JointTable::new();
                while let Some((pattern, value)) = map.next_entry()? {
                    table.insert(pattern, value);
                }
                Ok(JointNumber::Table(table))
            }
        }
        deserializer.deserialize_any(Either)
    }
}
