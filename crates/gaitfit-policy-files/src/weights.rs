//! The project's own policy file: safetensors, with the rest of the policy as JSON in its metadata.
//!
//! | tensor | type, shape |
//! | --- | --- |
//! | `actor.0.weight`, `actor.2.weight`, … | F32 `outputs × inputs`, as PyTorch's `nn.Sequential` stores them |
//! | `actor.0.bias`, … | F32 `outputs` |
//! | `critic.0.weight`, … | the same, where there is a critic |
//! | `memory.weight_ih_l0`, … | F32, as PyTorch's `nn.LSTM` and `nn.GRU` store them, where there are recurrent layers; `critic_memory.…` likewise |
//! | `log_std` | F32 `joints` |
//! | `graph` | U8: an ONNX model, where the policy is a graph of operators; `actor` then passes its actions on |
//! | `normaliser.mean`, `.variance`, `.count` | F64 `width`, `width`, 1; `critic_normaliser.…` likewise |
//!
//! The metadata has one entry, `gaitfit`: a JSON object with the file's checksum, format version, interface, activation,
//! provenance. Files of earlier versions have no checksum, and are read.

use super::layers::{take_apart, transpose};
use super::tensors::Tensors;
use super::{checksum, onnx};
use gaitfit_policy::graph::Plan;
use gaitfit_policy::invalid;
use gaitfit_policy::network::{Activation, Cell, LayerNorm, Network, Normaliser};
use gaitfit_policy::{Encoder, Front, Inputs, Interface, Latent, Policy, PolicyError, Provenance};
use safetensors::tensor::{Dtype, TensorView, serialize};
use serde::{Deserialize, Serialize};
use std::collections::HashMap;

/// Version of the layout; a reader refuses every other.
const FORMAT: u32 = 1;
/// Where the metadata keeps the header.
const KEY: &str = "gaitfit";
/// The tensor with the model of a policy that is a graph.
const GRAPH: &str = "graph";
/// Bytes before the digits of the checksum: the metadata's key and the beginning of its JSON, as JSON text.
const BEFORE: &[u8] = br#""gaitfit":"{\"sha256\":\""#;

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    /// First, where [`checksum`] looks for it.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    sha256: Option<String>,
    format: u32,
    interface: Interface,
    activation: Activation,
    #[serde(default, skip_serializing_if = "Option::is_none")]
    critic_activation: Option<Activation>,
    /// Function of the actor's output.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    output_activation: Option<Activation>,
    /// What stands before the actor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    front: Option<FrontHeader>,
    /// Kind of the recurrent layers before the critic.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    critic_memory: Option<Cell>,
    /// ε of all layer norms.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    layer_norm_epsilon: Option<f32>,
    provenance: Provenance,
}

/// Parts of a front that are not in its tensors, `memory.…` or `encoder.…`.
#[derive(Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
enum FrontHeader {
    Memory(Cell),
    /// The model's file is the tensor `graph`.
    Graph {
        inputs: Inputs,
        output: String,
    },
    Encoder {
        activation: Activation,
        #[serde(default, skip_serializing_if = "Option::is_none")]
        output_activation: Option<Activation>,
        passed: Vec<usize>,
        latent: Latent,
    },
}

/// The bytes of a policy's file. The same policy gives the same bytes, and [`read`] gives the same policy, bit for
/// bit. The file carries a checksum, so that damage to any bit of it is an error when it is read.
///
/// # Errors
/// A policy whose parts do not fit ([`Policy::check`]).
pub fn write(policy: &Policy) -> Result<Vec<u8>, PolicyError> {
    let mut bytes = written(policy, Some(checksum::blank()))?;
    if !checksum::seal(&mut bytes, BEFORE) {
        return Err(invalid("its metadata has no place for the checksum"));
    }
    Ok(bytes)
}

/// Returns the same file without a checksum, as earlier versions wrote it.
///
/// # Errors
/// As [`write()`].
pub fn plain(policy: &Policy) -> Result<Vec<u8>, PolicyError> {
    written(policy, None)
}

