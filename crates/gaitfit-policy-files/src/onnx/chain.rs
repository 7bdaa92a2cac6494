//! A network under construction, operator by operator.

use super::bounds::Bounds;
use super::constant::Constant;
use super::node_error::{NodeError, misfit, unread};
use crate::layers::{Affine, MAX_LAYERS, assemble};
use gaitfit_policy::PolicyError;
use gaitfit_policy::invalid;
use gaitfit_policy::network::{Activation, Cell, LayerNorm, Network, Normaliser, Recurrent, RecurrentLayer};
use std::ops::Range;

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
    /// Recurrent layers, which stand before all others.
    memory: Option<Recurrent>,
    layers: Vec<Affine>,
    /// Norms of the layers so far; layers beyond the list have none.
    norms: Vec<Option<LayerNorm>>,
    /// Activation of the hidden layers.
    activation: Option<Activation>,
    /// Activation behind the last layer so far.
    last: Option<Activation>,
    /// Between which numbers each output is clipped, behind everything else.
    bounds: Option<Bounds>,
}

/// Layers that were read from a graph.
#[derive(Clone, Debug)]
pub struct Read {
    /// Recurrent layers before the network.
    pub memory: Option<Recurrent>,
    /// The network.
    pub network: Network,
    /// Largest magnitude of each output, where the graph clips its outputs.
    pub clip: Option<Vec<f64>>,
}

impl Chain {
    /// The numbers a row has now; `None` before the first layer, when nothing said so.
    pub fn width(&self) -> Option<usize> {
        let memory = self.memory.as_ref().map(Recurrent::outputs);
        self.layers.last().map(|layer| layer.outputs).or(memory)
    }

    /// Whether no layer stands behind what it may remember.
    pub fn is_empty(&self) -> bool {
        self.layers.is_empty()
    }

    /// Number of recurrent layers.
    pub fn remembering(&self) -> usize {
        self.memory.as_ref().map_or(0, |memory| memory.layers.len())
    }

    /// One more recurrent layer.
    pub fn recurrent(&mut self, cell: Cell, layer: RecurrentLayer) -> Result<(), NodeError> {
        if !self.layers.is_empty() {
            return Err(unread("it stands behind other layers; memories are read before them only"));
        }
        if self.remembering() == MAX_LAYERS {
            return Err(misfit(format!("it is one layer more than {MAX_LAYERS}")));
        }
        // The first layer decides the kind.
        let memory = self.memory.get_or_insert(Recurrent { cell, layers: Vec::new() });
        if memory.cell != cell {
            return Err(misfit(format!("the layer before it is a {}", memory.cell.name())));
        }
        memory.layers.push(layer);
        memory.mistake().map_or(Ok(()), |mistake| Err(misfit(mistake)))
    }

    /// The numbers a row has at the beginning; `None` before the first layer.
    pub fn inputs(&self) -> Option<usize> {
        let memory = self.memory.as_ref().map(Recurrent::inputs);
        memory.or_else(|| self.layers.first().map(|layer| layer.inputs))
    }

