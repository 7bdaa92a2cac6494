//! Many robots at a task, stepped together: what a reinforcement learner of Python trains on.

use crate::errors::value;
use crate::task::{Task, bearable, checked};
use crate::terms::motion;
use crate::vec_rows::{Rows, advance, chunks, row, rows};
use gaitfit_learn::task::{self, Ended, Environment, Saved, Snapshot, TaskError};
use gaitfit_sim::pool;
use numpy::{
    PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray1, PyReadonlyArray2, PyReadwriteArray1,
    PyReadwriteArray2,
};
use pyo3::prelude::*;
use std::sync::{Arc, Mutex, PoisonError};

/// Robots that one thread steps at a time.
const TILE: usize = 256;

/// The robots of a task in tiles.
type Tiles<'a> = Vec<Mutex<Environment<'a>>>;

self_cell::self_cell!(
    struct Scene {
        owner: Arc<task::Task>,
        #[not_covariant]
        dependent: Tiles,
    }
);

/// Many robots at a task. The Python classes around it have the documentation.
#[pyclass(module = "gaitfit._gaitfit")]
pub struct Robots {
    scene: Scene,
    step: u32,
    threads: usize,
    /// Whether robots whose episode ended begin a new one within the step.
    autoreset: bool,
    #[pyo3(get)]
    count: usize,
    observation_width: usize,
    critic_width: usize,
    action_width: usize,
    joints: Vec<String>,
    /// Steps since the reward terms were read.
    summed: usize,
    /// Episodes that ended because the simulation diverged.
    #[pyo3(get)]
    diverged: usize,
}

/// One by one, as a GPU takes and gives them.
impl Robots {
    /// All robots as they are before the next step, and its number.
    pub fn snapshots(&self) -> (Vec<Snapshot>, u32) {
        let mut all = Vec::with_capacity(self.count);
        self.scene.with_dependent(|_, tiles| {
            for tile in tiles {
                let mut tile = tile.lock().unwrap_or_else(PoisonError::into_inner);
                all.extend((0..tile.count()).map(|index| tile.snapshot(index)));
            }
        });
        (all, self.step)
    }

    /// Makes all robots what they were before step `step`.
    pub fn take_up(&mut self, snapshots: &[Snapshot], step: u32) -> PyResult<()> {
        self.scene.with_dependent(|_, tiles| {
            for (tile, snapshots) in tiles.iter().zip(snapshots.chunks(TILE)) {
                let mut tile = tile.lock().unwrap_or_else(PoisonError::into_inner);
                for (index, one) in snapshots.iter().enumerate() {
                    tile.set_snapshot(index, one).map_err(value)?;
                }
                tile.refresh();
            }
            Ok::<_, PyErr>(())
        })?;
        self.step = step;
        Ok(())
    }
}

