//! Tests of the errors of short predictions for properties that noise does not have: memory, and a dependence on the
//! robot's motion.
//!
//! A prediction of a model that lacks nothing is off by noise of motors and sensors. Noise of one sample knows nothing
//! of the sample before, nor of velocity, acceleration, torque or command. A missing delay is off along the change of
//! the target, missing friction along the velocity, missing strength along the torque. So the errors of each joint are
//! regressed on these, as they were when the prediction began. The errors' largest part is made by feet that touch the
//! ground a moment sooner or later; errors are limited to three deviations, so that they do not drown the rest.

use super::log_set::LogSet;
use crate::log::Log;
use gaitfit_adapt::fit::Predicted;
use gaitfit_log::Signal;
use gaitfit_sim::{pool, stats};
use nalgebra::{DMatrix, DVector};
use serde::{Deserialize, Serialize};

/// Deviations beyond which an error counts as three of them, by the median of the absolute errors.
const LIMIT: f64 = 3.0;
/// The median of the absolute values of normal numbers of deviation 1.
const MEDIAN: f64 = 0.6745;
/// Samples of a joint from which on anything is said of it.
const MIN_SAMPLES: usize = 100;
/// Velocity at which dry friction is taken to change its sign, rad/s.
const SLOW: f64 = 0.3;
/// The quantities with which errors are compared.
const MOTIONS: [&str; 8] = [
    "velocity",
    "direction of motion",
    "acceleration",
    "torque",
    "change of the target",
    "command ahead",
    "command to the side",
    "command to turn",
];

/// The errors of short predictions of velocities.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Audit {
    /// Correlation of an error with the joint's error a sample before, mean over joints.
    pub memory: f64,
    /// Share of the errors' variance that correlates with the robot's motion, mean over joints.
    pub explained: f64,
    /// The quantity that errors go with most: its name and the correlation's size, mean over joints.
    #[serde(rename = "most")]
    pub strongest: (String, f64),
    /// The joint of whose errors the largest part goes with motion, and that part, 0 to 1.
    pub worst_joint: (String, f64),
}

impl Audit {
    /// The errors of the predictions of a set of logs without the first `skip` samples of each; `None` if there are too
    /// few samples.
    pub(super) fn new(set: &LogSet, predicted: &[Predicted], skip: usize) -> Option<Self> {
        let joints = set.logs.first()?.joints.len();
        let names = &set.logs.first()?.joints;
        let one = |joint: usize| {
            let logs = set.logs.iter().zip(predicted);
            let series: Vec<Series> =
                logs.filter_map(|(log, walk)| Series::new(log, walk, joint, joints, skip)).collect();
            Some((names[joint].clone(), Joint::new(&series)?))
        };
        let by_joint: Vec<(String, Joint)> =
            pool::map(joints, set.simulator.threads(), one).into_iter().flatten().collect();
        let mean = |measure: &dyn Fn(&Joint) -> f64| {
            stats::mean(&by_joint.iter().map(|(_, joint)| measure(joint)).collect::<Vec<_>>())
        };
        // Sizes are averaged, because a correlation may have another sign on each joint.
        let sizes = (0..MOTIONS.len()).map(|motion| mean(&|joint| joint.correlations[motion].abs()));
        let known = sizes.enumerate().filter_map(|(motion, size)| Some((motion, size?)));
        let (motion, size) = known.max_by(|a, b| a.1.total_cmp(&b.1))?;
        let worst = by_joint.iter().max_by(|a, b| a.1.explained.total_cmp(&b.1.explained))?;
        Some(Self {
            memory: mean(&|joint| joint.memory)?,
            explained: mean(&|joint| joint.explained)?,
            strongest: (MOTIONS[motion].to_owned(), size),
            worst_joint: (worst.0.clone(), worst.1.explained),
        })
    }
}

/// Errors of a joint in one log, and what the robot did when each prediction began.
struct Series {
    errors: Vec<f64>,
    motions: Vec<[f64; MOTIONS.len()]>,
}

impl Series {
    fn new(log: &Log, walk: &Predicted, joint: usize, joints: usize, skip: usize) -> Option<Self> {
        let column = |signal| log.trajectory.column_at(signal, joint);
        let (position, velocity) = (column(Signal::Position)?, column(Signal::Velocity)?);
        let target = column(Signal::Target).or_else(|| column(Signal::Action))?;
        let command = log.trajectory.command.as_deref().unwrap_or_default();
        // Behind a fall nothing is predicted.
        let end =
            velocity.len().min(walk.velocity.len() / joints.max(1)).min(walk.fell_at.unwrap_or(usize::MAX));
        let mut series = Self { errors: Vec::new(), motions: Vec::new() };
        // The change of a target needs two samples before.
        // The motion is taken from the sample before, so that the error does not explain itself.
        for at in skip.max(2)..end {
            let (last, before) = (at - 1, at - 2);
            let part = |part: usize| command.get(3 * last + part).copied().unwrap_or(0.0);
            series.errors.push(f64::from(walk.velocity[at * joints + joint]) - velocity[at]);
            series.motions.push([
                velocity[last],
                // A smooth sign: near rest the measured direction is noise.
                (velocity[last] / SLOW).tanh(),
                velocity[last] - velocity[before],
                // The torque of a position controller but for its gains.
                target[last] - position[last],
                target[last] - target[before],
                part(0),
                part(1),
                part(2),
            ]);
        }
        // One broken number would make all correlations of the joint unknown.
        let finite = |numbers: &[f64]| numbers.iter().all(|number| number.is_finite());
        let whole = finite(&series.errors) && series.motions.iter().all(|motion| finite(motion));
        whole.then_some(series)
    }
}

/// Properties of the errors of one joint.
struct Joint {
    memory: f64,
    explained: f64,
    correlations: [f64; MOTIONS.len()],
}

