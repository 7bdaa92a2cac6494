//! Solver effort by name, in configuration files.

use gaitfit_physics::Preset;
use serde::{Deserialize, Deserializer, Serializer, de::Error};

#[allow(clippy::trivially_copy_pass_by_ref, reason = "serde hands fields over by reference")]
pub fn serialize<S: Serializer>(preset: &Preset, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.serialize_str(preset.name())
}

pub fn deserialize<'de, D: Deserializer<'de>>(deserializer: D) -> Result<Preset, D::Error> {
    String::deserialize(deserializer)?.parse().map_err(D::Error::custom)
}
