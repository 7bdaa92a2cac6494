//! Observations of a policy from what a loop of the user reads.

use crate::errors::{failed, value};
use gaitfit_policy::observation::{Layout, Past, Sensed};
use gaitfit_policy::{Description, Interface, Quantity, clock};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;

/// The policy's observations as the engine writes them. The Python class around it has the documentation and checks shapes.
#[pyclass(module = "gaitfit._gaitfit")]
pub struct Observer {
    interface: Interface,
    layout: Layout,
    /// What is read, without what the layout and the clock fill in.
    read: Vec<Quantity>,
    past: Past,
    /// Control periods of each robot since its episode began.
    steps: Vec<u32>,
    sensed: Sensed,
}

#[pymethods]
impl Observer {
    /// An observer for `interface`, which is JSON.
    #[new]
    fn new(interface: &str) -> PyResult<Self> {
        let description: Description = serde_json::from_str(interface).map_err(value)?;
        let interface = description.interface().map_err(value)?;
        let layout = Layout::new(&interface, &interface.observation);
        let mut sensed = Sensed::new(interface.joints.len());
        let mut read = Vec::new();
        for term in &interface.observation {
            let quantity = term.quantity;
            let filled = quantity.is_of_clock()
                || matches!(quantity, Quantity::Constant | Quantity::EarlierAction)
                || read.contains(&quantity);
            if filled {
                continue;
            }
            if !sensed.set(quantity, &vec![0.0; quantity.width(interface.joints.len())]) {
                return Err(value(format!("an observer does not know {}", quantity.name())));
            }
            read.push(quantity);
        }
        Ok(Self { past: Past::new(&layout, 0), steps: Vec::new(), interface, layout, read, sensed })
    }

    /// What a call takes: names, each with its number of numbers.
    fn quantities(&self) -> Vec<(&'static str, usize)> {
        let joints = self.interface.joints.len();
        self.read.iter().map(|quantity| (quantity.name(), quantity.width(joints))).collect()
    }

    /// Robots that are observed; 0 before the first call.
    #[getter]
    fn robots(&self) -> usize {
        self.steps.len()
    }

    /// The episodes of these robots begin. Without rows those of all do, which may be another number then.
    fn reset(&mut self, rows: Option<Vec<usize>>) -> PyResult<()> {
        let Some(rows) = rows else {
            self.steps.clear();
            return Ok(());
        };
        if let Some(row) = rows.iter().find(|&&row| row >= self.steps.len()) {
            let robots = self.steps.len();
            return Err(PyIndexError::new_err(format!("there is no robot {row}; {robots} are observed")));
        }
        for row in rows {
            self.steps[row] = 0;
            self.past.begin(row);
        }
        Ok(())
    }

    /// The rows of `robots` robots. `given`: numbers of each of [`Self::quantities`], in their order, `robots` rows or one for all.
    fn observe<'py>(
        &mut self,
        py: Python<'py>,
        robots: usize,
        given: Vec<PyReadonlyArray2<'py, f32>>,
    ) -> PyResult<Bound<'py, PyArray2<f32>>> {
        if self.steps.is_empty() {
            self.steps = vec![0; robots];
            self.past = Past::new(&self.layout, robots);
        }
        let width = self.layout.width();
        let mut rows = vec![0.0; robots * width];
        for (robot, row) in rows.chunks_exact_mut(width.max(1)).enumerate() {
            for (quantity, numbers) in self.read.iter().zip(&given) {
                let numbers = numbers.as_array();
                let row_of_robot = numbers.row(if numbers.nrows() == 1 { 0 } else { robot });
                if !self.sensed.set(*quantity, &row_of_robot.to_vec()) {
                    return Err(failed(format!("{} has a wrong number of numbers", quantity.name())));
                }
            }
            self.sensed.clock = clock(&self.interface, self.steps[robot]);
            self.layout.write(&self.sensed, self.past.row(robot), |_, _| (), row);
            self.past.set(robot, row);
            self.steps[robot] += 1;
        }
        PyArray1::from_vec(py, rows).reshape([robots, width])
    }
}
