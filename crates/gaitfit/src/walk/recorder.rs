//! The robot as it makes logs: its policy walks in closed loop, and what the robot's sensors read is kept.

use super::simulator::{in_model, script};
use super::walking::Walking;
use gaitfit_adapt::{Cancel, Theta};
use gaitfit_log::{BaseState, Trajectory};
use gaitfit_model::kinematics::standing_height;
use gaitfit_policy::follow::{self, Script, Track};
use gaitfit_policy::walker::{Walker, WalkerError};
use gaitfit_sim::Candidate;
use std::sync::{Arc, Mutex, PoisonError};

/// Makes logs under the commands of others.
pub struct Recorder {
    walking: Arc<Walking>,
    /// What θ changes.
    base: Candidate,
    scripts: Vec<Script>,
    /// Names of the model's joints, which θ names.
    model_joints: Vec<String>,
}

impl Recorder {
    /// A recorder of logs like `logs` (joints in the policy's order, sampled at the policy's rate): as long, under the
    /// same commands, from the state that their first sample shows. How the base moved then they do not say; it is at
    /// rest. `base`: the robot that θ changes.
    pub fn new(walking: Arc<Walking>, base: Candidate, logs: &[&Trajectory]) -> Self {
        let walker = &walking.task.walker;
        let joints = &walker.batch.model().joints;
        Self {
            base,
            scripts: logs.iter().map(|log| begun(walker, log)).collect(),
            model_joints: joints.iter().map(|joint| joint.name.clone()).collect(),
            walking,
        }
    }

    /// Physics step of the robot, s.
    pub fn physics_step(&self) -> f64 {
        self.walking.task.walker.physics_step()
    }

    /// Sets of logs of the robot with `values` of θ and normal torques of the deviation `noise` at its joints, N·m, one set
    /// for each of `seeds`.
    ///
    /// # Errors
    /// Values that are no robot's.
    pub fn record(
        &self,
        theta: &Theta,
        values: &[f64],
        noise: f64,
        seeds: &[u64],
        cancel: &Cancel<'_>,
    ) -> Result<Vec<Vec<Recorded>>, WalkerError> {
        let Walking { policy, task, threads, .. } = self.walking.as_ref();
        let mut candidate = self.base.clone();
        theta.apply(values, &self.model_joints, &mut candidate);
        candidate.torque_noise = noise;
        let job = |&seed: &u64| follow::Job { candidate: candidate.clone(), reset_every: None, seed };
        let jobs: Vec<follow::Job> = seeds.iter().map(job).collect();
        let found = Mutex::new(vec![vec![Recorded::default(); self.scripts.len()]; seeds.len()]);
        let keep = |set: usize, number: usize, track: &Track| {
            let recorded = Recorded::new(&task.walker, &self.scripts[number], track);
            let mut found = found.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(slot) = found.get_mut(set).and_then(|set| set.get_mut(number)) {
                *slot = recorded;
            }
        };
        follow::follow(&task.walker, policy, &self.scripts, &jobs, *threads, &keep, cancel)?;
        Ok(found.into_inner().unwrap_or_else(PoisonError::into_inner))
    }
}

/// What a robot recorded, the policy's joint order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recorded {
    position: Vec<f64>,
    velocity: Vec<f64>,
    action: Vec<f64>,
    target: Vec<f64>,
    base: BaseState,
    /// First sample at which the robot had fallen.
    pub fell_at: Option<usize>,
}

impl Recorded {
    pub(crate) fn new(walker: &Walker, script: &Script, track: &Track) -> Self {
        let wide = |values: &[f32]| values.iter().map(|&value| f64::from(value)).collect();
        let joints = walker.default_pose.len();
        let mut targets = vec![0.0; script.commands.len() * joints];
        walker.targets(&track.action, &mut targets);
        let rows = targets.chunks_exact(joints);
        Self {
            position: wide(&track.position),
            velocity: wide(&track.velocity),
            action: wide(&track.action),
            target: rows.flat_map(|row| walker.joints.iter().map(|&joint| f64::from(row[joint]))).collect(),
            base: BaseState {
                quaternion: Some(wide(&track.base_quaternion)),
                angular_velocity: Some(wide(&track.base_rates)),
                ..BaseState::default()
            },
            fell_at: track.fell_at,
        }
    }

    /// `log` with what was recorded instead of what it holds.
    pub fn instead_of(self, log: &Trajectory) -> Trajectory {
        Trajectory {
            position: self.position,
            velocity: self.velocity,
            action: Some(self.action),
            target: Some(self.target),
            base: Some(self.base),
            fell: false,
            ..log.clone()
        }
    }
}

/// The log's commands, from the state that its first sample shows.
fn begun(walker: &Walker, log: &Trajectory) -> Script {
    let mut script = script(walker, log);
    let base = log.base.as_ref();
    let attitude = base.and_then(|base| base.quaternion.as_deref()?.first_chunk::<4>());
    let rates = base.and_then(|base| base.angular_velocity.as_deref()?.first_chunk::<3>());
    if let Some(&attitude) = attitude {
        let width = walker.joints.len().min(log.position.len());
        let angles: Vec<f64> = in_model(walker, &log.position[..width], &walker.default_pose)
            .into_iter()
            .map(f64::from)
            .collect();
        script.start.base_position[2] = standing_height(walker.model(), attitude, &angles) as f32;
        script.start.base_quaternion = attitude.map(|x| x as f32);
    }
    if let Some(rates) = rates {
        script.start.base_angular = rates.map(|x| x as f32);
    }
    script.states.clear();
    script
}
