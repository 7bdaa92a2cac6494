//! Logs as arrays.

use crate::errors::{failed, to_py_err};
use gaitfit::log_check;
use gaitfit_log::{BaseState, CheckSpec, Gains, Lead, Trajectory, check, write_csv};
use numpy::{PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2};
use pyo3::prelude::*;
use pyo3::types::PyDict;
use std::path::PathBuf;

/// The log of a CSV file, as a dictionary of arrays. The Python function around it has the documentation.
#[pyfunction]
pub fn read_log<'py>(py: Python<'py>, path: PathBuf, allow: Vec<String>) -> PyResult<Bound<'py, PyDict>> {
    let log: Trajectory = py.detach(|| log_check::read(&path, &allow)).map_err(|error| to_py_err(&error))?;
    let (rows, width) = (log.time.len(), log.joints.len());
    let matrix = |values: Vec<f64>, width: usize| -> PyResult<Bound<'py, PyArray2<f64>>> {
        PyArray1::from_vec(py, values).reshape([rows, width])
    };
    let fields = PyDict::new(py);
    fields.set_item("joints", log.joints)?;
    fields.set_item("time", PyArray1::from_vec(py, log.time))?;
    fields.set_item("dt", 1.0 / log.rate_hz)?;
    fields.set_item("position", matrix(log.position, width)?)?;
    fields.set_item("velocity", matrix(log.velocity, width)?)?;
    fields.set_item("target", log.target.map(|values| matrix(values, width)).transpose()?)?;
    fields.set_item("action", log.action.map(|values| matrix(values, width)).transpose()?)?;
    fields.set_item("command", log.command.map(|values| matrix(values, 3)).transpose()?)?;
    let base = log.base.unwrap_or_default();
    fields.set_item("base_position", base.position.map(|values| matrix(values, 3)).transpose()?)?;
    fields.set_item("base_quaternion", base.quaternion.map(|values| matrix(values, 4)).transpose()?)?;
    fields.set_item(
        "base_linear_velocity",
        base.linear_velocity.map(|values| matrix(values, 3)).transpose()?,
    )?;
    fields.set_item(
        "base_angular_velocity",
        base.angular_velocity.map(|values| matrix(values, 3)).transpose()?,
    )?;
    let (kp, kd) = log.gains.map(|gains| (gains.kp, gains.kd)).unzip();
    fields.set_item("kp", kp.map(|values| PyArray1::from_vec(py, values)))?;
    fields.set_item("kd", kd.map(|values| PyArray1::from_vec(py, values)))?;
    fields.set_item("robot", log.robot)?;
    fields.set_item("motion", log.motion.map(|values| matrix(values, 2)).transpose()?)?;
    fields.set_item("target_lead", log.lead.map(|lead| (lead.seconds, lead.spread)))?;
    fields.set_item("velocity_joints", log.velocity_joints)?;
    fields.set_item("simulated_step", log.simulated_step)?;
    fields.set_item("fell", log.fell)?;
    Ok(fields)
}

/// A log of Python's arrays; matrices have one row a sample.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Arrays<'py> {
    joints: Vec<String>,
    rate_hz: f64,
    time: PyReadonlyArray1<'py, f64>,
    position: PyReadonlyArray2<'py, f64>,
    velocity: PyReadonlyArray2<'py, f64>,
    target: Option<PyReadonlyArray2<'py, f64>>,
    action: Option<PyReadonlyArray2<'py, f64>>,
    command: Option<PyReadonlyArray2<'py, f64>>,
    base_position: Option<PyReadonlyArray2<'py, f64>>,
    base_quaternion: Option<PyReadonlyArray2<'py, f64>>,
    base_linear_velocity: Option<PyReadonlyArray2<'py, f64>>,
    base_angular_velocity: Option<PyReadonlyArray2<'py, f64>>,
    kp: Option<Vec<f64>>,
    kd: Option<Vec<f64>>,
    motion: Option<PyReadonlyArray2<'py, f64>>,
    target_lead: Option<(f64, f64)>,
    velocity_joints: Vec<String>,
    robot: Option<String>,
    simulated_step: Option<f64>,
    fell: bool,
}

impl Arrays<'_> {
    fn trajectory(&self) -> Trajectory {
        let matrix =
            |array: &PyReadonlyArray2<'_, f64>| -> Vec<f64> { array.as_array().iter().copied().collect() };
        let maybe = |array: &Option<PyReadonlyArray2<'_, f64>>| array.as_ref().map(matrix);
        let time = self.time.as_array().to_vec();
        let (position, velocity) = (matrix(&self.position), matrix(&self.velocity));
        let base = BaseState {
            position: maybe(&self.base_position),
            quaternion: maybe(&self.base_quaternion),
            linear_velocity: maybe(&self.base_linear_velocity),
            angular_velocity: maybe(&self.base_angular_velocity),
        };
        let gains = self.kp.clone().zip(self.kd.clone()).map(|(kp, kd)| Gains { kp, kd });
        Trajectory {
            robot: self.robot.clone(),
            target: maybe(&self.target),
            action: maybe(&self.action),
            command: maybe(&self.command),
            base: (base != BaseState::default()).then_some(base),
            gains,
            motion: maybe(&self.motion),
            lead: self.target_lead.map(|(seconds, spread)| Lead { seconds, spread }),
            velocity_joints: self.velocity_joints.clone(),
            simulated_step: self.simulated_step,
            fell: self.fell,
            ..Trajectory::of_joints(self.joints.clone(), self.rate_hz, time, position, velocity)
        }
    }
}

/// Writes a log as CSV, exactly and whole.
#[pyfunction]
pub fn write_log(py: Python<'_>, path: PathBuf, log: Arrays<'_>) -> PyResult<()> {
    let log = log.trajectory();
    py.detach(|| write_csv(&path, &log)).map_err(failed)
}

/// What the checks find in a log, as JSON.
#[pyfunction]
pub fn check_log(py: Python<'_>, log: Arrays<'_>) -> PyResult<String> {
    let log = log.trajectory();
    let found = py.detach(|| check(&log, &CheckSpec::default()));
    serde_json::to_string(&found).map_err(failed)
}
