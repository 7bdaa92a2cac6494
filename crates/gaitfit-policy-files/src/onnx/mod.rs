//! Policies as ONNX graphs, out and in.
//!
//! Multilayer perceptrons are read as such, alone or behind recurrent layers; other graphs become steps that run node by node
//! ([`gaitfit_policy::Graph`]). Whatever is neither is refused by node and operator.

mod attributes;
mod bounds;
mod chain;
mod constant;
mod decoded;
mod external;
mod fuse;
mod graph;
mod linear;
mod metadata;
mod missing;
mod moves;
mod node_error;
mod parts;
mod program;
mod proto;
mod recurrent;
#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests;
mod write;
mod write_memory;
mod write_parts;

pub(super) use chain::{Chain, Read};
pub(super) use graph::others;
pub(super) use missing::without_metadata;
pub use write::{write, write_network, write_single};

use super::foreign::{self, Known};
use gaitfit_policy::graph::Plan;
use gaitfit_policy::{Front, Graph, Inputs, Interface, Policy, PolicyError, invalid};
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
    // This program writes no Clip, so another program changed the graph behind the metadata.
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

/// Reads another program's metadata; `None` if it is not known.
pub(super) fn foreign(bytes: &[u8], folder: Option<&Path>) -> Result<Option<Known>, PolicyError> {
    let model = graph::decode(bytes, folder)?;
    match widths(&model) {
        Ok(Some([inputs, outputs])) => foreign::mjlab(&metadata::all(&model)?, inputs, outputs),
        Ok(None) => Ok(None),
        Err(error) => Err(error),
    }
}

/// Numbers of the observation and of the action: of the layers, or as a graph of other operators states them.
fn widths(model: &decoded::Decoded) -> Result<Option<[usize; 2]>, PolicyError> {
    match graph::walk(model) {
        Ok(chain) => Ok(chain.inputs().zip(chain.width()).map(|(inputs, outputs)| [inputs, outputs])),
        // The error of the walk names a node. It is the better one if the graph's ends state no widths either.
        Err(error) => program::stated(model)?.map(Some).ok_or(error),
    }
}

/// A graph of another program, as read.
pub(super) enum Found {
    /// A plain perceptron, maybe behind recurrent layers.
    Layers(Read),
    /// Anything else, with notes on what was assumed.
    Graph(Graph, Vec<String>),
}

/// Reads the graph of another program behind `interface`. `inputs`, `output`: what a description says of them.
pub(super) fn read_graph(
    bytes: &[u8],
    folder: &Path,
    interface: &Interface,
    inputs: &Inputs,
    output: Option<&str>,
) -> Result<Found, PolicyError> {
    let model = graph::decode(bytes, Some(folder))?;
    // A description that names inputs or an output means a graph: a perceptron has one of each.
    if inputs.is_empty() && output.is_none() {
        match graph::walk(&model).and_then(|chain| chain.read(None)) {
            Ok(read) => return Ok(Found::Layers(read)),
            // No layers at all: the walk's own words are the clearer ones.
            Err(error) if model.nodes.is_empty() => return Err(error),
            Err(_) => {}
        }
    }
    let source = graph::inlined(bytes, Some(folder))?;
    let (graph, mut notes) = program::compile(&model, interface, inputs, output, source)?;
    notes.insert(0, format!("its graph is run node by node: {}", graph.describe()));
    Ok(Found::Graph(graph, notes))
}

/// The graph of one that was read before, from its own model, behind another interface too.
pub(super) fn graph_again(
    source: &[u8],
    interface: &Interface,
    inputs: &Inputs,
    output: &str,
) -> Result<Graph, PolicyError> {
    let model = graph::decode(source, None)?;
    Ok(program::compile(&model, interface, inputs, Some(output), source.to_vec())?.0)
}

/// The graph of a policy behind another interface.
///
/// # Errors
/// One that does not give its inputs what they take.
pub(super) fn graph_behind(graph: &Graph, interface: &Interface) -> Result<Graph, PolicyError> {
    let Plan { source, inputs, output, .. } = graph.plan();
    graph_again(source, interface, inputs, output)
}

/// The layers of any ONNX multilayer perceptron. `folder`: where the file lies.
pub(super) fn read_chain(bytes: &[u8], folder: &Path) -> Result<Chain, PolicyError> {
    graph::walk(&graph::decode(bytes, Some(folder))?)
}
