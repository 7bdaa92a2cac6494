//! Rounds of simulated robots, each drawn around the values of the round before.

use super::posterior::{Posterior, with_priors};
use super::ridge::{Estimate, Robots};
use super::{Logs, Walks};
use crate::{Cancel, Entry, Theta};
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::stats;
use serde::{Deserialize, Serialize};

/// Max number of rounds; each draws robots around the values of the round before.
pub(super) const MAX_ROUNDS: usize = 6;
/// Min number of rounds.
const MIN_ROUNDS: usize = 3;
/// Largest ratio of a round's mean standard deviation to the last round's that is still a gain. Rounds end at the first one above it.
const SETTLED: f64 = 0.95;
/// Half the width of the first round, in an entry's deviations.
const FIRST: f64 = 1.5;
/// Half the width of later ones, in errors of the round before.
const WIDTH: f64 = 3.0;
/// Least half width of a round, part of an entry's range: below, what single precision does to a walk is all that is seen.
const MIN_WIDTH: f64 = 2e-3;
/// Least share of the robots of a round that must walk.
const WALKING: f64 = 0.5;
/// How much more than the standard error of a mean of independent groups their scatter counts: what the simulator lacks is
/// the same for many of them. 2 makes three independent ones of twelve. Chosen with the fits of the first seed of `wass-5ms`
/// in docs/results.
const SHARED: f64 = 2.0;
/// Ratio of two errors of the prediction from all numbers together: for a real robot, and for robots that were left out. In 15
/// fits of robots in MuJoCo without unknown effects it was 0.9 to 1.3 for eight kinds of parameters, and 1.9 for the delay.
const LARGER: f64 = 1.3;

/// Selects the random draws of [`Rounds::with_errors`]. No round has so many robots.
const ERRORS: u32 = 1_000_000;

/// One round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Drawn {
    /// Lower ends of the region from which the first round is drawn. Later rounds draw a few robots beyond it.
    pub lower: Vec<f64>,
    /// Its upper ends.
    pub upper: Vec<f64>,
    /// Robots of this round that walked, and those of earlier rounds within the region.
    pub walked: usize,
    /// The values of the robot that made the real logs, with what was known of them before.
    pub values: Vec<f64>,
    /// Standard deviation of their errors.
    #[serde(default)]
    pub deviation: Vec<f64>,
    /// The same values, predicted from all numbers of the logs together.
    #[serde(default)]
    pub together: Vec<f64>,
    /// Standard deviation of the errors of `together`.
    #[serde(default)]
    pub together_deviation: Vec<f64>,
    /// Standard deviation of the errors for robots that were left out, predicted from all numbers together.
    pub errors: Vec<f64>,
    /// Standard error of the values by what signals and legs say alone.
    pub scatter: Vec<f64>,
    /// Standard deviation by which these disagree besides their own errors.
    pub disagreement: Vec<f64>,
}

impl Estimate {
    /// Standard deviations of the errors of `values`.
    fn deviations(&self) -> Vec<f64> {
        let both = self.errors.iter().zip(&self.scatter);
        both.map(|(error, scatter)| error.hypot(SHARED * scatter)).collect()
    }

    /// Standard deviations of the errors of `together`.
    fn deviations_together(&self) -> Vec<f64> {
        self.errors.iter().map(|error| LARGER * error).collect()
    }
}

/// Why a regression ends without an estimate.
pub(super) enum NoEstimate {
    /// The caller stopped it.
    Cancelled,
    /// A reason in a sentence.
    Because(String),
}

/// The two predictions of a round.
pub(super) struct Posteriors {
    /// The mean of what groups of numbers predict.
    pub groups: Posterior,
    /// The prediction from all numbers together.
    pub together: Posterior,
    /// Robots from which both were learnt.
    pub robots: usize,
}

/// Inputs of the rounds.
pub(super) struct Rounds<'a> {
    /// The parameters.
    pub theta: &'a Theta,
    /// The real logs.
    pub logs: &'a Logs,
    /// Simulates robots.
    pub world: &'a dyn Walks,
    /// Robots of a round.
    pub each: usize,
    /// Selects the random draws.
    pub seed: u64,
    /// Whether the caller stops it.
    pub cancel: &'a Cancel<'a>,
}

