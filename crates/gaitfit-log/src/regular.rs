//! A log on an even grid: true times of samples are used, lost rows are filled, and what a controller set stays in its row.

use crate::resample::{Places, RESAMPLE_LIMIT};
use crate::spacing::{line, spacing};
use crate::{LogError, Trajectory};
use gaitfit_model::shown_number;

/// Jitter below this share of the interval moves nothing that sensors resolve.
const EVEN: f64 = 0.01;
/// Relative difference of rates that are one.
const SAME_RATE: f64 = 0.005;
/// Share of the stamps' jitter that positions must show before they are taken to have been sampled at their stamps.
const REAL: f64 = 0.5;

/// A log with one row an interval.
#[derive(Clone, Debug, PartialEq)]
pub struct Regular {
    /// Its rows, at even times.
    pub trajectory: Trajectory,
    /// Rows that were lost and are filled: measurements by interpolation, what a controller set by its last value. Rising.
    pub filled: Vec<usize>,
    /// Whether measurements were moved from the times of their stamps to even times. They were not where the positions say
    /// that they were sampled evenly, and only the stamps jitter.
    pub moved: bool,
}

impl Trajectory {
    /// The same run with a row every interval of its own ([`spacing`]). Rows stay what they are, so what a controller set
    /// (targets, actions, commands) is in the row in which it was; only measurements are moved, from the time of their stamp
    /// to that of the row. Rows that were lost are filled. Needs finite, strictly increasing time.
    ///
    /// # Errors
    /// Time that does not increase; gaps too long to be filled.
    pub fn regular(&self) -> Result<Regular, LogError> {
        self.validate()?;
        self.require_increasing_time("regular")?;
        let same = || Regular { trajectory: self.clone(), filled: Vec::new(), moved: false };
        let Some(spacing) = spacing(&self.time) else { return Ok(same()) };
        let step = spacing.step;
        // Jitter alone is no reason to move measurements: stamps may jitter while the robot samples evenly.
        let real = spacing.jitter > EVEN * step && self.is_sampled_at_stamps(step);
        if spacing.lost.is_empty() && !real {
            return Ok(same());
        }
        // As f64: a damaged time may claim more rows than an integer holds.
        let rows = (self.len() as f64) + spacing.lost.iter().map(|lost| lost.samples as f64).sum::<f64>();
        // A row has four signals of each joint, time, command (3) and the base's state (13).
        if rows * (4 * self.joints.len() + 17) as f64 > RESAMPLE_LIMIT {
            return Err(LogError::Range {
                what: "regular",
                problem: format!(
                    "gaps of {} rows cannot be filled; cut the log there",
                    shown_number(rows - self.len() as f64)
                ),
            });
        }
        // The number of each sample's row.
        let mut numbers = Vec::with_capacity(self.len());
        let (mut lost, mut number) = (spacing.lost.iter().peekable(), 0);
        // Lost samples leave numbers out, so that later samples keep their true distance.
        for sample in 0..self.len() {
            numbers.push(number);
            number += 1 + lost.next_if(|lost| lost.after == sample).map_or(0, |lost| lost.samples);
        }
        let rows = numbers.last().map_or(0, |last| last + 1);
        // A line through numbers and times: single stamps that jitter do not move the grid.
        let exact: Vec<f64> = numbers.iter().map(|number| *number as f64).collect();
        let start = line(&exact, &self.time).map_or(self.time[0], |(start, slope)| {
            // The line's middle, at the interval that is used.
            start + (slope - step) * 0.5 * (rows - 1) as f64
        });
        let mut held = Vec::with_capacity(rows);
        let mut measured = Vec::with_capacity(rows);
        let mut filled = Vec::new();
        let mut sample = 0;
        for row in 0..rows {
            while numbers.get(sample + 1).is_some_and(|next| *next <= row) {
                sample += 1;
            }
            // What a controller set stays in its row: `held` counts rows, `measured` times.
            held.push(sample);
            let is_filled = numbers[sample] != row;
            if is_filled {
                filled.push(row);
            }
            measured.push(if real {
                self.place(start + row as f64 * step)
            // A filled row lies between its neighbours, in proportion.
            } else if is_filled {
                let gap = (numbers[sample + 1] - numbers[sample]) as f64;
                (sample, (row - numbers[sample]) as f64 / gap)
            } else {
                (sample, 0.0)
            });
        }
        let time = (0..rows).map(|row| start + row as f64 * step).collect();
        // The stated rate, where it is that of the rows.
        let rate = 1.0 / step;
        let rate_hz = if (rate / self.rate_hz - 1.0).abs() < SAME_RATE { self.rate_hz } else { rate };
        let trajectory = self.at(time, rate_hz, &Places { held, measured, curved: true });
        Ok(Regular { trajectory, filled, moved: real })
    }

