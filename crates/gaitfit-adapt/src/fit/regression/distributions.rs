//! The distributions of a walk as a list of numbers.

use crate::cost::{Reference, Signal};
use crate::fit::Predicted;
use std::ops::Range;

/// Parts of equal count into which sorted samples are cut.
const PARTS: usize = 16;
/// Max part of the shortest recording that is left out at its start.
const MAX_SETTLING: f64 = 0.2;
/// Signals that every walking log has.
const SIGNALS: [Signal; 3] = [Signal::Position, Signal::Velocity, Signal::Action];
/// Groups of each signal's joints, in their order: the legs of a quadruped.
const GROUPS: usize = 4;
/// Most samples that falls may take from the logs of a robot that is looked at.
const MAX_LOST: f64 = 0.2;

/// The distribution of each joint's position, velocity and action over all logs, as the means of sixteenths of the sorted
/// samples: 16 numbers a joint and signal, in the reference's scaling. What is constant on the robot is left out.
#[derive(Clone, Copy)]
pub struct Distributions<'a> {
    reference: &'a Reference,
    /// Samples at the start of each log, after the reference's pre-roll, that do not count either.
    settling: usize,
}

impl<'a> Distributions<'a> {
    /// The distributions of `reference`, without the first `settling` samples that count. The start of a log changes the walk, and
    /// this must not look like the robot's values. Max `settling`: a fifth of the shortest recording.
    pub fn new(reference: &'a Reference, settling: usize) -> Self {
        let counted = |recording| reference.samples(recording).saturating_sub(reference.skip());
        let shortest = (0..reference.recordings()).map(counted).min().unwrap_or(0);
        Self { reference, settling: settling.min((MAX_SETTLING * shortest as f64) as usize) }
    }

    /// Signals, their columns, and what scales them.
    fn dimensions(&self) -> impl Iterator<Item = (Signal, usize, f64)> {
        let reference = self.reference;
        SIGNALS.into_iter().flat_map(move |signal| {
            let dimensions = reference.dimensions(signal).unwrap_or_default().iter().enumerate();
            dimensions.filter_map(move |(column, one)| Some((signal, column, one.scale?)))
        })
    }

    /// Samples of all recordings that count.
    fn counted(&self) -> usize {
        self.reference.counted().saturating_sub(self.reference.recordings() * self.settling)
    }

    /// The numbers of each signal's groups of joints.
    pub fn groups(&self) -> Vec<Range<usize>> {
        let joints = self.reference.joints().len();
        let group = |(signal, column): (Signal, usize)| (signal as usize, column * GROUPS / joints);
        let mut groups: Vec<((usize, usize), Range<usize>)> = Vec::new();
        for (k, (signal, column, ..)) in self.dimensions().enumerate() {
            let (key, numbers) = (group((signal, column)), k * PARTS..(k + 1) * PARTS);
            // Columns ascend within a signal, so the numbers of one group follow each other.
            match groups.last_mut().filter(|(last, _)| *last == key) {
                Some((_, range)) => range.end = numbers.end,
                None => groups.push((key, numbers)),
            }
        }
        groups.into_iter().map(|(_, range)| range).collect()
    }

    /// Those of the robot's logs.
    pub fn recorded(&self) -> Vec<f64> {
        let (reference, joints) = (self.reference, self.reference.joints().len());
        let recordings = 0..reference.recordings();
        self.dimensions()
            .flat_map(|(signal, column, scale)| {
                let kept = recordings.clone().filter_map(|number| reference.recorded(signal, number));
                // The reference has cut off its pre-roll; `settling` comes on top.
                let rows = kept.flat_map(|matrix| matrix.chunks_exact(joints).skip(self.settling));
                let mut pool: Vec<f64> = rows.map(|row| row[column]).collect();
                pool.sort_unstable_by(f64::total_cmp);
                parts(&pool, scale)
            })
            .collect()
    }