impl Rounds<'_> {
    /// All rounds, and the predictions of the last one. The first round is around `values`.
    pub fn run(&self, values: &[f64]) -> Result<(Vec<Drawn>, Posteriors), NoEstimate> {
        let entries = self.theta.entries();
        let mut centre = values.to_vec();
        let mut half: Vec<f64> = entries.iter().map(|entry| FIRST * entry.deviation).collect();
        let (mut walked, mut rounds, mut latest) =
            (Robots::default(), Vec::<Drawn>::new(), None::<Posteriors>);
        for round in 0..MAX_ROUNDS {
            let bounds = around(entries, &centre, &half);
            // Before the first round no errors are known whose correlations robots could have.
            let robots = match &latest {
                None => self.evenly(&bounds, round),
                Some(latest) => self.correlated(&latest.groups, &centre, &half, round),
            };
            let (drawn, posteriors) = self.learn(&mut walked, robots, bounds, round)?;
            for (at, entry) in entries.iter().enumerate() {
                // Beyond what was drawn the regression is a guess: the next round looks there.
                let beyond = 0.5 * (drawn.upper[at] - drawn.lower[at]);
                let value = drawn.values[at].clamp(drawn.lower[at] - beyond, drawn.upper[at] + beyond);
                centre[at] = value.clamp(entry.lower, entry.upper);
                half[at] = (WIDTH * drawn.deviation[at]).max(MIN_WIDTH * (entry.upper - entry.lower));
            }
            let shrunk = |before: &Drawn| {
                let parts = drawn.deviation.iter().zip(&before.deviation).map(|(now, before)| now / before);
                stats::mean(&parts.collect::<Vec<_>>()).unwrap_or(1.0)
            };
            let settled =
                round + 1 >= MIN_ROUNDS && rounds.last().is_some_and(|before| shrunk(before) > SETTLED);
            rounds.push(drawn);
            latest = Some(posteriors);
            if settled {
                break;
            }
        }
        let latest = latest.ok_or_else(|| NoEstimate::Because("No robot was simulated.".to_owned()))?;
        Ok((rounds, latest))
    }

    /// Robots between the bounds. Each parameter is independent of the others.
    fn evenly(&self, (lower, upper): &(Vec<f64>, Vec<f64>), round: usize) -> Vec<Vec<f64>> {
        evenly(lower, upper, self.each, self.seed, number(round * self.each))
    }

    /// Robots around `centre`. Their values are correlated as the errors of `latest` are, and each differs by about `half`. The
    /// errors of a search and of a regression are correlated: for example, a lighter robot with weaker motors walks alike. If
    /// all values were independent, few robots would be like the real one, and a ridge regression would predict values near
    /// the centre.
    fn correlated(&self, latest: &Posterior, centre: &[f64], half: &[f64], round: usize) -> Vec<Vec<f64>> {
        let entries = self.theta.entries();
        // The draws lie between −1 and 1; `half` gives them their size.
        let sides = (vec![-1.0; entries.len()], vec![1.0; entries.len()]);
        let value = |at: usize, by: f64| {
            let Entry { lower, upper, .. } = entries[at];
            let value = centre[at] + half[at] * by;
            // A value beyond a bound is reflected at the bound.
            let value = if value < lower { 2.0 * lower - value } else { value };
            let value = if value > upper { 2.0 * upper - value } else { value };
            value.clamp(lower, upper)
        };
        let robot = |independent: Vec<f64>| {
            latest.correlated(&independent).into_iter().enumerate().map(|(at, by)| value(at, by)).collect()
        };
        self.evenly(&sides, round).into_iter().map(robot).collect()
    }

    /// `count` robots with `values` plus errors that are drawn from `posterior`, within the bounds.
    pub fn with_errors(&self, values: &[f64], posterior: &Posterior, count: usize) -> Vec<Vec<f64>> {
        let stream = Stream::new(self.seed, Purpose::SIMULATED_ROBOTS).environment(ERRORS);
        let entries = self.theta.entries();
        let robot = |at: usize| {
            let draws = stream.step(number(at));
            let independent: Vec<f64> = (0..entries.len()).map(|k| draws.normal(number(k))).collect();
            let errors = posterior.correlated(&independent).into_iter().zip(&posterior.deviations);
            let values = values.iter().zip(errors).map(|(value, (error, size))| value + size * error);
            super::within(entries, &values.collect::<Vec<_>>())
        };
        (0..count).map(robot).collect()
    }

    /// Simulates the robots `drawn` of a round and adds them to `robots`. Learns the values from them and from the earlier
    /// robots between the bounds.
    fn learn(
        &self,
        robots: &mut Robots,
        drawn: Vec<Vec<f64>>,
        (lower, upper): (Vec<f64>, Vec<f64>),
        round: usize,
    ) -> Result<(Drawn, Posteriors), NoEstimate> {
        let because = |reason: &str| NoEstimate::Because(reason.to_owned());
        // Each robot of all rounds has a number, and with it random draws of its own.
        let walked = self.walk(&drawn, round * self.each)?;
        let count = walked.iter().flatten().count();
        if (count as f64) < WALKING * self.each as f64 {
            let fallen = self.each - count;
            return Err(NoEstimate::Because(format!("{fallen} of {} simulated robots fall.", self.each)));
        }
        // Robots of earlier rounds help too, as far as they lie in this round's region.
        let mut near = robots.between(&lower, &upper);
        for (values, logs) in drawn.into_iter().zip(walked) {
            // A robot that fell has no distributions to learn from.
            let Some(logs) = logs else { continue };
            for robots in [&mut *robots, &mut near] {
                robots.values.push(values.clone());
                robots.logs.push(logs.clone());
            }
        }
        let estimate = near
            .estimate(&self.logs.numbers, &self.logs.groups, self.logs.threads)
            .ok_or_else(|| because("The logs of simulated robots are all alike, or too few."))?;
        let with_priors = |values: &[f64], deviations: &[f64]| {
            with_priors(self.theta, values, deviations, &estimate.left_out)
                .ok_or_else(|| because("The values of simulated robots cannot be told apart."))
        };
        let groups = with_priors(&estimate.values, &estimate.deviations())?;
        let together = with_priors(&estimate.together, &estimate.deviations_together())?;
        let drawn = Drawn {
            lower,
            upper,
            walked: near.len(),
            values: groups.values.clone(),
            deviation: groups.deviations.clone(),
            together: together.values.clone(),
            together_deviation: together.deviations.clone(),
            errors: estimate.errors,
            scatter: estimate.scatter,
            disagreement: estimate.disagreement,
        };
        Ok((drawn, Posteriors { groups, together, robots: near.len() }))
    }

    /// The logs of `robots`, the first of which has the number `first`.
    pub fn walk(&self, robots: &[Vec<f64>], first: usize) -> Result<Vec<Option<Vec<f64>>>, NoEstimate> {
        let walked = self.world.walk(robots, number(first));
        // A walk that was cancelled may also return an error; being cancelled comes first.
        if (self.cancel)() {
            return Err(NoEstimate::Cancelled);
        }
        walked.map_err(NoEstimate::Because)
    }
}

