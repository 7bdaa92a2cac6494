//! Policies that are functions of Python.

use crate::errors::{failed, value};
use gaitfit::Error;
use gaitfit_policy::Policy;
use gaitfit_policy_files::Description;
use pyo3::prelude::*;
use std::path::PathBuf;

/// A policy: a file, or a function and what it sees and does.
#[derive(FromPyObject)]
pub enum Source {
    /// A file.
    File(PathBuf),
    /// A function.
    Own(Own),
}

/// A function in a policy's place.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Own {
    /// What it is called in results and messages.
    name: String,
    /// What it sees and does, as JSON.
    interface: String,
    /// Settings of its task as TOML, or nothing.
    task: String,
    /// Observations, `rows × width`, in; actions, `rows × joints`, out.
    act: Py<PyAny>,
}

impl Source {
    /// What it is called: its path, or the function's name.
    pub fn name(&self) -> PathBuf {
        match self {
            Self::File(path) => path.clone(),
            Self::Own(own) => own.name.clone().into(),
        }
    }

    /// The function, if it is one.
    pub fn act(&self) -> Option<&Py<PyAny>> {
        match self {
            Self::File(_) => None,
            Self::Own(own) => Some(&own.act),
        }
    }

    /// The policy whose actions `act` fills in, if it is a function; see [`crate::watch::Caller::act`].
    ///
    /// # Errors
    /// An interface that contradicts itself.
    pub fn policy(
        &self,
        act: impl Fn(usize, &[f32], &mut [f32]) -> bool + Send + Sync + 'static,
    ) -> Result<Option<Policy>, Error> {
        let Self::Own(own) = self else { return Ok(None) };
        let wrong = |error: &dyn std::fmt::Display| Error::settings(format!("{}: {error}", own.name));
        let description: Description = serde_json::from_str(&own.interface).map_err(|error| wrong(&error))?;
        let interface = description.interface().map_err(|error| wrong(&error))?;
        let mut policy =
            Policy::of_function(interface, std::sync::Arc::new(act)).map_err(|error| wrong(&error))?;
        policy.provenance.task.clone_from(&own.task);
        Ok(Some(policy))
    }
}

/// The interface of a policy's file, or of a description without weights, as JSON, and the settings of its task.
#[pyfunction]
pub fn interface_of(path: PathBuf) -> PyResult<(String, String)> {
    let (interface, task) = gaitfit_policy_files::interface_of(&path).map_err(failed)?;
    Ok((serde_json::to_string(&interface).map_err(failed)?, task))
}

/// Refuses an interface, as JSON, that contradicts itself; gives the width of its observation.
#[pyfunction]
pub fn observation_width(interface: &str) -> PyResult<usize> {
    let description: Description = serde_json::from_str(interface).map_err(value)?;
    Ok(description.interface().map_err(value)?.observation_width())
}