impl Joint {
    fn new(series: &[Series]) -> Option<Self> {
        let mut sizes: Vec<f64> =
            series.iter().flat_map(|one| &one.errors).map(|error| error.abs()).collect();
        if sizes.len() < MIN_SAMPLES {
            return None;
        }
        sizes.sort_by(f64::total_cmp);
        // The median is not moved by the few large errors of touchdowns; a standard deviation would be.
        let limit = LIMIT * sizes[sizes.len() / 2] / MEDIAN;
        let limited = |error: &f64| error.clamp(-limit, limit);
        let errors: Vec<f64> = series.iter().flat_map(|one| &one.errors).map(limited).collect();
        let mean = stats::mean(&errors)?;
        let variance = stats::squares(&errors);
        if variance <= 0.0 {
            return None;
        }
        // Pairs of neighbours within one log; logs are not continued by one another.
        let pairs = series.iter().flat_map(|one| one.errors.windows(2));
        let memory =
            pairs.map(|pair| (limited(&pair[0]) - mean) * (limited(&pair[1]) - mean)).sum::<f64>() / variance;
        let motions: Vec<[f64; MOTIONS.len()]> =
            series.iter().flat_map(|one| one.motions.iter().copied()).collect();
        let count = errors.len();
        // Columns of mean 0 and length 1; those that never change are left out.
        let columns: Vec<Option<DVector<f64>>> = (0..MOTIONS.len())
            .map(|motion| {
                let column = DVector::from_iterator(count, motions.iter().map(|one| one[motion]));
                let column = column.add_scalar(-column.mean());
                let length = column.norm();
                // A column that never changes has a length of rounding errors, which is not exactly 0.
                (length > 1e-9 * (count as f64).sqrt()).then(|| column / length)
            })
            .collect();
        // Scaled to length 1, as the columns are: scalar products are then correlations.
        let wanted = DVector::from_vec(errors).add_scalar(-mean) / variance.sqrt();
        let correlations =
            std::array::from_fn(|motion| columns[motion].as_ref().map_or(0.0, |column| column.dot(&wanted)));
        // All motions together, because they are correlated with one another.
        let kept: Vec<&DVector<f64>> = columns.iter().flatten().collect();
        let explained = explained(&kept, &wanted);
        Some(Self { memory, explained, correlations })
    }
}

/// The part of the variance of `wanted` (length 1) that a regression on `columns` explains, less what as many columns
/// of noise would (the adjusted R² of Theil 1961).
fn explained(columns: &[&DVector<f64>], wanted: &DVector<f64>) -> f64 {
    let entries = columns.len();
    if entries == 0 || wanted.len() <= entries + 1 {
        return 0.0;
    }
    // 1e-9 keeps the equations solvable if columns follow from each other.
    let matrix = DMatrix::from_fn(entries, entries, |i, j| {
        columns[i].dot(columns[j]) + if i == j { 1e-9 } else { 0.0 }
    });
    let right = DVector::from_iterator(entries, columns.iter().map(|column| column.dot(wanted)));
    let Some(cholesky) = matrix.cholesky() else { return 0.0 };
    // The part lies between 0 and 1 but for rounding and for the 1e-9 above.
    let share = cholesky.solve(&right).dot(&right).clamp(0.0, 1.0);
    let count = wanted.len() as f64;
    // The adjusted R² of pure noise is 0 on average, so it is often negative.
    (1.0 - (1.0 - share) * (count - 1.0) / (count - entries as f64 - 1.0)).max(0.0)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_random::{Purpose, Stream};

    /// Errors that are noise plus `along` times the velocity plus `memory` times the error before.
    fn series(along: f64, memory: f64) -> Vec<Series> {
        let stream = Stream::new(3, Purpose(77));
        let one = |log: u32| {
            let draw = |row: u32, place: u32| stream.environment(log).step(row).normal(place);
            let mut one = Series { errors: Vec::new(), motions: Vec::new() };
            for row in 0..400 {
                let motion: [f64; MOTIONS.len()] = std::array::from_fn(|place| draw(row, 1 + place as u32));
                let last = one.errors.last().copied().unwrap_or(0.0);
                one.errors.push(draw(row, 0) + along * motion[0] + memory * last);
                one.motions.push(motion);
            }
            one
        };
        (0..4).map(one).collect()
    }

    #[test]
    fn noise_goes_with_nothing() {
        let joint = Joint::new(&series(0.0, 0.0)).unwrap();
        assert!(joint.explained < 0.01 && joint.memory.abs() < 0.06, "{} {}", joint.explained, joint.memory);
    }

    #[test]
    fn what_goes_with_the_velocity_or_the_error_before_is_seen() {
        // The error is noise of variance 1 plus half of the velocity, so the velocity explains a fifth of the variance.
        let joint = Joint::new(&series(0.5, 0.0)).unwrap();
        assert!((joint.explained - 0.2).abs() < 0.04, "{}", joint.explained);
        assert!((joint.correlations[0] - 0.2f64.sqrt()).abs() < 0.05 && joint.correlations[1].abs() < 0.06);
        let joint = Joint::new(&series(0.0, 0.6)).unwrap();
        assert!((joint.memory - 0.6).abs() < 0.07, "{}", joint.memory);
    }

    #[test]
    fn few_samples_say_nothing() {
        let few = vec![Series { errors: vec![1.0; 50], motions: vec![[0.0; MOTIONS.len()]; 50] }];
        assert!(Joint::new(&few).is_none());
        let still = vec![Series { errors: vec![0.5; 200], motions: vec![[0.0; MOTIONS.len()]; 200] }];
        assert!(Joint::new(&still).is_none(), "errors that do not vary");
    }
}
