//! A training run's whole state as one safetensors file: a training that reads it resumes with the same bits.
//!
//! | tensor | type, shape |
//! | --- | --- |
//! | `learner.actor`, `.critic`, `.log_std`, `.adam.first`, `.adam.second` | F32, flat |
//! | `learner.actor_memory.weight_ih_l0`, …; `learner.critic_memory.…` | F32, flat: of recurrent layers, if there are any |
//! | `tile.N.numbers` | F32, flat: the robots' states, see [`Environment::save`](crate::task::Environment::save) |
//! | `tile.N.steps` | U32 `environments`: steps since each episode began |
//! | `tile.N.returns` | F32 `environments × 2`: reward and steps since each episode began |
//! | `tile.N.actor_memory`, `.critic_memory` | F32, flat: what recurrent layers remember, if there are any |
//!
//! The metadata has one entry, `gaitfit-checkpoint`: a JSON object with the file's checksum, format version, origin,
//! instruction set, iteration, wall time, the learner's scalars and, where commands grow, how far they have.

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests;

use std::collections::HashMap;
use std::sync::PoisonError;

use gaitfit_policy_files::checksum;
use safetensors::tensor::{Dtype, SafeTensors, TensorView, serialize};
use serde::{Deserialize, Serialize};

use crate::curriculum::Growth;
use crate::ppo::{Scalars, StateError};
use crate::task::{Saved, TaskError};
use crate::training::Training;

/// Version of the layout; a reader refuses every other.
const FORMAT: u32 = 2;
/// Key of the metadata under which the header is.
const KEY: &str = "gaitfit-checkpoint";
/// Tensors of a tile for what the actor and the critic remember.
const MEMORIES: [&str; 2] = ["actor_memory", "critic_memory"];
/// Bytes before the digits of the checksum: the metadata's key and the beginning of its JSON, as JSON text.
const BEFORE: &[u8] = br#""gaitfit-checkpoint":"{\"sha256\":\""#;

/// The training that a checkpoint belongs to. No other training takes it up.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Origin {
    /// Name of the robot.
    pub robot: String,
    /// SHA-256 of the robot as compiled, hexadecimal.
    pub model: String,
    /// SHA-256 of the settings that determine the training, hexadecimal.
    pub settings: String,
    /// Seed of the training.
    pub seed: u64,
}

#[derive(Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
struct Header {
    /// First, where [`checksum`] looks for it.
    sha256: String,
    format: u32,
    origin: Origin,
    isa: String,
    iteration: u32,
    wall_seconds: f64,
    learner: Scalars,
    /// State of the curriculum; absent if commands do not grow.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    growth: Option<Growth>,
}

