//! Commands.

use gaitfit_random::{Purpose, Stream};

use super::{CommandSettings, Interval};

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
    // The draws 0 to 2 are those of the three directions.
    if stream.uniform(3) < standing {
        return [0.0; 3];
    }
    std::array::from_fn(|k| within(stream, k as u32, ranges[k]) as f32)
}

/// The commands that environment 0 of an episode gets, each with the time from which it holds (s), for `seconds`; control
/// periods of `control_dt`, s. The last row says when they end.
pub fn commands(
    settings: &CommandSettings,
    control_dt: f64,
    seed: u64,
    seconds: f64,
) -> Vec<(f64, [f32; 3])> {
    let ranges = settings.ranges(1.0);
    // A command lasts one control period at least.
    let period = (settings.seconds / control_dt).round().max(1.0) as u32;
    let last = (seconds / control_dt).round().max(1.0) as u32;
    let begins = (0..last).step_by(period as usize);
    // What is drawn after a step counts as the next step's.
    let drawn =
        |begin: u32| command(&ranges, settings.standing, seed, 0, if begin == 0 { 0 } else { begin + 1 });
    let rows = begins.map(|begin| (f64::from(begin) * control_dt, drawn(begin)));
    rows.chain([(f64::from(last) * control_dt, [0.0; 3])]).collect()
}
