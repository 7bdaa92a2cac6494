//! The program, in Python's process.

use pyo3::prelude::*;
use std::ffi::OsString;

/// Runs the program with what starts it and its arguments; its exit code.
#[pyfunction]
pub fn program(py: Python<'_>, arguments: Vec<OsString>) -> u8 {
    py.detach(|| gaitfit_cli::program(arguments))
}
