//! Does an encoder slip or hang, or is a single reading wrong?
//!
//! Logs of Go2 robots, in the air, walking, and stuck, and logs of simulated ones stay below 0.7 of these bounds.

use super::copies::{JUMPS, zero_rows};
use super::{CheckSpec, FindingKind, Findings, Severity};
use crate::scale::{GAP, typical_step};
use crate::stats::{median, range, short};
use crate::{Signal, Trajectory};
use gaitfit_model::{shown, shown_number};
use std::f64::consts::TAU;
use std::ops::Range;

/// The smallest jump, and the smallest motion that a frozen position misses: rad, of slides m.
const FAR: f64 = 0.05;
const FAR_SLIDE: f64 = 0.02;
/// The smallest spike of a velocity, rad/s.
const FAST: f64 = 10.0;
/// How many times their median, and how many times what nine of ten stay below, a value is far beyond the usual ones.
const MANY: f64 = 20.0;
const MOST: f64 = 8.0;
/// How many times what the velocities around a jump explain it must be. A robot's rows may come late by some intervals
/// without a gap in the stamps.
const UNEXPLAINED: f64 = 5.0;
/// How many times its neighbours, and the speed by the positions, a spike must be.
const SHARP: f64 = 3.0;
/// Shortest time, s (less rounding), and fewest samples of the same number that count as frozen.
const HELD_S: f64 = 0.0499;
const HELD: usize = 5;
/// How many steps of the encoder a frozen position must miss.
const RESOLUTION: f64 = 10.0;
/// The speed that a frozen position must miss on the mean, as a multiple of the smallest motion a second: noise of the
/// velocities adds up over a long rest.
const MISSED_A_SECOND: f64 = 6.0;
/// Longest usual interval, s. At lower rates a servo finishes a step between two rows.
const SLOW_S: f64 = 0.03;
/// Fewer intervals do not show what is usual.
const ENOUGH: usize = 20;

/// What is wrong with one joint in some rows, and by how much: rad or rad/s, of slides m or m/s.
struct Fault {
    joint: usize,
    rows: Range<usize>,
    size: f64,
}

pub(super) fn check(findings: &mut Findings, spec: &CheckSpec) {
    let log = findings.log;
    let Some(typical) = typical_step(&log.time).filter(|typical| *typical <= SLOW_S) else { return };
    let held = held_rows(log);
    let zeros = jumps_to_zero(log);
    let (mut jumps, mut freezes, mut spikes) = (Vec::new(), Vec::new(), Vec::new());
    for joint in 0..log.joints.len() {
        let Some(column) = Column::new(log, joint, typical) else { continue };
        let kind = spec.kind(&log.joints[joint]);
        let far = if kind.is_hinge() { FAR } else { FAR_SLIDE };
        // Behind rows that hold the row before, all positions jump.
        let jump = |row: usize| Fault { joint, rows: row..row + 2, size: column.change(row) };
        // An angle that wraps jumps by whole turns.
        let wraps = |row: usize| kind.is_hinge() && column.turns(row);
        jumps.extend(column.jumps(far, |row| held[row] || zeros[row] || wraps(row)).into_iter().map(jump));
        freezes.extend(column.freezes(far).into_iter().map(|(rows, size)| Fault { joint, rows, size }));
        let spike = |row: usize| Fault { joint, rows: row..row + 1, size: column.dq[row].abs() };
        spikes.extend(column.spikes(kind.like("rad/s", FAST)).into_iter().map(spike));
    }
    let of_all = |fault: &Fault| fault.rows.clone().skip(1).all(|row| held[row]);
    let (together, alone): (Vec<Fault>, Vec<Fault>) = freezes.into_iter().partition(of_all);
    jumped(findings, spec, &jumps);
    frozen(findings, spec, &alone, false);
    // Where many rows repeat the row before, this is reported already.
    if !findings.list.iter().any(|finding| finding.kind == FindingKind::RepeatedRows) {
        frozen(findings, spec, &together, true);
    }
    spiked(findings, spec, &spikes);
}

