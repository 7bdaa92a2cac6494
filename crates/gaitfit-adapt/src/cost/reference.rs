//! The robot side of every cost, prepared once.

use super::{CostError, Signal};
use crate::Signals;
use crate::checksum::Sum;
use gaitfit_log::Trajectory;
use std::sync::OnceLock;

/// Ranges below this (rad, rad/s, unitless) count as constant: nothing of a joint's motion is that small, and the
/// scale 2 / range would blow rounding errors up to the size of real differences.
const MIN_RANGE: f64 = 1e-9;

/// One recorded run: `samples × joints` matrices, row-major, all in the reference's joint order, and `samples × 3`
/// matrices of the base.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recorded {
    /// Joint positions, rad.
    pub position: Vec<f64>,
    /// Joint velocities, rad/s.
    pub velocity: Vec<f64>,
    /// Policy actions, unitless.
    pub action: Option<Vec<f64>>,
    /// Base position, m, world frame.
    pub base_position: Option<Vec<f64>>,
    /// Base linear velocity, m/s, world frame.
    pub base_velocity: Option<Vec<f64>>,
}

impl Recorded {
    /// Joint signals alone, `samples × joints`, for example of another simulator.
    pub fn of_joints(position: &[f32], velocity: &[f32]) -> Self {
        let wide = |values: &[f32]| values.iter().map(|&value| f64::from(value)).collect();
        Self { position: wide(position), velocity: wide(velocity), ..Self::default() }
    }

    /// The signals of `trajectory` with its columns reordered by name to `joints`; `recording` is the number used
    /// in errors.
    ///
    /// # Errors
    /// [`CostError::UnknownJoint`] if the log lacks one of `joints`.
    pub fn from_trajectory(
        trajectory: &Trajectory,
        joints: &[String],
        recording: usize,
    ) -> Result<Self, CostError> {
        // Columns are matched by name: a log may list the joints in another order than the model.
        let columns: Vec<usize> = joints
            .iter()
            .map(|joint| {
                trajectory.joint(joint).ok_or_else(|| CostError::UnknownJoint {
                    recording,
                    joint: joint.clone(),
                    available: trajectory.joints.join(", "),
                })
            })
            .collect::<Result<_, _>>()?;
        let width = trajectory.joints.len();
        let pick = |matrix: &Vec<f64>| -> Vec<f64> {
            matrix
                .chunks_exact(width)
                .flat_map(|row| columns.iter().map(move |column| row[*column]))
                .collect()
        };
        let base = trajectory.base.as_ref();
        Ok(Self {
            position: pick(&trajectory.position),
            velocity: pick(&trajectory.velocity),
            action: trajectory.action.as_ref().map(pick),
            base_position: base.and_then(|base| base.position.clone()),
            base_velocity: base.and_then(|base| base.linear_velocity.clone()),
        })
    }

    fn get(&self, signal: Signal) -> Option<&Vec<f64>> {
        match signal {
            Signal::Position => Some(&self.position),
            Signal::Velocity => Some(&self.velocity),
            Signal::Action => self.action.as_ref(),
            Signal::BasePosition => self.base_position.as_ref(),
            Signal::BaseVelocity => self.base_velocity.as_ref(),
        }
    }
}

/// One dimension of one signal (a joint, or an axis of the base) over all recordings, pre-roll cut off.
#[derive(Clone, Debug, PartialEq)]
pub struct Dimension {
    /// Smallest recorded value.
    pub min: f64,
    /// Largest recorded value.
    pub max: f64,
    /// 2 / (max − min), which maps the robot's range to [−1, 1]; `None` if the robot's value is constant or not
    /// compared. The shift is −(max + min) / (max − min); it cancels in every distance and is not stored.
    pub scale: Option<f64>,
    samples: Samples,
}

/// Samples of all recordings. They are sorted at first use, because costs of single samples never need that.
#[derive(Clone, Debug)]
struct Samples {
    recorded: Vec<f64>,
    ascending: OnceLock<Vec<f64>>,
}

impl PartialEq for Samples {
    fn eq(&self, other: &Self) -> bool {
        // The ascending samples follow from the recorded ones.
        self.recorded == other.recorded
    }
}

