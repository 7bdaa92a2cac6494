//! A policy's networks as the kernels have them: one list of numbers, and tables of where each layer's numbers begin.

use gaitfit_policy::network::{Cell, Network, RecurrentLayer};
use gaitfit_policy::{Encoder, Front, Latent, Policy};

use super::Blocks;
use crate::words::{FUNCTIONS, Words, function, single};

/// A policy's networks in the kernels' order.
pub(crate) struct Networks {
    /// Weights, biases and layer norms, then factors and offsets of the normaliser.
    pub numbers: Vec<f32>,
    /// Number of the first normaliser's factor, if there is a normaliser.
    normaliser: Option<usize>,
    /// Table of dense layers: first the encoder's rows, then the actor's.
    layers: Vec<String>,
    /// Number of the first layer of the actor.
    actor: usize,
    /// Table of recurrent layers.
    recurrent: Vec<String>,
    /// Largest width of a layer's input or output, a multiple of 4.
    pub widest: usize,
    /// Numbers that a front keeps of each robot while it computes, a multiple of 4.
    pub kept: usize,
    /// Numbers that recurrent layers remember of each robot from step to step.
    pub remembered: usize,
}

/// Words for a policy that the kernels cannot run, for a message; `None` for one that they can.
pub(crate) fn unknown_policy(policy: &Policy) -> Option<&'static str> {
    match policy.front {
        Some(Front::Graph(_)) => Some("a policy that is a graph of operators"),
        Some(Front::Function(_)) => Some("a policy that is a function"),
        Some(Front::Recurrent(_) | Front::Encoder(_)) | None => None,
    }
}

impl Networks {
    /// The networks of a policy that is not [unknown](unknown_policy).
    pub fn new(policy: &Policy) -> Self {
        let mut networks = Self {
            numbers: Vec::new(),
            normaliser: None,
            layers: Vec::new(),
            actor: 0,
            recurrent: Vec::new(),
            widest: policy.front.as_ref().map_or(0, Front::inputs),
            kept: 0,
            remembered: 0,
        };
        match &policy.front {
            Some(Front::Recurrent(recurrent)) => {
                recurrent.layers.iter().for_each(|layer| networks.remember(recurrent.cell, layer));
            }
            Some(Front::Encoder(Encoder { network, passed, .. })) => {
                networks.dense(network);
                networks.kept = passed.len();
            }
            Some(Front::Graph(_) | Front::Function(_)) | None => {}
        }
        networks.actor = networks.layers.len();
        networks.dense(&policy.actor);
        networks.widest = networks.widest.next_multiple_of(4);
        networks.kept = networks.kept.next_multiple_of(4);
        if let Some(normaliser) = &policy.normaliser {
            networks.normaliser = Some(networks.numbers.len());
            let scale = normaliser.scale().into_iter().flat_map(|(factor, offset)| [factor, offset]);
            networks.numbers.extend(scale);
        }
        networks
    }

    /// Appends `numbers` at a multiple of four, and returns the place of the first one.
    fn put(&mut self, numbers: &[f32]) -> usize {
        let first = self.numbers.len();
        self.numbers.extend_from_slice(numbers);
        // Kernels read weights by four.
        self.numbers.resize(self.numbers.len().next_multiple_of(4), 0.0);
        first
    }

    /// Appends a matrix `inputs × outputs`, row-major. In the copy, weights of four inputs of an output lie together.
    fn put_matrix(&mut self, matrix: &[f32], outputs: usize) -> usize {
        let inputs = matrix.len() / outputs;
        let mut copy = vec![0.0; inputs.next_multiple_of(4) * outputs];
        for (number, &weight) in matrix.iter().enumerate() {
            let (input, output) = (number / outputs, number % outputs);
            copy[(input / 4 * outputs + output) * 4 + input % 4] = weight;
        }
        self.put(&copy)
    }

