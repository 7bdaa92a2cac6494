//! Stamps that lost their digits: times that were rounded to single precision or to a coarse tick before they were written.
//!
//! Rows that were sampled evenly then share stamps, or are unevenly apart, and what follows from their intervals (rates,
//! velocities, lost rows, delays) is wrong. If all stamps are within a tick of an even grid, the rows were evenly spaced.

use crate::scale::shared_factor;
use crate::spacing::line;
use crate::stats::short;
use gaitfit_model::shown_number;
use serde::Serialize;

/// Share of the rows that repeat the time before with other values, from which stamps are taken for too coarse. Less is a
/// recorder that wrote late now and then.
const STANDING: f64 = 0.05;
/// A tick smaller than this share of the mean interval does no harm.
const HARMLESS: f64 = 0.1;
/// A tick from which stamps that fit no even grid are refused, of the mean interval.
const HARMFUL: f64 = 0.5;
/// Share of the intervals that are not the most frequent multiple of the tick; below it rows were lost, or nothing is wrong.
const UNEVEN: f64 = 0.05;
/// How far a stamp may be from a multiple of its tick, of a tick: text may have rounded it again.
const OFF_TICK: f64 = 0.12;
/// How far stamps of even rows may be from even besides their tick, of an interval.
const LOOSE: f64 = 0.2;
/// Relative difference of a stated rate and that of the stamps.
const SAME_RATE: f64 = 0.02;
/// Fewer rows show no tick.
const ENOUGH: usize = 20;
/// Rows over which the grid may drift while lost rows are looked for.
const WINDOW: usize = 64;
/// A loss of more than this share of the rows is a wrong rate.
const LOSS: f64 = 0.2;

/// The fault of stamps that are too coarse.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CoarseStamps {
    /// The tick, s: every stamp is a multiple of it; 0 where there is none, and rows share stamps nevertheless.
    pub tick_s: f64,
    /// Whether the tick is a power of two, as single precision leaves it.
    pub single_precision: bool,
    /// Rows with the time of the row before and other values.
    pub shared: usize,
}

impl std::fmt::Display for CoarseStamps {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        if self.shared > 0 {
            write!(f, "{} rows have the time of the row before and other values: ", self.shared)?;
        }
        match (self.single_precision, self.tick_s > 0.0) {
            (true, _) => write!(
                f,
                "the stamps are multiples of {} s, 2^{}, as single precision (float32) leaves of large times: save them as \
                 float64",
                short(self.tick_s),
                self.tick_s.log2().round()
            ),
            (false, true) => {
                write!(f, "the stamps are multiples of {} s, too coarse for these rows", short(self.tick_s))
            }
            (false, false) => write!(f, "the stamps are too coarse for these rows"),
        }
    }
}

/// Rows that were spaced evenly, because their stamps had lost their digits.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct EvenRows {
    /// The fault of the stamps.
    pub coarse: CoarseStamps,
    /// Rows a second.
    pub rate_hz: f64,
    /// Rows that are missing between the others.
    pub lost: usize,
    /// Largest distance of a stamp from its row's time, s.
    pub off_s: f64,
}

impl std::fmt::Display for EvenRows {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}; the rows are spaced evenly at {} Hz", self.coarse, shown_number(self.rate_hz))?;
        if self.lost > 0 {
            write!(f, ", with {} lost ones between them", self.lost)?;
        }
        write!(f, ", at most {} s from their stamps", short(self.off_s))
    }
}

/// Result of examining stamps.
#[derive(Clone, Debug, PartialEq)]
pub enum Stamps {
    /// As good as they need to be.
    Fine,
    /// Too coarse, and of rows that were evenly spaced: their times, s.
    Even(Vec<f64>, EvenRows),
    /// Too coarse, and where the rows were in time does not follow from them. In words: what they are and why.
    Lost(CoarseStamps, String),
}

/// Whether a cell has news against that of the row before. Two NaN count as one value: a missing cell that repeats is
/// no news.
pub fn is_news(cell: f64, before: f64) -> bool {
    cell != before && !(cell.is_nan() && before.is_nan())
}

