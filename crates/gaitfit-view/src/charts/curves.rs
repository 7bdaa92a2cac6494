//! Numbers over generations or iterations, one line a run.

use super::panel::{self, Panel};
use super::path::coordinate;
use super::scale::{self, Scale};
use std::fmt::Write;

/// One line and its style-sheet class.
pub(crate) struct Line<'a> {
    pub label: &'a str,
    pub class: String,
    pub x: &'a [f64],
    pub y: &'a [f64],
}

/// A chart of lines that share their axes.
pub(crate) struct Curves<'a> {
    /// Name for those who cannot see it.
    pub title: &'a str,
    pub x_title: &'a str,
    pub y_title: &'a str,
    /// Size in user units.
    pub size: (f64, f64),
    /// Logarithmic in y where all values are positive.
    pub log: bool,
    /// A value drawn as a line across.
    pub goal: Option<f64>,
    /// Drawn in this order.
    pub lines: Vec<Line<'a>>,
}

impl Curves<'_> {
    /// The chart; `None` when there is nothing to draw.
    pub fn draw(&self) -> Option<String> {
        let goal = self.goal.filter(|g| g.is_finite());
        // Values before the first or beyond the last x do not show, nor do those without one.
        let shown = || self.lines.iter().flat_map(|l| l.x.iter().zip(l.y).filter(|(x, _)| x.is_finite()));
        let (low, high) = scale::extent(shown().map(|(_, y)| *y))?;
        let (first, last) = scale::extent(shown().filter(|(_, y)| y.is_finite()).map(|(x, _)| *x))?;
        let (low, high) = goal.map_or((low, high), |g| (low.min(g), high.max(g)));
        let (left, right, top, bottom) = (58.0, self.size.0 - 10.0, 26.0, self.size.1 - 35.0);
        let y = if self.log && low > 0.0 {
            Scale::log(low / 1.05, high * 1.05, bottom, top)
        } else {
            Scale::linear(Some((low, high)), bottom, top).padded(0.04)
        };
        let chart = Panel {
            x: Scale::linear(Some((first, last)), left, right),
            y,
            left,
            right,
            top,
            bottom,
            x_title: self.x_title,
            y_title: self.y_title,
            x_ticks: (self.size.0 / 80.0) as usize,
            y_ticks: (self.size.1 / 50.0) as usize,
        };
        // More points than the chart is wide show no more.
        let points = self.size.0 as usize;
        let mut svg = panel::open_svg(self.size.0, self.size.1, self.title);
        chart.open(&mut svg);
        if let Some(goal) = goal {
            let (x1, x2, y) = (coordinate(left), coordinate(right), coordinate(y.at(goal)));
            let _ = write!(svg, r#"<path class="floor" d="M{x1} {y}H{x2}"/>"#);
        }
        for line in &self.lines {
            chart.series(&mut svg, line.label, &line.class, line.x, line.y, points);
        }
        panel::close(&mut svg);
        svg.push_str("</svg>");
        Some(svg)
    }
}

/// The best value so far; what is not finite leaves it as it was.
pub(crate) fn best_so_far(values: &[f64]) -> Vec<f64> {
    let mut best = f64::INFINITY;
    values
        .iter()
        .map(|v| {
            best = if v.is_finite() { best.min(*v) } else { best };
            best
        })
        .collect()
}
