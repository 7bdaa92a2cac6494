//! Data of other programs about a policy, beside its network.

mod mjlab;
pub(super) mod sdk;
mod terms;
mod unitree;

pub(super) use mjlab::read as mjlab;
pub(super) use unitree::{beside as unitree_file, read as unitree};

/// Entries of a description that are known without one, and what was assumed for them, in words.
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Known {
    pub table: toml::Table,
    pub notes: Vec<Note>,
}

/// What was assumed.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Note {
    /// The entries that it is about: a description that gives them all needs no note.
    pub entries: &'static [&'static str],
    pub text: String,
}

/// Bounds beyond which a clipped observation counts as not clipped.
const FAR: f64 = 50.0;

/// A list of numbers for a table.
fn numbers(values: &[f64]) -> toml::Value {
    toml::Value::Array(values.iter().map(|&value| toml::Value::Float(value)).collect())
}

/// A list of names for a table.
fn names(values: &[String]) -> toml::Value {
    toml::Value::Array(values.iter().map(|name| toml::Value::String(name.clone())).collect())
}
