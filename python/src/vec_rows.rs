//! A step of one tile of robots, and the arrays of Python that it fills.

use crate::errors::value;
use gaitfit_learn::task::{Ended, Environment};
use numpy::{PyReadwriteArray1, PyReadwriteArray2};
use pyo3::prelude::*;

/// The arrays of one step, as one tile sees them.
pub struct Rows<'a> {
    /// `robots × joints`.
    pub actions: &'a [f32],
    pub observation: &'a mut [f32],
    pub critic: &'a mut [f32],
    pub last: &'a mut [f32],
    pub reward: &'a mut [f32],
    pub terminated: &'a mut [bool],
    pub truncated: &'a mut [bool],
}

/// Steps a tile; how many episodes ended, and the robots that diverged.
pub fn advance(
    tile: &mut Environment<'_>,
    step: u32,
    rows: Rows<'_>,
    autoreset: bool,
) -> (usize, Vec<usize>) {
    let mut ended = vec![Ended::No; tile.count()];
    tile.step(step, rows.actions, rows.reward, &mut ended);
    for (index, ended) in ended.iter().enumerate() {
        rows.terminated[index] = matches!(ended, Ended::Fall | Ended::Diverged);
        rows.truncated[index] = *ended == Ended::TimeOut;
    }
    let ends = ended.iter().filter(|&&ended| ended != Ended::No).count();
    let broken: Vec<usize> = (0..ended.len()).filter(|&index| ended[index] == Ended::Diverged).collect();
    if !autoreset {
        // A state that is not finite cannot be stepped further.
        ended.iter_mut().filter(|ended| **ended != Ended::Diverged).for_each(|ended| *ended = Ended::No);
        tile.begin_episodes(step, &ended);
    } else if ends > 0 {
        tile.observe(step.wrapping_add(1), rows.last);
        let width = rows.last.len() / ended.len();
        for index in &broken {
            rows.last[index * width..(index + 1) * width].fill(0.0);
        }
        tile.begin_episodes(step, &ended);
    }
    tile.observe(step.wrapping_add(1), rows.observation);
    tile.observe_critic(rows.critic);
    (ends, broken)
}

/// The parts of `values` of `count` tiles; a task without a critic's observation has empty ones.
pub fn chunks(values: &mut [f32], size: usize, count: usize) -> impl Iterator<Item = &mut [f32]> + Send {
    let mut rest = Some(values);
    (0..count).map_while(move |_| {
        let values = rest.take()?;
        let (first, others) = values.split_at_mut(size.min(values.len()));
        rest = Some(others);
        Some(first)
    })
}

/// The numbers of an array `count × width`.
///
/// # Errors
/// Another shape, or an array that is not one block.
pub fn rows<'a>(
    array: &'a mut PyReadwriteArray2<'_, f32>,
    what: &str,
    count: usize,
    width: usize,
) -> PyResult<&'a mut [f32]> {
    let shape = array.as_array().dim();
    if shape != (count, width) {
        return Err(value(format!("{what} has the shape {shape:?}; needed: {:?}", (count, width))));
    }
    array.as_slice_mut().map_err(|_| value(format!("{what} must be one block of memory, row by row")))
}

/// The numbers of an array with `count` of them.
///
/// # Errors
/// As [`rows`].
pub fn row<'a, T: numpy::Element>(
    array: &'a mut PyReadwriteArray1<'_, T>,
    what: &str,
    count: usize,
) -> PyResult<&'a mut [T]> {
    if array.as_array().len() != count {
        return Err(value(format!("{what} has {} numbers; needed: {count}", array.as_array().len())));
    }
    array.as_slice_mut().map_err(|_| value(format!("{what} must be one block of memory")))
}