/// A tensor's name, shape, type and bytes.
type NamedTensor = (String, Vec<usize>, Dtype, Vec<u8>);

fn put_network(tensors: &mut Vec<NamedTensor>, prefix: &str, network: &Network) {
    let mut number = 0;
    for (index, layer) in take_apart(network).iter().enumerate() {
        let shape = vec![layer.outputs, layer.inputs];
        tensors.push((format!("{prefix}.{number}.weight"), shape, Dtype::F32, single(&layer.transposed())));
        tensors.push((
            format!("{prefix}.{number}.bias"),
            vec![layer.outputs],
            Dtype::F32,
            single(&layer.bias),
        ));
        if let Some(norm) = network.norms.get(index).and_then(Option::as_ref) {
            number += 1;
            for (part, values) in [("weight", &norm.weight), ("bias", &norm.bias)] {
                let name = format!("{prefix}.{number}.{part}");
                tensors.push((name, vec![values.len()], Dtype::F32, single(values)));
            }
        }
        // nn.Sequential counts the activations too.
        number += 2;
    }
}

fn put_memories(tensors: &mut Vec<NamedTensor>, policy: &Policy) {
    let memories = [("memory", policy.actor_memory()), ("critic_memory", policy.critic_memory.as_ref())];
    for (prefix, recurrent) in memories {
        for (number, layer) in recurrent.iter().flat_map(|recurrent| recurrent.layers.iter().enumerate()) {
            let wide = layer.bias_ih.len();
            for (part, inputs, values) in
                [("weight_ih", layer.inputs, &layer.weight_ih), ("weight_hh", layer.hidden, &layer.weight_hh)]
            {
                // In PyTorch's order: outputs × inputs.
                let values = single(&transpose(values, inputs, wide));
                tensors.push((format!("{prefix}.{part}_l{number}"), vec![wide, inputs], Dtype::F32, values));
            }
            for (part, values) in [("bias_ih", &layer.bias_ih), ("bias_hh", &layer.bias_hh)] {
                tensors.push((format!("{prefix}.{part}_l{number}"), vec![wide], Dtype::F32, single(values)));
            }
        }
    }
}

fn written(policy: &Policy, sha256: Option<String>) -> Result<Vec<u8>, PolicyError> {
    policy.check()?;
    // A function lives in this process only and has no form in a file.
    policy.refuse_function("a policy's file")?;
    let mut tensors: Vec<NamedTensor> = Vec::new();
    let mut network = |prefix: &str, network: &Network| put_network(&mut tensors, prefix, network);
    network("actor", &policy.actor);
    if let Some(critic) = &policy.critic {
        network("critic", critic);
    }
    let mut graph_file = None;
    let front = match &policy.front {
        Some(Front::Recurrent(recurrent)) => Some(FrontHeader::Memory(recurrent.cell)),
        Some(Front::Encoder(Encoder { network: encoder, passed, latent })) => {
            network("encoder", encoder);
            Some(FrontHeader::Encoder {
                activation: encoder.shape.activation,
                output_activation: encoder.output,
                passed: passed.clone(),
                latent: *latent,
            })
        }
        Some(Front::Graph(graph)) => {
            let Plan { source, inputs, output, .. } = graph.plan();
            graph_file = Some(source);
            Some(FrontHeader::Graph { inputs: inputs.clone(), output: output.clone() })
        }
        Some(Front::Function(_)) | None => None,
    };
    if let Some(source) = graph_file {
        tensors.push((GRAPH.to_owned(), vec![source.len()], Dtype::U8, source.clone()));
    }
    put_memories(&mut tensors, policy);
    tensors.push(("log_std".into(), vec![policy.log_std.len()], Dtype::F32, single(&policy.log_std)));
    // In double precision, as the policy holds them: the file must give back the same policy.
    for (name, normaliser) in
        [("normaliser", &policy.normaliser), ("critic_normaliser", &policy.critic_normaliser)]
    {
        let Some(normaliser) = normaliser else { continue };
        let count = [normaliser.count];
        let parts: [(&str, &[f64]); 3] =
            [("mean", &normaliser.mean), ("variance", &normaliser.variance), ("count", &count)];
        for (part, values) in parts {
            tensors.push((format!("{name}.{part}"), vec![values.len()], Dtype::F64, double(values)));
        }
    }
    let header = Header {
        sha256,
        format: FORMAT,
        interface: policy.interface.clone(),
        activation: policy.actor.shape.activation,
        critic_activation: policy.critic.as_ref().map(|critic| critic.shape.activation),
        output_activation: policy.actor.output,
        front,
        critic_memory: policy.critic_memory.as_ref().map(|memory| memory.cell),
        layer_norm_epsilon: epsilon(policy)?,
        provenance: policy.provenance.clone(),
    };
    let header = serde_json::to_string(&header).map_err(|error| invalid(error.to_string()))?;
    // Views borrow the bytes, so that the weights are not copied a second time.
    let views = tensors.iter().map(|(name, shape, dtype, bytes)| {
        TensorView::new(*dtype, shape.clone(), bytes).map(|view| (name.as_str(), view))
    });
    let views: Vec<_> = views.collect::<Result<_, _>>().map_err(|error| invalid(error.to_string()))?;
    // With one entry the order of a map does not matter, so equal policies give equal bytes.
    serialize(views, Some(HashMap::from([(KEY.to_owned(), header)])))
        .map_err(|error| invalid(error.to_string()))
}

