//! Are the values numbers, within limits, in the right unit, and alive?

use super::falls::stretches;
use super::{CheckSpec, FindingKind, Findings, Severity};
use crate::stats::{decimals, deviation, range};
use crate::{Signal, Trajectory, motion};
use gaitfit_model::{shown, shown_number};
use std::collections::HashSet;

/// Overshoot of a position limit that compliance and calibration explain, rad.
const POSITION_SLACK: f64 = 0.02;
/// Time beyond a limit, s, of a joint that bounces off its stop.
const MOMENT_S: f64 = 0.1;
/// Beyond this overshoot, rad, the value cannot be that joint's position.
const POSITION_IMPOSSIBLE: f64 = 0.2;
/// Measured speed may exceed the actuator's limit when the ground drives the joint; not this many times.
const SPEED_IMPOSSIBLE: f64 = 2.0;
/// In a log that ends in a fall, the part of the samples in which the fall may drive a joint beyond its limits.
const FALLING: f64 = 0.1;
/// No leg joint turns two full turns, rad; in degrees it does so in any step.
const TWO_TURNS: f64 = 12.6;
/// Faster than this, rad/s, only a wheel's motor turns; a leg in degrees does so in any step.
const FASTER: f64 = 60.0;
/// Fewer samples may be equal by chance or rest.
const ENOUGH: usize = 20;
/// A position that moves more than this, rad, moves.
const MOVES: f64 = 0.01;

pub(super) fn check(findings: &mut Findings, spec: &CheckSpec) {
    not_finite(findings);
    if let Some(motion) = &findings.log.motion
        && let Some(message) = motion::runs_wrongly(&findings.log.time, motion)
    {
        findings.add(FindingKind::SuspectUnit, Severity::Error, &[], None, message);
    }
    units(findings, spec);
    position_limits(findings, spec);
    velocity_limits(findings, spec);
    if findings.log.len() >= ENOUGH {
        constant(findings);
    }
}

fn not_finite(findings: &mut Findings) {
    let log = findings.log;
    let width = log.joints.len();
    for signal in Signal::ALL {
        let Some(values) = log.signal(signal) else { continue };
        let bad: Vec<usize> = (0..values.len()).filter(|&i| !values[i].is_finite()).collect();
        // One finding a signal, with all its joints, instead of one for each value.
        let (Some(first), Some(last)) = (bad.first(), bad.last()) else { continue };
        let mut joints: Vec<usize> = bad.iter().map(|i| i % width).collect();
        joints.sort_unstable();
        joints.dedup();
        let message = format!(
            "{} {signal} value(s) of {} are NaN or infinite, the first at {} s; cut the log there or record again",
            bad.len(),
            findings.names(&joints),
            shown_number(log.time[first / width])
        );
        let span = first / width..last / width + 1;
        findings.add(FindingKind::NotFinite, Severity::Error, &joints, Some(span), message);
    }
    let base = log.base.clone().unwrap_or_default();
    for (what, values, width, severity) in [
        ("command", &log.command, 3, Severity::Error),
        // What the simulation needs is an error; what only some costs need is a warning.
        ("motion_time or motion_heading", &log.motion, 2, Severity::Error),
        ("base position", &base.position, 3, Severity::Warning),
        ("base orientation", &base.quaternion, 4, Severity::Warning),
        ("base velocity", &base.linear_velocity, 3, Severity::Warning),
        ("body rate", &base.angular_velocity, 3, Severity::Warning),
    ] {
        let Some(values) = values else { continue };
        let count = values.iter().filter(|value| !value.is_finite()).count();
        if let Some(first) = values.iter().position(|value| !value.is_finite()) {
            let message = format!(
                "{count} {what} value(s) are NaN or infinite, the first at {} s; what needs the {what} cannot use \
                 these samples",
                shown_number(log.time[first / width])
            );
            findings.add(FindingKind::NotFinite, severity, &[], None, message);
        }
    }
}

