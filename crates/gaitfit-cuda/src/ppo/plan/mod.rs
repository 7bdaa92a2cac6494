//! The update as data: arrays, and kernels in order. A GPU runs it, and so does the test without one.

mod arrays;
mod memory;
mod shared;
mod sizes;
mod update;

use super::launch::{Array, Batch, Exchange, Id, Kind, Launch, Value};
use super::text::Text;
use crate::runtime::Shape;
use arrays::Arrays;
use gaitfit_learn::ppo::{Settings, Widths};
use gaitfit_policy::network::RecurrentShape;
use memory::{Memory, Samples};
pub(in crate::ppo) use shared::{check_shared, turns};
use sizes::Sizes;
use update::Update;

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
    memory: Option<Memory>,
    /// The update.
    pub launches: Vec<Launch>,
    /// The launches of the update that need none of those before them. They come before the first exchange.
    pub apart: std::ops::Range<usize>,
    /// Exchanges between several GPUs, in order; empty for one GPU.
    pub exchanges: Vec<Exchange>,
}

/// Arrays that `check_finite` looks at, in the order of `gaitfit_learn::ppo::Samples`.
pub(in crate::ppo) const CHECKED: [&str; 9] = [
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
pub(in crate::ppo) const STATE_SIZE: usize = 19;
pub(in crate::ppo) const CONTROL_SIZE: usize = 5;

/// Collects arrays and launches.
struct Maker {
    arrays: Vec<Array>,
    launches: Vec<Launch>,
    exchanges: Vec<Exchange>,
}

impl Maker {
    fn array(&mut self, name: &'static str, kind: Kind, length: usize) -> Value {
        self.arrays.push(Array { name, kind, length });
        Value::Array(Id(self.arrays.len() - 1))
    }

    fn launch(&mut self, kernel: &'static str, shape: Shape, arguments: &[Value]) {
        self.launches.push(launch(kernel, shape, arguments));
    }

    /// After the present launches: each GPU's array goes to all others.
    fn exchange(&mut self, arrays: &[[Value; 2]]) {
        let id = |value: Value| match value {
            Value::Array(id) => Some(id),
            _ => None,
        };
        let arrays = arrays.iter().filter_map(|&[own, all]| Some([id(own)?, id(all)?])).collect();
        self.exchanges.push(Exchange { before: self.launches.len(), arrays });
    }
}

fn launch(kernel: &'static str, shape: Shape, arguments: &[Value]) -> Launch {
    Launch { kernel, shape, arguments: arguments.to_vec() }
}

fn word(value: usize) -> Value {
    Value::U32(u32::try_from(value).unwrap_or(u32::MAX))
}

/// Settings and sizes that the plan is made for.
pub(in crate::ppo) struct Task<'a> {
    pub settings: &'a Settings,
    pub widths: Widths,
    pub batch: Batch,
    /// Multiprocessors.
    pub processors: usize,
    /// Whether the actor's and the critic's observations are normalised.
    pub normalised: [bool; 2],
    /// Shapes of the actor's and the critic's memory; `None` without memories.
    pub memories: Option<[RecurrentShape; 2]>,
}

impl Plan {
    /// The update of one learner.
    pub(in crate::ppo) fn new(task: &Task<'_>, text: &Text) -> Self {
        let sizes = Sizes::new(task, text);
        let mut maker = Maker { arrays: Vec::new(), launches: Vec::new(), exchanges: Vec::new() };
        let arrays = Arrays::new(&mut maker, &sizes, text);
        let samples = Samples {
            observations: [arrays.observation, arrays.critic_observation],
            scales: [arrays.actor_scale, arrays.critic_scale],
            done: arrays.done,
        };
        let (batch, counts) = (task.batch, (task.settings.minibatches, task.settings.epochs));
        let memory =
            task.memories.as_ref().map(|shapes| Memory::new(&mut maker, shapes, batch, counts, &samples));
        let shared = [text.shared as u32, text.foreseen_shared as u32];
        let mut update = Update { settings: task.settings, sizes, arrays, memory, maker, shared };
        let scales = update.scales(task.normalised);
        update.start();
        update.advantages();
        let first = update.maker.launches.len();
        update.deal();
        let apart = first..update.maker.launches.len();
        update.normalise_together();
        update.gradient_steps();
        if task.settings.normalise_observations {
            update.statistics();
            update.maker.launches.extend(scales.iter().cloned());
        }
        let mut pack = vec![update.adam(true)];
        pack.extend(scales);
        let (a, memory) = (update.arrays, update.memory.clone());
        pack.extend(memory.as_ref().map(|memory| memory.adam(true, a.control, a.state)));
        let foresee = Some(update.foresee());
        let sharing = (task.processors, text.foreseen, [text.actor.work, text.critic.work]);
        let Maker { arrays, launches, exchanges } = update.maker;
        Self { arrays, pack, launches, apart, exchanges, foresee, sharing, memory }
    }