    fn dense(&mut self, network: &Network) {
        self.widest = self.widest.max(network.shape.widest()).max(network.shape.inputs);
        let layers = network.shape.layers();
        for (index, layer) in layers.iter().enumerate() {
            let weight = self.put_matrix(&network.parameters[layer.weight.clone()], layer.outputs);
            let bias = self.put(&network.parameters[layer.bias.clone()]);
            let hidden = index + 1 < layers.len();
            let taken = if hidden { Some(network.shape.activation) } else { network.output };
            let (name, alpha, lambda) = taken.map_or(("LINEAR", 0.0, 0.0), function);
            // A norm stands before a hidden layer's activation: ε, then the weights and biases.
            let norm = network.norms.get(index).and_then(Option::as_ref).filter(|_| hidden).map(|norm| {
                let epsilon = self.put(&[norm.epsilon]);
                self.put(&[&norm.weight[..], &norm.bias].concat());
                epsilon
            });
            let norm = norm.map_or("-1".to_owned(), |place| place.to_string());
            self.layers.push(format!(
                "{{{}, {}, {weight}, {bias}, {norm}, {name}, {}, {}}}",
                layer.inputs.div_ceil(4),
                layer.outputs,
                single(alpha),
                single(lambda)
            ));
        }
    }

    fn remember(&mut self, cell: Cell, layer: &RecurrentLayer) {
        let RecurrentLayer { inputs, hidden, .. } = *layer;
        self.widest = self.widest.max(inputs).max(hidden);
        self.kept = self.kept.max(hidden);
        let outputs = cell.gates() * hidden;
        let of_input = self.put_matrix(&layer.weight_ih, outputs);
        let of_output = self.put_matrix(&layer.weight_hh, outputs);
        let biases = [&layer.bias_ih, &layer.bias_hh].map(|bias| self.put(bias));
        self.recurrent.push(format!(
            "{{{}, {hidden}, {of_input}, {of_output}, {}, {}, {}}}",
            inputs.div_ceil(4),
            biases[0],
            biases[1],
            self.remembered
        ));
        self.remembered += cell.remembered() * hidden;
    }

    /// Bytes of shared memory of a block of `rows` robots: two buffers that layers take in turn, and what a front keeps.
    pub fn shared(&self, rows: usize) -> usize {
        size_of::<f32>() * (2 * self.widest + self.kept) * rows
    }

    /// The tables and sizes at the head of the kernels' text.
    pub fn write(&self, words: &mut Words, policy: &Policy, blocks: Blocks) {
        words.define("ROWS", blocks.rows);
        words.define("GROUP", blocks.group);
        words.define("WIDEST", self.widest);
        words.define("NORMALISED", usize::from(self.normaliser.is_some()));
        words.define("NORMALISER", self.normaliser.unwrap_or(0));
        words.text.push_str(&format!("enum {{ {} }};\n", FUNCTIONS.join(", ")));
        words.text.push_str(
            "// A dense layer: inputs by four; where its norm's numbers begin, -1 without one; its function with two parameters.\n\
             struct Layer {\n    int quads, outputs, weight, bias, norm, function;\n    float alpha, lambda;\n};\n",
        );
        words.define("LAYERS", self.layers.len());
        words.define("ACTOR", self.actor);
        words.table("Layer", "LAYER", self.layers.clone());
        let (passed, latent) = match &policy.front {
            Some(Front::Encoder(encoder)) => (&encoder.passed[..], encoder.latent),
            _ => (&[][..], Latent::Last),
        };
        let gates = policy.actor_memory().map_or(0, |memory| memory.cell.gates());
        for (name, value) in [
            ("ENCODED", usize::from(self.actor > 0)),
            ("PASSED", passed.len()),
            ("LATENT_FIRST", usize::from(latent == Latent::First)),
            ("ACTOR_INPUTS", policy.actor.shape.inputs),
            // LSTM units have four gates, GRU units three.
            ("GATES", gates),
            ("CELLS", self.recurrent.len()),
            ("POLICY_MEMORY", self.remembered),
        ] {
            words.define(name, value);
        }
        words.lookup("int", "PASSED_FROM", passed.iter().map(ToString::to_string).collect());
        words.text.push_str(
            "// A recurrent layer: inputs by four, units, places of its parts, and of what it remembers.\nstruct Cell {\n    \
             int quads, units, of_input, of_output, input_bias, output_bias, place;\n};\n",
        );
        words.table("Cell", "CELL", self.recurrent.clone());
    }
}
