//! Walking logs that were not fitted: how far the simulated robot's walks under their commands are from them, beside
//! how far other logs of the same robot are.
//!
//! The measure is [`Wass`](gaitfit_adapt::cost::Wass) on whole walks, whatever cost was fitted: it needs neither clocks
//! nor the same commands, so logs can be compared with logs. That gives a floor. No simulator need be closer to the
//! held-out logs than the robot's other logs are.

use super::Method;
use super::score::Robot;
use super::setup::LogSet;
use crate::Error;
use crate::log::Log;
use crate::settings::AdaptConfig;
use gaitfit_adapt::Resets;
use gaitfit_adapt::cost::{Breakdown, Cost, CostKind, Recorded, Reference, Signal};
use gaitfit_adapt::fit::Predicted;
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::stats;
use gaitfit_view::{Doubt, DoubtKind};
use serde::{Deserialize, Serialize};
use std::sync::Arc;

/// How often other logs are drawn for the floor.
const DRAWS: u32 = 200;
/// Half the width of the range that 95 % of normal draws lie in, in deviations.
const RANGE: f64 = 1.96;
/// Seed of the draws.
const SEED: u64 = 15;

/// How far simulated walks are from held-out logs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct HeldOut {
    /// Logs, or stretches of logs, that were compared.
    pub logs: usize,
    /// What counts of them together, s.
    pub seconds: f64,
    /// `wass` of the fitted robot; absent if it diverged. The robot's range is 2 in each of the three signals.
    pub cost: Option<f64>,
    /// The same of the robot before the fit.
    pub nominal_cost: Option<f64>,
    /// The same of other logs of the robot; absent where there are too few.
    pub floor: Option<Floor>,
    /// Logs in which the fitted robot falls.
    pub falls: usize,
    /// The same before the fit.
    pub nominal_falls: usize,
    /// Joint by joint, signal by signal.
    pub distances: Vec<Distance>,
}

/// How far other logs of the robot are from the held-out ones.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Floor {
    /// Mean over the draws.
    pub mean: f64,
    /// Half the width of the range in which 95 % of such draws lie.
    pub range95: f64,
    /// What was drawn.
    pub of: FloorOf,
    /// Logs of a draw.
    pub logs: usize,
    /// The fitted robot's cost on what the draws were compared with: with halves it differs from that on all logs.
    pub cost: Option<f64>,
}

/// What a floor is made of.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum FloorOf {
    /// Fitted logs against the held-out ones, as many as these.
    OtherLogs,
    /// One half of the held-out logs against the other half.
    Halves,
}

/// Wasserstein-1 distance of a joint's signal to the held-out logs, in the signal's unit; NaN becomes absent.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Distance {
    /// Joint.
    pub joint: String,
    /// Signal.
    pub signal: Signal,
    /// Of the fitted robot.
    pub fitted: Option<f64>,
    /// Of the robot before the fit.
    pub nominal: Option<f64>,
    /// Of other logs of the robot, mean over the draws.
    pub floor: Option<f64>,
}

/// Whether the fit explains the logs.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Verdict {
    /// No worse than other logs of the robot would.
    Explained,
    /// Worse than other logs of the robot would, but better than the robot before the fit.
    Misfit,
    /// Worse than the robot before the fit.
    WorseThanNominal,
    /// There is no floor to judge by.
    Unknown,
}