fn position_limits(findings: &mut Findings, spec: &CheckSpec) {
    let log = findings.log;
    for signal in [Signal::Position, Signal::Target] {
        let mut worst: Option<(usize, f64)> = None;
        let mut joints = Vec::new();
        let mut at_stops = true;
        let mut impossible = false;
        for (joint, name) in log.joints.iter().enumerate() {
            let (Some([low, high]), Some(column)) =
                (spec.position_limits.get(name), log.column_at(signal, joint))
            else {
                continue;
            };
            let Some((min, max)) = range(&column) else { continue };
            // Values beyond the limit only count if the robot does not fall just then.
            let over = (low - min).max(max - high);
            if over > POSITION_SLACK {
                let beyond = |q: f64| q < low - POSITION_IMPOSSIBLE || q > high + POSITION_IMPOSSIBLE;
                impossible |= over > POSITION_IMPOSSIBLE && !falls(log, &column, beyond);
                joints.push(joint);
                // A joint at its stop with a torque on it bends a little.
                at_stops &= hits_its_stop(log, joint, &column, [*low, *high]);
                if worst.is_none_or(|(_, max)| over > max) {
                    worst = Some((joint, over));
                }
            }
        }
        // One finding a signal, with the worst joint as its example.
        let Some((joint, over)) = worst else { continue };
        let name = &log.joints[joint];
        let [low, high] = spec.position_limits[name];
        let unit = spec.kind(name).unit("rad");
        let check_unit = format!("check unit ({unit}), sign, zero and which column is which joint");
        let impossible = signal == Signal::Position && impossible;
        let falls = signal == Signal::Position && over > POSITION_IMPOSSIBLE;
        let message = format!(
            "{signal} of {} beyond limits, most {}, {} {unit} outside [{}, {}]; {}",
            findings.names(&joints),
            shown(name),
            decimals(over, 3),
            shown_number(low),
            shown_number(high),
            if impossible {
                &check_unit
            } else if signal == Signal::Target {
                "a PD controller may ask for that to push against its limit; the joint will not get there"
            } else if falls {
                "the robot falls in this log, which drives joints beyond their stops"
            } else if at_stops {
                "the joint hits its stop, which gives a little"
            } else {
                "compliance explains a little; check the joint's zero and the model's limits"
            }
        );
        // Targets may lie beyond the limits on purpose, so they are a note at most.
        let severity = match signal {
            _ if impossible => Severity::Error,
            Signal::Position if !at_stops => Severity::Warning,
            _ => Severity::Note,
        };
        findings.add(FindingKind::BeyondPositionLimit, severity, &joints, None, message);
    }
}

/// Whether a joint that goes beyond its limits hits its stops, which give a little: for a moment each time, or because
/// its targets lie further out. `column`: its positions, rad.
fn hits_its_stop(log: &Trajectory, joint: usize, column: &[f64], [low, high]: [f64; 2]) -> bool {
    // At low rates one sample counts as a moment, however long it is.
    let brief = (MOMENT_S * log.rate_hz).max(1.0);
    let target = log.column_at(Signal::Target, joint).and_then(|target| range(&target));
    let side = |beyond: Vec<bool>, further: bool| {
        further || stretches(&beyond).iter().all(|stretch| stretch.len() as f64 <= brief)
    };
    let (min, max) = range(column).unwrap_or_default();
    side(
        column.iter().map(|q| *q < low - POSITION_SLACK).collect(),
        target.is_some_and(|target| target.0 < min),
    ) && side(
        column.iter().map(|q| *q > high + POSITION_SLACK).collect(),
        target.is_some_and(|target| target.1 > max),
    )
}

/// Whether the robot's fall explains the few samples of a joint that are `beyond` its limits.
fn falls(log: &Trajectory, column: &[f64], beyond: impl Fn(f64) -> bool) -> bool {
    let many = column.iter().filter(|value| beyond(**value)).count();
    log.fell && many as f64 <= FALLING * column.len() as f64
}

fn velocity_limits(findings: &mut Findings, spec: &CheckSpec) {
    let log = findings.log;
    let mut worst: Option<(usize, f64, f64)> = None;
    let mut joints = Vec::new();
    let mut impossible = false;
    for (joint, name) in log.joints.iter().enumerate() {
        let (Some(&limit), Some(column)) =
            (spec.velocity_limits.get(name), log.column_at(Signal::Velocity, joint))
        else {
            continue;
        };
        let Some((low, high)) = range(&column) else { continue };
        let ratio = high.max(-low) / limit;
        if ratio > 1.0 {
            // As for positions: an impact in a fall may drive a joint that fast.
            let beyond = |speed: f64| speed.abs() > SPEED_IMPOSSIBLE * limit;
            impossible |= ratio > SPEED_IMPOSSIBLE && !falls(log, &column, beyond);
            joints.push(joint);
            if worst.is_none_or(|(_, max, _)| ratio > max) {
                worst = Some((joint, ratio, high.max(-low)));
            }
        }
    }
    let Some((joint, _, speed)) = worst else { return };
    let name = &log.joints[joint];
    let limit = spec.velocity_limits[name];
    let unit = spec.kind(name).unit("rad/s");
    let check_unit = format!("check the unit ({unit})");
    let message = format!(
        "velocity of {} beyond limits, most {} with {} of {} {unit}; {}",
        findings.names(&joints),
        shown(name),
        decimals(speed, 2),
        shown_number(limit),
        if impossible {
            &check_unit
        } else {
            "the ground can drive a joint faster than its motor; if it happens often, check the model's limit"
        }
    );
    let severity = if impossible { Severity::Error } else { Severity::Note };
    findings.add(FindingKind::BeyondVelocityLimit, severity, &joints, None, message);
}

