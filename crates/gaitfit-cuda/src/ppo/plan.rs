//! The update as data: arrays, and kernels in order. A GPU runs it, and so does the test without one.

use gaitfit_learn::ppo::{Settings, Widths};

use super::launch::{Array, Batch, Id, Kind, Launch, Value};
use super::text::{LOSSES, MAX_ACTIONS, THREADS, Text};
use crate::runtime::Shape;

/// Arrays and launches of an update.
#[derive(Clone, Debug, PartialEq)]
pub struct Plan {
    /// All arrays.
    pub arrays: Vec<Array>,
    /// Renews what is derived from parameters and statistics, after they were set from outside.
    pub pack: Vec<Launch>,
    /// Means and values of rows 0 .. 0; see [`Plan::foresee`].
    foresee: Option<Launch>,
    /// Processors, samples of a tile, and work of both networks.
    sharing: (usize, usize, [usize; 2]),
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
        self.launches.push(launch(kernel, shape, arguments));
    }
}

fn launch(kernel: &'static str, shape: Shape, arguments: &[Value]) -> Launch {
    Launch { kernel, shape, arguments: arguments.to_vec() }
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
        let (rows, actions) = (batch.rows(), widths.action.min(MAX_ACTIONS));
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
        let mut scales = Vec::new();
        for (width, normalised, own, scale) in [
            (widths.observation, task.normalised[0], statistics, actor_scale),
            (widths.critic_observation, task.normalised[1], critic_statistics, critic_scale),
        ] {
            let present = word(usize::from(normalised));
            scales.push(launch("scale_of", Shape::cover(width, 128), &[word(width), present, own, scale]));
        }
        scales.push(launch(
            "join_scales",
            Shape::cover(2 * (widths.observation + widths.critic_observation), 128),
            &[
                word(2 * widths.observation),
                word(2 * widths.critic_observation),
                actor_scale,
                critic_scale,
                scale,
            ],
        ));
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
        if settings.normalise_observations {
            maker.launches.extend(scales.iter().cloned());
        }
        let copy = [word(1), control, state, forth, back, gradient, moments, parameters, packed];
        let mut pack = vec![launch("adam", Shape::cover(networks, 128), &copy)];
        pack.extend(scales);
        let shape = Shape { shared: text.shared as u32, ..Shape::new(0, THREADS as u32) };
        let foreseen =
            [word(0), word(0), word(0), observation, critic_observation, scale, packed, mean, value];
        let foresee = Some(launch("foresee", shape, &foreseen));
        let sharing = (task.processors, text.rows, [text.actor.work, text.critic.work]);
        Self { arrays: maker.arrays, pack, launches: maker.launches, foresee, sharing }
    }

    /// A plan without a learner: any arrays and launches.
    pub fn from_parts(arrays: Vec<Array>, launches: Vec<Launch>) -> Self {
        Self { arrays, pack: Vec::new(), launches, foresee: None, sharing: (1, 1, [1, 1]) }
    }

    /// Means and values of rows `from .. from + rows` of the samples, from their observations; none in a plan without
    /// a learner.
    pub fn foresee(&self, from: usize, rows: usize) -> Option<Launch> {
        let mut launch = self.foresee.clone()?;
        let (processors, tile, work) = self.sharing;
        let [actor, critic] = share(processors, rows.div_ceil(tile), work);
        launch.shape.grid[0] = (actor + critic) as u32;
        launch.arguments[..3].copy_from_slice(&[word(from), word(rows), word(actor)]);
        Some(launch)
    }

    /// The critic's values of `rows` rows, and the places among the arguments of its observations and of the values,
    /// which are those of the samples; none in a plan without a learner.
    pub fn foresee_values(&self, rows: usize) -> Option<(Launch, [usize; 2])> {
        let mut launch = self.foresee.clone()?;
        let (processors, tile, _) = self.sharing;
        launch.shape.grid[0] = rows.div_ceil(tile).clamp(1, processors.max(1)) as u32;
        launch.arguments[..3].copy_from_slice(&[word(0), word(rows), word(0)]);
        Some((launch, [4, 8]))
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
