//! A log's samples as a policy observes them, and what a log lacks for that.

use super::reference;
use gaitfit_log::Trajectory;
use gaitfit_model::rotation::normalize;
use gaitfit_policy::observation::{Layout, Sensed};
use gaitfit_policy::{BaseSample, Interface, Quantity, Term};

/// The values of a log's sample for each quantity of the base's motion.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Given {
    values: [Option<[f64; 3]>; Quantity::ALL.len()],
}

/// One number that a sample lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Unknown {
    /// The quantity.
    pub quantity: Quantity,
    /// Place among the quantity's numbers.
    pub number: usize,
}

impl Unknown {
    /// Spread about 0 on a robot that walks.
    pub fn spread(self) -> f64 {
        let of = self.quantity.base();
        of.and_then(|of| of.spreads.get(self.number).copied()).unwrap_or(1.0)
    }
}

impl Given {
    /// The values of sample `row`; a part with a number that is not finite is unknown.
    pub fn from_log(log: &Trajectory, row: usize) -> Self {
        let Some(base) = &log.base else { return Self::default() };
        let sample = BaseSample {
            position: part(&base.position, row),
            quaternion: part(&base.quaternion, row).map(normalize),
            linear_velocity: part(&base.linear_velocity, row),
            angular_velocity: part(&base.angular_velocity, row),
        };
        let mut given = Self::default();
        for (value, quantity) in given.values.iter_mut().zip(Quantity::ALL) {
            *value = quantity.base().and_then(|of| (of.read)(&sample));
        }
        given
    }

    /// The numbers of a quantity.
    pub fn get(&self, quantity: Quantity) -> Option<[f64; 3]> {
        self.values[quantity as usize]
    }

    /// The numbers that `interface` observes and the sample lacks.
    pub fn missing(&self, interface: &Interface) -> Vec<Unknown> {
        let mut missing = Vec::new();
        for &Term { quantity, .. } in &interface.observation {
            if let (Some(of), None) = (quantity.base(), self.get(quantity)) {
                missing.extend((0..of.spreads.len()).map(|number| Unknown { quantity, number }));
            }
        }
        missing
    }

    /// The same observation with `values` for the `missing` numbers. Other unknown numbers are 0, and unknown
    /// gravity is that of a level base.
    pub fn filled(&self, missing: &[Unknown], values: &[f64]) -> Self {
        let mut filled = Self { values: self.values.map(|value| Some(value.unwrap_or_default())) };
        for (unknown, &value) in missing.iter().zip(values) {
            if let Some(numbers) = &mut filled.values[unknown.quantity as usize] {
                numbers[unknown.number] = value;
            }
        }
        let gravity = Quantity::ProjectedGravity;
        if let (None, Some([x, y, z])) = (self.get(gravity), &mut filled.values[gravity as usize]) {
            // Gravity is a unit vector that points down. Beyond 1 the root would not be a number.
            *z = -(1.0 - (x.powi(2) + y.powi(2)).min(1.0)).sqrt();
        }
        filled
    }
}

/// The numbers of sample `row`, if there are some and all are finite.
fn part<const N: usize>(values: &Option<Vec<f64>>, row: usize) -> Option<[f64; N]> {
    let values = values.as_deref()?.get(N * row..N * (row + 1))?;
    values.iter().all(|x| x.is_finite()).then(|| std::array::from_fn(|k| values[k]))
}

/// Writes the observation of sample `row`, with the arithmetic of the simulator's; what `given` lacks counts as level and
/// at rest. `last`: the row of the last action. `clock`: phase of the gait clock at sample 0, 0 to 1. `past`: the row of
/// the sample before, see [`past`].
pub fn write(
    layout: &Layout,
    interface: &Interface,
    log: &Trajectory,
    row: usize,
    last: &[f64],
    given: &Given,
    clock: f64,
    past: Option<&[f32]>,
    out: &mut [f32],
) {
    let joints = interface.joints.len();
    // Single precision, because the simulator observes so too.
    let single = |values: &[f64]| values.iter().map(|&x| x as f32).collect::<Vec<f32>>();
    let joint = |values: &[f64]| single(&values[row * joints..(row + 1) * joints]);
    let command = log.command.as_deref().unwrap_or_default();
    let turns = clock + row as f64 * interface.control_dt * interface.gait_frequency.unwrap_or(0.0);
    let mut sensed = Sensed {
        command: std::array::from_fn(|k| command.get(3 * row + k).copied().unwrap_or(0.0) as f32),
        joint_position: joint(&log.position),
        joint_velocity: joint(&log.velocity),
        last_action: single(last),
        clock: turns.fract() as f32,
        ..Sensed::new(0)
    };
    // Base readings that are given replace those that `Sensed` starts with.
    for (quantity, value) in Quantity::ALL.iter().zip(given.values) {
        if let (Some(of), Some(value)) = (quantity.base(), value) {
            (of.sense)(&mut sensed, value);
        }
    }
    if let Some(orientation) = log.base.as_ref().and_then(|base| part(&base.quaternion, row)) {
        sensed.orientation = orientation.map(|x: f64| x as f32);
    }
    sensed.motion = reference::place(log, row);
    layout.write(&sensed, past, |_, _| (), out);
}

/// The observation of the sample before `sample`, from the log, as far as `sample` still contains its frames; `None` if a row has
/// no past frames, and before the log's second sample.
pub fn past(
    layout: &Layout,
    interface: &Interface,
    log: &Trajectory,
    sample: usize,
    clock: f64,
) -> Option<Vec<f32>> {
    if layout.frames() == 1 {
        return None;
    }
    let joints = interface.joints.len();
    let still = vec![0.0; joints];
    let action = log.action.as_deref().unwrap_or_default();
    let mut row: Option<Vec<f32>> = None;
    // Only as many rows as the observation keeps frames of, each written over the one before.
    for before in (sample + 1).saturating_sub(layout.frames())..sample {
        let last = before.checked_sub(1).and_then(|last| action.get(last * joints..(last + 1) * joints));
        let given = Given::from_log(log, before);
        let mut next = vec![0.0; layout.width()];
        let last = last.unwrap_or(&still);
        write(layout, interface, log, before, last, &given, clock, row.as_deref(), &mut next);
        row = Some(next);
    }
    row
}
