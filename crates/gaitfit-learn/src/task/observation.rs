//! Observations: rows of numbers as an interface lays them out.

use gaitfit_sim::Motion;

use super::moment::{to_body, up_axis};
use super::{NoiseSettings, Scene};
use gaitfit_policy::{Quantity, Term};

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

/// Numbers of the random blocks that [`observe`] takes noise from, in its order: four draws a block, blocks apart by the
/// place in the row.
pub(crate) fn noise_blocks(scene: &Scene, terms: &[Term]) -> Vec<u32> {
    let mut blocks = Vec::new();
    let mut place = 0;
    for term in terms {
        let width = term.quantity.width(scene.joints.len());
        if half_range(&scene.settings.noise, term.quantity) > 0.0 {
            blocks.extend((place..place + width).step_by(4).map(|place| place as u32));
        }
        place += width;
    }
    blocks
}

/// Writes the observation of environment `index` into `row`, with noise from the words of [`noise_blocks`] if there are
/// any.
pub(crate) fn observe(
    scene: &Scene,
    terms: &[Term],
    motion: &Motion,
    index: usize,
    context: &Context<'_>,
    mut noise: Option<&[[u32; 4]]>,
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
        let half = half_range(&scene.settings.noise, term.quantity);
        if let Some(blocks) = noise
            && half > 0.0
        {
            let (own, rest) = blocks.split_at(width.div_ceil(4));
            for (chunk, words) in out.chunks_mut(4).zip(own) {
                for (value, word) in chunk.iter_mut().zip(words) {
                    let uniform = (word >> 8) as f32 * (1.0 / (1 << 24) as f32);
                    *value += half * (2.0 * uniform - 1.0);
                }
            }
            noise = Some(rest);
        }
        match term.scale.as_slice() {
            [] => {}
            [scale] => out.iter_mut().for_each(|value| *value *= scale),
            scales => out.iter_mut().zip(scales).for_each(|(value, scale)| *value *= scale),
        }
        place += width;
    }
    debug_assert!(noise.is_none_or(<[_]>::is_empty), "blocks that no term took");
}
