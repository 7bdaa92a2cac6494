//! Policies of files that act on Python's arrays.

use crate::errors::{failed, value};
use gaitfit_policy::network::{Memory, Network, Recurrent, Scratch};
use gaitfit_policy::{Encoder, Front, Latent, Policy};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// Numbers of some robots, one row each.
type Rows<'py> = Bound<'py, PyArray2<f32>>;

/// A policy's file at work. The Python class around it has the documentation.
#[pyclass(module = "gaitfit._gaitfit")]
pub struct PolicyFile {
    policy: Policy,
    memory: Memory,
    /// Robots that the memory is of.
    robots: usize,
    scratch: Scratch,
    /// What it sees and does, as JSON.
    #[pyo3(get)]
    interface: String,
    /// Settings of its task, as TOML; may be empty.
    #[pyo3(get)]
    task: String,
    /// Whether it remembers what it observed.
    #[pyo3(get)]
    is_recurrent: bool,
    /// Numbers that it remembers of one robot.
    #[pyo3(get)]
    state_width: usize,
    /// What was assumed when it was read.
    #[pyo3(get)]
    notes: Vec<String>,
}

#[pymethods]
impl PolicyFile {
    /// Reads a policy of any kind that the program reads.
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let policy = py.detach(|| gaitfit_policy_files::read(&path)).map_err(failed)?;
        Ok(Self {
            memory: Memory::default(),
            robots: 0,
            scratch: Scratch::new(),
            interface: serde_json::to_string(&policy.interface).map_err(failed)?,
            task: policy.provenance.task.clone(),
            is_recurrent: policy.is_recurrent(),
            state_width: policy.memory(1).width(),
            notes: policy.notes.clone(),
            policy,
        })
    }

    /// Mean actions, `rows × joints`, for observations, `rows × width`. A memory of another number of rows begins anew.
    fn act<'py>(&mut self, py: Python<'py>, observation: PyReadonlyArray2<'py, f32>) -> PyResult<Rows<'py>> {
        let (rows, observation) = self.checked(&observation)?;
        if self.robots != rows {
            (self.memory, self.robots) = (self.policy.memory(rows), rows);
        }
        let mut memory = std::mem::take(&mut self.memory);
        let actions = py.detach(|| self.computed(rows, &observation, &mut memory));
        self.memory = memory;
        PyArray1::from_vec(py, actions).reshape([rows, self.policy.interface.joints.len()])
    }

    /// The same from a given state, `rows × state_width`, and the state afterwards. The memory of [`Self::act`] stays.
    fn act_from<'py>(
        &mut self,
        py: Python<'py>,
        observation: PyReadonlyArray2<'py, f32>,
        state: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<(Rows<'py>, Rows<'py>)> {
        let (rows, observation) = self.checked(&observation)?;
        let wide = self.state_width;
        if state.as_array().dim() != (rows, wide) {
            let [given, numbers] = [state.as_array().nrows(), state.as_array().ncols()];
            return Err(value(format!(
                "the state has the shape ({given}, {numbers}); needed: ({rows}, {wide}), what the last predict returned, or None"
            )));
        }
        let mut memory = self.policy.memory(rows);
        for (row, numbers) in state.as_array().rows().into_iter().enumerate() {
            memory.set_row(row, &numbers.to_vec());
        }
        let actions = py.detach(|| self.computed(rows, &observation, &mut memory));
        let mut after = Vec::with_capacity(rows * wide);
        (0..rows).for_each(|row| memory.append_row(row, &mut after));
        let actions = PyArray1::from_vec(py, actions).reshape([rows, self.policy.interface.joints.len()])?;
        Ok((actions, PyArray1::from_vec(py, after).reshape([rows, wide])?))
    }

    /// The episodes of these rows begin: the policy forgets them. Without rows all do.
    fn reset(&mut self, rows: Option<Vec<usize>>) -> PyResult<()> {
        let Some(rows) = rows else {
            self.memory = self.policy.memory(self.robots);
            return Ok(());
        };
        if let Some(row) = rows.iter().find(|&&row| row >= self.robots) {
            return Err(value(format!("there is no row {row}; the policy acted for {} robots", self.robots)));
        }
        rows.into_iter().for_each(|row| self.memory.begin(row));
        Ok(())
    }

    /// The policy's networks, for other libraries: `scale` and `offset` of its input, the actor, and what stands before it,
    /// `recurrent` or `encoder`. A graph of operators is refused.
    fn networks<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let fields = network(py, &self.policy.actor)?;
        match &self.policy.front {
            None => {}
            Some(Front::Recurrent(memory)) => fields.set_item("recurrent", recurrent(py, memory)?)?,
            Some(Front::Encoder(front)) => fields.set_item("encoder", encoder(py, front)?)?,
            Some(Front::Graph(graph)) => return Err(value(format!("the policy is {}", graph.describe()))),
            Some(Front::Function(_)) => return Err(value("the policy is a function")),
        }
        let (scale, offset): (Vec<f32>, Vec<f32>) =
            self.policy.normaliser.as_ref().map(|one| one.scale().into_iter().unzip()).unwrap_or_default();
        fields.set_item("scale", PyArray1::from_vec(py, scale))?;
        fields.set_item("offset", PyArray1::from_vec(py, offset))?;
        Ok(fields)
    }
}

