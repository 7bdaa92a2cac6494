//! Progress of the optimiser, run by run.

use super::OptimizerRun;
use crate::chart::{Axis, Look, Plot, Series};
use crate::format::{clean, significant};
use serde::Serialize;

/// Runs drawn at most.
const MAX_RUNS: usize = 40;

#[derive(Serialize)]
pub(crate) struct Runs {
    cost: Option<String>,
    sigma: Option<String>,
    rows: Vec<RunRow>,
    /// The cost to set the runs against.
    nominal: Option<String>,
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

/// Charts of all runs with the cost before the fit as a line across, if it is known.
pub(super) fn build(runs: &[OptimizerRun], nominal_cost: f64) -> Option<Runs> {
    let shown = &runs[..runs.len().min(MAX_RUNS)];
    if shown.is_empty() {
        return None;
    }
    let best: Vec<Vec<f64>> = shown.iter().map(|r| best_so_far(&r.best)).collect();
    let means: Vec<String> = shown.iter().map(|r| format!("{}, generation's mean", r.label)).collect();
    // Runs may end early and record less: the axis holds the longest list.
    let longest = shown.iter().map(|r| r.mean.len().max(r.best.len()).max(r.sigma.len())).max().unwrap_or(0);
    let x: Vec<f64> = (1..=longest).map(|i| i as f64).collect();
    let faint = (0..shown.len()).map(|i| (&means[i], &shown[i].mean, Look::color(i).faint()));
    let bold = (0..shown.len()).map(|i| (&shown[i].label, &best[i], Look::color(i)));
    let sigmas = (0..shown.len()).map(|i| (&shown[i].label, &shown[i].sigma, Look::color(i)));
    let nominal = significant(nominal_cost, 4);
    // Series borrow names and numbers, so the line across gets variables of its own.
    let label = "nominal simulator".to_string();
    let before = vec![nominal_cost; longest];
    let across = nominal_cost.is_finite().then_some((&label, &before, Look::NOMINAL)).into_iter();
    let rows = shown
        .iter()
        .enumerate()
        .map(|(i, run)| RunRow {
            label: clean(&run.label),
            // As `Look::color` counts.
            color: i % 8,
            best: significant(run.best_cost, 5),
            generations: run.best.len(),
        })
        .collect();
    Some(Runs {
        // In this order the bold lines lie above the faint ones.
        cost: chart("cost over generations", "cost", &x, across.chain(faint).chain(bold)),
        sigma: chart("step size over generations", "step size σ (relative)", &x, sigmas),
        rows,
        nominal: nominal_cost.is_finite().then_some(nominal),
        total: runs.len(),
        left_out: runs.len() - shown.len(),
    })
}

fn chart<'a>(
    title: &str,
    y_title: &str,
    x: &'a [f64],
    lines: impl Iterator<Item = (&'a String, &'a Vec<f64>, Look)>,
) -> Option<String> {
    let plot = Plot {
        x: Axis { title: "generation", ticks: 6, ..Axis::default() },
        // Costs fall by powers of ten. The pad is for costs that reach 0, for which the axis is linear.
        y: Axis { title: y_title, log: true, pad: 0.04, ..Axis::default() },
        series: lines.map(|(name, y, look)| Series::Line { name, look, x, y }).collect(),
        // As wide as the chart.
        points: 480,
    };
    plot.figure(title, 480.0, 275.0).map(|figure| figure.inline())
}

/// The best value so far; what is not finite leaves it as it was.
fn best_so_far(values: &[f64]) -> Vec<f64> {
    let mut best = f64::INFINITY;
    values
        .iter()
        .map(|v| {
            best = if v.is_finite() { best.min(*v) } else { best };
            best
        })
        .collect()
}
