//! How often a number was what.

use super::Histogram;
use crate::chart::{Axis, Look, Plot, Scale, Series, extent};

/// Max number of bins: more than the pixels of the chart do not show.
const BINS: usize = 400;

/// Counts between edges with a line at their mean and, dashed, at a limit; `None` when edges and counts do not fit
/// together or nothing was counted.
pub(super) fn histogram(
    title: &str,
    x_title: &str,
    edges: &[f64],
    counts: &[u64],
    mean: f64,
    limit: Option<f64>,
) -> Option<String> {
    // Edges that are not ascending would draw bars over each other.
    let ascending = edges.windows(2).all(|e| e[0] < e[1]) && edges.iter().all(|e| e.is_finite());
    if counts.is_empty() || counts.len() > BINS || edges.len() != counts.len() + 1 || !ascending {
        return None;
    }
    let total = counts.iter().map(|c| *c as f64).sum::<f64>();
    let shares: Vec<f64> = counts.iter().map(|c| 100.0 * *c as f64 / total).collect();
    // Without any count the shares are 0/0, of which none is finite.
    let highest = extent(shares.iter().copied())?.1;
    let (low, high) = (edges[0], edges[edges.len() - 1]);
    // A limit far away would squeeze the rest.
    let limit = limit.filter(|l| *l > low && *l < high + 2.0 * (high - low));
    // A pale area and its outline: the outline stays visible behind the lines of mean and limit.
    let outline = |look, filled| Series::Stairs { look, edges, heights: &shares, filled };
    let mut series = vec![outline(Look::AREA, true), outline(Look::FITTED, false)];
    series.push(Series::Rule { look: Look::MEAN, at: mean, upright: true });
    series.extend(limit.map(|at| Series::Rule { look: Look::LIMIT, at, upright: true }));
    let end = limit.map_or(high, |l| l.max(high));
    let plot = Plot {
        x: Axis { title: x_title, range: Some((low, end)), ticks: 6, ..Axis::default() },
        y: Axis {
            title: "% of trajectories",
            // A little room above the highest bar.
            range: Some((0.0, highest * 1.05)),
            ticks: 3,
            ..Axis::default()
        },
        series,
        ..Plot::default()
    };
    plot.figure(title, 360.0, 200.0).map(|figure| figure.inline())
}

impl Histogram {
    /// Counts `samples` in `bins` equal bins (1 to 400) from the smallest to the 99.5th percentile, so that a few
    /// falls do not squeeze the rest; what is not finite is not counted. Empty without samples.
    pub fn from_samples(samples: &[f64], bins: usize) -> Histogram {
        let mut sorted: Vec<f64> = samples.iter().copied().filter(|x| x.is_finite()).collect();
        sorted.sort_by(f64::total_cmp);
        let Some(low) = sorted.first().copied() else { return Histogram::default() };
        // A count of bins comes from callers. Zero would divide by zero, and more are not drawn.
        let bins = bins.clamp(1, BINS);
        // The last bin below takes what lies beyond.
        let high = sorted[(sorted.len() - 1) * 199 / 200];
        // Samples that are all equal get an interval with an inside.
        let (low, high) = Scale::linear(Some((low, high)), 0.0, 1.0).domain();
        let width = (high - low) / bins as f64;
        let mut counts = vec![0; bins];
        for x in &sorted {
            // `Scale` cuts numbers beyond ±1e150, so a sample can lie below `low`.
            let bin = ((x - low) / width).max(0.0) as usize;
            counts[bin.min(bins - 1)] += 1;
        }
        Histogram { edges: (0..=bins).map(|i| low + i as f64 * width).collect(), counts }
    }
}
