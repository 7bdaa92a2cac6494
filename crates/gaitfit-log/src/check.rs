//! Checks of a log's content, each finding with a named reason, a place and a remedy.
//!
//! Thresholds are constants beside each check, with the reason for their value. They are set so that healthy
//! recordings of real robots pass: a robot standing under a zero command, legs swept in the air, a trot with
//! soft gains and noisy velocities.

mod copies;
mod falls;
mod following;
mod gross;
mod imu;
mod joints;
pub(crate) mod lag;
mod reading;
mod robot;
mod saturation;
mod time;
mod values;
mod velocity;
mod windows;

pub use copies::zero_rows;
pub use falls::{Fall, FallSign, falls};
pub use imu::{settle_angles, settle_imu};
pub use lag::VelocityLag;

use crate::Trajectory;
use crate::finding::{Finding, FindingKind, Severity, Span};
use crate::names::names;
use crate::scale::{self, scales};
use std::borrow::Cow;
use std::collections::{BTreeMap, BTreeSet};

/// What the checks may know about the robot. Everything is optional and by joint name; joints that the maps
/// lack are not held to a limit.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CheckSpec {
    /// The robot's joints in its own order.
    pub joints: Option<Vec<String>>,
    /// Joints that slide: their units are m, m/s and N.
    pub slides: BTreeSet<String>,
    /// Position limits, rad.
    pub position_limits: BTreeMap<String, [f64; 2]>,
    /// Speed limits, rad/s.
    pub velocity_limits: BTreeMap<String, f64>,
    /// Torque limits, N·m.
    pub effort_limits: BTreeMap<String, f64>,
    /// Pose the robot stands in, rad.
    pub default_pose: BTreeMap<String, f64>,
    /// Base height below which the robot lies, m, world frame, ground at 0.
    pub lying_height: Option<f64>,
    /// Direction of gravity in the base's frame when the robot stands as it should, unit; (0, 0, −1), level, when absent.
    pub posture: Option<[f64; 3]>,
}

impl CheckSpec {
    /// Cosine of the angle by which the base leans away from its posture, at the orientation `q` (w, x, y, z, base to
    /// world).
    fn upright(&self, q: &[f64]) -> f64 {
        let [w, x, y, z] = [q[0], q[1], q[2], q[3]];
        // The world's down in the base's frame: the third row of the rotation with the opposite sign.
        let gravity = [2.0 * (w * y - x * z), -2.0 * (y * z + w * x), 2.0 * (x * x + y * y) - 1.0];
        let posture = self.posture.unwrap_or([0.0, 0.0, -1.0]);
        gravity.iter().zip(posture).map(|(a, b)| a * b).sum()
    }
}

/// All findings, the worst first. An empty list: nothing suspicious.
pub fn check(log: &Trajectory, spec: &CheckSpec) -> Vec<Finding> {
    let mut findings = Findings { log, list: Vec::new() };
    if let Err(error) = log.validate() {
        findings.add(FindingKind::Malformed, Severity::Error, &[], None, error.to_string());
        return findings.list;
    }
    let mut unwrapped = Cow::Borrowed(log);
    if !log.velocity_joints.is_empty() {
        // A wheel's angle that wraps at a full turn would look like a jump.
        unwrapped.to_mut().unwrap_wheels();
    }
    let log = &*unwrapped;
    // Messages and spans are made from the unwrapped log too.
    findings.log = log;
    joints::check(&mut findings, spec);
    if log.len() < 2 {
        let message = format!("{} sample(s); record at least a second", log.len());
        findings.add(FindingKind::TooShort, Severity::Error, &[], None, message);
        return findings.list;
    }
    let scales = scales(&log.time, &log.position, &log.velocity, log.joints.len());
    // A wrong clock makes all velocities wrong by one factor; it is reported once.
    let rate_is_said = time::check(&mut findings, scales.shared);
    values::check(&mut findings, spec);
    copies::check(&mut findings);
    // Where no joint moves, nothing speaks against the clock.
    imu::check(&mut findings, scales.shared.is_none_or(|shared| scale::equal(shared, 1.0)));
    velocity::check(&mut findings, &scales, rate_is_said);
    lag::check(&mut findings, &scales);
    gross::check(&mut findings, spec);
    saturation::check(&mut findings, spec);
    following::check(&mut findings, spec);
    // A stable sort: findings of one severity stay in the order of the checks.
    findings.list.sort_by_key(|finding| std::cmp::Reverse(finding.severity));
    findings.list
}

/// Whether a log is that of a clamped robot, whose fit replays the targets and compares sample by sample: it has nothing that
/// logs of walks have.
fn replayed(log: &Trajectory) -> bool {
    log.base.is_none() && log.command.is_none() && log.action.is_none()
}

/// The growing list, and the log it is about.
struct Findings<'a> {
    log: &'a Trajectory,
    list: Vec<Finding>,
}

impl Findings<'_> {
    /// Adds a finding about joints given by column number and, if not the whole log, samples `span`.
    fn add(
        &mut self,
        kind: FindingKind,
        severity: Severity,
        joints: &[usize],
        span: Option<std::ops::Range<usize>>,
        message: String,
    ) {
        let time = &self.log.time;
        // A span without samples counts as the whole log.
        let span = span.filter(|span| span.start < span.end && span.end <= time.len()).map(|span| Span {
            start: span.start,
            end: span.end,
            from_s: time[span.start],
            to_s: time[span.end - 1],
        });
        let joints = joints.iter().map(|&joint| self.log.joints[joint].clone()).collect();
        self.list.push(Finding { kind, severity, joints, span, message });
    }

    /// Joint names for a message: all of them, or how many.
    fn names(&self, joints: &[usize]) -> String {
        if joints.len() == self.log.joints.len() && joints.len() > 1 {
            return format!("all {} joints", joints.len());
        }
        names(joints.iter().map(|&joint| self.log.joints[joint].as_str()))
    }
}
