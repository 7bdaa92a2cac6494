//! The task of a training's configuration, for robots that are stepped at it.

use crate::errors::{failed, to_py_err, value};
use gaitfit::device::Device;
use gaitfit::settings::{self, TrainConfig};
use gaitfit::{replay, train};
use gaitfit_learn::{MEND_DIVERGENCE, max_diverged, task};
use gaitfit_sim::Candidate;
use pyo3::prelude::*;
use std::path::PathBuf;
use std::sync::Arc;

/// More robots than any machine has memory for.
const MAX_ENVIRONMENTS: usize = 1 << 20;

/// A task: what robots see and do at it.
#[pyclass(module = "gaitfit._gaitfit", frozen)]
pub struct Task {
    pub scene: Arc<task::Task>,
    /// The robot with the numbers of a fit; without one the robot of its file.
    pub candidate: Option<Candidate>,
    #[pyo3(get)]
    pub observation_width: usize,
    #[pyo3(get)]
    pub critic_width: usize,
    #[pyo3(get)]
    pub action_width: usize,
    #[pyo3(get)]
    pub joints: Vec<String>,
    /// Smallest and largest action of each joint that makes a difference.
    #[pyo3(get)]
    action_bounds: Vec<[f32; 2]>,
    #[pyo3(get)]
    control_dt: f64,
    #[pyo3(get)]
    episode_steps: u32,
    #[pyo3(get)]
    rewards: Vec<String>,
    /// What a policy for the robots sees and does, as JSON.
    #[pyo3(get)]
    interface: String,
    /// Settings, as TOML.
    #[pyo3(get)]
    settings: String,
    /// What the robot looks like, as JSON: its bodies and their shapes.
    #[pyo3(get)]
    shape: String,
}

#[pymethods]
impl Task {
    /// The task of a training's configuration.
    #[new]
    fn new(
        config: Option<PathBuf>,
        sets: Vec<String>,
        robot: Option<String>,
        theta: Option<PathBuf>,
    ) -> PyResult<Self> {
        let mut settings: TrainConfig =
            settings::load(config.as_deref(), &sets).map_err(|error| to_py_err(&error))?;
        settings.robot = robot.or(settings.robot);
        let setup = train::setup(&settings, "env", config.as_deref(), 1, &Device::Cpu.into());
        let setup = setup.map_err(|error| to_py_err(&error))?;
        let (mut task, mut candidate) = (setup.scene, None);
        if let Some(path) = theta {
            let read = |path| {
                let file = gaitfit::theta::read(path)?;
                Ok((gaitfit::theta::candidate(&file, path, &setup.model)?, file))
            };
            let (robot, file) = read(&path).map_err(|error: gaitfit::Error| to_py_err(&error))?;
            let task_settings = &mut settings.task.settings;
            gaitfit::theta::add_self_contact(&file, task_settings);
            // A robot remembers targets for as long as its longest delay.
            let delay = gaitfit::world::longest_delay(&robot);
            let interface = task.walker.interface.clone();
            task = task::Task::with_interface(&setup.model, task_settings, interface, settings.preset, delay)
                .map_err(failed)?;
            candidate = Some(robot);
        }
        let walker = &task.walker;
        let widths = gaitfit_learn::widths(&task);
        Ok(Self {
            observation_width: widths.observation,
            critic_width: widths.critic_observation,
            action_width: widths.action,
            action_bounds: task.action_bounds(),
            joints: walker.interface.joints.clone(),
            control_dt: walker.interface.control_dt,
            episode_steps: task.episode_steps(),
            rewards: task.reward_names().into_iter().map(str::to_owned).collect(),
            interface: serde_json::to_string(&walker.interface).map_err(failed)?,
            settings: toml::to_string(&task.settings).map_err(failed)?,
            shape: serde_json::to_string(&replay::shape("robot", walker.model(), &[])).map_err(failed)?,
            scene: Arc::new(task),
            candidate,
        })
    }
}

/// Refuses a number of robots that no machine has.
pub fn checked(count: usize) -> PyResult<()> {
    if count == 0 || count > MAX_ENVIRONMENTS {
        return Err(value(format!("num_envs is {count}; it must be from 1 to {MAX_ENVIRONMENTS}")));
    }
    Ok(())
}

/// Robots of any number that may diverge in one step. A few may meet with bad actions at once, and each has fallen.
const FEW: f64 = 10.0;

/// Refuses a step in which too many of `count` robots diverged: the simulation is broken then.
pub fn bearable(
    diverged: usize,
    count: usize,
    first: impl FnOnce() -> PyResult<Option<usize>>,
) -> PyResult<()> {
    if diverged as f64 <= max_diverged(count).max(FEW) {
        return Ok(());
    }
    let first = first()?.unwrap_or_default();
    Err(failed(format!(
        "{diverged} of {count} robots diverged, the first of them robot {first}: its state or reward is not \
         finite, or impossible. {MEND_DIVERGENCE}, or smaller actions"
    )))
}
