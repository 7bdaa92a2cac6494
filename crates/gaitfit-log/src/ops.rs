//! Taking trajectories apart: columns, slices, joint order, sample rate, and whether the arrays fit together.

use crate::names::names;
use crate::{BaseState, Gains, LogError, Trajectory};
use gaitfit_model::rotation::{blend, quat_of};
use gaitfit_model::{shown, shown_number};
use serde::{Deserialize, Serialize};
use std::collections::HashSet;

/// A signal that has one column a joint.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Hash, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Signal {
    /// Joint position, rad.
    Position,
    /// Joint velocity, rad/s.
    Velocity,
    /// Position target, rad.
    Target,
    /// Policy action.
    Action,
}

impl Signal {
    /// All of them.
    pub const ALL: [Signal; 4] = [Signal::Position, Signal::Velocity, Signal::Target, Signal::Action];

    /// Prefix of the signal's CSV columns.
    pub fn prefix(self) -> &'static str {
        match self {
            Signal::Position => "q_",
            Signal::Velocity => "dq_",
            Signal::Target => "qdes_",
            Signal::Action => "act_",
        }
    }
}

impl std::fmt::Display for Signal {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Signal::Position => "position",
            Signal::Velocity => "velocity",
            Signal::Target => "target",
            Signal::Action => "action",
        })
    }
}

/// Largest time between a row and its target's message, s.
const MAX_LEAD_S: f64 = 1.0;
/// Largest physics step of a simulator, s.
const MAX_STEP_S: f64 = 0.1;

/// Largest resampled trajectory, values (400 MB).
pub(crate) const RESAMPLE_LIMIT: f64 = 5e7;

impl Trajectory {
    /// Nominal sample interval 1 / `rate_hz`, s.
    pub fn dt(&self) -> f64 {
        1.0 / self.rate_hz
    }

    /// Time from the first to the last sample, s; 0 for fewer than two samples.
    pub fn duration(&self) -> f64 {
        match (self.time.first(), self.time.last()) {
            (Some(first), Some(last)) => last - first,
            _ => 0.0,
        }
    }

    /// A joint signal, `len × joints`, if the log has it.
    pub fn signal(&self, signal: Signal) -> Option<&[f64]> {
        match signal {
            Signal::Position => Some(&self.position),
            Signal::Velocity => Some(&self.velocity),
            Signal::Target => self.target.as_deref(),
            Signal::Action => self.action.as_deref(),
        }
    }

    /// One joint's column of a signal, `len` values. `None` when the log lacks the signal or the joint.
    pub fn column(&self, signal: Signal, joint: &str) -> Option<Vec<f64>> {
        self.column_at(signal, self.joint(joint)?)
    }

    /// As [`Trajectory::column`], by the joint's column number.
    pub fn column_at(&self, signal: Signal, joint: usize) -> Option<Vec<f64>> {
        let width = self.joints.len();
        if joint >= width {
            return None;
        }
        Some(self.signal(signal)?.iter().skip(joint).step_by(width).copied().collect())
    }

    /// Whether all arrays have the sizes that `time` and `joints` say, joint names are distinct and not empty,
    /// times finite, rate and gains usable numbers. Says nothing about the values.
    pub fn validate(&self) -> Result<(), LogError> {
        let refuse = |what: &str, problem: String| Err(LogError::Shape { what: what.to_owned(), problem });
        let (samples, joints) = (self.len(), self.joints.len());
        if joints == 0 {
            return refuse("joints", "none; a trajectory has at least one joint".into());
        }
        let mut seen = HashSet::with_capacity(joints);
        for (i, name) in self.joints.iter().enumerate() {
            if name.is_empty() {
                return refuse("joints", format!("joint {i} has no name"));
            }
            if !seen.insert(name) {
                return refuse("joints", format!("`{}` twice; joint names must be distinct", shown(name)));
            }
        }
        if let Some(bad) = self.time.iter().position(|time| !time.is_finite()) {
            return refuse(
                "time",
                format!("{} at sample {bad}; every sample has a finite time", self.time[bad]),
            );
        }
        let empty = BaseState::default();
        let base = self.base.as_ref().unwrap_or(&empty);
        let arrays = [
            ("position", Some(&self.position), joints),
            ("velocity", Some(&self.velocity), joints),
            ("target", self.target.as_ref(), joints),
            ("action", self.action.as_ref(), joints),
            ("command", self.command.as_ref(), 3),
            ("base.position", base.position.as_ref(), 3),
            ("base.quaternion", base.quaternion.as_ref(), 4),
            ("base.linear_velocity", base.linear_velocity.as_ref(), 3),
            ("base.angular_velocity", base.angular_velocity.as_ref(), 3),
        ];
        for (what, values, width) in arrays {
            if let Some(values) = values
                && Some(values.len()) != samples.checked_mul(width)
            {
                return refuse(what, format!("{} values for {samples} samples × {width}", values.len()));
            }
        }
        if !(self.rate_hz.is_finite() && self.rate_hz > 0.0) {
            return refuse(
                "rate_hz",
                format!("{}; give a positive sample rate in Hz", shown_number(self.rate_hz)),
            );
        }
        if let Some(lead) = &self.lead {
            let usable = lead.seconds.abs() <= MAX_LEAD_S && (0.0..=MAX_LEAD_S).contains(&lead.spread);
            if !usable {
                return refuse(
                    "lead",
                    format!(
                        "{} s, spread {} s; a target is stamped within a second of its row",
                        shown_number(lead.seconds),
                        shown_number(lead.spread)
                    ),
                );
            }
        }
        if let Some(step) = self.simulated_step.filter(|step| !(*step > 0.0 && *step <= MAX_STEP_S)) {
            let problem = format!(
                "{} s; a simulator's physics step is above 0 and at most {MAX_STEP_S} s",
                shown_number(step)
            );
            return refuse("simulated_step_s", problem);
        }
        if let Some(gains) = &self.gains {
            for (what, values) in [("gains.kp", &gains.kp), ("gains.kd", &gains.kd)] {
                if values.len() != joints {
                    return refuse(what, format!("{} values for {joints} joints", values.len()));
                }
                if let Some(bad) = values.iter().position(|gain| !(gain.is_finite() && *gain >= 0.0)) {
                    return refuse(
                        what,
                        format!(
                            "{} for {}; gains are finite and not negative",
                            shown_number(values[bad]),
                            shown(&self.joints[bad])
                        ),
                    );
                }
            }
        }
        Ok(())
    }

