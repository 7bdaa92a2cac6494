//! How the optimiser got there, run by run.

use super::AdaptReport;
use crate::charts::convergence::{Line, best_so_far, convergence};
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
    let mut costs = Vec::new();
    for (i, run) in runs.iter().enumerate() {
        costs.push(Line { label: &means[i], color: i, values: &run.mean, faint: true });
        costs.push(Line { label: &run.label, color: i, values: &best[i], faint: false });
    }
    let sigma = |(color, run)| {
        let run: &super::OptimizerRun = run;
        Line { label: &run.label, color, values: &run.sigma, faint: false }
    };
    let sigmas: Vec<Line> = runs.iter().enumerate().map(sigma).collect();
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
        cost: convergence("cost over generations", &format!("best cost so far{unit}"), &costs),
        sigma: convergence("step size over generations", "step size σ (relative)", &sigmas),
        rows,
        total: report.runs.len(),
        left_out: report.runs.len() - runs.len(),
    })
}
