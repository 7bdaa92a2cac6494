//! Scales from data to positions on the page, and round tick values.

use crate::format;

/// Largest magnitude drawn: beyond it differences overflow.
const LARGEST: f64 = 1e150;

/// A linear or logarithmic map from `low..high` to `from..to`.
#[derive(Clone, Copy, Debug)]
pub struct Scale {
    low: f64,
    high: f64,
    from: f64,
    to: f64,
    log: bool,
}

/// A value worth a mark on the axis.
pub struct Tick {
    /// Where it is, in the unit of the data.
    pub value: f64,
    /// The value as text.
    pub label: String,
}

/// Smallest and largest finite value; `None` if there is none.
pub fn extent(values: impl IntoIterator<Item = f64>) -> Option<(f64, f64)> {
    values.into_iter().filter(|x| x.is_finite()).fold(None, |range, x| match range {
        None => Some((x, x)),
        Some((low, high)) => Some((x.min(low), x.max(high))),
    })
}

impl Scale {
    /// A linear scale; an empty interval is widened so that it has an inside.
    pub fn linear(domain: Option<(f64, f64)>, from: f64, to: f64) -> Scale {
        let (low, high) = domain.unwrap_or((0.0, 1.0));
        let (mut low, mut high) = (low.clamp(-LARGEST, LARGEST), high.clamp(-LARGEST, LARGEST));
        // An interval of a few thousand rounding errors of f64 has no inside worth drawing.
        if high - low <= 1e-12 * low.abs().max(high.abs()) || high <= low {
            let pad = if low == 0.0 { 1.0 } else { 0.05 * low.abs() };
            (low, high) = (low - pad, high + pad);
        }
        Scale { low, high, from, to, log: false }
    }

    /// A logarithmic scale over positive values.
    pub fn log(low: f64, high: f64, from: f64, to: f64) -> Scale {
        let low = low.clamp(1.0 / LARGEST, LARGEST);
        // An axis of length zero would divide by zero in `at`.
        let high = high.clamp(low * 1.2, LARGEST * 1.2);
        Scale { low, high, from, to, log: true }
    }

    /// The linear scale with `share` of its length added at both ends.
    pub fn padded(self, share: f64) -> Scale {
        let pad = (self.high - self.low) * share;
        Scale { low: self.low - pad, high: self.high + pad, ..self }
    }

    /// Lower and upper end of the data.
    pub fn domain(&self) -> (f64, f64) {
        (self.low, self.high)
    }

    /// Whether the scale is logarithmic.
    pub fn is_log(&self) -> bool {
        self.log
    }

    /// Position of `x`, which need not lie inside; it is held within one length beyond either end.
    pub fn at(&self, x: f64) -> f64 {
        let share = if self.log {
            (x.max(1.0 / LARGEST) / self.low).ln() / (self.high / self.low).ln()
        } else {
            (x.clamp(-LARGEST, LARGEST) - self.low) / (self.high - self.low)
        };
        // A point far outside stays within one length of the axis, so that coordinates stay short.
        self.from + (self.to - self.from) * share.clamp(-1.0, 2.0)
    }

    /// About `wanted` round values inside the domain.
    pub fn ticks(&self, wanted: usize) -> Vec<Tick> {
        if self.log { self.log_ticks(wanted) } else { self.linear_ticks(wanted) }
    }

    fn linear_ticks(&self, wanted: usize) -> Vec<Tick> {
        let raw = (self.high - self.low) / wanted.max(1) as f64;
        let power = 10_f64.powf(raw.log10().floor());
        // Multiples of 1, 2 and 5 of a power of ten are what people read easily; 0.5 is one step finer for the case
        // below.
        let steps = [0.5, 1.0, 2.0, 5.0, 10.0].map(|m| m * power);
        // 1e-9: an end of the axis that is a tick but for rounding has its tick.
        let count = |step: f64| (self.high / step + 1e-9).floor() - (self.low / step - 1e-9).ceil() + 1.0;
        let fitting = steps.iter().position(|s| *s >= raw * (1.0 - 1e-9)).unwrap_or(4).max(1);
        // One tick tells no scale: a step too many is better.
        let step =
            if wanted > 2 && count(steps[fitting]) < 3.0 { steps[fitting - 1] } else { steps[fitting] };
        let first = (self.low / step - 1e-9).ceil();
        // Ticks count from `first`; far from zero and close together they would round to one another.
        let count = ((self.high / step + 1e-9).floor() - first).clamp(0.0, 4.0 * wanted as f64) as usize;
        // As many as the step has, so that all labels of an axis align.
        let decimals = (-step.log10().floor()).max(0.0) as usize;
        let largest = self.low.abs().max(self.high.abs());
        (0..=count)
            .map(|i| {
                let value = (first + i as f64) * step;
                // Longer labels do not fit beside the axis. A value that is 0 but for rounding is written as 0.
                let label = if decimals > 4 || largest >= 1e6 {
                    format::round_number(if value.abs() < step * 1e-6 { 0.0 } else { value })
                } else {
                    format::fixed(value, decimals)
                };
                Tick { value, label }
            })
            .collect()
    }

