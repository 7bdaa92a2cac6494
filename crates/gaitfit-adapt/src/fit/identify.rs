//! Which parameters the data identify: how flat the cost is along each, measured against the cost's own noise.
//!
//! Around the best values each parameter alone is moved to both sides, in steps from a thousandth of its range to its
//! bounds. The noise of each rise of the cost is its jackknife standard error over groups of recordings: the rise is
//! computed anew without each group, which covers what the choice of recordings and the simulation's own randomness
//! do to it (Efron and Stein 1981, eq. 1.1, in groups). The interval ends where the rise exceeds its standard error.
//! For a smooth cost with curvature H and a gradient of noise s the rise is ½Hδ² and its error sδ, so the interval is
//! δ = 2 s/H: two standard errors of the estimate to either side. Noise n that does not grow, as of one recording, gives
//! δ = √(2 n/H).
//!
//! Here the other parameters stay where they are. What they can make up for, and what other simulators would have
//! found, [`joint`] adds.

use super::identification::{Identification, NoiseSource, narrow};
use super::joint::{Around, joint};
use super::views::{Views, jackknife};
use super::{Alternative, FitError};
use crate::cost::Cost;
use crate::{Cancel, Entry, Rollout, Signals, Simulator, Theta};
use gaitfit_sim::stats;
use std::sync::atomic::{AtomicUsize, Ordering};

/// Most entries of a θ that is scanned.
pub const MAX_SCANNED: usize = 50;
// Between two steps the end of an interval is only interpolated; each step costs a simulation to both sides.
/// Steps of the scan, parts of the range, half a decade apart; the bounds come on top.
const STEPS: [f64; 6] = [1e-3, 3.16e-3, 1e-2, 3.16e-2, 1e-1, 3.16e-1];
/// Draws, where recordings are too few or the robot falls.
const DRAWS: u64 = 8;
/// Rises below this count as rounding of single-precision signals, in units where the robot's range is 2; and parts of
/// the cost below this as nothing worth telling apart.
const FLOOR: (f64, f64) = (1e-6, 1e-3);
/// Standard errors by which a lower cost beside the best values counts: dozens of parameters are looked at, and by chance
/// one of them is lower by one or two.
const SURE: f64 = 3.0;
/// The part of the cost taken for its noise where it cannot be measured.
const ASSUMED: f64 = 0.05;
/// Memory for signals waiting for the rest of their candidate's, bytes.
const MEMORY: usize = 256 << 20;

/// A point of the scan.
struct Point {
    entry: usize,
    value: f64,
}

/// The rise of the cost at a point, and what of it may be noise; `None` where the simulation diverged.
type Rise = Option<(f64, f64)>;

