//! Torque noise: what a motor does besides what it is told.

use gaitfit_random::{Purpose, Stream, fill_normal_rows};
use gaitfit_sim::Candidate;

use super::Walker;

/// Draws torque noise into a buffer of its own.
#[derive(Debug, Default)]
pub struct TorqueNoise {
    torques: Vec<f32>,
    normals: Vec<f64>,
}

impl TorqueNoise {
    /// Gaussian torques (N·m) of the candidate's deviation for control period `step` of environments
    /// `first..first + count`: `substeps × count × joints`, a function of seed, environment and physics step; empty
    /// for a robot without noise.
    pub fn torques(
        &mut self,
        walker: &Walker,
        candidate: &Candidate,
        seed: u64,
        first: u32,
        step: u32,
        count: usize,
    ) -> &[f32] {
        self.draw(walker, |_| candidate.torque_noise, seed, first, step, count)
    }

    /// As [`Self::torques`], for environments that differ: a deviation each, N·m.
    pub fn torques_of(
        &mut self,
        walker: &Walker,
        deviations: &[f64],
        seed: u64,
        first: u32,
        step: u32,
    ) -> &[f32] {
        self.draw(walker, |environment| deviations[environment], seed, first, step, deviations.len())
    }

    fn draw(
        &mut self,
        walker: &Walker,
        deviation: impl Fn(usize) -> f64,
        seed: u64,
        first: u32,
        step: u32,
        count: usize,
    ) -> &[f32] {
        // Robots without noise draw nothing, which costs no time, and the step adds nothing to their torques.
        if (0..count).all(|environment| deviation(environment) <= 0.0) {
            return &[];
        }
        let (substeps, joints) = (walker.batch.options().substeps, walker.default_pose.len());
        self.torques.resize(substeps * count * joints, 0.0);
        self.normals.resize(count * joints, 0.0);
        for (substep, torques) in self.torques.chunks_exact_mut(count * joints).enumerate() {
            // Counted over all substeps, so that each has draws of its own.
            let physics_step = step.wrapping_mul(substeps as u32).wrapping_add(substep as u32);
            let stream = Stream::new(seed, Purpose::TORQUE_NOISE).step(physics_step);
            fill_normal_rows(stream, first, joints, &mut self.normals);
            let rows = torques.chunks_exact_mut(joints).zip(self.normals.chunks_exact(joints));
            for (environment, (torques, normals)) in rows.enumerate() {
                let deviation = deviation(environment);
                for (torque, normal) in torques.iter_mut().zip(normals) {
                    *torque = (deviation * normal) as f32;
                }
            }
        }
        &self.torques
    }
}
