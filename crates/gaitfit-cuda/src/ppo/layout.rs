//! Where a network's numbers lie in the GPU's shared memory and in the padded copy of its parameters.

use gaitfit_policy::network::Shape;

use gaitfit_learn::ppo::Precision;

/// Layers that the kernels' tables have room for.
pub(super) const MAX_LAYERS: usize = 17;

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
    /// The widths, padded to what the matrix units take at a time.
    pub padded: Vec<usize>,
    /// How far apart a layer's rows lie in shared memory, numbers.
    pub apart: Vec<usize>,
    /// Where each layer's rows begin in shared memory, numbers of a sample.
    pub places: Vec<usize>,
    /// Numbers of shared memory that a sample takes.
    pub end: usize,
    /// Bytes of shared memory that a sample takes, with what the network gives.
    pub bytes: usize,
    /// Derivatives of a sample that hidden layers keep in the GPU's memory for the way back, numbers, as the layers'
    /// rows lie in shared memory; 0 where the derivatives follow from the layers' outputs.
    pub kept: usize,
    /// Numbers in a word.
    pub per_word: usize,
    /// Where each layer's matrix for the way forth begins in the copies, words.
    pub weights: Vec<usize>,
    /// Where each layer's bias begins in the copies.
    pub biases: Vec<usize>,
    /// Where each layer's matrix for the way back begins in the copies.
    pub backs: Vec<usize>,
    /// Words of the copies.
    pub packed: usize,
    /// Where each layer's gradient begins in a block's part, of the matrix and of the bias.
    pub gradients: [Vec<usize>; 2],
    /// Numbers of a block's part.
    pub gradient: usize,
    /// Where each parameter's derivative lies in a block's part.
    pub map: Vec<u32>,
    /// Where each parameter lies in the copies for the way forth: numbers of a matrix's kind, or the word of a bias.
    pub forth: Vec<u32>,
    /// Where it lies for the way back; `u32::MAX` for a bias.
    pub back: Vec<u32>,
    /// Multiplications of a sample's way forth and back, for the share of multiprocessors.
    pub work: usize,
}

/// Where an element of a matrix with so many columns lies.
type Place = fn(usize, usize, usize) -> usize;

/// Place of element (k, n) of a factor of the matrix units with `columns` columns (PTX, mma.m16n8k8, B): 8 × 32 at a
/// time, of which thread 4 g + t holds rows t and t + 4 of columns g, g + 8, g + 16, g + 24, in two parts of four.
fn factor(k: usize, n: usize, columns: usize) -> usize {
    let (thread, part) = (n % 8 * 4 + k % 4, n % 32 / 16);
    let number = n % 16 / 8 * 2 + k % 8 / 4;
    ((k / 8 * (columns / 32) + n / 32) * 2 + part) * 128 + thread * 4 + number
}

/// Place of element (m, n) of a sum of the matrix units with `columns` columns (as there, C): 16 × 32 at a time, of
/// which thread 4 g + t holds columns 2 t and 2 t + 1 of rows g and g + 8, for each 8 columns.
fn sum(m: usize, n: usize, columns: usize) -> usize {
    let thread = m % 8 * 4 + n % 8 / 2;
    let number = m % 16 / 8 * 2 + n % 2;
    (((m / 16) * (columns / 32) + n / 32) * 4 + n % 32 / 8) * 128 + thread * 4 + number
}

/// [`factor`] in bf16 (mma.m16n8k16): 16 × 16 at a time, of which thread 4 g + t holds rows 2 t, 2 t + 1, 2 t + 8 and
/// 2 t + 9 of columns g and g + 8.
fn factor_bf16(k: usize, n: usize, columns: usize) -> usize {
    let (thread, pair) = (n % 8 * 4 + k % 8 / 2, n % 16 / 8 * 2 + k % 16 / 8);
    (k / 16 * (columns / 16) + n / 16) * 256 + thread * 8 + pair * 2 + k % 2
}

/// [`sum`] in bf16: 16 × 8 at a time, first the upper 8 rows, then the lower.
fn sum_bf16(m: usize, n: usize, columns: usize) -> usize {
    let half = (m / 16 * (columns / 8) + n / 8) * 2 + m % 16 / 8;
    half * 64 + m % 8 * 8 + n % 8
}

