//! Where a network's numbers lie in the GPU's shared memory and in the padded copy of its parameters.

use gaitfit_policy::network::Shape;

/// Columns of rows and of padded matrices are a multiple of this.
const ALIGN: usize = 32;
/// Layers that the kernels' tables have room for.
pub(super) const MOST_LAYERS: usize = 17;

/// Networks that do not fit into a multiprocessor's memory.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[error(
    "the network {network} needs {needed} bytes of a multiprocessor's memory for {rows} samples, this GPU has \
     {available}: make its layers narrower or fewer, or train on the CPU"
)]
pub struct TooWide {
    /// Its layers' widths.
    pub network: String,
    /// Bytes needed.
    pub needed: usize,
    /// Samples that are worked on together.
    pub rows: usize,
    /// Bytes there are.
    pub available: usize,
}

/// Layout of one network.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct NetLayout {
    /// Widths of input, hidden layers and output.
    pub widths: Vec<usize>,
    /// The same, padded.
    pub padded: Vec<usize>,
    /// Where each layer's rows begin in shared memory.
    pub places: Vec<usize>,
    /// Numbers of shared memory that the rows take.
    pub end: usize,
    /// Where each layer's matrix begins in the padded copy.
    pub weights: Vec<usize>,
    /// Where each layer's bias begins.
    pub biases: Vec<usize>,
    /// Numbers of the padded copy.
    pub packed: usize,
    /// Where each parameter lies in the padded copy.
    pub map: Vec<u32>,
    /// Multiplications of a sample's way forth and back, for the share of multiprocessors.
    pub work: usize,
}

impl NetLayout {
    /// For tiles of `rows` samples.
    pub(super) fn new(shape: &Shape, rows: usize) -> Self {
        let layers = shape.layers();
        let widths: Vec<usize> =
            [shape.inputs].into_iter().chain(layers.iter().map(|layer| layer.outputs)).collect();
        let padded: Vec<usize> = widths.iter().map(|width| width.next_multiple_of(ALIGN)).collect();
        let (mut places, mut end) = (Vec::new(), 0);
        for width in &padded {
            places.push(end);
            end += rows * width;
        }
        let (mut weights, mut biases, mut packed, mut work) = (Vec::new(), Vec::new(), 0, 0);
        let mut map = vec![0; shape.parameters()];
        for (index, layer) in layers.iter().enumerate() {
            let (inputs, outputs) = (padded[index], padded[index + 1]);
            weights.push(packed);
            biases.push(packed + inputs * outputs);
            for (number, parameter) in layer.weight.clone().enumerate() {
                let (row, column) = (number / layer.outputs, number % layer.outputs);
                map[parameter] = (packed + row * outputs + column) as u32;
            }
            for (column, parameter) in layer.bias.clone().enumerate() {
                map[parameter] = (packed + inputs * outputs + column) as u32;
            }
            packed += (inputs + 1) * outputs;
            work += inputs * outputs * if index == 0 { 2 } else { 3 };
        }
        Self { widths, padded, places, end, weights, biases, packed, map, work }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaitfit_policy::network::Activation;

    #[test]
    fn every_parameter_has_its_own_place() {
        let shape = Shape { inputs: 5, hidden: vec![33, 7], outputs: 2, activation: Activation::Elu };
        let layout = NetLayout::new(&shape, 32);
        assert_eq!(layout.padded, [32, 64, 32, 32]);
        assert_eq!(layout.end, 32 * (32 + 64 + 32 + 32));
        assert_eq!(layout.packed, 33 * 64 + 65 * 32 + 33 * 32);
        let mut seen = layout.map.clone();
        seen.sort_unstable();
        seen.dedup();
        assert_eq!(seen.len(), shape.parameters());
        // Row 1, column 2 of the second matrix.
        let parameter = shape.layers()[1].weight.start + 7 + 2;
        assert_eq!(layout.map[parameter] as usize, layout.weights[1] + 32 + 2);
        assert!(layout.map.iter().all(|&place| (place as usize) < layout.packed));
    }
}
