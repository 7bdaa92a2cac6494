//! Corrections by simulated robots, on a toy whose logs are twelve numbers with noise, in four groups.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_adapt::fit::{FitError, Logs, Regression, Walks, regress};
use gaitfit_adapt::{JointParameter, ParameterRule, Sharing, Theta, never};
use gaitfit_random::{Purpose, Stream};

const TRUTH: [f64; 2] = [0.13, 0.042];
/// What a search found.
const FOUND: [f64; 2] = [0.24, 0.06];
const EACH: usize = 60;

fn theta() -> Theta {
    let rule = |kind| ParameterRule { per: Sharing::All, ..ParameterRule::new(kind) };
    let rules = [rule(JointParameter::FrictionLoss), rule(JointParameter::Armature)];
    Theta::from_rules(&rules, &[], &["FL_hip".to_owned()]).unwrap()
}

/// The numbers of a robot's logs.
struct Toy {
    seed: u64,
    /// Robots with more friction fall.
    stands: f64,
    /// Whether friction has an effect.
    seen: bool,
}

impl Default for Toy {
    fn default() -> Self {
        Self { seed: 1, stands: 1.0, seen: true }
    }
}

impl Toy {
    /// Logs of `values`; each has noise of its own `number`.
    fn logs(&self, values: &[f64], number: u32) -> Vec<f64> {
        let noise = Stream::new(self.seed, Purpose::OBSERVATION_NOISE).environment(number);
        let (a, b) = (if self.seen { values[0] } else { 0.0 }, values[1]);
        let clean = [
            [a + 3.0 * b, (6.0 * a).sin(), 8.0 * b],
            [a * b * 20.0, (20.0 * b).exp() / 4.0, b - a],
            [3.0 * b + a, a * a, 5.0 * b],
            [a - 2.0 * b, 10.0 * b * b, a + b],
        ];
        let clean = clean.into_iter().flatten().enumerate();
        clean.map(|(k, one)| one + 0.01 * noise.normal(k as u32)).collect()
    }
}

impl Walks for Toy {
    fn walk(&self, robots: &[Vec<f64>], first: u32) -> Result<Vec<Option<Vec<f64>>>, String> {
        let one = |(k, values): (usize, &Vec<f64>)| {
            (values[0] <= self.stands).then(|| self.logs(values, first + k as u32))
        };
        Ok(robots.iter().enumerate().map(one).collect())
    }
}

/// The logs of the real robot.
fn real(toy: &Toy) -> Logs {
    let groups = (0..4).map(|group| 3 * group..3 * group + 3).collect();
    Logs { numbers: toy.logs(&TRUTH, u32::MAX), groups, threads: 2 }
}

fn regressed(toy: &Toy, logs: &Logs) -> Regression {
    regress(&theta(), &FOUND, logs, toy, EACH, toy.seed, &never).unwrap().unwrap()
}

#[test]
fn values_far_off_are_corrected_and_their_intervals_cover() {
    let (mut inside, mut all, mut unexplained) = (0, 0, 0);
    for seed in 0..40 {
        let toy = Toy { seed, ..Toy::default() };
        let regression = regressed(&toy, &real(&toy));
        for (at, truth) in TRUTH.iter().enumerate() {
            let [low, high] = regression.interval[at];
            inside += usize::from(low <= *truth && *truth <= high);
            all += 1;
            // A tenth of what the search was off by, or a little more.
            let off = (regression.corrected[at] - truth).abs();
            assert!(off < 0.4 * (FOUND[at] - truth).abs(), "{regression:?}");
            assert!(high - low < (FOUND[at] - truth).abs(), "{regression:?}");
        }
        unexplained += usize::from(regression.likeness.unwrap().unlike());
        assert_eq!(regression.uncorrected, FOUND);
        assert!(
            (3..=6).contains(&(regression.robots / EACH))
                && regression.robots == regression.rounds.len() * EACH + 96
        );
        assert!(
            regression.is_nearer(),
            "robots with the search's values are further from the logs: {:?}",
            regression.further
        );
    }
    // 76 of 80 are due.
    assert!(inside >= 70, "{inside} of {all}");
    // The real robot is one of 25 alike.
    assert!(unexplained <= 4, "{unexplained} of 40 robots count as unlike the simulated ones");
}

