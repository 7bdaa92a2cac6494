//! Policies as ONNX graphs, out and in.
//!
//! Only multilayer perceptrons are read; everything else is refused by node and operator.

mod chain;
mod constant;
mod graph;
mod metadata;
mod proto;
#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests;
mod write;

pub(super) use chain::Chain;
pub use write::write;

use crate::error::invalid;
use crate::{Policy, PolicyError};

/// Reads a policy that [`write()`] wrote: the graph's network and the metadata's interface. The critic is not part
/// of an ONNX file.
///
/// # Errors
/// A graph that is no multilayer perceptron, one without this program's metadata, or parts that do not fit.
pub fn read(bytes: &[u8]) -> Result<Policy, PolicyError> {
    let model = graph::decode(bytes)?;
    let header = metadata::read(&model)?.ok_or_else(|| {
        invalid(
            "it has no `gaitfit` metadata, so joints, gains and observation are unknown; describe them in a TOML \
             file beside it and give that (docs/policies.md)",
        )
    })?;
    let chain = graph::walk(&model)?;
    let policy = Policy {
        interface: header.interface,
        actor: chain.network(header.normaliser.as_ref())?,
        log_std: header.log_std,
        critic: None,
        normaliser: header.normaliser,
        critic_normaliser: None,
        provenance: header.provenance,
    };
    policy.check()?;
    Ok(policy)
}

/// The layers of any ONNX multilayer perceptron.
pub(super) fn read_chain(bytes: &[u8]) -> Result<Chain, PolicyError> {
    graph::walk(&graph::decode(bytes)?)
}
