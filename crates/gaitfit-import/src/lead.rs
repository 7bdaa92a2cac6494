//! Assigns a controller's messages to rows, and measures how long after the row's time they were stamped.
//!
//! A control loop reads a state, computes, and publishes a target. The target answers that state, though its stamp is a
//! little later. So it belongs to the state's row, and the time between them, its lead, is kept: a simulator that holds the
//! target from the row's time on has to wait as much longer.

use crate::clock::typical;
use crate::table::Table;
use gaitfit_log::Lead;

/// Times this close, s, are one time: recorders round.
pub(crate) const SAME: f64 = 1e-9;
/// Messages at least so much more frequent than rows do not answer them one by one.
const FASTER: f64 = 1.5;
/// A message that was stamped up to this share of an interval before a row, as most of its stream, belongs to that row.
const BEFORE: f64 = 0.15;
/// The same where the two clocks are only known to agree about: the nearest row.
const BEFORE_INEXACT: f64 = 0.5;
/// Length of the mean of the leads as phases, of 1, below which they have no common value: the two streams run freely.
const TOGETHER: f64 = 0.3;
/// A message farther than this share of an interval from where its stream's messages are answers a row that was lost.
const ASTRAY: f64 = 0.75;
/// Fewer messages do not show a lead.
const ENOUGH: usize = 3;
/// Leads are rounded to this, s: stamps of Unix time have no more digits as floating point.
const DIGITS: f64 = 1e6;

/// A stream of messages on rows.
#[derive(Debug, PartialEq)]
pub(crate) struct Placed {
    /// For each row the message that it holds; `None` before the first.
    pub rows: Vec<Option<usize>>,
    /// How long after their rows the messages were stamped; `None` where that is 0 or not known.
    pub lead: Option<Lead>,
    /// Whether messages come so much faster than rows that most of them are in no row.
    pub faster: bool,
}

/// Puts the messages of `table` on rows at the times `state`. Columns that `is_held` tells say when a message is new.
pub(crate) fn place(state: &[f64], table: &Table, is_held: impl Fn(&str) -> bool) -> Placed {
    let columns: Vec<&Vec<f64>> =
        table.columns.iter().filter(|(name, _)| is_held(name)).map(|(_, values)| values).collect();
    let is_new = |message: usize| {
        message == 0
            || columns.iter().any(|column| {
                column.get(message).map(|value| value.to_bits())
                    != column.get(message - 1).map(|value| value.to_bits())
            })
    };
    // A driver that repeats a target until the next one is there sends it for the first time once.
    let new: Vec<usize> = (0..table.time.len()).filter(|message| is_new(*message)).collect();
    let mut steps: Vec<f64> = state.windows(2).map(|pair| pair[1] - pair[0]).collect();
    let mut between: Vec<f64> =
        new.windows(2).map(|pair| table.time[pair[1]] - table.time[pair[0]]).collect();
    // A single state has no interval to measure a lead by.
    let Some(step) = typical(&mut steps) else {
        return Placed { rows: last_before(state, table, &new), lead: None, faster: false };
    };
    if typical(&mut between).is_some_and(|between| between * FASTER < step) {
        return Placed { rows: last_before(state, table, &new), lead: None, faster: true };
    }
    let wrap = if table.slack > 0.0 { BEFORE_INEXACT } else { BEFORE };
    // 1. The usual lead of the stream; 2. each message goes to the row from which it has about this lead.
    let usual = usual(state, table, &new, step, wrap);
    let mut rows: Vec<Option<usize>> = vec![None; state.len()];
    let mut leads = Vec::with_capacity(new.len());
    for &message in &new {
        let at = table.time[message];
        // Only the neighbours can be meant: the row before, the one at the message, and the next.
        let next = state.partition_point(|time| *time <= at + SAME);
        let first = next.saturating_sub(2);
        let near = (first..(next + 1).min(state.len()))
            .min_by(|a, b| (at - state[*a] - usual).abs().total_cmp(&(at - state[*b] - usual).abs()));
        let Some(near) = near else { continue };
        let lead = at - state[near];
        let answers = (lead - usual).abs() <= ASTRAY * step;
        // A message that is astray holds from the next row on, as it would without any lead.
        let row = if answers { near } else { next };
        if answers {
            leads.push(lead);
        }
        if let Some(slot) = rows.get_mut(row) {
            *slot = Some(message);
        }
    }
    // Held until the next one.
    let mut held = None;
    for slot in &mut rows {
        held = slot.or(held);
        *slot = held;
    }
    Placed { rows, lead: lead(leads), faster: false }
}

/// The last new message at or before each row.
fn last_before(state: &[f64], table: &Table, new: &[usize]) -> Vec<Option<usize>> {
    let before = |at: &f64| new.partition_point(|message| table.time[*message] <= at + SAME + table.slack);
    state.iter().map(|at| before(at).checked_sub(1).map(|place| new[place])).collect()
}

/// The time from a row to the message that answers it, by most of the messages, s; from `-wrap` to `1 - wrap` intervals.
fn usual(state: &[f64], table: &Table, new: &[usize], step: f64, wrap: f64) -> f64 {
    let phases: Vec<f64> = new
        .iter()
        .filter_map(|message| {
            let at = table.time[*message];
            // A message before the first row answers none.
            let before = state.partition_point(|time| *time <= at + SAME).checked_sub(1)?;
            // Within `SAME` it may be a little below 0.
            let lead = (at - state[before]).max(0.0);
            // After so long a time a row is missing, and the phase shows nothing.
            (lead < 1.5 * step).then_some(lead / step)
        })
        .collect();
    // The mean of phases on a circle: a lead a little below 0 and one a little below an interval are near each other.
    // The mean vector has length 1 if all phases are equal, and about 0 if they are spread over the circle.
    let turn = std::f64::consts::TAU;
    let (sin, cos) = phases
        .iter()
        .fold((0.0, 0.0), |(sin, cos), phase| (sin + (turn * phase).sin(), cos + (turn * phase).cos()));
    let length = (sin * sin + cos * cos).sqrt() / phases.len().max(1) as f64;
    if phases.is_empty() {
        return 0.0;
    }
    // Streams that run freely: the middle of an interval is the best guess of what answers what.
    if length < TOGETHER {
        return 0.5 * step;
    }
    let phase = (sin.atan2(cos) / turn).rem_euclid(1.0);
    step * if phase > 1.0 - wrap { phase - 1.0 } else { phase }
}