impl PolicyFile {
    /// Rows and numbers of an observation.
    fn checked(&self, observation: &PyReadonlyArray2<'_, f32>) -> PyResult<(usize, Vec<f32>)> {
        let (rows, width) = observation.as_array().dim();
        let needed = self.policy.interface.observation_width();
        if width != needed {
            return Err(value(format!(
                "the observation has {width} numbers a row; the policy needs {needed} (policy.interface.observation_width)"
            )));
        }
        Ok((rows, observation.as_array().iter().copied().collect()))
    }

    /// The mean actions, `rows × joints`.
    fn computed(&mut self, rows: usize, observation: &[f32], memory: &mut Memory) -> Vec<f32> {
        let mut actions = vec![0.0; rows * self.policy.interface.joints.len()];
        self.policy.act_with(rows, observation, memory, &mut actions, &mut self.scratch);
        actions
    }
}

/// Recurrent layers: the cell's name, and of each layer weights `gates · units × inputs` and biases, in PyTorch's order.
fn recurrent<'py>(py: Python<'py>, memory: &Recurrent) -> PyResult<Bound<'py, PyDict>> {
    let mut layers = Vec::new();
    for layer in &memory.layers {
        let wide = layer.bias_ih.len();
        let weight = |values: &[f32], inputs: usize| {
            PyArray1::from_slice(py, values).reshape([inputs, wide])?.transpose()
        };
        let biases = [&layer.bias_ih, &layer.bias_hh].map(|values| PyArray1::from_slice(py, values));
        layers.push((
            weight(&layer.weight_ih, layer.inputs)?,
            weight(&layer.weight_hh, layer.hidden)?,
            biases,
        ));
    }
    let fields = PyDict::new(py);
    fields.set_item("cell", memory.cell.name())?;
    fields.set_item("layers", layers)?;
    Ok(fields)
}

/// The encoder of a two-part policy: its network, which numbers the actor sees too, and whether the latent stands first.
fn encoder<'py>(py: Python<'py>, front: &Encoder) -> PyResult<Bound<'py, PyDict>> {
    let fields = network(py, &front.network)?;
    fields.set_item("passed", front.passed.clone())?;
    fields.set_item("latent_first", front.latent == Latent::First)?;
    Ok(fields)
}

/// A network's layers: weights `outputs × inputs`, biases, norms, and the functions after them.
fn network<'py>(py: Python<'py>, network: &Network) -> PyResult<Bound<'py, PyDict>> {
    let mut layers = Vec::new();
    for (number, layer) in network.shape.layers().into_iter().enumerate() {
        let weight = PyArray1::from_slice(py, &network.parameters[layer.weight.clone()])
            .reshape([layer.inputs, layer.outputs])?
            .transpose()?;
        let bias = PyArray1::from_slice(py, &network.parameters[layer.bias.clone()]);
        let norm = network.norms.get(number).and_then(Option::as_ref).map(|norm| {
            let [weight, bias] = [&norm.weight, &norm.bias].map(|values| PyArray1::from_slice(py, values));
            (weight, bias, norm.epsilon)
        });
        layers.push((weight, bias, norm));
    }
    let fields = PyDict::new(py);
    fields.set_item("layers", layers)?;
    let activation = network.shape.activation;
    fields.set_item("activation", (activation.name(), activation.parameter()))?;
    fields.set_item("output", network.output.map(|output| (output.name(), output.parameter())))?;
    Ok(fields)
}
