//! Checks of a stream's times.

use crate::ImportError;
use crate::known::PER_JOINT;
use crate::table::Table;
use gaitfit_model::shown_number;
use serde::Serialize;

/// An interval this many times the middle one has lost samples.
const GAP: f64 = 1.5;
/// More samples out of order than this share are no clock.
const DISORDER: f64 = 0.05;
/// RMS deviation of the intervals, relative to the middle one, that is worth a word.
const JITTER: f64 = 0.2;

/// What is noteworthy about a stream's clock.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum ClockFinding {
    /// Samples came out of order and were sorted.
    Disorder {
        /// How many.
        samples: usize,
    },
    /// Samples with the time of the one before were dropped.
    Repeated {
        /// How many.
        samples: usize,
    },
    /// Samples are missing.
    Gaps {
        /// How many gaps.
        gaps: usize,
        /// About how many samples are missing.
        lost: usize,
        /// The longest, s.
        longest_s: f64,
        /// When it begins, s.
        at_s: f64,
    },
    /// Intervals vary.
    Jitter {
        /// RMS deviation from the middle interval, s.
        rms_s: f64,
    },
}

impl std::fmt::Display for ClockFinding {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            ClockFinding::Disorder { samples } => write!(f, "{samples} samples out of order, sorted by time"),
            ClockFinding::Repeated { samples } => {
                write!(f, "{samples} samples repeat the time of the one before, dropped")
            }
            ClockFinding::Gaps { gaps, lost, longest_s, at_s } => write!(
                f,
                "{gaps} gap(s), about {lost} samples lost, the longest {} s after {} s",
                shown_number(*longest_s),
                shown_number(*at_s)
            ),
            ClockFinding::Jitter { rms_s } => {
                write!(f, "intervals vary by {} ms RMS", shown_number(rms_s * 1e3))
            }
        }
    }
}

/// A stream as it was read.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StreamReport {
    /// Topic, file or group of columns.
    pub name: String,
    /// Which clock its times are of.
    pub clock: &'static str,
    /// Samples.
    pub samples: usize,
    /// 1 / middle interval, Hz; 0 with one sample.
    pub rate_hz: f64,
    /// First and last time, s.
    pub span_s: [f64; 2],
    /// What was taken from it, such as `q` or `qdes`.
    pub quantities: Vec<String>,
    /// What is noteworthy about its clock.
    pub findings: Vec<ClockFinding>,
}

/// Puts a table's rows into the order of time, each time once, and says what was wrong.
pub(crate) fn clean(table: &mut Table) -> Result<StreamReport, ImportError> {
    let refuse = |problem: String| Err(ImportError::Clock { stream: table.name.clone(), problem });
    let samples = table.time.len();
    if samples == 0 {
        return refuse("no samples".into());
    }
    if let Some(bad) = table.time.iter().position(|time| !time.is_finite()) {
        return refuse(format!("sample {bad} has no time"));
    }
    let mut findings = Vec::new();
    let mut latest = f64::NEG_INFINITY;
    let disorder = table
        .time
        .iter()
        .filter(|time| {
            let behind = **time < latest;
            latest = latest.max(**time);
            behind
        })
        .count();
    if disorder as f64 > DISORDER * samples as f64 {
        return refuse(format!(
            "{disorder} of {samples} samples are earlier than one before them: that is no clock; cut the recording where it \
             jumps, or name another time column"
        ));
    }
    let mut order: Vec<usize> = (0..samples).collect();
    if disorder > 0 {
        order.sort_by(|a, b| table.time[*a].total_cmp(&table.time[*b]));
        findings.push(ClockFinding::Disorder { samples: disorder });
    }
    let before = order.len();
    order.dedup_by(|later, earlier| table.time[*later] == table.time[*earlier]);
    if order.len() < before {
        findings.push(ClockFinding::Repeated { samples: before - order.len() });
    }
    if disorder > 0 || order.len() < before {
        let pick = |values: &mut Vec<f64>| {
            *values = order.iter().filter_map(|row| values.get(*row).copied()).collect()
        };
        pick(&mut table.time);
        table.columns.values_mut().for_each(pick);
    }
    if table.time.len() < 2 && samples > 1 {
        return refuse("all samples have one time; name another time column".into());
    }
    let mut steps: Vec<f64> = table.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let typical = typical(&mut steps.clone());
    if let Some(step) = typical {
        let gaps: Vec<usize> = (0..steps.len()).filter(|i| steps[*i] > GAP * step).collect();
        if let Some(longest) = gaps.iter().copied().max_by(|a, b| steps[*a].total_cmp(&steps[*b])) {
            findings.push(ClockFinding::Gaps {
                gaps: gaps.len(),
                // A cast saturates: a damaged time may lie centuries away.
                lost: gaps.iter().map(|i| (steps[*i] / step).round() - 1.0).sum::<f64>() as usize,
                longest_s: steps[longest],
                at_s: table.time[longest],
            });
        }
        steps.retain(|interval| *interval <= GAP * step);
        let sum: f64 = steps.iter().map(|interval| (interval - step).powi(2)).sum();
        let rms = (sum / steps.len().max(1) as f64).sqrt();
        if rms > JITTER * step {
            findings.push(ClockFinding::Jitter { rms_s: rms });
        }
    }
    let mut quantities: Vec<String> = Vec::new();
    for name in table.columns.keys() {
        let quantity = match name.split_once('_') {
            Some((prefix, _)) if PER_JOINT.contains(&prefix) => prefix.to_owned(),
            _ => name.clone(),
        };
        if !quantities.contains(&quantity) {
            quantities.push(quantity);
        }
    }
    Ok(StreamReport {
        name: table.name.clone(),
        clock: table.clock,
        samples: table.time.len(),
        rate_hz: typical.map_or(0.0, |step| 1.0 / step),
        span_s: [table.time[0], table.time[table.time.len() - 1]],
        quantities,
        findings,
    })
}

