//! Does the robot do what it is asked? Tells a walking robot from one that is stuck, lies or fell.
//!
//! Whether a joint follows its target is judged in windows ([`super::windows`]); a robot is stuck where most of
//! the joints that are asked to move do not. Standing still under a constant target asks nothing and is no
//! finding.

use super::windows::{COMMANDED, FAR, Joint, Window, runs, windows};
use super::{CheckSpec, FindingKind, Findings, Severity};
use crate::stats::{decimals, mean, median};
use crate::{Signal, Trajectory};
use gaitfit_model::{shown, shown_number};

/// cos 60°: upright component of the base's z axis below which the robot fell.
pub(super) const TILTED: f64 = 0.5;
/// Time below it, s, that is a fall and not a stumble.
const TILTED_S: f64 = 0.5;

pub(super) fn check(findings: &mut Findings, spec: &CheckSpec) {
    let windows = windows(findings.log);
    let stuck: Vec<bool> = windows.iter().map(is_stuck).collect();
    not_following(findings, &windows, &stuck);
    single_joints(findings, &windows, &stuck);
    resting(findings, &windows, spec);
    super::imu::hanging(findings);
    // A unit that is mounted turned would look like a robot that fell.
    if !super::imu::mounting(findings, spec) {
        base(findings, spec);
    }
}

/// More than half of the joints that are asked to move, and at least two, do not.
pub(super) fn is_stuck(window: &Window) -> bool {
    let asked = window.joints.iter().filter(|joint| joint.asked).count();
    let held = window.joints.iter().filter(|joint| joint.asked && !joint.follows).count();
    // A single joint is another finding.
    held >= 2 && 2 * held > asked
}

fn span(windows: &[Window]) -> std::ops::Range<usize> {
    match (windows.first(), windows.last()) {
        (Some(first), Some(last)) => first.start..last.end,
        _ => 0..0,
    }
}

fn between(log: &Trajectory, span: &std::ops::Range<usize>) -> String {
    // An empty span at 0 wraps to a place that no log has, and `get` finds nothing.
    match (log.time.get(span.start), log.time.get(span.end.wrapping_sub(1))) {
        (Some(from), Some(to)) => format!("from {} to {} s", decimals(*from, 2), decimals(*to, 2)),
        _ => "throughout".into(),
    }
}

fn typical(values: impl Iterator<Item = f64>) -> f64 {
    let mut values: Vec<f64> = values.filter(|value| value.is_finite()).collect();
    median(&mut values).unwrap_or(f64::NAN)
}

fn not_following(findings: &mut Findings, windows: &[Window], stuck: &[bool]) {
    for run in runs(stuck) {
        let part = &windows[run];
        let joints: Vec<usize> = (0..findings.log.joints.len())
            // Joints that do not follow in most windows in which they are asked to move.
            .filter(|&joint| {
                let asked = part.iter().filter(|window| window.joints[joint].asked).count();
                let held = part.iter().filter(|w| w.joints[joint].asked && !w.joints[joint].follows).count();
                2 * held > asked
            })
            .collect();
        // Angles and speeds have different units: average only one of them, angles first.
        let is_wheel = |joint: &usize| findings.log.has_velocity_target(*joint);
        let only_wheels = joints.iter().all(is_wheel);
        let unit = if only_wheels { "rad/s" } else { "rad" };
        let same_unit: Vec<usize> =
            joints.iter().copied().filter(|joint| is_wheel(joint) == only_wheels).collect();
        let middle = |value: fn(&Joint) -> f64| {
            typical(
                part.iter()
                    .flat_map(|window| same_unit.iter().map(move |&joint| value(&window.joints[joint]))),
            )
        };
        let (asked, moved, away) =
            (middle(|j| j.target_motion), middle(|j| j.motion), middle(|j| j.distance));
        let span = span(part);
        let away = if away.is_finite() { format!(", {} rad away", decimals(away, 2)) } else { String::new() };
        let message = format!(
            "{}, {} do not do what they are asked (targets vary by {} {unit}, the joints by {} \
             {unit}{away}); the robot lies, is stuck or held, or its motors are off: leave this part out or \
             record again",
            between(findings.log, &span),
            findings.names(&joints),
            decimals(asked, 3),
            decimals(moved, 3),
        );
        findings.add(FindingKind::Stuck, Severity::Error, &joints, Some(span), message);
    }
}

