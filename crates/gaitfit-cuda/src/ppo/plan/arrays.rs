//! The arrays of an update.

use super::super::launch::{Kind, Value};
use super::super::layout::NetLayout;
use super::super::text::{LOSSES, Text};
use super::{CHECKED, CONTROL_SIZE, Maker, STATE_SIZE, Sizes};

/// `ADVANTAGE_NUMBERS` of the text.
const ADVANTAGE_NUMBERS: usize = 7;

/// All arrays of an update, as arguments of kernels.
#[derive(Clone, Copy, Debug)]
pub(super) struct Arrays {
    /// Samples, as `gaitfit_learn::ppo::Samples` has them: what the actor saw.
    pub observation: Value,
    /// Observations of the critic.
    pub critic_observation: Value,
    /// Actions.
    pub action: Value,
    /// The actor's means.
    pub mean: Value,
    /// Logarithms of the probabilities of the actions.
    pub log_probability: Value,
    /// The critic's values.
    pub value: Value,
    /// Rewards.
    pub reward: Value,
    /// Ends of episodes.
    pub done: Value,
    /// Values after the last step.
    pub last_value: Value,
    /// Advantages.
    pub advantage: Value,
    /// Returns.
    pub returns: Value,
    /// Parameters of both networks, then the logarithm of the spread.
    pub parameters: Value,
    /// Adam's first and second moments.
    pub moments: Value,
    /// The gradient.
    pub gradient: Value,
    /// Weights as the large kernel reads them.
    pub packed: Value,
    /// Gradients of the blocks.
    pub partial: Value,
    /// Derivatives that the blocks' hidden layers keep for the way back; empty where these follow from outputs.
    pub kept: Value,
    /// Losses of the blocks.
    pub sums: Value,
    /// Squares of the gradient's norm, by blocks of `reduce`, then the losses.
    pub squares: Value,
    /// With several GPUs: this one's means and squares of advantages, and those of all.
    pub advantage_shares: [Value; 2],
    /// With several GPUs: this one's losses and gradients. Steps of the gradient take the first array and the second
    /// in turn.
    pub own_shares: [Value; 2],
    /// Losses and gradients of all GPUs.
    pub shares: Value,
    /// With several GPUs: statistics of the actor's and the critic's observations, this one's and those of all.
    pub statistics_shares: [[Value; 2]; 2],
    /// Blocks of `reduce` that are done.
    pub reduced: Value,
    /// Where a weight is among the partial gradients.
    pub map: Value,
    /// Where the first copy of each weight lies among the packed ones.
    pub forth: Value,
    /// Where the second copy lies; the largest word: there is none.
    pub back: Value,
    /// Logarithm of the spread before the update.
    pub old_log_std: Value,
    /// What the spread gives the actor's losses.
    pub constants: Value,
    /// Both observations' offsets and factors.
    pub scale: Value,
    /// The actor's.
    pub actor_scale: Value,
    /// The critic's.
    pub critic_scale: Value,
    /// Mean, variance and count of the actor's observations.
    pub statistics: Value,
    /// Mean, variance and count of the critic's observations.
    pub critic_statistics: Value,
    /// Statistics of parts of the samples.
    pub parts: Value,
    /// The place that each step of the shuffle swaps with its own.
    pub swaps: Value,
    /// The first of the steps that swap with one place, from 1; 0: there is none.
    pub head: Value,
    /// The next step with the same place, likewise.
    pub next: Value,
    /// Minibatches of the cards.
    pub dealt: Value,
    /// Cards of a minibatch in a part.
    pub counts: Value,
    /// Rows in the order of the minibatches.
    pub places: Value,
    /// First number of each checked array that is none.
    pub first: Value,
    /// Iteration, flags and seeds.
    pub control: Value,
    /// Learning rate, steps, losses.
    pub state: Value,
}

