//! A network's parameters as the passes of a gradient want them.

use aligned_vec::{AVec, avec};

use super::{Activation, Shape, scalar::Scalar};

/// Parameters with each matrix in both orders, so that it can be read row by row on the way forth and back.
pub struct Weights<'a, T> {
    /// Shape of the network.
    pub shape: &'a Shape,
    /// As [`Shape::layers`] has them.
    pub(super) parameters: &'a [T],
    /// Wᵀ where W is in `parameters`, of all layers but the first, through which nothing goes back
    /// unless the network stands behind another.
    pub(super) transposed: AVec<T>,
    /// Function of the output. Without one, the output is linear.
    pub(super) output: Option<Activation>,
}

impl<'a, T: Scalar> Weights<'a, T> {
    /// The weights of a network of `shape` with these parameters.
    pub fn new(shape: &'a Shape, parameters: &'a [T]) -> Self {
        Self::transposing(shape, parameters, 1)
    }

    /// As [`Self::new`], for a network behind another, to which [`super::Tape::to_input`] goes back through
    /// the first layer too.
    pub fn behind_another(shape: &'a Shape, parameters: &'a [T]) -> Self {
        Self::transposing(shape, parameters, 0)
    }

    /// The same weights of a network whose output goes through this function.
    #[must_use]
    pub fn with_output(self, output: Option<Activation>) -> Self {
        Self { output, ..self }
    }

    /// With the layers from number `first` on in both orders.
    fn transposing(shape: &'a Shape, parameters: &'a [T], first: usize) -> Self {
        let mut transposed = avec![T::ZERO; parameters.len()];
        // The places of the layers before `first` stay zero: nobody reads them.
        for layer in shape.layers().iter().skip(first) {
            let w = &parameters[layer.weight.clone()];
            // Row j of the transpose is column j of W.
            for (j, row) in transposed[layer.weight.clone()].chunks_exact_mut(layer.inputs).enumerate() {
                let column = w[j..].iter().step_by(layer.outputs);
                row.iter_mut().zip(column).for_each(|(to, &from)| *to = from);
            }
        }
        Self { shape, parameters, transposed, output: None }
    }
}
