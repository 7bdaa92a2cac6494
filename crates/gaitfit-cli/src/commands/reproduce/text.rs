//! Tables for people: what a table came to, and which tables there are.

use crate::table::table;
use gaitfit::reproduce::{Kind, Paper};
use gaitfit::reproduce::{Results, Walk, shown as estimate};
use gaitfit_view::Estimate;
use std::fmt::Write;

/// The tables that there are.
pub fn list(paper: &Paper) -> String {
    let mut rows = table(&["table", "what", "cells", "takes (estimate)"], &[2]);
    for one in &paper.tables {
        rows.add_row([one.name.clone(), one.title.clone(), one.cells.len().to_string(), one.time.clone()]);
    }
    format!("{rows}\n\ngaitfit reproduce TABLE runs one; cells that are finished are skipped.\n")
}

/// The rows, with the paper's numbers beside ours.
pub fn text(results: &Results) -> String {
    let scale = if results.full { ", at the paper's scale" } else { "" };
    let mut text = format!("{}{scale}\n\n", results.title);
    let rows = match results.kind {
        Kind::Identification => identification(results),
        Kind::Finetuning => finetuning(results),
    };
    let _ = writeln!(text, "{rows}\n");
    for row in &results.rows {
        for seed in &row.seeds {
            for warning in &seed.warnings {
                let _ = writeln!(text, "note: {}, seed {}: {warning}", row.cell, seed.seed);
            }
        }
    }
    let _ = writeln!(text, "files: {}", results.run_folder);
    text
}

/// Errors of parameters, percent: a line of ours and one of the paper's for each cell.
fn identification(results: &Results) -> comfy_table::Table {
    let names: Vec<&String> =
        results.rows.first().map(|row| row.errors_percent.keys().collect()).unwrap_or_default();
    let mut header = vec!["error, %", ""];
    header.extend(names.iter().map(|name| name.as_str()));
    header.extend(["mean", "seconds"]);
    let mut rows = table(&header, &(2..header.len()).collect::<Vec<_>>());
    let percent = |value: Option<&f64>| value.map_or_else(String::new, |value| format!("{value:.2}"));
    for row in &results.rows {
        let mut ours = vec![row.cell.clone(), "gaitfit".to_owned()];
        ours.extend(names.iter().map(|name| estimate(row.errors_percent.get(*name).copied(), 2)));
        ours.extend([estimate(row.mean_error_percent, 2), format!("{:.0}", row.seconds)]);
        rows.add_row(ours);
        let mut theirs = vec![String::new(), "paper".to_owned()];
        theirs.extend(names.iter().map(|name| percent(row.paper.errors_percent.get(*name))));
        theirs.extend([percent(row.paper.mean_error_percent.as_ref()), String::new()]);
        rows.add_row(theirs);
    }
    rows
}

fn finetuning(results: &Results) -> comfy_table::Table {
    let drifts = results.rows.iter().any(|row| row.walk.is_some_and(|walk| walk.drift.is_some()));
    let mut header = vec!["policy", "summed reward", "linear error, m/s", "angular error, rad/s", "falls, %"];
    // Cells without drift trials would fill the column with gaps.
    header.extend(drifts.then_some("drift, m"));
    header.extend(["seconds", "in the paper"]);
    let mut rows = table(&header, &(1..header.len() - 1).collect::<Vec<_>>());
    for row in &results.rows {
        let cell = |which: fn(&Walk) -> Estimate, digits| estimate(row.walk.as_ref().map(which), digits);
        let falls =
            |walk: &Walk| Estimate { mean: 100.0 * walk.fall_rate.mean, ci95: 100.0 * walk.fall_rate.ci95 };
        let mut cells = vec![
            row.label(),
            cell(|walk| walk.reward, 3),
            cell(|walk| walk.linear_velocity_error, 4),
            cell(|walk| walk.angular_velocity_error, 4),
            estimate(row.walk.as_ref().map(falls), 2),
        ];
        if drifts {
            cells.push(estimate(row.walk.and_then(|walk| walk.drift), 3));
        }
        cells.extend([format!("{:.0}", row.seconds), row.paper.says.clone().unwrap_or_default()]);
        rows.add_row(cells);
    }
    rows
}
