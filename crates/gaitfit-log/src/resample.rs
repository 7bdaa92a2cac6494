//! Trajectories at other sample rates.

use crate::{BaseState, Gains, LogError, Trajectory, motion};
use gaitfit_model::rotation::{blend, quat_of};
use gaitfit_model::shown_number;

/// Max values of a resampled trajectory (400 MB).
pub(crate) const RESAMPLE_LIMIT: f64 = 5e7;

impl Trajectory {
    /// The same run at `rate_hz`, from the first sample's time on: positions, velocities and base states by
    /// linear interpolation (quaternions along the shorter arc, normalised), targets, actions and commands by
    /// holding the last value, as the controller does. No low-pass filter: lowering the rate aliases motion
    /// above half of it. Needs finite, strictly increasing time.
    pub fn resample(&self, rate_hz: f64) -> Result<Trajectory, LogError> {
        self.resample_early(rate_hz, 0.0)
    }

    /// As [`Trajectory::resample`]; what a controller set counts from `early` s before its sample on. Where stamps jitter, a
    /// value that is set at a new sample's time may be stamped a little after it.
    ///
    /// # Errors
    /// As of [`Trajectory::resample`].
    pub fn resample_early(&self, rate_hz: f64, early: f64) -> Result<Trajectory, LogError> {
        self.validate()?;
        self.require_increasing_time("resample")?;
        if !(rate_hz.is_finite() && rate_hz > 0.0) || self.is_empty() {
            return Err(LogError::Range {
                what: "resample",
                problem: format!(
                    "{} samples to {} Hz; give a positive rate and a log",
                    self.len(),
                    shown_number(rate_hz)
                ),
            });
        }
        // A tolerance, so that a duration of a whole number of periods keeps its last sample.
        let periods = (self.duration() * rate_hz + 1e-6).floor();
        // A row has four signals of each joint, time, command (3) and the base's state (13).
        if (periods + 1.0) * (4 * self.joints.len() + 17) as f64 > RESAMPLE_LIMIT {
            return Err(LogError::Range {
                what: "resample",
                problem: format!(
                    "{} s at {} Hz are too many samples; slice the log first",
                    shown_number(self.duration()),
                    shown_number(rate_hz)
                ),
            });
        }
        let start = self.time[0];
        let time: Vec<f64> = (0..=periods as usize).map(|i| start + i as f64 / rate_hz).collect();
        // For each new time: the sample at or before it, and the fraction of the way to the next.
        // A nanosecond covers rounding: a new time that is a sample's must not take the sample before.
        let last = |at: f64| self.time.partition_point(|known| *known <= at + 1e-9).saturating_sub(1);
        let measured = time.iter().map(|&at| {
            let before = last(at);
            match self.time.get(before + 1) {
                Some(next) => {
                    let known = self.time[before];
                    (before, ((at - known) / (next - known)).clamp(0.0, 1.0))
                }
                None => (before, 0.0),
            }
        });
        let measured = measured.collect();
        // Set values are held to the next sample, measured ones are blended.
        let held = time.iter().map(|&at| last(at + early)).collect();
        Ok(self.at(time, rate_hz, &Places { held, measured, curved: false }))
    }

    /// The samples at `places`.
    pub(crate) fn at(&self, time: Vec<f64>, rate_hz: f64, places: &Places) -> Trajectory {
        // Commands and targets are steps in time; a blend of two of them was never sent.
        let hold = |values: &[f64], width: usize| -> Vec<f64> {
            places.held.iter().flat_map(|&at| values[at * width..(at + 1) * width].iter().copied()).collect()
        };
        let blend = |values: &[f64], width: usize| -> Vec<f64> {
            let mut out = Vec::with_capacity(places.measured.len() * width);
            for &(at, fraction) in &places.measured {
                for column in 0..width {
                    let here = values[at * width + column];
                    out.push(match fraction {
                        // Not 0 × next: next may be NaN or not exist.
                        0.0 => here,
                        _ => here + fraction * (values[(at + 1) * width + column] - here),
                    });
                }
            }
            out
        };
        let joints = self.joints.len();
        let mut position = blend(&self.position, joints);
        // With velocities known at both ends, positions follow a cubic instead of a line.
        if places.curved {
            let rows = position.chunks_exact_mut(joints.max(1));
            for (row, &(at, fraction)) in rows.zip(&places.measured) {
                let Some(step) = self.time.get(at + 1).map(|next| next - self.time[at]) else { continue };
                for (joint, position) in row.iter_mut().enumerate() {
                    let value =
                        |values: &[f64]| [values[at * joints + joint], values[(at + 1) * joints + joint]];
                    *position +=
                        bend(value(&self.position), value(&self.velocity).map(|v| v * step), fraction);
                }
            }
        }
        Trajectory {
            position,
            velocity: blend(&self.velocity, joints),
            target: self.target.as_deref().map(|values| hold(values, joints)),
            action: self.action.as_deref().map(|values| hold(values, joints)),
            command: self.command.as_deref().map(|values| hold(values, 3)),
            // A motion runs on by itself and is not simply blended.
            motion: self.motion.as_deref().map(|values| motion::at(&self.time, values, &places.measured)),
            base: self.base.as_ref().map(|base| BaseState {
                position: base.position.as_deref().map(|values| blend(values, 3)),
                quaternion: base
                    .quaternion
                    .as_deref()
                    .map(|values| blend_quaternions(values, &places.measured)),
                linear_velocity: base.linear_velocity.as_deref().map(|values| blend(values, 3)),
                angular_velocity: base.angular_velocity.as_deref().map(|values| blend(values, 3)),
            }),
            time,
            rate_hz,
            source: self.source.clone(),
            robot: self.robot.clone(),
            joints: self.joints.clone(),
            velocity_joints: self.velocity_joints.clone(),
            gains: self.gains.clone(),
            lead: self.lead,
            simulated_step: self.simulated_step,
            fell: self.fell,
        }
    }