/// Looks at `time`, s, one a row, never falling. `is_new(row)`: whether row `row` has other values than the row before, asked
/// where the two share a stamp. `rate_hz`: the rate that is stated, if one is.
pub fn look(time: &[f64], rate_hz: Option<f64>, is_new: impl Fn(usize) -> bool) -> Stamps {
    let Some(coarse) = coarse(time, is_new) else { return Stamps::Fine };
    // Text may have rounded single precision again.
    let single: Vec<f64> = time.iter().map(|time| f64::from(*time as f32)).collect();
    let time = if coarse.single_precision { &single[..] } else { time };
    // 1. Stamps within a tick of an even grid: the rows were even, and none is lost.
    if let Some((times, rate)) = even(time, coarse.tick_s, rate_hz) {
        let off_s = farthest(time, &times);
        return Stamps::Even(times, EvenRows { coarse, rate_hz: rate, lost: 0, off_s });
    }
    // Uneven rows whose ticks are finer than their intervals have their times nearly right.
    if coarse.shared == 0 && coarse.tick_s < HARMFUL * mean_step(time) {
        return Stamps::Fine;
    }
    let Some(rate) = rate_hz else {
        return Stamps::Lost(coarse, "Where the rows were does not follow from them".to_owned());
    };
    // 2. With the stated rate, lost rows are found too.
    match at_rate(time, coarse.tick_s, rate) {
        Ok((times, lost)) => {
            let off_s = farthest(time, &times);
            Stamps::Even(times, EvenRows { coarse, rate_hz: rate, lost, off_s })
        }
        Err(why) => Stamps::Lost(coarse, why),
    }
}

/// Rows a second by the velocities, for a time column that says nothing: how many times they are the change of the position
/// from row to row. `None` where they do not agree. `position`, `velocity`: `rows × joints`, row-major.
pub fn rate_of_velocities(position: &[f64], velocity: &[f64], joints: usize) -> Option<f64> {
    let rows = position.len().checked_div(joints)?;
    let numbers: Vec<f64> = (0..rows).map(|row| row as f64).collect();
    shared_factor(&numbers, position, velocity, joints).filter(|rate| *rate >= 1.0)
}

/// Returns the fault of the stamps, if they are too coarse.
fn coarse(time: &[f64], is_new: impl Fn(usize) -> bool) -> Option<CoarseStamps> {
    if time.len() < ENOUGH {
        return None;
    }
    // Rows with the time of the row before; whether they are new rows or copies decides what they mean.
    let equal: Vec<usize> = (1..time.len()).filter(|row| time[*row] == time[row - 1]).collect();
    let shared = equal.iter().filter(|row| is_new(**row)).count();
    let standing = shared as f64 > STANDING * time.len() as f64;
    // Copies of rows have the copied row's time.
    if !standing && shared < equal.len() {
        return None;
    }
    let (tick_s, single_precision) = tick(time).unwrap_or((0.0, false));
    // Many new rows under one stamp: the stamps stand still, whatever their tick.
    if standing {
        return Some(CoarseStamps { tick_s, single_precision, shared });
    }
    if tick_s < HARMLESS * mean_step(time) {
        return None;
    }
    // Lost rows of exact stamps are multiples of a tick too, but rare ones.
    let mut counts: std::collections::HashMap<u64, usize> = std::collections::HashMap::new();
    for pair in time.windows(2) {
        *counts.entry(((pair[1] - pair[0]) / tick_s).round() as u64).or_default() += 1;
    }
    let max = counts.values().copied().max().unwrap_or(0);
    let uneven = (time.len() - 1 - max) as f64 > UNEVEN * time.len() as f64;
    uneven.then_some(CoarseStamps { tick_s, single_precision, shared })
}

fn mean_step(time: &[f64]) -> f64 {
    (time[time.len() - 1] - time[0]) / (time.len() - 1) as f64
}

/// Returns the step of single precision for times of this size, s.
fn single_tick(time: f64) -> f64 {
    // The significand of single precision has 23 bits behind the leading one.
    if time > 0.0 { (time.log2().floor() - 23.0).exp2() } else { 0.0 }
}

/// Whether a time is a number of single precision, or the text of one.
fn is_single(time: f64) -> bool {
    let single = time as f32;
    // Its shortest text, read as a double, is another number than the single itself.
    f64::from(single) == time || single.to_string().parse() == Ok(time)
}

/// The largest tick of which all stamps are multiples, and whether it is a power of two.
fn tick(time: &[f64]) -> Option<(f64, bool)> {
    // A time that never changes has no shortest interval to find a tick by.
    if time.iter().all(|at| *at == time[0]) {
        // The power of two that single precision keeps at this size.
        let tick = single_tick(time[0].abs());
        return (tick >= 1e-3 && is_single(time[0])).then_some((tick, true));
    }
    let largest = time.iter().fold(0.0f64, |max, time| max.max(time.abs()));
    let single = single_tick(largest);
    if single >= HARMLESS * mean_step(time) && time.iter().all(|time| is_single(*time)) {
        return Some((single, true));
    }
    // From 256 s, above the 128 s that single precision leaves of a Unix time, to 61 µs.
    let binary = (-8..=14).map(|power| (0.5f64.powi(power), true));
    let decimal = [10.0, 5.0, 2.0, 1.0]
        .into_iter()
        .flat_map(|digit| [1.0, 0.1, 0.01, 1e-3, 1e-4].map(|unit| digit * unit));
    let mut ticks: Vec<(f64, bool)> = binary.chain(decimal.map(|tick| (tick, false))).collect();
    // The largest first: multiples of it are multiples of smaller ticks too.
    ticks.sort_by(|a, b| b.0.total_cmp(&a.0));
    let shortest = time
        .windows(2)
        .map(|pair| pair[1] - pair[0])
        .filter(|step| *step > 0.0)
        .fold(f64::INFINITY, f64::min);
    let fits = |(tick, _): &(f64, bool)| {
        *tick <= (1.0 + OFF_TICK) * shortest
            && time.iter().all(|time| {
                let multiple = time / tick;
                (multiple - multiple.round()).abs() <= OFF_TICK
            })
    };
    ticks.into_iter().find(fits)
}