    /// Those of a simulated robot, whose `logs` are as long as the reference's. `None` if it diverged, or fell too soon.
    pub fn simulated(&self, logs: &[Predicted]) -> Option<Vec<f64>> {
        let (joints, skip) = (self.reference.joints().len(), self.reference.skip() + self.settling);
        let end = |log: &Predicted| log.fell_at.unwrap_or(usize::MAX).min(log.position.len() / joints);
        let kept: usize = logs.iter().map(|log| end(log).saturating_sub(skip)).sum();
        // Robots that fall early leave distributions of other parts of the walk.
        if logs.is_empty() || (kept as f64) < (1.0 - MAX_LOST) * self.counted() as f64 {
            return None;
        }
        let mut numbers = Vec::new();
        for (signal, column, scale) in self.dimensions() {
            let mut pool = Vec::with_capacity(kept);
            for log in logs {
                let signals = log.signals();
                // Simulated logs still have the pre-roll, which `skip` contains.
                let rows = signals.get(signal)?.chunks_exact(joints).take(end(log)).skip(skip);
                pool.extend(rows.map(|row| f64::from(row[column])));
            }
            pool.sort_unstable_by(f64::total_cmp);
            numbers.extend(parts(&pool, scale));
        }
        numbers.iter().all(|value| value.is_finite()).then_some(numbers)
    }
}

/// Means of the parts of `sorted` samples, scaled.
fn parts(sorted: &[f64], scale: f64) -> Vec<f64> {
    let count = sorted.len();
    (0..PARTS)
        .map(move |part| {
            // With fewer samples than parts, neighbouring parts share a sample: each has at least one.
            let from = (part * count / PARTS).min(count.saturating_sub(1));
            let to = ((part + 1) * count / PARTS).clamp((from + 1).min(count), count);
            scale * sorted[from..to].iter().sum::<f64>() / (to - from) as f64
        })
        .collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::cost::Recorded;

    fn reference() -> Reference {
        let position: Vec<f64> = (0..32).map(f64::from).collect();
        let velocity = vec![1.0; 32];
        let recorded = Recorded { action: Some(position.clone()), position, velocity, ..Recorded::default() };
        Reference::new(vec!["hip".into()], &[recorded.clone(), recorded], 2).unwrap()
    }

    fn walk(fell_at: Option<usize>) -> Predicted {
        let position: Vec<f32> = (0..32).map(|k| k as f32).collect();
        Predicted {
            action: Some(position.clone()),
            velocity: vec![1.0; 32],
            position,
            fell_at,
            ..Predicted::default()
        }
    }

    #[test]
    fn equal_walks_have_equal_numbers_and_falls_are_left_out() {
        let reference = reference();
        let distributions = Distributions::new(&reference, 0);
        let recorded = distributions.recorded();
        // Positions and actions; the velocity is constant.
        assert_eq!(recorded.len(), 2 * PARTS);
        assert_eq!(distributions.groups(), [0..PARTS, PARTS..2 * PARTS]);
        assert_eq!(distributions.simulated(&[walk(None), walk(None)]).unwrap(), recorded);
        // Samples 2 to 31 map to a range of 2; the lowest sixteenth of 60 has three: 2, 2, 3.
        assert!((recorded[0] - (7.0 / 3.0) * 2.0 / 29.0).abs() < 1e-12, "{}", recorded[0]);
        let shorter = distributions.simulated(&[walk(None), walk(Some(28))]).unwrap();
        assert!(shorter[PARTS - 1] < recorded[PARTS - 1]);
        assert!(distributions.simulated(&[walk(None), walk(Some(12))]).is_none());
        // 30 samples of each log count; the max settling is a fifth of them.
        let settled = Distributions::new(&reference, 2);
        let numbers = settled.recorded();
        assert_eq!(settled.simulated(&[walk(None), walk(None)]).unwrap(), numbers);
        assert!(numbers[0] > recorded[0], "the lowest samples, of the first rows, are left out");
        assert_eq!(
            Distributions::new(&reference, 100).recorded(),
            Distributions::new(&reference, 6).recorded()
        );
        let mut broken = walk(None);
        broken.position[9] = f32::NAN;
        assert!(distributions.simulated(&[walk(None), broken]).is_none());
    }
}