/// The middle of the leads and their spread.
fn lead(mut leads: Vec<f64>) -> Option<Lead> {
    if leads.len() < ENOUGH {
        return None;
    }
    leads.sort_by(f64::total_cmp);
    let rounded = |seconds: f64| (seconds * DIGITS).round() / DIGITS;
    let at = |share: f64| leads[((leads.len() - 1) as f64 * share).round() as usize];
    let lead = Lead { seconds: rounded(at(0.5)), spread: rounded(0.5 * (at(0.95) - at(0.05))) };
    (lead.seconds != 0.0 || lead.spread != 0.0).then_some(lead)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Messages `late` after the rows at `rows`, valued by the number of their row.
    fn messages(rows: &[f64], late: impl Fn(usize) -> f64) -> Table {
        let time: Vec<f64> = rows.iter().enumerate().map(|(row, at)| at + late(row)).collect();
        let columns =
            [("qdes_a".to_owned(), (0..rows.len()).map(|row| row as f64).collect())].into_iter().collect();
        Table { name: "/t".into(), time, columns, ..Table::default() }
    }

    fn even(count: usize, step: f64) -> Vec<f64> {
        (0..count).map(|row| row as f64 * step).collect()
    }

    fn placed(state: &[f64], table: &Table) -> Placed {
        place(state, table, |name| name.starts_with("qdes_"))
    }

    #[test]
    fn a_target_is_in_the_row_that_it_answers() {
        for (step, late) in [(0.005, 0.0003), (0.005, 0.001), (0.005, 0.002), (0.02, 0.002), (0.02, 0.016)] {
            let state = even(200, step);
            let placement = placed(&state, &messages(&state, |_| late));
            assert_eq!(placement.rows, (0..200).map(Some).collect::<Vec<_>>(), "{step} {late}");
            assert_eq!(placement.lead, Some(Lead { seconds: late, spread: 0.0 }));
        }
        // Stamps a little early are early, not a whole interval late.
        let state = even(200, 0.02);
        let placement = placed(&state, &messages(&state, |_| -0.001));
        assert_eq!(placement.rows, (0..200).map(Some).collect::<Vec<_>>());
        assert_eq!(placement.lead, Some(Lead { seconds: -0.001, spread: 0.0 }));
        // At the row's own time there is nothing to keep.
        assert_eq!(placed(&state, &messages(&state, |_| 0.0)).lead, None);
    }

    #[test]
    fn leads_that_vary_keep_their_rows_and_their_spread() {
        let state = even(500, 0.005);
        let placement = placed(&state, &messages(&state, |row| 0.002 + 0.0001 * ((row * 8) % 21) as f64));
        assert_eq!(placement.rows, (0..500).map(Some).collect::<Vec<_>>());
        let lead = placement.lead.unwrap_or(Lead { seconds: 0.0, spread: 0.0 });
        assert!((lead.seconds - 0.003).abs() < 1e-4, "{lead:?}");
        assert!((0.0008..0.0011).contains(&lead.spread), "{lead:?}");
    }

    #[test]
    fn targets_of_lost_rows_are_in_no_row_before_them() {
        let state = even(100, 0.01);
        let table = messages(&state, |_| 0.002);
        let mut left = state.clone();
        left.drain(40..45);
        let placement = placed(&left, &table);
        assert_eq!(placement.rows[39], Some(39));
        assert_eq!(placement.rows[40], Some(45));
        assert_eq!(placement.lead.map(|lead| lead.seconds), Some(0.002));
    }

    #[test]
    fn a_repeated_target_counts_when_it_is_new() {
        // 500 Hz of messages, a new target every tenth, 1 ms after the row.
        let state = even(50, 0.02);
        let time: Vec<f64> = (0..500).map(|message| 0.001 + f64::from(message) * 0.002).collect();
        let values: Vec<f64> = (0..500).map(|message| f64::from(message / 10)).collect();
        let columns = [("qdes_a".to_owned(), values.clone())].into_iter().collect();
        let table = Table { name: "/t".into(), time, columns, ..Table::default() };
        let placement = placed(&state, &table);
        let held: Vec<f64> = placement.rows.iter().flatten().map(|message| values[*message]).collect();
        assert_eq!(held, (0..50).map(f64::from).collect::<Vec<_>>());
        assert_eq!(placement.lead, Some(Lead { seconds: 0.001, spread: 0.0 }));
    }

    #[test]
    fn of_faster_targets_a_row_holds_the_last_before_it() {
        let state = even(50, 0.02);
        let time: Vec<f64> = (0..500).map(|message| f64::from(message) * 0.002).collect();
        let columns = [("qdes_a".to_owned(), time.clone())].into_iter().collect();
        let table = Table { name: "/t".into(), time, columns, ..Table::default() };
        let placement = placed(&state, &table);
        assert!(placement.faster && placement.lead.is_none());
        assert_eq!(placement.rows, (0..50).map(|row| Some(10 * row)).collect::<Vec<_>>());
    }
}
