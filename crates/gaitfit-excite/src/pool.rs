//! Command sequences to choose from.

use super::playlist::Sequence;
use gaitfit_learn::task::CommandSettings as Ranges;
use gaitfit_random::{Purpose, Stream};

/// Periods of quick sequences and of reversals, s, in turn.
const QUICK: [f64; 2] = [1.0, 0.5];
/// Range of slow walks as shares of the greatest command. Slow and fast walks together separate dry friction, which
/// goes with the sign of velocity, from damping, which goes with velocity itself.
const SLOW: [f64; 2] = [0.05, 0.3];
/// Standard deviation of a variant's commands about the original's, as a share of the range.
const CHANGE: f64 = 0.15;
/// Kinds of sequences beside the usual ones.
const KINDS: usize = 5;

/// The source of command sequences.
pub(super) struct Pool<'a> {
    /// Ranges from which the task draws commands.
    pub usual: &'a Ranges,
    /// Smallest and greatest command of the others, m/s ahead, m/s to the left, rad/s.
    pub ranges: [[f64; 2]; 3],
    /// Length of a sequence, s.
    pub seconds: f64,
    pub seed: u64,
}

impl<'a> Pool<'a> {
    /// `reach`: the greatest commands over the task's.
    pub fn new(usual: &'a Ranges, reach: f64, seconds: f64, seed: u64) -> Self {
        let ranges =
            [usual.x, usual.y, usual.yaw].map(|[low, high]| [low.min(reach * low), high.max(reach * high)]);
        Self { usual, ranges, seconds, seed }
    }

    /// `count` sequences: the first `usual` as the task draws them, then in turn some that change soon, steady ones at the
    /// ends of the ranges, slow and fast steady ones, and reversals between ends.
    pub fn draw(&self, count: usize, usual: usize) -> Vec<Sequence> {
        let one = |number: usize| match number.checked_sub(usual) {
            None => self.as_drawn(number, self.usual.seconds),
            Some(other) if other % KINDS == 0 => self.as_drawn(number, QUICK[(other / KINDS) % QUICK.len()]),
            Some(other) => self.special(number, other),
        };
        (0..count).map(one).collect()
    }

    /// `count` variants of `sequences`, in turn, clear of those with smaller numbers than `first`.
    pub fn variants(&self, sequences: &[&Sequence], first: usize, count: usize) -> Vec<Sequence> {
        let one = |number: usize| {
            let stream = self.stream(first + number);
            let step = |(at, (time, command)): (usize, &(f64, [f64; 3]))| {
                let draws = stream.step(2 + at as u32);
                let moved = |k: usize| {
                    let [low, high] = self.ranges[k];
                    (command[k] + CHANGE * (high - low) * draws.normal(k as u32)).clamp(low, high)
                };
                (*time, std::array::from_fn(moved))
            };
            Sequence {
                steps: sequences[number % sequences.len()].steps.iter().enumerate().map(step).collect(),
            }
        };
        (0..if sequences.is_empty() { 0 } else { count }).map(one).collect()
    }

    fn stream(&self, number: usize) -> Stream {
        Stream::new(self.seed, Purpose::EXCITATION).environment(number as u32)
    }

    /// Steps of a sequence that changes every `period` s.
    fn steps(&self, period: f64) -> u32 {
        // The subtraction takes rounding away: 4 s of 0.5 s are 8 steps, not 9.
        (self.seconds / period - 1e-9).ceil().max(1.0) as u32
    }

    /// A sequence as the task draws it, but for the time until the next command.
    fn as_drawn(&self, number: usize, period: f64) -> Sequence {
        let ranges = [self.usual.x, self.usual.y, self.usual.yaw];
        let step = |step: u32| {
            let draws = self.stream(number).step(2 + step);
            let value = |k: usize| ranges[k][0] + (ranges[k][1] - ranges[k][0]) * draws.uniform(k as u32);
            let stands = draws.uniform(3) < self.usual.standing;
            (f64::from(step) * period, if stands { [0.0; 3] } else { std::array::from_fn(value) })
        };
        Sequence { steps: (0..self.steps(period)).map(step).collect() }
    }