    /// x ↦ x ∘ factor + offset.
    pub fn elementwise(&mut self, factor: &Constant, offset: &Constant) -> Result<(), NodeError> {
        let row = |constant: &Constant| {
            constant
                .as_row()
                .map(<[f64]>::to_vec)
                .ok_or(unread("its constant does not act alike on every row"))
        };
        let (factor, offset) = (row(factor)?, row(offset)?);
        if self.last.is_some() {
            return Err(unread(
                "it stands behind an activation: export the actor without it, and let the description's action_scale have \
                 its factor",
            ));
        }
        // The clip lies before this operator, so its limits change with the values.
        if let Some(bounds) = &mut self.bounds {
            bounds.scale(&factor, &offset)?;
        }
        // Factor and offset become part of what stands before them: a norm's weights, the last layer, or
        // before all layers a normaliser. So the network has no operators besides its layers.
        let normed = self.norms.len() == self.layers.len();
        if let Some(Some(norm)) = self.norms.last_mut().filter(|_| normed) {
            let width = norm.weight.len();
            if [&factor, &offset].iter().any(|values| values.len() != 1 && values.len() != width) {
                return Err(misfit(format!(
                    "its constant is not of the {width} numbers of the norm before it"
                )));
            }
            let at = |values: &[f64], index: usize| values[if values.len() == 1 { 0 } else { index }];
            for (index, (weight, bias)) in norm.weight.iter_mut().zip(&mut norm.bias).enumerate() {
                *weight = (f64::from(*weight) * at(&factor, index)) as f32;
                *bias = (f64::from(*bias) * at(&factor, index) + at(&offset, index)) as f32;
            }
            return Ok(());
        }
        let Some(layer) = self.layers.last_mut() else {
            if self.memory.is_some() {
                return Err(unread("it stands between a memory and a layer"));
            }
            let before = self.before.take().unwrap_or(Elementwise { factor: vec![1.0], offset: vec![0.0] });
            let sizes = [&before.factor, &before.offset, &factor, &offset].map(Vec::len);
            let width = sizes.into_iter().max().unwrap_or(1);
            if sizes.iter().any(|&size| size != 1 && size != width) {
                return Err(misfit(format!(
                    "its constant has another width than the one before it: {sizes:?}"
                )));
            }
            let at = |values: &[f64], index: usize| if values.len() == 1 { values[0] } else { values[index] };
            // Two in a row become one: f₂ (f₁ x + o₁) + o₂.
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
                return Err(misfit(format!(
                    "its constant has {} numbers, the layer before it gives {}",
                    values.len(),
                    layer.outputs
                )));
            }
        }
        let at = |values: &[f64], index: usize| if values.len() == 1 { values[0] } else { values[index] };
        // (x W + b) f + o is x (W f) + (b f + o), with a factor for each column of W.
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
    pub fn layer(&mut self, layer: Affine) -> Result<(), NodeError> {
        self.not_clipped()?;
        if layer.inputs == 0 || layer.outputs == 0 {
            return Err(misfit("its weight is empty"));
        }
        if self.layers.len() == MAX_LAYERS {
            return Err(misfit(format!("it is one layer more than {MAX_LAYERS}")));
        }
        match self.width() {
            Some(width) if width != layer.inputs => {
                return Err(misfit(format!(
                    "it takes {} numbers, the layer before it gives {width}",
                    layer.inputs
                )));
            }
            Some(_) if self.last.is_none() && !self.layers.is_empty() => {
                return Err(unread("it follows another layer without an activation between them"));
            }
            _ => {}
        }
        // A `Network` has one function for all its hidden layers.
        if let (Some(last), Some(other)) = (self.last, self.activation)
            && last != other
        {
            return Err(misfit(format!(
                "the layer before it has {last}, others {other}; all hidden layers must use one activation"
            )));
        }
        // A further layer shows that the activation before it is that of a hidden layer.
        self.activation = self.last.take().or(self.activation);
        // A normaliser before the first layer becomes part of it, so their widths must agree; one number
        // serves all.
        if let (true, None, Some(before)) = (self.layers.is_empty(), &self.memory, &self.before) {
            let width = before.factor.len();
            if width != 1 && width != layer.inputs {
                return Err(unread(format!(
                    "it takes {} numbers, the normaliser before it has {width}",
                    layer.inputs
                )));
            }
        }
        self.layers.push(layer);
        Ok(())
    }

    /// A layer norm of the last layer's output.
    pub fn norm(&mut self, norm: LayerNorm) -> Result<(), NodeError> {
        self.not_clipped()?;
        let Some(width) = self.width().filter(|_| self.last.is_none() && !self.layers.is_empty()) else {
            return Err(unread("it does not follow a layer"));
        };
        if self.norms.len() == self.layers.len() {
            return Err(unread("it follows another layer norm"));
        }
        if norm.weight.len() != width || norm.bias.len() != width {
            return Err(misfit(format!("its weights are not {width}, as the layer before it gives")));
        }
        // Layers before this one without a norm.
        self.norms.resize(self.layers.len() - 1, None);
        self.norms.push(Some(norm));
        Ok(())
    }

    /// The function behind a layer; the same behind all but the last.
    pub fn activate(&mut self, activation: Activation) -> Result<(), NodeError> {
        self.not_clipped()?;
        if self.layers.is_empty() {
            return Err(unread("it stands before the first layer"));
        }
        if self.last.is_some() {
            return Err(unread("it follows another activation"));
        }
        if !activation.is_sound() {
            return Err(misfit(format!("its parameter is out of range ({activation})")));
        }
        self.last = Some(activation);
        Ok(())
    }

