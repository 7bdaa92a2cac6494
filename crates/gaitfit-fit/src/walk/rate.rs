//! Logs at the policy's rate.

use crate::Error;
use gaitfit_log::{LogError, Regular, Trajectory};

/// Rates this close, relative, are the same.
const SAME: f64 = 0.02;
/// A pause between two samples this long, s, is a gap, not jitter.
pub const LONG_GAP_S: f64 = 0.1;

/// Refuses a log that is slower than the policy.
pub fn check(rate_hz: f64, control_dt: f64, shown: &str) -> Result<(), Error> {
    let needed = 1.0 / control_dt;
    if rate_hz < needed * (1.0 - SAME) {
        return Err(Error::failed(format!(
            "{shown}: the log has {rate_hz} samples a second, the policy acts {needed} times: actions are missing. \
             Record every step of the policy next time."
        )));
    }
    Ok(())
}

/// The different rates, Hz, rising, for a message.
pub fn text(rates: impl Iterator<Item = f64>) -> String {
    let mut rates: Vec<f64> = rates.collect();
    rates.sort_by(f64::total_cmp);
    // Sorted before, so that rates that are nearly equal are neighbours.
    rates.dedup_by(|a, b| (*a / *b - 1.0).abs() < SAME);
    rates.iter().map(|rate| format!("{rate:.4}")).collect::<Vec<_>>().join(", ")
}

/// The same run with one sample a control period. A log of about that rate keeps its rows, with lost ones filled, and
/// measurements moved to even times where they were sampled at uneven ones. A faster log begins where its actions change,
/// so that a sample holds the state in which the action was chosen.
///
/// # Errors
/// A trajectory that cannot be resampled.
pub fn to_control(log: &Trajectory, control_dt: f64) -> Result<Regular, LogError> {
    let needed = 1.0 / control_dt;
    let ratio = log.rate_hz / needed;
    if (ratio - 1.0).abs() <= SAME {
        let mut same = log.regular()?;
        // A sample a step, whatever its clock says.
        let start = log.time.first().copied().unwrap_or_default();
        let rows = same.trajectory.len();
        same.trajectory.rate_hz = needed;
        same.trajectory.time = (0..rows).map(|sample| start + sample as f64 * control_dt).collect();
        return Ok(same);
    }
    // An action that is stamped a little after the new sample's time was chosen there.
    let early = if ratio > 1.0 { 0.5 * log.dt() } else { 0.0 };
    let trajectory = log.slice(first_change(log, ratio)..log.len())?.resample_early(needed, early)?;
    // Rows within a gap of the faster log. A gap shorter than half a control period loses no row.
    let gap = (1.5 * log.dt()).max(0.5 * control_dt);
    let in_gap = |at: f64| {
        // 1e-9 s is rounding of the new times: a row that falls on a sample counts as behind it.
        let next = log.time.partition_point(|time| *time <= at + 1e-9);
        next > 0
            && log.time.get(next).is_some_and(|later| {
                let before = log.time[next - 1];
                // A row at the last sample before a gap has that sample's values.
                later - before > gap && at - before > 0.25 * log.dt()
            })
    };
    let filled = (0..trajectory.len()).filter(|row| in_gap(trajectory.time[*row])).collect();
    Ok(Regular { trajectory, filled, moved: false })
}

/// Sample of the first control period: that at which actions change most often, of every `ratio` samples.
fn first_change(log: &Trajectory, ratio: f64) -> usize {
    let Some(action) = &log.action else { return 0 };
    let period = ratio.round().max(1.0) as usize;
    let width = log.joints.len();
    let mut changes = vec![0usize; period];
    for sample in 1..log.len() {
        let row = |sample: usize| &action[sample * width..(sample + 1) * width];
        if row(sample) != row(sample - 1) {
            // By time, so that lost samples and rates that are no multiple do not move it.
            let passed = (log.time[sample] - log.time[0]) * log.rate_hz;
            changes[(passed % ratio).round() as usize % period] += 1;
        }
    }
    let max = changes.iter().copied().max().unwrap_or(0);
    if max == 0 { 0 } else { changes.iter().position(|&count| count == max).unwrap_or(0).min(log.len() - 1) }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    /// At 500 Hz, actions held for ten samples from `first` on; position counts samples.
    fn fast(first: usize, rate_hz: f64) -> Trajectory {
        let samples = 200;
        let time: Vec<f64> = (0..samples).map(|k| 3.0 + k as f64 / rate_hz).collect();
        let count: Vec<f64> = (0..samples).map(|k| k as f64).collect();
        Trajectory {
            source: None,
            robot: None,
            joints: vec!["knee".into()],
            time,
            rate_hz,
            velocity: count.clone(),
            action: Some((0..samples).map(|k| ((k + 10 - first) / 10) as f64).collect()),
            position: count,
            target: None,
            command: None,
            motion: None,
            base: None,
            gains: None,
            lead: None,
            simulated_step: None,
            velocity_joints: Vec::new(),
            fell: false,
        }
    }

    #[test]
    fn a_fast_log_is_taken_where_its_actions_change() {
        for first in [0, 3, 9] {
            let log = to_control(&fast(first, 500.0), 0.02).unwrap().trajectory;
            assert_eq!(log.rate_hz, 50.0);
            let expected: Vec<f64> = (0..log.len()).map(|k| (first + 10 * k) as f64).collect();
            for (found, expected) in log.position.iter().zip(&expected) {
                assert!((found - expected).abs() < 1e-6, "{found} {expected}");
            }
            let action = log.action.unwrap();
            assert!(action.windows(2).all(|pair| pair[1] == pair[0] + 1.0), "{action:?}");
        }
    }

    #[test]
    fn rows_within_a_gap_of_a_faster_log_are_named() {
        let whole = fast(0, 500.0);
        let keep = |samples: std::ops::Range<usize>| whole.slice(samples).unwrap();
        let (mut lost, end) = (keep(0..97), keep(112..200));
        lost.time.extend(end.time);
        lost.position.extend(end.position);
        lost.velocity.extend(end.velocity);
        lost.action.as_mut().unwrap().extend(end.action.unwrap());
        let resampled = to_control(&lost, 0.02).unwrap();
        // Samples 97 to 111 are missing: the rows of 100 and 110.
        assert_eq!(resampled.filled, [10, 11]);
        assert!(to_control(&whole, 0.02).unwrap().filled.is_empty());
    }

    #[test]
    fn a_log_at_the_rate_keeps_its_samples() {
        let log = to_control(&fast(0, 50.3), 0.02).unwrap().trajectory;
        assert_eq!(log.len(), 200);
        assert!((log.time[199] - 3.0 - 199.0 * 0.02).abs() < 1e-9);
    }

    #[test]
    fn slower_is_refused() {
        assert!(check(49.9, 0.02, "x.csv").is_ok());
        let text = check(20.0, 0.02, "x.csv").unwrap_err().to_string();
        assert!(text.contains("x.csv: the log has 20 samples") && text.contains("50 times"), "{text}");
        assert_eq!(super::text([200.0, 50.0, 50.1].into_iter()), "50.0000, 200.0000");
    }
}
