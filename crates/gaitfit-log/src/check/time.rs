//! Is time increasing and regular, at the stated rate, with new data in every row?

use super::{FindingKind, Findings, Severity, replayed};
use crate::scale::equal;
use crate::spacing::spacing;
use crate::stats::{decimals, short};
use gaitfit_model::shown_number;

/// A gap this long, s, ends a joint's free motion: replaying across it means nothing.
const LONG_GAP_S: f64 = 0.1;
/// RMS deviation of the intervals, relative to their median. Python loops on an idle machine reach 2–4 %.
const JITTER: f64 = 0.05;
/// Relative error of the stated rate; clocks and rounding stay far below it.
const RATE_ERROR: f64 = 0.02;
/// Share of repeated rows. A bus that is read a little faster than it updates repeats 5–10 %.
const REPEATED: f64 = 0.3;
/// Share of repeated rows from which on the rest is no log of a motion.
const NEARLY_ALL: f64 = 0.98;

/// `velocity_over_derivative`: how many times the velocities of most joints are the derivative of the positions by the
/// time column. Returns whether a finding says already that the time column does not fit them.
pub(super) fn check(findings: &mut Findings, velocity_over_derivative: Option<f64>) -> bool {
    let log = findings.log;
    let steps: Vec<f64> = log.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let backward: Vec<usize> = (0..steps.len()).filter(|&i| steps[i] <= 0.0).collect();
    if let Some(&first) = backward.first() {
        // Remedies differ: copies may go, late rows have values of their own.
        let width = log.joints.len();
        let row = |values: &[f64], row: usize| values[row * width..(row + 1) * width].to_vec();
        // Rows with the same time are copies, or were written late.
        let new = backward.iter().any(|&i| {
            steps[i] == 0.0
                && (row(&log.position, i) != row(&log.position, i + 1)
                    || row(&log.velocity, i) != row(&log.velocity, i + 1))
        });
        let remedy = if new {
            "their values differ, so they are no copies: `gaitfit import` places them between their neighbours"
        } else {
            "cut the log there, or remove the repeated rows"
        };
        let message = format!(
            "time goes from {:?} s to {:?} s at sample {}{}; {remedy}",
            log.time[first],
            log.time[first + 1],
            first + 1,
            match backward.len() {
                1 => String::new(),
                count => format!(", and does not increase at {} more places", count - 1),
            }
        );
        let span = first..first + 2;
        findings.add(FindingKind::NonMonotonicTime, Severity::Error, &[], Some(span), message);
    }

    let Some(spacing) = spacing(&log.time) else { return false };
    let typical = spacing.step;
    let ratio = typical * log.rate_hz;
    let mut clock_is_wrong = false;
    if (ratio - 1.0).abs() > RATE_ERROR {
        // The velocities show which of the two clocks is right, the stated rate or the column.
        clock_is_wrong = velocity_over_derivative.is_some_and(|factor| equal(factor, ratio));
        let clock_is_right = velocity_over_derivative.is_some_and(|factor| equal(factor, 1.0));
        // Within a factor of two, because the stated rate may be wrong too.
        let hint = match ratio {
            ratio if (500.0..2000.0).contains(&ratio) => {
                "time is in milliseconds, it seems: divide it by 1000"
            }
            ratio if (5e5..2e6).contains(&ratio) => "time is in microseconds, it seems: divide it by 1e6",
            ratio if (5e8..2e9).contains(&ratio) => "time is in nanoseconds, it seems: divide it by 1e9",
            _ if typical == 1.0 => "time counts samples, it seems: divide it by the rate",
            _ if clock_is_wrong && !clock_is_right => {
                "the velocities fit the stated rate: correct the time column"
            }
            _ if clock_is_right && !clock_is_wrong => {
                "the velocities fit the time column: correct the stated rate"
            }
            _ => "correct the stated rate, or the time column",
        };
        let message = format!(
            "the stated rate is {} Hz, but samples are {} s apart ({} Hz); {hint}",
            shown_number(log.rate_hz),
            short(typical),
            decimals(1.0 / typical, 4)
        );
        findings.add(FindingKind::RateMismatch, Severity::Error, &[], None, message);
    }

    // Gaps and jitter are apart: a lost sample must not count as jitter.
    let gaps: Vec<usize> = spacing.lost.iter().map(|lost| lost.after).collect();
    if let Some(&longest) = gaps.iter().max_by(|&&a, &&b| steps[a].total_cmp(&steps[b])) {
        // At low rates a single lost sample takes as long as `LONG_GAP_S`.
        let severity =
            if steps[longest] > LONG_GAP_S.max(3.0 * typical) { Severity::Error } else { Severity::Warning };
        let remedy = match (replayed(log), severity) {
            (true, Severity::Error) => "a fit replays the log of a clamped robot as a whole: cut it there",
            _ => "fits leave gaps out, better logs have none",
        };
        let message = format!(
            "{} gap(s), about {} samples lost; the longest is {} s after {:?} s; {remedy}",
            gaps.len(),
            spacing.count(),
            decimals(steps[longest], 4),
            log.time[longest]
        );
        findings.add(FindingKind::TimeGap, severity, &[], Some(longest..longest + 2), message);
    }

    // In parts of the step, so that one limit serves all rates.
    let jitter = spacing.jitter / typical;
    if jitter > JITTER {
        let message = format!(
            "jitter: sample intervals vary by {:.1} % RMS around {} s{}; record from a real-time loop if you can",
            100.0 * jitter,
            decimals(typical, 6),
            if gaps.is_empty() { ", and no sample is lost" } else { "" }
        );
        findings.add(FindingKind::IrregularTime, Severity::Warning, &[], None, message);
    }

    repeated_rows(findings, typical);
    clock_is_wrong
}

fn repeated_rows(findings: &mut Findings, typical: f64) {
    let log = findings.log;
    let width = log.joints.len();
    // Equal rows in motion mean that the recorder was faster than the robot.
    let moving = crate::stats::range(&log.velocity).is_some_and(|(low, high)| high > low);
    let repeats =
        |values: &[f64], i: usize| values[i * width..(i + 1) * width] == values[(i - 1) * width..i * width];
    let repeated = (1..log.len()).filter(|&i| repeats(&log.position, i) && repeats(&log.velocity, i)).count();
    let share = repeated as f64 / (log.len() - 1) as f64;
    // A log where nothing moves at all repeats every row for another reason, reported elsewhere.
    if moving && share > NEARLY_ALL {
        let message = format!(
            "{:.1} % of the rows repeat positions and velocities of the row before: the robot's state was hardly read; record again",
            100.0 * share
        );
        let severity = if replayed(log) { Severity::Error } else { Severity::Warning };
        findings.add(FindingKind::RepeatedRows, severity, &[], None, message);
    } else if moving && share > REPEATED {
        // `--every 1` would change nothing.
        let message = format!(
            "{:.0} % of the rows repeat positions and velocities of the row before; the robot reports at about {} Hz: \
             record or resample at that rate, for example with `gaitfit import LOG --every {} --out LESS.csv`",
            100.0 * share,
            decimals((1.0 - share) / typical, 0),
            decimals((1.0 / (1.0 - share)).max(2.0), 0)
        );
        let severity = if replayed(log) { Severity::Error } else { Severity::Warning };
        findings.add(FindingKind::RepeatedRows, severity, &[], None, message);
    }
}
