//! Hidden layers that are not searched: what a joint's torque can be expected to depend on.
//!
//! From random or zero hidden layers a search has to find, through products of three small weights, that a joint has
//! friction; 97 weights a network make that slow, and unstable on the way. With these the last layer's few weights say
//! it at once. Fixed hidden layers with a searched last one are random features (Rahimi and Recht 2008) that are not
//! random.

use super::network_kind::{NETWORK_LAYERS, OUTPUT_WEIGHTS};
use gaitfit_physics::NETWORK_WEIGHTS;

/// The meanings of the last layer's weights, in order: torques (or corrections of the target), which resist if the weight is
/// positive, except the last.
pub(super) const NAMES: [&str; OUTPUT_WEIGHTS] = ["friction", "damping", "inertia", "stiffness", "offset"];

/// Velocity at which friction is about its full size, rad/s, inverse.
const FRICTION_SLOPE: f64 = 10.0;
/// Size of friction for a weight of 1, and of the offset, in units of the output scale.
const SMALL: f64 = 0.02;
/// Damping for a weight of 1, s/rad in units of the output scale.
const DAMPING: f64 = 0.02;
/// Change of velocity since the sample before for an output of about 1, rad/s, inverse.
const INERTIA: f64 = 0.1;
/// Stiffness for a weight of 1, 1/rad in units of the output scale.
const STIFFNESS: f64 = 1.0;

/// Inputs: angle and velocity now, then at the sample before.
const ANGLE: usize = 0;
const VELOCITY: usize = 1;
const VELOCITY_BEFORE: usize = 3;

/// All weights of a network whose last layer is `last`, for inputs scaled by `position` (1/rad) and `velocity` (s/rad):
/// −(w₁ 0.02 tanh 10 q̇ + w₂ tanh 0.02 q̇ + w₃ tanh 0.1 Δq̇ + w₄ tanh Δq) + 0.02 w₅, each within another tanh, with Δq̇
/// the change of velocity since the sample before and Δq the angle less its rest angle.
pub(super) fn weights(last: &[f64; OUTPUT_WEIGHTS], position: f64, velocity: f64) -> [f64; NETWORK_WEIGHTS] {
    let mut weights = [0.0; NETWORK_WEIGHTS];
    let [(inputs, units), (_, seconds), _] = NETWORK_LAYERS;
    let first = |input: usize, unit: usize| input * units + unit;
    weights[first(VELOCITY, 0)] = FRICTION_SLOPE / velocity;
    weights[first(VELOCITY, 1)] = DAMPING / velocity;
    weights[first(VELOCITY, 2)] = INERTIA / velocity;
    weights[first(VELOCITY_BEFORE, 2)] = -INERTIA / velocity;
    weights[first(ANGLE, 3)] = STIFFNESS / position;
    // Behind the first layer's weights and its units' biases.
    let second = (inputs + 1) * units;
    // Unit k of the second layer takes unit k of the first alone. The sign makes positive weights resist.
    for (unit, size) in [SMALL, 1.0, 1.0, 1.0].into_iter().enumerate() {
        weights[second + unit * seconds + unit] = -size;
    }
    weights[NETWORK_WEIGHTS - OUTPUT_WEIGHTS..].copy_from_slice(last);
    // The last weight is the output's bias: the offset.
    weights[NETWORK_WEIGHTS - 1] *= SMALL;
    weights
}

/// The size of a weight of 1 of the last layer, for each weight in order, as a unit that follows the weight: of torques, N·m, or
/// of corrections of the target, rad, for this output scale.
pub(super) fn units(output: f64, torque: bool) -> [String; OUTPUT_WEIGHTS] {
    let written = |size: f64, unit: &str| {
        // Three digits, without what products in binary leave.
        let size: f64 = format!("{:.2e}", size * output).parse().unwrap_or(size * output);
        if size == 1.0 { unit.to_owned() } else { format!("× {size} {unit}") }
    };
    let [friction, damping, stiffness] =
        if torque { ["N·m", "N·m·s/rad", "N·m/rad"] } else { ["rad", "s", "rad/rad"] };
    [
        written(SMALL, friction),
        written(DAMPING, damping),
        format!("{} a sample", written(INERTIA, damping)),
        written(STIFFNESS, stiffness),
        written(SMALL, friction),
    ]
}

/// Stiffness (N·m/rad) and torque at the rest angle (N·m) that a last layer stands for near the rest angle.
pub(super) fn spring(last: &[f64], output: f64) -> (f64, f64) {
    let [.., stiffness, offset] = last else { return (0.0, 0.0) };
    (stiffness * STIFFNESS * output, offset * SMALL * output)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn units_are_what_a_weight_of_one_does() {
        let wanted = ["× 0.6 N·m", "× 0.6 N·m·s/rad", "× 3 N·m·s/rad a sample", "× 30 N·m/rad", "× 0.6 N·m"];
        assert_eq!(units(30.0, true), wanted);
        assert_eq!(units(1.0, false)[3], "rad/rad");
    }

    /// The network by its formula, for the physical inputs (Δq, q̇) of three samples.
    fn output(last: [f64; OUTPUT_WEIGHTS], motion: [f64; 6]) -> f64 {
        let (position, velocity) = (2.0, 0.1);
        let weights = weights(&last, position, velocity);
        let mut x: Vec<f64> = motion
            .iter()
            .enumerate()
            .map(|(input, value)| value * if input % 2 == 0 { position } else { velocity })
            .collect();
        let mut at = 0;
        for (inputs, outputs) in NETWORK_LAYERS {
            x = (0..outputs)
                .map(|unit| {
                    let sum: f64 = (0..inputs).map(|i| x[i] * weights[at + i * outputs + unit]).sum();
                    let sum = sum + weights[at + inputs * outputs + unit];
                    if outputs > 1 { sum.tanh() } else { sum }
                })
                .collect();
            at += (inputs + 1) * outputs;
        }
        x[0]
    }

    #[test]
    fn each_weight_is_what_its_name_says() {
        let single = |number: usize, motion: [f64; 6]| {
            let mut last = [0.0; OUTPUT_WEIGHTS];
            last[number] = 1.0;
            output(last, motion)
        };
        let moving = |velocity: f64, before: f64| [0.0, velocity, 0.0, before, 0.0, before];
        assert!((single(0, moving(3.0, 3.0)) + 0.02).abs() < 1e-5);
        assert!((single(0, moving(-3.0, -3.0)) - 0.02).abs() < 1e-5);
        assert!((single(1, moving(3.0, 3.0)) + 0.06).abs() < 2e-4);
        assert!((single(2, moving(3.0, 2.0)) + 0.1).abs() < 1e-3);
        assert_eq!(single(2, moving(3.0, 3.0)), 0.0);
        assert!((single(3, [0.1, 5.0, 0.0, 5.0, 0.0, 5.0]) + 0.1).abs() < 1e-3);
        assert_eq!(single(4, moving(3.0, -2.0)), 0.02);
    }
}