    /// x ↦ max(low, min(x, high)) of every number.
    pub fn clip(&mut self, low: f64, high: f64) -> Result<(), NodeError> {
        if self.layers.is_empty() {
            return Err(unread(
                "it clips the observation, which is not read: export the actor without it, or run the whole file as a \
                 function in Python (gaitfit.Policy, docs/python.md)",
            ));
        }
        if low.is_nan() || high.is_nan() || low > high {
            return Err(misfit(format!("it clips to [{low}, {high}], which is no interval")));
        }
        // Nothing changes behind a tanh.
        if self.last == Some(Activation::Tanh) && low <= -1.0 && high >= 1.0 {
            return Ok(());
        }
        let width = self.width().unwrap_or(0);
        self.bounds.get_or_insert_with(|| Bounds::new(width)).narrow(low, high);
        Ok(())
    }

    /// Only the numbers `range` of what the last layer gives.
    pub fn select(&mut self, range: Range<usize>) -> Result<(), NodeError> {
        // A norm mixes all numbers of its row, so a part of what it gives needs all columns of the layer.
        let normed = self.norms.len() == self.layers.len() && self.norms.last().is_some_and(Option::is_some);
        let Some(layer) = self.layers.last_mut().filter(|_| !normed) else {
            return Err(unread("it takes a part of what a memory or a layer norm gives"));
        };
        if range.is_empty() || range.end > layer.outputs {
            return Err(misfit(format!("it takes numbers {range:?} of {}", layer.outputs)));
        }
        // The part is what a layer with these columns alone gives.
        let rows = layer.weight.chunks_exact(layer.outputs);
        layer.weight = rows.flat_map(|row| row[range.clone()].to_vec()).collect();
        layer.bias = layer.bias[range.clone()].to_vec();
        layer.outputs = range.len();
        if let Some(bounds) = &mut self.bounds {
            bounds.select(range);
        }
        Ok(())
    }

    /// Refuses what stands behind a clip.
    fn not_clipped(&self) -> Result<(), NodeError> {
        match self.bounds {
            None => Ok(()),
            Some(_) => Err(unread("it stands behind a Clip; only actions are clipped, behind all layers")),
        }
    }

    /// The memory, if there is one, the network, and the clip of its outputs. With `normaliser`, what stands before the
    /// first layer must be that normaliser; without, it becomes part of the first layer.
    pub fn read(mut self, normaliser: Option<&Normaliser>) -> Result<Read, PolicyError> {
        let clip = self.bounds.take().map(|bounds| bounds.magnitudes()).transpose()?;
        match (self.before.take(), normaliser) {
            // The normaliser is kept apart, so that fine-tuning can continue its statistics. The graph must
            // not have another one.
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
            // A normaliser of another program has no statistics to continue, so it becomes part of the first
            // weights.
            (Some(before), None) => {
                let spread = |values: Vec<f64>, inputs: usize| match values[..] {
                    [one] => vec![one; inputs],
                    _ => values,
                };
                let memory = self.memory.as_mut().and_then(|memory| memory.layers.first_mut());
                if let Some(first) = memory {
                    let inputs = first.inputs;
                    let (factor, offset) = (spread(before.factor, inputs), spread(before.offset, inputs));
                    if factor.len() != inputs {
                        return Err(invalid(format!(
                            "its normaliser has {} numbers, its memory takes {inputs}",
                            factor.len()
                        )));
                    }
                    let (weight, bias) = (first.weight_ih.clone(), first.bias_ih.clone());
                    let outputs = bias.len();
                    let behind = Affine { inputs, outputs, weight, bias }.behind(&factor, &offset);
                    (first.weight_ih, first.bias_ih) = (behind.weight, behind.bias);
                } else if let Some(first) = self.layers.first_mut() {
                    let inputs = first.inputs;
                    let (factor, offset) = (spread(before.factor, inputs), spread(before.offset, inputs));
                    *first = first.behind(&factor, &offset);
                }
            }
            (None, None) => {}
        }
        if self.norms.len() == self.layers.len() && self.norms.last().is_some_and(Option::is_some) {
            return Err(invalid(
                "a layer norm stands behind its last layer; only hidden layers may have one",
            ));
        }
        let network = assemble(&self.layers, self.activation.unwrap_or_default(), self.norms)?;
        Ok(Read { memory: self.memory, network: Network { output: self.last, ..network }, clip })
    }
}
