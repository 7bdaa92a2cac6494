//! The comparison: blocks of logs and of simulated walks, and halves of them.

use super::super::Method;
use super::super::log_set::LogSet;
use super::super::score::Robot;
use super::trials::{Trials, pairs, tail};
use super::{Distance, Floor, HeldOut};
use crate::Error;
use crate::log::Log;
use crate::settings::AdaptConfig;
use gaitfit_adapt::cost::{Breakdown, Cost, CostKind, Recorded, Reference, Signal};
use gaitfit_adapt::fit::{Predicted, max_falls_by_chance};
use gaitfit_adapt::{Cancel, Resets};
use gaitfit_log::BLOCK_S;
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::stats;
use std::sync::Arc;

/// Number of times that halves are drawn, and the fewest blocks that halves are drawn of.
const DRAWS: u32 = 100;
const MIN_BLOCKS: usize = 8;
/// Simulations of the walks, each with other random draws. A walk amplifies the smallest differences, so one simulation
/// of 12 walks of a real Go2 lies 10 % above or below the next one of the same robot. Eight leave a third of that.
const SIMULATIONS: usize = 8;
/// Seed of the draws.
const SEED: u64 = 15;

/// Compares walks under the commands of held-out logs with them. Each of `sets` has these logs and the simulator of the
/// robot after and before the fit; beside it stands what θ changes of it. `fitted_logs`: other logs of the robot, among
/// which trials of the same commands are looked for. `done` is called with 1 after each simulation; there are at most
/// twice as many as [`simulations`] says.
///
/// # Errors
/// A simulation that cannot be made; `Interrupted` if `cancel` asks to stop. Logs that cannot be compared in this way
/// (constant joints) give none.
pub fn held_out(
    config: &AdaptConfig,
    method: &Method,
    [fitted, nominal]: [(&LogSet, Robot<'_>); 2],
    fitted_logs: &[Log],
    (cancel, done): (&Cancel<'_>, &(dyn Fn(usize) + Sync)),
) -> Result<Option<HeldOut>, Error> {
    if method.walking().is_none() {
        return Ok(None);
    }
    // Whole walks need the longer time to settle, whatever the fit needed.
    let config = AdaptConfig { costs: vec![CostKind::Wass], ..config.clone() };
    let (set, joints) = (fitted.0, method.joints());
    let (logs, count) = (&set.logs, joints.len());
    let (skip, length) = (method.samples(config.skip_seconds(), logs), method.samples(BLOCK_S, logs));
    let blocks = blocks(logs.iter().map(|log| log.trajectory.len()), skip, length.max(1));
    let recorded: Option<Vec<Predicted>> = logs.iter().map(|log| recorded(log, &joints)).collect();
    let Some(recorded) = recorded.filter(|_| !blocks.is_empty()) else { return Ok(None) };
    // Logs and walks are cut at the same places, so that blocks stand for the same commands.
    let cut = |walks: &[Predicted]| -> Vec<Predicted> {
        blocks.iter().map(|block| block.cut(&walks[block.log], count)).collect()
    };
    let recorded_blocks = cut(&recorded);
    let Some(cost) = cost_against(&recorded_blocks, &joints, set) else { return Ok(None) };
    let (reference, cost) = (&cost.0, cost.1.as_ref());
    let simulations = simulations(method);
    let walk = |(set, robot): (&LogSet, Robot<'_>)| -> Result<Vec<Vec<Predicted>>, Error> {
        let mut walks: Vec<Vec<Predicted>> = Vec::with_capacity(simulations);
        for draw in 0..simulations as u64 {
            let walk = robot.simulate_drawn(set.simulator.as_ref(), Resets::Never, draw, cancel)?;
            done(1);
            // A robot without random torques walks alike in every draw.
            if walks.first().is_some_and(|first| alike(first, &walk)) {
                break;
            }
            walks.push(walk);
        }
        Ok(walks)
    };
    let (after, before) = (walk(fitted)?, walk(nominal)?);
    // Stretches that are shorter than a block are not compared, so their falls do not count either.
    let counts = |log: usize| blocks.iter().any(|block| block.log == log);
    let falls = |walks: &[Vec<Predicted>]| {
        let logs = walks.iter().flat_map(|walk| walk.iter().enumerate());
        let falls = logs.filter(|(log, walk)| walk.fell_at.is_some() && counts(*log)).count();
        falls * simulations / walks.len().max(1)
    };
    let (falls, nominal_falls) = (falls(&after), falls(&before));
    // Trials compare whole walks, so they are taken before the walks are cut.
    let trials = trials(set, fitted_logs, &joints, skip, &recorded, &after);
    let all: Vec<usize> = (0..blocks.len()).collect();
    let cut_all = |walks: &[Vec<Predicted>]| walks.iter().map(|walk| cut(walk)).collect::<Vec<_>>();
    let (after, before) = (cut_all(&after), cut_all(&before));
    let (fitted, nominal) = (pooled(cost, &after), pooled(cost, &before));
    let single = after.iter().map(|walk| total(&chosen_blocks(cost, walk, &all)));
    let logs_of: Vec<usize> = blocks.iter().map(|block| block.log).collect();
    // The distance of the robot from itself, by halves of its blocks.
    let (floor, drawn) = floor(cost, &recorded_blocks, &after, &logs_of);
    let lasts = |log: &Log| (log.trajectory.duration() - config.skip_seconds()).max(0.0);
    let (compared, seconds) = compared(&blocks, logs.iter().map(lasts));
    Ok(Some(HeldOut {
        logs: compared,
        seconds,
        simulations,
        cost: total(&fitted),
        single_costs: single.flatten().collect(),
        nominal_cost: total(&nominal),
        floor,
        trials,
        falls,
        nominal_falls,
        robot_fall_rate: set.reference.fall_rate(),
        robot_falls: set.falling.falls,
        distances: distances(reference, [&fitted, &nominal], &drawn),
    }))
}

/// Number of times that [`held_out`] simulates the walks with each of its two robots, at most.
pub fn simulations(method: &Method) -> usize {
    if method.walking().is_some() { SIMULATIONS } else { 0 }
}

/// Whether two simulations of the same logs have the same motion.
fn alike(one: &[Predicted], other: &[Predicted]) -> bool {
    one.iter().zip(other).all(|(a, b)| a.position == b.position && a.velocity == b.velocity)
}

/// Some samples of a log.
struct Block {
    log: usize,
    start: usize,
    end: usize,
}

/// Cuts logs with these numbers of samples into blocks of `length` samples. The first `skip` samples of each log do not
/// count; the last block of a log also takes the remaining samples.
fn blocks(samples: impl Iterator<Item = usize>, skip: usize, length: usize) -> Vec<Block> {
    let mut blocks = Vec::new();
    for (log, samples) in samples.enumerate() {
        let count = samples.saturating_sub(skip) / length;
        for block in 0..count {
            let start = skip + block * length;
            let end = if block + 1 == count { samples } else { start + length };
            blocks.push(Block { log, start, end });
        }
    }
    blocks
}

/// The number of logs that have blocks, and their time, s. `seconds`: the time of each log.
fn compared(blocks: &[Block], seconds: impl Iterator<Item = f64>) -> (usize, f64) {
    let logs = seconds.enumerate().filter(|(log, _)| blocks.iter().any(|block| block.log == *log));
    logs.fold((0, 0.0), |(count, sum), (_, seconds)| (count + 1, sum + seconds))
}

impl Block {
    /// The block of a walk.
    fn cut(&self, walk: &Predicted, joints: usize) -> Predicted {
        let rows = |values: &[f32]| {
            let at = |row: usize| (row * joints).min(values.len());
            values[at(self.start)..at(self.end)].to_vec()
        };
        Predicted {
            position: rows(&walk.position),
            velocity: rows(&walk.velocity),
            action: walk.action.as_deref().map(rows),
            fell_at: walk.fell_at.filter(|&fall| fall < self.end).map(|fall| fall.saturating_sub(self.start)),
            ..Predicted::default()
        }
    }
}

/// A log's own signals as if they had been simulated.
fn recorded(log: &Log, joints: &[String]) -> Option<Predicted> {
    let recorded = Recorded::from_trajectory(&log.trajectory, joints, 0).ok()?;
    let single = |values: &[f64]| values.iter().map(|&value| value as f32).collect();
    Some(Predicted {
        position: single(&recorded.position),
        velocity: single(&recorded.velocity),
        action: recorded.action.as_deref().map(single),
        ..Predicted::default()
    })
}

/// Held-out logs beside other trials of their commands. `recorded` and `after`: the held-out logs and the simulations
/// of the fitted robot's walks; `skip`: the samples that do not count.
fn trials(
    set: &LogSet,
    others: &[Log],
    joints: &[String],
    skip: usize,
    recorded: &[Predicted],
    after: &[Vec<Predicted>],
) -> Option<Trials> {
    let pairs = pairs(&set.logs, others);
    let count = joints.len();
    if pairs.is_empty() {
        return None;
    }
    let paired = |walks: &[Predicted]| -> Option<Vec<Predicted>> {
        pairs.iter().map(|(log, _)| Some(tail(walks.get(*log)?, skip, count))).collect()
    };
    let logged = paired(recorded)?;
    let other =
        |(_, other): &(usize, usize)| Some(tail(&self::recorded(&others[*other], joints)?, skip, count));
    let other: Vec<Predicted> = pairs.iter().map(other).collect::<Option<_>>()?;
    let (_, cost) = cost_against(&logged, joints, set)?;
    let all: Vec<usize> = (0..logged.len()).collect();
    // Pooled over all pairs, and the mean of single pairs: a robot can be right on the whole and wrong in each.
    let distances = |walks: &[Predicted]| -> Option<[f64; 2]> {
        let pooled = total(&chosen_blocks(cost.as_ref(), walks, &all))?;
        let one = |log: usize| total(&chosen_blocks(cost.subset(&[log])?.as_ref(), walks, &[log]));
        let each = all.iter().map(|&log| one(log)).collect::<Option<Vec<f64>>>()?;
        Some([pooled, stats::mean(&each)?])
    };
    // Each simulation alone: the other trial is a single one, and several pooled together would have less noise than
    // it.
    let walked = after.iter().map(|walks| distances(&paired(walks)?)).collect::<Option<Vec<_>>>()?;
    let fitted = |number: usize| stats::mean(&walked.iter().map(|walk| walk[number]).collect::<Vec<_>>());
    Some(Trials { pairs: pairs.len(), itself: distances(&other)?, fitted: [fitted(0)?, fitted(1)?] })
}

/// The cost against blocks, each a recording; `None` if they cannot be compared.
fn cost_against(
    blocks: &[Predicted],
    joints: &[String],
    set: &LogSet,
) -> Option<(Arc<Reference>, Box<dyn Cost>)> {
    let wide = |values: &[f32]| values.iter().map(|&value| f64::from(value)).collect();
    let recorded: Vec<Recorded> = blocks
        .iter()
        .map(|block| Recorded {
            position: wide(&block.position),
            velocity: wide(&block.velocity),
            action: block.action.as_deref().map(wide),
            ..Recorded::default()
        })
        .collect();
    let reference = Reference::new(joints.to_vec(), &recorded, 0).ok()?.without_angles(set.wheels());
    // Falls are judged by their number: as many as chance explains do not make the walks before them less alike.
    let (logs, rate) = (set.logs.len() as f64, set.reference.fall_rate());
    // Divided by the number of logs it is a share again, as the reference takes it.
    let by_chance = max_falls_by_chance(rate * logs, set.falling.falls) as f64 / logs;
    let reference = Arc::new(reference.with_fall_rate(by_chance.min(1.0)));
    let cost = CostKind::Wass.build(&reference, set.simulator.as_ref()).ok()?;
    Some((reference, cost))
}

fn total(breakdown: &Option<Breakdown>) -> Option<f64> {
    breakdown.as_ref().map(|breakdown| breakdown.total).filter(|total| total.is_finite())
}

/// The cost of some blocks of walks; `None` if one diverged.
fn chosen_blocks(cost: &dyn Cost, blocks: &[Predicted], chosen: &[usize]) -> Option<Breakdown> {
    let mut accumulator = cost.begin();
    for &block in chosen {
        accumulator.add(block, blocks.get(block)?.signals()).ok()?;
    }
    accumulator.finish().ok()
}

/// The cost of all blocks of all simulations together, as the search pools its simulations of a log; `None` if one
/// diverged.
fn pooled(cost: &dyn Cost, walks: &[Vec<Predicted>]) -> Option<Breakdown> {
    let mut accumulator = cost.begin();
    for walk in walks {
        for (number, block) in walk.iter().enumerate() {
            accumulator.add(number, block.signals()).ok()?;
        }
    }
    accumulator.finish().ok()
}

/// The numbers below `count` in an order that `draw` decides.
fn shuffled(draw: u32, count: usize) -> Vec<usize> {
    let stream = Stream::new(SEED, Purpose::BOOTSTRAP).step(draw);
    let mut order: Vec<usize> = (0..count).collect();
    // Fisher and Yates's shuffle.
    for place in 0..count.saturating_sub(1) {
        // Each place takes one of the numbers that are left, with the same probability.
        let left = (count - place) as f64;
        order.swap(place, place + (stream.uniform(place as u32) * left) as usize);
    }
    order
}

/// The blocks in two halves: each log's blocks in turn, in an order that `draw` decides, so that both halves have the
/// same commands. `logs`: the log of each block, ascending.
fn halves(draw: u32, logs: &[usize]) -> (Vec<usize>, Vec<usize>) {
    let order = shuffled(draw, logs.len());
    let mut places: Vec<usize> = (0..logs.len()).collect();
    places.sort_by_key(|&block| (logs[block], order[block]));
    let (one, other): (Vec<_>, Vec<_>) =
        places.into_iter().enumerate().partition(|(place, _)| place % 2 == 0);
    let blocks = |half: Vec<(usize, usize)>| half.into_iter().map(|(_, block)| block).collect();
    (blocks(one), blocks(other))
}

/// How far the robot is from itself: one half of its blocks is compared with the other half, in many draws. The
/// simulated robot's blocks are compared with the same halves. Also returns each draw of the robot's own. `logs`: the
/// log of each block. Each draw takes the next single simulation in turn, because a half of the robot's blocks has no
/// more data than that.
fn floor(
    cost: &dyn Cost,
    recorded: &[Predicted],
    after: &[Vec<Predicted>],
    logs: &[usize],
) -> (Option<Floor>, Vec<Breakdown>) {
    let (mut drawn, mut fitted) = (Vec::new(), Vec::new());
    // Too few blocks have no halves that are alike.
    for draw in (0..DRAWS).take_while(|_| recorded.len() >= MIN_BLOCKS) {
        let (one, other) = halves(draw, logs);
        let Some(against) = cost.subset(&one) else { break };
        drawn.extend(chosen_blocks(against.as_ref(), recorded, &other));
        // Only draws in which the fitted robot could be compared count for it.
        let simulated = after.get(draw as usize % after.len().max(1));
        fitted.extend(simulated.and_then(|walk| total(&chosen_blocks(against.as_ref(), walk, &other))));
    }
    let totals: Vec<f64> = drawn.iter().map(|breakdown| breakdown.total).collect();
    let floor = stats::mean(&totals).zip(stats::deviation(&totals)).map(|(mean, deviation)| Floor {
        mean,
        range95: stats::NORMAL_95 * deviation,
        // A mean over other draws could not be set beside the robot's own.
        cost: stats::mean(&fitted).filter(|_| fitted.len() == drawn.len()),
    });
    (floor, drawn)
}

/// Scaled distances in the signals' own units.
fn distances(
    reference: &Reference,
    [fitted, nominal]: [&Option<Breakdown>; 2],
    drawn: &[Breakdown],
) -> Vec<Distance> {
    let scaled = |breakdown: &Breakdown, signal: Signal, joint: usize| -> Option<f64> {
        let group = breakdown.groups.iter().find(|group| group.signal == signal)?;
        group.per_joint.get(joint).copied().flatten().filter(|distance| distance.is_finite())
    };
    let mut rows = Vec::new();
    for signal in [Signal::Position, Signal::Velocity, Signal::Action] {
        let dimensions = reference.dimensions(signal).unwrap_or_default();
        for (joint, (name, dimension)) in reference.joints().iter().zip(dimensions).enumerate() {
            // Constant dimensions have no scale and are not shown.
            let Some(scale) = dimension.scale else { continue };
            let relative = |breakdown: &Option<Breakdown>| {
                breakdown
                    .as_ref()
                    .and_then(|breakdown| scaled(breakdown, signal, joint))
                    .map(|distance| distance / scale)
            };
            let floor: Vec<f64> =
                drawn.iter().filter_map(|breakdown| scaled(breakdown, signal, joint)).collect();
            // A distance in the cost is one of signals whose range is 2. Divided by the scale it has the
            // signal's unit.
            rows.push(Distance {
                joint: name.clone(),
                signal,
                fitted: relative(fitted),
                nominal: relative(nominal),
                floor: stats::mean(&floor).map(|distance| distance / scale),
            });
        }
    }
    rows
}

#[cfg(test)]
#[path = "compare_test.rs"]
mod tests;
