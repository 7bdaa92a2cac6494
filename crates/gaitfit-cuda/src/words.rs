//! Numbers and tables at the head of kernels' texts.

use std::fmt::Write;

use gaitfit_policy::network::{Activation, SELU};

use crate::spots::Spot;

/// A text in the making.
pub(crate) struct Words {
    pub text: String,
}

impl Words {
    pub fn define(&mut self, name: &str, value: impl std::fmt::Display) {
        // Writing to a string does not fail.
        let _ = writeln!(self.text, "#define {name} {value}");
    }

    /// A table of which the threads of a warp read the same places. An empty table has one entry of zeros.
    pub fn table(&mut self, kind: &str, name: &str, rows: Vec<String>) {
        self.rows_in("TABLE", kind, name, rows);
    }

    /// A table of which threads read places of their own. An empty table has one entry of zeros.
    pub fn lookup(&mut self, kind: &str, name: &str, rows: Vec<String>) {
        self.rows_in("LOOKUP", kind, name, rows);
    }

    fn rows_in(&mut self, memory: &str, kind: &str, name: &str, mut rows: Vec<String>) {
        if rows.is_empty() {
            // C has no arrays without entries.
            rows.push(if kind == "int" || kind == "float" { "0".into() } else { "{}".into() });
        }
        let _ = writeln!(self.text, "{memory} {kind} {name}[] = {{{}}};", rows.join(", "));
    }

    /// A table of places.
    pub fn spots(&mut self, name: &str, spots: &[Spot]) {
        let rows = spots.iter().map(|spot| format!("{{{}, {}}}", spot.base, spot.stride)).collect();
        self.table("Spot", name, rows);
    }

    /// A table of whole numbers.
    pub fn integers(&mut self, name: &str, numbers: &[usize]) {
        self.table("int", name, numbers.iter().map(ToString::to_string).collect());
    }

    /// A table of numbers.
    pub fn singles(&mut self, name: &str, numbers: &[f32]) {
        self.table("float", name, numbers.iter().map(|&x| single(x)).collect());
    }
}

/// Functions of a layer's sums, as the kernels name them.
pub(crate) const FUNCTIONS: [&str; 8] =
    ["LINEAR", "EXPONENTIAL", "RECTIFIED", "LEAKY", "TANGENT", "SILU", "GELU", "GELU_TANH"];

/// The kernels' name of an activation, and its two parameters.
pub(crate) fn function(activation: Activation) -> (&'static str, f32, f32) {
    match activation {
        // ELU, with other parameters, and SELU are λ x above 0 and λ α (eˣ − 1) below.
        Activation::Elu => ("EXPONENTIAL", 1.0, 1.0),
        Activation::EluOf(alpha) => ("EXPONENTIAL", alpha, 1.0),
        Activation::Selu => ("EXPONENTIAL", SELU[0] as f32, SELU[1] as f32),
        Activation::Relu => ("RECTIFIED", 0.0, 0.0),
        Activation::LeakyRelu(slope) => ("LEAKY", slope, 0.0),
        Activation::Tanh => ("TANGENT", 0.0, 0.0),
        Activation::Silu => ("SILU", 0.0, 0.0),
        Activation::Gelu => ("GELU", 0.0, 0.0),
        Activation::GeluTanh => ("GELU_TANH", 0.0, 0.0),
    }
}

pub(crate) fn single(value: f32) -> String {
    // C has no literal for infinity: the largest finite number stands for it.
    format!("{:?}f", value.clamp(f32::MIN, f32::MAX))
}

pub(crate) fn double(value: f64) -> String {
    // As above.
    format!("{:?}", value.clamp(-1e300, 1e300))
}

pub(crate) fn braces<T>(values: impl IntoIterator<Item = T>, write: impl Fn(T) -> String) -> String {
    let words: Vec<String> = values.into_iter().map(write).collect();
    format!("{{{}}}", words.join(", "))
}
