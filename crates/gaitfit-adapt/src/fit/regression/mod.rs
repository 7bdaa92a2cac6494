//! Values corrected by simulated robots, for costs that compare distributions: regression-adjusted approximate Bayesian
//! computation (Beaumont, Zhang and Balding 2002) in a few rounds, each nearer to the values.
//!
//! A search finds the values whose walks are nearest to the logs. These values have three errors: the fit's step is not the
//! robot's, the start of each log is unknown, and the search ended early. So robots are simulated as the real one makes
//! logs, with values drawn around the result of the search. Their values are known. A regression learns them from the
//! distributions of their logs. Then it predicts the values of the robot that made the real logs.
//!
//! There are two predictions. The first uses all numbers of the logs together. It is the best if the real robot is like the
//! simulated ones. But an effect that the model lacks can make it very wrong. The second is the mean of what each signal of
//! each leg predicts alone. Such an effect changes it less. The values are the mean of both.
//!
//! Robots are left out one by one, and the regression predicts their values. If the real robot is like them, the regression
//! has the same errors for the real robot. If signals and legs disagree by more than their errors, the simulator lacks
//! something. The errors of the second prediction contain this scatter. The intervals contain both predictions with their
//! errors.
//!
//! At the end, more robots are simulated. They have the predicted values plus random errors of the prediction. If the real logs
//! are unlike theirs, the model lacks an effect, and the intervals are wider in proportion.

mod distributions;
mod likeness;
mod posterior;
mod ridge;
mod rounds;

pub use distributions::Distributions;
pub use likeness::Likeness;
use likeness::further;
pub use rounds::Drawn;
use rounds::{MAX_ROUNDS, NoEstimate, Posteriors, Rounds};

use super::FitError;
use crate::{Cancel, Entry, Theta};
use gaitfit_sim::stats;
use serde::{Deserialize, Serialize};
use std::ops::Range;

/// An end of an interval that is less than this many standard deviations from a bound is moved to the bound: no robots are
/// drawn beyond it, so estimates of values at the bound lie within.
const NEAR: f64 = 0.5;
/// If an entry's deviation is more than this many errors of left-out robots, its cause is the simulator.
const UNLIKE: f64 = 3.0;
/// Number of robots with the regression's values. As many robots have the search's values. They show which values the real logs
/// are nearer to.
const WITH_VALUES: usize = 24;
/// Number of robots with the regression's values plus random errors. They show whether the real logs are like theirs.
const WITH_ERRORS: usize = 48;
/// Max entries of a θ for a regression.
pub const MAX_REGRESSED: usize = 50;
/// Max entries of a θ for which a fit always takes the regression's values. With more entries it takes them only if they cost
/// less than the search's values. For robots in MuJoCo without unknown effects the regression's values are twice as near to the
/// truth. But on soft ground they gave larger errors of the policy's walks under other commands. The search's values also
/// compensate for what the fit's simulator lacks.
pub const MAX_TAKEN: usize = 12;
/// Min number of robots of a round for each entry and each set of logs (`optimizer.replicates`): seven for each
/// entry with the usual four sets.
const PER_ENTRY: f64 = 1.75;

/// The robot, simulated as it makes logs.
pub trait Walks {
    /// The numbers of the logs of robots with these values of θ ([`Distributions::simulated`]), in their order; `None` of
    /// one that falls or diverges. `first` is the number of the first one, which selects its random draws: what nobody knows
    /// of a log's start is drawn for each. `Err`: why there are none, in a sentence.
    fn walk(&self, robots: &[Vec<f64>], first: u32) -> Result<Vec<Option<Vec<f64>>>, String>;
}

/// The estimate from simulated robots.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Regression {
    /// The values that the fit found.
    pub uncorrected: Vec<f64>,
    /// The values that the real logs have by the regression, within the bounds.
    pub corrected: Vec<f64>,
    /// Whether the fit takes these values. If not, it keeps the search's values, which cost less, and takes the intervals.
    #[serde(default = "yes")]
    pub taken: bool,
    /// Standard deviation of their errors: half the width of the interval, divided by the quantile of Student's t.
    pub deviation: Vec<f64>,
    /// 95 % interval of each entry, not limited to its bounds.
    pub interval: Vec<[f64; 2]>,
    /// Robots that were simulated.
    pub robots: usize,
    /// The rounds.
    pub rounds: Vec<Drawn>,
    /// Whether the real logs are like those of robots with the corrected values plus random errors of the prediction from all
    /// numbers. `None` if too few of these robots walk, or if their logs are all equal. If the real logs are unlike theirs, the
    /// model lacks an effect, and `deviation` and `interval` are larger by [`Likeness::ratio`].
    #[serde(default)]
    pub likeness: Option<Likeness>,
    /// How much further the real logs are from robots with the search's values than from robots with the corrected values: the
    /// ratio of the mean square distances. All robots are simulated as they make logs. `None` as [`Self::likeness`].
    #[serde(default)]
    pub further: Option<f64>,
}

/// Results of earlier versions have the values of the regression.
fn yes() -> bool {
    true
}

impl Regression {
    /// Whether the real logs are nearer to robots with the corrected values than to robots with the search's values.
    pub fn is_nearer(&self) -> bool {
        self.further.is_some_and(|ratio| ratio > 1.0)
    }

    /// Whether signals and legs disagree about an entry, and most of its error comes from that.
    pub fn unlike(&self, entry: usize) -> bool {
        let Some(last) = self.rounds.last() else { return false };
        // Results of earlier versions lack some of these lists.
        let at_entry = |numbers: &[f64]| numbers.get(entry).copied();
        let (error, disagreement) = (at_entry(&last.errors), at_entry(&last.disagreement));
        let whole = at_entry(&last.deviation).zip(error).is_some_and(|(whole, error)| whole > UNLIKE * error);
        whole && disagreement.is_some_and(|apart| apart > 0.0)
    }