/// Compares walks under the commands of held-out logs with them. `sets`: these logs with the simulators of the robot
/// after and before the fit, and what of it θ changes; `others`: logs of the same robot for the floor, at best the
/// fitted ones, without which the floor is of halves.
///
/// # Errors
/// A simulation that cannot be made. Logs that cannot be compared in this way (constant joints) give none.
pub(super) fn held_out(
    config: &AdaptConfig,
    method: &Method,
    [fitted, nominal]: [(&LogSet, Robot<'_>); 2],
    others: &[Log],
) -> Result<Option<HeldOut>, Error> {
    if method.walking().is_none() {
        return Ok(None);
    }
    // Whole walks need the longer time to settle, whatever the fit needed.
    let config = AdaptConfig { costs: vec![CostKind::Wass], ..config.clone() };
    let (set, joints) = (fitted.0, method.joints());
    let skip = method.samples(config.skip_seconds(), &set.logs);
    let long = |log: &&Log| log.trajectory.len() > skip;
    let logs: Vec<&Log> = set.logs.iter().filter(long).collect();
    let found = logs.iter().map(|log| Recorded::from_trajectory(&log.trajectory, &joints, 0));
    let reference = found.collect::<Result<Vec<_>, _>>();
    let reference = reference.and_then(|found| Reference::new(joints.clone(), &found, skip)).map(Arc::new);
    let Ok(reference) = reference else { return Ok(None) };
    let Ok(cost) = CostKind::Wass.build(&reference, set.simulator.as_ref()) else { return Ok(None) };
    let cost = cost.as_ref();
    let walk = |(set, robot): (&LogSet, Robot<'_>)| -> Result<Vec<Predicted>, Error> {
        let walked = robot.simulate(set.simulator.as_ref(), Resets::Never)?;
        let kept = set.logs.iter().zip(walked).filter(|(log, _)| long(log));
        Ok(kept.map(|(_, walked)| walked).collect())
    };
    let (after, before) = (walk(fitted)?, walk(nominal)?);
    let all: Vec<usize> = (0..logs.len()).collect();
    let (fitted, nominal) = (of(cost, &after, &all), of(cost, &before, &all));
    let others: Vec<Predicted> =
        others.iter().filter(long).filter_map(|log| recorded(log, &joints)).collect();
    let (floor, drawn) = match floor_of_others(cost, &others, logs.len()) {
        Some((floor, drawn)) => (Some(Floor { cost: total(&fitted), ..floor }), drawn),
        None => halves(cost, &logs, &joints, &after),
    };
    let falls = |walked: &[Predicted]| walked.iter().filter(|log| log.fell_at.is_some()).count();
    let counted = |log: &&Log| log.trajectory.duration() - config.skip_seconds();
    Ok(Some(HeldOut {
        logs: logs.len(),
        seconds: logs.iter().map(counted).sum(),
        cost: total(&fitted),
        nominal_cost: total(&nominal),
        floor,
        falls: falls(&after),
        nominal_falls: falls(&before),
        distances: distances(&reference, [&fitted, &nominal], &drawn),
    }))
}

fn total(breakdown: &Option<Breakdown>) -> Option<f64> {
    breakdown.as_ref().map(|breakdown| breakdown.total).filter(|total| total.is_finite())
}

/// The cost of some of the walks; none if one diverged.
fn of(cost: &dyn Cost, walks: &[Predicted], chosen: &[usize]) -> Option<Breakdown> {
    let mut accumulator = cost.begin();
    for (number, &walk) in chosen.iter().enumerate() {
        accumulator.add(number, walks.get(walk)?.signals()).ok()?;
    }
    accumulator.finish().ok()
}

/// A log's own signals as if they had been simulated.
fn recorded(log: &Log, joints: &[String]) -> Option<Predicted> {
    let found = Recorded::from_trajectory(&log.trajectory, joints, 0).ok()?;
    let single = |values: &[f64]| values.iter().map(|&value| value as f32).collect();
    Some(Predicted {
        position: single(&found.position),
        velocity: single(&found.velocity),
        action: found.action.as_deref().map(single),
        ..Predicted::default()
    })
}

/// `count` of `among` numbers, drawn without repetition; the rest follows them.
fn drawn(draw: u32, among: usize) -> Vec<usize> {
    let stream = Stream::new(SEED, Purpose::BOOTSTRAP).step(draw);
    let mut order: Vec<usize> = (0..among).collect();
    for place in 0..among.saturating_sub(1) {
        let left = (among - place) as f64;
        order.swap(place, place + (stream.uniform(place as u32) * left) as usize);
    }
    order
}

/// The floor of as many other logs as are held out, and the draws. Draws from a small stock resemble one another: their
/// deviation is that of draws from a large one times √(1 − drawn / stock), which is undone.
fn floor_of_others(cost: &dyn Cost, others: &[Predicted], count: usize) -> Option<(Floor, Vec<Breakdown>)> {
    let spare = others.len().checked_sub(count).filter(|&spare| spare > 0)?;
    let draws: Vec<Breakdown> =
        (0..DRAWS).filter_map(|draw| of(cost, others, &drawn(draw, others.len())[..count])).collect();
    let totals: Vec<f64> = draws.iter().map(|found| found.total).collect();
    let deviation = stats::deviation(&totals)? * (others.len() as f64 / spare as f64).sqrt();
    let mean = stats::mean(&totals)?;
    Some((Floor { mean, range95: RANGE * deviation, of: FloorOf::OtherLogs, logs: count, cost: None }, draws))
}

/// The floor of one half against the other. The fitted robot's cost beside it is on the same halves.
fn halves(
    cost: &dyn Cost,
    logs: &[&Log],
    joints: &[String],
    after: &[Predicted],
) -> (Option<Floor>, Vec<Breakdown>) {
    let own: Option<Vec<Predicted>> = logs.iter().map(|log| recorded(log, joints)).collect();
    let (Some(own), half) = (own, logs.len() / 2) else { return (None, Vec::new()) };
    let (mut draws, mut fitted) = (Vec::new(), Vec::new());
    for draw in (0..DRAWS).take_while(|_| half > 0) {
        let order = drawn(draw, logs.len());
        let (one, other) = (&order[..half], &order[half..2 * half]);
        let Some(against) = cost.subset(one) else { break };
        draws.extend(of(against.as_ref(), &own, other));
        fitted.extend(total(&of(against.as_ref(), after, one)));
    }
    let totals: Vec<f64> = draws.iter().map(|found| found.total).collect();
    let floor = stats::mean(&totals).zip(stats::deviation(&totals)).map(|(mean, deviation)| Floor {
        mean,
        range95: RANGE * deviation,
        of: FloorOf::Halves,
        logs: half,
        cost: stats::mean(&fitted).filter(|_| fitted.len() == draws.len()),
    });
    (floor, draws)
}

/// Scaled distances in the signals' own units.
fn distances(
    reference: &Reference,
    [fitted, nominal]: [&Option<Breakdown>; 2],
    drawn: &[Breakdown],
) -> Vec<Distance> {
    let scaled = |found: &Breakdown, signal: Signal, joint: usize| -> Option<f64> {
        let group = found.groups.iter().find(|group| group.signal == signal)?;
        group.per_joint.get(joint).copied().flatten().filter(|distance| distance.is_finite())
    };
    let mut rows = Vec::new();
    for signal in [Signal::Position, Signal::Velocity, Signal::Action] {
        let dimensions = reference.dimensions(signal).unwrap_or_default();
        for (joint, (name, dimension)) in reference.joints().iter().zip(dimensions).enumerate() {
            let Some(scale) = dimension.scale else { continue };
            let of = |found: &Option<Breakdown>| {
                found.as_ref().and_then(|found| scaled(found, signal, joint)).map(|distance| distance / scale)
            };
            let floor: Vec<f64> = drawn.iter().filter_map(|found| scaled(found, signal, joint)).collect();
            rows.push(Distance {
                joint: name.clone(),
                signal,
                fitted: of(fitted),
                nominal: of(nominal),
                floor: stats::mean(&floor).map(|distance| distance / scale),
            });
        }
    }
    rows
}

impl HeldOut {
    /// Whether the fit explains the logs.
    pub fn verdict(&self) -> Verdict {
        let worse = |cost: Option<f64>, than: Option<f64>| match (cost, than) {
            (None, _) => true,
            (Some(cost), Some(than)) => cost > than,
            (Some(_), None) => false,
        };
        if self.cost.is_none() || worse(self.cost, self.nominal_cost) {
            return Verdict::WorseThanNominal;
        }
        let Some(floor) = &self.floor else { return Verdict::Unknown };
        if worse(floor.cost, Some(floor.mean + floor.range95)) { Verdict::Misfit } else { Verdict::Explained }
    }

    /// Why the fit must not be taken as it stands; none if it explains the logs.
    pub fn doubt(&self) -> Option<Doubt> {
        let kind = match self.verdict() {
            Verdict::Misfit => DoubtKind::Misfit,
            Verdict::WorseThanNominal => DoubtKind::WorseThanNominal,
            Verdict::Explained | Verdict::Unknown => return None,
        };
        Some(Doubt::new(kind, format!("On whole walks {}.", self.sentence())))
    }

    /// The result in a sentence.
    pub fn sentence(&self) -> String {
        let number = |value: Option<f64>| value.map_or_else(|| "diverged".to_owned(), |value| format!("{value:.4}"));
        let nominal = format!("the robot before the fit {}", number(self.nominal_cost));
        let logs = format!("{} held-out log{}", self.logs, if self.logs == 1 { "" } else { "s" });
        let Some(floor) = &self.floor else {
            return match self.verdict() {
                Verdict::WorseThanNominal => format!(
                    "the fit explains {logs} worse than the robot before the fit does: {} against {} (wass)",
                    number(self.cost),
                    number(self.nominal_cost)
                ),
                _ => format!(
                    "on {logs} wass is {}; {nominal}. There are too few logs to say what other logs of the robot would give",
                    number(self.cost)
                ),
            };
        };
        let numbers =
            format!("{} against {:.4} ± {:.4} (wass; {nominal})", number(floor.cost), floor.mean, floor.range95);
        let what = match floor.of {
            FloorOf::OtherLogs => logs,
            FloorOf::Halves => format!("halves of {logs}"),
        };
        match self.verdict() {
            Verdict::WorseThanNominal => format!(
                "the fit explains {what} worse than the robot before the fit does, let alone other logs of the same \
                 robot: {numbers}"
            ),
            Verdict::Misfit => format!(
                "the fit explains {what} worse than other logs of the same robot would: {numbers}"
            ),
            _ if floor.cost.is_some_and(|cost| cost < floor.mean - floor.range95) => format!(
                "the fit is closer to {what} than other logs of the same robot, which have other commands: {numbers}"
            ),
            _ => format!("the fit explains {what} as well as other logs of the same robot would: {numbers}"),
        }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_adapt::cost::Wass;
    use gaitfit_adapt::cost::Weights;

    /// Logs of a joint that moves with some deviation about a place.
    fn logs(seed: u64, count: u32, deviation: f64, place: f64) -> Vec<Predicted> {
        let stream = Stream::new(seed, Purpose(99));
        let of = |log: u32| {
            let values = (0..100).map(|k| (place + deviation * stream.step(log).normal(k)) as f32).collect();
            Predicted { position: values, velocity: vec![1.0; 100], ..Predicted::default() }
        };
        (0..count).map(of).collect()
    }

    fn cost(logs: &[Predicted]) -> Box<dyn Cost> {
        let wide = |values: &[f32]| values.iter().map(|&x| f64::from(x)).collect();
        let recorded: Vec<Recorded> = logs
            .iter()
            .map(|log| Recorded { position: wide(&log.position), velocity: wide(&log.velocity), ..Recorded::default() })
            .collect();
        let reference = Arc::new(Reference::new(vec!["hip".to_owned()], &recorded, 0).unwrap());
        Box::new(Wass::new(reference, Weights::POSITION).unwrap())
    }

    fn found(cost: f64, nominal: f64, floor: Option<(f64, f64, FloorOf)>) -> HeldOut {
        HeldOut {
            logs: 16,
            seconds: 48.0,
            cost: Some(cost),
            nominal_cost: Some(nominal),
            floor: floor.map(|(mean, range95, of)| Floor { mean, range95, of, logs: 16, cost: Some(cost) }),
            falls: 0,
            nominal_falls: 0,
            distances: Vec::new(),
        }
    }

    #[test]
    fn the_floor_is_what_logs_of_the_same_robot_give_and_its_range_holds_them() {
        let stock = logs(1, 48, 0.1, 0.0);
        let (mut inside, mut draws) = (0, Vec::new());
        for seed in 2..32 {
            let held = logs(seed, 16, 0.1, 0.0);
            let cost = cost(&held);
            let (floor, drawn) = floor_of_others(cost.as_ref(), &stock, 16).unwrap();
            let fresh = logs(seed + 100, 16, 0.1, 0.0);
            let other = of(cost.as_ref(), &fresh, &(0..16).collect::<Vec<_>>()).unwrap().total;
            inside += usize::from((other - floor.mean).abs() <= floor.range95);
            draws.push(drawn.len());
            // A robot that moves elsewhere is far above it.
            let wrong = of(cost.as_ref(), &logs(seed, 16, 0.1, 0.05), &(0..16).collect::<Vec<_>>()).unwrap();
            assert!(wrong.total > floor.mean + floor.range95, "{} {floor:?}", wrong.total);
        }
        assert!((24..=30).contains(&inside), "{inside} of 30 lie within the range of 95 %");
        assert!(draws.iter().all(|&count| count == DRAWS as usize));
        assert!(floor_of_others(cost(&stock).as_ref(), &logs(3, 48, 0.1, 0.0), 48).is_none(), "none to spare");
    }

    #[test]
    fn draws_are_permutations_that_differ() {
        let mut one = drawn(0, 9);
        assert_ne!(one, drawn(1, 9));
        one.sort_unstable();
        assert_eq!(one, (0..9).collect::<Vec<_>>());
        assert!(drawn(0, 0).is_empty());
    }

    #[test]
    fn the_sentence_says_worse_where_it_is_worse() {
        let floor = Some((0.0118, 0.0009, FloorOf::OtherLogs));
        let said = |one: HeldOut| (one.verdict(), one.sentence());
        let (verdict, text) = said(found(0.0121, 0.2, floor));
        assert_eq!(verdict, Verdict::Explained);
        assert!(text.contains("as well as other logs of the same robot would: 0.0121 against 0.0118 ± 0.0009"), "{text}");
        let (verdict, text) = said(found(0.013, 0.2, floor));
        assert!(verdict == Verdict::Misfit && text.contains("worse than other logs"), "{text}");
        let (verdict, text) = said(found(0.3, 0.2, floor));
        assert!(verdict == Verdict::WorseThanNominal && text.contains("worse than the robot before"), "{text}");
        let (verdict, text) = said(found(0.005, 0.2, floor));
        assert!(verdict == Verdict::Explained && text.contains("closer to 16 held-out logs"), "{text}");
        let (verdict, text) = said(found(0.1, 0.2, None));
        assert!(verdict == Verdict::Unknown && text.contains("too few logs"), "{text}");
        let (_, text) = said(found(0.0121, 0.2, Some((0.0118, 0.0009, FloorOf::Halves))));
        assert!(text.contains("halves of 16"), "{text}");
        let diverged = HeldOut { cost: None, ..found(0.1, 0.2, floor) };
        assert_eq!(diverged.verdict(), Verdict::WorseThanNominal);
    }
}
