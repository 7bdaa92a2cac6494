//! A multilayer perceptron at work: parameters and inference.

use aligned_vec::{AVec, avec};
use gaitfit_random::{Purpose, Stream};

use super::{Activation, LayerNorm, Normaliser, Shape, ShapeError, forward, lanes};

/// Rows that pass through all layers together, so that their activations stay in the second-level cache.
const TILE: usize = 256;

/// A network: its shape and its parameters in the order of [`Shape::layers`].
#[derive(Clone, Debug, PartialEq)]
pub struct Network {
    /// Layer sizes and activation.
    pub shape: Shape,
    /// All weights and biases, [`Shape::parameters`] of them, from a cache line's beginning on.
    pub parameters: AVec<f32>,
    /// Layer norms of the sums of each hidden layer before its activation; layers beyond the list have none.
    /// For inference: trainings refuse it.
    pub norms: Vec<Option<LayerNorm>>,
    /// Function of the output. Without one, the output is linear.
    pub output: Option<Activation>,
}

/// Working memory of networks; one a thread, kept between calls. Any network may use it.
#[derive(Clone, Debug)]
pub struct Scratch {
    /// Two buffers that the layers take in turn.
    buffers: [AVec<f32>; 2],
    /// The input of the first layer, where there is a normaliser.
    normalised: Vec<f32>,
    /// Results of the operators of a graph.
    values: Vec<Vec<f32>>,
}

impl Default for Scratch {
    fn default() -> Self {
        Self { buffers: [AVec::new(0), AVec::new(0)], normalised: Vec::new(), values: Vec::new() }
    }
}

impl Scratch {
    /// Empty; it grows at the first use.
    pub fn new() -> Self {
        Self::default()
    }

    /// Results of the operators of a graph, a list each.
    pub(crate) fn values(&mut self) -> &mut Vec<Vec<f32>> {
        &mut self.values
    }
}

impl Network {
    /// A network of given parameters.
    ///
    /// # Errors
    /// [`ShapeError`] if a layer is empty or the parameters are not as many as the shape needs.
    pub fn new(shape: Shape, parameters: &[f32]) -> Result<Self, ShapeError> {
        let parameters = AVec::from_slice(0, parameters);
        let network = Self { shape, parameters, norms: Vec::new(), output: None };
        network.check()?;
        Ok(network)
    }

    /// A network that passes `width` numbers on.
    ///
    /// # Errors
    /// No numbers at all.
    pub fn identity(width: usize) -> Result<Self, ShapeError> {
        let shape = Shape { inputs: width, hidden: Vec::new(), outputs: width, activation: Activation::Elu };
        let mut parameters = vec![0.0; shape.parameters()];
        // The diagonal of the weight; biases behind it stay 0.
        (0..width).for_each(|number| parameters[number * (width + 1)] = 1.0);
        Self::new(shape, &parameters)
    }

    /// Why it cannot be trained, in words; `None` for a network that can.
    pub fn untrainable(&self) -> Option<String> {
        self.norms.iter().any(Option::is_some).then(|| "layer norm".to_owned())
    }

    /// Refuses what [`Network::new`] refuses.
    ///
    /// # Errors
    /// As there.
    pub fn check(&self) -> Result<(), ShapeError> {
        self.shape.check()?;
        let (expected, found) = (self.shape.parameters(), self.parameters.len());
        if found != expected {
            return Err(ShapeError::Parameters { shape: self.shape.to_string(), expected, found });
        }
        for (number, norm) in self.norms.iter().enumerate() {
            let Some(norm) = norm else { continue };
            let (found, expected) = (norm.weight.len(), self.shape.hidden.get(number).copied().unwrap_or(0));
            let positive = norm.epsilon > 0.0 && norm.epsilon.is_finite();
            if found != expected || norm.bias.len() != found || !positive {
                return Err(ShapeError::Norm { layer: number + 1, expected, found });
            }
        }
        Ok(())
    }

