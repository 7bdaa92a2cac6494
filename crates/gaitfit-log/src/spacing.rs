//! The interval between samples, and where samples were lost: a lost sample shifts all later ones, jitter does not.

use crate::scale::typical_step;
use crate::stats::{mean, median};

/// An interval from which samples may be missing, of the usual one: jitter makes that of a lost sample shorter.
const LONG: f64 = 1.2;
/// Samples on either side of a long interval that show whether it shifts what follows.
const AROUND: usize = 24;
/// Jitter of one sample against its neighbours, of an interval, that still may be jitter.
const JITTER: f64 = 0.96;
/// Samples of a span whose length tells the interval.
const SEVERAL: usize = 16;
/// Rounds of counting losses and measuring the interval.
const ROUNDS: usize = 5;
/// Relative change of the interval that is not rounding.
const REFINED: f64 = 1e-6;

/// Samples that are missing.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Lost {
    /// The sample before the gap.
    pub after: usize,
    /// How many are missing.
    pub samples: usize,
}

/// The interval between the samples of a log, and lost samples.
#[derive(Clone, Debug, PartialEq)]
pub struct Spacing {
    /// The interval, s: the slope of time over samples, lost ones counted.
    pub step: f64,
    /// Where samples are missing, in order.
    pub lost: Vec<Lost>,
    /// RMS deviation of the other intervals from `step`, s.
    pub jitter: f64,
}

impl Spacing {
    /// How many samples are missing.
    pub fn count(&self) -> usize {
        self.lost.iter().fold(0, |sum, lost| sum.saturating_add(lost.samples))
    }
}

/// The spacing of increasing times, s; `None` where time does not increase or has one sample.
///
/// An interval of more than 1.2 usual ones has lost samples if what follows stays late by at least half an
/// interval. If the next samples are back on the grid, it is jitter.
pub fn spacing(time: &[f64]) -> Option<Spacing> {
    let usual = typical_step(time)?;
    let mut step = over_several(time, usual);
    let mut lost = self::lost(time, step);
    // What is lost depends on the interval, and the interval on what is lost.
    for _ in 0..ROUNDS {
        // Wrong counts of lost samples must not carry the interval away.
        let slope = slope(time, &lost).filter(|slope| (0.5..2.0).contains(&(slope / usual)));
        let refined = slope.filter(|slope| (slope / usual - 1.0).abs() > REFINED).unwrap_or(usual);
        let again = self::lost(time, refined);
        let settled = again == lost && refined == step;
        (step, lost) = (refined, again);
        if settled {
            break;
        }
    }
    let mut gaps = lost.iter().map(|lost| lost.after).peekable();
    let (mut squares, mut count) = (0.0, 0usize);
    for (sample, pair) in time.windows(2).enumerate() {
        // Intervals with lost samples are no jitter.
        if gaps.next_if_eq(&sample).is_some() {
            continue;
        }
        let interval = pair[1] - pair[0];
        if interval > 0.0 {
            squares += (interval - step).powi(2);
            count += 1;
        }
    }
    Some(Spacing { step, lost, jitter: (squares / count.max(1) as f64).sqrt() })
}

/// The middle interval by spans of several samples, over which jitter averages out; `usual` where losses are in most of
/// them.
fn over_several(time: &[f64], usual: f64) -> f64 {
    let mut spans: Vec<f64> =
        time.windows(SEVERAL + 1).map(|span| (span[SEVERAL] - span[0]) / SEVERAL as f64).collect();
    // A lost sample in a span makes its mean interval longer by 1 / SEVERAL.
    median(&mut spans).filter(|step| (step / usual - 1.0).abs() < 0.6 / SEVERAL as f64).unwrap_or(usual)
}

/// Where samples are missing if they are `step` apart.
fn lost(time: &[f64], step: f64) -> Vec<Lost> {
    let mut gaps: Vec<Lost> = Vec::new();
    for (sample, pair) in time.windows(2).enumerate() {
        let interval = (pair[1] - pair[0]) / step;
        // The gap before was found to lie here already.
        if gaps.last().is_some_and(|lost| lost.after >= sample) {
            continue;
        }
        if interval.is_nan() || interval <= LONG {
            continue;
        }
        // Up to where a longer interval may have lost more.
        let longer = |row: &usize| time[row + 1] - time[*row] > pair[1] - pair[0];
        let last = (time.len() - 1).min(sample + 1 + AROUND);
        let last = (sample + 1..last).find(longer).unwrap_or(last);
        // Too little to tell jitter from a loss; what is lost shows at the longer interval.
        if last < sample + 3 && last + 1 < time.len() && interval < 2.0 {
            continue;
        }
        // Where this sample and the next would be by those around them, but for those beyond another gap.
        let middle = |mut places: Vec<f64>| {
            let middle = median(&mut places)?;
            // Places beyond another gap are off by whole intervals.
            places.retain(|place| (place - middle).abs() < 0.75 * step);
            Some(if places.is_empty() { middle } else { mean(&places) })
        };
        // The samples beside the interval are those whose jitter made it long; others tell more, where there are others.
        let begin = sample.saturating_sub(AROUND);
        let behind = if sample - begin > 2 { begin..sample } else { begin..sample + 1 };
        let missing = |from: usize| {
            let between = gaps.iter().rev().take_while(|lost| lost.after >= from);
            between.map(|lost| lost.samples as f64).sum::<f64>()
        };
        let before =
            middle(behind.map(|row| time[row] + ((sample - row) as f64 + missing(row)) * step).collect());
        let ahead = if last > sample + 3 { sample + 2..last + 1 } else { sample + 1..last + 1 };
        let after = middle(ahead.map(|row| time[row] - (row - sample - 1) as f64 * step).collect());
        let (Some(before), Some(after)) = (before, after) else { continue };
        // Bounds of the count by the interval itself and the largest jitter: 0.04 is room for rounding.
        let low = (interval - 1.0 - JITTER - 0.04).ceil().max(0.0);
        let high = (interval - 1.0 + JITTER).floor().max(low);
        let samples = ((after - before) / step - 1.0).round().clamp(low, high);
        if samples >= 1.0 {
            // A neighbour's interval may be the longer one by its jitter: samples are where they are nearer to.
            let first = gaps.last().map_or(0, |lost| lost.after + 1).max(sample.saturating_sub(2));
            let last = (sample + 2).min(time.len() - 2);
            let misfit = |after: usize| -> f64 {
                let off = |row: usize| {
                    let late = if row > after { samples * step } else { 0.0 };
                    time[row] - before - (row as f64 - sample as f64) * step - late
                };
                (first..=last + 1).map(|row| off(row).powi(2)).sum()
            };
            let near = (first..=last).min_by(|a, b| misfit(*a).total_cmp(&misfit(*b))).unwrap_or(sample);
            // A cast saturates: a damaged time may lie centuries away.
            gaps.push(Lost { after: near, samples: samples as usize });
        }
    }
    gaps
}

