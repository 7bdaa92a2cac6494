//! What to know before trusting the numbers, read off the data.

use super::rounds::title;
use super::{LogSummary, LoopReport, Round};
use crate::format::{clean, clean_prose, round_number, significant};
use crate::page;

/// Sentences of one kind a round at most.
pub(super) const MOST: usize = 20;

/// The caller's warnings, then those of each round.
pub(super) fn build(report: &LoopReport, replay: Option<String>) -> Vec<String> {
    let mut all = page::lines(&report.warnings);
    all.extend(replay.map(|why| format!("The replay is left out: {}.", clean_prose(&why))));
    for (i, round) in report.rounds.iter().enumerate() {
        let prefix = if report.rounds.len() > 1 { format!("{}: ", title(round, i)) } else { String::new() };
        let found = round.log.iter().flat_map(of_log).chain(of_parameters(round));
        all.extend(found.map(|sentence| format!("{prefix}{sentence}")));
    }
    all
}

fn of_log(log: &LogSummary) -> Vec<String> {
    let mut found = Vec::new();
    if log.falls > 0 {
        let (fell, were) = if log.falls == 1 { ("fall", "was") } else { ("falls", "were") };
        let cut = match (log.cut_seconds.is_finite(), log.seconds.is_finite() && log.seconds > 0.0) {
            (true, true) => format!(
                "{} s of {} s, {} %",
                significant(log.cut_seconds, 3),
                significant(log.seconds, 4),
                significant(100.0 * log.cut_seconds / log.seconds, 2)
            ),
            (true, false) => format!("{} s", significant(log.cut_seconds, 3)),
            _ => "a stretch of unknown length".to_string(),
        };
        found.push(format!(
            "{} {fell} in the log {were} cut with a margin ({cut}). A simulator that falls matches a log that falls; \
             what was cut says nothing of the robot.",
            log.falls
        ));
    }
    found.extend(log.uncovered.iter().take(MOST).map(|part| {
        format!("The log does not cover {}: record it next time, or expect little there.", clean_prose(part))
    }));
    found
}

fn of_parameters(round: &Round) -> Vec<String> {
    let several = round.adaptations.len() > 1;
    let mut found = Vec::new();
    for adaptation in &round.adaptations {
        let open = adaptation.parameters.iter().filter(|p| p.parameter.identified == Some(false));
        found.extend(open.take(MOST).map(|p| {
            let of = if several { format!(" ({})", clean(&adaptation.name)) } else { String::new() };
            let range = p.profile.filter(|ends| ends.iter().all(|x| x.is_finite())).map(|[low, high]| {
                let (low, high) = (round_number(low), round_number(high));
                format!(": anything from {low} to {high} {} fits as well", clean(&p.parameter.unit))
            });
            format!(
                "{}{of} is not identified by the log{}.",
                clean(&p.parameter.name),
                range.unwrap_or_default().trim_end()
            )
        }));
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn falls_are_counted_and_measured() {
        let log = LogSummary { falls: 3, cut_seconds: 6.4, seconds: 256.0, ..LogSummary::default() };
        assert!(
            of_log(&log)[0]
                .starts_with("3 falls in the log were cut with a margin (6.40 s of 256.0 s, 2.5 %)")
        );
        let log = LogSummary { falls: 1, ..LogSummary::default() };
        assert!(
            of_log(&log)[0].contains("1 fall in the log was cut with a margin (a stretch of unknown length)")
        );
        assert!(of_log(&LogSummary::default()).is_empty());
    }
}
