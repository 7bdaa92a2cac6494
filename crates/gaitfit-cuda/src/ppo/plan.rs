//! The update as data: arrays, and kernels in order. A GPU runs it, and so does the test without one.

use gaitfit_learn::ppo::{Settings, Widths};

use super::text::{LOSSES, MOST_ACTIONS, THREADS, Text};
use crate::runtime::Shape;

/// Sizes of a rollout.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Batch {
    /// Control steps.
    pub steps: usize,
    /// Environments.
    pub environments: usize,
    /// Environments of a tile of the CPU's learner, which numbers samples tile by tile: the deal of the samples is then
    /// the same. The last tile may be smaller.
    pub tile: usize,
}

impl Batch {
    /// Samples in all.
    pub fn rows(&self) -> usize {
        self.steps * self.environments
    }
}

/// What an array holds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Kind {
    /// 32-bit floats.
    F32,
    /// 64-bit floats.
    F64,
    /// 32-bit words.
    U32,
}

/// Number of an array in [`Plan::arrays`].
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Id(pub usize);

/// One array.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Array {
    /// Its name.
    pub name: &'static str,
    /// Its numbers' type.
    pub kind: Kind,
    /// Numbers in it.
    pub length: usize,
}

/// An argument of a kernel.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Value {
    /// Pointer to an array's beginning.
    Array(Id),
    /// A word.
    U32(u32),
    /// A float.
    F32(f32),
}

/// One kernel's start.
#[derive(Clone, Debug, PartialEq)]
pub struct Launch {
    /// Name in the text.
    pub kernel: &'static str,
    /// Threads.
    pub shape: Shape,
    /// Arguments in order.
    pub arguments: Vec<Value>,
}

/// Arrays and launches of an update.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// All arrays.
    pub arrays: Vec<Array>,
    /// Renews the padded copy of the parameters; once, after they were set from outside.
    pub pack: Launch,
    /// The update.
    pub launches: Vec<Launch>,
}

/// Arrays that `check_finite` looks at, in the order of `gaitfit_learn::ppo::Samples`.
pub(super) const CHECKED: [&str; 9] = [
    "observation",
    "critic_observation",
    "action",
    "mean",
    "log_probability",
    "value",
    "reward",
    "done",
    "last_value",
];
/// Rows of a block of `statistics_of`, and of `shuffle_place`.
const CHUNK: usize = 256;
/// `STATE_SIZE` and `CONTROL_SIZE` of the text.
pub(super) const STATE_SIZE: usize = 19;
pub(super) const CONTROL_SIZE: usize = 5;

/// Collects arrays and launches.
struct Maker {
    arrays: Vec<Array>,
    launches: Vec<Launch>,
}

impl Maker {
    fn array(&mut self, name: &'static str, kind: Kind, length: usize) -> Value {
        self.arrays.push(Array { name, kind, length });
        Value::Array(Id(self.arrays.len() - 1))
    }

    fn launch(&mut self, kernel: &'static str, shape: Shape, arguments: &[Value]) {
        self.launches.push(Launch { kernel, shape, arguments: arguments.to_vec() });
    }
}

fn word(value: usize) -> Value {
    Value::U32(u32::try_from(value).unwrap_or(u32::MAX))
}

/// What the plan is made for.
pub(super) struct Task<'a> {
    pub settings: &'a Settings,
    pub widths: Widths,
    pub batch: Batch,
    /// Multiprocessors.
    pub processors: usize,
    /// Whether the actor's and the critic's observations are normalised.
    pub normalised: [bool; 2],
}

