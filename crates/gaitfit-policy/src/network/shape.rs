//! Layer sizes of a multilayer perceptron, and where each layer lies in one flat vector of parameters.

use std::ops::Range;

use serde::{Deserialize, Serialize};

use super::Activation;

/// Max number of parameters of one network.
pub const MAX_PARAMETERS: usize = 16 << 20;

/// Sizes of a fully connected network: inputs, hidden layers, outputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Shape {
    /// Width of the input row.
    pub inputs: usize,
    /// Widths of the hidden layers, in order; empty for a linear map.
    pub hidden: Vec<usize>,
    /// Width of the output row.
    pub outputs: usize,
    /// Function after every hidden layer.
    pub activation: Activation,
}

/// One layer y = x W + b of a network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Layer {
    /// Width of x.
    pub inputs: usize,
    /// Width of y.
    pub outputs: usize,
    /// Where W lies in the flat parameters: `inputs × outputs`, row-major.
    pub weight: Range<usize>,
    /// Where b lies: `outputs`.
    pub bias: Range<usize>,
}

/// Reasons why a network is impossible.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum ShapeError {
    /// A layer without numbers.
    #[error("the network's {0} has width 0: give it at least one number")]
    EmptyLayer(String),
    /// Parameters of another network.
    #[error("a network of {shape} has {expected} parameters, {found} were given")]
    Parameters {
        /// The layers' widths, "45-128-12".
        shape: String,
        /// Parameters that the shape needs.
        expected: usize,
        /// Parameters that were given.
        found: usize,
    },
    /// A layer norm of another width, or without a positive ε.
    #[error(
        "the layer norm of hidden layer {layer} has {found} numbers and the layer {expected}: as many weights and biases \
         and a positive epsilon are needed"
    )]
    Norm {
        /// Number of the hidden layer, from 1.
        layer: usize,
        /// Its width.
        expected: usize,
        /// The norm's.
        found: usize,
    },
}

impl Shape {
    /// Number of parameters: Σ inputs × outputs + outputs over the layers.
    pub fn parameters(&self) -> usize {
        // The parts lie without gaps, so the end of the last bias is the count.
        self.layers().last().map_or(0, |layer| layer.bias.end)
    }

    /// The layers in order, one after the other in the flat parameters, weight before bias.
    pub fn layers(&self) -> Vec<Layer> {
        let mut start = 0;
        let mut inputs = self.inputs;
        let widths = self.hidden.iter().copied().chain([self.outputs]);
        widths
            .map(|outputs| {
                let weight = start..start + inputs * outputs;
                let bias = weight.end..weight.end + outputs;
                start = bias.end;
                let layer = Layer { inputs, outputs, weight, bias };
                inputs = outputs;
                layer
            })
            .collect()
    }

    /// Greatest width of a layer's output.
    pub fn widest(&self) -> usize {
        self.hidden.iter().copied().fold(self.outputs, usize::max)
    }

    /// Refuses a layer of width 0.
    ///
    /// # Errors
    /// [`ShapeError::EmptyLayer`], naming the layer.
    pub fn check(&self) -> Result<(), ShapeError> {
        let hidden =
            self.hidden.iter().enumerate().map(|(i, &width)| (format!("hidden layer {}", i + 1), width));
        // The order is from front to back, so that the first empty layer is named.
        let all = [("input".to_owned(), self.inputs)].into_iter().chain(hidden);
        for (name, width) in all.chain([("output".to_owned(), self.outputs)]) {
            if width == 0 {
                return Err(ShapeError::EmptyLayer(name));
            }
        }
        Ok(())
    }
}

impl std::fmt::Display for Shape {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.inputs)?;
        for width in self.hidden.iter().chain([&self.outputs]) {
            write!(f, "-{width}")?;
        }
        Ok(())
    }
}
