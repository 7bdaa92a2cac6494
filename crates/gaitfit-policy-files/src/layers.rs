//! Networks layer by layer, as other programs store them.

use gaitfit_policy::PolicyError;
use gaitfit_policy::invalid;
use gaitfit_policy::network::{Activation, LayerNorm, Network, Shape};

/// Max number of layers of a network from a file.
pub(super) const MAX_LAYERS: usize = 64;

/// One layer y = x W + b, with W `inputs × outputs`, row-major.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Affine {
    pub inputs: usize,
    pub outputs: usize,
    pub weight: Vec<f32>,
    pub bias: Vec<f32>,
}

impl Affine {
    /// W as PyTorch stores it: `outputs × inputs`.
    pub fn transposed(&self) -> Vec<f32> {
        transpose(&self.weight, self.inputs, self.outputs)
    }

    /// Returns the layer behind x ↦ x ∘ factor + offset: Wᵢⱼ becomes factorᵢ Wᵢⱼ and bⱼ becomes bⱼ + Σᵢ
    /// offsetᵢ Wᵢⱼ, summed in `f64`.
    pub fn behind(&self, factor: &[f64], offset: &[f64]) -> Self {
        // In `f64`, because many products are added to one bias.
        let mut bias: Vec<f64> = self.bias.iter().map(|&b| f64::from(b)).collect();
        let mut weight = Vec::with_capacity(self.weight.len());
        for (row, (factor, offset)) in
            self.weight.chunks_exact(self.outputs.max(1)).zip(factor.iter().zip(offset))
        {
            for (bias, &w) in bias.iter_mut().zip(row) {
                *bias += offset * f64::from(w);
                weight.push((factor * f64::from(w)) as f32);
            }
        }
        let bias = bias.into_iter().map(|b| b as f32).collect();
        Self { inputs: self.inputs, outputs: self.outputs, weight, bias }
    }
}

/// The transpose of a `rows × columns` matrix, row-major.
pub(super) fn transpose<T: Copy>(matrix: &[T], rows: usize, columns: usize) -> Vec<T> {
    (0..columns).flat_map(|column| (0..rows).map(move |row| matrix[row * columns + column])).collect()
}

/// A network's layers.
pub(super) fn take_apart(network: &Network) -> Vec<Affine> {
    let layer = |layer: &gaitfit_policy::network::Layer| Affine {
        inputs: layer.inputs,
        outputs: layer.outputs,
        weight: network.parameters[layer.weight.clone()].to_vec(),
        bias: network.parameters[layer.bias.clone()].to_vec(),
    };
    network.shape.layers().iter().map(layer).collect()
}

/// The network of `layers`, whose sizes must follow each other.
pub(super) fn assemble(
    layers: &[Affine],
    activation: Activation,
    norms: Vec<Option<LayerNorm>>,
) -> Result<Network, PolicyError> {
    let (Some(first), Some(last)) = (layers.first(), layers.last()) else {
        return Err(invalid("it holds no layers"));
    };
    for (index, pair) in layers.windows(2).enumerate() {
        if pair[0].outputs != pair[1].inputs {
            return Err(invalid(format!(
                "layer {} gives {} numbers, layer {} takes {}",
                index + 1,
                pair[0].outputs,
                index + 2,
                pair[1].inputs
            )));
        }
    }
    // There is a last layer, so the subtraction does not underflow.
    let hidden = layers[..layers.len() - 1].iter().map(|layer| layer.outputs).collect();
    let shape = Shape { inputs: first.inputs, hidden, outputs: last.outputs, activation };
    let parts = layers.iter().flat_map(|layer| [&layer.weight[..], &layer.bias]);
    let network = Network { norms, ..Network::new(shape, &parts.collect::<Vec<_>>().concat())? };
    network.check()?;
    Ok(network)
}
