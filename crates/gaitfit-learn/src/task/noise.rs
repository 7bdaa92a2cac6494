//! Torque noise: what a motor does besides what it is told.

use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::Candidate;

use super::Scene;

/// Draws torque noise into a buffer of its own.
#[derive(Debug, Default)]
pub(crate) struct Noise {
    torques: Vec<f32>,
}

impl Noise {
    /// Gaussian torques (N·m) of the candidate's deviation for control period `step` of environments
    /// `first..first + count`: `substeps × count × joints`, a function of seed, environment and physics step; empty
    /// for a robot without noise.
    pub fn torques(
        &mut self,
        scene: &Scene,
        candidate: &Candidate,
        seed: u64,
        first: u32,
        step: u32,
        count: usize,
    ) -> &[f32] {
        if candidate.torque_noise <= 0.0 {
            return &[];
        }
        let (substeps, joints) = (scene.settings.substeps, scene.start_pose.len());
        self.torques.resize(substeps * count * joints, 0.0);
        let mut normals = vec![0.0; joints];
        for (row, torques) in self.torques.chunks_exact_mut(joints).enumerate() {
            let (substep, index) = (row / count, row % count);
            let physics_step = step.wrapping_mul(substeps as u32).wrapping_add(substep as u32);
            Stream::new(seed, Purpose::TORQUE_NOISE)
                .environment(first + index as u32)
                .step(physics_step)
                .fill_normals(0, &mut normals);
            for (torque, normal) in torques.iter_mut().zip(&normals) {
                *torque = (candidate.torque_noise * normal) as f32;
            }
        }
        &self.torques
    }
}