#[pymethods]
impl Robots {
    /// Robots at a task.
    #[new]
    fn new(
        py: Python<'_>,
        task: &Task,
        count: usize,
        seed: u64,
        threads: Option<usize>,
        stagger: bool,
        autoreset: bool,
    ) -> PyResult<Self> {
        checked(count)?;
        let threads = threads.unwrap_or_else(gaitfit::machine::threads).clamp(1, count.div_ceil(TILE));
        let candidate = task.candidate.clone();
        let scene = py.detach(|| {
            Scene::try_new(task.scene.clone(), |task| -> Result<Tiles<'_>, TaskError> {
                let tile = |first: usize| {
                    let robot = candidate.as_ref();
                    let mut tile =
                        Environment::new(task, robot, seed, first as u32, TILE.min(count - first))?;
                    if stagger {
                        tile.stagger();
                    }
                    Ok(Mutex::new(tile))
                };
                (0..count).step_by(TILE).map(tile).collect()
            })
        });
        Ok(Self {
            scene: scene.map_err(value)?,
            step: 0,
            threads,
            autoreset,
            count,
            observation_width: task.observation_width,
            critic_width: task.critic_width,
            action_width: task.action_width,
            joints: task.joints.clone(),
            summed: 0,
            diverged: 0,
        })
    }

    /// Writes what the robots observe now.
    fn observe(
        &mut self,
        py: Python<'_>,
        mut observation: PyReadwriteArray2<'_, f32>,
        mut critic: PyReadwriteArray2<'_, f32>,
    ) -> PyResult<()> {
        let observation = rows(&mut observation, "observation", self.count, self.observation_width)?;
        let critic = rows(&mut critic, "critic", self.count, self.critic_width)?;
        let (scene, step, threads) = (&self.scene, self.step, self.threads);
        let [wide, critic_wide] =
            [self.observation_width, self.critic_width].map(|width| width.max(1) * TILE);
        py.detach(|| {
            scene.with_dependent(|_, tiles| {
                let jobs = tiles.iter().zip(observation.chunks_mut(wide).zip(chunks(
                    critic,
                    critic_wide,
                    tiles.len(),
                )));
                pool::share(&mut vec![(); threads], jobs, |(), (tile, (observation, critic))| {
                    let tile = tile.lock().unwrap_or_else(PoisonError::into_inner);
                    tile.observe(step, observation);
                    tile.observe_critic(critic);
                });
            });
        });
        Ok(())
    }

    /// One control period. With `autoreset` robots whose episode ended begin a new one at once, and `last` has what they observed
    /// before; without it only robots that diverged do. The number of episodes that ended comes back.
    fn step(
        &mut self,
        py: Python<'_>,
        actions: PyReadonlyArray2<'_, f32>,
        mut observation: PyReadwriteArray2<'_, f32>,
        mut critic: PyReadwriteArray2<'_, f32>,
        mut last: PyReadwriteArray2<'_, f32>,
        mut reward: PyReadwriteArray1<'_, f32>,
        mut terminated: PyReadwriteArray1<'_, bool>,
        mut truncated: PyReadwriteArray1<'_, bool>,
    ) -> PyResult<usize> {
        let (count, width) = (self.count, self.action_width);
        if actions.as_array().dim() != (count, width) {
            let found = actions.as_array().dim();
            return Err(value(format!("actions have the shape {found:?}; needed: {:?}", (count, width))));
        }
        let actions =
            actions.as_slice().map_err(|_| value("actions must be one block of memory, row by row"))?;
        if let Some(at) = actions.iter().position(|action| !action.is_finite()) {
            let (row, column) = (at / width.max(1), at % width.max(1));
            return Err(value(format!(
                "the action of environment {row} for {} is not finite",
                self.joints[column]
            )));
        }
        let observation = rows(&mut observation, "observation", count, self.observation_width)?;
        let critic = rows(&mut critic, "critic", count, self.critic_width)?;
        let last = rows(&mut last, "last", count, self.observation_width)?;
        let reward = row(&mut reward, "reward", count)?;
        let terminated = row(&mut terminated, "terminated", count)?;
        let truncated = row(&mut truncated, "truncated", count)?;
        let (scene, step, threads, autoreset) = (&self.scene, self.step, self.threads, self.autoreset);
        let [wide, critic_wide, action_wide] =
            [self.observation_width, self.critic_width, width].map(|width| width.max(1) * TILE);
        let diverged: Mutex<Vec<usize>> = Mutex::default();
        let ended = Mutex::new(0);
        py.detach(|| {
            scene.with_dependent(|_, tiles| {
                let mut parts =
                    observation.chunks_mut(wide).zip(chunks(critic, critic_wide, tiles.len())).zip(
                        last.chunks_mut(wide).zip(reward.chunks_mut(TILE)).zip(
                            terminated
                                .chunks_mut(TILE)
                                .zip(truncated.chunks_mut(TILE))
                                .zip(actions.chunks(action_wide)),
                        ),
                    );
                let jobs = tiles.iter().enumerate().map_while(|(number, tile)| {
                    let ((observation, critic), ((last, reward), ((terminated, truncated), actions))) =
                        parts.next()?;
                    Some((
                        number,
                        tile,
                        Rows { actions, observation, critic, last, reward, terminated, truncated },
                    ))
                });
                pool::share(&mut vec![(); threads], jobs, |(), (number, tile, rows)| {
                    let mut tile = tile.lock().unwrap_or_else(PoisonError::into_inner);
                    let (ends, broken) = advance(&mut tile, step, rows, autoreset);
                    *ended.lock().unwrap_or_else(PoisonError::into_inner) += ends;
                    let broken = broken.into_iter().map(|robot| number * TILE + robot);
                    diverged.lock().unwrap_or_else(PoisonError::into_inner).extend(broken);
                });
            });
        });
        self.step = self.step.wrapping_add(1);
        self.summed += 1;
        let diverged = diverged.into_inner().unwrap_or_else(PoisonError::into_inner);
        self.diverged += diverged.len();
        bearable(diverged.len(), count, || Ok(diverged.iter().min().copied()))?;
        Ok(ended.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// New episodes for the robots of `mask`, or without one for all.
    #[pyo3(signature = (mask=None))]
    fn restart(&mut self, py: Python<'_>, mask: Option<PyReadonlyArray1<'_, bool>>) -> PyResult<()> {
        let mask = mask.map(|mask| mask.as_array().to_vec());
        if mask.as_ref().is_some_and(|mask| mask.len() != self.count) {
            return Err(value(format!("the mask must have {} elements, one for each robot", self.count)));
        }
        let (scene, step) = (&self.scene, self.step);
        py.detach(|| {
            scene.with_dependent(|_, tiles| {
                for (number, tile) in tiles.iter().enumerate() {
                    let mut tile = tile.lock().unwrap_or_else(PoisonError::into_inner);
                    let begins = |robot: usize| mask.as_ref().is_none_or(|mask| mask[number * TILE + robot]);
                    let ended = |robot| if begins(robot) { Ended::TimeOut } else { Ended::No };
                    let ended: Vec<Ended> = (0..tile.count()).map(ended).collect();
                    tile.begin_episodes(step, &ended);
                }
            });
        });
        self.step = self.step.wrapping_add(1);
        Ok(())
    }

    /// Mean of each weighted reward term, in the order of the task's names, over all robots and the steps since the last
    /// call: a control step's pay. Without steps in between it is 0.
    fn take_terms(&mut self) -> Vec<f64> {
        let steps = std::mem::take(&mut self.summed).max(1);
        let samples = (steps * self.count) as f64;
        let sums = self.scene.with_dependent(|_, tiles| {
            let of = |tile: &Mutex<Environment<'_>>| {
                tile.lock().unwrap_or_else(PoisonError::into_inner).take_terms()
            };
            tiles.iter().map(of).reduce(|sum, one| sum.iter().zip(&one).map(|(a, b)| a + b).collect())
        });
        sums.unwrap_or_default().into_iter().map(|sum| sum / samples).collect()
    }

    /// Everything that changes from step to step: numbers of the tiles, steps of the episodes, and the step.
    fn state<'py>(&self, py: Python<'py>) -> (Bound<'py, PyArray1<f32>>, Bound<'py, PyArray1<u32>>, u32) {
        let (mut numbers, mut steps) = (Vec::new(), Vec::new());
        self.scene.with_dependent(|_, tiles| {
            for tile in tiles {
                let saved = tile.lock().unwrap_or_else(PoisonError::into_inner).save();
                numbers.extend(saved.numbers);
                steps.extend(saved.steps);
            }
        });
        (PyArray1::from_vec(py, numbers), PyArray1::from_vec(py, steps), self.step)
    }

    /// Takes up what `state` gave of robots at the same task. After an error some robots may have been changed.
    fn set_state(
        &mut self,
        numbers: PyReadonlyArray1<'_, f32>,
        steps: PyReadonlyArray1<'_, u32>,
        step: u32,
    ) -> PyResult<()> {
        let foreign = || value("the state is of other robots: another task, robot or num_envs");
        let (numbers, steps) = (numbers.as_slice()?, steps.as_slice()?);
        self.scene.with_dependent(|_, tiles| {
            let (mut numbers, mut steps) = (numbers, steps);
            for tile in tiles {
                let mut tile = tile.lock().unwrap_or_else(PoisonError::into_inner);
                let size = tile.save();
                let split =
                    numbers.split_at_checked(size.numbers.len()).zip(steps.split_at_checked(tile.count()));
                let Some(((mine, other_numbers), (episodes, other_steps))) = split else {
                    return Err(foreign());
                };
                let saved = Saved { numbers: mine.to_vec(), steps: episodes.to_vec() };
                tile.restore(&saved).map_err(|_| foreign())?;
                (numbers, steps) = (other_numbers, other_steps);
            }
            if numbers.is_empty() && steps.is_empty() { Ok(()) } else { Err(foreign()) }
        })?;
        self.step = step;
        Ok(())
    }

    /// How all robots move: position, orientation (wxyz), linear and angular velocity of their bases, then positions, velocities and
    /// torques of the joints that the policy moves, in its order; row by row.
    fn motion<'py>(&self, py: Python<'py>) -> PyResult<Vec<Bound<'py, PyArray2<f32>>>> {
        let mut signals: Vec<(usize, Vec<f32>)> = Vec::new();
        self.scene.with_dependent(|task, tiles| {
            for tile in tiles {
                let tables = motion(task, &tile.lock().unwrap_or_else(PoisonError::into_inner));
                signals.resize_with(tables.len(), Default::default);
                for ((width, into), (columns, from)) in signals.iter_mut().zip(tables) {
                    *width = columns;
                    into.extend(from);
                }
            }
        });
        let arrays = signals
            .into_iter()
            .map(|(width, values)| PyArray1::from_vec(py, values).reshape([self.count, width]));
        arrays.collect()
    }

    /// Where robot `index` is: position of its base, m, world frame, its orientation, wxyz, and joint angles less those at which
    /// the file places the bodies, rad, in the model's order.
    fn pose(&self, index: usize) -> PyResult<([f32; 3], [f32; 4], Vec<f64>)> {
        if index >= self.count {
            return Err(value(format!(
                "there is no robot {index}; they are numbered from 0 to {}",
                self.count - 1
            )));
        }
        Ok(self.scene.with_dependent(|task, tiles| {
            let tile = tiles[index / TILE].lock().unwrap_or_else(PoisonError::into_inner);
            let (motion, row) = (tile.motion(), index % TILE);
            let joints = &task.walker.model().joints;
            let angles = &motion.joint_position[row * joints.len()..(row + 1) * joints.len()];
            (
                std::array::from_fn(|k| motion.base_position[3 * row + k]),
                std::array::from_fn(|k| motion.base_quaternion[4 * row + k]),
                angles.iter().zip(joints).map(|(angle, joint)| f64::from(*angle) - joint.reference).collect(),
            )
        }))
    }

    /// Has the robots follow these commands, until the task draws others.
    fn set_commands(&mut self, commands: Vec<[f32; 3]>) {
        self.scene.with_dependent(|_, tiles| {
            for (tile, commands) in tiles.iter().zip(commands.chunks(TILE)) {
                let mut tile = tile.lock().unwrap_or_else(PoisonError::into_inner);
                commands.iter().enumerate().for_each(|(index, command)| tile.set_command(index, *command));
            }
        });
    }

    /// The commands that the robots follow: ahead and to the side, m/s, and turning, rad/s.
    fn commands(&self) -> Vec<[f32; 3]> {
        self.scene.with_dependent(|_, tiles| {
            let of = |tile: &Mutex<Environment<'_>>| {
                tile.lock().unwrap_or_else(PoisonError::into_inner).commands().to_vec()
            };
            tiles.iter().flat_map(of).collect()
        })
    }
}