/// ε of a policy's layer norms; `None` without any.
fn epsilon(policy: &Policy) -> Result<Option<f32>, PolicyError> {
    let encoder = match &policy.front {
        Some(Front::Encoder(encoder)) => Some(&encoder.network),
        _ => None,
    };
    let networks = [Some(&policy.actor), policy.critic.as_ref(), encoder];
    let mut all = networks.into_iter().flatten().flat_map(|network| network.norms.iter().flatten());
    let first = all.next().map(|norm| norm.epsilon);
    // The header has one ε for all networks of the policy.
    if all.any(|norm| Some(norm.epsilon) != first) {
        return Err(invalid("its layer norms have different epsilons, which this format cannot say"));
    }
    // The header has output functions of the actor and of the encoder, but none of the critic.
    if policy.critic.as_ref().is_some_and(|critic| critic.output.is_some()) {
        return Err(invalid("its critic has a function of its output, which this format cannot say"));
    }
    Ok(first)
}

/// Reads a policy from its file's bytes.
///
/// # Errors
/// A file that is cut short, damaged in any bit, of another program or version, with tensors missing, unknown or of wrong
/// shape, or whose parts do not fit each other.
pub fn read(bytes: &[u8]) -> Result<Policy, PolicyError> {
    let mut tensors = Tensors::parse(bytes)?;
    let header = header(bytes)?;
    // `write` leaves ε out where no network has a layer norm, and then this value is not used.
    let epsilon = header.layer_norm_epsilon.unwrap_or(LayerNorm::EPSILON);
    let mut actor = tensors.network("actor", header.activation, epsilon)?;
    actor.output = header.output_activation;
    let front = match header.front {
        None => None,
        Some(FrontHeader::Memory(cell)) => Some(Front::Recurrent(tensors.recurrent("memory", cell)?)),
        Some(FrontHeader::Encoder { activation, output_activation, passed, latent }) => {
            let mut network = tensors.network("encoder", activation, epsilon)?;
            network.output = output_activation;
            Some(Front::Encoder(Encoder { network, passed, latent }))
        }
        Some(FrontHeader::Graph { inputs, output }) => {
            // The graph's inputs are looked up in the interface, which comes from a file and may be wrong.
            header.interface.check()?;
            let graph = onnx::graph_again(tensors.bytes(GRAPH)?, &header.interface, &inputs, &output)?;
            Some(Front::Graph(graph))
        }
    };
    let critic = header
        .critic_activation
        .map(|activation| tensors.network("critic", activation, epsilon))
        .transpose()?;
    let critic_memory =
        header.critic_memory.map(|cell| tensors.recurrent("critic_memory", cell)).transpose()?;
    let log_std = tensors.vector("log_std")?.into_iter().map(|value| value as f32).collect();
    let normaliser = normaliser(&mut tensors, "normaliser")?;
    let critic_normaliser = self::normaliser(&mut tensors, "critic_normaliser")?;
    // A tensor that nobody reads would be lost without a sign, and a part of the policy with it.
    if let Some(name) = tensors.unused() {
        return Err(invalid(format!("tensor {name} is none of a policy's; export the policy again")));
    }
    let Header { interface, provenance, .. } = header;
    // A file of this program leaves nothing to assume.
    let notes = Vec::new();
    let policy = Policy {
        interface,
        front,
        actor,
        log_std,
        critic,
        critic_memory,
        normaliser,
        critic_normaliser,
        provenance,
        notes,
    };
    policy.check()?;
    Ok(policy)
}