fn units(findings: &mut Findings, spec: &CheckSpec) {
    let log = findings.log;
    // A joint that the robot's file knows without limits may turn as far as it likes.
    let known: HashSet<&String> = spec.joints.iter().flatten().collect();
    let turns = |joint: usize| known.contains(&log.joints[joint]);
    for signal in [Signal::Position, Signal::Target] {
        let joints: Vec<usize> = (0..log.joints.len())
            .filter(|&joint| {
                let column = log.column_at(signal, joint).unwrap_or_default();
                let Some((low, high)) = range(&column) else { return false };
                // Limits tell degrees: beyond them by far, and within them as radians.
                let within = |[min, max]: &[f64; 2]| {
                    low.to_radians() > min - POSITION_IMPOSSIBLE
                        && high.to_radians() < max + POSITION_IMPOSSIBLE
                };
                let possible = spec.position_limits.get(&log.joints[joint]).map_or(!turns(joint), within);
                high.max(-low) > TWO_TURNS && possible && !log.has_velocity_target(joint)
            })
            .collect();
        if joints.is_empty() {
            continue;
        }
        let speed = |joint: &usize| {
            let column = log.column_at(Signal::Velocity, *joint).unwrap_or_default();
            range(&column).map_or(0.0, |(low, high)| high.max(-low))
        };
        // One joint may turn far; most joints together do so only in another unit.
        let majority = joints.len() >= 2 && 2 * joints.len() > log.joints.len();
        let (severity, remedy) = if majority || joints.iter().any(|joint| speed(joint) > FASTER) {
            (
                Severity::Error,
                "it is in degrees, it seems. Import it with `unit = \"deg\"` in a mapping: `gaitfit import LOG.csv \
                 --mapping MAP.toml --out NEW.csv`, or `gaitfit new --mapping MAP.toml`",
            )
        } else {
            (
                Severity::Note,
                "a wheel or a pendulum may turn so far; if it is in degrees, import it with `unit = \"deg\"` in a mapping \
                 (`--robot` says which joints have limits)",
            )
        };
        let message = format!("{signal} of {} exceeds two full turns; {remedy}", findings.names(&joints));
        findings.add(FindingKind::SuspectUnit, severity, &joints, None, message);
    }
}

fn constant(findings: &mut Findings) {
    let log = findings.log;
    let joints = log.joints.len();
    // A signal that the log lacks is empty, and so is one of a joint whose targets are velocities.
    let columns = |signal: Signal| -> Vec<Vec<f64>> {
        let there = log.signal(signal).is_some();
        (0..joints).filter(|_| there).map(|joint| log.column_at(signal, joint).unwrap_or_default()).collect()
    };
    let is_constant = |column: &Vec<f64>| range(column).is_some_and(|(low, high)| low == high);
    let pick =
        |test: &dyn Fn(usize) -> bool| -> Vec<usize> { (0..joints).filter(|&joint| test(joint)).collect() };
    let (position, velocity) = (columns(Signal::Position), columns(Signal::Velocity));
    let (target, action) = (columns(Signal::Target), columns(Signal::Action));
    // "Asked" by a target that moves; a constant position is then a fault, not rest.
    let asked = |joint: usize| target.get(joint).is_some_and(|column| deviation(column) > MOVES);
    let moves = |joint: usize| range(&position[joint]).is_some_and(|(low, high)| high - low > MOVES);

    let dead = pick(&|joint| is_constant(&position[joint]) && asked(joint));
    if !dead.is_empty() {
        let message = format!(
            "position of {} never changes while its target does; the encoder is not read, or the columns are mixed up",
            findings.names(&dead)
        );
        findings.add(FindingKind::ConstantSignal, Severity::Error, &dead, None, message);
    }
    let still = pick(&|joint| is_constant(&position[joint]) && !asked(joint));
    if !still.is_empty() {
        let message = format!(
            "position of {} never changes, not even by encoder noise; nothing can be learned of it from this log",
            findings.names(&still)
        );
        findings.add(FindingKind::ConstantSignal, Severity::Warning, &still, None, message);
    }
    let deaf = pick(&|joint| is_constant(&velocity[joint]) && moves(joint));
    if !deaf.is_empty() {
        let message = format!(
            "velocity of {} is constant while the position moves; log the encoder's velocity",
            findings.names(&deaf)
        );
        findings.add(FindingKind::ConstantSignal, Severity::Error, &deaf, None, message);
    }
    if !action.is_empty() {
        let idle = pick(&|joint| is_constant(&action[joint]));
        if !idle.is_empty() {
            let message =
                format!("action of {} never changes; was the policy running?", findings.names(&idle));
            findings.add(FindingKind::ConstantSignal, Severity::Warning, &idle, None, message);
        }
    }
    if !target.is_empty() {
        let fixed = pick(&|joint| is_constant(&target[joint]));
        if fixed.len() == joints {
            let message =
                "no joint's target ever changes; such a log identifies nothing: record a motion".to_owned();
            findings.add(FindingKind::FrozenTarget, Severity::Warning, &[], None, message);
        } else if !fixed.is_empty() {
            let message = format!(
                "target of {} never changes; its parameters will be poorly known",
                findings.names(&fixed)
            );
            findings.add(FindingKind::ConstantSignal, Severity::Note, &fixed, None, message);
        }
    }
}
