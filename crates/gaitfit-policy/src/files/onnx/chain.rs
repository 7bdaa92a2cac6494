//! A network under construction, operator by operator.

use super::constant::Constant;
use crate::PolicyError;
use crate::error::invalid;
use crate::files::layers::{Affine, MOST_LAYERS, assemble};
use crate::network::{Activation, Network, Normaliser};

/// x ↦ x ∘ factor + offset; vectors of one number or of the width.
#[derive(Clone, Debug, PartialEq)]
struct Elementwise {
    factor: Vec<f64>,
    offset: Vec<f64>,
}

/// Layers so far. Errors are sentence parts that follow the operator's name.
#[derive(Clone, Debug, Default)]
pub struct Chain {
    before: Option<Elementwise>,
    layers: Vec<Affine>,
    activation: Option<Activation>,
    after_activation: bool,
}

impl Chain {
    /// The numbers a row has now; `None` before the first layer, when nothing said so.
    pub fn width(&self) -> Option<usize> {
        self.layers.last().map(|layer| layer.outputs)
    }

    /// The numbers a row has at the beginning; `None` before the first layer.
    pub fn inputs(&self) -> Option<usize> {
        self.layers.first().map(|layer| layer.inputs)
    }

    /// Whether the last operator was an activation.
    pub fn ends_in_activation(&self) -> bool {
        self.after_activation
    }

    /// x ↦ x ∘ factor + offset.
    pub fn elementwise(&mut self, factor: &Constant, offset: &Constant) -> Result<(), String> {
        let row = |constant: &Constant| {
            constant.as_row().map(<[f64]>::to_vec).ok_or("its constant does not act alike on every row")
        };
        let (factor, offset) = (row(factor)?, row(offset)?);
        if self.after_activation {
            return Err("it stands between an activation and a layer".to_owned());
        }
        let Some(layer) = self.layers.last_mut() else {
            let before = self.before.take().unwrap_or(Elementwise { factor: vec![1.0], offset: vec![0.0] });
            let sizes = [&before.factor, &before.offset, &factor, &offset].map(Vec::len);
            let width = sizes.into_iter().max().unwrap_or(1);
            if sizes.iter().any(|&size| size != 1 && size != width) {
                return Err(format!("its constant has another width than the one before it: {sizes:?}"));
            }
            let at = |values: &[f64], index: usize| if values.len() == 1 { values[0] } else { values[index] };
            let both = |index| {
                let scale = at(&factor, index);
                (scale * at(&before.factor, index), scale * at(&before.offset, index) + at(&offset, index))
            };
            let (factor, offset) = (0..width).map(both).unzip();
            self.before = Some(Elementwise { factor, offset });
            return Ok(());
        };
        for values in [&factor, &offset] {
            if values.len() != 1 && values.len() != layer.outputs {
                return Err(format!(
                    "its constant has {} numbers, the layer before it gives {}",
                    values.len(),
                    layer.outputs
                ));
            }
        }
        let at = |values: &[f64], index: usize| if values.len() == 1 { values[0] } else { values[index] };
        for row in layer.weight.chunks_exact_mut(layer.outputs) {
            for (output, weight) in row.iter_mut().enumerate() {
                *weight = (f64::from(*weight) * at(&factor, output)) as f32;
            }
        }
        for (output, bias) in layer.bias.iter_mut().enumerate() {
            *bias = (f64::from(*bias) * at(&factor, output) + at(&offset, output)) as f32;
        }
        Ok(())
    }

    /// x ↦ x W + b; `weight` is `inputs × outputs`, row-major.
    pub fn layer(&mut self, layer: Affine) -> Result<(), String> {
        if layer.inputs == 0 || layer.outputs == 0 {
            return Err("its weight is empty".to_owned());
        }
        if self.layers.len() == MOST_LAYERS {
            return Err(format!("it is one layer more than {MOST_LAYERS}"));
        }
        match self.width() {
            Some(width) if width != layer.inputs => {
                return Err(format!("it takes {} numbers, the layer before it gives {width}", layer.inputs));
            }
            Some(_) if !self.after_activation => {
                return Err("it follows another layer without an activation between them".to_owned());
            }
            _ => {}
        }
        if let (true, Some(before)) = (self.layers.is_empty(), &self.before) {
            let width = before.factor.len();
            if width != 1 && width != layer.inputs {
                return Err(format!(
                    "it takes {} numbers, the normaliser before it has {width}",
                    layer.inputs
                ));
            }
        }
        self.layers.push(layer);
        self.after_activation = false;
        Ok(())
    }

    /// The function between two layers; the same everywhere.
    pub fn activate(&mut self, activation: Activation) -> Result<(), String> {
        if self.layers.is_empty() {
            return Err("it stands before the first layer".to_owned());
        }
        if self.after_activation {
            return Err("it follows another activation".to_owned());
        }
        if let Some(other) = self.activation.filter(|&other| other != activation) {
            return Err(format!("other layers use {}; all must use one activation", other.name()));
        }
        self.activation = Some(activation);
        self.after_activation = true;
        Ok(())
    }

    /// The network. With `normaliser`, what stands before the first layer must be that normaliser; without, it
    /// becomes part of the first layer.
    pub fn network(mut self, normaliser: Option<&Normaliser>) -> Result<Network, PolicyError> {
        match (self.before.take(), normaliser) {
            (before, Some(normaliser)) => {
                let expected: (Vec<f64>, Vec<f64>) = normaliser
                    .scale()
                    .into_iter()
                    .map(|(factor, offset)| (f64::from(factor), f64::from(offset)))
                    .unzip();
                if before.is_none_or(|found| (found.factor, found.offset) != expected) {
                    return Err(invalid(
                        "the normaliser in the graph is not the one in the metadata; export the policy again",
                    ));
                }
            }
            (Some(before), None) => {
                if let Some(first) = self.layers.first_mut() {
                    let spread = |values: Vec<f64>| match values[..] {
                        [one] => vec![one; first.inputs],
                        _ => values,
                    };
                    let (factor, offset) = (spread(before.factor), spread(before.offset));
                    *first = first.behind(&factor, &offset);
                }
            }
            (None, None) => {}
        }
        assemble(&self.layers, self.activation.unwrap_or_default())
    }
}