/// Slope of time over the samples' numbers, lost ones counted, by least squares.
fn slope(time: &[f64], lost: &[Lost]) -> Option<f64> {
    let mut gaps = lost.iter().peekable();
    let mut number = 0.0;
    let mut numbers = Vec::with_capacity(time.len());
    for sample in 0..time.len() {
        numbers.push(number);
        let missing = gaps.next_if(|gap| gap.after == sample).map_or(0, |gap| gap.samples);
        number += 1.0 + missing as f64;
    }
    line(&numbers, time).map(|(_, slope)| slope)
}

/// Offset and slope of the line through points by least squares.
pub(crate) fn line(x: &[f64], y: &[f64]) -> Option<(f64, f64)> {
    let count = x.len() as f64;
    // Unix times lose their digits in sums of squares.
    let (x0, y0) = (*x.first()?, *y.first()?);
    let (mean_x, mean_y) =
        (x.iter().map(|x| x - x0).sum::<f64>() / count, y.iter().map(|y| y - y0).sum::<f64>() / count);
    let (mut xx, mut xy) = (0.0, 0.0);
    for (x, y) in x.iter().zip(y) {
        let (x, y) = (x - x0 - mean_x, y - y0 - mean_y);
        xx += x * x;
        xy += x * y;
    }
    let slope = xy / xx;
    slope.is_finite().then_some((y0 + mean_y - slope * (x0 + mean_x), slope))
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Numbers from −1 to 1 without a pattern.
    fn noise(i: usize) -> f64 {
        2.0 * ((i as f64 * 12.9898).sin() * 43_758.547).fract().abs() - 1.0
    }

    #[test]
    fn jitter_loses_nothing() {
        // Up to 48 % of an interval: every seventh interval is longer than one and a half.
        for share in [0.05, 0.3, 0.48] {
            let time: Vec<f64> = (0..2000).map(|i| 7.0 + 0.005 * (i as f64 + share * noise(i))).collect();
            let result =
                spacing(&time).map(|spacing| (spacing.lost.len(), (spacing.step / 0.005 - 1.0).abs() < 1e-4));
            assert_eq!(result, Some((0, true)), "{share}");
        }
    }

    #[test]
    fn lost_samples_are_counted_with_and_without_jitter() {
        for share in [0.0, 0.1, 0.3] {
            let mut time: Vec<f64> = (0..1000).map(|i| 0.02 * (i as f64 + share * noise(i))).collect();
            time.drain(700..704);
            time.remove(400);
            time.remove(100);
            let spacing = spacing(&time);
            let lost = spacing.as_ref().map(|spacing| spacing.lost.clone()).unwrap_or_default();
            let want = [(99, 1), (398, 1), (697, 4)].map(|(after, samples)| Lost { after, samples });
            assert_eq!(lost, want, "{share}");
            assert!(spacing.is_some_and(|spacing| (spacing.step / 0.02 - 1.0).abs() < 1e-3));
        }
    }

    #[test]
    fn frequent_losses_are_counted() {
        let time: Vec<f64> = (0..1000).filter(|i| i % 10 != 3).map(|i| 0.01 * f64::from(i)).collect();
        let spacing = spacing(&time);
        assert_eq!(spacing.as_ref().map(Spacing::count), Some(100));
        assert!(
            spacing.is_some_and(|spacing| (spacing.step / 0.01 - 1.0).abs() < 1e-6 && spacing.jitter < 1e-9)
        );
    }

    #[test]
    fn gaps_of_centuries_and_standing_time_are_no_panic() {
        let sparse = spacing(&[0.0, 0.01, 0.02, 0.03, 0.04, 1e300, 1.5e300]);
        assert!(sparse.is_some_and(|sparse| sparse.count() == usize::MAX));
        assert_eq!(spacing(&[1.0; 5]), None);
        assert_eq!(spacing(&[]), None);
        assert_eq!(spacing(&[f64::NAN, f64::NAN]), None);
    }
}
