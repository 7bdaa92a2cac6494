//! A robot that walked: the policy, its task and the simulator in which it walks again.

use super::simulator::WalkSimulator;
use crate::Error;
use crate::gpu_predictions::GpuPredictions;
use crate::log::Log;
use crate::settings::{AdaptConfig, Preset, SimulationConfig};
use crate::world;
use gaitfit_adapt::{JointParameter, Theta};
use gaitfit_learn::task::{Task, TaskSettings};
use gaitfit_model::Model;
use gaitfit_policy::Policy;
use gaitfit_sim::Candidate;
use std::sync::Arc;

/// A policy on a robot.
pub struct Walking {
    /// The policy that walked.
    pub policy: Policy,
    /// Its task, without noise, pushes and variety, and the simulator.
    pub task: Task,
    /// Threads.
    pub threads: usize,
    /// The GPUs that simulate, instead of the CPU; none for the CPU.
    pub gpus: Vec<crate::device::Gpu>,
    /// Short predictions on the first of them.
    pub predictions: GpuPredictions,
}

impl Walking {
    /// The policy on the robot of `model`. Candidates may have the delays of `base` and `theta`.
    ///
    /// # Errors
    /// A policy that is not this robot's; a task in its file that cannot be read.
    pub fn new(
        config: &AdaptConfig,
        policy: Policy,
        model: &Model,
        theta: &Theta,
        base: &Candidate,
        threads: usize,
    ) -> Result<Self, Error> {
        let settings = settings(config, &policy, model)?;
        let task = task(config.simulation.preset, settings, &policy, model, theta, base)?;
        Ok(Self { policy, task, threads, gpus: Vec::new(), predictions: GpuPredictions::default() })
    }

    /// The same robot as it makes logs: at its own step, where the configuration or the policy's task states it, with
    /// contacts solved accurately.
    ///
    /// # Errors
    /// As [`Self::new`].
    pub fn robot(
        config: &AdaptConfig,
        policy: Policy,
        model: &Model,
        theta: &Theta,
        base: &Candidate,
        threads: usize,
    ) -> Result<Self, Error> {
        let mut settings = settings(config, &policy, model)?;
        let mut preset = config.simulation.preset;
        if let Some(step) = settings.robot_timestep {
            let period = policy.interface.control_dt;
            // A step must divide the control period. Where the divided step differs from the robot's, the
            // robot's is kept beside it.
            settings.substeps = substeps(period, step.max(MIN_STEP));
            let split = period / settings.substeps as f64;
            settings.robot_timestep = Some(step).filter(|step| (split - step).abs() > 1e-3 * split);
            preset = Preset::Accurate;
        }
        let task = task(preset, settings, &policy, model, theta, base)?;
        Ok(Self { policy, task, threads, gpus: Vec::new(), predictions: GpuPredictions::default() })
    }

    /// Names of the policy's joints, in its order.
    pub fn joints(&self) -> Vec<String> {
        let walker = &self.task.walker;
        let model = walker.batch.model();
        walker.joints.iter().map(|&joint| model.joints[joint].name.clone()).collect()
    }

    /// Runs the policy on candidates under the commands of `logs`. `base`: the robot that θ changes.
    pub fn simulator(self: &Arc<Self>, base: Candidate, logs: &[Log]) -> WalkSimulator {
        let trajectories: Vec<_> = logs.iter().map(|log| &log.trajectory).collect();
        WalkSimulator::new(Arc::clone(self), base, &trajectories).with_filled(logs)
    }
}

/// The policy's default pose in the model's order, rad.
///
/// # Errors
/// A policy that is not this robot's.
pub fn rest_angles(policy: &Policy, model: &Model) -> Result<Vec<f64>, Error> {
    policy.interface.model_pose(model).map_err(Error::failed)
}

/// Shortest step of a robot that makes logs, s: those of motor boards beyond it cost much time and change little.
const MIN_STEP: f64 = 5e-4;

/// Physics steps of at most `step` in a control period. A period of 20 ms and a step of 5 ms mean four, whatever the last
/// digit says.
fn substeps(period: f64, step: f64) -> usize {
    (period / step - 0.01).ceil().max(1.0) as usize
}

/// Largest physics step of a fit, s. If the configuration leaves the default, it is at most that of the policy's training:
/// robots with stiff gains or much damping shake with longer ones.
///
/// # Errors
/// A task in the policy's file that cannot be read.
pub fn timestep(config: &AdaptConfig, policy: &Policy) -> Result<f64, Error> {
    let step = config.simulation.timestep;
    // A step that the user chose stays, even if it is longer than that of the training.
    if step != SimulationConfig::default().timestep {
        return Ok(step);
    }
    let trained =
        world::trained_task(policy)?.map(|task| policy.interface.control_dt / task.substeps.max(1) as f64);
    Ok(trained.map_or(step, |trained| step.min(trained)))
}

/// Number of feet of the robot of the policy's task.
///
/// # Errors
/// A task in the policy's file that cannot be read.
pub fn feet(config: &AdaptConfig, policy: &Policy, model: &Model) -> Result<usize, Error> {
    Ok(settings(config, policy, model)?.feet.len())
}

/// The policy's task as the configuration has it simulated.
fn settings(config: &AdaptConfig, policy: &Policy, model: &Model) -> Result<TaskSettings, Error> {
    // A policy that was trained elsewhere has no task. The usual one of the robot stands in.
    let mut settings = match world::trained_task(policy)? {
        Some(task) => task,
        None => world::usual_task(model)?,
    };
    settings.substeps = substeps(policy.interface.control_dt, config.simulation.timestep);
    // What the configuration states about the robot wins over what the training assumed.
    settings.robot_timestep = config.simulation.robot_timestep.or(settings.robot_timestep);
    if let Some(chosen) = &config.simulation.self_contact {
        settings.self_contact = chosen.clone();
    }
    Ok(settings)
}

fn task(
    preset: Preset,
    settings: TaskSettings,
    policy: &Policy,
    model: &Model,
    theta: &Theta,
    base: &Candidate,
) -> Result<Task, Error> {
    let interface = policy.interface.clone();
    let delay = base.robot.delay.iter().fold(0.0f64, |max, &delay| max.max(delay));
    // The simulator keeps as many past targets as the longest delay needs, so it must know this delay now.
    let delay = delay.max(theta.largest(JointParameter::Delay).unwrap_or(0.0));
    Task::with_interface(model, &settings.calm(), interface, preset, delay).map_err(Error::failed)
}
