//! Paths over the ground, seen from above.

use super::panel::{self, Panel};
use super::path::{self, coordinate};
use super::scale::{self, Scale};
use std::fmt::Write;

/// Points of a path at most.
const POINTS: usize = 400;

/// A path with a mark at its end.
pub(crate) struct Track<'a> {
    /// x (forward) and y (left), m.
    pub points: &'a [[f64; 2]],
    /// Style-sheet classes of the line.
    pub line: String,
    /// Style-sheet classes of the mark.
    pub mark: String,
    /// Radius of the mark, user units.
    pub radius: f64,
}

/// All tracks, x to the right and y upwards in equal scales, `width` user units wide at most; `None` without any
/// point.
pub(crate) fn plan(title: &str, width: f64, tracks: &[Track]) -> Option<String> {
    let along = |k: usize| {
        let points = tracks.iter().flat_map(|t| t.points).map(move |p| p[k]);
        scale::extent(points.map(|x| x.clamp(-1e6, 1e6)))
    };
    let ((x0, x1), (y0, y1)) = (along(0)?, along(1)?);
    let (wide, tall) = ((x1 - x0).max(0.2) * 1.1, (y1 - y0).max(0.2) * 1.1);
    // Pixels a metre, the same both ways.
    let zoom = (width / wide).min(0.95 * width / tall);
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
    let mut svg = panel::open_svg(right + 10.0, bottom + 40.0, title);
    chart.open(&mut svg);
    let place = |p: &[f64; 2]| {
        let finite = p.iter().all(|x| x.is_finite());
        if finite { (chart.x.at(p[0]), chart.y.at(p[1])) } else { (f64::NAN, f64::NAN) }
    };
    for track in tracks {
        let step = track.points.len().div_ceil(POINTS).max(1);
        // The last point is what tables are about: it is drawn whatever the step.
        let kept = track.points.iter().step_by(step).chain(track.points.last());
        let d = path::line(kept.map(place));
        if !d.is_empty() {
            let _ = write!(svg, r#"<path class="d {}" d="{d}"/>"#, track.line);
        }
    }
    // Marks above all lines.
    for track in tracks {
        if let Some((x, y)) = track.points.last().map(place).filter(|(x, _)| x.is_finite()) {
            let (x, y, radius) = (coordinate(x), coordinate(y), coordinate(track.radius));
            let _ = write!(svg, r#"<circle class="{}" cx="{x}" cy="{y}" r="{radius}"/>"#, track.mark);
        }
    }
    panel::close(&mut svg);
    svg.push_str("</svg>");
    Some(svg)
}
