//! Metadata of an ONNX file, beside its graph.
//!
//! `gaitfit` holds everything as JSON, for this program. The other entries say the same as comma-separated lists
//! under the names that exporters of robot policies commonly use.

use super::decoded::{Decoded, decode_message};
use super::proto::{Entry, Model};
use crate::checksum::{self, Sealed};
use gaitfit_policy::Interface;
use gaitfit_policy::invalid;
use gaitfit_policy::network::Normaliser;
use gaitfit_policy::{Policy, PolicyError, Provenance};
use prost::Message;
use serde::{Deserialize, Serialize};

/// Program that writes these files, as they name it.
pub const PRODUCER: &str = "gaitfit";
/// Version of the JSON object.
const FORMAT: u32 = 1;
const KEY: &str = "gaitfit";
/// The first entry's key as it is encoded, and how its JSON begins; the length between them takes 1 to 5 bytes.
const ENCODED_KEY: &[u8] = b"\x0a\x07gaitfit\x12";
const JSON: &[u8] = br#"{"sha256":""#;

/// The JSON object.
#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Header {
    /// First, where the [`checksum`] is looked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub sha256: Option<String>,
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
        // The checksum of the whole file is known last and takes this place.
        sha256: Some(checksum::blank()),
        format: FORMAT,
        interface: interface.clone(),
        log_std: policy.log_std.clone(),
        normaliser: policy.normaliser.clone(),
        provenance: policy.provenance.clone(),
    };
    let json = serde_json::to_string(&header).map_err(|error| invalid(error.to_string()))?;
    let numbers = |values: &[f64]| values.iter().map(f64::to_string).collect::<Vec<_>>().join(",");
    let names: Vec<&str> = interface.observation.iter().map(|term| term.quantity.name()).collect();
    let velocities = (!interface.velocity_joints.is_empty())
        .then(|| ("velocity_joint_names", interface.velocity_joints.join(",")));
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
    Ok(list.into_iter().chain(velocities).map(|(key, value)| Entry { key: key.to_owned(), value }).collect())
}

/// Bytes before the digits of the checksum in a file; `None` for a file without one.
fn before(bytes: &[u8]) -> Option<&[u8]> {
    // Weights can hold the key's bytes by chance, so only those that the JSON follows count.
    let starts = bytes.windows(ENCODED_KEY.len()).enumerate().filter(|(_, window)| *window == ENCODED_KEY);
    starts.map(|(start, _)| start).find_map(|start| {
        let length = start + ENCODED_KEY.len();
        // Between key and JSON stands the length of the JSON, a varint of one to five bytes.
        let end = (length + 1..=length + 5)
            .find(|&end| bytes.get(end..).is_some_and(|rest| rest.starts_with(JSON)))?;
        bytes.get(start..end + JSON.len())
    })
}

/// Writes the checksum of a policy's file into its place.
pub fn seal(mut bytes: Vec<u8>) -> Result<Vec<u8>, PolicyError> {
    let before = before(&bytes).map(<[u8]>::to_vec);
    if !before.is_some_and(|before| checksum::seal(&mut bytes, &before)) {
        return Err(invalid("its metadata has no place for the checksum"));
    }
    Ok(bytes)
}

/// Whether the metadata has a checksum.
pub fn is_sealed(metadata: &[Vec<u8>]) -> bool {
    let is_sealed_entry = |bytes: &Vec<u8>| {
        Entry::decode(bytes.as_slice()).is_ok_and(|one| one.key == KEY && Sealed::is(&one.value))
    };
    metadata.iter().any(is_sealed_entry)
}

/// Refuses a file with a checksum whose bytes are not those that were sealed, and one by this program whose own metadata
/// cannot be found: it may look like another program's then.
pub fn check(bytes: &[u8], model: &Model) -> Result<(), PolicyError> {
    let sealed = is_sealed(&model.metadata_props);
    let entry = |bytes: &Vec<u8>| Entry::decode(bytes.as_slice()).is_ok_and(|one| one.key == KEY);
    // Damage can hit the key itself: then other entries are there and this program's own is not.
    let lost = model.producer_name == PRODUCER
        && !model.metadata_props.is_empty()
        && !model.metadata_props.iter().any(entry);
    let intact = || before(bytes).is_some_and(|before| checksum::intact(bytes, before));
    if lost || sealed && !intact() { Err(checksum::damaged()) } else { Ok(()) }
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
