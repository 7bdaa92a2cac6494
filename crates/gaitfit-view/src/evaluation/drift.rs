//! Constant commands: where the robot went, seen from above, and how far it ended from where it should.

use super::Drift;
use crate::charts::panel::{self, Panel};
use crate::charts::path::{self, coordinate};
use crate::charts::scale::{self, Scale};
use crate::format::{UNKNOWN, clean, fixed, with_spread};
use serde::Serialize;
use std::fmt::Write;

/// Trials shown at most, and points of a path.
const MOST_TRIALS: usize = 64;
const POINTS: usize = 400;

/// Table and picture.
#[derive(Serialize)]
pub(super) struct DriftTable {
    rows: Vec<Row>,
    /// Paths from above; none without any.
    svg: Option<String>,
    has_spread: bool,
    left_out: usize,
}

#[derive(Serialize)]
struct Row {
    name: String,
    color: usize,
    trials: u32,
    falls: u32,
    /// x and y in m, yaw in rad, each with its spread.
    errors: Vec<String>,
    yaw_degrees: String,
}

pub(super) fn build(drift: &[Drift]) -> Option<DriftTable> {
    let shown = &drift[..drift.len().min(MOST_TRIALS)];
    let rows = shown.iter().enumerate().map(|(i, d)| Row {
        name: clean(&d.name),
        color: i % 8,
        trials: d.trials,
        falls: d.falls,
        errors: d.error.iter().zip(&d.spread).map(|(e, s)| error(*e, *s)).collect(),
        yaw_degrees: fixed(d.error[2].to_degrees(), 1),
    });
    (!shown.is_empty()).then(|| DriftTable {
        rows: rows.collect(),
        svg: picture(shown),
        has_spread: shown.iter().any(|d| d.spread.iter().any(|s| s.is_finite())),
        left_out: drift.len() - shown.len(),
    })
}

fn error(value: f64, spread: f64) -> String {
    if !value.is_finite() {
        return UNKNOWN.into();
    }
    if !spread.is_finite() {
        return fixed(value, 3);
    }
    let (value, spread) = with_spread(value, spread);
    format!("{value} ± {spread}")
}

/// All paths from above, x to the right and y upwards in equal scales, solid; what the commands ask for, dashed.
fn picture(drift: &[Drift]) -> Option<String> {
    let along = |k: usize| {
        let points = drift.iter().flat_map(|d| d.path.iter().chain(&d.intended)).map(move |p| p[k]);
        scale::extent(points.map(|x| x.clamp(-1e6, 1e6)))
    };
    let ((x0, x1), (y0, y1)) = (along(0)?, along(1)?);
    let (wide, tall) = ((x1 - x0).max(0.2) * 1.1, (y1 - y0).max(0.2) * 1.1);
    let width = 420.0;
    // Pixels a metre, the same both ways.
    let zoom = (width / wide).min(400.0 / tall);
    let height = (tall * zoom).max(100.0);
    let (left, top) = (56.0, 26.0);
    let (right, bottom) = (left + width, top + height);
    let centred =
        |a: f64, b: f64, length: f64| ((a + b - length / zoom) / 2.0, (a + b + length / zoom) / 2.0);
    let chart = Panel {
        x: Scale::linear(Some(centred(x0, x1, width)), left, right),
        y: Scale::linear(Some(centred(y0, y1, height)), bottom, top),
        left,
        right,
        top,
        bottom,
        x_title: "x, forward (m)",
        y_title: "y, left (m)",
        x_ticks: 6,
        y_ticks: 6,
    };
    let mut svg = panel::open_svg(right + 10.0, bottom + 40.0, "Paths under constant commands, from above");
    chart.open(&mut svg);
    let place = |p: &[f64; 2]| {
        let finite = p.iter().all(|x| x.is_finite());
        if finite { (chart.x.at(p[0]), chart.y.at(p[1])) } else { (f64::NAN, f64::NAN) }
    };
    for (i, trial) in drift.iter().enumerate() {
        for (points, look) in [(&trial.intended, "dashed"), (&trial.path, "")] {
            let step = points.len().div_ceil(POINTS).max(1);
            // The last point is what the table is about: it is drawn whatever the step.
            let kept = points.iter().step_by(step).chain(points.last());
            let d = path::line(kept.map(place));
            if !d.is_empty() {
                let _ = write!(svg, r#"<path class="d c{} {look}" d="{d}"/>"#, i % 8);
            }
        }
        if let Some((x, y)) = trial.intended.last().map(place).filter(|(x, _)| x.is_finite()) {
            let (x, y) = (coordinate(x), coordinate(y));
            let _ = write!(svg, r#"<circle class="ring c{}" cx="{x}" cy="{y}" r="5"/>"#, i % 8);
        }
        if let Some((x, y)) = trial.path.last().map(place).filter(|(x, _)| x.is_finite()) {
            let (x, y) = (coordinate(x), coordinate(y));
            let _ = write!(svg, r#"<circle class="bar{}" cx="{x}" cy="{y}" r="4"/>"#, i % 8);
        }
    }
    panel::close(&mut svg);
    svg.push_str("</svg>");
    Some(svg)
}
