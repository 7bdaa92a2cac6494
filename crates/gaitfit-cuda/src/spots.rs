//! Where the physics keeps a robot's numbers, and these places as kernels' text.

use gaitfit_physics::Owner;
use gaitfit_physics::trace::{Input, Output};

use crate::emit::{Class, Layout, Place};
use crate::physics::Period;
use crate::words::Words;

/// Place of a number in its tile: `base + stride · i` for the tile's robot `i`.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Spot {
    pub base: usize,
    pub stride: usize,
}

fn spot(layout: &Layout, place: Place) -> Spot {
    let base = layout.offset(place, 0);
    let stride = if layout.environments() > 1 { layout.offset(place, 1) - base } else { 0 };
    Spot { base, stride }
}

/// Places of the numbers that kernels beside the physics read and write.
pub(crate) struct Spots {
    /// The state, in the order of `State::visit`.
    pub state: Vec<Spot>,
    /// Encoder biases, one a joint, rad.
    pub bias: Vec<Spot>,
    /// Sent targets, rad, `taps × joints`.
    pub targets: Vec<Spot>,
    /// Memories of networks.
    pub memory: Vec<Spot>,
    /// The joint of each number of `memory`.
    pub memory_of: Vec<usize>,
    /// Disturbing torques, N·m; empty without them.
    pub disturbance: Vec<Spot>,
    /// Reported torques (N·m), normal forces (N) and centres of geoms (m).
    pub report: Vec<Spot>,
}

impl Spots {
    /// The places in the tiles of `period`.
    pub fn new(period: &Period) -> Self {
        Self {
            state: input_spots(period, |input| matches!(input, Input::State(_))),
            bias: input_spots(period, is_bias),
            targets: input_spots(period, |input| matches!(input, Input::Target { .. })),
            memory: input_spots(period, |input| matches!(input, Input::Memory { .. })),
            memory_of: memory_joints(period),
            disturbance: input_spots(period, |input| matches!(input, Input::Disturbance { .. })),
            report: report_spots(period),
        }
    }
}

impl Words {
    /// Sizes of the physics' tiles, and the places of the numbers in them.
    pub fn physics(&mut self, period: &Period, spots: &Spots) {
        let (layout, sensors) = (period.layout(), period.sensors());
        for (name, value) in [
            ("PER_TILE", layout.environments()),
            ("STATE_SIZE", layout.size(Class::State)),
            ("PARAMS_SIZE", layout.size(Class::Params)),
            ("TARGETS_SIZE", layout.size(Class::Targets)),
            ("MEMORY_SIZE", layout.size(Class::Memory)),
            ("REPORT_SIZE", layout.size(Class::Report)),
            ("DISTURBANCE_SIZE", layout.size(Class::Disturbance)),
            ("SUBSTEPS", period.substeps()),
            ("JOINTS", period.joints()),
            ("TAPS", period.taps()),
            ("MEMORY", spots.memory.len()),
            ("DISTURBED", spots.disturbance.len()),
            // Slow sensors' readings among the numbers that modifications remember.
            ("SENSORS_AT", sensors.begin),
            ("HAS_FILTER", usize::from(sensors.velocities.is_some())),
            ("FILTER_AT", sensors.velocities.unwrap_or_default()),
            ("HAS_LATE_IMU", usize::from(sensors.imu.is_some())),
            ("LATE_IMU_AT", sensors.imu.unwrap_or_default()),
        ] {
            self.define(name, value);
        }
        self.spots("STATE_SPOTS", &spots.state);
        self.spots("BIAS_SPOTS", &spots.bias);
        self.spots("TARGET_SPOTS", &spots.targets);
        self.spots("MEMORY_SPOTS", &spots.memory);
        self.integers("MEMORY_OF", &spots.memory_of);
        self.spots("REPORT_SPOTS", &spots.report);
        self.spots("DISTURBANCE_SPOTS", &spots.disturbance);
    }
}

/// Returns the places of those of a period's inputs that are `wanted`, in their order.
pub(crate) fn input_spots(period: &Period, wanted: fn(&Input) -> bool) -> Vec<Spot> {
    let layout = period.layout();
    let inputs = period.graph.inputs.iter().zip(&layout.inputs);
    inputs.filter(|(input, _)| wanted(input)).map(|(_, &place)| spot(layout, place)).collect()
}

/// The joint of each number that modifications remember; the number of joints for a number that starts at 0 (gears).
fn memory_joints(period: &Period) -> Vec<usize> {
    let joint = |input: &Input| match *input {
        Input::Memory { zero: true, .. } => Some(period.joints()),
        Input::Memory { owner: Owner::Joint(joint), .. } => Some(joint),
        Input::Memory { .. } => Some(0),
        _ => None,
    };
    period.graph.inputs.iter().filter_map(joint).collect()
}

/// Returns the places of a period's reports.
fn report_spots(period: &Period) -> Vec<Spot> {
    let layout = period.layout();
    let outputs = period.graph.outputs.iter().zip(&layout.outputs);
    let shown = outputs.filter(|(output, _)| matches!(output, Output::Report(_)));
    shown.map(|(_, &place)| spot(layout, place)).collect()
}

/// Whether an input is a joint's encoder bias.
fn is_bias(input: &Input) -> bool {
    matches!(input, Input::Params(slot) if slot.name == "encoder_bias" && matches!(slot.owner, Owner::Joint(_)))
}