/// The middle of the intervals, if there are some.
pub(crate) fn typical(steps: &mut [f64]) -> Option<f64> {
    let middle = steps.len() / 2;
    if steps.is_empty() {
        return None;
    }
    let (_, step, _) = steps.select_nth_unstable_by(middle, f64::total_cmp);
    (*step > 0.0).then_some(*step)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(time: &[f64]) -> Table {
        let columns = [("q_a".to_owned(), time.iter().map(|t| 10.0 * t).collect())].into_iter().collect();
        Table { name: "/joints".into(), time: time.to_vec(), columns, ..Table::default() }
    }

    #[test]
    fn clocks_are_put_right_and_what_was_wrong_is_said() -> Result<(), ImportError> {
        let mut time: Vec<f64> = (0..100).map(|i| f64::from(i) / 50.0).collect();
        time.swap(10, 11);
        time[30] = time[29];
        time.drain(60..65);
        let mut table = table(&time);
        let report = clean(&mut table)?;
        assert!(table.time.windows(2).all(|pair| pair[1] > pair[0]));
        assert_eq!(table.columns["q_a"], table.time.iter().map(|t| 10.0 * t).collect::<Vec<_>>());
        assert_eq!(report.samples, 94);
        assert!((report.rate_hz - 50.0).abs() < 1e-9);
        let kinds: Vec<bool> = vec![
            matches!(report.findings[0], ClockFinding::Disorder { samples: 1 }),
            matches!(report.findings[1], ClockFinding::Repeated { samples: 1 }),
            matches!(report.findings[2], ClockFinding::Gaps { gaps: 2, lost: 6, .. }),
        ];
        assert_eq!(kinds, [true; 3], "{:?}", report.findings);
        Ok(())
    }

    #[test]
    fn gaps_of_centuries_are_counted() -> Result<(), ImportError> {
        let report = clean(&mut table(&[0.0, 0.01, 0.02, 0.03, 0.04, 1e300, 1.5e300]))?;
        assert!(
            matches!(report.findings[0], ClockFinding::Gaps { lost: usize::MAX, .. }),
            "{:?}",
            report.findings
        );
        Ok(())
    }

    #[test]
    fn what_is_no_clock_is_refused() {
        let backward: Vec<f64> = (0..100).map(|i| -f64::from(i)).collect();
        for (time, part) in [
            (&backward[..], "that is no clock"),
            (&[1.0; 5], "one time"),
            (&[0.0, f64::NAN], "sample 1 has no time"),
            (&[], "no samples"),
        ] {
            let text = clean(&mut table(time))
                .map_or_else(|error| error.to_string(), |report| format!("{report:?}"));
            assert!(text.contains(part), "{text}");
        }
    }
}
