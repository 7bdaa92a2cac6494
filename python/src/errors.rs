//! The library's errors as Python's.

use gaitfit::{Error, brief};
use pyo3::PyErr;
use pyo3::exceptions::{PyException, PyKeyboardInterrupt, PyValueError};

pyo3::create_exception!(
    gaitfit,
    GaitfitError,
    PyException,
    "A stage of gaitfit could not go on; the text says why, and what to do."
);

/// An error of the library; one that stopped because it was asked to is Python's own `KeyboardInterrupt`.
pub fn to_py_err(error: &Error) -> PyErr {
    match error {
        Error::Interrupted { .. } => PyKeyboardInterrupt::new_err(brief(&error.to_string()).into_owned()),
        _ => GaitfitError::new_err(brief(&error.to_string()).into_owned()),
    }
}

/// A wrong argument.
pub fn value(message: impl ToString) -> PyErr {
    PyValueError::new_err(brief(&message.to_string()).into_owned())
}

/// Anything else that failed.
pub fn failed(message: impl ToString) -> PyErr {
    GaitfitError::new_err(brief(&message.to_string()).into_owned())
}