    /// Random parameters, uniform in ±1/√inputs for weights and biases alike (the usual choice of PyTorch's
    /// `Linear`); those of the last layer are multiplied by `output_gain`. Draws are [`Purpose::WEIGHTS`] of `seed`
    /// at environment `index` (which network of the run it is) and step = layer.
    ///
    /// # Errors
    /// [`ShapeError::EmptyLayer`].
    pub fn random(shape: Shape, seed: u64, index: u32, output_gain: f64) -> Result<Self, ShapeError> {
        shape.check()?;
        let mut parameters = avec![0.0; shape.parameters()];
        let layers = shape.layers();
        for (number, layer) in layers.iter().enumerate() {
            let stream = Stream::new(seed, Purpose::WEIGHTS).environment(index).step(number as u32);
            let gain = if number + 1 == layers.len() { output_gain } else { 1.0 };
            let bound = (gain / (layer.inputs as f64).sqrt()) as f32;
            for (draw, parameter) in parameters[layer.weight.start..layer.bias.end].iter_mut().enumerate() {
                *parameter = (2.0 * stream.uniform_f32(draw as u32) - 1.0) * bound;
            }
        }
        Ok(Self { shape, parameters, norms: Vec::new(), output: None })
    }

    /// [`Network::forward`] of `input` as `normaliser`, if there is one, makes it.
    ///
    /// # Panics
    /// As there.
    pub fn forward_normalised(
        &self,
        normaliser: Option<&Normaliser>,
        rows: usize,
        input: &[f32],
        output: &mut [f32],
        scratch: &mut Scratch,
    ) {
        let Some(normaliser) = normaliser else { return self.forward(rows, input, output, scratch) };
        // Taken out for the while, because `forward` borrows the scratch as a whole.
        let mut normalised = std::mem::take(&mut scratch.normalised);
        let size = rows * self.shape.inputs;
        normalised.resize(size, 0.0);
        normaliser.apply(&input[..size], &mut normalised);
        self.forward(rows, &normalised, output, scratch);
        scratch.normalised = normalised;
    }

    /// Evaluates `rows` rows: `input` is `rows × inputs`, `output` `rows × outputs`, both row-major. Runs on the
    /// calling thread; the same rows in the same call give the same bits.
    ///
    /// # Panics
    /// If a slice is shorter than its size: an error of the caller.
    pub fn forward(&self, rows: usize, input: &[f32], output: &mut [f32], scratch: &mut Scratch) {
        let layers = self.shape.layers();
        let (inputs, outputs) = (self.shape.inputs, self.shape.outputs);
        // A tile's activations are at most as wide as the widest layer; fewer rows than a tile need less.
        let size = TILE.min(rows) * self.shape.widest();
        // Other networks use the scratch too, so it grows and never shrinks.
        for buffer in &mut scratch.buffers {
            if buffer.len() < size {
                buffer.resize(size, 0.0);
            }
        }
        let [even, odd] = &mut scratch.buffers;
        let tiles = input[..rows * inputs].chunks(TILE * inputs);
        for (input, output) in tiles.zip(output[..rows * outputs].chunks_mut(TILE * outputs)) {
            let rows = input.len() / inputs;
            for index in 0..layers.len() {
                // Two buffers in turn: a layer reads what the one before it wrote.
                let (from, to) = if index % 2 == 0 { (&*odd, &mut *even) } else { (&*even, &mut *odd) };
                let from = if index == 0 { input } else { from };
                let to = if index + 1 == layers.len() { &mut *output } else { to };
                let activation = self.shape.activation;
                match self.norms.get(index).and_then(Option::as_ref) {
                    Some(norm) => {
                        let layer = &layers[index];
                        forward::normed_layer(layer, norm, activation, &self.parameters, rows, from, to);
                    }
                    None => forward::layer(&layers, index, activation, &self.parameters, rows, from, to),
                }
            }
            if let Some(activation) = self.output {
                // The last layer has added its bias, so that of the kernel is zero.
                lanes::add_bias_and_activate(output, &vec![0.0; outputs], activation);
            }
        }
    }
}
