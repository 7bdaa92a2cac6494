//! Torque noise: what a motor does besides what it is told.

use gaitfit_random::{Purpose, Stream};

/// Gaussian torques of standard deviation `deviation` (N·m) for control period `step` of environments
/// `first..first + count`: `substeps × count × joints`, drawn by seed, environment and physics step.
pub(super) fn torque_noise(
    deviation: f64,
    seed: u64,
    first: u32,
    step: u32,
    [substeps, count, joints]: [usize; 3],
    torques: &mut Vec<f32>,
) {
    torques.resize(substeps * count * joints, 0.0);
    let mut normals = vec![0.0; joints];
    for (row, torques) in torques.chunks_exact_mut(joints).enumerate() {
        let (substep, index) = (row / count, row % count);
        let physics_step = step.wrapping_mul(substeps as u32).wrapping_add(substep as u32);
        Stream::new(seed, Purpose::TORQUE_NOISE)
            .environment(first + index as u32)
            .step(physics_step)
            .fill_normals(0, &mut normals);
        for (torque, normal) in torques.iter_mut().zip(&normals) {
            *torque = (deviation * normal) as f32;
        }
    }
}
