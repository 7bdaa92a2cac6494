//! How the optimiser got there, run by run.

use super::AdaptReport;
use crate::charts::curves::{Curves, Line, best_so_far};
use crate::format::{clean, significant};
use serde::Serialize;

/// Runs drawn at most.
const MOST_RUNS: usize = 40;

#[derive(Serialize)]
pub(super) struct Runs {
    cost: Option<String>,
    sigma: Option<String>,
    rows: Vec<RunRow>,
    total: usize,
    left_out: usize,
}

#[derive(Serialize)]
struct RunRow {
    label: String,
    color: usize,
    best: String,
    generations: usize,
}

pub(super) fn build(report: &AdaptReport) -> Option<Runs> {
    let runs = &report.runs[..report.runs.len().min(MOST_RUNS)];
    if runs.is_empty() {
        return None;
    }
    let best: Vec<Vec<f64>> = runs.iter().map(|r| best_so_far(&r.best)).collect();
    let means: Vec<String> = runs.iter().map(|r| format!("{}, generation's mean", r.label)).collect();
    let longest = runs.iter().map(|r| r.mean.len().max(r.best.len()).max(r.sigma.len())).max().unwrap_or(0);
    let x: Vec<f64> = (1..=longest).map(|i| i as f64).collect();
    let faint = (0..runs.len()).map(|i| (&means[i], &runs[i].mean, format!("c{} faint", i % 8)));
    let plain = |i: usize| format!("c{}", i % 8);
    let bold = (0..runs.len()).map(|i| (&runs[i].label, &best[i], plain(i)));
    let sigmas = (0..runs.len()).map(|i| (&runs[i].label, &runs[i].sigma, plain(i)));
    let unit = if report.cost_unit.is_empty() { String::new() } else { format!(" ({})", report.cost_unit) };
    let rows = runs
        .iter()
        .enumerate()
        .map(|(i, run)| RunRow {
            label: clean(&run.label),
            color: i % 8,
            best: significant(run.best_cost, 5),
            generations: run.best.len(),
        })
        .collect();
    Some(Runs {
        cost: chart("cost over generations", &format!("best cost so far{unit}"), &x, faint.chain(bold)),
        sigma: chart("step size over generations", "step size σ (relative)", &x, sigmas),
        rows,
        total: report.runs.len(),
        left_out: report.runs.len() - runs.len(),
    })
}

fn chart<'a>(
    title: &str,
    y_title: &str,
    x: &'a [f64],
    lines: impl Iterator<Item = (&'a String, &'a Vec<f64>, String)>,
) -> Option<String> {
    let lines = lines.map(|(label, y, class)| Line { label, class, x, y }).collect();
    Curves { title, x_title: "generation", y_title, size: (480.0, 275.0), log: true, goal: None, lines }
        .draw()
}
