//! A layer's weights laid out for the products: panel after panel of columns.

use super::{Layer, Shape, aligned::Aligned, dispatch, dispatch::LANES, scalar::Scalar};

/// A matrix of `depth × columns` in panels of columns, each `depth × width` row-major, so that a product reads memory
/// forwards. Panels are [`dispatch::panel`] wide, the last ones [`LANES`]; columns that fill up the last are 0.
#[derive(Clone, Debug, Default)]
pub(crate) struct Panels<T: Scalar> {
    /// Rows of the matrix.
    pub(crate) depth: usize,
    /// Columns of the matrix, without the padding.
    pub(crate) columns: usize,
    data: Aligned<T>,
}

impl<T: Scalar> Panels<T> {
    /// Takes the matrix with element (i, j) at `source[i · strides[0] + j · strides[1]]`.
    fn fill(&mut self, source: &[T], [depth, columns]: [usize; 2], strides: [usize; 2]) {
        (self.depth, self.columns) = (depth, columns);
        let padded = columns.next_multiple_of(LANES);
        self.data.at_least(depth * padded);
        let mut first = 0;
        while first < padded {
            let width = if padded - first >= dispatch::panel() { dispatch::panel() } else { LANES };
            let panel = self.data[first * depth..].chunks_exact_mut(width);
            for (i, row) in panel.take(depth).enumerate() {
                let kept = width.min(columns - first);
                let from = source[i * strides[0] + first * strides[1]..].iter().step_by(strides[1]);
                row[..kept].iter_mut().zip(from).for_each(|(to, &from)| *to = from);
                row[kept..].fill(T::ZERO);
            }
            first += width;
        }
    }

    /// The panel of `W` columns that starts at column `first`.
    #[inline(always)]
    pub(crate) fn panel<const W: usize>(&self, first: usize) -> &[[T; W]] {
        &self.data[first * self.depth..].as_chunks().0[..self.depth]
    }
}

/// A network's parameters laid out for its passes; made anew when they change.
#[derive(Clone, Debug, Default)]
pub(crate) struct Weights<T: Scalar> {
    /// W of every layer, and Wᵀ.
    pub(crate) layers: Vec<[Panels<T>; 2]>,
    /// b of every layer, padded with 0 to whole [`LANES`].
    pub(crate) biases: Vec<Aligned<T>>,
    /// Number of parameters, without the padding.
    pub(crate) count: usize,
}

impl<T: Scalar> Weights<T> {
    /// Of a network; Wᵀ, which only the backward pass needs, if `backward`.
    pub(crate) fn new(shape: &Shape, parameters: &[T], backward: bool) -> Self {
        let mut weights = Self::default();
        weights.fill(shape, parameters, backward);
        weights
    }

    /// [`Self::new`] in the memory of earlier parameters.
    pub(crate) fn fill(&mut self, shape: &Shape, parameters: &[T], backward: bool) {
        let layers = shape.layers();
        self.layers.resize_with(layers.len(), Default::default);
        self.biases.resize_with(layers.len(), Aligned::default);
        self.count = shape.parameters();
        for ((layer, [w, transposed]), bias) in layers.iter().zip(&mut self.layers).zip(&mut self.biases) {
            let Layer { inputs, outputs, .. } = *layer;
            let source = &parameters[layer.weight.clone()];
            w.fill(source, [inputs, outputs], [outputs, 1]);
            if backward {
                transposed.fill(source, [outputs, inputs], [1, outputs]);
            }
            bias.at_least(outputs.next_multiple_of(LANES));
            bias[..outputs].copy_from_slice(&parameters[layer.bias.clone()]);
        }
    }
}