impl Samples {
    /// One column of all matrices.
    fn new(matrices: &[Vec<f64>], column: usize, width: usize) -> Self {
        let of_matrix = |matrix: &Vec<f64>| matrix.iter().skip(column).step_by(width).copied().collect();
        let recorded: Vec<Vec<f64>> = matrices.iter().map(of_matrix).collect();
        Self { recorded: recorded.concat(), ascending: OnceLock::new() }
    }

    fn ascending(&self) -> &[f64] {
        self.ascending.get_or_init(|| {
            let mut samples = self.recorded.clone();
            samples.sort_unstable_by(f64::total_cmp);
            samples
        })
    }
}

/// The matrices and dimensions of one signal.
#[derive(Clone, Debug, PartialEq)]
struct ReferenceSignal {
    dimensions: Vec<Dimension>,
    /// One matrix a recording, pre-roll cut off.
    recordings: Vec<Vec<f64>>,
}

/// The robot's recordings with scale and shift per dimension, fixed for a whole adaptation: every dimension is
/// mapped to [−1, 1] by the robot's own minimum and maximum over all recordings.
///
/// A dimension that is constant on the robot (range below 1e-9) has no scale. It is left out of the mean over
/// joints and named by [`Reference::constant`], which callers must show; if a weighted signal has no other dimension
/// the cost is refused.
#[derive(Clone, Debug, PartialEq)]
pub struct Reference {
    joints: Vec<String>,
    skip: usize,
    /// In the order of [`Signal::ALL`].
    signals: [Option<ReferenceSignal>; Signal::ALL.len()],
    /// Part of the recordings in which the robot would fall.
    fall_rate: f64,
}

impl Reference {
    /// Prepares `recordings`, whose columns are `joints`. The first `skip` samples of every recording, on both
    /// sides, do not count (pre-roll: the start is unlike the rest, or its state is unknown). The action
    /// and the base's state can be compared only if every recording has them.
    ///
    /// # Errors
    /// [`CostError::EmptyReference`], [`CostError::Shape`], [`CostError::ReferenceNotFinite`].
    pub fn new(joints: Vec<String>, recordings: &[Recorded], skip: usize) -> Result<Self, CostError> {
        if joints.is_empty() || recordings.is_empty() {
            return Err(CostError::EmptyReference("it needs at least one joint and one recording".into()));
        }
        let mut signals = [const { None }; Signal::ALL.len()];
        for (slot, signal) in signals.iter_mut().zip(Signal::ALL) {
            *slot = ReferenceSignal::new(signal, &joints, recordings, skip)?;
        }
        Ok(Self { joints, skip, signals, fall_rate: 0.0 })
    }

    /// The same recordings of a robot that would fall in the part `fall_rate` of them, 0 to 1. Recordings are cut before falls and
    /// do not show them.
    pub fn with_fall_rate(self, fall_rate: f64) -> Self {
        Self { fall_rate, ..self }
    }

    /// Part of the recordings in which the robot would fall, 0 to 1.
    pub fn fall_rate(&self) -> f64 {
        self.fall_rate
    }

    /// Share of the samples that a simulated robot may lose to falls without a charge. A robot that falls at a random time
    /// loses half of the recording.
    pub(crate) fn lost_by_robot(&self) -> f64 {
        0.5 * self.fall_rate
    }

    /// The same recordings without the angles of `joints`, such as wheels, which turn without limit. Their velocities and
    /// actions are still compared.
    pub fn without_angles(mut self, joints: &[String]) -> Self {
        if let Some(position) = &mut self.signals[Signal::Position as usize] {
            for (name, dimension) in self.joints.iter().zip(&mut position.dimensions) {
                if joints.contains(name) {
                    // The range stays, so the joint is left out without counting as constant.
                    dimension.scale = None;
                }
            }
        }
        self
    }

    /// The same recordings in the scaling of `other`, which has the same joints. Without it, the scaling of two sets of logs
    /// differs by their most extreme samples.
    pub fn scaled_as(mut self, other: &Self) -> Self {
        for (own, other) in self.signals.iter_mut().zip(&other.signals) {
            // A signal that only one of the two has keeps its own scaling.
            let (Some(own), Some(other)) = (own, other) else { continue };
            for (own, other) in own.dimensions.iter_mut().zip(&other.dimensions) {
                own.scale = other.scale;
            }
        }
        self
    }

