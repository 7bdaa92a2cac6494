//! A log in windows of a second, and what each joint does in each of them.
//!
//! A PD-controlled joint, however soft, low-passes and delays its target: its position correlates with the
//! target filtered so, and moves by a fair part of it, whether it carries load or swings freely. A joint that
//! is held, or whose leg is under the robot, does neither. So, where the target moves, take the best
//! correlation over delays and filters; a joint below [`FOLLOWS`], or one that moves by less than
//! [`MOVED_SHARE`] of what is asked, does not follow. On a real trot at kp 20 the median joint reaches
//! 0.84–0.89 in every window; on the same robot lying, 0.0.

use crate::stats::{correlation, deviation, mean, rms};
use crate::{Signal, Trajectory};

/// Distance from target or pose, rad, that no standing robot's load explains: a loaded Go2 calf at kp 20
/// sags by 0.4.
pub(super) const FAR: f64 = 0.6;
/// Command norm (m/s and rad/s together) that asks for walking.
pub(super) const COMMANDED: f64 = 0.1;
/// Windows in a row that make a finding; they overlap by half, so this is 1.5 windows.
const IN_A_ROW: usize = 2;
/// Length of a window, s. Windows begin half a length apart.
const WINDOW_S: f64 = 1.0;
/// Min number of samples of a window: a correlation of fewer says little.
const WINDOW_SAMPLES: usize = 20;
/// Samples a second are thinned out to about this rate, Hz: joints move below 10 Hz.
const RATE_HZ: f64 = 100.0;
/// A target that deviates this much in a window, rad, asks for motion.
const ASKS: f64 = 0.05;
/// The same threshold for a velocity target, rad/s.
const ASKS_SPEED: f64 = 1.0;
/// A steady velocity target of this size, rad/s, asks a wheel to turn. A Go2-W that turns on the spot has wheels that rest under
/// targets of 4 rad/s.
const ASKS_STEADY_SPEED: f64 = 10.0;
/// Longest delay tried, s: transport, policy hold and the joint's own lag.
const DELAY_S: f64 = 0.2;
/// Time constants of the low-pass filters tried, s: kd/kp of usual gains is 0.02–0.1.
const FILTERS_S: [f64; 3] = [0.0, 0.05, 0.15];
/// Least correlation of a joint that follows.
const FOLLOWS: f64 = 0.4;
/// Correlation of a joint that does what it is asked and little else: legs in the air reach 0.99, the median joint of
/// a walking robot 0.8 to 0.95, for the ground moves its joints too.
const CLOSELY: f64 = 0.97;
/// A joint that moves by less than this share of its target's motion is held.
const HELD_SHARE: f64 = 0.1;
/// Least motion of a joint that follows, as a share of the target's.
const MOVED_SHARE: f64 = 0.03;
/// RMS velocity of a joint at rest, rad/s.
const REST_SPEED: f64 = 0.1;
/// Deviation of the position of a joint at rest, rad.
const REST_MOTION: f64 = 0.01;
/// Radians a unit of action, to tell motion from rest where a log has actions and no targets; the usual scale.
const ACTION_SCALE: f64 = 0.25;

/// What a joint is asked to do: its position target; up to an offset and a scale its action; or its velocity target, rad/s (in logs
/// without targets its action, unscaled).
enum Wish {
    Target(Vec<f64>),
    Action(Vec<f64>),
    Velocity(Vec<f64>),
}

impl Wish {
    fn values(&self) -> &[f64] {
        match self {
            Wish::Target(values) | Wish::Action(values) | Wish::Velocity(values) => values,
        }
    }
}

/// One joint in one window.
#[derive(Clone, Copy, Default)]
pub(super) struct Joint {
    /// The target moves.
    pub asked: bool,
    /// The position follows it.
    pub follows: bool,
    /// The position follows it and moves by nothing else.
    pub closely: bool,
    /// Nothing moves.
    pub rests: bool,
    /// Mean distance from the target, rad; NaN without a target.
    pub distance: f64,
    /// Deviations of target and position, rad. For a wheel: deviations of its target and measured velocity, rad/s, or the size of
    /// their means if the target is steady.
    pub target_motion: f64,
    pub motion: f64,
}

