//! Numbers and tables at the head of kernels' texts, and where the physics keeps a robot's numbers.

use std::fmt::Write;

use gaitfit_physics::Owner;
use gaitfit_physics::trace::{Input, Output};
use gaitfit_policy::Quantity;
use gaitfit_policy::network::Activation;

use crate::emit::{Layout, Place};
use crate::physics::Period;

/// A text in the making.
pub(crate) struct Words {
    pub text: String,
}

impl Words {
    pub fn define(&mut self, name: &str, value: impl std::fmt::Display) {
        // Writing to a string does not fail.
        let _ = writeln!(self.text, "#define {name} {value}");
    }

    /// An empty table has one entry of zeros.
    pub fn table(&mut self, kind: &str, name: &str, mut rows: Vec<String>) {
        if rows.is_empty() {
            rows.push(if kind == "int" || kind == "float" { "0".into() } else { "{}".into() });
        }
        let _ = writeln!(self.text, "TABLE {kind} {name}[] = {{{}}};", rows.join(", "));
    }

    /// A table of places.
    pub fn spots(&mut self, name: &str, spots: &[Spot]) {
        let rows = spots.iter().map(|spot| format!("{{{}, {}}}", spot.base, spot.stride)).collect();
        self.table("Spot", name, rows);
    }

    /// The place of slow sensors' readings among the numbers that a period's modifications remember, if there are any.
    pub fn filter(&mut self, period: &Period) {
        self.define("HAS_FILTER", usize::from(period.filter().is_some()));
        self.define("FILTER_AT", period.filter().unwrap_or_default());
    }

    /// The numbers of what a policy observes, in capitals, as terms of an observation have them.
    pub fn quantities(&mut self) {
        let names: Vec<String> =
            Quantity::ALL.iter().map(|quantity| quantity.name().to_uppercase()).collect();
        let _ = writeln!(self.text, "enum {{ {} }};", names.join(", "));
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

/// What to say of an activation that the kernels do not know.
pub(crate) fn unknown(activation: Activation) -> Option<String> {
    let known = matches!(activation, Activation::Elu | Activation::Relu | Activation::Tanh);
    (!known).then(|| format!("the activation {activation}"))
}

pub(crate) fn single(value: f32) -> String {
    format!("{:?}f", value.clamp(f32::MIN, f32::MAX))
}

pub(crate) fn double(value: f64) -> String {
    format!("{:?}", value.clamp(-1e300, 1e300))
}

pub(crate) fn braces<T>(values: impl IntoIterator<Item = T>, write: impl Fn(T) -> String) -> String {
    let words: Vec<String> = values.into_iter().map(write).collect();
    format!("{{{}}}", words.join(", "))
}

/// Place of a number in its tile: `base + stride · i` for the tile's robot `i`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Spot {
    pub base: usize,
    pub stride: usize,
}

pub(crate) fn spot(layout: &Layout, place: Place) -> Spot {
    let base = layout.offset(place, 0);
    let stride = if layout.environments() > 1 { layout.offset(place, 1) - base } else { 0 };
    Spot { base, stride }
}

/// Where a period keeps those of its inputs that are `wanted`, in their order.
pub(crate) fn input_spots(period: &Period, wanted: fn(&Input) -> bool) -> Vec<Spot> {
    let layout = period.layout();
    let inputs = period.graph.inputs.iter().zip(&layout.inputs);
    inputs.filter(|(input, _)| wanted(input)).map(|(_, &place)| spot(layout, place)).collect()
}

/// The joint of each number that modifications remember; the number of joints for a number that starts at 0 (gears).
pub(crate) fn memory_joints(period: &Period) -> Vec<usize> {
    let joint = |input: &Input| match *input {
        Input::Memory { zero: true, .. } => Some(period.joints()),
        Input::Memory { owner: Owner::Joint(joint), .. } => Some(joint),
        Input::Memory { .. } => Some(0),
        _ => None,
    };
    period.graph.inputs.iter().filter_map(joint).collect()
}

/// Where a period keeps what it reports.
pub(crate) fn report_spots(period: &Period) -> Vec<Spot> {
    let layout = period.layout();
    let outputs = period.graph.outputs.iter().zip(&layout.outputs);
    let shown = outputs.filter(|(output, _)| matches!(output, Output::Report(_)));
    shown.map(|(_, &place)| spot(layout, place)).collect()
}

/// Whether an input is a joint's encoder bias.
pub(crate) fn is_bias(input: &Input) -> bool {
    matches!(input, Input::Params(slot) if slot.name == "encoder_bias" && matches!(slot.owner, Owner::Joint(_)))
}
