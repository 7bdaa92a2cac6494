//! The launches of an update, part by part.

use super::super::launch::{Launch, Value};
use super::super::text::THREADS;
use super::{Arrays, CHECKED, CHUNK, Maker, Memory, Sizes, launch, word};
use crate::runtime::Shape;
use gaitfit_learn::ppo::Settings;

/// An update that is being written.
pub(super) struct Update<'a> {
    pub settings: &'a Settings,
    pub sizes: Sizes,
    pub arrays: Arrays,
    /// Memories before the networks.
    pub memory: Option<Memory>,
    /// Takes the launches.
    pub maker: Maker,
    /// Shared memory of the large kernel and of the one that looks ahead, bytes.
    pub shared: [u32; 2],
}

impl Update<'_> {
    /// The actor's and the critic's observations: width, numbers, statistics, offsets and factors.
    fn observations(&self) -> [(usize, Value, Value, Value); 2] {
        let (widths, a) = (&self.sizes.widths, &self.arrays);
        [
            (widths.observation, a.observation, a.statistics, a.actor_scale),
            (widths.critic_observation, a.critic_observation, a.critic_statistics, a.critic_scale),
        ]
    }

    /// Offsets and factors of observations from their statistics. They are launched after an update, and after statistics were
    /// set from outside.
    pub(super) fn scales(&self, normalised: [bool; 2]) -> Vec<Launch> {
        let mut scales = Vec::new();
        for ((width, _, own, scale), normalised) in self.observations().into_iter().zip(normalised) {
            let present = word(usize::from(normalised));
            scales.push(launch("scale_of", Shape::cover(width, 128), &[word(width), present, own, scale]));
        }
        let [actor, critic] = self.sizes.scales();
        let a = &self.arrays;
        let joined = [word(actor), word(critic), a.actor_scale, a.critic_scale, a.scale];
        scales.push(launch("join_scales", Shape::cover(actor + critic, 128), &joined));
        scales
    }

    /// Looks for samples that are no numbers, then begins.
    pub(super) fn start(&mut self) {
        let (a, m) = (self.arrays, &mut self.maker);
        m.launch("fill", Shape::new(1, 32), &[a.first, word(CHECKED.len()), Value::U32(u32::MAX)]);
        let Sizes { rows, widths, batch, .. } = self.sizes;
        let widest = widths.observation.max(widths.critic_observation).max(widths.action);
        // Each of a block's 256 threads looks at 16 numbers of the widest array, at more if it is very long.
        let blocks = (rows * widest).div_ceil(4096).clamp(1, 512) as u32;
        let shape = Shape { grid: [blocks, CHECKED.len() as u32, 1], ..Shape::new(1, 256) };
        let sizes = [rows, batch.environments, widths.observation, widths.critic_observation].map(word);
        m.launch("check_finite", shape, &[&sizes[..], &a.checked(), &[a.first]].concat());
        let arguments = [
            a.control,
            a.first,
            word(CHECKED.len()),
            a.parameters,
            a.moments,
            word(self.sizes.parameters),
            a.old_log_std,
            a.constants,
            a.state,
            a.reduced,
        ];
        m.launch("begin_update", Shape::new(1, 256), &arguments);
        m.launches.extend(self.memory.as_ref().map(|memory| memory.begin(a.control)));
    }

    /// Advantages and returns.
    pub(super) fn advantages(&mut self) {
        let (a, settings, batch) = (self.arrays, self.settings, self.sizes.batch);
        // Generalised advantage estimation (Schulman et al. 2016): a thread goes backwards through an environment's
        // steps.
        let (gamma, decay) = (settings.gamma as f32, (settings.gamma * settings.lambda) as f32);
        let arguments = [
            word(batch.steps),
            word(batch.environments),
            Value::F32(gamma),
            Value::F32(decay),
            a.reward,
            a.value,
            a.done,
            a.last_value,
            a.advantage,
            a.returns,
        ];
        self.maker.launch("gae", Shape::cover(batch.environments, 64), &arguments);
        if batch.share.count > 1 {
            let arguments =
                [word(self.sizes.rows), a.advantage, a.returns, a.value, a.state, a.advantage_shares[0]];
            self.maker.launch("advantages_share", Shape::new(1, 1024), &arguments);
            return;
        }
        // One block needs no exchange between blocks: the means come first, then the sums of squares about them.
        let normalise = word(usize::from(settings.normalise_advantage));
        let arguments = [word(self.sizes.rows), normalise, a.advantage, a.returns, a.value, a.state];
        self.maker.launch("advantages", Shape::new(1, 1024), &arguments);
    }

    /// With several GPUs: normalises the advantages of all.
    pub(super) fn normalise_together(&mut self) {
        let (a, count, rows) = (self.arrays, self.sizes.batch.share.count, self.sizes.rows);
        if count > 1 {
            self.maker.exchange(&[a.advantage_shares]);
            let normalise = word(usize::from(self.settings.normalise_advantage));
            let [_, all] = a.advantage_shares;
            let arguments = [word(rows), normalise, word(count), all, a.advantage, a.state];
            let shape = Shape::new(rows.div_ceil(1024).clamp(1, 256) as u32, 256);
            self.maker.launch("advantages_together", shape, &arguments);
        }
    }

    /// Deals the samples to the minibatches of all epochs.
    pub(super) fn deal(&mut self) {
        let Sizes { units, minibatches, cards, epochs, batch, .. } = self.sizes;
        let (a, m) = (self.arrays, &mut self.maker);
        let (rows, chunks) = (units, units.div_ceil(CHUNK));
        let (dealt_steps, dealt_places) =
            self.memory.as_ref().map_or((batch.steps, a.places), |memory| (1, memory.robots));
        // One row of blocks an epoch.
        let per_epoch = |count: usize, threads: u32| {
            let shape = Shape::cover(count, threads);
            Shape { grid: [shape.grid[0], epochs as u32, 1], ..shape }
        };
        let (all, parts) = (word(rows), word(minibatches));
        let filling = Shape::new(cards.div_ceil(1024).clamp(1, 1024) as u32, 256);
        m.launch("fill", filling, &[a.head, word(cards), word(0)]);
        let linking = per_epoch(rows.div_ceil(4), 128);
        m.launch("shuffle_link", linking, &[a.control, all, a.swaps, a.head, a.next]);
        m.launch("shuffle_follow", per_epoch(rows, 128), &[all, parts, a.swaps, a.head, a.next, a.dealt]);
        let counting = Shape { shared: (4 * minibatches) as u32, ..per_epoch(rows, CHUNK as u32) };
        m.launch("shuffle_count", counting, &[all, parts, a.dealt, a.counts]);
        m.launch("shuffle_begin", per_epoch(minibatches, 32), &[all, parts, word(chunks), a.counts]);
        let (steps, environments, tile) = (word(dealt_steps), word(batch.environments), word(batch.tile));
        let arguments = [all, parts, steps, environments, tile, a.dealt, a.counts, dealt_places];
        m.launch("shuffle_place", per_epoch(rows, CHUNK as u32), &arguments);
        m.launches.extend(self.memory.as_ref().map(|memory| memory.places(epochs, a.places)));
    }

    /// A step of the gradient on each minibatch of each epoch.
    pub(super) fn gradient_steps(&mut self) {
        for epoch in 0..self.sizes.epochs {
            for minibatch in 0..self.sizes.minibatches {
                self.gradient(epoch, minibatch);
            }
        }
    }

    /// Inputs of the networks, observations or outputs of memories, with their factors and offsets.
    fn taken(&self) -> (Value, Value, Value) {
        match &self.memory {
            None => (self.arrays.observation, self.arrays.critic_observation, self.arrays.scale),
            Some(memory) => {
                let [[actor, _], [critic, _]] = memory.seen();
                (actor, critic, memory.unit())
            }
        }
    }

    /// A step of the gradient on one minibatch: by blocks, then their sum with losses, the learning rate and the spread, then
    /// the weights.
    fn gradient(&mut self, epoch: usize, minibatch: usize) {
        let (a, sizes) = (self.arrays, self.sizes);
        // With several GPUs, one may still read what another wrote in the step before: two arrays take turns.
        let turn = (epoch * sizes.minibatches + minibatch) % 2;
        let [actor, critic] = sizes.blocks;
        let blocks = Shape::new((actor + critic) as u32, THREADS as u32);
        let (first, robots) = (sizes.first(minibatch), sizes.first(minibatch + 1) - sizes.first(minibatch));
        let seen = self.memory.as_ref().map(Memory::seen);
        let (observed, critic_observed, scale) = self.taken();
        if let Some(memory) = &self.memory {
            self.maker.launches.extend(memory.forth(epoch, first, robots));
        }
        let mut arguments = vec![
            word(epoch * sizes.rows + sizes.begin(minibatch)),
            word(sizes.minibatch_rows(minibatch)),
            // Losses are means over the minibatch of all GPUs, so each GPU divides by all of their rows.
            Value::F32((1.0 / sizes.whole_rows(minibatch) as f64) as f32),
            word(actor),
            a.control,
            a.places,
            observed,
            critic_observed,
            a.action,
            a.mean,
            a.log_probability,
            a.advantage,
            a.value,
            a.returns,
            scale,
            a.packed,
            a.constants,
            a.partial,
            a.sums,
        ];
        arguments.extend(seen.into_iter().flatten().map(|[_, derivative]| derivative));
        arguments.extend(self.sizes.keeps.then_some(a.kept));
        self.maker.launch("network", Shape { shared: self.shared[0], ..blocks }, &arguments);
        if let Some(memory) = &self.memory {
            self.maker.launches.extend(memory.back((a.control, turn), epoch, first, robots));
        }
        let reduction = Shape::new(sizes.reduce_blocks as u32, 256);
        let step = [word(epoch), word(minibatch), word(sizes.whole_rows(minibatch))];
        let blocks = [word(actor), word(critic), a.control, a.partial, a.map];
        let after = [a.parameters, a.moments, a.old_log_std, a.constants, a.state];
        let (kernel, mut arguments) = if sizes.batch.share.count > 1 {
            let (own, all) = (a.own_shares[turn], a.shares);
            self.maker.launch("reduce_share", reduction, &[&blocks[..], &[a.sums, own]].concat());
            let memory = self.memory.as_ref().map(|memory| memory.shares(turn));
            self.maker.exchange(&[[own, all]].into_iter().chain(memory).collect::<Vec<_>>());
            let memory = self.memory.as_ref().map(|memory| memory.together(a.control));
            self.maker.launches.extend(memory);
            let between = [word(sizes.batch.share.count), a.control, all, a.gradient, a.squares, a.reduced];
            ("reduce_together", [&step[..], &between, &after].concat())
        } else {
            let between = [a.gradient, a.squares, a.reduced, a.sums];
            ("reduce", [&step[..], &blocks, &between, &after].concat())
        };
        if let Some((squares, blocks)) = self.memory.as_ref().map(Memory::squares) {
            arguments.extend([word(blocks), squares]);
        }
        self.maker.launch(kernel, reduction, &arguments);
        let adam = self.adam(false);
        self.maker.launches.push(adam);
        let memory = self.memory.as_ref().map(|memory| memory.adam(false, a.control, a.state));
        self.maker.launches.extend(memory);
    }

    /// A step of Adam on the weights of both networks; `copy`: packs the weights without a step.
    pub(super) fn adam(&self, copy: bool) -> Launch {
        let a = &self.arrays;
        let copy = word(usize::from(copy));
        let arguments =
            [copy, a.control, a.state, a.forth, a.back, a.gradient, a.moments, a.parameters, a.packed];
        launch("adam", Shape::cover(self.sizes.networks, 128), &arguments)
    }

    /// Renews the statistics of observations.
    pub(super) fn statistics(&mut self) {
        let (parts, state, chunks) = (self.arrays.parts, self.arrays.state, self.sizes.chunks);
        let (rows, gpus) = (self.sizes.rows, self.sizes.batch.share.count);
        let (count, chunk) = (word(rows), word(CHUNK));
        let shares = self.arrays.statistics_shares;
        let threads = |width: usize| width.clamp(32, 1024) as u32;
        for ((width, numbers, own, _), [share, _]) in self.observations().into_iter().zip(shares) {
            let arguments = [count, word(width), chunk, numbers, parts];
            self.maker.launch("statistics_of", Shape::new(chunks as u32, threads(width)), &arguments);
            let joined = [count, word(width), chunk, word(chunks), parts];
            let one = Shape::new(1, threads(width));
            if gpus > 1 {
                self.maker.launch("statistics_share", one, &[&joined[..], &[share]].concat());
            } else {
                self.maker.launch("statistics_join", one, &[&joined[..], &[state, own]].concat());
            }
        }
        if gpus > 1 {
            self.maker.exchange(&shares);
            for ((width, _, own, _), [_, all]) in self.observations().into_iter().zip(shares) {
                let arguments = [word(gpus * rows), word(width), count, word(gpus), all, state, own];
                self.maker.launch("statistics_join", Shape::new(1, threads(width)), &arguments);
            }
        }
    }

    /// Means and values of rows 0 .. 0, in blocks that the caller numbers.
    pub(super) fn foresee(&self) -> Launch {
        let a = &self.arrays;
        let shape = Shape { shared: self.shared[1], ..Shape::new(0, THREADS as u32) };
        let (actor, critic, scale) = self.taken();
        let observed = [actor, critic, scale, a.packed, a.mean, a.value];
        launch("foresee", shape, &[[word(0); 3].as_slice(), &observed].concat())
    }
}