    /// Max number of robots that are simulated, with `each` a round.
    pub fn robots(each: usize) -> usize {
        MAX_ROUNDS * each + 2 * WITH_VALUES + WITH_ERRORS
    }

    /// Robots of a round for `entries` entries, if there are `each` for one, and `sets` sets of logs are asked for.
    pub fn each(entries: usize, each: usize, sets: usize) -> usize {
        sets * each.max((PER_ENTRY * entries as f64).ceil() as usize)
    }
}

/// The recorded logs.
#[derive(Clone, Debug)]
pub struct Logs {
    /// Numbers ([`Distributions::recorded`]).
    pub numbers: Vec<f64>,
    /// Ranges of numbers that belong together ([`Distributions::groups`]).
    pub groups: Vec<Range<usize>>,
    /// Threads that learn from the groups. The estimates do not depend on their number.
    pub threads: usize,
}

/// Estimates the values of the robot that made `logs` from `each` simulated robots a round. `values`: the result of the search
/// over `theta`. `Ok(Err)`: why there is no estimate, in a sentence.
///
/// # Errors
/// [`FitError::Cancelled`].
pub fn regress(
    theta: &Theta,
    values: &[f64],
    logs: &Logs,
    world: &dyn Walks,
    each: usize,
    seed: u64,
    cancel: &Cancel<'_>,
) -> Result<Result<Regression, String>, FitError> {
    let rounds = Rounds { theta, logs, world, each, seed, cancel };
    match estimate(&rounds, values) {
        Ok(regression) => Ok(Ok(regression)),
        Err(NoEstimate::Because(reason)) => Ok(Err(reason)),
        Err(NoEstimate::Cancelled) => Err(FitError::Cancelled),
    }
}

/// The estimate around `values`, the search's values.
fn estimate(source: &Rounds<'_>, values: &[f64]) -> Result<Regression, NoEstimate> {
    let entries = source.theta.entries();
    if entries.len() > MAX_REGRESSED {
        return Err(NoEstimate::Because(format!(
            "{} parameters are fitted, and robots are drawn for at most {MAX_REGRESSED}.",
            entries.len()
        )));
    }
    let (rounds, posteriors) = source.run(values)?;
    let Posteriors { groups, together, .. } = &posteriors;
    let middle: Vec<f64> = groups.values.iter().zip(&together.values).map(|(a, b)| 0.5 * (a + b)).collect();
    let corrected = within(entries, &middle);
    // The rounds have used the numbers below this one. A robot with a used number would have the same random draws.
    let mut simulated = source.each * rounds.len();
    // Robots that fall do not count.
    let mut walk = |robots: &[Vec<f64>]| {
        let walked = source.walk(robots, simulated)?;
        simulated += robots.len();
        Ok(walked.into_iter().flatten().collect::<Vec<_>>())
    };
    let numbers = &source.logs.numbers;
    // Robots with both sets of values walk, so that their distances from the real logs can be compared.
    let of_corrected = walk(&vec![corrected.clone(); WITH_VALUES])?;
    let of_found = walk(&vec![values.to_vec(); WITH_VALUES])?;
    // For the likeness robots need the scatter that the prediction's errors make.
    let with_errors = source.with_errors(&corrected, together, WITH_ERRORS);
    let likeness = Likeness::new(numbers, &walk(&with_errors)?);
    // Where too few robots walked there is no verdict, and the intervals keep their width.
    let wider = likeness.map_or(1.0, |likeness| likeness.ratio());
    let (interval, deviation) = intervals(entries, &posteriors, wider);
    Ok(Regression {
        uncorrected: values.to_vec(),
        corrected,
        taken: true,
        deviation,
        interval,
        robots: simulated,
        rounds,
        likeness,
        further: further(numbers, &of_found, &of_corrected),
    })
}

/// `values`, limited to the bounds of `entries`.
fn within(entries: &[Entry], values: &[f64]) -> Vec<f64> {
    entries.iter().zip(values).map(|(entry, value)| value.clamp(entry.lower, entry.upper)).collect()
}

/// 95 % intervals and their standard deviations. An interval contains both predictions with `wider` times their errors.
fn intervals(
    entries: &[Entry],
    Posteriors { groups, together, robots }: &Posteriors,
    wider: f64,
) -> (Vec<[f64; 2]>, Vec<f64>) {
    let quantile = stats::student_t_95(robots.saturating_sub(1));
    let interval = |(at, entry): (usize, &Entry)| {
        let end = |side: f64| {
            [groups, together].map(|one| one.values[at] + side * quantile * wider * one.deviations[at])
        };
        let [a, b] = end(-1.0);
        let [c, d] = end(1.0);
        let (lower, upper) = (a.min(b), c.max(d));
        // The deviation whose own interval would be as wide.
        let deviation = 0.5 * (upper - lower) / quantile;
        (to_bounds([lower, upper], entry, NEAR * deviation), deviation)
    };
    entries.iter().enumerate().map(interval).unzip()
}

/// An interval whose ends are moved to the bounds of `entry` where they are less than `near` from them.
fn to_bounds([lower, upper]: [f64; 2], entry: &Entry, near: f64) -> [f64; 2] {
    [
        // An end that lies beyond its bound already stays there, hence `min` and `max`.
        if lower - entry.lower < near { lower.min(entry.lower) } else { lower },
        if entry.upper - upper < near { upper.max(entry.upper) } else { upper },
    ]
}
