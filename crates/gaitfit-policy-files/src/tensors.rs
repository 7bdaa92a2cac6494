//! Tensors by name in a safetensors file, with errors that name the tensor.

use super::layers::{Affine, MAX_LAYERS, assemble, transpose};
use gaitfit_model::{listed, shown};
use gaitfit_policy::PolicyError;
use gaitfit_policy::invalid;
use gaitfit_policy::network::{Activation, Cell, LayerNorm, Network, Recurrent, RecurrentLayer};
use safetensors::tensor::TensorView;
use safetensors::{Dtype, SafeTensorError, SafeTensors};
use std::collections::BTreeSet;

/// Names that the message about a missing tensor shows.
const SHOWN: usize = 24;

/// A parsed file, and the tensors asked for so far.
pub(super) struct Tensors<'a> {
    file: SafeTensors<'a>,
    used: BTreeSet<String>,
}

impl<'a> Tensors<'a> {
    pub fn parse(bytes: &'a [u8]) -> Result<Self, PolicyError> {
        let file = SafeTensors::deserialize(bytes).map_err(|error| {
            let cut = matches!(
                error,
                SafeTensorError::HeaderTooSmall
                    | SafeTensorError::InvalidHeaderLength
                    | SafeTensorError::MetadataIncompleteBuffer
            );
            let why = if cut { "it is cut short or has extra bytes" } else { "its header is damaged" };
            invalid(format!(
                "no whole safetensors file: {why} ({}); copy or export it again",
                shown(&error.to_string())
            ))
        })?;
        // After parsing: a file that is cut short is reported as such, and not by its checksum.
        super::weights::check(bytes)?;
        Ok(Self { file, used: BTreeSet::new() })
    }

    pub fn has(&self, name: &str) -> bool {
        self.file.tensor(name).is_ok()
    }