/// Times on a line, if every stamp is within a tick of it, and the rate: the stated one, or a whole number near it.
fn even(time: &[f64], tick: f64, rate_hz: Option<f64>) -> Option<(Vec<f64>, f64)> {
    let numbers: Vec<f64> = (0..time.len()).map(|row| row as f64).collect();
    let (start, step) = line(&numbers, time)?;
    // A tick of many rows does not show the interval.
    if step <= 0.0 || tick <= 0.0 || tick > 0.1 * step * time.len() as f64 {
        return None;
    }
    // All stamps within a tick of the line means that rounding alone explains them.
    let (mut low, mut high) = (f64::INFINITY, f64::NEG_INFINITY);
    for (row, time) in time.iter().enumerate() {
        let off = time - (start + row as f64 * step);
        (low, high) = (low.min(off), high.max(off));
    }
    if high - low > tick + LOOSE * step {
        return None;
    }
    // Rounding leaves the slope this uncertain over the whole log.
    let sure = (tick / (step * time.len() as f64)).max(1e-6);
    let near = |rate: f64| (rate * step - 1.0).abs() <= sure;
    let rate = match rate_hz {
        Some(stated) if (stated * step - 1.0).abs() > SAME_RATE => return None,
        Some(stated) if near(stated) => stated,
        _ if near((1.0 / step).round()) => (1.0 / step).round(),
        _ => 1.0 / step,
    };
    // Corrected about the middle, so that a rate that is slightly changed moves both ends alike.
    let middle = start + 0.5 * step * (time.len() - 1) as f64;
    let begin = middle - 0.5 * (time.len() - 1) as f64 / rate;
    Some((numbers.iter().map(|row| begin + row / rate).collect(), rate))
}

/// Times of rows at a stated rate, and how many rows are missing between them.
fn at_rate(time: &[f64], tick: f64, rate: f64) -> Result<(Vec<f64>, usize), String> {
    let step = 1.0 / rate;
    let span = time[time.len() - 1] - time[0];
    let rows = (time.len() - 1) as f64 * step;
    // Stamps that all are one say nothing against any rate.
    let wide = if tick > 0.0 { tick + LOOSE * step } else { largest_step(time) + LOOSE * step };
    let mut missing = 0usize;
    let mut off: Vec<f64> = Vec::with_capacity(time.len());
    for (row, at) in time.iter().enumerate() {
        let offset = at - (row + missing) as f64 * step;
        // The earliest of the recent rows is nearest to its true time, because lost rows only make later ones
        // late.
        let recent = &off[off.len().saturating_sub(WINDOW)..];
        let low = recent.iter().copied().fold(f64::INFINITY, f64::min);
        // A row that is later than a tick allows, by the earliest of its neighbours, follows lost rows.
        let late = offset - (low + wide);
        let lost = if late > 0.0 { (late / step).ceil() } else { 0.0 };
        missing = missing.saturating_add(lost as usize);
        if missing as f64 > LOSS * time.len() as f64 {
            return Err(format!(
                "{} rows at {} Hz last {} s and the stamps {} s",
                time.len(),
                shown_number(rate),
                short(rows),
                short(span)
            ));
        }
        off.push(at - (row + missing) as f64 * step);
    }
    // Too many rows for the time between the first and the last stamp: the rate is wrong, not the stamps.
    if rows > span * (1.0 + SAME_RATE) + 2.0 * wide {
        return Err(format!(
            "{} rows at {} Hz last {} s and the stamps {} s",
            time.len(),
            shown_number(rate),
            short(rows),
            short(span)
        ));
    }
    // Each row where it is by its number; the first at the middle of where the stamps allow.
    let begin = off.iter().sum::<f64>() / off.len() as f64;
    let mut times = Vec::with_capacity(time.len());
    for (at, off) in time.iter().zip(&off) {
        // `at − off` is the row's number times the interval.
        times.push(begin + (at - off));
    }
    Ok((times, missing))
}

