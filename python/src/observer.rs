//! Observations of a policy from what a loop of the user reads.

use crate::errors::{failed, value};
use gaitfit_policy::observation::{Layout, Past, Sensed};
use gaitfit_policy::{Interface, MotionPlace, Quantity, clock};
use gaitfit_policy_files::Description;
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2};
use pyo3::exceptions::PyIndexError;
use pyo3::prelude::*;

/// What a call reads.
#[derive(Clone, Copy, PartialEq)]
enum Reading {
    /// A quantity that the policy observes, or that its place in a motion follows from.
    Quantity(Quantity),
    /// The base's orientation, wxyz, which a motion is turned by.
    Orientation,
}

impl Reading {
    fn name(self) -> &'static str {
        match self {
            Self::Quantity(quantity) => quantity.name(),
            Self::Orientation => "base_quaternion",
        }
    }

    fn width(self, joints: usize) -> usize {
        match self {
            Self::Quantity(quantity) => quantity.width(joints),
            Self::Orientation => 4,
        }
    }

    /// Puts numbers where they belong; false for a wrong number of them.
    fn set(self, sensed: &mut Sensed, numbers: &[f32]) -> bool {
        match self {
            Self::Quantity(quantity) => sensed.set(quantity, numbers),
            Self::Orientation => numbers.try_into().map(|found| sensed.orientation = found).is_ok(),
        }
    }
}

/// The policy's observations as the engine writes them. The Python class around it has the documentation and checks shapes.
#[pyclass(module = "gaitfit._gaitfit")]
pub struct Observer {
    interface: Interface,
    layout: Layout,
    /// What is read, without what the layout, the clock and the motion fill in.
    read: Vec<Reading>,
    past: Past,
    /// Control periods of each robot since its episode began.
    steps: Vec<u32>,
    /// Angle by which the motion is turned to face as each robot did at its episode's beginning, rad.
    headings: Vec<f64>,
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
        for quantity in interface.observation.iter().map(|term| term.quantity) {
            let turns = quantity == Quantity::ReferenceOrientation;
            let has_anchor = interface.reference.as_ref().is_some_and(|motion| !motion.anchor.is_empty());
            let readings = match quantity {
                Quantity::Constant | Quantity::EarlierAction => vec![],
                _ if turns && has_anchor => {
                    vec![Reading::Orientation, Reading::Quantity(Quantity::JointPosition)]
                }
                _ if turns => vec![Reading::Orientation],
                _ if quantity.is_of_clock() || quantity.is_of_reference() => vec![],
                _ => vec![Reading::Quantity(quantity)],
            };
            for reading in readings {
                if read.contains(&reading) {
                    continue;
                }
                if !reading.set(&mut sensed, &vec![0.0; reading.width(interface.joints.len())]) {
                    return Err(value(format!("an observer does not know {}", reading.name())));
                }
                read.push(reading);
            }
        }
        let (steps, headings) = (Vec::new(), Vec::new());
        Ok(Self { past: Past::new(&layout, 0), steps, headings, interface, layout, read, sensed })
    }

    /// What a call takes: names, each with its number of numbers.
    fn quantities(&self) -> Vec<(&'static str, usize)> {
        let joints = self.interface.joints.len();
        self.read.iter().map(|reading| (reading.name(), reading.width(joints))).collect()
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
            self.headings = vec![0.0; robots];
            self.past = Past::new(&self.layout, robots);
        }
        let width = self.layout.width();
        let mut rows = vec![0.0; robots * width];
        for (robot, row) in rows.chunks_exact_mut(width.max(1)).enumerate() {
            for (reading, numbers) in self.read.iter().zip(&given) {
                let numbers = numbers.as_array();
                let row_of_robot = numbers.row(if numbers.nrows() == 1 { 0 } else { robot });
                if !reading.set(&mut self.sensed, &row_of_robot.to_vec()) {
                    return Err(failed(format!("{} has a wrong number of numbers", reading.name())));
                }
            }
            self.sensed.clock = clock(&self.interface, self.steps[robot]);
            let time = f64::from(self.steps[robot]) * self.interface.control_dt;
            self.sensed.motion = MotionPlace { time, heading: 0.0 };
            if self.steps[robot] == 0 {
                self.headings[robot] = self.layout.motion_heading(&self.sensed);
            }
            self.sensed.motion.heading = self.headings[robot];
            self.layout.write(&self.sensed, self.past.row(robot), |_, _| (), row);
            self.past.set(robot, row);
            self.steps[robot] += 1;
        }
        PyArray1::from_vec(py, rows).reshape([robots, width])
    }
}