    /// One of the other kinds.
    fn special(&self, number: usize, other: usize) -> Sequence {
        let draws = self.stream(number).step(2);
        let within = |[low, high]: [f64; 2], part: f64| low + (high - low) * part;
        // Each command is the lower end, the middle or the upper end of its range.
        let ends = |offset: u32| {
            let end =
                |k: usize| within(self.ranges[k], (3.0 * draws.uniform(offset + k as u32)).floor() / 2.0);
            std::array::from_fn(end)
        };
        let steady = |part: f64| {
            let value = |k: usize| {
                let [low, high] = self.ranges[k];
                (part * within([low, high], draws.uniform(k as u32))).clamp(low, high)
            };
            Sequence { steps: vec![(0.0, std::array::from_fn(value))] }
        };
        match other % KINDS {
            1 => Sequence { steps: vec![(0.0, ends(0))] },
            2 => steady(within(SLOW, draws.uniform(3))),
            3 => steady(1.0),
            _ => {
                let period = QUICK[(other / KINDS) % QUICK.len()];
                let ends: [[f64; 3]; 2] = [ends(0), ends(3)];
                let step = |step: u32| (f64::from(step) * period, ends[step as usize % 2]);
                Sequence { steps: (0..self.steps(period)).map(step).collect() }
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Commands of the task: never backwards.
    fn ranges() -> Ranges {
        let (x, y, yaw) = ([0.5, 1.0], [-0.4, 0.4], [-1.0, 1.0]);
        Ranges { x, y, yaw, seconds: 4.0, standing: 0.0, curriculum: None }
    }

    /// Whether a command lies within ranges.
    fn within(command: [f64; 3], ranges: [[f64; 2]; 3]) -> bool {
        command.iter().zip(ranges).all(|(value, [low, high])| (low..=high).contains(value))
    }

    #[test]
    fn the_first_are_usual_and_others_reach_further_but_no_further_than_they_may() {
        let usual = ranges();
        let pool = Pool::new(&usual, 2.0, 4.0, 3);
        let drawn = pool.draw(60, 30);
        let small = [usual.x, usual.y, usual.yaw];
        assert!(drawn[..30].iter().all(|one| one.steps.len() == 1 && within(one.steps[0].1, small)));
        let others = || drawn[30..].iter().flat_map(|one| one.steps.iter().map(|(_, command)| *command));
        // Twice the task's greatest, and from its smallest on.
        let wide = [[0.5, 2.0], [-0.8, 0.8], [-2.0, 2.0]];
        assert!(
            others().all(|command| within(command, wide)) && others().any(|command| !within(command, small))
        );
        // Slow ones, and ones that turn back.
        let slow = |one: &&Sequence| {
            one.steps.len() == 1 && one.steps[0].1[1].abs() < 0.25 && one.steps[0].1[2].abs() < 0.61
        };
        assert!(drawn[30..].iter().filter(slow).count() >= 6);
        let back = |one: &&Sequence| one.steps.len() >= 4 && one.steps[0].1 == one.steps[2].1;
        assert_eq!(drawn[30..].iter().filter(back).count(), 6);
        // The same from the same seed, others from another.
        assert_eq!(pool.draw(60, 30), drawn);
        assert!(Pool::new(&usual, 2.0, 4.0, 4).draw(60, 30) != drawn);
    }

    #[test]
    fn variants_are_near_and_within_the_ranges() {
        let usual = ranges();
        let pool = Pool::new(&usual, 1.0, 4.0, 3);
        let one = Sequence { steps: vec![(0.0, [1.0, 0.0, -0.5]), (2.0, [0.5, 0.4, 0.0])] };
        let variants = pool.variants(&[&one], 100, 40);
        assert!(variants.iter().all(|variant| variant.steps[1].0 == 2.0 && *variant != one));
        let commands =
            || variants.iter().flat_map(|variant| variant.steps.iter().map(|(_, command)| *command));
        assert!(commands().all(|command| within(command, [usual.x, usual.y, usual.yaw])));
        let mean = variants.iter().map(|variant| variant.steps[0].1[2]).sum::<f64>() / 40.0;
        assert!((mean + 0.5).abs() < 0.15, "{mean}");
        assert!(pool.variants(&[], 0, 40).is_empty());
    }
}
