//! The policy in the simulator, under the logs' commands: what a fit of walking logs compares with them.

use super::walking::Walking;
use gaitfit_adapt::cost::Signal;
use gaitfit_adapt::{Cancel, Consume, Rollout, Signals, Simulator, SimulatorError, Theta};
use gaitfit_log::Trajectory;
use gaitfit_policy::follow::{Job, Script, Track, follow};
use gaitfit_policy::walker::Walker;
use gaitfit_sim::{Candidate, Start};
use std::sync::Arc;

/// Runs a policy on candidate robots with the command sequences of some logs.
pub struct WalkSimulator {
    walking: Arc<Walking>,
    /// What θ changes.
    base: Candidate,
    scripts: Vec<Script>,
    /// Joints of the signals: the policy's.
    joints: Vec<String>,
    /// Joints of the model, which θ names.
    model_joints: Vec<String>,
}

impl WalkSimulator {
    /// A simulator of `logs` (joints in the policy's order, sampled at the policy's rate). `base`: the robot that θ
    /// changes.
    pub fn new(walking: Arc<Walking>, base: Candidate, logs: &[&Trajectory]) -> Self {
        let joints = &walking.task.walker.batch.model().joints;
        Self {
            base,
            scripts: logs.iter().map(|log| script(&walking.task.walker, log)).collect(),
            joints: walking.joints(),
            model_joints: joints.iter().map(|joint| joint.name.clone()).collect(),
            walking,
        }
    }

    /// The robot with these values of θ.
    pub fn candidate(&self, theta: &Theta, values: &[f64]) -> Candidate {
        let mut candidate = self.base.clone();
        theta.apply(values, &self.model_joints, &mut candidate);
        candidate
    }
}

impl Simulator for WalkSimulator {
    fn joints(&self) -> &[String] {
        &self.joints
    }

    fn recordings(&self) -> usize {
        self.scripts.len()
    }

    fn provides(&self, _signal: Signal) -> bool {
        true
    }

    fn simulate(
        &self,
        theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        let Walking { policy, task, threads } = self.walking.as_ref();
        let jobs: Vec<Job> = candidates
            .iter()
            .map(|rollout| Job {
                candidate: self.candidate(theta, &rollout.values),
                reset_every: rollout.reset_every,
                seed: rollout.draw,
            })
            .collect();
        let pass = |job: usize, script: usize, track: &Track| {
            let signals = Signals {
                position: &track.position,
                velocity: &track.velocity,
                action: Some(&track.action),
                base_position: Some(&track.base_position),
                base_velocity: Some(&track.base_velocity),
                fell_at: track.fell_at,
            };
            consume(job, script, signals);
        };
        follow(&task.walker, policy, &self.scripts, &jobs, *threads, &pass, cancel)
            .map_err(SimulatorError::failed)?;
        if cancel() { Err(SimulatorError::Cancelled) } else { Ok(()) }
    }
}

/// What the simulated robot follows: the log's commands, from the log's first joint angles and velocities. Where the
/// base is at the start no robot knows: upright in the task's posture, feet on the ground, at rest.
fn script(walker: &Walker, log: &Trajectory) -> Script {
    let joints = walker.joints.len();
    let samples = log.len();
    let command = log.command.as_deref().unwrap_or_default();
    let commands = (0..samples).map(|row| std::array::from_fn(|k| command[3 * row + k] as f32)).collect();
    let model_order = |values: &[f64], row: usize, other: f64| -> Vec<f64> {
        let mut all = vec![other; walker.default_pose.len()];
        for (&joint, &value) in walker.joints.iter().zip(&values[row * joints..]) {
            all[joint] = value;
        }
        all
    };
    let posture = |row: usize| (model_order(&log.position, row, 0.0), model_order(&log.velocity, row, 0.0));
    let (angles, velocities) = posture(0);
    let start = walker.start_from_joints(&angles, &velocities);
    Script { commands, start, states: states(log, posture), actions: actions(log) }
}

/// The whole state at every sample, where the log has it.
fn states(log: &Trajectory, posture: impl Fn(usize) -> (Vec<f64>, Vec<f64>)) -> Vec<Start> {
    let Some(base) = &log.base else { return Vec::new() };
    let (Some(position), Some(quaternion), Some(linear), Some(angular)) =
        (&base.position, &base.quaternion, &base.linear_velocity, &base.angular_velocity)
    else {
        return Vec::new();
    };
    fn row<const N: usize>(values: &[f64], row: usize) -> [f32; N] {
        std::array::from_fn(|k| values[row * N + k] as f32)
    }
    (0..log.len())
        .map(|sample| {
            let (angles, velocities) = posture(sample);
            let single = |values: Vec<f64>| values.into_iter().map(|x| x as f32).collect();
            Start {
                base_position: row(position, sample),
                base_quaternion: row(quaternion, sample),
                base_linear: row(linear, sample),
                base_angular: row(angular, sample),
                joint_position: single(angles),
                joint_velocity: single(velocities),
            }
        })
        .collect()
}

fn actions(log: &Trajectory) -> Vec<f32> {
    log.action.iter().flatten().map(|&action| action as f32).collect()
}