impl Arrays {
    /// Adds the arrays to a plan.
    pub(super) fn new(m: &mut Maker, sizes: &Sizes, text: &Text) -> Self {
        let Sizes { rows, widths, actions, batch, networks, reduce_blocks, chunks, cards, .. } = *sizes;
        let Sizes { epochs, minibatches, parameters: size, blocks: [actor_blocks, critic_blocks], .. } =
            *sizes;
        let widest = widths.observation.max(widths.critic_observation);
        let share = batch.share.count;
        // A single GPU needs none.
        let mut shares = |names: [&'static str; 2], length: usize| {
            let length = if share > 1 { length } else { 0 };
            [m.array(names[0], Kind::F64, length), m.array(names[1], Kind::F64, share * length)]
        };
        let advantage_shares = shares(["advantage_share", "advantage_shares"], ADVANTAGE_NUMBERS);
        // Losses in double precision, then the gradient in single precision, two numbers in the place of one.
        let of_gradient = LOSSES + actions + networks.div_ceil(2);
        let [even, of_all] = shares(["share", "shares"], of_gradient);
        let statistics_shares = [
            shares(["statistics_share", "statistics_shares"], 2 * widths.observation),
            shares(["critic_statistics_share", "critic_statistics_shares"], 2 * widths.critic_observation),
        ];
        let of_blocks = |blocks: usize, net: &NetLayout| blocks * text.rows * net.kept / net.per_word;
        let kept = of_blocks(actor_blocks, &text.actor) + of_blocks(critic_blocks, &text.critic);
        let odd = m.array("odd_share", Kind::F64, if share > 1 { of_gradient } else { 0 });
        Self {
            advantage_shares,
            own_shares: [even, odd],
            shares: of_all,
            statistics_shares,
            observation: m.array("observation", Kind::F32, rows * widths.observation),
            critic_observation: m.array("critic_observation", Kind::F32, rows * widths.critic_observation),
            action: m.array("action", Kind::F32, rows * actions),
            mean: m.array("mean", Kind::F32, rows * actions),
            log_probability: m.array("log_probability", Kind::F32, rows),
            value: m.array("value", Kind::F32, rows),
            reward: m.array("reward", Kind::F32, rows),
            done: m.array("done", Kind::F32, rows),
            last_value: m.array("last_value", Kind::F32, batch.environments),
            advantage: m.array("advantage", Kind::F32, rows),
            returns: m.array("returns", Kind::F32, rows),
            parameters: m.array("parameters", Kind::F32, size),
            moments: m.array("moments", Kind::F32, 2 * size),
            gradient: m.array("gradient", Kind::F32, size),
            packed: m.array("packed", Kind::F32, text.actor.packed + text.critic.packed),
            partial: m.array(
                "partial",
                Kind::F32,
                actor_blocks * text.actor.gradient + critic_blocks * text.critic.gradient,
            ),
            kept: m.array("kept", Kind::F32, kept),
            sums: m.array("sums", Kind::F64, (actor_blocks + critic_blocks) * (LOSSES + actions)),
            squares: m.array("squares", Kind::F64, 2 * reduce_blocks + LOSSES + actions),
            reduced: m.array("reduced", Kind::U32, 1),
            map: m.array("map", Kind::U32, networks),
            forth: m.array("forth", Kind::U32, networks),
            back: m.array("back", Kind::U32, networks),
            old_log_std: m.array("old_log_std", Kind::F32, actions),
            constants: m.array("constants", Kind::F32, actions + 2),
            scale: m.array("scale", Kind::F32, 2 * (widths.observation + widths.critic_observation)),
            actor_scale: m.array("actor_scale", Kind::F32, 2 * widths.observation),
            critic_scale: m.array("critic_scale", Kind::F32, 2 * widths.critic_observation),
            statistics: m.array("statistics", Kind::F64, 2 * widths.observation + 1),
            critic_statistics: m.array("critic_statistics", Kind::F64, 2 * widths.critic_observation + 1),
            parts: m.array("parts", Kind::F64, 2 * chunks * widest),
            swaps: m.array("swaps", Kind::U32, cards),
            head: m.array("head", Kind::U32, cards),
            next: m.array("next", Kind::U32, cards),
            dealt: m.array("cards", Kind::U32, cards),
            counts: m.array("counts", Kind::U32, epochs * chunks * minibatches),
            places: m.array("places", Kind::U32, cards),
            first: m.array("first", Kind::U32, CHECKED.len()),
            control: m.array("control", Kind::U32, CONTROL_SIZE),
            state: m.array("state", Kind::F64, STATE_SIZE),
        }
    }

    /// The arrays that `check_finite` looks at, in the order of [`CHECKED`].
    pub(super) fn checked(&self) -> [Value; CHECKED.len()] {
        [
            self.observation,
            self.critic_observation,
            self.action,
            self.mean,
            self.log_probability,
            self.value,
            self.reward,
            self.done,
            self.last_value,
        ]
    }
}