    /// A plan without a learner: any arrays and launches.
    pub fn from_parts(arrays: Vec<Array>, launches: Vec<Launch>) -> Self {
        let (pack, sharing) = (Vec::new(), (1, 1, [1, 1]));
        let exchanges = Vec::new();
        Self { arrays, pack, launches, apart: 0..0, exchanges, foresee: None, sharing, memory: None }
    }

    /// The launches up to each exchange, and those after the last one.
    pub fn parts(&self) -> Vec<std::ops::Range<usize>> {
        let ends = self.exchanges.iter().map(|exchange| exchange.before);
        let ends: Vec<usize> = ends.chain([self.launches.len()]).collect();
        let begins = [0].into_iter().chain(ends.iter().copied());
        begins.zip(&ends).map(|(begin, &end)| begin..end).collect()
    }

    /// Means and values of rows `from .. from + rows` of the samples, from their observations; `None` in a plan without
    /// a learner.
    pub fn foresee(&self, from: usize, rows: usize) -> Option<Launch> {
        let mut launch = self.foresee.clone()?;
        let (processors, tile, work) = self.sharing;
        let [actor, critic] = share(processors, rows.div_ceil(tile), work);
        launch.shape.grid[0] = (actor + critic) as u32;
        launch.arguments[..3].copy_from_slice(&[word(from), word(rows), word(actor)]);
        Some(launch)
    }

    /// The critic's values of `rows` rows from number `from` on, and two indices into the arguments: of its observations and of the values. The
    /// arguments hold the samples. `None` in a plan without a learner.
    pub fn foresee_values(&self, from: usize, rows: usize) -> Option<(Launch, [usize; 2])> {
        let mut launch = self.foresee.clone()?;
        let (processors, tile, _) = self.sharing;
        launch.shape.grid[0] = rows.div_ceil(tile).clamp(1, processors.max(1)) as u32;
        // No block for the actor: its means are not asked for.
        launch.arguments[..3].copy_from_slice(&[word(from), word(rows), word(0)]);
        // Places of the critic's observations and of the values in the arguments of `Update::foresee`.
        Some((launch, [4, 8]))
    }

    /// Launches of the memories before [`Plan::foresee`] of a rollout's step; empty without memories.
    pub fn remember(&self, step: usize) -> Vec<Launch> {
        self.memory.as_ref().map(|memory| memory.step(step)).unwrap_or_default()
    }

    /// Launches of the critic's memory before [`Plan::foresee_values`] of `environments` rows of states from number
    /// `part · environments` on, and places of arguments: the states, of the first launch, and what is remembered before
    /// them, of all launches; the latter is absent if the critic has no memory. The first part begins with what is remembered now.
    pub fn remember_tail(&self, part: usize) -> Option<(Vec<Launch>, usize, Option<usize>)> {
        self.memory.as_ref().map(|memory| memory.tail(part))
    }

    /// What memories forget after a step of a rollout that cuts off `cuts` episodes of an environment at most, and places
    /// of arguments: where these were cut, and where what the critic then remembered goes. `None` without memories.
    pub fn forget(&self, step: usize, cuts: usize) -> Option<(Launch, [usize; 2])> {
        self.memory.as_ref().map(|memory| memory.forget(step, cuts))
    }

    /// The array of this name.
    pub fn array(&self, name: &str) -> Option<Id> {
        self.arrays.iter().position(|array| array.name == name).map(Id)
    }
}

/// Blocks of the actor and of the critic: by their work, at least one each, at most one a tile.
fn share(processors: usize, tiles: usize, work: [usize; 2]) -> [usize; 2] {
    let (processors, tiles) = (processors.max(2), tiles.max(1));
    // Rounded to the nearest.
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
