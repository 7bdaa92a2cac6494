//! Which commands the log has seen, of those the policy is to follow.

use super::LogSummary;
use crate::charts::panel::{self, Panel};
use crate::charts::path::coordinate;
use crate::charts::scale::Scale;
use std::fmt::Write;

/// Cells a side that each pair of commands is divided into.
const CELLS: usize = 5;
/// Points drawn at most.
const POINTS: usize = 500;
/// Names of the commands and their axes.
const AXES: [&str; 3] = ["forward (m/s)", "left (m/s)", "turn (rad/s)"];

/// Three views of the commands, two of them against one another in each: cells without any are marked. `None`
/// without commands or a range to see them in.
pub(super) fn picture(log: &LogSummary) -> Option<String> {
    let finite = |command: &&[f64; 3]| command.iter().all(|x| x.is_finite());
    let seen: Vec<&[f64; 3]> = log.commands.iter().filter(finite).collect();
    let ranged = log.command_range.iter().all(|[a, b]| a.is_finite() && b.is_finite() && a < b);
    if seen.is_empty() || !ranged {
        return None;
    }
    let side = 200.0;
    let mut svg = panel::open_svg(
        3.0 * (side + 70.0),
        side + 62.0,
        "Commands of the log, two against one another in each view",
    );
    for (i, (x, y)) in [(0, 1), (0, 2), (1, 2)].into_iter().enumerate() {
        let left = 44.0 + i as f64 * (side + 70.0);
        let range = |k: usize| Some((log.command_range[k][0], log.command_range[k][1]));
        let (right, top, bottom) = (left + side, 22.0, 22.0 + side);
        // Commands beyond the range are worth seeing too.
        let chart = Panel {
            x: Scale::linear(range(x), left, right).padded(0.06),
            y: Scale::linear(range(y), bottom, top).padded(0.06),
            left,
            right,
            top,
            bottom,
            x_title: AXES[x],
            y_title: "",
            x_ticks: 4,
            y_ticks: 4,
        };
        chart.open(&mut svg);
        let _ = write!(svg, r#"<text class="t" x="{}" y="12">{}</text>"#, coordinate(left - 40.0), AXES[y]);
        cells(&mut svg, &chart, log, &seen, (x, y));
        points(&mut svg, &chart, &seen, (x, y));
        panel::close(&mut svg);
    }
    svg.push_str("</svg>");
    Some(svg)
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

fn cells(svg: &mut String, chart: &Panel, log: &LogSummary, seen: &[&[f64; 3]], axes: (usize, usize)) {
    let edge = |k: usize, i: usize| {
        let [low, high] = log.command_range[k];
        low + (high - low) * i as f64 / CELLS as f64
    };
    for (i, column) in counts(log, seen, axes).iter().enumerate() {
        for (j, count) in column.iter().enumerate() {
            let (x0, x1) = (chart.x.at(edge(axes.0, i)), chart.x.at(edge(axes.0, i + 1)));
            let (y0, y1) = (chart.y.at(edge(axes.1, j)), chart.y.at(edge(axes.1, j + 1)));
            let class = if *count == 0 { "cell none" } else { "cell" };
            let _ = write!(
                svg,
                r#"<rect class="{class}" x="{}" y="{}" width="{}" height="{}"/>"#,
                coordinate(x0 + 0.75),
                coordinate(y1 + 0.75),
                coordinate(x1 - x0 - 1.5),
                coordinate(y0 - y1 - 1.5)
            );
        }
    }
}

fn points(svg: &mut String, chart: &Panel, seen: &[&[f64; 3]], (x, y): (usize, usize)) {
    for command in seen.iter().step_by(seen.len().div_ceil(POINTS)) {
        let ((x0, x1), (y0, y1)) = (chart.x.domain(), chart.y.domain());
        let at = (chart.x.at(command[x].clamp(x0, x1)), chart.y.at(command[y].clamp(y0, y1)));
        let (cx, cy) = (coordinate(at.0), coordinate(at.1));
        let _ = write!(svg, r#"<circle class="bar0 seen" cx="{cx}" cy="{cy}" r="2"/>"#);
    }
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
        let svg = picture(&log).unwrap();
        // Of 25 cells 2 are taken in the first view and the second, 3 in the third.
        assert_eq!(svg.matches("cell none").count(), 23 + 23 + 22);
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
