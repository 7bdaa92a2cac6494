//! Streams at different rates, on the samples of the one with the positions.

use crate::ImportError;
use crate::clock::typical;
use crate::lead::{Placed, SAME, place};
use crate::table::Table;
use gaitfit_log::Lead;
use gaitfit_log::column_names::COMMAND;
use indexmap::IndexMap;

/// Joined columns.
#[derive(Debug, Default)]
pub(crate) struct Joined {
    /// s
    pub time: Vec<f64>,
    /// One value a sample.
    pub columns: IndexMap<String, Vec<f64>>,
    /// Assumptions, in sentences.
    pub assumed: Vec<String>,
    /// How long after their rows targets were stamped, or actions where there are no targets.
    pub lead: Option<Lead>,
    /// Samples left out at the beginning and at the end.
    pub dropped: [usize; 2],
}

/// The table with the positions, whose samples the log has.
fn table_of_positions(tables: &[Table]) -> Result<usize, ImportError> {
    let positions = |table: &Table| table.columns.keys().filter(|name| name.starts_with("q_")).count();
    // If several tables have the max number of positions, the first one counts.
    let base = (0..tables.len()).max_by_key(|i| (positions(&tables[*i]), std::cmp::Reverse(*i)));
    base.filter(|i| positions(&tables[*i]) > 0).ok_or_else(|| {
        let names: Vec<String> =
            tables.iter().map(|table| format!("{} ({})", table.name, some_names(table))).collect();
        let found = if names.is_empty() { "no column of a known name".to_owned() } else { names.join("; ") };
        ImportError::NoPositions { found }
    })
}

/// Refuses two tables with the same column.
fn check_unique(tables: &[Table]) -> Result<(), ImportError> {
    let mut owner: IndexMap<&str, &str> = IndexMap::new();
    for table in tables {
        for name in table.columns.keys() {
            if let Some(first) = owner.insert(name, &table.name) {
                let (first, second) = (first.to_owned(), table.name.clone());
                return Err(ImportError::Ambiguous { what: name.clone(), first, second });
            }
        }
    }
    Ok(())
}

/// The time span that all tables cover.
struct Common {
    /// First and last time, s.
    from: f64,
    to: f64,
    /// Rows of targets and actions, one entry a table.
    placed: Vec<Option<Placed>>,
}

impl Common {
    fn new(tables: &[Table], base: usize, joined: &mut Joined) -> Result<Self, ImportError> {
        let state = &tables[base];
        let placed = tables.iter().map(|_| None).collect();
        // Infinite, because there may be no stream that bounds the time.
        let mut common = Self { from: f64::NEG_INFINITY, to: f64::INFINITY, placed };
        let has_targets =
            tables.iter().any(|table| table.columns.keys().any(|name| name.starts_with("qdes_")));
        for (i, table) in tables.iter().enumerate() {
            let (Some(first), Some(last)) = (table.time.first(), table.time.last()) else { continue };
            let bounds = |table: &Table| [table.time[0], table.time[table.time.len() - 1]];
            if i == base {
                continue;
            }
            let mut steps: Vec<f64> = table.time.windows(2).map(|pair| pair[1] - pair[0]).collect();
            let period = typical(&mut steps).unwrap_or(0.0);
            let [state_first, state_last] = bounds(state);
            if *first > state_last || last + period < state_first {
                return Err(ImportError::NoOverlap {
                    first: state.name.clone(),
                    first_s: [state_first, state_last],
                    second: table.name.clone(),
                    second_s: [*first, *last],
                });
            }
            // Commands come when somebody gives one, so their stream does not bound the log's time.
            if table.columns.keys().all(|name| COMMAND.contains(&name.as_str())) {
                if *first > state_first {
                    joined.assumed.push(format!("{}: the command before its first message is 0", table.name));
                }
                continue;
            }
            // Targets and actions answer a state, so they begin with the first row that has an answer.
            let answers = |name: &str| is_held(name) && !COMMAND.contains(&name);
            if table.columns.keys().any(|name| answers(name)) {
                let placed = place(&state.time, table, is_held);
                if let Some(row) = placed.rows.iter().position(Option::is_some) {
                    common.from = common.from.max(state.time[row]);
                }
                note(joined, table, &placed, has_targets);
                common.placed[i] = Some(placed);
            } else {
                common.from = common.from.max(*first - table.slack);
            }
            let blended = table.columns.keys().any(|name| !is_held(name));
            // What is held counts for one more period; what is blended needs a sample on both sides.
            common.to = common.to.min(if blended { *last } else { last + period });
        }
        Ok(common)
    }
}

/// The columns of `table` at the times of the log; `placed`: the row of each sample for targets and actions, if they have rows
/// of their own.
fn columns_at(time: &[f64], table: &Table, placed: Option<&[Option<usize>]>) -> Vec<(String, Vec<f64>)> {
    // For each sample the row at or before it, if there is one.
    let places: Vec<Option<usize>> = time
        .iter()
        .map(|at| table.time.partition_point(|time| *time <= at + SAME + table.slack).checked_sub(1))
        .collect();
    let column = |(name, values): (&String, &Vec<f64>)| {
        let at = |sample: usize| {
            if let Some(placed) = placed.filter(|_| is_held(name)) {
                return placed[sample].map_or(0.0, |row| values[row]);
            }
            let Some(row) = places[sample] else { return 0.0 };
            if is_held(name) {
                return values[row];
            }
            match (values.get(row + 1), table.time.get(row + 1)) {
                (Some(next), Some(later)) => {
                    // Because of the slack, the row may be a little later than the sample.
                    let fraction =
                        ((time[sample] - table.time[row]) / (later - table.time[row])).clamp(0.0, 1.0);
                    // Not 0 × next, which may be NaN.
                    if fraction == 0.0 { values[row] } else { values[row] + fraction * (next - values[row]) }
                }
                _ => values[row],
            }
        };
        (name.clone(), (0..time.len()).map(at).collect())
    };
    table.columns.iter().map(column).collect()
}

