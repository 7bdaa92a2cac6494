//! The cost's distances on arrays.

use crate::errors::value;
use gaitfit_adapt::cost::wasserstein1_of_unsorted;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

/// The 1-D Wasserstein-1 distance of `a` and `b`, columns with the samples of one dimension each.
#[pyfunction]
pub fn wasserstein(
    py: Python<'_>,
    a: PyReadonlyArray2<'_, f64>,
    b: PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<f64>> {
    let (a, b) = (a.as_array(), b.as_array());
    if a.ncols() != b.ncols() {
        return Err(value(format!("a has {} columns and b has {}", a.ncols(), b.ncols())));
    }
    if a.nrows() == 0 || b.nrows() == 0 {
        return Err(value("there are no samples"));
    }
    py.detach(|| {
        (0..a.ncols())
            .map(|column| {
                let mut first: Vec<f64> = a.column(column).to_vec();
                let mut second: Vec<f64> = b.column(column).to_vec();
                wasserstein1_of_unsorted(&mut first, &mut second)
                    .ok_or_else(|| value(format!("column {column} has values that are not finite")))
            })
            .collect()
    })
}
