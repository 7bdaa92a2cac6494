//! A picture of a log: every joint's position and target over time.

use crate::exit::Failure;
use gaitfit_log::{Signal, Trajectory};
use plotters::prelude::*;
use std::path::Path;

/// Size of one joint's panel, pixels.
const PANEL: (u32, u32) = (420, 220);

/// Points drawn of a line: more than its pixels, so that nothing shows.
const POINTS: usize = 1200;

/// Writes the picture as SVG.
pub fn write(log: &Trajectory, path: &Path) -> Result<(), Failure> {
    let svg = draw(log).map_err(|error| Failure::failed(format!("cannot draw the log: {error}")))?;
    std::fs::write(path, svg)
        .map_err(|error| Failure::failed(format!("cannot write {}: {error}", path.display())))
}

fn draw(log: &Trajectory) -> Result<String, Box<dyn std::error::Error>> {
    let columns = 3.min(log.joints.len()).max(1);
    let rows = log.joints.len().div_ceil(columns);
    let mut svg = String::new();
    {
        let size = (PANEL.0 * columns as u32, PANEL.1 * rows as u32);
        let page = SVGBackend::with_string(&mut svg, size).into_drawing_area();
        page.fill(&WHITE)?;
        for (joint, panel) in page.split_evenly((rows, columns)).iter().enumerate().take(log.joints.len()) {
            let position = thin(log, log.column_at(Signal::Position, joint).unwrap_or_default());
            let target = thin(log, log.column_at(Signal::Target, joint).unwrap_or_default());
            let all = || position.iter().chain(&target).filter(|point| point.1.is_finite());
            let low = all().map(|point| point.1).fold(f64::INFINITY, f64::min);
            let high = all().map(|point| point.1).fold(f64::NEG_INFINITY, f64::max);
            let (low, high) = if low < high { (low, high) } else { (low - 0.1, low + 0.1) };
            let (low, high) = if low.is_finite() { (low, high) } else { (-1.0, 1.0) };
            let margin = 0.05 * (high - low);
            let begin = log.time.first().copied().unwrap_or(0.0);
            let end = log.time.last().copied().unwrap_or(1.0).max(begin + 1e-9);
            let mut chart = ChartBuilder::on(panel)
                .caption(format!("{} (rad over s)", log.joints[joint]), ("sans-serif", 14))
                .margin(6)
                .x_label_area_size(22)
                .y_label_area_size(44)
                .build_cartesian_2d(begin..end, low - margin..high + margin)?;
            chart.configure_mesh().light_line_style(TRANSPARENT).x_labels(6).y_labels(5).draw()?;
            let finite = |line: Vec<(f64, f64)>| line.into_iter().filter(|point| point.1.is_finite());
            chart.draw_series(LineSeries::new(finite(target), RGBColor(200, 120, 40)))?;
            chart.draw_series(LineSeries::new(finite(position), RGBColor(30, 80, 160)))?;
        }
        page.present()?;
    }
    Ok(svg)
}

/// Every n-th sample, so that a long log stays a small file.
fn thin(log: &Trajectory, values: Vec<f64>) -> Vec<(f64, f64)> {
    let step = log.time.len().div_ceil(POINTS).max(1);
    log.time.iter().copied().zip(values).step_by(step).collect()
}
