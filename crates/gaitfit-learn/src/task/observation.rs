//! Observations: rows of numbers as an interface lays them out.

use gaitfit_random::Stream;
use gaitfit_sim::Motion;

use super::moment::{to_body, up_axis};
use super::{NoiseSettings, Scene};
use crate::{Quantity, Term};

/// What an observation is made of besides the motion; rows of one environment.
pub(crate) struct Context<'a> {
    pub command: [f32; 3],
    /// Policy order.
    pub last_action: &'a [f32],
    /// Phase of the gait clock, 0 to 1.
    pub clock: f32,
}

fn half_range(noise: &NoiseSettings, quantity: Quantity) -> f32 {
    (match quantity {
        Quantity::BaseAngularVelocity => noise.base_angular_velocity,
        Quantity::ProjectedGravity => noise.projected_gravity,
        Quantity::JointPosition => noise.joint_position,
        Quantity::JointVelocity => noise.joint_velocity,
        _ => 0.0,
    }) as f32
}

/// Writes the observation of environment `index` into `row`, with noise from `stream` if there is one.
pub(crate) fn observe(
    scene: &Scene,
    terms: &[Term],
    motion: &Motion,
    index: usize,
    context: &Context<'_>,
    stream: Option<Stream>,
    row: &mut [f32],
) {
    let joints = scene.start_pose.len();
    let quaternion = &motion.base_quaternion[4 * index..4 * index + 4];
    let linear = &motion.base_linear[3 * index..3 * index + 3];
    let angular = &motion.base_angular[3 * index..3 * index + 3];
    let position = &motion.joint_position[joints * index..joints * (index + 1)];
    let velocity = &motion.joint_velocity[joints * index..joints * (index + 1)];
    let mut place = 0;
    for term in terms {
        let width = term.quantity.width(scene.joints.len());
        let out = &mut row[place..place + width];
        match term.quantity {
            Quantity::BaseAngularVelocity => out.copy_from_slice(angular),
            Quantity::ProjectedGravity => out.copy_from_slice(&up_axis(quaternion).map(|x| -x)),
            Quantity::Command => out.copy_from_slice(&context.command),
            Quantity::JointPosition => {
                for (slot, &joint) in out.iter_mut().zip(&scene.joints) {
                    *slot = position[joint] - scene.default_pose[joint];
                }
            }
            Quantity::JointVelocity => {
                for (slot, &joint) in out.iter_mut().zip(&scene.joints) {
                    *slot = velocity[joint];
                }
            }
            Quantity::LastAction => out.copy_from_slice(context.last_action),
            Quantity::BaseLinearVelocity => out.copy_from_slice(&to_body(quaternion, linear)),
            Quantity::GaitPhase => {
                let (sin, cos) = (std::f32::consts::TAU * context.clock).sin_cos();
                out.copy_from_slice(&[sin, cos]);
            }
        }
        if let Some(stream) = stream {
            let half = half_range(&scene.settings.noise, term.quantity);
            if half > 0.0 {
                // Four draws a block, blocks apart by the place in the row.
                for (k, chunk) in out.chunks_mut(4).enumerate() {
                    let words = stream.block((place + 4 * k) as u32);
                    for (value, word) in chunk.iter_mut().zip(words) {
                        let uniform = (word >> 8) as f32 * (1.0 / (1 << 24) as f32);
                        *value += half * (2.0 * uniform - 1.0);
                    }
                }
            }
        }
        match term.scale.as_slice() {
            [] => {}
            [scale] => out.iter_mut().for_each(|value| *value *= scale),
            scales => out.iter_mut().zip(scales).for_each(|(value, scale)| *value *= scale),
        }
        place += width;
    }
}
