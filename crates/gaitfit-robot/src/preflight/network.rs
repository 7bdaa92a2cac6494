//! Arrival of states: their rate, gaps, losses, and the robot's clock against this computer's.

use serde::Serialize;

use super::statistics::{Measured, deviation, least_squares, median, span};
use super::{Check, Finding, Heard};
use crate::state::Seal;

/// Min messages a second for running a policy.
const FEWEST_HZ: f64 = 100.0;
/// A longer gap stops a run, ms: the guard's limit for the age of a state.
const LONGEST_GAP_MS: f64 = 20.0;
/// Share of lost messages: above the first it is a warning, above the second a fault.
const LOST: [f64; 2] = [0.001, 0.01];
/// A larger difference of the clocks is a warning, parts per million; quartz clocks differ by less than 100.
const CLOCK_PPM: f64 = 500.0;
/// With fewer messages nothing else is judged.
pub(super) const FEWEST: usize = 20;

/// Arrival of states.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct NetworkReport {
    /// Messages heard.
    pub messages: usize,
    /// Time from the first to the last, s.
    pub seconds: f64,
    /// Messages a second.
    pub hz: f64,
    /// Longest time between two, ms.
    pub longest_gap_ms: f64,
    /// Messages that the robot counted and that did not come; absent where it does not count.
    pub lost: Option<u64>,
    /// Messages whose counter is that of the one before.
    pub doubled: u64,
    /// Messages whose counter is smaller than that of the one before.
    pub disordered: u64,
    /// Messages with a wrong checksum.
    pub wrong_checksum: u64,
    /// Messages without a checksum.
    pub without_checksum: u64,
    /// Commands of other programs.
    pub other_commands: u64,
    /// The robot's clock; absent where it does not count.
    pub clock: Option<ClockReport>,
}

/// The robot's clock against this computer's.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub struct ClockReport {
    /// How much faster the robot's counter runs than ms of this computer, parts per million.
    pub faster_ppm: Measured,
    /// Irregularity of the arrival against the robot's counter: standard deviation, ms.
    pub jitter_ms: f64,
}

/// Measures the arrival of messages.
pub(super) fn network(heard: &[Heard], other_commands: u64) -> NetworkReport {
    let seconds = match (heard.first(), heard.last()) {
        (Some(first), Some(last)) => last.came.saturating_sub(first.came).as_secs_f64(),
        _ => 0.0,
    };
    let gaps = heard.windows(2).map(|pair| 1e3 * pair[1].came.saturating_sub(pair[0].came).as_secs_f64());
    // A simulator may leave the counter at 0; then it shows neither losses nor doubles.
    let counts = heard.windows(2).any(|pair| pair[0].state.tick != pair[1].state.tick);
    let steps: Vec<i64> = heard
        .windows(2)
        // The difference as a signed number is right where the counter wraps, and negative for an older message.
        .map(|pair| i64::from(pair[1].state.tick.wrapping_sub(pair[0].state.tick).cast_signed()))
        .collect();
    // The usual step is the median: losses make steps longer and must not change it.
    let ahead: Vec<f64> = steps.iter().filter(|step| **step > 0).map(|step| *step as f64).collect();
    let usual = median(&ahead);
    // A counter in ms of messages that come every 2 ms may step by 1 or 3.
    let missing = |step: f64| if step >= 1.75 * usual { (step / usual).round() as u64 - 1 } else { 0 };
    // The stamps of ROS 2 are times: they show how regularly states are made, not how many. Two may have the same ms.
    let stamped = heard.iter().any(|one| one.seal == Seal::Unused);
    let doubled = |pair: &[Heard]| {
        let [a, b] = [&pair[0].state, &pair[1].state];
        a.tick == b.tick && (!stamped || a == b)
    };
    let sealed = |seal: Seal| heard.iter().filter(|one| one.seal == seal).count() as u64;
    NetworkReport {
        messages: heard.len(),
        seconds,
        hz: if seconds > 0.0 { (heard.len() - 1) as f64 / seconds } else { 0.0 },
        longest_gap_ms: gaps.fold(0.0, f64::max),
        lost: (counts && !stamped).then(|| ahead.iter().map(|step| missing(*step)).sum()),
        doubled: if counts { heard.windows(2).filter(|pair| doubled(pair)).count() as u64 } else { 0 },
        disordered: steps.iter().filter(|step| **step < 0).count() as u64,
        wrong_checksum: sealed(Seal::Wrong),
        without_checksum: sealed(Seal::Absent),
        other_commands,
        clock: if counts { clock(heard) } else { None },
    }
}