/// Measures how flat `cost` is along each entry of `theta` around `values`, in one batch of the simulator after small
/// ones for the values themselves. `draw` selects the random draws, the same for all; if robots of the values fall in
/// it, one of the next few in which fewest do is taken, for a robot that by chance falls in one recording drowns all
/// that the others say. `alternatives` could stand in for the simulator. What falls add beyond the samples they lose, and regularisation, are left out: this is about
/// the data.
///
/// # Errors
/// As [`super::evaluate`]; [`FitError::Scan`] if there are more than [`MAX_SCANNED`] entries or `values` diverges.
pub fn identify(
    simulator: &dyn Simulator,
    theta: &Theta,
    cost: &dyn Cost,
    values: &[f64],
    alternatives: &[Alternative<'_>],
    draw: u64,
    cancel: &Cancel<'_>,
) -> Result<Vec<Identification>, FitError> {
    if theta.len() > MAX_SCANNED || values.len() != theta.len() {
        return Err(FitError::Scan(format!(
            "{} values of {} parameters; at most {MAX_SCANNED} can be scanned",
            values.len(),
            theta.len()
        )));
    }
    let recordings = simulator.recordings();
    // A view is all recordings but one group, for the jackknife; the first has all.
    let views = Views::new(cost, recordings, simulator.logs());
    let rollout = |values: Vec<f64>, draw: u64| Rollout { values, resets: cost.resets(), draw };
    let draw = steadiest(simulator, theta, draw, |draw| rollout(values.to_vec(), draw), cancel)?;
    // Several recordings show the noise by their differences; of a single one only other random draws can.
    let more = if views.count() > 1 { 0 } else { DRAWS };
    let best: Vec<Rollout> =
        (0..=more).map(|next| rollout(values.to_vec(), draw.wrapping_add(next))).collect();
    let (best, bytes) = simulator.views(theta, &views, &best, &|| (), cancel)?;
    let diverged = || FitError::Scan("the simulation of the best values diverges".to_owned());
    let centre = best.first().cloned().flatten().ok_or_else(diverged)?;

    // Without a floor rounding would pass for a rise of the cost.
    let floor = FLOOR.0 + FLOOR.1 * centre[0].abs();
    // The part of the noise that does not grow with the distance.
    let (noise, fixed) = if views.count() > 1 {
        (NoiseSource::Recordings, 0.0)
    } else {
        let draws: Vec<f64> = best[1..].iter().flatten().map(|costs| costs[0]).collect();
        // Draws of a simulator without randomness agree but for the rounding of their mean.
        match stats::deviation(&draws).filter(|spread| *spread > 1e-12 * centre[0].abs()) {
            Some(spread) => (NoiseSource::Draws, spread),
            None => (NoiseSource::Assumed, ASSUMED * centre[0]),
        }
    };
    let fixed = fixed.max(floor);
    let rise = |costs: &Vec<f64>| {
        let rises: Vec<f64> = costs.iter().zip(&centre).map(|(there, here)| there - here).collect();
        // The first view holds all recordings. The others leave a group out, for the jackknife.
        (rises[0], jackknife(&rises[1..]).max(fixed))
    };

    // All points of all entries are one list, so that few large batches simulate them.
    let points: Vec<Point> =
        theta.entries().iter().enumerate().flat_map(|(at, entry)| scan(at, entry, values[at])).collect();
    let mut rises: Vec<Rise> = Vec::with_capacity(points.len());
    // The signals of all rollouts of a chunk may be in memory together.
    for points in points.chunks((MEMORY / bytes.max(1)).max(1)) {
        let moved = |point: &Point| {
            let mut values = values.to_vec();
            values[point.entry] = point.value;
            rollout(values, draw)
        };
        let rollouts: Vec<Rollout> = points.iter().map(moved).collect();
        let (costs, _) = simulator.views(theta, &views, &rollouts, &|| (), cancel)?;
        rises.extend(costs.iter().map(|costs| costs.as_ref().map(rise)));
    }
    let of_entry = |(at, entry): (usize, &Entry)| {
        let rises: Vec<(f64, Rise)> = points
            .iter()
            .zip(&rises)
            .filter(|(point, _)| point.entry == at)
            .map(|(point, rise)| (point.value, *rise))
            .collect();
        let charged = |value: f64| {
            let mut moved = values.to_vec();
            moved[at] = value;
            let charge = |values: &[f64]| theta.regularisation(values) + theta.prior_cost(values);
            charge(&moved) - charge(values)
        };
        verdict(entry, values[at], &rises, (noise, fixed), charged)
    };
    let mut identifications: Vec<Identification> = theta.entries().iter().enumerate().map(of_entry).collect();
    let around =
        Around { simulator, theta, values, views: &views, centre: &centre, draw, rise: &rise, fixed, cancel };
    joint(&around, alternatives, &mut identifications)?;
    Ok(identifications)
}

/// Standard error of `cost` at `values`: jackknife over groups of recordings. `None` of a single recording, and if the
/// simulation diverges. Sets of values whose costs differ by less fit equally well.
///
/// # Errors
/// As [`super::evaluate`].
pub fn cost_error(
    simulator: &dyn Simulator,
    theta: &Theta,
    cost: &dyn Cost,
    values: &[f64],
    draw: u64,
    cancel: &Cancel<'_>,
) -> Result<Option<f64>, FitError> {
    let views = Views::new(cost, simulator.recordings(), simulator.logs());
    let rollout = Rollout { values: values.to_vec(), resets: cost.resets(), draw };
    let (costs, _) = simulator.views(theta, &views, &[rollout], &|| (), cancel)?;
    let costs = costs.into_iter().next().flatten();
    Ok(costs.filter(|costs| costs.len() > 1).map(|costs| jackknife(&costs[1..])))
}

/// The first of [`DRAWS`] draws from `first` with the fewest falls.
fn steadiest(
    simulator: &dyn Simulator,
    theta: &Theta,
    first: u64,
    rollout: impl Fn(u64) -> Rollout,
    cancel: &Cancel<'_>,
) -> Result<u64, FitError> {
    let falls = |draws: &[u64]| -> Result<Vec<usize>, FitError> {
        // Falls are reported from several threads, hence atomic counters.
        let counts: Vec<AtomicUsize> = draws.iter().map(|_| AtomicUsize::new(0)).collect();
        let rollouts: Vec<Rollout> = draws.iter().map(|&draw| rollout(draw)).collect();
        let consume = |candidate: usize, _: usize, signals: Signals<'_>| {
            if let Some(count) = counts.get(candidate).filter(|_| signals.fell_at.is_some()) {
                // The counts are read after the simulation's end, so no order among threads matters.
                count.fetch_add(1, Ordering::Relaxed);
            }
        };
        simulator.simulate(theta, &rollouts, &consume, cancel)?;
        Ok(counts.into_iter().map(AtomicUsize::into_inner).collect())
    };
    // Most robots do not fall; then one simulation is enough.
    if falls(&[first])? == [0] {
        return Ok(first);
    }
    let draws: Vec<u64> = (0..DRAWS).map(|next| first.wrapping_add(next)).collect();
    let fewest = draws.iter().zip(falls(&draws)?).min_by_key(|&(_, falls)| falls);
    Ok(fewest.map_or(first, |(&draw, _)| draw))
}

