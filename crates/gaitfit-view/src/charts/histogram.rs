//! How often a number was what.

use super::panel::{self, Panel};
use super::path::coordinate;
use super::scale::{self, Scale};
use std::fmt::Write;

/// Bins drawn at most.
const BINS: usize = 400;

/// Counts between edges with a line at their mean and, dashed, at a limit; `None` when edges and counts do not fit
/// together or nothing was counted.
pub(crate) fn histogram(
    title: &str,
    x_title: &str,
    edges: &[f64],
    counts: &[u64],
    mean: f64,
    limit: Option<f64>,
) -> Option<String> {
    let ascending = edges.windows(2).all(|e| e[0] < e[1]) && edges.iter().all(|e| e.is_finite());
    if counts.is_empty() || counts.len() > BINS || edges.len() != counts.len() + 1 || !ascending {
        return None;
    }
    let total = counts.iter().map(|c| *c as f64).sum::<f64>();
    let shares: Vec<f64> = counts.iter().map(|c| 100.0 * *c as f64 / total).collect();
    let highest = scale::extent(shares.iter().copied())?.1;
    let (left, right, top, bottom) = (46.0, 350.0, 26.0, 165.0);
    let (low, high) = (edges[0], edges[edges.len() - 1]);
    // A limit far away would squeeze the rest.
    let limit = limit.filter(|l| *l > low && *l < high + 2.0 * (high - low));
    let chart = Panel {
        x: Scale::linear(Some((low, limit.map_or(high, |l| l.max(high)))), left, right),
        y: Scale::linear(Some((0.0, highest * 1.05)), bottom, top),
        left,
        right,
        top,
        bottom,
        x_title,
        y_title: "% of trajectories",
        x_ticks: 6,
        y_ticks: 3,
    };
    let mut svg = panel::open_svg(360.0, 200.0, title);
    chart.open(&mut svg);
    let d = stairs(&chart, edges, &shares);
    let _ = write!(svg, r#"<path class="area" d="{d}"/><path class="d fitted" d="{d}"/>"#);
    let (y1, y2) = (coordinate(bottom), coordinate(top));
    if mean.is_finite() && (low..=high).contains(&mean) {
        let _ = write!(svg, r#"<path class="d mean" d="M{} {y1}V{y2}"/>"#, coordinate(chart.x.at(mean)));
    }
    if let Some(limit) = limit {
        let _ = write!(svg, r#"<path class="floor" d="M{} {y1}V{y2}"/>"#, coordinate(chart.x.at(limit)));
    }
    panel::close(&mut svg);
    svg.push_str("</svg>");
    Some(svg)
}

/// The outline of a histogram from the base line and back to it.
pub(crate) fn stairs(chart: &Panel, edges: &[f64], density: &[f64]) -> String {
    if density.is_empty() {
        return String::new();
    }
    let mut d = format!("M{} {}", coordinate(chart.x.at(edges[0])), coordinate(chart.bottom));
    for (i, height) in density.iter().enumerate() {
        let y = chart.y.at(if height.is_finite() { *height } else { 0.0 });
        let _ = write!(d, "V{}H{}", coordinate(y), coordinate(chart.x.at(edges[i + 1])));
    }
    let _ = write!(d, "V{}", coordinate(chart.bottom));
    d
}
