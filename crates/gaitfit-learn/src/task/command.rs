//! Commands.

use gaitfit_random::{Purpose, Stream};

use super::Interval;

/// A number drawn uniformly from an interval.
pub(super) fn within(stream: Stream, draw: u32, [low, high]: Interval) -> f64 {
    low + (high - low) * stream.uniform(draw)
}

/// The command that environment `environment` gets at step `step`. `standing`: share of zero commands.
pub(super) fn command(
    ranges: &[Interval; 3],
    standing: f64,
    seed: u64,
    environment: u32,
    step: u32,
) -> [f32; 3] {
    let stream = Stream::new(seed, Purpose::COMMAND).environment(environment).step(step);
    if stream.uniform(3) < standing {
        return [0.0; 3];
    }
    std::array::from_fn(|k| within(stream, k as u32, ranges[k]) as f32)
}