    /// The sample at or before a time, and the fraction of the way to the next; before the first sample the first, after the
    /// last the last.
    fn place(&self, at: f64) -> (usize, f64) {
        let before = self.time.partition_point(|time| *time <= at).saturating_sub(1);
        let Some(next) = self.time.get(before + 1) else { return (before, 0.0) };
        let known = self.time[before];
        (before, ((at - known) / (next - known)).clamp(0.0, 1.0))
    }

    /// Whether positions changed by their velocities over the stamps' intervals, not over even ones: the slope of what an
    /// even interval leaves over what the interval's deviation explains is 1 there, and 0 where only stamps jitter.
    fn is_sampled_at_stamps(&self, step: f64) -> bool {
        let width = self.joints.len();
        let (mut explained, mut square) = (0.0, 0.0);
        for sample in 1..self.len() {
            let interval = self.time[sample] - self.time[sample - 1];
            // Over a gap the mean of two velocities is not that of the motion.
            if interval > 2.0 * step {
                continue;
            }
            for joint in 0..width {
                let (now, before) = (sample * width + joint, (sample - 1) * width + joint);
                let speed = 0.5 * (self.velocity[now] + self.velocity[before]);
                let left = self.position[now] - self.position[before] - step * speed;
                let deviation = (interval - step) * speed;
                if left.is_finite() && deviation.is_finite() {
                    explained += left * deviation;
                    square += deviation * deviation;
                }
            }
        }
        square > 0.0 && explained / square > REAL
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BaseState, Lead};

    fn noise(i: usize) -> f64 {
        2.0 * ((i as f64 * 12.9898).sin() * 43_758.547).fract().abs() - 1.0
    }

    /// A swinging joint at 50 Hz with a target that counts rows, sampled at `sampled(row)` and stamped at `stamped(row)`.
    fn log(sampled: impl Fn(usize) -> f64, stamped: impl Fn(usize) -> f64) -> Trajectory {
        let rows = 0..400;
        let swing = |t: f64| 0.5 * (6.0 * t).sin();
        Trajectory {
            target: Some(rows.clone().map(|row| row as f64).collect()),
            base: Some(BaseState::default()),
            lead: Some(Lead { seconds: 0.001, spread: 0.0 }),
            ..Trajectory::of_joints(
                vec!["knee".into()],
                50.0,
                rows.clone().map(&stamped).collect(),
                rows.clone().map(|row| swing(sampled(row))).collect(),
                rows.map(|row| 3.0 * (6.0 * sampled(row)).cos()).collect(),
            )
        }
    }

    fn without(log: &Trajectory, row: usize) -> Trajectory {
        let (first, last) = (log.slice(0..row), log.slice(row + 1..log.len()));
        let (mut first, last) = (first.unwrap_or_else(|_| log.clone()), last.unwrap_or_else(|_| log.clone()));
        first.time.extend(last.time);
        first.position.extend(last.position);
        first.velocity.extend(last.velocity);
        first.target.iter_mut().zip(last.target).for_each(|(own, other)| own.extend(other));
        first
    }

    #[test]
    fn a_lost_row_among_jitter_moves_no_target() -> Result<(), LogError> {
        let jittered = |row: usize| 0.02 * (row as f64 + 0.3 * noise(row));
        let even = |row: usize| 0.02 * row as f64;
        for (log, moved) in
            [(log(jittered, jittered), true), (log(even, jittered), false), (log(even, even), false)]
        {
            let regular = without(&log, 123).regular()?;
            assert_eq!((regular.filled.as_slice(), regular.moved), (&[123][..], moved));
            let target = regular.trajectory.target.clone().unwrap_or_default();
            for (row, target) in target.iter().enumerate() {
                assert_eq!(*target, if row == 123 { 122.0 } else { row as f64 });
            }
            for (row, position) in regular.trajectory.position.iter().enumerate().skip(1).take(397) {
                let want = 0.5 * (0.12 * row as f64).sin();
                assert!((position - want).abs() < 2e-3, "{row}: {position} {want}");
            }
            assert_eq!(regular.trajectory.lead, log.lead);
        }
        Ok(())
    }

    #[test]
    fn an_even_log_is_left_alone() -> Result<(), LogError> {
        let even = log(|row| 0.02 * row as f64, |row| 0.02 * row as f64);
        assert_eq!(even.regular()?.trajectory, even);
        Ok(())
    }
}