    pub(crate) fn require_increasing_time(&self, what: &'static str) -> Result<(), LogError> {
        let bad = self.time.windows(2).position(|pair| !(pair[1] > pair[0] && pair[1].is_finite()));
        match bad {
            Some(i) => Err(LogError::Range {
                what,
                problem: format!(
                    "time goes from {} s to {} s at sample {}; it must increase: cut the log there",
                    shown_number(self.time[i]),
                    shown_number(self.time[i + 1]),
                    i + 1
                ),
            }),
            None => Ok(()),
        }
    }

    /// Applies `map(values, width)` to every sample array.
    pub(crate) fn map_arrays(
        &self,
        joints: Vec<String>,
        gains: Option<Gains>,
        map: impl Fn(&[f64], usize) -> Vec<f64>,
    ) -> Trajectory {
        let width = self.joints.len();
        let optional = |values: &Option<Vec<f64>>, width| values.as_deref().map(|values| map(values, width));
        Trajectory {
            source: self.source.clone(),
            robot: self.robot.clone(),
            joints,
            velocity_joints: self.velocity_joints.clone(),
            time: map(&self.time, 1),
            rate_hz: self.rate_hz,
            position: map(&self.position, width),
            velocity: map(&self.velocity, width),
            target: optional(&self.target, width),
            action: optional(&self.action, width),
            command: optional(&self.command, 3),
            motion: optional(&self.motion, 2),
            base: self.base.as_ref().map(|base| BaseState {
                position: optional(&base.position, 3),
                quaternion: optional(&base.quaternion, 4),
                linear_velocity: optional(&base.linear_velocity, 3),
                angular_velocity: optional(&base.angular_velocity, 3),
            }),
            gains,
            lead: self.lead,
            simulated_step: self.simulated_step,
            fell: self.fell,
        }
    }
}

/// Where the samples of a new trajectory are in an old one; one entry each a new sample.
pub(crate) struct Places {
    /// The sample whose targets, actions and commands hold.
    pub held: Vec<usize>,
    /// The sample at or before, and the fraction of the way to the next, of what is measured.
    pub measured: Vec<(usize, f64)>,
    /// Whether positions between samples follow their velocities.
    pub curved: bool,
}

/// Returns what a cubic with the samples' slopes (for one step) adds to the straight line between two values.
fn bend([from, to]: [f64; 2], [slope_from, slope_to]: [f64; 2], fraction: f64) -> f64 {
    let rise = to - from;
    let rest = 1.0 - fraction;
    // Hermite's cubic less the line.
    let bend = fraction * rest * (rest * (slope_from - rise) - fraction * (slope_to - rise));
    // Where a velocity is missing, the line stays.
    if fraction == 0.0 || !bend.is_finite() { 0.0 } else { bend }
}

/// Quaternions between samples: `places` are samples and how far behind them.
fn blend_quaternions(values: &[f64], places: &[(usize, f64)]) -> Vec<f64> {
    let mut out = Vec::with_capacity(places.len() * 4);
    for &(at, fraction) in places {
        let here = &values[at * 4..at * 4 + 4];
        if fraction == 0.0 {
            out.extend_from_slice(here);
            continue;
        }
        out.extend(blend(quat_of(here), quat_of(&values[at * 4 + 4..]), fraction));
    }
    out
}
