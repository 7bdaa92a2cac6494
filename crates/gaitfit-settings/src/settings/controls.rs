//! Settings of the policies that a loop's policy is compared with: `[controls]` of a loop.

use gaitfit_model::shown_number;
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

use super::check_torque_noise;
use crate::Spring;

/// What else π₀ is fine-tuned in, with the same task and as many iterations, where the target can be measured: what a
/// user can do without any logs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ControlsConfig {
    /// The simulator as the robot's file has it.
    pub nominal: bool,
    /// Robots that differ at random, as below.
    pub randomised: bool,
    /// The fitted robot with its numbers drawn from their joint intervals.
    #[serde(default)]
    pub draws: bool,
    /// The robot itself, where its numbers are known: the best that a fit could do.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truth: Option<TruthConfig>,
    /// Dry friction torque of the joints, N·m: smallest and largest.
    pub frictionloss: [f64; 2],
    /// Reflected rotor inertia added to the joints, kg·m².
    pub armature: [f64; 2],
    /// Delay from a target to the motors, s.
    pub delay: [f64; 2],
    /// Standard deviation of Gaussian torques at every joint and physics step, N·m.
    pub torque_noise: f64,
}

/// Numbers of a robot that are known, as in tests of the method.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct TruthConfig {
    /// Its parameters, a `theta.toml`.
    pub theta: String,
    /// Its springs, written `JOINT=STIFFNESS` or `JOINT=STIFFNESS@REST`, N·m/rad and rad.
    #[serde(default)]
    pub spring: Vec<Spring>,
    /// Its torque noise at the simulator's steps, N·m.
    #[serde(default)]
    pub torque_noise: f64,
}

impl ControlsConfig {
    /// Names a fault of the settings, in words.
    pub fn wrong(&self) -> Option<String> {
        let ranges = [
            ("frictionloss", self.frictionloss, 1e4),
            ("armature", self.armature, 1e4),
            ("delay", self.delay, 1.0),
        ];
        let wrong = ranges.into_iter().find_map(|(name, [low, high], max)| {
            // Negated as a whole, so that a range with NaN is refused.
            (!(0.0 <= low && low <= high && high <= max)).then(|| {
                let (low, high) = (shown_number(low), shown_number(high));
                format!(
                    "`controls.{name}` is [{low}, {high}]; it must be [smallest, largest], from 0 to {max}"
                )
            })
        });
        // Without a true robot there is nothing to refuse, and 0 is within the range.
        let truth = self.truth.as_ref().map_or(0.0, |truth| truth.torque_noise);
        wrong
            .or_else(|| check_torque_noise("controls.torque_noise", self.torque_noise).err())
            .or_else(|| check_torque_noise("controls.truth.torque_noise", truth).err())
    }

    /// Changes of a task that make its robots differ so.
    pub fn randomisation(&self) -> Table {
        let range = |[low, high]: [f64; 2]| Value::Array(vec![Value::Float(low), Value::Float(high)]);
        let ranges =
            [("frictionloss", self.frictionloss), ("armature", self.armature), ("delay", self.delay)];
        let ranges: Table = ranges.into_iter().map(|(name, of)| (name.to_owned(), range(of))).collect();
        [("randomisation".to_owned(), Value::Table(ranges))].into_iter().collect()
    }
}
