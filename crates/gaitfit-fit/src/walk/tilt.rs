//! Falls in logs that have joint signals alone. The policy observed how far the base leans, so its actions show it.
//!
//! [`Search`] finds the direction of gravity with which the policy chooses the logged action. On a simulated Go2 it is
//! within 15° of the truth under torque noise of 8 N·m; under 20 N·m single samples are wrong, medians are not. Of 41
//! falls in 144 simulated walks (noise of 2 to 20 N·m, friction of 0.5 to 5 N·m, armature of 0.3 kg·m²) it shows 37, most
//! within 0.2 s, and none in the 103 walks without a fall; a robot that sits down level on its trunk is not seen.

use super::imu_search::Search;
use super::observation::{Given, Unknown};
use gaitfit_log::Trajectory;
use gaitfit_policy::{Policy, Quantity};
use std::ops::Range;

/// Time between looks, s.
const EVERY_S: f64 = 0.1;
/// Number of looks whose median counts.
const MEDIAN: usize = 5;
/// Lean of a robot that falls, degrees: one that walks stays below 25, and the estimate errs by 15.
const FALLEN: f64 = 50.0;

/// Ranges with at most this many looks between them are one fall: a robot that rolls on its back seems upright for a moment.
const APART: usize = 10;

/// Sample ranges in which the robot leans as one that fell, for a log without the base's orientation at the policy's
/// rate. Right only if the log's actions are the policy's; none for policies that observe or remember the past. `spread`: of each joint's actions.
pub fn falls(policy: &Policy, log: &Trajectory, spread: &[f64]) -> Vec<Range<usize>> {
    let interface = &policy.interface;
    let Some(action) = &log.action else { return Vec::new() };
    let known = Given::from_log(log, 0);
    let unknown = known.missing(interface);
    // With past frames or a memory several samples would be unknown together, and any policy could be made to
    // fit.
    let remembers = policy.is_recurrent() || interface.observation.iter().any(|term| term.history > 1);
    if !unknown.contains(&Unknown { quantity: Quantity::ProjectedGravity, number: 0 }) || remembers {
        return Vec::new();
    }
    // Each look costs a search, so only some samples are looked at.
    let every = ((EVERY_S / interface.control_dt).round() as usize).max(1);
    leaning(&looks(policy, log, action, spread, every), every, log.len())
}

/// The lean at every `every`-th sample of a log with these actions: sample, degrees.
fn looks(
    policy: &Policy,
    log: &Trajectory,
    action: &[f64],
    spread: &[f64],
    every: usize,
) -> Vec<(usize, f64)> {
    let joints = policy.interface.joints.len();
    let row = |sample: usize| action[sample * joints..(sample + 1) * joints].to_vec();
    let chosen: Vec<(usize, Vec<f64>, Vec<f64>)> =
        (1..log.len()).step_by(every).map(|sample| (sample, row(sample), row(sample - 1))).collect();
    let mut search = Search::new(policy, spread);
    // A log does not say when the gait clock began.
    let clock = search.clock(log, &chosen);
    let look = |(sample, logged, last): &(usize, Vec<f64>, Vec<f64>)| {
        let given = Given::from_log(log, *sample);
        let (_, nearest) = search.nearest(log, *sample, last, &given, clock, logged);
        // The sine of the lean. Beyond 90° it falls again: a robot on its back seems upright, see [`APART`].
        let [x, y, _] = nearest.get(Quantity::ProjectedGravity).unwrap_or_default();
        (*sample, x.hypot(y).min(1.0).asin().to_degrees())
    };
    chosen.iter().map(look).collect()
}

