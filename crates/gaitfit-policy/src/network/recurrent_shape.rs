//! Sizes of recurrent layers, and where each part lies in one flat vector of parameters.

use std::ops::Range;

use super::Cell;

/// Sizes of recurrent layers of one kind, one behind the other.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecurrentShape {
    /// Kind of all layers.
    pub cell: Cell,
    /// Width of the input.
    pub inputs: usize,
    /// Units of every layer; at least one layer.
    pub hidden: Vec<usize>,
}

/// One part of a layer: its name in PyTorch, such as `weight_ih_l0`, and where it lies in the flat vector.
pub type Part = (String, Range<usize>);

/// One layer.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct RecurrentSpan {
    /// Width of its input.
    pub inputs: usize,
    /// Units.
    pub hidden: usize,
    /// Where its parts lie: input weights (`inputs × gates · hidden`, row-major), output weights
    /// (`hidden × gates · hidden`, row-major), bias of the input's product, bias of the output's (`gates · hidden`).
    pub parts: [Range<usize>; 4],
}

impl RecurrentShape {
    /// The layers in order.
    pub fn layers(&self) -> Vec<RecurrentSpan> {
        let (mut start, mut inputs) = (0, self.inputs);
        let layers = self.hidden.iter().map(|&hidden| {
            let wide = self.cell.gates() * hidden;
            let parts = [inputs * wide, hidden * wide, wide, wide].map(|size| {
                start += size;
                start - size..start
            });
            let layer = RecurrentSpan { inputs, hidden, parts };
            inputs = hidden;
            layer
        });
        layers.collect()
    }

    /// The parts in order, one behind the other without gaps.
    pub fn parts(&self) -> Vec<Part> {
        let names = ["weight_ih", "weight_hh", "bias_ih", "bias_hh"];
        let layers = self.layers().into_iter().enumerate();
        layers
            .flat_map(|(number, layer)| {
                names
                    .into_iter()
                    .zip(layer.parts)
                    .map(move |(name, range)| (format!("{name}_l{number}"), range))
            })
            .collect()
    }

    /// Number of parameters.
    pub fn parameters(&self) -> usize {
        // The parts lie without gaps, so the end of the last one is the count.
        self.layers().last().map_or(0, |layer| layer.parts[3].end)
    }

    /// Width of the output; without layers that of the input.
    pub fn outputs(&self) -> usize {
        self.hidden.last().copied().unwrap_or(self.inputs)
    }

    /// Numbers that are remembered of one environment.
    pub fn remembered(&self) -> usize {
        self.cell.remembered() * self.hidden.iter().sum::<usize>()
    }
}
