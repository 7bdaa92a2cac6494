//! Many robots at a task on a GPU, stepped under actions that another library has there.

use crate::dlpack::{DeviceArray, DeviceInput};
use crate::errors::{failed, to_py_err, value};
use crate::task::{Task, bearable, checked};
use crate::vec_env::Robots;
use gaitfit::device::{Device, rollout_error};
use gaitfit_cuda::rollout::{Moved, RolloutError, Shown, Stepper};
use gaitfit_cuda::runtime;
use gaitfit_learn::task;
use gaitfit_sim::Candidate;
use numpy::PyReadonlyArray1;
use pyo3::prelude::*;
use std::sync::Arc;

self_cell::self_cell!(
    struct Scene {
        owner: Arc<task::Task>,
        #[not_covariant]
        dependent: Stepper,
    }
);

/// Many robots at a task on a GPU. The Python classes around it have the documentation.
#[pyclass(module = "gaitfit._gaitfit")]
pub struct CudaRobots {
    /// None only while it is dropped.
    scene: Option<Scene>,
    gpu: runtime::Device,
    #[pyo3(get)]
    count: usize,
    /// Numbers of an action.
    width: usize,
    /// Number of the GPU.
    #[pyo3(get)]
    device: usize,
    /// Handle of the stream that steps run on.
    #[pyo3(get)]
    stream: u64,
    /// Steps since the reward terms were read.
    summed: usize,
    /// Episodes that ended because the simulation diverged.
    #[pyo3(get)]
    diverged: usize,
}

impl Drop for CudaRobots {
    fn drop(&mut self) {
        let _visit = self.gpu.visit();
        self.scene = None;
    }
}

fn named(device: &str) -> PyResult<Device> {
    device.parse().map_err(|wrong| value(format!("device is {device:?}; {wrong}")))
}

/// The device that `auto` means here, for robots; another device's own name.
#[pyfunction]
pub fn robots_device(device: &str) -> PyResult<String> {
    Ok(named(device)?.to_string())
}

fn wrong(error: RolloutError) -> PyErr {
    match error {
        RolloutError::Action { .. } => value(error),
        RolloutError::Steps(_) => failed(error),
        error => to_py_err(&rollout_error(error)),
    }
}

impl CudaRobots {
    /// Does something with the stepper, without Python's lock; the thread's present GPU stays what it is.
    fn with<T: Send>(
        &mut self,
        py: Python<'_>,
        act: impl FnOnce(&mut Stepper<'_>) -> Result<T, RolloutError> + Send,
    ) -> PyResult<T> {
        let Some(scene) = &mut self.scene else { return Err(failed("the robots are gone")) };
        let gpu = &self.gpu;
        py.detach(|| {
            let _visit = gpu.visit();
            scene.with_dependent_mut(|_, stepper| act(stepper))
        })
        .map_err(wrong)
    }
}

#[pymethods]
impl CudaRobots {
    /// Robots at a task. Without `autoreset` those whose episode ended stay as they are.
    #[new]
    fn new(
        py: Python<'_>,
        task: &Task,
        count: usize,
        seed: u64,
        stagger: bool,
        autoreset: bool,
        device: &str,
    ) -> PyResult<Self> {
        checked(count)?;
        let Some(gpu) = named(device)?.open().map_err(|error| to_py_err(&error))? else {
            return Err(value(format!("device is {device:?}; it must be a GPU")));
        };
        let candidate = task.candidate.clone();
        let made = py.detach(|| {
            let _visit = gpu.visit();
            Scene::try_new(task.scene.clone(), |task| {
                let robot = candidate.unwrap_or_else(|| Candidate::nominal(task.walker.model()));
                let mut stepper = Stepper::new(&gpu, task, &[robot], count, seed, stagger)?;
                stepper.hold(!autoreset)?;
                Ok(stepper)
            })
        });
        let scene = made.map_err(wrong)?;
        let stream = scene.with_dependent(|_, stepper| stepper.stream().address());
        let device = gpu.info().ordinal;
        Ok(Self {
            scene: Some(scene),
            gpu,
            count,
            width: task.action_width,
            device,
            stream,
            summed: 0,
            diverged: 0,
        })
    }