#[test]
fn a_value_without_an_effect_may_be_anything() {
    let toy = Toy { seen: false, ..Toy::default() };
    let regression = regressed(&toy, &real(&toy));
    let ([low, high], [least, most]) = (regression.interval[0], regression.interval[1]);
    assert!(high - low > 0.4, "{regression:?}");
    assert!(most - least < 0.02, "{regression:?}");
}

#[test]
fn logs_unlike_those_of_any_robot_widen_the_intervals() {
    let toy = Toy::default();
    let like = regressed(&toy, &real(&toy));
    let mut logs = real(&toy);
    // The last group says 0.1 N·m more.
    logs.numbers[9] += 0.1;
    logs.numbers[11] += 0.1;
    let unlike = regressed(&toy, &logs);
    assert!(!like.unlike(0) && unlike.unlike(0), "{like:?} {unlike:?}");
    assert!(unlike.deviation[0] > 2.0 * like.deviation[0]);
    // Robots with such values do not make such logs, so the intervals are wider.
    let (near, far) = (like.likeness.unwrap(), unlike.likeness.unwrap());
    assert!(!near.unlike() && far.unlike() && far.ratio() > 1.5, "{near:?} {far:?}");
    let last = unlike.rounds.last().unwrap();
    assert!(unlike.deviation[0] > 0.999 * far.ratio() * last.deviation[0].max(last.together_deviation[0]));
    let [low, high] = unlike.interval[0];
    assert!(low <= TRUTH[0] && TRUTH[0] <= high, "{unlike:?}");
}

#[test]
fn a_small_error_of_the_values_is_no_missing_effect() {
    let toy = Toy::default();
    let logs = real(&toy);
    // The search found the true values. Its robots are as near to the logs as the regression's robots.
    let there = regress(&theta(), &TRUTH, &logs, &toy, EACH, 1, &never).unwrap().unwrap();
    assert!(there.further.unwrap() < 3.0, "{there:?}");
    let likeness = there.likeness.unwrap();
    assert!(likeness.robots == 48 && !likeness.unlike(), "{there:?}");
    // The logs also show an effect that no value explains.
    let mut odd = logs.clone();
    odd.numbers[9] += 0.1;
    odd.numbers[11] += 0.1;
    let odd = regress(&theta(), &TRUTH, &odd, &toy, EACH, 1, &never).unwrap().unwrap();
    assert!(odd.likeness.unwrap().unlike(), "{odd:?}");
}

#[test]
fn robots_that_fall_are_left_out_or_said() {
    let toy = Toy { stands: 0.35, ..Toy::default() };
    let some = regressed(&toy, &real(&toy));
    assert!(some.rounds[0].walked < EACH);
    assert!((some.corrected[0] - TRUTH[0]).abs() < 0.05, "{some:?}");
    let toy = Toy { stands: 0.1, ..Toy::default() };
    let refused = regress(&theta(), &FOUND, &real(&toy), &toy, EACH, 1, &never).unwrap().unwrap_err();
    assert!(refused.contains("of 60 simulated robots fall"), "{refused}");
}

#[test]
fn the_same_seed_gives_the_same_bits_and_a_cancelled_one_nothing() {
    let toy = Toy::default();
    let logs = real(&toy);
    let regression = regressed(&toy, &logs);
    assert_eq!(regression, regressed(&toy, &logs));
    let other = regress(&theta(), &FOUND, &logs, &toy, EACH, 2, &never).unwrap().unwrap();
    assert_ne!(regression.corrected, other.corrected);
    let cancelled = regress(&theta(), &FOUND, &logs, &toy, EACH, 1, &|| true);
    assert!(matches!(cancelled, Err(FitError::Cancelled)));
}