fn single_joints(findings: &mut Findings, windows: &[Window], stuck: &[bool]) {
    for joint in 0..findings.log.joints.len() {
        let held: Vec<bool> =
            // A stuck robot is one finding, not one for each joint.
            windows.iter().zip(stuck).map(|(window, stuck)| !stuck && window.fails(joint)).collect();
        for run in runs(&held) {
            let part = &windows[run];
            let middle =
                |value: fn(&Joint) -> f64| typical(part.iter().map(|window| value(&window.joints[joint])));
            let (asked, moved) = (middle(|joint| joint.target_motion), middle(|joint| joint.motion));
            let span = span(part);
            let [asked, moved] = [asked, moved].map(|value| decimals(value, 3));
            let how = match findings.log.has_velocity_target(joint) {
                true => {
                    format!("asks for a speed or a change of {asked} rad/s, the wheel makes {moved} rad/s")
                }
                false => format!("varies by {asked} rad, the joint by {moved} rad"),
            };
            let message = format!(
                "{}, {} does not follow its target (which {how}) while others follow; is it blocked, unpowered, at its limit, or \
                 is the column another joint's?",
                between(findings.log, &span),
                shown(&findings.log.joints[joint]),
            );
            findings.add(FindingKind::JointNotFollowing, Severity::Warning, &[joint], Some(span), message);
        }
    }
}

fn resting(findings: &mut Findings, windows: &[Window], spec: &CheckSpec) {
    let log = findings.log;
    let idle: Vec<bool> = windows.iter().map(|window| window.rests() && window.command > COMMANDED).collect();
    for run in runs(&idle) {
        let span = span(&windows[run]);
        let message = format!(
            "{}, the command asks for motion and neither targets nor joints move; was the policy running?",
            between(log, &span)
        );
        findings.add(FindingKind::Stuck, Severity::Warning, &[], Some(span), message);
    }

    // A robot that rests far from its targets has no torque, or is held.
    let collapsed: Vec<bool> = windows.iter().map(Window::collapsed).collect();
    for run in runs(&collapsed) {
        let joints = windows[run.start].far(FAR);
        let span = span(&windows[run]);
        let message = format!(
            "{}, the robot rests with {} more than {FAR} rad from their targets; it lies with its motors off, or \
             is held: leave this part out",
            between(log, &span),
            findings.names(&joints)
        );
        findings.add(FindingKind::Lying, Severity::Error, &joints, Some(span), message);
    }

    // Against the standing pose only when the whole log is at rest: a motion may start from a crouch.
    if windows.is_empty() || !windows.iter().all(Window::rests) {
        return;
    }
    let joints: Vec<usize> = (0..log.joints.len())
        .filter(|&joint| {
            let Some(pose) = spec.default_pose.get(&log.joints[joint]) else { return false };
            let column = log.column_at(Signal::Position, joint).unwrap_or_default();
            (mean(&column) - pose).abs() > FAR
        })
        .collect();
    if !joints.is_empty() && 3 * joints.len() >= log.joints.len() {
        let message = format!(
            "the robot rests all the time with {} more than {FAR} rad from the standing pose; it lies",
            findings.names(&joints)
        );
        findings.add(FindingKind::Lying, Severity::Warning, &joints, None, message);
    }
}

fn base(findings: &mut Findings, spec: &CheckSpec) {
    let log = findings.log;
    let Some(base) = &log.base else { return };
    let min = ((TILTED_S * log.rate_hz) as usize).max(2);
    if let Some(quaternion) = &base.quaternion {
        let upright: Vec<f64> = quaternion.chunks_exact(4).map(|q| spec.upright(q)).collect();
        if let Some(span) = longest_below(&upright, TILTED, min) {
            // Rounding may bring the cosine beyond 1.
            let tilt =
                upright[span.clone()].iter().fold(1.0f64, |low, &up| low.min(up)).clamp(-1.0, 1.0).acos();
            let message = format!(
                "{}, the base is tilted by up to {:.0}°; the robot fell: leave this part out",
                between(log, &span),
                tilt.to_degrees()
            );
            findings.add(FindingKind::Fallen, Severity::Error, &[], Some(span), message);
        }
    }
    if let (Some(position), Some(limit)) = (&base.position, spec.lying_height) {
        let height: Vec<f64> = position.chunks_exact(3).map(|p| p[2]).collect();
        if let Some(span) = longest_below(&height, limit, min) {
            let lowest = height[span.clone()].iter().copied().fold(f64::INFINITY, f64::min);
            let message = format!(
                "{}, the base is as low as {} m, below {} m; the robot lies: leave this part out",
                between(log, &span),
                decimals(lowest, 3),
                shown_number(limit)
            );
            findings.add(FindingKind::Lying, Severity::Error, &[], Some(span), message);
        }
    }
}

/// Longest stretch of at least `min` values below `bound`.
fn longest_below(values: &[f64], bound: f64, min: usize) -> Option<std::ops::Range<usize>> {
    let mut longest: Option<std::ops::Range<usize>> = None;
    let mut start = None;
    // One step beyond the end closes a stretch that reaches it.
    for i in 0..=values.len() {
        let below = values.get(i).is_some_and(|value| *value < bound);
        match (below, start) {
            (true, None) => start = Some(i),
            (false, Some(from)) => {
                if i - from >= min && longest.as_ref().is_none_or(|known| i - from > known.len()) {
                    longest = Some(from..i);
                }
                start = None;
            }
            _ => {}
        }
    }
    longest
}