impl Plan {
    /// The update of one learner.
    pub(super) fn new(task: &Task<'_>, text: &Text) -> Self {
        let Task { settings, widths, batch, .. } = *task;
        let Settings { epochs, minibatches, .. } = *settings;
        let (rows, actions) = (batch.rows(), widths.action.min(MOST_ACTIONS));
        let networks = text.actor.map.len() + text.critic.map.len();
        let size = networks + actions;
        let begin = |number: usize| number * rows / minibatches;
        let smallest = (0..minibatches).map(|number| begin(number + 1) - begin(number)).min().unwrap_or(0);
        let [actor_blocks, critic_blocks] =
            share(task.processors, smallest.div_ceil(text.rows), [text.actor.work, text.critic.work]);
        let reduce_blocks = networks.div_ceil(256);
        let chunks = rows.div_ceil(CHUNK);
        let cards = epochs * rows;

        let mut maker = Maker { arrays: Vec::new(), launches: Vec::new() };
        let m = &mut maker;
        let observation = m.array("observation", Kind::F32, rows * widths.observation);
        let critic_observation = m.array("critic_observation", Kind::F32, rows * widths.critic_observation);
        let action = m.array("action", Kind::F32, rows * actions);
        let mean = m.array("mean", Kind::F32, rows * actions);
        let log_probability = m.array("log_probability", Kind::F32, rows);
        let value = m.array("value", Kind::F32, rows);
        let reward = m.array("reward", Kind::F32, rows);
        let done = m.array("done", Kind::F32, rows);
        let last_value = m.array("last_value", Kind::F32, batch.environments);
        let checked =
            [observation, critic_observation, action, mean, log_probability, value, reward, done, last_value];
        let advantage = m.array("advantage", Kind::F32, rows);
        let returns = m.array("returns", Kind::F32, rows);
        let parameters = m.array("parameters", Kind::F32, size);
        let moments = m.array("moments", Kind::F32, 2 * size);
        let gradient = m.array("gradient", Kind::F32, size);
        let packed = m.array("packed", Kind::F32, text.actor.packed + text.critic.packed);
        let partial = m.array(
            "partial",
            Kind::F32,
            actor_blocks * text.actor.gradient + critic_blocks * text.critic.gradient,
        );
        let sums = m.array("sums", Kind::F64, (actor_blocks + critic_blocks) * (LOSSES + actions));
        let squares = m.array("squares", Kind::F64, 2 * reduce_blocks);
        let map = m.array("map", Kind::U32, networks);
        let forth = m.array("forth", Kind::U32, networks);
        let back = m.array("back", Kind::U32, networks);
        let old_log_std = m.array("old_log_std", Kind::F32, actions);
        let constants = m.array("constants", Kind::F32, actions + 2);
        let scale = m.array("scale", Kind::F32, 2 * (widths.observation + widths.critic_observation));
        let actor_scale = m.array("actor_scale", Kind::F32, 2 * widths.observation);
        let critic_scale = m.array("critic_scale", Kind::F32, 2 * widths.critic_observation);
        let statistics = m.array("statistics", Kind::F64, 2 * widths.observation + 1);
        let critic_statistics = m.array("critic_statistics", Kind::F64, 2 * widths.critic_observation + 1);
        let widest = widths.observation.max(widths.critic_observation);
        let parts = m.array("parts", Kind::F64, 2 * chunks * widest);
        let swaps = m.array("swaps", Kind::U32, cards);
        let head = m.array("head", Kind::U32, cards);
        let next = m.array("next", Kind::U32, cards);
        let dealt = m.array("cards", Kind::U32, cards);
        let counts = m.array("counts", Kind::U32, epochs * chunks * minibatches);
        let places = m.array("places", Kind::U32, cards);
        let first = m.array("first", Kind::U32, CHECKED.len());
        let control = m.array("control", Kind::U32, CONTROL_SIZE);
        let state = m.array("state", Kind::F64, STATE_SIZE);

        let per_epoch = |count: usize, threads: u32| {
            let shape = Shape::cover(count, threads);
            Shape { grid: [shape.grid[0], epochs as u32, 1], ..shape }
        };
        // Samples that are no numbers, then the update's start.
        m.launch("fill", Shape::new(1, 32), &[first, word(CHECKED.len()), Value::U32(u32::MAX)]);
        for (index, array) in checked.into_iter().enumerate() {
            let Value::Array(Id(number)) = array else { continue };
            let count = m.arrays[number].length;
            let blocks = count.div_ceil(1024).clamp(1, 1024);
            m.launch(
                "check_finite",
                Shape::new(blocks as u32, 256),
                &[array, word(count), word(index), first],
            );
        }
        m.launch(
            "begin_update",
            Shape::new(1, 256),
            &[
                control,
                first,
                word(CHECKED.len()),
                parameters,
                moments,
                word(size),
                old_log_std,
                constants,
                state,
            ],
        );
        for (width, normalised, own, scale) in [
            (widths.observation, task.normalised[0], statistics, actor_scale),
            (widths.critic_observation, task.normalised[1], critic_statistics, critic_scale),
        ] {
            let present = word(usize::from(normalised));
            m.launch("scale_of", Shape::cover(width, 128), &[word(width), present, own, scale]);
        }
        m.launch(
            "join_scales",
            Shape::cover(2 * (widths.observation + widths.critic_observation), 128),
            &[
                word(2 * widths.observation),
                word(2 * widths.critic_observation),
                actor_scale,
                critic_scale,
                scale,
            ],
        );
        // Advantages.
        let (gamma, decay) = (settings.gamma as f32, (settings.gamma * settings.lambda) as f32);
        m.launch(
            "gae",
            Shape::cover(batch.environments, 64),
            &[
                word(batch.steps),
                word(batch.environments),
                Value::F32(gamma),
                Value::F32(decay),
                reward,
                value,
                done,
                last_value,
                advantage,
                returns,
            ],
        );
        let normalise = word(usize::from(settings.normalise_advantage));
        m.launch(
            "advantages",
            Shape::new(1, 1024),
            &[word(rows), normalise, advantage, returns, value, state],
        );
        // The deal of all epochs.
        m.launch(
            "fill",
            Shape::new(cards.div_ceil(1024).clamp(1, 1024) as u32, 256),
            &[head, word(cards), word(0)],
        );
        m.launch("shuffle_link", per_epoch(rows.div_ceil(4), 128), &[control, word(rows), swaps, head, next]);
        m.launch(
            "shuffle_follow",
            per_epoch(rows, 128),
            &[word(rows), word(minibatches), swaps, head, next, dealt],
        );
        let counting = Shape { shared: (4 * minibatches) as u32, ..per_epoch(rows, CHUNK as u32) };
        m.launch("shuffle_count", counting, &[word(rows), word(minibatches), dealt, counts]);
        let beginning = per_epoch(minibatches, 32);
        m.launch("shuffle_begin", beginning, &[word(rows), word(minibatches), word(chunks), counts]);
        m.launch(
            "shuffle_place",
            per_epoch(rows, CHUNK as u32),
            &[
                word(rows),
                word(minibatches),
                word(batch.steps),
                word(batch.environments),
                word(batch.tile),
                dealt,
                counts,
                places,
            ],
        );
        // Gradient steps.
        let [actor_count, critic_count] = [word(actor_blocks), word(critic_blocks)];
        for epoch in 0..epochs {
            for minibatch in 0..minibatches {
                let count = word(begin(minibatch + 1) - begin(minibatch));
                let shape = Shape {
                    shared: text.shared as u32,
                    ..Shape::new((actor_blocks + critic_blocks) as u32, THREADS as u32)
                };
                m.launch(
                    "network",
                    shape,
                    &[
                        word(epoch * rows + begin(minibatch)),
                        count,
                        actor_count,
                        control,
                        places,
                        observation,
                        critic_observation,
                        action,
                        mean,
                        log_probability,
                        advantage,
                        value,
                        returns,
                        scale,
                        packed,
                        constants,
                        partial,
                        sums,
                    ],
                );
                m.launch(
                    "reduce",
                    Shape::new(reduce_blocks as u32, 256),
                    &[actor_count, critic_count, control, partial, map, gradient, squares],
                );
                m.launch(
                    "finish",
                    Shape::new(1, 256),
                    &[
                        word(epoch),
                        word(minibatch),
                        count,
                        actor_count,
                        critic_count,
                        word(reduce_blocks),
                        control,
                        sums,
                        squares,
                        parameters,
                        gradient,
                        moments,
                        old_log_std,
                        constants,
                        state,
                    ],
                );
                m.launch(
                    "adam",
                    Shape::cover(networks, 128),
                    &[word(0), control, state, forth, back, gradient, moments, parameters, packed],
                );
            }
        }
        // Statistics of observations.
        if settings.normalise_observations {
            for (width, numbers, own) in [
                (widths.observation, observation, statistics),
                (widths.critic_observation, critic_observation, critic_statistics),
            ] {
                let (count, chunk, threads) = (word(rows), word(CHUNK), width.clamp(32, 1024) as u32);
                m.launch(
                    "statistics_of",
                    Shape::new(chunks as u32, threads),
                    &[count, word(width), chunk, numbers, parts],
                );
                m.launch(
                    "statistics_join",
                    Shape::new(1, threads),
                    &[count, word(width), chunk, word(chunks), parts, state, own],
                );
            }
        }
        let pack = Launch {
            kernel: "adam",
            shape: Shape::cover(networks, 128),
            arguments: vec![word(1), control, state, forth, back, gradient, moments, parameters, packed],
        };
        Self { arrays: maker.arrays, pack, launches: maker.launches }
    }

    /// The array of this name.
    pub fn array(&self, name: &str) -> Option<Id> {
        self.arrays.iter().position(|array| array.name == name).map(Id)
    }
}

/// Blocks of the actor and of the critic: by their work, at least one each, at most one a tile.
fn share(processors: usize, tiles: usize, work: [usize; 2]) -> [usize; 2] {
    let (processors, tiles) = (processors.max(2), tiles.max(1));
    let actor = (processors * work[0] + (work[0] + work[1]) / 2) / (work[0] + work[1]).max(1);
    let actor = actor.clamp(1, processors - 1);
    [actor.min(tiles), (processors - actor).min(tiles)]
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn blocks_are_shared_by_work() {
        assert_eq!(share(132, 384, [40_000, 40_000]), [66, 66]);
        assert_eq!(share(132, 384, [10_000, 30_000]), [33, 99]);
        assert_eq!(share(132, 3, [40_000, 40_000]), [3, 3]);
        assert_eq!(share(1, 0, [1, 1_000_000]), [1, 1]);
    }
}
