//! Logs as arrays.

use crate::errors::to_py_err;
use gaitfit::log_check;
use gaitfit_log::Trajectory;
use numpy::{PyArray1, PyArray2, PyArrayMethods};
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
    let (kp, kd) = log.gains.map(|gains| (gains.kp, gains.kd)).unzip();
    fields.set_item("kp", kp.map(|values| PyArray1::from_vec(py, values)))?;
    fields.set_item("kd", kd.map(|values| PyArray1::from_vec(py, values)))?;
    Ok(fields)
}