/// Rows in which all positions are those of the row before. A single joint may rest.
fn held_rows(log: &Trajectory) -> Vec<bool> {
    let width = log.joints.len();
    let row = |row: usize| &log.position[row * width..(row + 1) * width];
    (0..log.len()).map(|at| at > 0 && width > 1 && row(at) == row(at - 1)).collect()
}

/// Rows before and in jumps to zero, which are reported as such.
fn jumps_to_zero(log: &Trajectory) -> Vec<bool> {
    let mut zeros = vec![false; log.len()];
    let runs = zero_rows(&log.position, log.joints.len());
    if runs.len() >= JUMPS {
        runs.into_iter().for_each(|run| zeros[run.start - 1..run.end].fill(true));
    }
    zeros
}

/// One joint's positions and velocities. An interval has the number of the row that it begins with.
struct Column<'a> {
    time: &'a [f64],
    q: Vec<f64>,
    dq: Vec<f64>,
    /// Whether an interval lies between numbers and is neither a gap nor backward.
    whole: Vec<bool>,
    /// How much the change of position in an interval exceeds what the velocities explain, less the median.
    off: Vec<f64>,
    /// The first row of those up to this one that repeat one number.
    since: Vec<usize>,
}

impl<'a> Column<'a> {
    /// `None` if too little of the joint can be compared. `typical`: the usual interval, s.
    fn new(log: &'a Trajectory, joint: usize, typical: f64) -> Option<Self> {
        let (q, dq) = (log.column_at(Signal::Position, joint)?, log.column_at(Signal::Velocity, joint)?);
        // A velocity that never changes has a finding of its own.
        range(&dq).filter(|(low, high)| low < high)?;
        let time = log.time.as_slice();
        let by_velocity = |row: usize| 0.5 * (time[row + 1] - time[row]) * (dq[row] + dq[row + 1]);
        let intervals = 0..time.len().saturating_sub(1);
        let is_whole = |row: usize| {
            let step = time[row + 1] - time[row];
            step > 0.0 && step <= GAP * typical && (q[row + 1] - q[row] - by_velocity(row)).is_finite()
        };
        let whole: Vec<bool> = intervals.clone().map(is_whole).collect();
        let mut off: Vec<f64> = intervals.map(|row| q[row + 1] - q[row] - by_velocity(row)).collect();
        let mut known: Vec<f64> =
            off.iter().zip(&whole).filter(|(_, whole)| **whole).map(|(off, _)| *off).collect();
        if known.len() < ENOUGH {
            return None;
        }
        // Velocities may have a bias.
        let usual = median(&mut known)?;
        off.iter_mut().for_each(|off| *off -= usual);
        let mut since: Vec<usize> = (0..time.len()).collect();
        for row in 1..time.len() {
            if whole[row - 1] && q[row] == q[row - 1] {
                since[row] = since[row - 1];
            }
        }
        Some(Self { time, q, dq, whole, off, since })
    }

    fn judged(&self) -> impl Iterator<Item = usize> {
        (0..self.whole.len()).filter(move |&row| self.whole[row])
    }

    /// By how much the position changes in an interval.
    fn change(&self, row: usize) -> f64 {
        (self.q[row + 1] - self.q[row]).abs()
    }

    /// The highest speed around the rows `from` to `to`.
    fn fastest(&self, from: usize, to: usize) -> f64 {
        let rows = from.saturating_sub(1)..(to + 2).min(self.dq.len());
        self.dq[rows].iter().map(|speed| speed.abs()).fold(0.0, f64::max)
    }

    /// Whether the position changes by whole turns beyond what the velocities explain.
    fn turns(&self, row: usize) -> bool {
        let turns = (self.off[row].abs() / TAU).round();
        turns > 0.0 && (self.off[row].abs() - turns * TAU).abs() < FAR
    }

