//! Checks of a stream's times.

use crate::ImportError;
use crate::known::PER_JOINT;
use crate::table::Table;
use gaitfit_log::{EvenRows, Lost, Spacing, Stamps, is_news, look_at_stamps, rate_of_velocities, spacing};
use gaitfit_model::shown_number;
use serde::Serialize;

/// More samples out of order than this share are no clock.
const DISORDER: f64 = 0.05;
/// A sample so much earlier than one before it, s, was not late on its way: its time is damaged.
const FAR_BACK_S: f64 = 0.5;
/// RMS deviation of the intervals, relative to the middle one, that is worth a word.
const JITTER: f64 = 0.2;

/// A notable fact about a stream's clock.
#[derive(Clone, Debug, PartialEq, Serialize)]
#[serde(tag = "kind", rename_all = "snake_case")]
#[non_exhaustive]
pub enum ClockFinding {
    /// Samples came out of order and were sorted.
    Disorder {
        /// Number of samples.
        samples: usize,
    },
    /// Samples with the time of the one before were dropped.
    Repeated {
        /// Number of samples.
        samples: usize,
    },
    /// Samples with the time of the one before and other values were placed between their neighbours.
    Late {
        /// Number of samples.
        samples: usize,
    },
    /// Stamps had lost their digits, and rows were spaced evenly.
    Coarse {
        /// The fault, and the even times.
        even: EvenRows,
    },
    /// Samples are missing.
    Gaps {
        /// Number of gaps.
        gaps: usize,
        /// About how many samples are missing.
        lost: usize,
        /// The longest, s.
        longest_s: f64,
        /// Time at which it begins, s.
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
                write!(f, "{samples} samples repeat the time and the values of the one before, dropped")
            }
            ClockFinding::Late { samples } => write!(
                f,
                "{samples} samples have the time of the one before and new values, placed between their neighbours"
            ),
            ClockFinding::Coarse { even } => write!(f, "{even}"),
            ClockFinding::Gaps { gaps, lost, longest_s, at_s } => write!(
                f,
                "{gaps} gap(s), about {lost} samples lost, the longest {} s after {} s",
                shown_number(*longest_s),
                shown_number(*at_s)
            ),
            ClockFinding::Jitter { rms_s } => {
                write!(f, "jitter: intervals vary by {} ms RMS", shown_number((rms_s * 1e6).round() / 1e3))
            }
        }
    }
}

/// A stream as it was read.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct StreamReport {
    /// Topic, file or group of columns.
    pub name: String,
    /// The clock of its times.
    pub clock: &'static str,
    /// Samples.
    pub samples: usize,
    /// 1 / middle interval, Hz; 0 with one sample.
    pub rate_hz: f64,
    /// First and last time, s.
    pub span_s: [f64; 2],
    /// Quantities that were taken from it, such as `q` or `qdes`.
    pub quantities: Vec<String>,
    /// Notable facts about its clock.
    pub findings: Vec<ClockFinding>,
}

/// A clock that cannot be used.
fn refused(table: &Table, problem: String) -> ImportError {
    ImportError::Clock { stream: table.name.clone(), problem }
}

/// Puts a table's rows into the order of time; samples that were earlier than one before them.
fn sort(table: &mut Table) -> Result<usize, ImportError> {
    let samples = table.time.len();
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
        return Err(refused(
            table,
            format!(
                "{disorder} of {samples} samples are earlier than one before them: that is no clock; cut the recording where \
                 it jumps, or name another time column"
            ),
        ));
    }
    if disorder > 0 {
        // A little disorder is sorted; one stamp far back is damaged, and sorting would move its row to
        // another place.
        let mut latest = f64::NEG_INFINITY;
        for (row, &time) in table.time.iter().enumerate() {
            if latest - time > FAR_BACK_S {
                let problem = format!(
                    "sample {} is at {:.3} s, after one at {:.3} s: its time is damaged; correct it or delete the row, or cut the \
                     recording where its clock jumps",
                    row + 1,
                    time,
                    latest
                );
                return Err(refused(table, problem));
            }
            latest = latest.max(time);
        }
        // A stable sort: rows of one time stay in the order in which they came.
        let mut order: Vec<usize> = (0..samples).collect();
        order.sort_by(|a, b| table.time[*a].total_cmp(&table.time[*b]));
        table.pick(&order);
    }
    Ok(disorder)
}

/// Spaces rows evenly whose stamps are too coarse; whether it could.
fn space(table: &mut Table, rate_hz: Option<f64>) -> Result<Option<ClockFinding>, ImportError> {
    // The stated rate is that of the joints' positions; other streams may have it too.
    let is_state = table.columns.keys().any(|name| name.starts_with("q_"));
    let look = |rate_hz| look_at_stamps(&table.time, rate_hz, |row| is_new(table, row));
    let stamps = match look(rate_hz.filter(|_| is_state)) {
        Stamps::Lost(..) if !is_state => look(rate_hz),
        other => other,
    };
    match stamps {
        Stamps::Fine => Ok(None),
        Stamps::Even(times, even) => {
            table.time = times;
            Ok(Some(ClockFinding::Coarse { even }))
        }
        // Only quantities that are sampled all the time need their spacing; a command may come at any time.
        Stamps::Lost(coarse, why) if is_sampled(table) => {
            let hint = velocity_rate(table).map_or(String::new(), |rate| {
                format!("; the velocities fit about {} rows a second", shown_number(rate))
            });
            let problem = format!(
                "{coarse}. {why}{hint}. Give the rate at which the rows were sampled (`--rate 200`, `rate_hz` in a mapping \
                 file): they are then spaced evenly"
            );
            Err(refused(table, problem))
        }
        Stamps::Lost(..) => Ok(None),
    }
}