/// Why a checkpoint cannot be taken up; no message names the file, the caller does.
#[derive(Debug, thiserror::Error)]
pub enum CheckpointError {
    /// Cut short, damaged, or something else.
    #[error("no whole checkpoint: {0}")]
    Damaged(String),
    /// The file has another version.
    #[error(
        "a checkpoint of format {found}; this program reads format {FORMAT}, use the program that wrote it"
    )]
    Format {
        /// Its version.
        found: u32,
    },
    /// The file belongs to another training.
    #[error("a checkpoint of another training: {0}")]
    Foreign(String),
    /// The learner's part.
    #[error(transparent)]
    Learner(#[from] StateError),
    /// The robots' part.
    #[error(transparent)]
    Task(#[from] TaskError),
}

fn damaged(error: impl std::fmt::Display) -> CheckpointError {
    CheckpointError::Damaged(error.to_string())
}

impl Origin {
    /// Returns the first difference from `expected`, in words.
    fn difference(&self, expected: &Self) -> Option<String> {
        if self.robot != expected.robot {
            return Some(format!("it is of robot `{}`, this one trains `{}`", self.robot, expected.robot));
        }
        if self.model != expected.model {
            return Some(format!("the robot `{}` has changed since", self.robot));
        }
        if self.settings != expected.settings {
            return Some("the settings have changed since".to_owned());
        }
        (self.seed != expected.seed)
            .then(|| format!("it is of seed {}, this one has seed {}", self.seed, expected.seed))
    }
}

impl Training<'_> {
    /// The state between two iterations as a file's bytes. `wall_seconds`: time spent so far, s, kept for
    /// [`Training::restore`].
    ///
    /// # Errors
    /// None that a state of this program should meet.
    pub fn save(&mut self, origin: &Origin, wall_seconds: f64) -> Result<Vec<u8>, CheckpointError> {
        // safetensors holds numbers in little-endian order on every machine.
        let single =
            |values: &[f32]| -> Vec<u8> { values.iter().flat_map(|value| value.to_le_bytes()).collect() };
        let mut tensors: Vec<(String, Vec<usize>, Dtype, Vec<u8>)> = Vec::new();
        for (name, values) in self.learner.tensors() {
            tensors.push((format!("learner.{name}"), vec![values.len()], Dtype::F32, single(values)));
        }
        for (name, values) in self.learner.memory_tensors() {
            tensors.push((format!("learner.{name}"), vec![values.len()], Dtype::F32, single(values)));
        }
        // Each tile has tensors of its own, so a training with another split into tiles cannot take them up
        // by chance.
        for (tile, runner) in self.runners.iter_mut().enumerate() {
            // A panic of a thread poisons its lock. No thread runs now, so the lock only has to be opened.
            let runner = runner.get_mut().unwrap_or_else(PoisonError::into_inner);
            let memories = runner.recorder.memories(&self.learner, runner.environment.count());
            for (name, values) in MEMORIES.into_iter().zip(memories).filter(|(_, values)| !values.is_empty())
            {
                tensors.push((
                    format!("tile.{tile}.{name}"),
                    vec![values.len()],
                    Dtype::F32,
                    single(&values),
                ));
            }
            let Saved { numbers, steps } = runner.environment.save();
            let returns = runner.returns.as_flattened();
            let count = steps.len();
            let steps = steps.iter().flat_map(|step| step.to_le_bytes()).collect();
            tensors.push((format!("tile.{tile}.numbers"), vec![numbers.len()], Dtype::F32, single(&numbers)));
            tensors.push((format!("tile.{tile}.steps"), vec![count], Dtype::U32, steps));
            tensors.push((format!("tile.{tile}.returns"), vec![count, 2], Dtype::F32, single(returns)));
        }
        let header = Header {
            sha256: checksum::blank(),
            format: FORMAT,
            origin: origin.clone(),
            // Widths of vectors change the last bits of sums, so the instructions belong to the state.
            isa: self.task.walker.batch.isa().name().to_owned(),
            iteration: self.iteration,
            wall_seconds,
            learner: self.learner.scalars(),
            // A training without a curriculum writes no state of one.
            growth: self.task.settings.command.curriculum.as_ref().map(|_| self.growth),
        };
        let header = serde_json::to_string(&header).map_err(damaged)?;
        let views = tensors.iter().map(|(name, shape, dtype, bytes)| {
            TensorView::new(*dtype, shape.clone(), bytes).map(|view| (name.as_str(), view))
        });
        // Collected first: a shape that does not fit its bytes must stop the writing.
        let views: Vec<_> = views.collect::<Result<_, _>>().map_err(damaged)?;
        // Only the place of the checksum is still blank in these bytes: `seal` computes it over the whole file.
        let mut bytes = serialize(views, Some(HashMap::from([(KEY.to_owned(), header)]))).map_err(damaged)?;
        if !checksum::seal(&mut bytes, BEFORE) {
            return Err(damaged("its metadata has no place for the checksum"));
        }
        Ok(bytes)
    }

    /// Takes up a state that [`Training::save`] wrote; from there on both do the same to the bit. Returns the wall
    /// time spent before, s.
    ///
    /// # Errors
    /// A file cut short or changed in any bit, of another robot, other settings, another seed or another kind
    /// of processor; the training is then of no use.
    pub fn restore(&mut self, bytes: &[u8], origin: &Origin) -> Result<f64, CheckpointError> {
        // The header is judged before any tensor: it says which program, training and machine wrote the file.
        let file = SafeTensors::deserialize(bytes)
            .map_err(|error| damaged(format!("it is cut short or damaged ({error})")))?;
        let header = header(bytes)?;
        if let Some(difference) = header.origin.difference(origin) {
            return Err(CheckpointError::Foreign(difference));
        }
        let isa = self.task.walker.batch.isa().name();
        if header.isa != isa {
            return Err(CheckpointError::Foreign(format!(
                "it was written with {} instructions, this machine has {isa}; continue on a machine of the same kind",
                header.isa
            )));
        }
        let numbers = |name: &str| -> Result<Vec<f32>, CheckpointError> {
            let view = file.tensor(name).map_err(damaged)?;
            if view.dtype() != Dtype::F32 {
                return Err(damaged(format!("tensor {name} is {:?}, not F32", view.dtype())));
            }
            // `deserialize` has checked that a tensor's bytes are whole numbers of its type, so no bytes are
            // left over.
            Ok(view.data().as_chunks().0.iter().map(|&b| f32::from_le_bytes(b)).collect())
        };
        // The learner checks all its tensors together before it changes, so they are read first.
        let mut learner = Vec::new();
        let flat = self.learner.tensors().into_iter().map(|(name, _)| name.to_owned());
        for name in flat.chain(self.learner.memory_tensors().into_iter().map(|(name, _)| name)) {
            let values = numbers(&format!("learner.{name}"))?;
            learner.push((name, values));
        }
        let tensor = |name: &str| learner.iter().find(|(known, _)| known == name).map(|(_, v)| v.as_slice());
        self.learner.restore(tensor, &header.learner)?;
        // Then the robots, tile by tile. Another split into tiles fails by a missing name or by a size.
        for (tile, runner) in self.runners.iter_mut().enumerate() {
            let runner = runner.get_mut().unwrap_or_else(PoisonError::into_inner);
            let name = format!("tile.{tile}.steps");
            let view = file.tensor(&name).map_err(damaged)?;
            if view.dtype() != Dtype::U32 {
                return Err(damaged(format!("tensor {name} is {:?}, not U32", view.dtype())));
            }
            let steps = view.data().as_chunks().0.iter().map(|&b| u32::from_le_bytes(b)).collect();
            let saved = Saved { numbers: numbers(&format!("tile.{tile}.numbers"))?, steps };
            runner.environment.restore(&saved)?;
            let returns = numbers(&format!("tile.{tile}.returns"))?;
            if returns.len() != 2 * runner.returns.len() {
                return Err(damaged(format!("tensor tile.{tile}.returns has {} numbers", returns.len())));
            }
            if let Some(bad) = returns.iter().find(|x| !x.is_finite()) {
                return Err(damaged(format!("tensor tile.{tile}.returns holds {bad}")));
            }
            runner.returns.as_flattened_mut().copy_from_slice(&returns);
            let count = runner.environment.count();
            let mut memories = [Vec::new(), Vec::new()];
            // For no robots: this only shows which of the two have layers.
            let blank = self.learner.blank_memories(0);
            for ((values, name), blank) in memories.iter_mut().zip(MEMORIES).zip(blank) {
                if blank.is_empty() {
                    continue;
                }
                *values = numbers(&format!("tile.{tile}.{name}"))?;
                if let Some(bad) = values.iter().find(|x| !x.is_finite()) {
                    return Err(damaged(format!("tensor tile.{tile}.{name} holds {bad}")));
                }
            }
            if !runner.recorder.set_memories(&self.learner, count, &memories) {
                return Err(damaged(format!("the memories of tile {tile} have another number of numbers")));
            }
        }
        self.iteration = header.iteration;
        // A training without a curriculum has written none, and reads none.
        self.growth = header.growth.unwrap_or_default();
        // The curriculum subtracts `last` from the iteration, both unsigned.
        if self.growth.last > self.iteration {
            let last = self.growth.last;
            return Err(damaged(format!("its commands grew in iteration {last}, which it has not done")));
        }
        Ok(header.wall_seconds)
    }
}

fn header(bytes: &[u8]) -> Result<Header, CheckpointError> {
    let (_, metadata) = SafeTensors::read_metadata(bytes).map_err(damaged)?;
    let text = metadata
        .metadata()
        .as_ref()
        .and_then(|entries| entries.get(KEY))
        .ok_or_else(|| damaged("its metadata is not a checkpoint's"))?;
    #[derive(Deserialize)]
    struct Version {
        format: u32,
    }
    let version: Version = serde_json::from_str(text).map_err(damaged)?;
    // Before the checksum and the other fields, so that a file of another version is not called damaged.
    if version.format != FORMAT {
        return Err(CheckpointError::Format { found: version.format });
    }
    if !checksum::intact(bytes, BEFORE) {
        return Err(damaged("its checksum does not match: a bit has flipped, or a value was edited"));
    }
    serde_json::from_str(text).map_err(damaged)
}
