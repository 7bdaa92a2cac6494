//! Networks whose normaliser becomes a part of their first layer.

use super::NormaliserTensors;
use super::layers::{assemble, take_apart};
use super::tensors::Tensors;
use gaitfit_policy::network::{Activation, Network};
use gaitfit_policy::{PolicyError, invalid};

/// The network of `prefix`, its normaliser made part of the first layer.
pub(super) fn normalised(
    tensors: &mut Tensors<'_>,
    prefix: &str,
    (activation, epsilon): (Activation, f32),
    normaliser: Option<&NormaliserTensors>,
) -> Result<Network, PolicyError> {
    let network = tensors.network(prefix, activation, epsilon)?;
    let Some(names) = normaliser else { return Ok(network) };
    if !(0.0..=1e3).contains(&names.epsilon) {
        let epsilon = names.epsilon;
        return Err(invalid(format!("epsilon of the normaliser is {epsilon}; give 0 to 1000")));
    }
    let (mean, std) = (tensors.vector(&names.mean)?, tensors.vector(&names.std)?);
    for (name, values) in [(&names.mean, &mean), (&names.std, &std)] {
        if values.len() != network.shape.inputs {
            return Err(invalid(format!(
                "tensor {name} has {} numbers, {prefix} takes {}",
                values.len(),
                network.shape.inputs
            )));
        }
    }
    // Written with `!`, so that NaN is refused too.
    if let Some(&found) = std.iter().find(|&&std| !(std >= 0.0 && std + names.epsilon > 0.0)) {
        let name = &names.std;
        return Err(invalid(format!(
            "tensor {name} has a standard deviation of {found}; with epsilon it must be above 0"
        )));
    }
    // Epsilon is added to the deviation and not to the variance, as rsl_rl does it.
    let factor: Vec<f64> = std.iter().map(|std| 1.0 / (std + names.epsilon)).collect();
    let offset: Vec<f64> = mean.iter().zip(&factor).map(|(mean, factor)| -mean * factor).collect();
    let mut layers = take_apart(&network);
    if let Some(first) = layers.first_mut() {
        *first = first.behind(&factor, &offset);
    }
    assemble(&layers, activation, network.norms)
}
