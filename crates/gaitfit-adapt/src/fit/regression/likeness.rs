//! Whether the real logs are like those of robots that are simulated with draws of the regression's values: a posterior
//! predictive check (Gelman, Meng and Stern 1996).

use gaitfit_sim::stats;
use serde::{Deserialize, Serialize};

/// Min number of robots. Fewer do not show how far chance moves a robot's numbers.
const MIN_ROBOTS: usize = 12;
/// Part of a normal distribution below its mean plus one standard deviation.
const ONE_DEVIATION: f64 = 0.84;
/// A number of a log with a smaller variance among robots does not count: this is rounding. The robot's range is 2.
const STEADY: f64 = 1e-14;

/// How far the numbers of the real logs are from those of simulated robots. These differ by the errors of their
/// values and by their random draws.
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub struct Likeness {
    /// Mean square distance of the real logs' numbers from the robots' mean, in units of the robots' variances. If the model
    /// lacks nothing, it is about 1.
    pub distance: f64,
    /// The median of the same distance of each robot from the others.
    pub typical: f64,
    /// Chance seldom exceeds this distance. Its logarithm is two standard deviations above the median. One standard deviation is
    /// the difference between the 84th percentile and the median, so a few robots that stumble do not change it.
    pub by_chance: f64,
    /// Robots.
    pub robots: usize,
}

impl Likeness {
    /// Compares `logs` with `robots` (`robots × numbers`). `None` if there are too few robots, or if all numbers of all robots
    /// are equal.
    pub fn new(logs: &[f64], robots: &[Vec<f64>]) -> Option<Self> {
        if robots.len() < MIN_ROBOTS || robots.iter().any(|one| one.len() != logs.len()) {
            return None;
        }
        let distance = distance(logs, &robots.iter().collect::<Vec<_>>())?;
        // Each robot is compared with the others in the way the real logs are compared with all.
        let apart = |at: usize| {
            let others = robots.iter().enumerate().filter(|(other, _)| *other != at);
            self::distance(&robots[at], &others.map(|(_, one)| one).collect::<Vec<_>>())
        };
        let mut distances: Vec<f64> = (0..robots.len()).map(apart).collect::<Option<_>>()?;
        distances.sort_by(f64::total_cmp);
        let (typical, above) =
            (distances[distances.len() / 2], distances[(ONE_DEVIATION * distances.len() as f64) as usize]);
        // The logarithm's deviation is ln(above / typical), and two of them square the ratio.
        let by_chance = typical * (above / typical).powi(2);
        (typical > 0.0).then_some(Self { distance, typical, by_chance, robots: robots.len() })
    }

    /// Whether the logs are further from the robots than chance explains.
    pub fn unlike(&self) -> bool {
        self.distance > self.by_chance
    }

    /// The factor by which errors are larger than those of simulated robots: √(distance / typical), the ratio of Birge (1932),
    /// if the logs are unlike the robots'; else 1.
    pub fn ratio(&self) -> f64 {
        if self.unlike() { (self.distance / self.typical).sqrt().max(1.0) } else { 1.0 }
    }
}

/// How much further `logs` are from the robots `others` than from `robots`: the ratio of the mean square distances from their
/// means. Each number counts in units of the mean variance of both. `None` as in [`Likeness::new`].
pub fn further(logs: &[f64], others: &[Vec<f64>], robots: &[Vec<f64>]) -> Option<f64> {
    let both = || others.iter().chain(robots);
    if others.len() < MIN_ROBOTS || robots.len() < MIN_ROBOTS || both().any(|one| one.len() != logs.len()) {
        return None;
    }
    let (mut to_others, mut to_robots) = (0.0, 0.0);
    for (at, log) in logs.iter().enumerate() {
        let column = |robots: &[Vec<f64>]| robots.iter().map(|one| one[at]).collect::<Vec<f64>>();
        let (others, robots) = (column(others), column(robots));
        let variance = 0.5 * (stats::deviation(&others)?.powi(2) + stats::deviation(&robots)?.powi(2));
        if variance > STEADY {
            to_others += (log - stats::mean(&others)?).powi(2) / variance;
            to_robots += (log - stats::mean(&robots)?).powi(2) / variance;
        }
    }
    (to_others > 0.0 && to_robots > 0.0).then(|| to_others / to_robots)
}

/// Mean square distance of `logs` from the mean of `robots`, in units of the variance of one more robot about this mean. `None`
/// if no number differs among the robots.
fn distance(logs: &[f64], robots: &[&Vec<f64>]) -> Option<f64> {
    let count = robots.len() as f64;
    let of_number = |at: usize| {
        let mean = robots.iter().map(|one| one[at]).sum::<f64>() / count;
        let variance = robots.iter().map(|one| (one[at] - mean).powi(2)).sum::<f64>() / (count - 1.0);
        // The mean of the robots is uncertain too, by 1/count of the variance.
        (variance > STEADY).then(|| (logs[at] - mean).powi(2) / (variance * (1.0 + 1.0 / count)))
    };
    let distances: Vec<f64> = (0..logs.len()).filter_map(of_number).collect();
    stats::mean(&distances)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_random::{Purpose, Stream};

    /// Robots whose 200 numbers have standard deviations of 1 to 3 and means of `shift` standard deviations.
    fn robots(count: u32, shift: f64) -> Vec<Vec<f64>> {
        let robot = |number: u32| {
            let draws = Stream::new(3, Purpose::SIMULATED_ROBOTS).environment(number).step(0);
            (0..200).map(|at| (1.0 + f64::from(at % 3)) * (draws.normal(at) + shift)).collect()
        };
        (0..count).map(robot).collect()
    }

    #[test]
    fn a_robot_like_the_others_is_at_a_distance_of_1_and_another_is_not() {
        let others = robots(24, 0.0);
        let like = Likeness::new(&robots(25, 0.0)[24], &others).unwrap();
        assert!((like.distance - 1.0).abs() < 0.3 && (like.typical - 1.0).abs() < 0.3, "{like:?}");
        assert_eq!((like.unlike(), like.ratio()), (false, 1.0));
        let unlike = Likeness::new(&robots(25, 2.0)[24], &others).unwrap();
        // Its mean square distance is 1 + 2².
        assert!(unlike.unlike() && (unlike.ratio() - 5f64.sqrt()).abs() < 0.3, "{unlike:?}");
    }

    #[test]
    fn logs_are_further_from_robots_with_other_values() {
        let logs = &robots(25, 0.0)[24];
        let (same, others) = (robots(24, 0.0), robots(24, 2.0));
        let ratio = further(logs, &others, &same).unwrap();
        // Mean square distances of 1 + 2² and 1.
        assert!((ratio - 5.0).abs() < 1.5, "{ratio}");
        assert!(
            (further(logs, &same, &others).unwrap() * ratio - 1.0).abs() < 1e-9,
            "the same the other way round"
        );
        assert_eq!(further(logs, &others[..11], &same), None, "few robots");
        assert_eq!(further(&logs[1..], &others, &same), None, "numbers of another log");
    }

    #[test]
    fn few_robots_and_robots_that_are_all_alike_say_nothing() {
        assert_eq!(Likeness::new(&[0.0; 200], &robots(11, 0.0)), None);
        assert_eq!(Likeness::new(&[0.5], &vec![vec![1.0]; 24]), None);
        assert_eq!(Likeness::new(&[0.5, 1.0], &vec![vec![1.0]; 24]), None, "numbers of another log");
    }
}
