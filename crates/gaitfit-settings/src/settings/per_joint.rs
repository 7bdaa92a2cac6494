//! A number for every joint (one for all, a list, or by joint pattern) as part of a configuration.

use gaitfit_log::PerJoint;
use serde::{Deserialize, Deserializer, Serialize, Serializer};

/// Reads a value, saying what it may be if it is none of it.
pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Option<PerJoint>, D::Error> {
    // Read as any value first, so that the message can quote what is wrong.
    let value = toml::Value::deserialize(deserializer)?;
    let wrong = |_| {
        serde::de::Error::custom(format!(
            "{value} is no gain; write one number for all joints, or a table such as {{ \"*_hip\" = 20, \"*_calf\" = 40 }}"
        ))
    };
    PerJoint::deserialize(value.clone()).map(Some).map_err(wrong)
}

/// Writes a value in the form it was read.
pub fn serialize<S: Serializer>(value: &Option<PerJoint>, serializer: S) -> Result<S::Ok, S::Error> {
    match value {
        None => serializer.serialize_none(),
        Some(PerJoint::All(value)) => value.serialize(serializer),
        Some(PerJoint::List(values)) => values.serialize(serializer),
        Some(PerJoint::Named(entries)) => entries.serialize(serializer),
    }
}
