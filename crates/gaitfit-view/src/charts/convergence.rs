//! Cost and step size over the generations, one line a run.

use super::panel::{self, Panel};
use super::scale::{self, Scale};

/// Points a line at most.
const POINTS: usize = 500;

/// One line: its label and a value a generation.
pub(crate) struct Line<'a> {
    pub label: &'a str,
    /// Position in the palette, so that a run has one colour in every chart.
    pub color: usize,
    pub values: &'a [f64],
    /// Drawn faintly, behind the others.
    pub faint: bool,
}

/// The chart, its y axis logarithmic when all values are positive; `None` when there is nothing to draw.
pub(crate) fn convergence(title: &str, y_title: &str, lines: &[Line]) -> Option<String> {
    let all = || lines.iter().flat_map(|l| l.values.iter().copied());
    let (low, high) = scale::extent(all())?;
    let generations = lines.iter().map(|l| l.values.len()).max()?;
    let (left, right, top, bottom) = (58.0, 470.0, 26.0, 240.0);
    let y = if low > 0.0 {
        Scale::log(low / 1.05, high * 1.05, bottom, top)
    } else {
        Scale::linear(Some((low, high)), bottom, top).padded(0.04)
    };
    let chart = Panel {
        x: Scale::linear(Some((1.0, generations as f64)), left, right),
        y,
        left,
        right,
        top,
        bottom,
        x_title: "generation",
        y_title,
        x_ticks: 6,
        y_ticks: 5,
    };
    let x: Vec<f64> = (1..=generations).map(|i| i as f64).collect();
    let mut svg = panel::open_svg(480.0, 275.0, title);
    chart.open(&mut svg);
    for faint in [true, false] {
        for line in lines.iter().filter(|l| l.faint == faint) {
            let class = format!("c{}{}", line.color % 8, if faint { " faint" } else { "" });
            chart.series(&mut svg, line.label, &class, &x, line.values, POINTS);
        }
    }
    panel::close(&mut svg);
    svg.push_str("</svg>");
    Some(svg)
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
