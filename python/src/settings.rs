//! Settings as text.

use crate::errors::{failed, to_py_err, value};
use gaitfit::settings::{self, AdaptConfig, Configuration, FinetuneConfig, LoopConfig, TrainConfig};
use pyo3::prelude::*;
use serde::Serialize;

/// A TOML text as JSON; a wrong one has its line and column.
#[pyfunction]
pub fn read_toml(text: &str) -> PyResult<String> {
    let table: toml::Table =
        text.parse().map_err(|error: toml::de::Error| value(error.to_string().trim_end()))?;
    serde_json::to_string(&table).map_err(failed)
}

/// All settings of a stage as TOML, after `sets`: what a run with them takes.
#[pyfunction]
pub fn resolve_settings(stage: &str, sets: Vec<String>) -> PyResult<String> {
    match stage {
        "fit" => resolved::<AdaptConfig>(&sets),
        "train" => resolved::<TrainConfig>(&sets),
        "finetune" => resolved::<FinetuneConfig>(&sets),
        "loop" => resolved::<LoopConfig>(&sets),
        _ => Err(value(format!("there is no stage {stage}"))),
    }
}

fn resolved<C: Configuration + Serialize>(sets: &[String]) -> PyResult<String> {
    let config: C = settings::load(None, sets).map_err(|error| to_py_err(&error))?;
    toml::to_string(&config).map_err(failed)
}