/// Returns gaps and jitter of rows at `time`.
fn spacing_findings(time: &[f64], spacing: &Spacing) -> Vec<ClockFinding> {
    let mut findings = Vec::new();
    let length = |lost: &&Lost| time[lost.after + 1] - time[lost.after];
    if let Some(longest) = spacing.lost.iter().max_by(|a, b| length(a).total_cmp(&length(b))) {
        findings.push(ClockFinding::Gaps {
            gaps: spacing.lost.len(),
            lost: spacing.count(),
            longest_s: length(&longest),
            at_s: time[longest.after],
        });
    }
    if spacing.jitter > JITTER * spacing.step {
        findings.push(ClockFinding::Jitter { rms_s: spacing.jitter });
    }
    findings
}

/// Returns the quantities of a table; the columns of all joints together are one quantity.
fn quantities(table: &Table) -> Vec<String> {
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
    quantities
}

/// Puts a table's rows into the order of time, each row at a time of its own, and says what was wrong. `rate_hz`: the rate
/// that is stated for the rows of the positions, if one is.
pub(crate) fn clean(table: &mut Table, rate_hz: Option<f64>) -> Result<StreamReport, ImportError> {
    let samples = table.time.len();
    if samples == 0 {
        return Err(refused(table, "no samples".into()));
    }
    if let Some(bad) = table.time.iter().position(|time| !time.is_finite()) {
        return Err(refused(table, format!("sample {bad} has no time")));
    }
    let mut findings = Vec::new();
    // Order matters: rows are sorted, then spaced, then repeated ones are dropped, and the rest placed
    // between neighbours.
    let disorder = sort(table)?;
    if disorder > 0 {
        findings.push(ClockFinding::Disorder { samples: disorder });
    }
    findings.extend(space(table, rate_hz)?);
    let new: Vec<usize> = (0..table.time.len())
        .filter(|row| *row == 0 || table.time[*row] != table.time[row - 1] || is_new(table, *row))
        .collect();
    if new.len() < table.time.len() {
        findings.push(ClockFinding::Repeated { samples: table.time.len() - new.len() });
        table.pick(&new);
    }
    if table.time.len() < 2 && samples > 1 {
        return Err(refused(table, "all samples have one time; name another time column".into()));
    }
    let placed = place_between(&mut table.time);
    if placed > 0 {
        findings.push(ClockFinding::Late { samples: placed });
    }
    // Gaps and jitter are judged at last, on the times that the log will have.
    let spacing = spacing(&table.time);
    if let Some(spacing) = &spacing {
        findings.extend(spacing_findings(&table.time, spacing));
    }
    Ok(StreamReport {
        name: table.name.clone(),
        clock: table.clock,
        samples: table.time.len(),
        rate_hz: spacing.map_or(0.0, |spacing| 1.0 / spacing.step),
        span_s: [table.time[0], table.time[table.time.len() - 1]],
        quantities: quantities(table),
        findings,
    })
}

/// Whether the values of `row` differ from those of the row before.
fn is_new(table: &Table, row: usize) -> bool {
    table.columns.values().any(|column| match (column.get(row), column.get(row - 1)) {
        (Some(own), Some(before)) => is_news(*own, *before),
        _ => false,
    })
}

/// Whether a table holds what is sampled at a rate, and whose times matter: joints, not commands.
fn is_sampled(table: &Table) -> bool {
    let of_joint =
        |name: &String| ["q_", "dq_", "qdes_", "act_"].iter().any(|prefix| name.starts_with(prefix));
    table.columns.keys().any(of_joint)
}

/// Rows a second by the velocities of a table.
fn velocity_rate(table: &Table) -> Option<f64> {
    let joints: Vec<&str> = table.columns.keys().filter_map(|name| name.strip_prefix("q_")).collect();
    let values = |prefix: &str| -> Option<Vec<f64>> {
        let columns: Option<Vec<&Vec<f64>>> =
            joints.iter().map(|joint| table.columns.get(&format!("{prefix}{joint}"))).collect();
        let columns = columns.filter(|columns| !columns.is_empty())?;
        Some((0..table.time.len()).flat_map(|row| columns.iter().map(move |column| column[row])).collect())
    };
    let rate = rate_of_velocities(&values("q_")?, &values("dq_")?, joints.len())?;
    Some((10.0 * rate).round() / 10.0)
}

/// Gives rows that share a time, which was that of the last of them, times between the row before and it. Returns how many.
fn place_between(time: &mut [f64]) -> usize {
    let mut placed = 0;
    let mut row = 1;
    // Runs of equal times; their last row keeps the time.
    while row < time.len() {
        let mut end = row;
        while end < time.len() && time[end] == time[row - 1] {
            end += 1;
        }
        let shared = end - row;
        if shared > 0 {
            placed += shared;
            let (first, at) = (row - 1, time[row - 1]);
            let usual = || (time[time.len() - 1] - time[0]) / (time.len() - 1).max(1) as f64;
            // Before the first row there is no neighbour: the mean interval stands in for it.
            let before = if first > 0 { time[first - 1] } else { at - (shared + 1) as f64 * usual() };
            for (number, slot) in time[first..end].iter_mut().enumerate() {
                *slot = before + (at - before) * (number + 1) as f64 / (shared + 1) as f64;
            }
        }
        row = end + 1;
    }
    placed
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
        let report = clean(&mut table, None)?;
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
        let report = clean(&mut table(&[0.0, 0.01, 0.02, 0.03, 0.04, 1e300, 1.5e300]), None)?;
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
            let text = clean(&mut table(time), None)
                .map_or_else(|error| error.to_string(), |report| format!("{report:?}"));
            assert!(text.contains(part), "{text}");
        }
    }
}