fn number(robot: usize) -> u32 {
    // It only addresses random draws, and no fit simulates so many robots.
    u32::try_from(robot).unwrap_or(u32::MAX)
}

/// The values within `half` of `centre` and within the bounds.
fn around(entries: &[Entry], centre: &[f64], half: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let ends = entries.iter().zip(centre).zip(half);
    ends.map(|((entry, at), half)| ((at - half).max(entry.lower), (at + half).min(entry.upper))).unzip()
}

/// Robots with values drawn evenly between `lower` and `upper`: of each value one robot lies in each of `count`
/// equal parts (Latin hypercube, McKay, Beckman and Conover 1979).
fn evenly(lower: &[f64], upper: &[f64], count: usize, seed: u64, first: u32) -> Vec<Vec<f64>> {
    let stream = Stream::new(seed, Purpose::SIMULATED_ROBOTS).environment(first);
    let mut robots = vec![Vec::with_capacity(lower.len()); count];
    for (entry, (lower, upper)) in lower.iter().zip(upper).enumerate() {
        let draws = stream.step(number(entry));
        // A random order decides which robot lies in which part.
        let mut order: Vec<(f64, usize)> = (0..count).map(|k| (draws.uniform(number(k)), k)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (part, (_, robot)) in order.into_iter().enumerate() {
            // The numbers from `count` on are not those that ordered the robots.
            let within = draws.uniform(number(count + robot));
            robots[robot].push(lower + (upper - lower) * (part as f64 + within) / count as f64);
        }
    }
    robots
}
