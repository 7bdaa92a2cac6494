//! What stands between a policy's observation and its actor: a memory, an encoder, a graph, or a function of the caller's.

use crate::network::{Memory, Network, Recurrent, Scratch};
use crate::{Function, Graph};
use serde::{Deserialize, Serialize};

/// What stands between the (normalised) observation and the actor. Trainings refuse all but recurrent layers.
#[derive(Clone, Debug, PartialEq)]
pub enum Front {
    /// The actor sees the output of recurrent layers, which see the observation.
    Recurrent(Recurrent),
    /// The actor sees the observation, or its present frame, and what an encoder makes of the whole observation: two-part
    /// policies such as RMA (Kumar et al. 2021) and walk-these-ways (Margolis, Agrawal 2022).
    Encoder(Encoder),
    /// A function of the caller's acts; the actor passes its actions on.
    Function(Function),
    /// A graph of operators acts; the actor passes its actions on.
    Graph(Graph),
}

/// The encoder of a two-part policy.
#[derive(Clone, Debug, PartialEq)]
pub struct Encoder {
    /// From the whole observation to the latent.
    pub network: Network,
    /// Which numbers of the observation the actor sees too, in their order.
    pub passed: Vec<usize>,
    /// Where the latent stands in the actor's input.
    pub latent: Latent,
}

/// Where the latent stands in the actor's input.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum Latent {
    /// Behind what is passed on of the observation.
    #[default]
    Last,
    /// Before it.
    First,
}

impl Front {
    /// Its name in messages.
    pub(crate) fn name(&self) -> &'static str {
        match self {
            Self::Recurrent(_) => "memory",
            Self::Encoder(_) => "encoder",
            Self::Function(_) => "function",
            Self::Graph(_) => "graph",
        }
    }

    /// Width of the observation that it takes.
    pub fn inputs(&self) -> usize {
        match self {
            Self::Recurrent(recurrent) => recurrent.inputs(),
            Self::Encoder(encoder) => encoder.network.shape.inputs,
            Self::Function(function) => function.inputs(),
            Self::Graph(graph) => graph.inputs(),
        }
    }

    /// Width of what it gives the actor.
    pub fn outputs(&self) -> usize {
        match self {
            Self::Recurrent(recurrent) => recurrent.outputs(),
            Self::Encoder(encoder) => encoder.passed.len() + encoder.network.shape.outputs,
            Self::Function(function) => function.outputs(),
            Self::Graph(graph) => graph.outputs(),
        }
    }

    /// Nothing remembered, for `environments` robots.
    pub fn memory(&self, environments: usize) -> Memory {
        match self {
            Self::Recurrent(recurrent) => recurrent.memory(environments),
            Self::Graph(graph) => graph.memory(environments),
            Self::Encoder(_) | Self::Function(_) => Memory::default(),
        }
    }

    /// Computes the actor's input: `observation` is `rows × inputs`, `seen` becomes `rows × outputs`.
    pub(crate) fn step(
        &self,
        rows: usize,
        observation: &[f32],
        memory: &mut Memory,
        seen: &mut Vec<f32>,
        scratch: &mut Scratch,
    ) {
        match self {
            Self::Recurrent(recurrent) => recurrent.step(rows, observation, memory, seen),
            Self::Function(function) => function.act(rows, observation, seen),
            Self::Graph(graph) => graph.act(rows, observation, memory, seen, scratch),
            Self::Encoder(Encoder { network, passed, latent }) => {
                let (inputs, outputs) = (network.shape.inputs, network.shape.outputs);
                // A buffer of its own: in `seen` the latent's rows are not one behind the other, passed numbers stand
                // between.
                let mut code = vec![0.0; rows * outputs];
                network.forward(rows, observation, &mut code, scratch);
                seen.clear();
                for (row, code) in observation.chunks_exact(inputs).zip(code.chunks_exact(outputs)) {
                    if *latent == Latent::First {
                        seen.extend_from_slice(code);
                    }
                    seen.extend(passed.iter().map(|&place| row[place]));
                    if *latent == Latent::Last {
                        seen.extend_from_slice(code);
                    }
                }
            }
        }
    }
}
