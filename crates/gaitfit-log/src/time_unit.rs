//! The unit of a time column: seconds, or one of the units that recorders write integers in.

use crate::scale::typical_step;
use crate::stats::short;
use serde::Serialize;

/// Unit of a time column.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum TimeUnit {
    /// s
    Seconds,
    /// ms
    Milliseconds,
    /// µs
    Microseconds,
    /// ns
    Nanoseconds,
}

impl TimeUnit {
    /// All of them, the coarsest first.
    pub const ALL: [TimeUnit; 4] =
        [TimeUnit::Seconds, TimeUnit::Milliseconds, TimeUnit::Microseconds, TimeUnit::Nanoseconds];

    /// Units in a second.
    pub fn per_second(self) -> f64 {
        match self {
            TimeUnit::Seconds => 1.0,
            TimeUnit::Milliseconds => 1e3,
            TimeUnit::Microseconds => 1e6,
            TimeUnit::Nanoseconds => 1e9,
        }
    }

    /// Name of a column in this unit; `time` alone says none.
    pub(crate) fn column(self) -> &'static str {
        match self {
            TimeUnit::Seconds => "time_s",
            TimeUnit::Milliseconds => "time_ms",
            TimeUnit::Microseconds => "time_us",
            TimeUnit::Nanoseconds => "time_ns",
        }
    }
}

impl std::fmt::Display for TimeUnit {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            TimeUnit::Seconds => "seconds",
            TimeUnit::Milliseconds => "milliseconds",
            TimeUnit::Microseconds => "microseconds",
            TimeUnit::Nanoseconds => "nanoseconds",
        })
    }
}

/// A time column in another unit than seconds. The reader has converted it.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct ConvertedTime {
    /// The file's unit.
    pub unit: TimeUnit,
    /// The reason for taking this unit.
    pub because: String,
}

/// Sample rates that a log may have, Hz.
const POSSIBLE_HZ: (f64, f64) = (1.0, 10_000.0);
/// Sample rates that logs of joints usually have, Hz. A factor of 100 apart, so that two units never both fit.
const USUAL_HZ: (f64, f64) = (10.0, 1000.0);
/// Relative error of a rate that still tells units apart.
const NEAR: f64 = 0.4;
/// Unix times between the years 2001 and 2128, s: the same numbers in another unit are not of this century.
const UNIX_S: (f64, f64) = (1e9, 5e9);

/// The unit of `time`, the values of a column that does not name its unit; `None`: seconds.
///
/// `rate_hz`: the rate that the log states. `velocity_over_derivative`: how many times the recorded velocities are the
/// derivative of the positions by this clock, where the joints move.
///
/// # Errors
/// In words: values that could be in several units, with the remedy.
pub fn recognise(
    time: &[f64],
    rate_hz: Option<f64>,
    velocity_over_derivative: impl FnOnce() -> Option<f64>,
) -> Result<Option<ConvertedTime>, String> {
    // A clock that stands still has no unit to recognise.
    let Some(step) = usual_step(time) else { return Ok(None) };
    let rate = |unit: TimeUnit| unit.per_second() / step;
    let within = |rate: f64, (low, high): (f64, f64)| (low..=high).contains(&rate);
    let possible = |unit: &TimeUnit| within(rate(*unit), POSSIBLE_HZ);
    let near = |ratio: f64| (1.0 - NEAR..=1.0 + NEAR).contains(&ratio);
    let as_found = |unit: TimeUnit, because: String| {
        Ok((unit != TimeUnit::Seconds).then_some(ConvertedTime { unit, because }))
    };

    // Evidence in the order of its strength: a stated rate, a usual interval, the velocities, usual rates, Unix
    // times.
    if let Some(stated) = rate_hz {
        let unit = TimeUnit::ALL.into_iter().filter(possible).find(|unit| near(rate(*unit) / stated));
        if let Some(unit) = unit {
            return as_found(unit, format!("the log states {} Hz", short(stated)));
        }
    }
    // Less than 0.14 s apart in seconds: a usual log.
    if step < 1.0 / USUAL_HZ.0 * (1.0 + NEAR) {
        return Ok(None);
    }
    // Computed only here, because it looks at all samples.
    let factor = velocity_over_derivative();
    if let Some(factor) = factor {
        let fits = |unit: &TimeUnit| near(factor / unit.per_second());
        if let Some(unit) = TimeUnit::ALL.into_iter().filter(possible).find(fits) {
            let because = format!(
                "the velocities are {} times the derivative of the positions by this clock",
                short(factor)
            );
            return as_found(unit, because);
        }
    }
    let apart = format!("its samples are {} apart", short(step));
    // Steps of exactly 1 may be numbers of samples, so no unit is taken for them.
    let counts = step == 1.0;
    let usual = TimeUnit::ALL.into_iter().find(|unit| within(rate(*unit), USUAL_HZ));
    if let (Some(unit), false) = (usual, counts) {
        return as_found(unit, format!("{apart}, {} Hz", short(rate(unit))));
    }
    let unix = |unit: &TimeUnit| within(time[0] / unit.per_second(), UNIX_S);
    if let Some(unit) = TimeUnit::ALL.into_iter().filter(possible).find(unix) {
        return as_found(unit, format!("{apart}, and as Unix times they are of this century"));
    }
    // A stated rate that fits no unit is for the checks to report.
    if step < 1.0 || rate_hz.is_some() {
        return Ok(None);
    }
    let readings: Vec<String> = TimeUnit::ALL
        .into_iter()
        .filter(possible)
        .map(|unit| format!("{unit} ({} Hz)", short(rate(unit))))
        .collect();
    let what = match (counts, readings.is_empty()) {
        (true, _) => format!("{apart}. It may count samples, or be in {}", readings.join(" or ")),
        (false, true) => {
            format!("{apart}, which is no sample interval in any unit from seconds to nanoseconds")
        }
        (false, false) => format!("{apart}. It may be in {}", readings.join(" or ")),
    };
    // A count of samples has no unit, but velocities may show its rate.
    let velocities = factor
        .filter(|_| counts)
        .map_or(String::new(), |factor| format!(" The velocities fit {} samples a second.", short(factor)));
    Err(format!(
        "the unit of `time` is not clear: {what}.{velocities} State the rate as `# rate_hz = 200` above the header, or \
         name the column `time_s`, `time_ms`, `time_us` or `time_ns`"
    ))
}

