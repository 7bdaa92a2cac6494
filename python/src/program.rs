//! The program, in Python's process.

use crate::errors::failed;
use crate::watch::waited;
use pyo3::prelude::*;
use std::ffi::OsString;
use std::path::PathBuf;

/// Runs the program with what starts it and its arguments; its exit code.
#[pyfunction]
pub fn program(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| gaitfit_cli::program(arguments))
}

/// What logs show that the robot has and its model lacks, as JSON. Ctrl-C ends the waiting.
#[pyfunction]
pub fn explain(py: Python<'_>, robot: PathBuf, logs: PathBuf, lenient: bool) -> PyResult<String> {
    waited(py, move || gaitfit_cli::explain(&robot, &logs, lenient))?.map_err(failed)
}