fn largest_step(time: &[f64]) -> f64 {
    time.windows(2).map(|pair| pair[1] - pair[0]).fold(0.0, f64::max)
}

fn farthest(stamps: &[f64], times: &[f64]) -> f64 {
    stamps.iter().zip(times).map(|(a, b)| (a - b).abs()).fold(0.0, f64::max)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn looked(time: &[f64], rate: Option<f64>) -> Stamps {
        look(time, rate, |_| true)
    }

    fn rows(start: f64, step: f64) -> Vec<f64> {
        (0..1800).map(|row| start + f64::from(row) * step).collect()
    }

    /// As single precision keeps them.
    fn single(time: &[f64]) -> Vec<f64> {
        time.iter().map(|time| f64::from(*time as f32)).collect()
    }

    fn assert_even(stamps: &Stamps, step: f64, case: &str) {
        let Stamps::Even(times, even) = stamps else { panic!("{case}: {stamps:?}") };
        assert!(times.windows(2).all(|pair| ((pair[1] - pair[0]) / step - 1.0).abs() < 1e-4), "{case}");
        assert_eq!((times.len(), even.lost), (1800, 0), "{case}");
    }

    #[test]
    fn single_precision_is_recognised_and_its_rows_are_spaced_evenly() {
        for (start, step) in
            [(40_000.0, 0.005), (86_400.0, 0.005), (86_400.0, 0.02), (200_000.0, 0.005), (40_000.0, 0.002)]
        {
            let stamps = looked(&single(&rows(start, step)), None);
            assert_even(&stamps, step, &format!("{start} {step}"));
            let Stamps::Even(_, even) = stamps else { return };
            assert!(even.coarse.single_precision && even.to_string().contains("float32"), "{even}");
        }
        // Printed with the digits that single precision has.
        let text: Vec<f64> = rows(40_000.0, 0.005)
            .iter()
            .filter_map(|time| format!("{}", *time as f32).parse().ok())
            .collect();
        assert_even(&looked(&text, None), 0.005, "text");
    }

    #[test]
    fn unix_times_in_single_precision_need_a_rate() {
        let time = single(&rows(1.7e9, 0.005));
        let Stamps::Lost(coarse, _) = looked(&time, None) else { panic!("a rate out of nothing") };
        assert!(coarse.single_precision && coarse.tick_s >= 128.0, "{coarse:?}");
        assert_even(&looked(&time, Some(200.0)), 0.005, "stated");
    }

    #[test]
    fn coarse_ticks_are_recognised() {
        let ticks = |step: f64, tick: f64| -> Vec<f64> {
            rows(0.0, step).iter().map(|time| (time / tick + 1e-9).floor() * tick).collect()
        };
        assert_even(&looked(&ticks(0.005, 0.05), None), 0.005, "50 ms");
        assert_even(&looked(&ticks(0.005, 0.05), Some(200.0)), 0.005, "50 ms, stated");
        assert_even(&looked(&ticks(1.0 / 300.0, 0.001), None), 1.0 / 300.0, "1 ms");
        // Another rate than the stamps have.
        assert!(matches!(looked(&ticks(0.005, 0.05), Some(100.0)), Stamps::Lost(..)));
        // Rows that were lost show with a stated rate alone.
        let mut time = ticks(0.005, 0.05);
        time.drain(700..760);
        let Stamps::Even(times, even) = looked(&time, Some(200.0)) else { panic!("lost rows") };
        assert!((50..70).contains(&even.lost), "{even:?}");
        assert!((times[1700] - times[0] - 8.8).abs() < 0.06, "{}", times[1700] - times[0]);
        assert!(matches!(looked(&time, None), Stamps::Lost(..)));
    }

    #[test]
    fn good_stamps_are_left_alone() {
        let mut lost = rows(0.0, 0.02);
        lost.remove(300);
        lost.remove(900);
        let noise = |row: usize| ((row as f64 * 12.9898).sin() * 43_758.547).fract();
        let milliseconds: Vec<f64> =
            (0..500).map(|row| ((0.005 * (row as f64 + 0.45 * noise(row))) * 1e3).round() / 1e3).collect();
        for time in [rows(0.0, 0.005), rows(1.7e9, 0.005), lost, milliseconds, vec![0.0; 3]] {
            assert_eq!(looked(&time, None), Stamps::Fine);
        }
        // Rows that are copies of the row before are not new.
        let twice: Vec<f64> = (0..200).map(|row| f64::from(row / 2) * 0.01).collect();
        assert_eq!(look(&twice, None, |_| false), Stamps::Fine);
    }
}