/// The interval between samples; of stamps that stand still for several rows the mean one.
fn usual_step(time: &[f64]) -> Option<f64> {
    let standing = time.windows(2).filter(|pair| pair[0] == pair[1]).count();
    // Where more than one row of 20 repeats its stamp, the median interval is that of the ticks, or 0.
    if standing * 20 <= time.len() {
        return typical_step(time);
    }
    let (first, last) = (time.first()?, time.last()?);
    let mean = (last - first) / (time.len() - 1) as f64;
    (mean.is_finite() && mean > 0.0).then_some(mean)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn column(step: f64) -> Vec<f64> {
        (0..50).map(|i| f64::from(i) * step).collect()
    }

    fn unit(step: f64, rate_hz: Option<f64>, factor: Option<f64>) -> Result<Option<TimeUnit>, String> {
        recognise(&column(step), rate_hz, || factor)
            .map(|converted| converted.map(|converted| converted.unit))
    }

    #[test]
    fn usual_rates_tell_the_unit() {
        for (step, want) in [
            (0.02, None),
            (0.002, None),
            (0.5, None),
            (5.0, Some(TimeUnit::Milliseconds)),
            (20.0, Some(TimeUnit::Milliseconds)),
            (5e3, Some(TimeUnit::Microseconds)),
            (5e6, Some(TimeUnit::Nanoseconds)),
            (2e7, Some(TimeUnit::Nanoseconds)),
        ] {
            assert_eq!(unit(step, None, None), Ok(want), "{step}");
        }
    }

    #[test]
    fn a_stated_rate_tells_the_unit() {
        assert_eq!(unit(500.0, Some(2000.0), None), Ok(Some(TimeUnit::Microseconds)));
        assert_eq!(unit(500.0, Some(2.0), None), Ok(Some(TimeUnit::Milliseconds)));
        assert_eq!(unit(1.0, Some(1.0), None), Ok(None));
        assert_eq!(unit(1.0, Some(1000.0), None), Ok(Some(TimeUnit::Milliseconds)));
        // No unit fits: the checks say so.
        assert_eq!(unit(1.0, Some(50.0), None), Ok(None));
    }

    #[test]
    fn velocities_tell_the_unit() {
        assert_eq!(unit(0.5, None, Some(1010.0)), Ok(Some(TimeUnit::Milliseconds)));
        assert_eq!(unit(500.0, None, Some(0.98e6)), Ok(Some(TimeUnit::Microseconds)));
        assert_eq!(unit(1.0, None, Some(1.01)), Ok(None));
        assert_eq!(unit(1.0, None, Some(950.0)), Ok(Some(TimeUnit::Milliseconds)));
    }

    #[test]
    fn unix_times_tell_the_unit() {
        let time: Vec<f64> = (0..50).map(|i| 1.76e15 + f64::from(i) * 500.0).collect();
        let unit = recognise(&time, None, || None).map(|converted| converted.map(|converted| converted.unit));
        assert_eq!(unit, Ok(Some(TimeUnit::Microseconds)));
    }

    #[test]
    fn what_is_not_clear_is_refused() {
        for (step, factor, parts) in [
            (
                1.0,
                None,
                &["It may count samples, or be in seconds (1 Hz) or milliseconds (1000 Hz)", "time_ms"][..],
            ),
            (1.0, Some(200.0), &["It may count samples", "The velocities fit 200 samples a second"]),
            (500.0, None, &["milliseconds (2 Hz) or microseconds (2000 Hz)", "# rate_hz = 200"]),
            (5e12, None, &["5e12 apart, which is no sample interval"]),
        ] {
            let text = unit(step, None, factor).map_or_else(|text| text, |unit| format!("{unit:?}"));
            assert!(parts.iter().all(|part| text.contains(part)), "{step}: {text}");
        }
        // Time that stands still is another reader's matter.
        assert_eq!(unit(0.0, None, None), Ok(None));
    }
}