    /// Multiples of powers of ten from the richest set that is not too many; whole decades, or every second or more,
    /// where even those are.
    fn log_ticks(&self, wanted: usize) -> Vec<Tick> {
        const SETS: [&[f64]; 4] =
            [&[1.0, 1.5, 2.0, 3.0, 4.0, 5.0, 6.0, 7.0, 8.0], &[1.0, 2.0, 5.0], &[1.0, 3.0], &[1.0]];
        let (first, last) = (self.low.log10().floor() as i32, self.high.log10().ceil() as i32);
        // Two more than asked for do no harm, and a richer set reads better.
        let max = wanted.max(1) + 2;
        let inside = |multiples: &[f64]| -> Vec<f64> {
            // Whole powers of ten around the axis; the filter below cuts what lies outside.
            (first..=last)
                .flat_map(|e| multiples.iter().map(move |m| m * 10_f64.powi(e)))
                // A tick at the end of the axis may differ from it by rounding.
                .filter(|x| (self.low * 0.999..=self.high * 1.001).contains(x))
                .collect()
        };
        let fitting = SETS.into_iter().map(inside).find(|values| values.len() <= max);
        let values = fitting.unwrap_or_else(|| {
            let decades = inside(SETS[3]);
            let every = decades.len().div_ceil(max);
            decades.into_iter().step_by(every).collect()
        });
        // One tick tells no scale: the ends of the axis stand in.
        if values.len() < 2 {
            let round = |x: f64| Tick { value: x, label: format::significant(x, 3) };
            return vec![round(self.low), round(self.high)];
        }
        values.into_iter().map(|value| Tick { value, label: format::round_number(value) }).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ticks_are_round_and_inside() {
        let labels = |s: Scale| s.ticks(5).into_iter().map(|t| t.label).collect::<Vec<_>>();
        assert_eq!(
            labels(Scale::linear(Some((0.0, 1.0)), 0.0, 1.0)),
            ["0.0", "0.2", "0.4", "0.6", "0.8", "1.0"]
        );
        assert_eq!(labels(Scale::linear(Some((-0.03, 0.021)), 0.0, 1.0)), ["−0.02", "0.00", "0.02"]);
        assert_eq!(labels(Scale::log(0.5, 2000.0, 0.0, 1.0)), ["1", "3", "10", "30", "100", "300", "1000"]);
        assert_eq!(labels(Scale::log(0.3, 2.4, 0.0, 1.0)), ["0.5", "1", "2"]);
        assert_eq!(labels(Scale::log(1.4, 2.1, 0.0, 1.0)), ["1.5", "2"]);
        assert!(Scale::log(1e-140, 1e140, 0.0, 1.0).ticks(5).len() <= 8);
        for (low, high) in [(1e9, 1e9), (0.0, 0.0), (-1e308, 1e308), (1e-9, 2e-9), (1e9, 1e9 + 1e-3)] {
            let scale = Scale::linear(Some((low, high)), 0.0, 100.0);
            let ticks = scale.ticks(5);
            assert!(ticks.len() <= 21);
            assert!(ticks.iter().all(|t| (-1.0..=101.0).contains(&scale.at(t.value))), "{low} {high}");
        }
    }

    #[test]
    fn positions_are_where_they_belong() {
        let scale = Scale::linear(Some((0.0, 4.0)), 100.0, 0.0);
        assert_eq!(scale.at(1.0), 75.0);
        let scale = Scale::log(1.0, 100.0, 0.0, 10.0);
        assert!((scale.at(10.0) - 5.0).abs() < 1e-12);
        assert!(scale.at(0.0).is_finite());
    }
}