    /// Intervals in which the position jumps, except those that `explained` names.
    fn jumps(&self, far: f64, explained: impl Fn(usize) -> bool) -> Vec<usize> {
        let limit = far.max(beyond_usual(self.judged().map(|row| self.off[row])));
        let jumps = |row: &usize| {
            let row = *row;
            // Each repeat of a number is looked at once: it ends where the position changes.
            if self.off[row].abs() <= limit || self.change(row) == 0.0 || explained(row) {
                return false;
            }
            // What repeats a number may have missed a motion, which is no jump.
            let since = self.since[row];
            let moves = (self.time[row + 1] - self.time[since]) * self.fastest(since, row + 1);
            self.change(row) > UNEXPLAINED * moves
        };
        self.judged().filter(jumps).collect()
    }

    /// Rows that repeat a position while the joint moves, and by how much it moves.
    fn freezes(&self, far: f64) -> Vec<(Range<usize>, f64)> {
        let steps = self.judged().map(|row| self.change(row)).filter(|step| *step > 0.0);
        // Infinite if the position never changes, which has a finding of its own.
        let far = far.max(RESOLUTION * steps.fold(f64::INFINITY, f64::min));
        let mut freezes = Vec::new();
        let mut start = 0;
        while start < self.q.len() {
            let end = (start + 1..self.q.len()).find(|row| self.since[*row] != start).unwrap_or(self.q.len());
            let time = self.time[end - 1] - self.time[start];
            if end - start >= HELD && time >= HELD_S {
                let missed = self.missed(start, end - 1, far);
                if missed > far * (MISSED_A_SECOND * time).max(1.0) {
                    freezes.push((start..end, missed));
                }
            }
            start = end;
        }
        freezes
    }

    /// By how much the joint moves while its position is the same from row `first` to row `last`.
    fn missed(&self, first: usize, last: usize, far: f64) -> f64 {
        // No position changes here, so `off` is the motion by the velocities.
        let moves = |from: usize| {
            let mut sum = 0.0_f64;
            self.off[from..last].iter().fold(0.0, |most: f64, off| {
                sum += off;
                most.max(sum.abs())
            })
        };
        // Filtered velocities go on a little when a joint hits its stop.
        let goes_on = moves(first + (last - first) / 2) > far / 3.0;
        let by_velocity = if goes_on { moves(first) } else { 0.0 };
        // Where the velocities are frozen too, those before and after tell.
        let inside = first > 0 && last + 1 < self.q.len() && self.whole[first - 1] && self.whole[last];
        if !inside {
            return by_velocity;
        }
        let (before, after) = (self.dq[first - 1], self.dq[last + 1]);
        let slower = if before * after > 0.0 { before.abs().min(after.abs()) } else { 0.0 };
        let around = slower * (self.time[last] - self.time[first]);
        by_velocity.max(around.min(self.change(last)))
    }

    /// Rows whose velocity is far from those beside it and from the change of the positions.
    fn spikes(&self, fast: f64) -> Vec<usize> {
        let mut rows: Vec<usize> =
            (1..self.whole.len()).filter(|&row| self.whole[row - 1] && self.whole[row]).collect();
        let bend = |row: usize| self.dq[row] - 0.5 * (self.dq[row - 1] + self.dq[row + 1]);
        let limit = fast.max(beyond_usual(rows.iter().map(|row| bend(*row))));
        let speed = |row: usize| self.change(row) / (self.time[row + 1] - self.time[row]);
        let spikes = |row: &usize| {
            let row = *row;
            let beside = self.dq[row - 1].abs().max(self.dq[row + 1].abs());
            let near = beside.max(speed(row - 1)).max(speed(row));
            bend(row).abs() > limit && self.dq[row].abs() > SHARP * near
        };
        rows.retain(spikes);
        rows
    }
}

