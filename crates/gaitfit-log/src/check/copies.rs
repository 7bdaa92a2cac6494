//! Are the signals what they claim to be, and not copies of others or zeros of another writer?

use super::{FindingKind, Findings, Severity};
use crate::Signal;
use crate::stats::{deviation, range};
use gaitfit_model::shown_number;

/// A joint that deviates by less than this, rad, does not show what its target is.
const MOVES: f64 = 0.01;
/// RMS difference, as a part of the motion, below which a target is the position itself: no motor follows so closely.
const SAME: f64 = 0.002;
/// Samples by which a copy may be old.
const OLD: usize = 2;
/// Min number of samples that show it.
const ENOUGH: usize = 20;
/// A joint further than this from 0, rad, cannot be there a sample later and back.
const AWAY: f64 = 0.05;
/// Longest run of zeros that counts as a jump, samples.
const LONGEST: usize = 3;
/// Min number of jumps that are no single damaged row.
pub(super) const JUMPS: usize = 2;

pub(super) fn check(findings: &mut Findings) {
    copies(findings);
    zeros(findings);
}

fn copies(findings: &mut Findings) {
    let log = findings.log;
    let Some(target) = &log.target else { return };
    let width = log.joints.len();
    let samples = log.len();
    if samples < ENOUGH + OLD {
        return;
    }
    let copied = |joint: usize| -> Option<bool> {
        let column = log.column_at(Signal::Position, joint)?;
        // The deviation of what is huge and constant is not 0.
        // So the range is asked as well as the deviation.
        let (low, high) = range(&column)?;
        let moves = deviation(&column);
        if moves.is_nan() || moves < MOVES || high - low < MOVES {
            return None;
        }
        let close = |old: usize| {
            let squares: f64 =
                (old..samples).map(|i| (target[i * width + joint] - column[i - old]).powi(2)).sum();
            (squares / (samples - old) as f64).sqrt() < SAME * moves
        };
        Some((0..=OLD).any(close))
    };
    let judged: Vec<(usize, bool)> = (0..width).filter_map(|joint| Some((joint, copied(joint)?))).collect();
    let joints: Vec<usize> = judged.iter().filter(|(_, copied)| *copied).map(|(joint, _)| *joint).collect();
    if !joints.is_empty() {
        let message = format!(
            "targets of {} are copies of the measured positions: nothing shows what the motors were asked for; record the \
             position targets that were sent",
            findings.names(&joints)
        );
        findings.add(FindingKind::TargetIsPosition, Severity::Error, &joints, None, message);
    }
}

/// Rows whose positions are all exactly 0 between rows that are not: first and last of each run.
pub fn zero_rows(position: &[f64], width: usize) -> Vec<std::ops::Range<usize>> {
    let rows = position.len().checked_div(width).unwrap_or(0);
    let row = |i: usize| &position[i * width..(i + 1) * width];
    let zero = |i: usize| row(i).iter().all(|q| *q == 0.0);
    let away = |i: usize| row(i).iter().any(|q| q.abs() > AWAY);
    let mut runs = Vec::new();
    // The first row has no row before it that a jump could start from.
    let mut at = 1;
    while at < rows {
        if !zero(at) {
            at += 1;
            continue;
        }
        let end = (at..rows).find(|i| !zero(*i)).unwrap_or(rows);
        // A run that reaches the end has no row behind it.
        if end < rows && end - at <= LONGEST && away(at - 1) && away(end) {
            runs.push(at..end);
        }
        at = end + 1;
    }
    runs
}

fn zeros(findings: &mut Findings) {
    let log = findings.log;
    let runs = zero_rows(&log.position, log.joints.len());
    if runs.len() < JUMPS || range(&log.position).is_none() {
        return;
    }
    let times: Vec<String> = runs.iter().take(3).map(|run| shown_number(log.time[run.start])).collect();
    let message = format!(
        "positions of all joints jump to exactly 0 and back {} times (at {}{} s): that is no motion but a second writer of \
         zeros, such as a joint_state_publisher beside the driver; record without it, or leave these rows out",
        runs.len(),
        times.join(", "),
        if runs.len() > times.len() { ", …" } else { "" }
    );
    findings.add(FindingKind::JumpsToZero, Severity::Error, &[], None, message);
}
