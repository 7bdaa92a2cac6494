//! Rounds of simulated robots, each drawn around the values of the round before.

use super::posterior::with_priors;
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
/// Max ratio of the standard deviations of a round to those of the round before, on the mean, after which another round follows.
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

/// One round.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Drawn {
    /// Least values drawn.
    pub lower: Vec<f64>,
    /// Largest values drawn.
    pub upper: Vec<f64>,
    /// Robots between them that walked, those of rounds before included.
    pub walked: usize,
    /// The values of the robot that made the real logs, with what was known of them before.
    pub values: Vec<f64>,
    /// Standard deviation of their errors.
    #[serde(default)]
    pub deviation: Vec<f64>,
    /// Standard deviation of the errors of robots that were left out.
    pub errors: Vec<f64>,
    /// Standard error of the values by what signals and legs say alone.
    pub scatter: Vec<f64>,
    /// Standard deviation by which these disagree besides their own errors.
    pub disagreement: Vec<f64>,
}

impl Estimate {
    /// Standard deviations of the errors of the values.
    fn deviations(&self) -> Vec<f64> {
        let both = self.errors.iter().zip(&self.scatter);
        both.map(|(error, scatter)| error.hypot(SHARED * scatter)).collect()
    }
}

/// Why a regression ends without an estimate.
pub(super) enum NoEstimate {
    /// The caller stopped it.
    Cancelled,
    /// A reason in a sentence.
    Because(String),
}

/// What the rounds are made of.
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
    /// All rounds; the first is around `found`.
    pub fn run(&self, found: &[f64]) -> Result<Vec<Drawn>, NoEstimate> {
        let entries = self.theta.entries();
        let mut centre = found.to_vec();
        let mut half: Vec<f64> = entries.iter().map(|entry| FIRST * entry.deviation).collect();
        let (mut all, mut rounds) = (Robots::default(), Vec::<Drawn>::new());
        for round in 0..MAX_ROUNDS {
            let drawn = self.draw(&mut all, around(entries, &centre, &half), round)?;
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
            if settled {
                break;
            }
        }
        Ok(rounds)
    }

    /// Draws the robots of a round between the bounds, adds them to `all`, and learns the values from all between the bounds.
    fn draw(
        &self,
        all: &mut Robots,
        (lower, upper): (Vec<f64>, Vec<f64>),
        round: usize,
    ) -> Result<Drawn, NoEstimate> {
        let because = |reason: &str| NoEstimate::Because(reason.to_owned());
        let drawn = evenly(&lower, &upper, self.each, self.seed, number(round * self.each));
        let walked = self.walk(&drawn, round * self.each)?;
        let count = walked.iter().flatten().count();
        if (count as f64) < WALKING * self.each as f64 {
            let fallen = self.each - count;
            return Err(NoEstimate::Because(format!("{fallen} of {} simulated robots fall.", self.each)));
        }
        for (values, logs) in drawn.into_iter().zip(walked) {
            let Some(logs) = logs else { continue };
            all.values.push(values);
            all.logs.push(logs);
        }
        let near = all.between(&lower, &upper);
        let found = near
            .estimate(&self.logs.numbers, &self.logs.groups, self.logs.threads)
            .ok_or_else(|| because("The logs of simulated robots are all alike, or too few."))?;
        let (values, deviation) =
            with_priors(self.theta, &found.values, &found.deviations(), &found.left_out)
                .ok_or_else(|| because("The values of simulated robots cannot be told apart."))?;
        let Estimate { errors, scatter, disagreement, .. } = found;
        Ok(Drawn { lower, upper, walked: near.len(), values, errors, scatter, disagreement, deviation })
    }

    /// The logs of `robots`, the first of which has the number `first`.
    pub fn walk(&self, robots: &[Vec<f64>], first: usize) -> Result<Vec<Option<Vec<f64>>>, NoEstimate> {
        let walked = self.world.walk(robots, number(first));
        if (self.cancel)() {
            return Err(NoEstimate::Cancelled);
        }
        walked.map_err(NoEstimate::Because)
    }
}

fn number(robot: usize) -> u32 {
    u32::try_from(robot).unwrap_or(u32::MAX)
}

/// The values within `half` of `centre` and within the bounds.
fn around(entries: &[Entry], centre: &[f64], half: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let ends = entries.iter().zip(centre).zip(half);
    ends.map(|((entry, at), half)| ((at - half).max(entry.lower), (at + half).min(entry.upper))).unzip()
}

/// Robots with values drawn evenly between `lower` and `upper`: of each value one robot lies in each of `count` equal parts.
fn evenly(lower: &[f64], upper: &[f64], count: usize, seed: u64, first: u32) -> Vec<Vec<f64>> {
    let stream = Stream::new(seed, Purpose::SIMULATED_ROBOTS).environment(first);
    let mut robots = vec![Vec::with_capacity(lower.len()); count];
    for (entry, (lower, upper)) in lower.iter().zip(upper).enumerate() {
        let draws = stream.step(number(entry));
        let mut order: Vec<(f64, usize)> = (0..count).map(|k| (draws.uniform(number(k)), k)).collect();
        order.sort_by(|a, b| a.0.total_cmp(&b.0));
        for (part, (_, robot)) in order.into_iter().enumerate() {
            let within = draws.uniform(number(count + robot));
            robots[robot].push(lower + (upper - lower) * (part as f64 + within) / count as f64);
        }
    }
    robots
}
