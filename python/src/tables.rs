//! The paper's tables, whole and in parts.

use crate::errors::{failed, to_py_err, value};
use crate::watch::watched;
use gaitfit::machine;
use gaitfit::reproduce::{Part, Request, make, plan, run};
use pyo3::prelude::*;
use std::path::PathBuf;

/// What is asked of a table.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Table {
    table: String,
    full: bool,
    seeds: u64,
    only: Option<String>,
    sets: Vec<String>,
    experiments: PathBuf,
    threads: Option<usize>,
    device: String,
}

impl Table {
    fn request(self) -> PyResult<Request> {
        if self.seeds == 0 || self.threads == Some(0) {
            return Err(value("seeds and threads must be at least 1"));
        }
        Ok(Request {
            table: self.table,
            full: self.full,
            seeds: self.seeds,
            only: self.only,
            set: self.sets,
            experiments: self.experiments,
            threads: self.threads.unwrap_or_else(machine::threads),
            devices: self.device.parse().map_err(|wrong: String| value(format!("device: {wrong}")))?,
            jobs: None,
        })
    }
}

/// Runs a table or continues it.
#[pyfunction]
pub fn reproduce(py: Python<'_>, table: Table, progress: Option<Py<PyAny>>) -> PyResult<String> {
    let request = table.request()?;
    let found =
        watched(py, progress.as_ref(), None, |watch| run(&request, watch).map(|(results, _)| results))?;
    serde_json::to_string(&found.map_err(|error| to_py_err(&error))?).map_err(failed)
}

/// The parts of a table, and the files that they read.
#[pyfunction]
pub fn reproduce_plan(py: Python<'_>, table: Table) -> PyResult<String> {
    let request = table.request()?;
    let found = py.detach(|| plan(&request)).map_err(|error| to_py_err(&error))?;
    serde_json::to_string(&found).map_err(failed)
}

/// Makes one part, or goes on with it.
#[pyfunction]
pub fn reproduce_part(py: Python<'_>, table: Table, part: &str, progress: Option<Py<PyAny>>) -> PyResult<()> {
    let (request, part): (Request, Part) = (table.request()?, serde_json::from_str(part).map_err(value)?);
    watched(py, progress.as_ref(), None, |watch| make(&request, &part, watch))?
        .map_err(|error| to_py_err(&error))
}