/// Ranges of samples around medians beyond [`FALLEN`] of `looks` (sample, degrees).
fn leaning(looks: &[(usize, f64)], every: usize, samples: usize) -> Vec<Range<usize>> {
    let mut ranges: Vec<Range<usize>> = Vec::new();
    for window in looks.windows(MEDIAN) {
        let mut degrees: Vec<f64> = window.iter().map(|look| look.1).collect();
        degrees.sort_by(f64::total_cmp);
        // The median of five: two wrong looks in a row do not make a fall.
        if degrees[MEDIAN / 2] <= FALLEN {
            continue;
        }
        let high = || window.iter().filter(|look| look.1 > FALLEN).map(|look| look.0);
        let (Some(first), Some(last)) = (high().next(), high().next_back()) else { continue };
        // A look stands for the time until the next one.
        let range = first..(last + every).min(samples);
        match ranges.last_mut() {
            Some(known) if range.start <= known.end + APART * every => known.end = known.end.max(range.end),
            _ => ranges.push(range),
        }
    }
    ranges
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::walk::fixtures::{clocked, logs, policy, puppet, scene};
    use crate::walk::policy_check::spread;

    #[test]
    fn single_looks_are_not_falls() {
        let looks = |degrees: &[f64]| -> Vec<(usize, f64)> {
            degrees.iter().enumerate().map(|(k, &degrees)| (5 * k, degrees)).collect()
        };
        assert!(leaning(&looks(&[5.0, 90.0, 4.0, 8.0, 70.0, 3.0, 5.0]), 5, 40).is_empty());
        let twice = [60.0, 70.0, 80.0, 5.0, 4.0, 5.0, 3.0, 60.0, 70.0, 80.0, 90.0];
        let fell = leaning(&looks(&twice), 5, 55);
        assert_eq!((fell.len(), fell[0].clone()), (1, 0..55));
        let fell = leaning(&looks(&[5.0, 9.0, 60.0, 80.0, 90.0, 85.0, 90.0, 88.0]), 5, 38);
        assert_eq!((fell.len(), fell[0].clone()), (1, 10..38));
    }

    /// A robot that is level seems so, whatever the phase of the gait clock at which its log begins.
    #[test]
    fn the_lean_does_not_depend_on_when_the_gait_clock_began() {
        let policy = policy(&clocked(), 3);
        let log = puppet(&policy, 1, 2.0);
        // The clock turns by a twentieth in a sample: after ten it is at its other half.
        let later = log.slice(10..log.len()).unwrap();
        let spread = spread(&[&later], 12);
        let looks = looks(&policy, &later, later.action.as_ref().unwrap(), &spread, 5);
        assert!(looks.len() > 10 && looks.iter().all(|look| look.1 < 1.0), "{looks:?}");
    }

    /// Where the base is known the estimate is not needed; where it is not, the estimate is near the truth.
    #[test]
    fn the_lean_is_found_without_an_inertial_unit() {
        let scene = scene();
        let policy = policy(&scene, 3);
        let known = logs(&scene, &policy, true);
        let hidden = logs(&scene, &policy, false);
        let spread = spread(&hidden.iter().collect::<Vec<_>>(), 12);
        assert!(falls(&policy, &known[0], &spread).is_empty());
        let mut search = Search::new(&policy, &spread);
        let gravity = |given: &Given| given.get(Quantity::ProjectedGravity).unwrap();
        let (mut off, mut looks) = (Vec::new(), 0);
        for (known, hidden) in known.iter().zip(&hidden) {
            let action = hidden.action.as_ref().unwrap();
            for sample in (1..hidden.len()).step_by(7) {
                let row = |sample: usize| &action[12 * sample..12 * sample + 12];
                let (_, nearest) =
                    search.nearest(hidden, sample, row(sample - 1), &Given::default(), 0.0, row(sample));
                let (truth, estimate) = (gravity(&Given::from_log(known, sample)), gravity(&nearest));
                off.push((truth[0] - estimate[0]).hypot(truth[1] - estimate[1]));
                looks += 1;
            }
        }
        off.sort_by(f64::total_cmp);
        assert!(off[looks / 2] < 0.1, "median {}", off[looks / 2]);
    }
}