/// Joins tables in the order of time. What a controller sets (targets, actions, commands) holds until its next sample; what
/// is measured is blended between samples. A target or action is in the row of the state that it answers ([`place`]).
/// Samples before the first target or action, or a period after the last, are left out.
pub(crate) fn join(tables: Vec<Table>) -> Result<Joined, ImportError> {
    check_unique(&tables)?;
    let base = table_of_positions(&tables)?;
    let state = &tables[base];
    let mut joined = Joined::default();
    let Common { from, to, placed } = Common::new(&tables, base, &mut joined)?;
    // Only the time that all streams cover.
    let begin = state.time.partition_point(|time| *time < from - SAME);
    let end = state.time.partition_point(|time| *time <= to + SAME);
    if begin >= end {
        let problem =
            "no sample lies between the first and the last of the other streams; check the clocks".into();
        return Err(ImportError::Clock { stream: state.name.clone(), problem });
    }
    joined.dropped = [begin, state.time.len() - end];
    // The positions give the rows; other streams are brought to their times.
    joined.time = state.time[begin..end].to_vec();
    for (name, values) in &state.columns {
        joined.columns.insert(name.clone(), values[begin..end].to_vec());
    }
    let others = tables.iter().zip(&placed).enumerate().filter(|(i, _)| *i != base);
    for (_, (table, placed)) in others {
        let placed = placed.as_ref().map(|placed| &placed.rows[begin..end]);
        joined.columns.extend(columns_at(&joined.time, table, placed));
    }
    Ok(joined)
}

/// Keeps the lead of a stream's targets and says what was made of it.
fn note(joined: &mut Joined, table: &Table, placed: &Placed, has_targets: bool) {
    let has = |prefix: &str| table.columns.keys().any(|name| name.starts_with(prefix));
    if placed.faster {
        joined.assumed.push(format!(
            "{}: its messages change more often than there are positions; each row holds the last one before it",
            table.name
        ));
    }
    let Some(lead) = placed.lead else { return };
    joined.assumed.push(format!(
        "{}: each message is in the row that it answers, {:.3} ms {} it was stamped (nine of ten within ±{:.3} ms); a fit's \
         delay counts from the stamp",
        table.name,
        1e3 * lead.seconds.abs(),
        if lead.seconds < 0.0 { "after" } else { "before" },
        1e3 * lead.spread
    ));
    // What drives the joints counts; actions do where nobody recorded targets.
    if has("qdes_") || (has("act_") && !has_targets) {
        joined.lead = Some(lead);
    }
}

/// Whether a quantity is set by a controller and stays until it is set again.
fn is_held(name: &str) -> bool {
    ["qdes_", "act_", "kp_", "kd_", "dqdes_", "tauff_"].iter().any(|prefix| name.starts_with(prefix))
        || COMMAND.contains(&name)
}

fn some_names(table: &Table) -> String {
    let mut names: Vec<&str> = table.columns.keys().take(6).map(String::as_str).collect();
    if table.columns.len() > names.len() {
        names.push("…");
    }
    names.join(", ")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn table(name: &str, column: &str, time: &[f64], values: &[f64]) -> Table {
        let columns = [(column.to_owned(), values.to_vec())].into_iter().collect();
        Table { name: name.into(), time: time.to_vec(), columns, ..Table::default() }
    }

    #[test]
    fn targets_hold_and_measurements_are_blended() -> Result<(), ImportError> {
        let state = table("/s", "q_a", &[0.0, 1.0, 2.0, 3.0, 4.0], &[0.0, 10.0, 20.0, 30.0, 40.0]);
        let target = table("/t", "qdes_a", &[1.25, 2.25, 4.25], &[5.0, 6.0, 7.0]);
        let rate = table("/r", "dq_a", &[0.0, 2.0, 4.0], &[0.0, 2.0, 4.0]);
        let command = table("/c", "vx_cmd", &[2.5], &[0.3]);
        let joined = join(vec![state, target, rate, command])?;
        assert_eq!(joined.time, [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(joined.columns["q_a"], [10.0, 20.0, 30.0, 40.0]);
        assert_eq!(joined.columns["qdes_a"], [5.0, 6.0, 6.0, 7.0]);
        assert_eq!(joined.columns["dq_a"], [1.0, 2.0, 3.0, 4.0]);
        assert_eq!(joined.columns["vx_cmd"], [0.0, 0.0, 0.3, 0.3]);
        assert_eq!(joined.dropped, [1, 0]);
        assert_eq!(joined.lead.map(|lead| lead.seconds), Some(0.25));
        Ok(())
    }

    #[test]
    fn what_cannot_be_joined_is_refused() {
        let state = || table("/s", "q_a", &[0.0, 1.0], &[0.0, 1.0]);
        let text =
            |tables| join(tables).map_or_else(|error| error.to_string(), |joined| format!("{joined:?}"));
        assert!(
            text(vec![state(), table("/t", "qdes_a", &[100.0, 101.0], &[0.0, 1.0])])
                .contains("do not overlap")
        );
        assert!(text(vec![state(), table("/u", "q_a", &[0.0, 1.0], &[0.0, 1.0])]).contains("streams.take"));
        assert!(text(vec![table("/t", "qdes_a", &[0.0], &[0.0])]).contains("/t (qdes_a)"));
        assert!(text(Vec::new()).contains("no column of a known name"));
    }
}