    fn view(&mut self, name: &str) -> Result<TensorView<'a>, PolicyError> {
        let view = self.file.tensor(name).map_err(|_| {
            // A file may hold thousands of tensors: the message shows some.
            let mut names = self.file.names();
            names.sort_unstable();
            let names = listed(names.into_iter().map(shown), SHOWN);
            invalid(format!("tensor {} is missing; the file holds {names}", shown(name)))
        })?;
        self.used.insert(name.to_owned());
        Ok(view)
    }

    /// Shape and numbers; `f32` or `f64`.
    fn numbers(&mut self, name: &str) -> Result<(Vec<usize>, Vec<f64>), PolicyError> {
        let view = self.view(name)?;
        let values = match view.dtype() {
            Dtype::F32 => {
                view.data().as_chunks().0.iter().map(|&b| f64::from(f32::from_le_bytes(b))).collect()
            }
            Dtype::F64 => view.data().as_chunks().0.iter().map(|&b| f64::from_le_bytes(b)).collect(),
            other => {
                return Err(invalid(format!(
                    "tensor {} is {other:?}; only F32, and F64 (rounded to F32), are read",
                    shown(name)
                )));
            }
        };
        Ok((view.shape().to_vec(), values))
    }

    /// The bytes of a tensor of bytes.
    pub fn bytes(&mut self, name: &str) -> Result<&'a [u8], PolicyError> {
        let view = self.view(name)?;
        if view.dtype() != Dtype::U8 {
            return Err(invalid(format!("tensor {} is {:?}; it holds bytes", shown(name), view.dtype())));
        }
        Ok(view.data())
    }

    /// A vector of any length; axes of length 1 are ignored.
    pub fn vector(&mut self, name: &str) -> Result<Vec<f64>, PolicyError> {
        let (shape, values) = self.numbers(name)?;
        // Trainers save a vector also as a row or a column.
        if shape.iter().filter(|&&length| length != 1).count() > 1 {
            return Err(invalid(format!("tensor {} has shape {shape:?}; a vector is needed", shown(name))));
        }
        Ok(values)
    }

    /// The tensors `prefix.N.weight` (`outputs × inputs`) and `prefix.N.bias` by rising N, as `nn.Sequential`
    /// stores them, where layers without parameters take a number too. A weight that is a vector is a layer norm, with
    /// `epsilon`, of the layer before it.
    pub fn network(
        &mut self,
        prefix: &str,
        activation: Activation,
        epsilon: f32,
    ) -> Result<Network, PolicyError> {
        let number = |name: &str| -> Option<usize> {
            name.strip_prefix(prefix)?.strip_prefix('.')?.strip_suffix(".weight")?.parse().ok()
        };
        // Sorted as numbers: layer 10 comes after layer 9.
        let numbers: BTreeSet<usize> = self.file.names().into_iter().filter_map(number).collect();
        // The error about the first layer also lists the tensors that the file has.
        if numbers.is_empty() {
            let error = self.view(&format!("{prefix}.0.weight")).err();
            return Err(error.unwrap_or_else(|| invalid("it holds no layers")));
        }
        if numbers.len() > MAX_LAYERS {
            return Err(invalid(format!("{prefix} has {} layers; at most {MAX_LAYERS}", numbers.len())));
        }
        let (mut layers, mut norms) = (Vec::new(), Vec::new());
        for name in numbers.into_iter().map(|number| format!("{prefix}.{number}")) {
            let vector =
                self.file.tensor(&format!("{name}.weight")).is_ok_and(|weight| weight.shape().len() == 1);
            if !vector {
                // A layer's weight is a matrix, a layer norm's a vector.
                layers.push(self.layer(&name)?);
                continue;
            }
            if layers.is_empty() || norms.len() >= layers.len() {
                return Err(invalid(format!(
                    "tensor {}.weight is a vector, a layer norm, and does not follow a layer",
                    shown(&name)
                )));
            }
            // The layers between this norm and the one before it have none.
            norms.resize(layers.len() - 1, None);
            norms.push(Some(self.norm(&name, epsilon)?));
        }
        assemble(&layers, activation, norms).map_err(|error| invalid(format!("{prefix}: {error}")))
    }

    /// The tensors of PyTorch's `nn.LSTM` or `nn.GRU`: `prefix.weight_ih_l0` and so on, layer after layer.
    pub fn recurrent(&mut self, prefix: &str, cell: Cell) -> Result<Recurrent, PolicyError> {
        let mut layers = Vec::new();
        // The first layer is read in any case, so that its absence is an error.
        while layers.is_empty() || self.has(&format!("{prefix}.weight_ih_l{}", layers.len())) {
            let number = layers.len();
            if number == MAX_LAYERS {
                return Err(invalid(format!("{prefix} has more than {MAX_LAYERS} layers")));
            }
            let mut matrix = |part: &str| -> Result<(usize, usize, Vec<f32>), PolicyError> {
                let name = format!("{prefix}.{part}_l{number}");
                let (shape, values) = self.numbers(&name)?;
                let [wide, inputs] = shape[..] else {
                    return Err(invalid(format!(
                        "tensor {} has shape {shape:?}; a matrix is needed",
                        shown(&name)
                    )));
                };
                let values: Vec<f32> = values.into_iter().map(|x| x as f32).collect();
                // PyTorch stores outputs × inputs, the networks here inputs × outputs.
                Ok((wide, inputs, transpose(&values, wide, inputs)))
            };
            let (wide, inputs, weight_ih) = matrix("weight_ih")?;
            let (_, hidden, weight_hh) = matrix("weight_hh")?;
            let mut bias = |part: &str| -> Result<Vec<f32>, PolicyError> {
                let name = format!("{prefix}.{part}_l{number}");
                // Layers made with `bias=False` have no such tensors.
                if !self.has(&name) {
                    return Ok(vec![0.0; wide]);
                }
                Ok(self.vector(&name)?.into_iter().map(|x| x as f32).collect())
            };
            let (bias_ih, bias_hh) = (bias("bias_ih")?, bias("bias_hh")?);
            layers.push(RecurrentLayer { inputs, hidden, weight_ih, weight_hh, bias_ih, bias_hh });
        }
        let recurrent = Recurrent { cell, layers };
        match recurrent.mistake() {
            None => Ok(recurrent),
            Some(mistake) => Err(invalid(format!("{prefix}: {mistake}"))),
        }
    }

    fn norm(&mut self, name: &str, epsilon: f32) -> Result<LayerNorm, PolicyError> {
        let mut part = |part: &str| -> Result<Vec<f32>, PolicyError> {
            Ok(self.vector(&format!("{name}.{part}"))?.into_iter().map(|x| x as f32).collect())
        };
        Ok(LayerNorm { weight: part("weight")?, bias: part("bias")?, epsilon })
    }

    fn layer(&mut self, name: &str) -> Result<Affine, PolicyError> {
        let (shape, weight) = self.numbers(&format!("{name}.weight"))?;
        let [outputs, inputs] = shape[..] else {
            return Err(invalid(format!(
                "tensor {}.weight has shape {shape:?}; a layer's is [outputs, inputs]",
                shown(name)
            )));
        };
        let bias = self.vector(&format!("{name}.bias"))?;
        if bias.len() != outputs {
            return Err(invalid(format!(
                "tensor {}.bias has {} numbers, its weight has shape [{outputs}, {inputs}]",
                shown(name),
                bias.len()
            )));
        }
        let single = |values: Vec<f64>| values.into_iter().map(|value| value as f32).collect::<Vec<f32>>();
        let weight = transpose(&single(weight), outputs, inputs);
        Ok(Affine { inputs, outputs, weight, bias: single(bias) })
    }

    /// A tensor that was never asked for, if there is one.
    pub fn unused(&self) -> Option<String> {
        // Sorted below, so that the same file always gives the same message.
        let mut unused: Vec<&str> =
            self.file.names().into_iter().filter(|&name| !self.used.contains(name)).collect();
        unused.sort_unstable();
        unused.first().map(|name| shown(name))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn a_missing_tensor_is_named_with_the_first_of_the_others() {
        let data = 1_f32.to_le_bytes();
        let names = (0..SHOWN + 6).map(|number| format!("t{number:02}"));
        let views = names.map(|name| (name, TensorView::new(Dtype::F32, vec![1], &data).unwrap()));
        let bytes = safetensors::serialize(views, None).unwrap();
        let error = Tensors::parse(&bytes).unwrap().vector("none").unwrap_err().to_string();
        assert!(error.contains("the file holds t00, t01,") && error.contains(", t23 and 6 more"), "{error}");
    }
}