/// Thinned samples `start..end` of the log, judged.
pub(super) struct Window {
    pub start: usize,
    pub end: usize,
    pub joints: Vec<Joint>,
    /// Mean command norm; 0 without one.
    pub command: f64,
}

impl Joint {
    /// The target moves and the joint hardly does.
    fn held(&self) -> bool {
        self.motion < HELD_SHARE * self.target_motion
    }
}

impl Window {
    /// Whether a joint does not do what it is asked, though nothing but its own motor can be the reason: it is held, or
    /// most of the other joints that are asked to move follow closely, so that no ground moves them.
    pub fn fails(&self, joint: usize) -> bool {
        let judged = &self.joints[joint];
        if !judged.asked || judged.follows {
            return false;
        }
        let others =
            self.joints.iter().enumerate().filter(|(other, _)| *other != joint).map(|(_, other)| other);
        let (mut asked, mut closely) = (0, 0);
        for other in others.filter(|other| other.asked) {
            asked += 1;
            closely += usize::from(other.closely);
        }
        judged.held() || 2 * closely > asked
    }

    /// Nothing moves, and nothing is asked to.
    pub fn rests(&self) -> bool {
        self.joints.iter().all(|joint| joint.rests && !joint.asked)
    }

    /// Joints more than `distance` rad from their targets.
    pub fn far(&self, distance: f64) -> Vec<usize> {
        (0..self.joints.len()).filter(|&joint| self.joints[joint].distance > distance).collect()
    }

    /// At rest with a third of the joints far from their targets: no robot stands like this.
    pub fn collapsed(&self) -> bool {
        self.rests() && 3 * self.far(FAR).len() >= self.joints.len()
    }
}

/// The log's windows, each half over the one before; none when the log is too short to judge.
pub(super) fn windows(log: &Trajectory) -> Vec<Window> {
    // Rounded down, so that at least `RATE_HZ` samples a second stay.
    let stride = ((log.rate_hz / RATE_HZ).floor() as usize).clamp(1, log.len().max(1));
    let rate = log.rate_hz / stride as f64;
    let length = ((WINDOW_S * rate).round() as usize).max(WINDOW_SAMPLES);
    let lags = ((DELAY_S * rate).round() as usize).min(length);
    let thin = |column: Vec<f64>| -> Vec<f64> { column.into_iter().step_by(stride).collect() };
    let count = log.len().div_ceil(stride);
    // A short log is one window, with what delays there is room for.
    let length = length.min(count);
    if length < WINDOW_SAMPLES {
        return Vec::new();
    }
    // The last window ends with the log, where falls are.
    let last = count - length;
    let step = (length / 2).max(1);
    let mut windows: Vec<Window> = (0..last)
        .step_by(step)
        .chain([last])
        .map(|start| Window {
            start: start * stride,
            end: ((start + length) * stride).min(log.len()),
            joints: Vec::with_capacity(log.joints.len()),
            command: 0.0,
        })
        .collect();
    if let Some(command) = &log.command {
        for window in &mut windows {
            let rows = command[3 * window.start..3 * window.end].chunks_exact(3);
            let norms: Vec<f64> = rows.map(|row| row.iter().map(|v| v * v).sum::<f64>().sqrt()).collect();
            window.command = mean(&norms);
        }
    }
    for joint in 0..log.joints.len() {
        let column = |signal| log.column_at(signal, joint).map(thin);
        let q = column(Signal::Position).unwrap_or_default();
        let dq = column(Signal::Velocity).unwrap_or_default();
        let is_wheel = log.has_velocity_target(joint);
        // The most direct wish that the log has: a speed, a target, or an action with a usual scale.
        let speeds = log.velocity_target(joint).map(thin).map(Wish::Velocity);
        let wish = speeds.or_else(|| column(Signal::Target).map(Wish::Target)).or_else(|| {
            let action = column(Signal::Action)?;
            Some(if is_wheel {
                Wish::Velocity(action)
            } else {
                Wish::Action(action.iter().map(|action| ACTION_SCALE * action).collect())
            })
        });
        // Filtered once over the whole log: a filter that began anew in each window would need time to settle.
        let filtered: Vec<Vec<f64>> =
            wish.iter().flat_map(|wish| FILTERS_S.map(|time| low_pass(wish.values(), time * rate))).collect();
        for window in &mut windows {
            let range = window.start / stride..(window.start / stride + length).min(count);
            window.joints.push(judge(&q, &dq, wish.as_ref(), &filtered, range, lags));
        }
    }
    windows
}

