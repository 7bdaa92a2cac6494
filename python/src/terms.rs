//! Reward and ends of episodes of a training by functions of Python.

use crate::watch::Caller;
use gaitfit_learn::task::{Ended, Environment, Task, UserTerms};
use numpy::{PyArray1, PyArrayMethods, PyReadonlyArray1};
use pyo3::prelude::*;

/// Numbers of a tile, row by row: how many a row has, and all of them.
pub type Table = (usize, Vec<f32>);

/// What functions get of a tile after a control step.
pub struct Step {
    /// As [`motion`] has it.
    motion: Vec<Table>,
    commands: Table,
    reward: Vec<f32>,
    terminated: Vec<bool>,
    truncated: Vec<bool>,
}

/// What they return: rewards, and whose episode ends by a fall or by a term.
pub type Answer = (Vec<f32>, Vec<bool>);

/// How the robots of a tile move: position, orientation (wxyz), linear and angular velocity of their bases, then positions,
/// velocities and torques of the joints that the policy moves, in its order.
pub fn motion(task: &Task, tile: &Environment<'_>) -> Vec<Table> {
    let (all, moved) = (task.walker.model().joints.len().max(1), &task.walker.joints);
    let motion = tile.motion();
    let whole = [
        (3, &motion.base_position),
        (4, &motion.base_quaternion),
        (3, &motion.base_linear),
        (3, &motion.base_angular),
    ];
    let of_joints = [&motion.joint_position, &motion.joint_velocity, &motion.torque].map(|from| {
        let rows = from.chunks(all).flat_map(|row| moved.iter().map(|&joint| row[joint]));
        (moved.len(), rows.collect())
    });
    whole.into_iter().map(|(columns, from)| (columns, from.to_vec())).chain(of_joints).collect()
}

/// The terms of a task whose functions `caller`'s thread calls.
pub fn user_terms(caller: Caller) -> UserTerms {
    UserTerms::new(move |environment, reward, ended| {
        let mut tables = motion(environment.task(), environment);
        let diverged = |at: usize| ended[at] == Ended::Diverged;
        for (number, (width, values)) in tables.iter_mut().enumerate() {
            let rows = values.chunks_mut((*width).max(1)).enumerate();
            for (_, row) in rows.filter(|(at, _)| diverged(*at)) {
                // Its numbers are none. What functions make of these does not count.
                row.fill(0.0);
                if number == 1 {
                    row[0] = 1.0;
                }
            }
        }
        let step = Step {
            motion: tables,
            commands: (3, environment.commands().iter().flatten().copied().collect()),
            reward: reward.to_vec(),
            terminated: ended.iter().map(|end| matches!(end, Ended::Fall | Ended::Diverged)).collect(),
            truncated: ended.iter().map(|end| *end == Ended::TimeOut).collect(),
        };
        let Some((rewards, over)) = caller.terms(step) else { return false };
        if rewards.len() != reward.len() || over.len() != ended.len() {
            return false;
        }
        reward.copy_from_slice(&rewards);
        for (end, over) in ended.iter_mut().zip(over) {
            *end = if over { Ended::Fall } else { *end };
        }
        true
    })
}

/// Calls `terms(motion, commands, reward, terminated, truncated)`.
pub fn called(py: Python<'_>, terms: &Py<PyAny>, step: Step) -> PyResult<Answer> {
    let array = |(width, values): Table| {
        let rows = values.len() / width.max(1);
        PyArray1::from_vec(py, values).reshape([rows, width])
    };
    let motion = step.motion.into_iter().map(array).collect::<PyResult<Vec<_>>>()?;
    let given = (
        motion,
        array(step.commands)?,
        PyArray1::from_vec(py, step.reward),
        PyArray1::from_vec(py, step.terminated),
        PyArray1::from_vec(py, step.truncated),
    );
    let (rewards, over): (PyReadonlyArray1<'_, f32>, PyReadonlyArray1<'_, bool>) =
        terms.call1(py, given)?.extract(py)?;
    Ok((rewards.as_array().to_vec(), over.as_array().to_vec()))
}
