//! What an ONNX file says beside its graph.
//!
//! `gaitfit` holds everything as JSON, for this program. The other entries say the same as comma-separated lists
//! under the names that exporters of robot policies commonly use.

use super::graph::{Decoded, decode_message};
use super::proto::Entry;
use crate::Interface;
use crate::error::invalid;
use crate::network::Normaliser;
use crate::{Policy, PolicyError, Provenance};
use serde::{Deserialize, Serialize};

/// Version of the JSON object.
const FORMAT: u32 = 1;
const KEY: &str = "gaitfit";

/// The JSON object.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    pub format: u32,
    pub interface: Interface,
    pub log_std: Vec<f32>,
    /// The graph's first two nodes hold it too, rounded.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub normaliser: Option<Normaliser>,
    pub provenance: Provenance,
}

/// All entries of a policy.
pub fn entries(policy: &Policy) -> Result<Vec<Entry>, PolicyError> {
    let interface = &policy.interface;
    let header = Header {
        format: FORMAT,
        interface: interface.clone(),
        log_std: policy.log_std.clone(),
        normaliser: policy.normaliser.clone(),
        provenance: policy.provenance.clone(),
    };
    let json = serde_json::to_string(&header).map_err(|error| invalid(error.to_string()))?;
    let numbers = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let names: Vec<&str> = interface.observation.iter().map(|term| term.quantity.name()).collect();
    let list = [
        (KEY, json),
        ("robot", interface.robot.clone()),
        ("joint_names", interface.joints.join(",")),
        ("default_joint_pos", numbers(&interface.default_pose)),
        ("action_scale", numbers(&interface.action_scale)),
        ("joint_stiffness", numbers(&interface.kp)),
        ("joint_damping", numbers(&interface.kd)),
        ("observation_names", names.join(",")),
        ("control_dt", interface.control_dt.to_string()),
    ];
    Ok(list.into_iter().map(|(key, value)| Entry { key: key.to_owned(), value }).collect())
}

/// Every entry.
pub fn all(model: &Decoded) -> Result<Vec<(String, String)>, PolicyError> {
    let entry = |bytes: &Vec<u8>| -> Result<(String, String), PolicyError> {
        let entry: Entry = decode_message(bytes, "metadata")?;
        Ok((entry.key, entry.value))
    };
    model.metadata.iter().map(entry).collect()
}

/// This program's entry; `None` where another program wrote the file.
pub fn read(model: &Decoded) -> Result<Option<Header>, PolicyError> {
    for bytes in &model.metadata {
        let entry: Entry = decode_message(bytes, "metadata")?;
        if entry.key == KEY {
            let damaged = |error| invalid(format!("its `gaitfit` metadata is damaged: {error}"));
            let header: Header = serde_json::from_str(&entry.value).map_err(damaged)?;
            if header.format != FORMAT {
                return Err(invalid(format!(
                    "its `gaitfit` metadata has format {}, this program reads format {FORMAT}; use the program \
                     that wrote it",
                    header.format
                )));
            }
            return Ok(Some(header));
        }
    }
    Ok(None)
}
