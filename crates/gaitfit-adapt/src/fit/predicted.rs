//! Signals of one log, kept.

use crate::Signals;

/// Signals of one log, as [`Signals`] but owned.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Predicted {
    /// Joint positions, rad; `samples × joints`, row-major.
    pub position: Vec<f32>,
    /// Joint velocities, rad/s; `samples × joints`.
    pub velocity: Vec<f32>,
    /// Policy actions; `samples × joints`.
    pub action: Option<Vec<f32>>,
    /// Base position, m, world frame; `samples × 3`.
    pub base_position: Option<Vec<f32>>,
    /// Base linear velocity, m/s, world frame; `samples × 3`.
    pub base_velocity: Option<Vec<f32>>,
    /// First sample at which the robot has fallen.
    pub fell_at: Option<usize>,
}

impl Predicted {
    /// A copy of `signals`.
    pub fn from_signals(signals: &Signals<'_>) -> Self {
        Self {
            position: signals.position.to_vec(),
            velocity: signals.velocity.to_vec(),
            action: signals.action.map(<[f32]>::to_vec),
            base_position: signals.base_position.map(<[f32]>::to_vec),
            base_velocity: signals.base_velocity.map(<[f32]>::to_vec),
            fell_at: signals.fell_at,
        }
    }

    /// The view that costs take.
    pub fn signals(&self) -> Signals<'_> {
        Signals {
            position: &self.position,
            velocity: &self.velocity,
            action: self.action.as_deref(),
            base_position: self.base_position.as_deref(),
            base_velocity: self.base_velocity.as_deref(),
            fell_at: self.fell_at,
        }
    }

    /// Memory of the signals, bytes.
    pub(super) fn bytes(&self) -> usize {
        let optional = [&self.action, &self.base_position, &self.base_velocity];
        let numbers = optional.into_iter().flatten().map(Vec::len).sum::<usize>();
        size_of::<f32>() * (self.position.len() + self.velocity.len() + numbers)
    }
}