    /// SHA-256 of the recordings and their scaling, hexadecimal: the same only for the same numbers. Pre-roll does not count.
    pub fn fingerprint(&self) -> String {
        let mut sum = Sum::default();
        for (signal, recorded) in Signal::ALL.iter().zip(&self.signals) {
            let Some(recorded) = recorded else { continue };
            sum.text(&signal.to_string());
            // Not a number stands for a dimension that is not compared.
            let scales = recorded.dimensions.iter().map(|one| one.scale.unwrap_or(f64::NAN));
            sum.numbers(&scales.collect::<Vec<_>>());
            recorded.recordings.iter().for_each(|matrix| sum.numbers(matrix));
            if self.fall_rate > 0.0 {
                sum.numbers(&[self.fall_rate]);
            }
        }
        sum.digits()
    }

    /// Joint names in column order.
    pub fn joints(&self) -> &[String] {
        &self.joints
    }

    /// Number of recordings.
    pub fn recordings(&self) -> usize {
        // Signal 0 is the position, which every recording has.
        self.signals[0].as_ref().map_or(0, |signal| signal.recordings.len())
    }

    /// Samples at the start of each recording that do not count.
    pub fn skip(&self) -> usize {
        self.skip
    }

    /// Samples of recording `recording`, pre-roll included; 0 if there is no such recording.
    pub fn samples(&self, recording: usize) -> usize {
        self.recording(Signal::Position, recording)
            // The stored matrix lacks the pre-roll.
            .map_or(0, |matrix| matrix.len() / self.joints.len() + self.skip)
    }

    /// Samples of all recordings that count.
    pub fn counted(&self) -> usize {
        (0..self.recordings()).map(|recording| self.samples(recording) - self.skip).sum()
    }

    /// The recorded values of `signal` without the pre-roll: `samples × columns`, row-major; `None` without the signal or the
    /// recording.
    pub fn recorded(&self, signal: Signal, recording: usize) -> Option<&[f64]> {
        self.recording(signal, recording)
    }

    /// Whether every recording has `signal`.
    pub fn has(&self, signal: Signal) -> bool {
        self.signals[signal as usize].is_some()
    }

    /// Range and scale of every dimension of `signal`: joints in their order, or x, y, z of the base.
    pub fn dimensions(&self, signal: Signal) -> Option<&[Dimension]> {
        self.signals[signal as usize].as_ref().map(|signal| signal.dimensions.as_slice())
    }

    /// The dimensions that are constant on the robot and therefore left out, as (signal, name of the joint or
    /// axis).
    pub fn constant(&self) -> Vec<(Signal, &str)> {
        let mut columns = Vec::new();
        for signal in Signal::ALL {
            for (column, dimension) in self.dimensions(signal).unwrap_or_default().iter().enumerate() {
                if dimension.is_constant() {
                    columns.push((signal, signal.column(&self.joints, column)));
                }
            }
        }
        columns
    }

    /// Recorded matrix without the pre-roll.
    pub(crate) fn recording(&self, signal: Signal, recording: usize) -> Option<&[f64]> {
        self.signals[signal as usize].as_ref()?.recordings.get(recording).map(Vec::as_slice)
    }