fn judge(
    q: &[f64],
    dq: &[f64],
    wish: Option<&Wish>,
    filtered: &[Vec<f64>],
    range: std::ops::Range<usize>,
    lags: usize,
) -> Joint {
    // What answers the wish: a wheel's speed, or a joint's angle.
    let (answers, asks) = if matches!(wish, Some(Wish::Velocity(_))) { (dq, ASKS_SPEED) } else { (q, ASKS) };
    let here = &answers[range.clone()];
    let mut joint = Joint {
        // NaN compares false: a window with NaN neither rests nor asks.
        rests: rms(&dq[range.clone()]) < REST_SPEED && deviation(&q[range.clone()]) < REST_MOTION,
        motion: deviation(here),
        distance: f64::NAN,
        ..Joint::default()
    };
    let Some(wish) = wish else { return joint };
    let target = &wish.values()[range.clone()];
    if let Wish::Target(_) = wish {
        let errors: Vec<f64> = here.iter().zip(target).map(|(q, target)| q - target).collect();
        joint.distance = mean(&errors).abs();
    }
    joint.target_motion = deviation(target);
    let level = mean(target);
    if matches!(wish, Wish::Velocity(_)) && joint.target_motion <= asks && level.abs() > ASKS_STEADY_SPEED {
        // Under a steady target only the wheel's mean speed is judged.
        let speed = mean(here) * level.signum();
        (joint.target_motion, joint.motion) = (level.abs(), speed.abs());
        joint.asked = joint.motion.is_finite();
        joint.follows = speed > HELD_SHARE * level.abs();
        return joint;
    }
    joint.asked = joint.target_motion > asks && joint.motion.is_finite();
    if !joint.asked {
        return joint;
    }
    // The answer is late by an unknown time, so each delay is tried.
    for lag in 0..=lags {
        // Near the end of the log the later samples of the answer are missing: compare what there is.
        let end = (range.end + lag).min(answers.len());
        let answer = &answers[range.start + lag..end];
        if answer.len() < WINDOW_SAMPLES || deviation(answer) < MOVED_SHARE * joint.target_motion {
            continue;
        }
        let likeness = filtered
            .iter()
            .map(|asked| correlation(&asked[range.start..range.start + answer.len()], answer))
            .fold(-1.0, f64::max);
        joint.follows |= likeness >= FOLLOWS;
        joint.closely |= likeness >= CLOSELY;
        if joint.closely {
            break;
        }
    }
    joint
}

/// First-order low-pass with a time constant in samples (0: none), started at the first value.
fn low_pass(values: &[f64], time_constant: f64) -> Vec<f64> {
    if time_constant <= 0.0 {
        return values.to_vec();
    }
    let keep = (-1.0 / time_constant).exp();
    let mut state = values.first().copied().unwrap_or_default();
    values
        .iter()
        .map(|&value| {
            // NaN must not stay in the filter for good.
            if value.is_finite() {
                state = if state.is_finite() { keep * state + (1.0 - keep) * value } else { value };
            }
            if value.is_finite() { state } else { value }
        })
        .collect()
}

/// Runs of `IN_A_ROW` or more true windows (any, when there are fewer windows than that), as window ranges.
pub(super) fn runs(flags: &[bool]) -> Vec<std::ops::Range<usize>> {
    let needed = IN_A_ROW.min(flags.len());
    let mut runs = Vec::new();
    let mut start = None;
    for (i, flag) in flags.iter().chain([&false]).enumerate() {
        match (flag, start) {
            (true, None) => start = Some(i),
            (false, Some(from)) => {
                if i - from >= needed {
                    runs.push(from..i);
                }
                start = None;
            }
            _ => {}
        }
    }
    runs
}