    /// An array that steps write, by its name.
    fn array(&self, name: &str) -> PyResult<DeviceArray> {
        let shown = match name {
            "observation" => Shown::Observation,
            "critic_observation" => Shown::CriticObservation,
            "last_observation" => Shown::LastObservation,
            "reward" => Shown::Reward,
            "terminated" => Shown::Terminated,
            "truncated" => Shown::Truncated,
            "ended" => Shown::Ended,
            "commands" => Shown::Commands,
            _ => return Err(value(format!("robots have no array {name:?}"))),
        };
        let Some(scene) = &self.scene else { return Err(failed("the robots are gone")) };
        let array = scene.with_dependent(|_, stepper| stepper.array(shown)).map_err(wrong)?;
        Ok(DeviceArray::new(array))
    }

    /// How all robots move now: the arrays of a `Motion`, which the next call writes over.
    fn motion(&mut self, py: Python<'_>) -> PyResult<Vec<DeviceArray>> {
        self.with(py, |stepper| {
            stepper.observe_motion()?;
            let parts = [
                Moved::BasePosition,
                Moved::BaseQuaternion,
                Moved::BaseLinear,
                Moved::BaseAngular,
                Moved::JointPosition,
                Moved::JointVelocity,
                Moved::Torque,
            ];
            parts.into_iter().map(|part| stepper.array(Shown::Motion(part))).collect::<Result<Vec<_>, _>>()
        })
        .map(|arrays| arrays.into_iter().map(DeviceArray::new).collect())
    }

    /// One control period. With `autoreset` robots whose episode ended begin a new one at once. The number of episodes that ended comes back.
    fn step(&mut self, py: Python<'_>, actions: &DeviceInput) -> PyResult<usize> {
        if (actions.shape, actions.device) != ((self.count, self.width), self.device) {
            return Err(value("the actions were checked for other robots"));
        }
        let address = actions.address;
        let stepped = self.with(py, |stepper| stepper.step(address.into()))?;
        self.summed += 1;
        self.diverged += stepped.diverged;
        let count = self.count;
        bearable(stepped.diverged, count, || self.with(py, |stepper| Ok(stepper.first_diverged()?)))?;
        Ok(stepped.ended)
    }

    /// New episodes for the robots of `mask`, or without one for all. With `clear` the last step of these robots pays and ends nothing.
    #[pyo3(signature = (mask=None, clear=false))]
    fn restart(
        &mut self,
        py: Python<'_>,
        mask: Option<PyReadonlyArray1<'_, bool>>,
        clear: bool,
    ) -> PyResult<()> {
        let chosen = mask.map_or_else(|| vec![true; self.count], |mask| mask.as_array().to_vec());
        if chosen.len() != self.count {
            return Err(value(format!("the mask must have {} elements, one for each robot", self.count)));
        }
        self.with(py, |stepper| match clear {
            true => Ok(stepper.restart_without_step(&chosen)?),
            false => Ok(stepper.restart_those(&chosen)?),
        })
    }

    /// As that of `Robots`.
    fn take_terms(&mut self, py: Python<'_>) -> PyResult<Vec<f64>> {
        let steps = std::mem::take(&mut self.summed).max(1);
        let sums = self.with(py, |stepper| Ok(stepper.take_terms()))?;
        Ok(sums.into_iter().map(|sum| sum / (steps * self.count) as f64).collect())
    }

    /// As that of `Robots`.
    fn set_commands(&mut self, py: Python<'_>, commands: Vec<[f32; 3]>) -> PyResult<()> {
        self.with(py, |stepper| {
            let (mut all, step) = stepper.state()?;
            all.iter_mut().zip(commands).for_each(|(one, command)| one.command = command);
            stepper.set_state(&all, step)
        })
    }

    /// Makes robots of the same task and number on the processor what these are now.
    fn show(&mut self, py: Python<'_>, robots: &mut Robots) -> PyResult<()> {
        let (all, step) = self.with(py, |stepper| stepper.state())?;
        robots.take_up(&all, step)
    }

    /// Makes these robots what those of the same task and number on the processor are.
    fn follow(&mut self, py: Python<'_>, robots: &Robots) -> PyResult<()> {
        let (all, step) = robots.snapshots();
        self.with(py, |stepper| stepper.set_state(&all, step))
    }
}