    /// The part of a simulated signal that counts, checked for whole rows and finite values: rows from the end of
    /// the pre-roll to a fall.
    pub(crate) fn checked<'a>(
        &self,
        signal: Signal,
        recording: usize,
        signals: &Signals<'a>,
    ) -> Result<Counted<'a>, CostError> {
        let matrix = signals
            .get(signal)
            .ok_or_else(|| CostError::MissingSignal { signal, side: "the simulation".into() })?;
        let width = signal.width(self.joints.len());
        // A wrong number of values would shift every later row.
        if !matrix.len().is_multiple_of(width) {
            return Err(CostError::Shape {
                signal,
                recording,
                len: matrix.len(),
                expected: format!("a multiple of {width}"),
            });
        }
        let rows = matrix.len() / width;
        // A candidate that falls counts only up to its fall; the rows behind it are reported as lost.
        let end = signals.fell_at.map_or(rows, |fall| fall.min(rows));
        let start = self.skip.min(rows);
        // A fall before the end of the pre-roll leaves no row that counts.
        let counted = &matrix[start * width..end.max(start) * width];
        // One branch-free pass that vectorises, and a search only on failure.
        if counted.iter().fold(false, |bad, value| bad | !value.is_finite())
            && let Some(bad) = counted.iter().position(|value| !value.is_finite())
        {
            return Err(CostError::NotFinite {
                signal,
                of: signal.label(&self.joints, bad % width),
                recording,
                sample: start + bad / width,
            });
        }
        Ok(Counted { matrix: counted, lost: rows - end.max(start) })
    }

    /// The reference of some recordings alone, numbered as in `recordings`, in the scaling of all.
    pub(crate) fn subset(&self, recordings: &[usize]) -> Self {
        let subset = |signal: &ReferenceSignal| {
            let chosen: Vec<Vec<f64>> =
                recordings.iter().filter_map(|&number| signal.recordings.get(number).cloned()).collect();
            // Range and scale stay those of all recordings; only the samples are fewer.
            let dimensions = signal.dimensions.iter().enumerate().map(|(column, dimension)| Dimension {
                samples: Samples::new(&chosen, column, signal.dimensions.len()),
                ..*dimension
            });
            ReferenceSignal { dimensions: dimensions.collect(), recordings: chosen }
        };
        let signals = std::array::from_fn(|index| self.signals[index].as_ref().map(subset));
        Self { joints: self.joints.clone(), signals, ..*self }
    }
}

/// The rows of a simulated matrix that count.
pub(crate) struct Counted<'a> {
    /// From the end of the pre-roll to the end, or to a fall.
    pub matrix: &'a [f32],
    /// Rows that would count but for a fall.
    pub lost: usize,
}

impl ReferenceSignal {
    fn new(
        signal: Signal,
        joints: &[String],
        recordings: &[Recorded],
        skip: usize,
    ) -> Result<Option<Self>, CostError> {
        let width = signal.width(joints.len());
        let mut matrices = Vec::with_capacity(recordings.len());
        for (number, recorded) in recordings.iter().enumerate() {
            // A signal counts only if every recording has it.
            let Some(matrix) = recorded.get(signal) else { return Ok(None) };
            let (rows, partial) = (matrix.len() / width, matrix.len() % width);
            if partial > 0 || rows * joints.len() != recorded.position.len() {
                return Err(CostError::Shape {
                    signal,
                    recording: number,
                    len: matrix.len(),
                    expected: format!(
                        "samples × {width}, with as many samples as the {} positions of {} joints make",
                        recorded.position.len(),
                        joints.len()
                    ),
                });
            }
            if let Some(bad) = matrix.iter().position(|value| !value.is_finite()) {
                return Err(CostError::ReferenceNotFinite {
                    signal,
                    of: signal.label(joints, bad % width),
                    recording: number,
                    sample: bad / width,
                });
            }
            if rows <= skip {
                return Err(CostError::EmptyReference(format!(
                    "recording {number} has {rows} samples and the first {skip} are skipped"
                )));
            }
            // The pre-roll is cut off once here, and never compared.
            matrices.push(matrix[skip * width..].to_vec());
        }
        let dimensions = (0..width).map(|column| Dimension::new(&matrices, column, width)).collect();
        Ok(Some(Self { dimensions, recordings: matrices }))
    }
}

impl Dimension {
    /// Whether the robot's value never changes.
    fn is_constant(&self) -> bool {
        self.max - self.min < MIN_RANGE
    }

    /// Whether the robot's value changes and is not compared; see [`Reference::without_angles`].
    pub fn is_left_out(&self) -> bool {
        self.scale.is_none() && !self.is_constant()
    }

    /// All samples that count, ascending.
    pub fn sorted(&self) -> &[f64] {
        self.samples.ascending()
    }

    fn new(matrices: &[Vec<f64>], column: usize, width: usize) -> Self {
        let samples = Samples::new(matrices, column, width);
        let (mut min, mut max) = (f64::INFINITY, f64::NEG_INFINITY);
        for &sample in &samples.recorded {
            (min, max) = (min.min(sample), max.max(sample));
        }
        let range = max - min;
        Self { min, max, scale: (range >= MIN_RANGE).then(|| 2.0 / range), samples }
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests;
