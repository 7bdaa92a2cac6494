//! Measured, nominal and fitted histograms of one joint quantity laid over one another.

use super::histogram::stairs;
use super::panel::{self, Panel};
use super::scale::{self, Scale};
use crate::report::JointDistribution;
use std::fmt::Write;

/// Bins drawn at most; finer histograms are merged.
const BINS: usize = 120;

/// The chart; `None` when edges and densities do not fit together.
pub(crate) fn distribution(data: &JointDistribution) -> Option<String> {
    let bins = data.edges.len().checked_sub(1).filter(|b| *b > 0)?;
    if data.edges.iter().any(|e| !e.is_finite()) {
        return None;
    }
    let merge = bins.div_ceil(BINS);
    let edges: Vec<f64> = data
        .edges
        .iter()
        .copied()
        .step_by(merge)
        .chain((bins % merge != 0).then(|| data.edges[bins]))
        .collect();
    let coarse = |density: &[f64]| -> Vec<f64> {
        if density.len() != bins {
            return Vec::new();
        }
        density
            .chunks(merge)
            .zip(data.edges.windows(2).collect::<Vec<_>>().chunks(merge))
            .map(|(d, e)| {
                let mass: f64 = d.iter().zip(e).map(|(d, e)| d * (e[1] - e[0])).sum();
                mass / (e[e.len() - 1][1] - e[0][0])
            })
            .collect()
    };
    let (measured, nominal, fitted) = (coarse(&data.measured), coarse(&data.nominal), coarse(&data.fitted));
    let all = measured.iter().chain(&nominal).chain(&fitted).copied();
    let highest = scale::extent(all)?.1;
    let unit = data.quantity.unit();
    let (left, right, top, bottom) = (46.0, 352.0, 24.0, 134.0);
    let chart = Panel {
        x: Scale::linear(Some((edges[0], edges[edges.len() - 1])), left, right),
        y: Scale::linear(Some((0.0, highest * 1.05)), bottom, top),
        left,
        right,
        top,
        bottom,
        x_title: &format!("{} ({unit})", quantity_name(data)),
        y_title: &format!("density (1/({unit}))").replace("(rad))", "rad)"),
        x_ticks: 5,
        y_ticks: 3,
    };
    let mut svg = panel::open_svg(360.0, 170.0, &format!("{} of {}", quantity_name(data), data.joint));
    chart.open(&mut svg);
    for (class, density) in [("area", &measured), ("nominal", &nominal), ("fitted", &fitted)] {
        let d = stairs(&chart, &edges, density);
        if !d.is_empty() {
            let _ = write!(svg, r#"<path class="d {class}" d="{d}"/>"#);
        }
    }
    panel::close(&mut svg);
    svg.push_str("</svg>");
    Some(svg)
}

fn quantity_name(data: &JointDistribution) -> &'static str {
    match data.quantity {
        crate::report::Quantity::Position => "position",
        crate::report::Quantity::Velocity => "velocity",
    }
}