impl NetLayout {
    /// For products of this precision.
    pub(super) fn new(shape: &Shape, precision: Precision) -> Self {
        let bf16 = precision == Precision::Bf16;
        // Columns are a multiple of `align`; rows are `gap` numbers further apart than they are long.
        let (align, gap, per_word) = if bf16 { (16, 8, 2) } else { (32, 0, 1) };
        let (factor, sum): (Place, Place) = if bf16 { (factor_bf16, sum_bf16) } else { (factor, sum) };
        let layers = shape.layers();
        let widths: Vec<usize> =
            [shape.inputs].into_iter().chain(layers.iter().map(|layer| layer.outputs)).collect();
        let padded: Vec<usize> = widths.iter().map(|width| width.next_multiple_of(align)).collect();
        let apart: Vec<usize> = padded.iter().map(|width| width + gap).collect();
        let (mut places, mut end) = (Vec::new(), 0);
        for width in &apart {
            places.push(end);
            end += width;
        }
        let keeps = !shape.activation.slope_follows_from_output();
        let kept = if keeps { places[layers.len()] - places[1] } else { 0 };
        // The output of a network is in f32: behind the others, where those are in bf16.
        let given = if bf16 { apart.last().copied().unwrap_or(0) } else { 0 };
        let bytes = (end / per_word + given) * size_of::<f32>();
        // Each matrix lies there twice, for the way forth and transposed for the way back: the matrix units read both
        // row by row.
        let (mut weights, mut biases, mut backs, mut packed) = (Vec::new(), Vec::new(), Vec::new(), 0);
        let (mut gradients, mut gradient, mut work) = ([Vec::new(), Vec::new()], 0, 0);
        let size = shape.parameters();
        let (mut map, mut forth, mut back) = (vec![0; size], vec![0; size], vec![u32::MAX; size]);
        for (index, layer) in layers.iter().enumerate() {
            let (inputs, outputs) = (padded[index], padded[index + 1]);
            let area = inputs * outputs;
            let words = area / per_word;
            weights.push(packed);
            biases.push(packed + words);
            backs.push(packed + words + outputs);
            gradients[0].push(gradient);
            gradients[1].push(gradient + area);
            for (number, parameter) in layer.weight.clone().enumerate() {
                let (row, column) = (number / layer.outputs, number % layer.outputs);
                map[parameter] = (gradient + sum(row, column, outputs)) as u32;
                forth[parameter] = (packed * per_word + factor(row, column, outputs)) as u32;
                back[parameter] =
                    ((packed + words + outputs) * per_word + factor(column, row, inputs)) as u32;
            }
            for (column, parameter) in layer.bias.clone().enumerate() {
                map[parameter] = (gradient + area + column) as u32;
                forth[parameter] = (packed + words + column) as u32;
            }
            packed += 2 * words + outputs;
            gradient += area + outputs;
            // Forth, the weights' derivatives, and the derivatives of what goes in, which the first layer does not
            // need.
            work += area * if index == 0 { 2 } else { 3 };
        }
        Self {
            widths,
            padded,
            apart,
            places,
            end,
            bytes,
            kept,
            per_word,
            weights,
            biases,
            backs,
            packed,
            gradients,
            gradient,
            map,
            forth,
            back,
            work,
        }
    }

    /// Widths of each layer as the kernels are made for them: columns of the input that are used and that there are,
    /// columns of the output that there are and that are used.
    pub(super) fn shapes(&self) -> Vec<[usize; 4]> {
        // Not finer, so that fewer different kernels are compiled. In bf16 all padded columns are used.
        let used = |width: usize| width.next_multiple_of(16);
        (0..self.weights.len())
            .map(|l| [used(self.widths[l]), self.padded[l], self.padded[l + 1], used(self.widths[l + 1])])
            .collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaitfit_policy::network::Activation;

    #[test]
    fn every_parameter_has_its_own_place() {
        let shape = Shape { inputs: 5, hidden: vec![33, 7], outputs: 2, activation: Activation::Elu };
        let layout = NetLayout::new(&shape, Precision::F32);
        assert_eq!(layout.padded, [32, 64, 32, 32]);
        assert_eq!((layout.end, layout.bytes, layout.kept), (160, 4 * 160, 0));
        // Derivatives of the functions of hidden layers, not of the input and the output.
        let silu = Shape { activation: Activation::Silu, ..shape.clone() };
        assert_eq!(NetLayout { kept: 96, ..layout.clone() }, NetLayout::new(&silu, Precision::F32));
        let none = Shape { hidden: Vec::new(), ..silu };
        assert_eq!(NetLayout::new(&none, Precision::Bf16).kept, 0);
        let areas = 32 * 64 + 64 * 32 + 32 * 32;
        assert_eq!((layout.packed, layout.gradient), (2 * areas + 128, areas + 128));
        let places = |places: &[u32], max: usize| {
            let mut seen = places.to_vec();
            seen.retain(|&place| place != u32::MAX);
            let count = seen.len();
            seen.sort_unstable();
            seen.dedup();
            assert!(seen.len() == count && seen.iter().all(|&place| (place as usize) < max));
            seen
        };
        assert_eq!(places(&layout.map, layout.gradient).len(), shape.parameters());
        let copies = [layout.forth.clone(), layout.back.clone()].concat();
        assert_eq!(places(&copies, layout.packed).len(), 2 * shape.parameters() - 33 - 7 - 2);
        assert_eq!(layout.shapes(), [[16, 32, 64, 48], [48, 64, 32, 16], [16, 32, 32, 16]]);
    }
}
