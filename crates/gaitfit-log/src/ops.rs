//! Parts of trajectories: columns, slices, joint order, and whether the arrays fit together.

use crate::names::names;
use crate::{BaseState, Gains, LogError, Trajectory};
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

    /// Whether the targets of the joint of this column number are velocities.
    pub fn has_velocity_target(&self, joint: usize) -> bool {
        self.joints.get(joint).is_some_and(|name| self.velocity_joints.contains(name))
    }

    /// As [`Trajectory::column`], by the joint's column number. The target of a joint is an angle: there is none of a joint
    /// with velocity targets.
    pub fn column_at(&self, signal: Signal, joint: usize) -> Option<Vec<f64>> {
        let width = self.joints.len();
        if joint >= width || signal == Signal::Target && self.has_velocity_target(joint) {
            return None;
        }
        Some(self.signal(signal)?.iter().skip(joint).step_by(width).copied().collect())
    }

    /// The velocity targets of a joint by its column number, rad/s; `None` if its targets are angles or the log has none.
    pub fn velocity_target(&self, joint: usize) -> Option<Vec<f64>> {
        let targets = self.target.as_ref().filter(|_| self.has_velocity_target(joint))?;
        Some(targets.iter().skip(joint).step_by(self.joints.len()).copied().collect())
    }

    /// Whether all arrays have the sizes that `time` and `joints` say, joint names are distinct and not empty,
    /// times finite, rate and gains usable numbers. Says nothing about the values.
    pub fn validate(&self) -> Result<(), LogError> {
        let refuse = |what: &str, problem: String| Err(LogError::Shape { what: what.to_owned(), problem });
        let (samples, joints) = (self.len(), self.joints.len());
        if joints == 0 {
            return refuse("joints", "none; a trajectory has at least one joint".into());
        }
        // Names come first, because messages below use them.
        let mut seen = HashSet::with_capacity(joints);
        for (i, name) in self.joints.iter().enumerate() {
            if name.is_empty() {
                return refuse("joints", format!("joint {i} has no name"));
            }
            if !seen.insert(name) {
                return refuse("joints", format!("`{}` twice; joint names must be distinct", shown(name)));
            }
        }
        if let Some(name) = self.velocity_joints.iter().find(|name| !seen.contains(name)) {
            let problem =
                format!("`{}` is not one of the log's joints; name them as its columns do", shown(name));
            return refuse("velocity_joints", problem);
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
            ("motion", self.motion.as_ref(), 2),
            ("base.position", base.position.as_ref(), 3),
            ("base.quaternion", base.quaternion.as_ref(), 4),
            ("base.linear_velocity", base.linear_velocity.as_ref(), 3),
            ("base.angular_velocity", base.angular_velocity.as_ref(), 3),
        ];
        // `checked_mul`: sizes come from a caller and may be anything.
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
            // NaN fails both comparisons.
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
        // A part that ends earlier does not end in the fall.
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
            // Marks the column as taken and tells whether it was before.
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
        let joints: Vec<String> = columns.iter().map(|&column| self.joints[column].clone()).collect();
        // Only the joints that remain may be named.
        let velocities = self.velocity_joints.iter().filter(|joint| joints.contains(joint));
        Ok(Trajectory {
            velocity_joints: velocities.cloned().collect(),
            joints,
            gains,
            position: pick(&self.position),
            velocity: pick(&self.velocity),
            target: self.target.as_deref().map(pick),
            action: self.action.as_deref().map(pick),
            ..self.clone()
        })
    }
}
