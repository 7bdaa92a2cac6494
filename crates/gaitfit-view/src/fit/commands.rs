//! Picture of the commands of a log within the range that the policy is to follow.

use super::LogSummary;
use crate::chart::{Axis, Corners, Figure, Frame, Look, Plot, Series};

/// Cells a side that each pair of commands is divided into.
const CELLS: usize = 5;
/// Points drawn at most.
const POINTS: usize = 500;
/// Share of its range that each axis reaches beyond it.
const MARGIN: f64 = 0.06;
/// Names of the commands and their axes.
const AXES: [&str; 3] = ["forward (m/s)", "left (m/s)", "turn (rad/s)"];

/// Three views of the commands, two of them against one another in each: cells without any are marked. `None`
/// without commands or a range to see them in.
pub(super) fn picture(log: &LogSummary) -> Option<String> {
    // A command that is not known in all three parts has no place in two of the views.
    let finite = |command: &&[f64; 3]| command.iter().all(|x| x.is_finite());
    let seen: Vec<&[f64; 3]> = log.commands.iter().filter(finite).collect();
    // An axis of no length has no cells.
    let ranged = log.command_range.iter().all(|[a, b]| a.is_finite() && b.is_finite() && a < b);
    if seen.is_empty() || !ranged {
        return None;
    }
    // User units. The 70 between two views hold the numbers and the title of the next axis.
    let side = 200.0;
    let label = "Commands of the log, two in each view";
    let mut figure = Figure::new(label, 3.0 * (side + 70.0), side + 62.0);
    for (i, (x, y)) in [(0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
        let left = 44.0 + i as f64 * (side + 70.0);
        let range = |k: usize| Some((log.command_range[k][0], log.command_range[k][1]));
        let (filled, empty) = cells(log, &seen, (x, y));
        let (along, up) = points(log, &seen, (x, y));
        let plot = Plot {
            // Commands beyond the range are worth seeing too.
            x: Axis { title: AXES[x], range: range(x), pad: MARGIN, ticks: 4, ..Axis::default() },
            y: Axis { title: AXES[y], range: range(y), pad: MARGIN, ticks: 4, ..Axis::default() },
            series: vec![
                Series::Boxes { look: Look::CELL, corners: &filled },
                Series::Boxes { look: Look::WRONG, corners: &empty },
                Series::Points { look: Look::color(0), x: &along, y: &up, radius: 2.0, ring: false },
            ],
            ..Plot::default()
        };
        figure.plot(&plot, Frame { left, top: 22.0, right: left + side, bottom: 22.0 + side });
    }
    Some(figure.inline())
}

/// How many commands fall into each cell of two of their axes; the last index is that of `y`.
fn counts(log: &LogSummary, seen: &[&[f64; 3]], (x, y): (usize, usize)) -> [[usize; CELLS]; CELLS] {
    let mut counts = [[0; CELLS]; CELLS];
    let cell = |k: usize, value: f64| {
        let [low, high] = log.command_range[k];
        let share = (value - low) / (high - low);
        // The ends belong to the range, whatever was rounded on the way.
        (-1e-6..=1.0 + 1e-6).contains(&share).then(|| ((share * CELLS as f64) as usize).min(CELLS - 1))
    };
    for command in seen {
        if let (Some(i), Some(j)) = (cell(x, command[x]), cell(y, command[y])) {
            counts[i][j] += 1;
        }
    }
    counts
}

/// Cells with commands and those without any.
fn cells(log: &LogSummary, seen: &[&[f64; 3]], axes: (usize, usize)) -> (Vec<Corners>, Vec<Corners>) {
    let ends = |k: usize, i: usize| {
        let [low, high] = log.command_range[k];
        let edge = |i: f64| low + (high - low) * i / CELLS as f64;
        // A little less, so that cells do not touch.
        (edge(i as f64 + 0.02), edge(i as f64 + 0.98))
    };
    let counts = counts(log, seen, axes);
    let all = (0..CELLS).flat_map(|i| (0..CELLS).map(move |j| (i, j)));
    let (filled, empty): (Vec<_>, Vec<_>) = all.partition(|(i, j)| counts[*i][*j] > 0);
    let corners = |list: Vec<(usize, usize)>| {
        list.into_iter().map(|(i, j)| [ends(axes.0, i), ends(axes.1, j)]).collect()
    };
    (corners(filled), corners(empty))
}

/// Some of the commands; those beyond the axes lie at their ends.
fn points(log: &LogSummary, seen: &[&[f64; 3]], (x, y): (usize, usize)) -> (Vec<f64>, Vec<f64>) {
    let held = |k: usize, value: f64| {
        let [low, high] = log.command_range[k];
        let margin = MARGIN * (high - low);
        value.clamp(low - margin, high + margin)
    };
    // Every nth command. `seen` is not empty here (see `picture`), so the step is not 0.
    let kept = seen.iter().step_by(seen.len().div_ceil(POINTS));
    kept.map(|command| (held(x, command[x]), held(y, command[y]))).unzip()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn cells_hold_their_commands_and_no_others() {
        let log = LogSummary {
            commands: vec![[1.0, -1.0, 0.0], [-1.0, 1.0, 0.0], [-0.95, 0.95, 0.0], [9.0, 0.0, 0.0]],
            ..LogSummary::default()
        };
        let seen: Vec<&[f64; 3]> = log.commands.iter().collect();
        let counts = counts(&log, &seen, (0, 1));
        assert_eq!((counts[CELLS - 1][0], counts[0][CELLS - 1]), (1, 2));
        assert_eq!(counts.iter().flatten().sum::<usize>(), 3, "a command beyond the range is in no cell");
        // Of 25 cells 2 are taken in the first view and the second, 3 in the third.
        let empty = [(0, 1), (0, 2), (1, 2)].map(|axes| cells(&log, &seen, axes).1.len());
        assert_eq!(empty, [23, 23, 22]);
        assert!(picture(&log).unwrap().contains("f wrong"));
    }

    #[test]
    fn no_commands_no_picture() {
        assert!(picture(&LogSummary::default()).is_none());
        let log = LogSummary {
            commands: vec![[0.0; 3]],
            command_range: [[1.0, 1.0], [0.0, f64::NAN], [0.0, 1.0]],
            ..LogSummary::default()
        };
        assert!(picture(&log).is_none());
    }
}