/// The size from which on a value is far beyond the usual ones. Both parts are needed: a joint that mostly rests has a small
/// median.
fn beyond_usual(values: impl Iterator<Item = f64>) -> f64 {
    let mut sizes: Vec<f64> = values.map(f64::abs).collect();
    sizes.sort_unstable_by(f64::total_cmp);
    let at = |place: usize| sizes.get(place).copied().unwrap_or(f64::INFINITY);
    (MANY * at(sizes.len() / 2)).max(MOST * at(sizes.len() * 9 / 10))
}

/// The joints of faults, in order, and the largest fault: of hinges and slides as sizes that correspond.
fn largest<'f>(
    findings: &Findings,
    spec: &CheckSpec,
    faults: &'f [Fault],
) -> Option<(Vec<usize>, &'f Fault)> {
    let mut joints: Vec<usize> = faults.iter().map(|fault| fault.joint).collect();
    joints.dedup();
    let weight = |fault: &&Fault| fault.size / spec.kind(&findings.log.joints[fault.joint]).like("rad", 1.0);
    let largest = faults.iter().max_by(|a, b| weight(a).total_cmp(&weight(b)))?;
    Some((joints, largest))
}

/// `name` and the unit that its joint has for `unit` of a hinge.
fn named(findings: &Findings, spec: &CheckSpec, joint: usize, unit: &'static str) -> (String, String) {
    let name = &findings.log.joints[joint];
    (shown(name), spec.kind(name).unit(unit).to_owned())
}

fn jumped(findings: &mut Findings, spec: &CheckSpec, jumps: &[Fault]) {
    let Some((joints, worst)) = largest(findings, spec, jumps) else { return };
    let time = &findings.log.time;
    let (name, unit) = named(findings, spec, worst.joint, "rad");
    let message = format!(
        "position of {} jumps {} time(s), which its velocity does not explain; the largest is {} {unit} of {name}, from {} s \
         to {} s. An encoder slipped or was misread, or two recordings were joined: cut the log there",
        findings.names(&joints),
        jumps.len(),
        short(worst.size),
        shown_number(time[worst.rows.start]),
        shown_number(time[worst.rows.end - 1])
    );
    findings.add(FindingKind::PositionJump, Severity::Warning, &joints, Some(worst.rows.clone()), message);
}

/// Positions that repeat one number while the joints move. `together`: of all joints at the same time.
fn frozen(findings: &mut Findings, spec: &CheckSpec, freezes: &[Fault], together: bool) {
    let Some((joints, worst)) = largest(findings, spec, freezes) else { return };
    let time = &findings.log.time;
    let (name, unit) = named(findings, spec, worst.joint, "rad");
    let (from, to) = (shown_number(time[worst.rows.start]), shown_number(time[worst.rows.end - 1]));
    let size = short(worst.size);
    let message = match together {
        false => format!(
            "position of {} repeats one number {} time(s) while the joint moves; the worst is {name} from {from} s to {to} s: \
             it moves by about {size} {unit}. The encoder was not read: cut the log there",
            findings.names(&joints),
            freezes.len()
        ),
        true => format!(
            "the positions of all joints stand still from {from} s to {to} s, while {name} moves by about {size} {unit}: rows \
             were lost, and the recorder repeated the last one. Cut the log there"
        ),
    };
    findings.add(FindingKind::FrozenPosition, Severity::Warning, &joints, Some(worst.rows.clone()), message);
}

fn spiked(findings: &mut Findings, spec: &CheckSpec, spikes: &[Fault]) {
    let Some((joints, worst)) = largest(findings, spec, spikes) else { return };
    let (name, unit) = named(findings, spec, worst.joint, "rad/s");
    let message = format!(
        "velocity of {} has {} spike(s) of one sample, which the position does not follow; the largest is {} {unit} of {name} \
         at {} s. The sensor was misread: cut the log there",
        findings.names(&joints),
        spikes.len(),
        short(worst.size),
        shown_number(findings.log.time[worst.rows.start])
    );
    findings.add(FindingKind::VelocitySpike, Severity::Warning, &joints, Some(worst.rows.clone()), message);
}
