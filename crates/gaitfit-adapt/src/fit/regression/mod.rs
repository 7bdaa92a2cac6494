//! Values corrected by simulated robots, for costs that compare distributions: regression-adjusted approximate Bayesian
//! computation (Beaumont, Zhang and Balding 2002) in a few rounds, each nearer to the values.
//!
//! A search finds the values whose walks are nearest to the logs. These values have three errors: the fit's step is not the
//! robot's, the start of each log is unknown, and the search ended early. So robots are simulated as the real one makes
//! logs, with values drawn around the result of the search. Their values are known. A regression learns them from the
//! distributions of their logs. Then it predicts the values of the robot that made the real logs.
//!
//! Robots are left out one by one, and the regression predicts their values. Its errors for them are its errors for the
//! real robot too, if the real robot is like them. But it is not. So each signal of each leg also predicts the values alone.
//! If these predictions disagree by more than their errors, the simulator lacks something, and the intervals contain their
//! scatter. Last, robots are simulated with the regression's values. If the real logs are unlike theirs, the intervals are
//! wider in proportion.

mod distributions;
mod likeness;
mod posterior;
mod ridge;
mod rounds;

pub use distributions::Distributions;
pub use likeness::Likeness;
use likeness::further;
pub use rounds::Drawn;
use rounds::{MAX_ROUNDS, NoEstimate, Rounds};

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
/// Number of robots that are simulated with the regression's values, to see whether the real logs are like theirs. As many have
/// the search's values.
const WITH_VALUES: usize = 24;
/// The search's values are far off if the real logs are more than this many times as far from robots with these values as from
/// robots with the regression's values. Then the difference of the values does not show the regression's errors.
const FAR: f64 = 3.0;
/// Max entries of a θ for a regression.
pub const MAX_REGRESSED: usize = 50;
/// Max entries of a θ for which a fit always takes the regression's values. With more entries it takes them only if they cost
/// less than the search's values. On robots in MuJoCo the regression halved the errors of six entries; with thirty entries
/// both had similar errors.
pub const MAX_TAKEN: usize = 12;
/// Min number of robots of a round for each entry and each set of logs (`optimizer.replicates`).
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
    /// Standard deviation of their errors.
    pub deviation: Vec<f64>,
    /// 95 % interval of each entry, not limited to its bounds.
    pub interval: Vec<[f64; 2]>,
    /// Robots that were simulated.
    pub robots: usize,
    /// The rounds.
    pub rounds: Vec<Drawn>,
    /// Whether robots with the corrected values have such logs; `None` if too few of them walk, or if their logs are all equal.
    /// If the real logs are unlike theirs, `deviation` and `interval` are larger by [`Likeness::ratio`].
    #[serde(default)]
    pub likeness: Option<Likeness>,
    /// The same for robots with the corrected values and robots with the search's values together. The difference between the two
    /// stands for the errors of the values. So if the logs are unlike all of these robots, the model lacks an effect. If `further`
    /// exceeds 3, the search's values are far off, and this is `likeness`.
    #[serde(default)]
    pub likeness_of_both: Option<Likeness>,
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
        let at_entry = |numbers: &[f64]| numbers.get(entry).copied();
        let (error, disagreement) = (at_entry(&last.errors), at_entry(&last.disagreement));
        let whole = at_entry(&last.deviation).zip(error).is_some_and(|(whole, error)| whole > UNLIKE * error);
        whole && disagreement.is_some_and(|apart| apart > 0.0)
    }

    /// Max number of robots that are simulated, with `each` a round.
    pub fn robots(each: usize) -> usize {
        MAX_ROUNDS * each + 2 * WITH_VALUES
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
    /// Which of them belong together ([`Distributions::groups`]).
    pub groups: Vec<Range<usize>>,
    /// Threads that learn from the groups. The estimates do not depend on their number.
    pub threads: usize,
}

/// Estimates the values of the robot that made `logs` from `each` simulated robots a round. `found`: the result of the search
/// over `theta`. `Ok(Err)`: why there is no estimate, in a sentence.
///
/// # Errors
/// [`FitError::Cancelled`].
pub fn regress(
    theta: &Theta,
    found: &[f64],
    logs: &Logs,
    world: &dyn Walks,
    each: usize,
    seed: u64,
    cancel: &Cancel<'_>,
) -> Result<Result<Regression, String>, FitError> {
    let rounds = Rounds { theta, logs, world, each, seed, cancel };
    match estimate(&rounds, found) {
        Ok(regression) => Ok(Ok(regression)),
        Err(NoEstimate::Because(reason)) => Ok(Err(reason)),
        Err(NoEstimate::Cancelled) => Err(FitError::Cancelled),
    }
}

/// The estimate around `found`, the search's values.
fn estimate(source: &Rounds<'_>, found: &[f64]) -> Result<Regression, NoEstimate> {
    let entries = source.theta.entries();
    if entries.len() > MAX_REGRESSED {
        return Err(NoEstimate::Because(format!(
            "{} parameters are fitted, and robots are drawn for at most {MAX_REGRESSED}.",
            entries.len()
        )));
    }
    let rounds = source.run(found)?;
    let last = rounds.last().ok_or_else(|| NoEstimate::Because("No robot was simulated.".to_owned()))?;
    let within = entries.iter().zip(&last.values);
    let corrected: Vec<f64> = within.map(|(entry, value)| value.clamp(entry.lower, entry.upper)).collect();
    let drawn = source.each * rounds.len();
    let both = [vec![corrected.clone(); WITH_VALUES], vec![found.to_vec(); WITH_VALUES]].concat();
    let walked = source.walk(&both, drawn)?;
    let (of_corrected, of_found) = walked.split_at(WITH_VALUES.min(walked.len()));
    let standing = |robots: &[Option<Vec<f64>>]| robots.iter().flatten().cloned().collect::<Vec<_>>();
    let (of_corrected, of_found) = (standing(of_corrected), standing(of_found));
    let likeness = Likeness::new(&source.logs.numbers, &of_corrected);
    let further = further(&source.logs.numbers, &of_found, &of_corrected);
    let likeness_of_both = if further.is_some_and(|ratio| ratio > FAR) {
        likeness
    } else {
        Likeness::new(&source.logs.numbers, &[of_corrected, of_found].concat())
    };
    let wider = likeness.map_or(1.0, |likeness| likeness.ratio());
    let deviation: Vec<f64> = last.deviation.iter().map(|one| wider * one).collect();
    let interval = intervals(entries, last, &deviation);
    Ok(Regression {
        uncorrected: found.to_vec(),
        corrected,
        taken: true,
        deviation,
        interval,
        robots: drawn + 2 * WITH_VALUES,
        rounds,
        likeness,
        likeness_of_both,
        further,
    })
}

/// 95 % intervals about the values of the round `last`, whose errors have the standard deviations `deviation`.
fn intervals(entries: &[Entry], last: &Drawn, deviation: &[f64]) -> Vec<[f64; 2]> {
    let quantile = stats::student_t_95(last.walked.saturating_sub(1));
    let each = entries.iter().zip(&last.values).zip(deviation);
    each.map(|((entry, value), one)| {
        to_bounds([value - quantile * one, value + quantile * one], entry, NEAR * one)
    })
    .collect()
}

/// An interval whose ends are moved to the bounds of `entry` where they are less than `near` from them.
fn to_bounds([lower, upper]: [f64; 2], entry: &Entry, near: f64) -> [f64; 2] {
    [
        if lower - entry.lower < near { lower.min(entry.lower) } else { lower },
        if entry.upper - upper < near { upper.max(entry.upper) } else { upper },
    ]
}