/// The points of an entry: on each side outwards, ending at the bound.
fn scan(at: usize, entry: &Entry, value: f64) -> Vec<Point> {
    let range = entry.upper - entry.lower;
    let mut points = Vec::new();
    for (bound, sign) in [(entry.lower, -1.0), (entry.upper, 1.0)] {
        let room = (bound - value).abs();
        // A step that nearly reaches the bound would only repeat its point.
        let steps = STEPS.iter().map(|step| step * range).filter(|step| *step < 0.9 * room);
        points.extend(steps.map(|step| Point { entry: at, value: value + sign * step }));
        if room > 0.0 {
            points.push(Point { entry: at, value: bound });
        }
    }
    points
}

/// `fixed` is the part of the noise that does not grow. `charged` is what regularisation and priors add at a value: part of
/// what the search minimises, not of what the data say.
fn verdict(
    entry: &Entry,
    value: f64,
    points: &[(f64, Rise)],
    (noise, fixed): (NoiseSource, f64),
    charged: impl Fn(f64) -> f64,
) -> Identification {
    let side = |below: bool| -> (f64, f64) {
        // Ordered by distance, as `end` expects them.
        let mut side: Vec<(f64, Rise)> = points
            .iter()
            .filter(|(at, _)| (*at < value) == below)
            .map(|(at, rise)| ((at - value).abs(), *rise))
            .collect();
        side.sort_by(|a, b| a.0.total_cmp(&b.0));
        end(&side, fixed)
    };
    let ((down, rise_down), (up, rise_up)) = (side(true), side(false));
    let (lower, upper) = ((value - down).max(entry.lower), (value + up).min(entry.upper));
    let sure = |(at, rise): &(f64, Rise)| rise.map(|(rise, noise)| (*at, rise + SURE * noise + charged(*at)));
    let lowest = points.iter().filter_map(sure);
    let lowest = lowest.min_by(|a, b| a.1.total_cmp(&b.1));
    Identification {
        lower,
        upper,
        rise: rise_down.max(rise_up),
        noise,
        identified: narrow(entry, lower, upper),
        better: lowest.filter(|(_, rise)| *rise < 0.0).map(|(at, _)| at),
    }
}

/// How far out the cost rises no more than its noise, and the noise there. `side` is ordered by distance. Beyond the
/// last point whose rise is noise the end is found by the two's growth: the rise as δ², the noise as δ, but for the part
/// `fixed`, which does not grow.
pub(super) fn end(side: &[(f64, Rise)], fixed: f64) -> (f64, f64) {
    let within = |rise: &Rise| rise.is_some_and(|(rise, noise)| rise <= noise);
    let last = side.iter().rposition(|(_, rise)| within(rise));
    let from = last.map_or(0.0, |last| side[last].0);
    let noise_from = last.and_then(|last| side[last].1).map_or(0.0, |(_, noise)| noise);
    match side.get(last.map_or(0, |last| last + 1)) {
        None => (from, noise_from),
        // The simulation diverges somewhere before this point; the middle is the best guess.
        Some((to, None)) => (0.5 * (from + to), noise_from),
        Some((to, Some((rise, noise)))) => {
            // Noise that grows with the distance ends the interval at its share of the rise. Noise that does not grow
            // ends it at the root of the share, because the rise is a parabola.
            let part = (noise / rise).max((fixed / rise).sqrt());
            ((to * part).clamp(from, *to), *noise)
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_interval_ends_where_the_rise_meets_the_noise() {
        // Rise δ², noise 0.3 δ: they meet at 0.3.
        let point = |delta: f64| (delta, Some((delta * delta, 0.3 * delta)));
        let side = [0.1, 0.2, 0.5, 1.0].map(point);
        assert!((end(&side, 0.0).0 - 0.3).abs() < 1e-12);
        assert_eq!(end(&[0.1, 0.2].map(point), 0.0).0, 0.2, "flat up to the bound");
        assert_eq!(end(&[point(0.1), (0.3, None)], 0.0).0, 0.2, "divergence ends it");
        assert_eq!(end(&[], 0.0), (0.0, 0.0), "at a bound there is no side");
        // Rise δ², noise 0.09 everywhere: they meet at 0.3 too.
        let side = [0.1, 0.2, 0.5, 1.0].map(|delta: f64| (delta, Some((delta * delta, 0.09))));
        assert!((end(&side, 0.09).0 - 0.3).abs() < 1e-12);
        assert!((end(&side[2..], 0.09).0 - 0.3).abs() < 1e-12, "also without a point before it");
    }

    #[test]
    fn a_lower_cost_counts_from_three_standard_errors_on() {
        let entry = Entry {
            name: "p".into(),
            kind: "p",
            joints: Vec::new(),
            unit: "-".into(),
            lower: 0.0,
            upper: 1.0,
            start: 0.5,
            deviation: 0.1,
        };
        let better = |rise: f64| {
            let points = [(0.4, Some((rise, 0.1))), (0.6, Some((1.0, 0.1)))];
            verdict(&entry, 0.5, &points, (NoiseSource::Recordings, 0.0), |_| 0.0).better
        };
        assert_eq!((better(-0.29), better(-0.31)), (None, Some(0.4)));
    }
}
