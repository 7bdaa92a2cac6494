//! A log's samples as a policy observes them, and what a log lacks for that.

use gaitfit_log::Trajectory;
use gaitfit_model::rotation::{normalize, quat_of, rotate_back};
use gaitfit_policy::observation::{Layout, Sensed};
use gaitfit_policy::{Interface, Quantity};

/// What an inertial unit measures, as far as a sample has it.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Given {
    /// Rates of the base, rad/s, body frame.
    pub rates: Option<[f64; 3]>,
    /// Direction of gravity, body frame.
    pub gravity: Option<[f64; 3]>,
    /// Velocity of the base, m/s, body frame.
    pub velocity: Option<[f64; 3]>,
}

/// One number that a sample lacks.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Unknown {
    /// Rate about a body axis, rad/s.
    Rate(usize),
    /// Gravity's part along a horizontal body axis; the third follows from its length.
    Gravity(usize),
    /// Velocity along a body axis, m/s.
    Velocity(usize),
}

impl Unknown {
    /// Spread about 0 on a robot that walks.
    pub fn spread(self) -> f64 {
        match self {
            Self::Rate(_) => 0.6,
            Self::Gravity(_) => 0.1,
            Self::Velocity(_) => 0.6,
        }
    }
}

impl Given {
    /// Of sample `row`; a part with a number that is not finite is unknown.
    pub fn from_log(log: &Trajectory, row: usize) -> Self {
        let Some(base) = &log.base else { return Self::default() };
        let finite = |values: &[f64]| values.iter().all(|x| x.is_finite());
        let three = |values: &Option<Vec<f64>>| -> Option<[f64; 3]> {
            let values = values.as_deref()?.get(3 * row..3 * row + 3)?;
            finite(values).then(|| [values[0], values[1], values[2]])
        };
        let quaternion = base
            .quaternion
            .as_deref()
            .and_then(|values| values.get(4 * row..4 * row + 4))
            .filter(|values| finite(values));
        Self {
            rates: three(&base.angular_velocity),
            gravity: quaternion.map(|q| to_body(q, [0.0, 0.0, -1.0])),
            velocity: quaternion.zip(three(&base.linear_velocity)).map(|(q, v)| to_body(q, v)),
        }
    }

    /// What `interface` observes and is not given.
    pub fn missing(&self, interface: &Interface) -> Vec<Unknown> {
        let mut missing = Vec::new();
        for term in &interface.observation {
            match term.quantity {
                Quantity::BaseAngularVelocity if self.rates.is_none() => {
                    missing.extend((0..3).map(Unknown::Rate));
                }
                Quantity::ProjectedGravity if self.gravity.is_none() => {
                    missing.extend((0..2).map(Unknown::Gravity));
                }
                Quantity::BaseLinearVelocity if self.velocity.is_none() => {
                    missing.extend((0..3).map(Unknown::Velocity));
                }
                _ => {}
            }
        }
        missing
    }

    /// With `values` for what was missing.
    pub fn filled(&self, missing: &[Unknown], values: &[f64]) -> Self {
        let level = [0.0, 0.0, -1.0];
        let (mut rates, mut velocity) = (self.rates.unwrap_or_default(), self.velocity.unwrap_or_default());
        let mut gravity = self.gravity.unwrap_or(level);
        for (unknown, &value) in missing.iter().zip(values) {
            match *unknown {
                Unknown::Rate(axis) => rates[axis] = value,
                Unknown::Velocity(axis) => velocity[axis] = value,
                Unknown::Gravity(axis) => gravity[axis] = value,
            }
        }
        if self.gravity.is_none() {
            let across = (gravity[0].powi(2) + gravity[1].powi(2)).min(1.0);
            gravity[2] = -(1.0 - across).sqrt();
        }
        Self { rates: Some(rates), gravity: Some(gravity), velocity: Some(velocity) }
    }
}

/// A world vector in the body frame of a base with orientation `q` (wxyz).
fn to_body(q: &[f64], v: [f64; 3]) -> [f64; 3] {
    rotate_back(normalize(quat_of(q)), v)
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
    let single = |values: &[f64]| values.iter().map(|&x| x as f32).collect::<Vec<f32>>();
    let three = |values: [f64; 3]| values.map(|x| x as f32);
    let part = |values: &[f64]| single(&values[row * joints..(row + 1) * joints]);
    let command = log.command.as_deref().unwrap_or_default();
    let turns = clock + row as f64 * interface.control_dt * interface.gait_frequency.unwrap_or(0.0);
    let sensed = Sensed {
        base_angular_velocity: three(given.rates.unwrap_or_default()),
        projected_gravity: three(given.gravity.unwrap_or([0.0, 0.0, -1.0])),
        base_linear_velocity: three(given.velocity.unwrap_or_default()),
        command: three(std::array::from_fn(|k| command.get(3 * row + k).copied().unwrap_or(0.0))),
        joint_position: part(&log.position),
        joint_velocity: part(&log.velocity),
        last_action: single(last),
        clock: turns.fract() as f32,
    };
    layout.write(&sensed, past, |_, _| (), out);
}

/// What the policy observed in the sample before `sample`, by the log, as far as its frames are still seen in `sample`;
/// none where a row has no past frames, and before the log's second sample.
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
