//! The cost's distances on arrays.

use crate::errors::value;
use gaitfit_adapt::cost::wasserstein1_of_columns;
use numpy::PyReadonlyArray2;
use pyo3::prelude::*;

/// The 1-D Wasserstein-1 distance of two arrays, columns with the samples of one dimension each.
#[pyfunction]
pub fn wasserstein(
    py: Python<'_>,
    a: PyReadonlyArray2<'_, f64>,
    b: PyReadonlyArray2<'_, f64>,
) -> PyResult<Vec<f64>> {
    let ((samples, columns), (others, found)) = (a.as_array().dim(), b.as_array().dim());
    if columns != found {
        return Err(value(format!("a has {columns} columns and b has {found}")));
    }
    if samples == 0 || others == 0 {
        return Err(value("there are no samples"));
    }
    let rows = |array: &PyReadonlyArray2<'_, f64>| -> Vec<f64> {
        array.as_slice().map_or_else(|_| array.as_array().iter().copied().collect(), <[f64]>::to_vec)
    };
    let (a, b) = (rows(&a), rows(&b));
    py.detach(|| wasserstein1_of_columns(&a, &b, columns))
        .map_err(|column| value(format!("column {column} has values that are not finite")))
}
