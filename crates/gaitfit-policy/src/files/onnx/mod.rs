//! Policies as ONNX graphs, out and in.
//!
//! Multilayer perceptrons are read, alone or behind recurrent layers; everything else is refused by node and operator.

mod attributes;
mod bounds;
mod chain;
mod constant;
mod external;
mod fuse;
mod graph;
mod linear;
mod metadata;
mod moves;
mod parts;
mod proto;
mod recurrent;
#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests;
mod write;
mod write_memory;

pub(super) use chain::{Chain, Read};
pub(super) use graph::others;
pub use write::{write, write_network, write_single};

use super::foreign::{self, Known};
use crate::error::invalid;
use crate::{Front, Interface, Policy, PolicyError};
use gaitfit_model::shown;
use std::path::Path;

/// Reads a policy that [`write()`] wrote: the graph's network and the metadata's interface. The critic is not part
/// of an ONNX file. All numbers must be in `bytes`.
///
/// # Errors
/// A graph that is no multilayer perceptron, one without this program's metadata, or parts that do not fit.
pub fn read(bytes: &[u8]) -> Result<Policy, PolicyError> {
    read_own(bytes, None)?.ok_or_else(|| without_metadata("policy.onnx", bytes, None))
}

/// As [`read`]; `None` for a file without this program's metadata. `folder`: where the file lies.
pub(super) fn read_own(bytes: &[u8], folder: Option<&Path>) -> Result<Option<Policy>, PolicyError> {
    let model = graph::decode(bytes, folder)?;
    let Some(header) = metadata::read(&model)? else { return Ok(None) };
    let chain = graph::walk(&model)?;
    let Read { memory, network, clip } = chain.read(header.normaliser.as_ref())?;
    if clip.is_some() {
        return Err(invalid("its graph clips its outputs; describe it in a TOML file (docs/policies.md)"));
    }
    let policy = Policy {
        interface: header.interface,
        front: memory.map(Front::Recurrent),
        actor: network,
        log_std: header.log_std,
        critic: None,
        normaliser: header.normaliser,
        critic_memory: None,
        critic_normaliser: None,
        provenance: header.provenance,
        notes: Vec::new(),
    };
    policy.check()?;
    Ok(Some(policy))
}

/// Whether a file carries a checksum.
pub(super) fn is_sealed(bytes: &[u8]) -> bool {
    graph::decode(bytes, None).is_ok_and(|model| metadata::is_sealed(&model.metadata))
}

/// The interface in a file that [`write()`] wrote; `None` for other files and damaged ones.
pub(super) fn interface(bytes: &[u8]) -> Option<Interface> {
    metadata::read(&graph::decode(bytes, None).ok()?).ok()?.map(|header| header.interface)
}

/// What another program's metadata says; `None` where it is not known.
pub(super) fn foreign(bytes: &[u8], folder: Option<&Path>) -> Result<Option<Known>, PolicyError> {
    let model = graph::decode(bytes, folder)?;
    let chain = graph::walk(&model)?;
    match (chain.inputs(), chain.width()) {
        (Some(inputs), Some(outputs)) => foreign::mjlab(&metadata::all(&model)?, inputs, outputs),
        _ => Ok(None),
    }
}

/// What is missing in a file that says nothing of joints, gains and observation, with the description to write.
pub(super) fn without_metadata(name: &str, bytes: &[u8], folder: Option<&Path>) -> PolicyError {
    let sizes = graph::decode(bytes, folder).and_then(|model| graph::walk(&model));
    let (inputs, outputs) = match &sizes {
        Ok(chain) => (chain.inputs().unwrap_or(0), chain.width().unwrap_or(0)),
        Err(error) => return invalid(error.to_string()),
    };
    let name = shown(name);
    invalid(format!(
        "it has no metadata of gaitfit, mjlab or unitree_rl_lab, so joints, pose, gains, control period and observation \
         are unknown. Write them into a TOML file beside it and give that (docs/policies.md), for example:\n\n\
         file = \"{name}\"            # takes {inputs} numbers, gives {outputs} actions\n\
         joints = [\"…\"]              # {outputs} names, in the order of the actions\n\
         default_pose = [0.0]         # {outputs} angles, rad\n\
         action_scale = 0.25\n\
         kp = 25.0\n\
         kd = 0.5\n\
         control_dt = 0.02            # s\n\
         observation = [              # {inputs} numbers, in the network's order\n    \
         {{ quantity = \"base_angular_velocity\", scale = 0.25 }},\n    \
         {{ quantity = \"projected_gravity\" }},\n    \
         {{ quantity = \"command\" }},\n    \
         {{ quantity = \"joint_position\" }},\n    \
         {{ quantity = \"joint_velocity\", scale = 0.05 }},\n    \
         {{ quantity = \"last_action\" }},\n]"
    ))
}

/// The layers of any ONNX multilayer perceptron. `folder`: where the file lies.
pub(super) fn read_chain(bytes: &[u8], folder: &Path) -> Result<Chain, PolicyError> {
    graph::walk(&graph::decode(bytes, Some(folder))?)
}
