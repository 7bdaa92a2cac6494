//! Paths over the ground, seen from above.

use super::axes::Axis;
use super::figure::{Figure, Frame};
use super::look::Look;
use super::plot::Plot;
use super::scale;
use super::series::Series;

/// Points of a path at most.
const POINTS: usize = 400;

/// A path with a mark at its end.
pub(crate) struct Track<'a> {
    /// x (forward) and y (left), m.
    pub points: &'a [[f64; 2]],
    /// Look of the line.
    pub look: Look,
    /// Radius of the mark, user units.
    pub radius: f64,
    /// A ring, or else a disc.
    pub ring: bool,
}

/// All tracks, x to the right and y upwards in equal scales, `width` user units wide at most; `None` without any
/// point.
pub(crate) fn plan(title: &str, width: f64, tracks: &[Track]) -> Option<String> {
    // The bound keeps a diverged robot from making all other paths a point.
    let along = |k: usize| {
        let points = tracks.iter().flat_map(|t| t.points).map(move |p| p[k]);
        scale::extent(points.map(|x| x.clamp(-1e6, 1e6)))
    };
    let ((x0, x1), (y0, y1)) = (along(0)?, along(1)?);
    // At least 0.2 m each way, so that a robot that stands is not blown up.
    let (wide, tall) = ((x1 - x0).max(0.2) * 1.1, (y1 - y0).max(0.2) * 1.1);
    // Pixels a metre, the same both ways.
    let zoom = (width / wide).min(0.95 * width / tall);
    // A path straight ahead still leaves room for the numbers of the axis.
    let height = (tall * zoom).max(100.0);
    let frame = Frame { left: 56.0, top: 26.0, right: 56.0 + width, bottom: 26.0 + height };
    let centred =
        |a: f64, b: f64, length: f64| ((a + b - length / zoom) / 2.0, (a + b + length / zoom) / 2.0);

    // The last point is what tables are about: it is drawn whatever the step.
    let kept = |track: &Track| -> (Vec<f64>, Vec<f64>) {
        // At least 1, because a path without points has none to step over.
        let step = track.points.len().div_ceil(POINTS).max(1);
        track.points.iter().step_by(step).chain(track.points.last()).map(|p| (p[0], p[1])).unzip()
    };
    let lines: Vec<(Vec<f64>, Vec<f64>)> = tracks.iter().map(kept).collect();
    // A track without points has its mark at NaN, which is not drawn.
    let last = |(x, y): &(Vec<f64>, Vec<f64>)| (x.last().copied(), y.last().copied());
    let ends: Vec<([f64; 1], [f64; 1])> =
        lines.iter().map(last).map(|(x, y)| ([x.unwrap_or(f64::NAN)], [y.unwrap_or(f64::NAN)])).collect();
    let drawn =
        tracks.iter().zip(&lines).map(|(track, (x, y))| Series::Line { name: "", look: track.look, x, y });
    // Marks above all lines, and discs above rings.
    let marks = |ring: bool| {
        tracks.iter().zip(&ends).filter(move |(track, _)| track.ring == ring).map(|(track, (x, y))| {
            Series::Points { look: track.look, x, y, radius: track.radius, ring: track.ring }
        })
    };
    let plot = Plot {
        x: Axis { title: "x, forward (m)", range: Some(centred(x0, x1, width)), ticks: 6, ..Axis::default() },
        y: Axis { title: "y, left (m)", range: Some(centred(y0, y1, height)), ticks: 6, ..Axis::default() },
        series: drawn.chain(marks(true)).chain(marks(false)).collect(),
        // Thinned above already, with the end as one more.
        points: POINTS + 1,
    };
    let mut figure = Figure::new(title, frame.right + 10.0, frame.bottom + 40.0);
    figure.plot(&plot, frame).then(|| figure.inline())
}