    /// Samples `range` (by index, end excluded). Times are kept, not shifted.
    pub fn slice(&self, range: std::ops::Range<usize>) -> Result<Trajectory, LogError> {
        if range.start > range.end || range.end > self.len() {
            return Err(LogError::Range {
                what: "slice",
                problem: format!("samples {}..{} of {}", range.start, range.end, self.len()),
            });
        }
        let part = self.map_arrays(self.joints.clone(), self.gains.clone(), |values, width| {
            values[range.start * width..range.end * width].to_vec()
        });
        Ok(Trajectory { fell: self.fell && range.end == self.len(), ..part })
    }

    /// One sample of `every`, the first among them, at that rate.
    #[must_use]
    pub fn thinned(&self, every: usize) -> Trajectory {
        let every = every.max(1);
        let part = self.map_arrays(self.joints.clone(), self.gains.clone(), |values, width| {
            values.chunks_exact(width).step_by(every).flatten().copied().collect()
        });
        Trajectory { rate_hz: self.rate_hz / every as f64, ..part }
    }

    /// Samples with `from <= time < to`, s. Needs increasing time.
    pub fn slice_time(&self, from: f64, to: f64) -> Result<Trajectory, LogError> {
        self.require_increasing_time("slice_time")?;
        let index = |at: f64| self.time.partition_point(|time| *time < at);
        if from.is_nan() || to.is_nan() || from > to {
            return Err(LogError::Range {
                what: "slice_time",
                problem: format!("from {} s to {} s", shown_number(from), shown_number(to)),
            });
        }
        self.slice(index(from)..index(to))
    }

    /// The same samples with exactly the joints `wanted`, in that order. Joints not named are left out.
    /// Errors: a name the log lacks, or one named twice.
    pub fn select_joints<S: AsRef<str>>(&self, wanted: &[S]) -> Result<Trajectory, LogError> {
        let mut columns = Vec::with_capacity(wanted.len());
        let mut taken = vec![false; self.joints.len()];
        for name in wanted {
            let name = name.as_ref();
            let column = self.joint(name).ok_or_else(|| LogError::NoSuchJoint {
                name: name.to_owned(),
                available: names(self.joints.iter().map(String::as_str)),
            })?;
            if std::mem::replace(&mut taken[column], true) {
                return Err(LogError::Range {
                    what: "select_joints",
                    problem: format!("`{}` twice; name each joint once", shown(name)),
                });
            }
            columns.push(column);
        }
        let width = self.joints.len();
        let pick = |values: &[f64]| -> Vec<f64> {
            values.chunks_exact(width).flat_map(|row| columns.iter().map(|&column| row[column])).collect()
        };
        let gains = self.gains.as_ref().map(|gains| Gains { kp: pick(&gains.kp), kd: pick(&gains.kd) });
        let joints = columns.iter().map(|&column| self.joints[column].clone()).collect();
        Ok(Trajectory {
            joints,
            gains,
            position: pick(&self.position),
            velocity: pick(&self.velocity),
            target: self.target.as_deref().map(pick),
            action: self.action.as_deref().map(pick),
            ..self.clone()
        })
    }

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
    /// As there.
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
        let held = time.iter().map(|&at| last(at + early)).collect();
        Ok(self.at(time, rate_hz, &Places { held, measured, curved: false }))
    }

    /// The samples at `places`.
    pub(crate) fn at(&self, time: Vec<f64>, rate_hz: f64, places: &Places) -> Trajectory {
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
    fn map_arrays(
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
            time: map(&self.time, 1),
            rate_hz: self.rate_hz,
            position: map(&self.position, width),
            velocity: map(&self.velocity, width),
            target: optional(&self.target, width),
            action: optional(&self.action, width),
            command: optional(&self.command, 3),
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

/// What a cubic with the slopes of the samples (a step long) adds to the straight line between two values.
fn bend([from, to]: [f64; 2], [slope_from, slope_to]: [f64; 2], fraction: f64) -> f64 {
    let rise = to - from;
    let rest = 1.0 - fraction;
    // Hermite's cubic less the line.
    let bend = fraction * rest * (rest * (slope_from - rise) - fraction * (slope_to - rise));
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