/// Whether a file carries a checksum.
pub(super) fn is_sealed(bytes: &[u8]) -> bool {
    let Ok((_, metadata)) = safetensors::SafeTensors::read_metadata(bytes) else { return false };
    let entry = metadata.metadata().as_ref().and_then(|entries| entries.get(KEY));
    entry.is_some_and(|text| checksum::Sealed::is(text))
}

/// Refuses a file with a checksum whose bytes are not those that [`write`] sealed.
///
/// # Errors
/// As it says.
pub(super) fn check(bytes: &[u8]) -> Result<(), PolicyError> {
    // Files of other programs and of earlier versions have no checksum, so there is nothing to compare.
    if is_sealed(bytes) && !checksum::intact(bytes, BEFORE) { Err(checksum::damaged()) } else { Ok(()) }
}

/// The interface in a file that [`write`] wrote; `None` for other files and damaged ones.
pub(super) fn interface(bytes: &[u8]) -> Option<Interface> {
    header(bytes).ok().map(|header| header.interface)
}

fn header(bytes: &[u8]) -> Result<Header, PolicyError> {
    let (_, metadata) =
        safetensors::SafeTensors::read_metadata(bytes).map_err(|error| invalid(error.to_string()))?;
    let text = metadata.metadata().as_ref().and_then(|entries| entries.get(KEY)).ok_or_else(|| {
        invalid(
            "its metadata has no `gaitfit` entry, so it was not written by this program; describe it in a TOML \
             file and give that (docs/policies.md)",
        )
    })?;
    // The format first: a header of another format may have fields that the present one refuses.
    #[derive(Deserialize)]
    struct Version {
        format: u32,
    }
    let damaged = |error: serde_json::Error| invalid(format!("its `gaitfit` metadata is damaged: {error}"));
    let version: Version = serde_json::from_str(text).map_err(damaged)?;
    if version.format != FORMAT {
        return Err(invalid(format!(
            "it has format {}, this program reads format {FORMAT}; use the program that wrote it",
            version.format
        )));
    }
    serde_json::from_str(text).map_err(damaged)
}

fn normaliser(tensors: &mut Tensors<'_>, name: &str) -> Result<Option<Normaliser>, PolicyError> {
    if !tensors.has(&format!("{name}.mean")) {
        return Ok(None);
    }
    let mean = tensors.vector(&format!("{name}.mean"))?;
    let variance = tensors.vector(&format!("{name}.variance"))?;
    let count = tensors.vector(&format!("{name}.count"))?;
    match count[..] {
        [count] => Ok(Some(Normaliser { mean, variance, count })),
        _ => Err(invalid(format!("tensor {name}.count has {} numbers; it is one", count.len()))),
    }
}

fn single(values: &[f32]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}

fn double(values: &[f64]) -> Vec<u8> {
    values.iter().flat_map(|value| value.to_le_bytes()).collect()
}
