//! Policies of files that act on Python's arrays.

use crate::errors::{failed, value};
use gaitfit_policy::network::{Memory, Network, Scratch};
use gaitfit_policy::{Front, Policy};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

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
    /// What was assumed when it was read.
    #[pyo3(get)]
    notes: Vec<String>,
}

#[pymethods]
impl PolicyFile {
    /// Reads a policy of any kind that the program reads.
    #[new]
    fn new(py: Python<'_>, path: PathBuf) -> PyResult<Self> {
        let policy = py.detach(|| gaitfit_policy::read(&path)).map_err(failed)?;
        Ok(Self {
            memory: Memory::default(),
            robots: 0,
            scratch: Scratch::new(),
            interface: serde_json::to_string(&policy.interface).map_err(failed)?,
            task: policy.provenance.task.clone(),
            is_recurrent: policy.is_recurrent(),
            notes: policy.notes.clone(),
            policy,
        })
    }

    /// Mean actions, `rows × joints`, for observations, `rows × width`. A memory of another number of rows begins anew.
    fn act<'py>(
        &mut self,
        py: Python<'py>,
        observation: PyReadonlyArray2<'py, f32>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        let (rows, width) = observation.as_array().dim();
        let needed = self.policy.interface.observation_width();
        if width != needed {
            return Err(value(format!(
                "the observation has {width} numbers a row; the policy needs {needed} (policy.interface.observation_width)"
            )));
        }
        let observation: Vec<f32> = observation.as_array().iter().copied().collect();
        let joints = self.policy.interface.joints.len();
        let mut actions = vec![0.0; rows * joints];
        if self.robots != rows {
            (self.memory, self.robots) = (self.policy.memory(rows), rows);
        }
        let Self { policy, memory, scratch, .. } = self;
        py.detach(|| policy.act_with(rows, &observation, memory, &mut actions, scratch));
        PyArray1::from_vec(py, actions).reshape([rows, joints])
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

    /// The actor, for other libraries: `scale` and `offset` of its input, and its network. A policy with more than that
    /// is refused.
    fn actor<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        match &self.policy.front {
            None => {}
            Some(Front::Recurrent(memory)) => {
                return Err(value(format!("the policy has a memory ({})", memory.cell.name())));
            }
            Some(Front::Graph(graph)) => {
                return Err(value(format!("the policy is {}", graph.describe())));
            }
            Some(_) => return Err(value("the policy has two networks")),
        }
        let fields = network(py, &self.policy.actor)?;
        let (scale, offset): (Vec<f32>, Vec<f32>) =
            self.policy.normaliser.as_ref().map(|one| one.scale().into_iter().unzip()).unwrap_or_default();
        fields.set_item("scale", PyArray1::from_vec(py, scale))?;
        fields.set_item("offset", PyArray1::from_vec(py, offset))?;
        Ok(fields)
    }
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