fn clock(heard: &[Heard]) -> Option<ClockReport> {
    let first = heard.first()?;
    let rows: Vec<([f64; 2], f64)> = heard
        .iter()
        .map(|one| {
            let ms = 1e3 * one.came.saturating_sub(first.came).as_secs_f64();
            let counted = f64::from(one.state.tick.wrapping_sub(first.state.tick).cast_signed());
            ([1.0, ms], counted)
        })
        .collect();
    // A line through counter over arrival: its slope is the ratio of the clocks, its residuals the jitter.
    let (coefficients, covariance, left) = least_squares(&rows)?;
    let noise = left / rows.len().saturating_sub(2).max(1) as f64;
    let residuals: Vec<f64> =
        rows.iter().map(|(row, y)| y - coefficients[0] - coefficients[1] * row[1]).collect();
    let error = 1e6 * (noise * covariance[1][1]).sqrt();
    Some(ClockReport {
        faster_ppm: Measured { value: 1e6 * (coefficients[1] - 1.0), error },
        jitter_ms: deviation(&residuals),
    })
}

/// Adds what is wrong with it. `simulator`: checksum and counter may be absent.
pub(super) fn judge(report: &NetworkReport, simulator: bool, findings: &mut Vec<Finding>) {
    // Judged first, so that it shows even where hardly any state came.
    if report.other_commands > 0 {
        findings.push(Finding::fault(
            Check::SecondController,
            format!("another program sent {} commands to the motors", report.other_commands),
            "Stop it, and switch off the robot's own walking (motion service) in the vendor's app",
        ));
    }
    if report.messages < FEWEST {
        findings.push(Finding::fault(
            Check::Messages,
            format!("{} states came", report.messages),
            "Check cable, network interface, domain and the robot's file (topics), and whether the robot is switched on",
        ));
        return;
    }
    if report.hz < FEWEST_HZ {
        findings.push(Finding::fault(
            Check::Messages,
            format!("{:.0} states come in a second; a run needs {FEWEST_HZ:.0} or more", report.hz),
            "Use a cable instead of a radio link, and the state topic of the low level",
        ));
    }
    if report.wrong_checksum > 0 {
        findings.push(Finding::fault(
            Check::Messages,
            format!("{} states have a wrong checksum", report.wrong_checksum),
            "Another program writes to this topic, or the messages are of another version: check `messages` in the robot's file",
        ));
    }
    // Simulators may leave the checksum out.
    if report.without_checksum > 0 && !simulator {
        findings.push(Finding::fault(
            Check::Messages,
            format!("{} states have no checksum: they come from a simulator", report.without_checksum),
            "Stop the simulator in this domain, or give its domain with --domain",
        ));
    }
    if report.longest_gap_ms > LONGEST_GAP_MS {
        let problem = format!(
            "no state came for {:.0} ms; a run stops after {LONGEST_GAP_MS:.0}",
            report.longest_gap_ms
        );
        let remedy =
            "Use a cable, end other programs, and give this one real-time priority (rtprio in limits.conf)";
        findings.push(match simulator {
            true => Finding::warning(Check::Gaps, problem, remedy),
            false => Finding::fault(Check::Gaps, problem, remedy),
        });
    }
    if let Some(lost) = report.lost.filter(|lost| *lost > 0) {
        let share = lost as f64 / (lost + report.messages as u64) as f64;
        let problem =
            format!("{lost} of {} states were lost ({:.1} %)", lost + report.messages as u64, 100.0 * share);
        let remedy =
            "Use a cable and a network interface of its own, and end other programs that use the network";
        // Below both limits single losses are no finding.
        if share > LOST[1] {
            findings.push(Finding::fault(Check::Gaps, problem, remedy));
        } else if share > LOST[0] {
            findings.push(Finding::warning(Check::Gaps, problem, remedy));
        }
    }
    if report.doubled + report.disordered > 0 {
        findings.push(Finding::warning(
            Check::Gaps,
            format!("{} states came twice and {} in another order", report.doubled, report.disordered),
            "Look for a second path between robot and computer, or a program that repeats messages",
        ));
    }
    if let Some(clock) = &report.clock {
        let ppm = clock.faster_ppm;
        // Jitter of arrival in a short recording alone must not make a finding.
        if ppm.value.abs() > CLOCK_PPM + 3.0 * ppm.error {
            findings.push(Finding::warning(
                Check::Clock,
                format!(
                    "the robot's counter runs {:.2} % {} than this computer's clock",
                    1e-4 * ppm.value.abs(),
                    if ppm.value > 0.0 { "faster" } else { "slower" }
                ),
                "Logs are right, because their times are this computer's. If the counter counts ms, check the robot's clock",
            ));
        }
    }
}

/// Smallest distance between two different values, or 0.
pub(super) fn step(values: &[f64]) -> f64 {
    let mut sorted = values.to_vec();
    sorted.sort_unstable_by(f64::total_cmp);
    // Smaller distances are rounding of one value.
    let steps = sorted.windows(2).map(|pair| pair[1] - pair[0]).filter(|step| *step > 1e-9);
    let least = steps.fold(f64::INFINITY, f64::min);
    if least.is_finite() && span(sorted.iter().copied()) > 0.0 { least } else { 0.0 }
}
