//! Series between axes: each kind becomes a path.

use super::axes::Axes;
use super::look::Look;
use super::path::{self, coordinate};
use super::scale::Scale;
use crate::format::escape;
use std::fmt::Write;

/// Ends of a rectangle in x and in y, smaller first; infinite ends reach the edge of the axes.
pub type Corners = [(f64, f64); 2];

/// Numbers to draw, in the units of the axes. Lists that belong together are cut to the shortest.
#[derive(Clone, Debug, PartialEq)]
pub enum Series<'a> {
    /// A line through points. A name is read out under the pointer on a page; empty: it is not.
    Line {
        /// Name of the line.
        name: &'a str,
        /// Look of the line.
        look: Look,
        /// Along the axis, ascending.
        x: &'a [f64],
        /// Values.
        y: &'a [f64],
    },
    /// Values that are held until the next one.
    Step {
        /// Name of the line.
        name: &'a str,
        /// Look of the line.
        look: Look,
        /// Where each value begins, ascending.
        x: &'a [f64],
        /// Values.
        y: &'a [f64],
    },
    /// A disc a point.
    Points {
        /// Look of the discs.
        look: Look,
        /// Along the axis.
        x: &'a [f64],
        /// Values.
        y: &'a [f64],
        /// Radius of a disc, user units.
        radius: f64,
        /// Rings instead of discs.
        ring: bool,
    },
    /// Vertical bars without gaps: a histogram.
    Stairs {
        /// Look of the bars.
        look: Look,
        /// Ends of the bars, ascending; one more than heights.
        edges: &'a [f64],
        /// Heights above zero.
        heights: &'a [f64],
        /// Filled, or the outline alone.
        filled: bool,
    },
    /// The area between two curves.
    Band {
        /// Look of the area.
        look: Look,
        /// Along the axis, ascending.
        x: &'a [f64],
        /// Lower curve.
        low: &'a [f64],
        /// Upper curve.
        high: &'a [f64],
    },
    /// Rectangles, e.g. bars or marked stretches.
    Boxes {
        /// Look of the rectangles.
        look: Look,
        /// Ends of each.
        corners: &'a [Corners],
    },
    /// A straight line across the axes.
    Rule {
        /// Look of the line.
        look: Look,
        /// Where it crosses.
        at: f64,
        /// Whether it crosses the x axis, or else the y axis.
        upright: bool,
    },
}

impl Series<'_> {
    /// Values that the x axis (`axis` 0) or the y axis (1) has to hold.
    pub(super) fn values(&self, axis: usize) -> Vec<f64> {
        let both = |x: &[f64], y: &[f64]| -> Vec<f64> {
            // Only points that are drawn may stretch the axes.
            let finite = x.iter().zip(y).filter(|(x, y)| x.is_finite() && y.is_finite());
            finite.map(|(x, y)| if axis == 0 { *x } else { *y }).collect()
        };
        match self {
            Series::Line { x, y, .. } | Series::Step { x, y, .. } | Series::Points { x, y, .. } => both(x, y),
            Series::Stairs { edges, .. } if axis == 0 => edges.to_vec(),
            // Stairs stand on zero.
            Series::Stairs { heights, .. } => heights.iter().copied().chain([0.0]).collect(),
            Series::Band { x, low, high, .. } => both(x, low).into_iter().chain(both(x, high)).collect(),
            // An infinite end reaches as far as the axis does, so it does not set it.
            Series::Boxes { corners, .. } => {
                corners.iter().flat_map(|c| [c[axis].0, c[axis].1]).filter(|v| v.is_finite()).collect()
            }
            Series::Rule { at, upright, .. } if *upright == (axis == 0) => vec![*at],
            Series::Rule { .. } => Vec::new(),
        }
    }

    /// Draws between the axes, lines with about `points` points.
    pub(super) fn draw(&self, svg: &mut String, axes: &Axes, points: usize) {
        match self {
            Series::Line { name, look, x, y } => line(svg, axes, (name, *look), (x, y), points),
            Series::Step { name, look, x, y } => {
                let (x, y) = corners_of(x, y);
                // A step is two corners.
                line(svg, axes, (name, *look), (&x, &y), 2 * points);
            }
            Series::Points { look, x, y, radius, ring } => {
                let (radius, kind) = (coordinate(*radius), if *ring { "s ring" } else { "f" });
                // Zero and negative values have no place on a logarithmic axis.
                for (x, y) in x.iter().zip(*y).filter(|(x, y)| fits(&axes.x, **x) && fits(&axes.y, **y)) {
                    let (cx, cy) = (coordinate(axes.x.at(*x)), coordinate(axes.y.at(*y)));
                    let _ =
                        write!(svg, r#"<circle class="{kind} {look}" cx="{cx}" cy="{cy}" r="{radius}"/>"#);
                }
            }
            Series::Stairs { look, edges, heights, filled } => {
                if edges.len() == heights.len() + 1 && edges.iter().all(|e| e.is_finite()) {
                    let kind = if *filled { 'f' } else { 's' };
                    let d = stairs(axes, edges, heights);
                    let _ = write!(svg, r#"<path class="{kind} {look}" d="{d}"/>"#);
                }
            }
            Series::Band { look, x, low, high } => band(svg, axes, *look, (x, low, high), points),
            Series::Boxes { look, corners } => boxes(svg, axes, *look, corners),
            Series::Rule { look, at, upright } => rule(svg, axes, *look, *at, *upright),
        }
    }
}

/// Whether a value has a place on the scale.
fn fits(scale: &Scale, value: f64) -> bool {
    value.is_finite() && (!scale.is_log() || value > 0.0)
}

fn line(svg: &mut String, axes: &Axes, (name, look): (&str, Look), (x, y): (&[f64], &[f64]), points: usize) {
    let y = &y[..y.len().min(x.len())];
    // Thinned before the test, so that gaps keep an index and break the line.
    let d = path::line(path::thin(y, points).into_iter().map(|i| {
        let inside = fits(&axes.x, x[i]) && fits(&axes.y, y[i]);
        if inside { (axes.x.at(x[i]), axes.y.at(y[i])) } else { (f64::NAN, f64::NAN) }
    }));
    if d.is_empty() {
        return;
    }
    let named = if name.is_empty() { String::new() } else { format!(r#" data-n="{}""#, escape(name)) };
    let _ = write!(svg, r#"<path class="s {look}"{named} d="{d}"/>"#);
}

/// A value held until the next sample, as corner points; runs of one value keep their ends only.
fn corners_of(x: &[f64], y: &[f64]) -> (Vec<f64>, Vec<f64>) {
    let (mut along, mut values) = (Vec::new(), Vec::new());
    let count = x.len().min(y.len());
    for i in 0..count {
        // NaN differs from itself, so a gap keeps all of its samples and stays a gap.
        let changed = i == 0 || y[i] != y[i - 1];
        if changed && i > 0 {
            along.push(x[i]);
            values.push(y[i - 1]);
        }
        if changed || i + 1 == count {
            along.push(x[i]);
            values.push(y[i]);
        }
    }
    (along, values)
}

/// The outline of a histogram from the base line and back to it.
fn stairs(axes: &Axes, edges: &[f64], heights: &[f64]) -> String {
    // A logarithmic axis has no zero, so bars stand on its lower end.
    let base = coordinate(axes.y.at(if axes.y.is_log() { axes.y.domain().0 } else { 0.0 }));
    let mut d = format!("M{} {base}", coordinate(axes.x.at(edges[0])));
    for (height, end) in heights.iter().zip(&edges[1..]) {
        let y = if fits(&axes.y, *height) { coordinate(axes.y.at(*height)) } else { base.clone() };
        let _ = write!(d, "V{y}H{}", coordinate(axes.x.at(*end)));
    }
    d.push('V');
    d.push_str(&base);
    d
}

/// A closed outline a stretch without gaps.
fn band(svg: &mut String, axes: &Axes, look: Look, (x, low, high): (&[f64], &[f64], &[f64]), points: usize) {
    let count = x.len().min(low.len()).min(high.len());
    // Each curve keeps its own peaks, so the points of both are joined.
    let mut known = path::thin(&low[..count], points / 2);
    known.extend(path::thin(&high[..count], points / 2));
    known.sort_unstable();
    known.dedup();
    let whole = |i: &usize| fits(&axes.x, x[*i]) && fits(&axes.y, low[*i]) && fits(&axes.y, high[*i]);
    let mut d = String::new();
    for stretch in known.chunk_by(|a, b| whole(a) == whole(b)).filter(|stretch| stretch.iter().all(whole)) {
        let there = stretch.iter().map(|i| (axes.x.at(x[*i]), axes.y.at(high[*i])));
        let back = stretch.iter().rev().map(|i| (axes.x.at(x[*i]), axes.y.at(low[*i])));
        d.push_str(&path::line(there.chain(back)));
        d.push('Z');
    }
    if !d.is_empty() {
        let _ = write!(svg, r#"<path class="f {look}" d="{d}"/>"#);
    }
}

fn boxes(svg: &mut String, axes: &Axes, look: Look, corners: &[Corners]) {
    let ends = |scale: &Scale, (low, high): (f64, f64)| {
        let (first, last) = scale.domain();
        let at = |end: f64| scale.at(end.clamp(first, last));
        // A box beside the axes is left out. Clamped, it would be a line at their edge.
        let known = !low.is_nan() && !high.is_nan() && low <= last && high >= first;
        known.then(|| (at(low), at(high)))
    };
    let mut d = String::new();
    for [along, up] in corners {
        if let (Some((x0, x1)), Some((y0, y1))) = (ends(&axes.x, *along), ends(&axes.y, *up)) {
            // A box too narrow to see still shows that it is there.
            let (right, top) = (coordinate(x1.max(x0 + 0.5)), coordinate(y1));
            let _ = write!(d, "M{} {}H{right}V{top}H{}Z", coordinate(x0), coordinate(y0), coordinate(x0));
        }
    }
    if !d.is_empty() {
        let _ = write!(svg, r#"<path class="f {look}" d="{d}"/>"#);
    }
}

fn rule(svg: &mut String, axes: &Axes, look: Look, at: f64, upright: bool) {
    let scale = if upright { &axes.x } else { &axes.y };
    let (low, high) = scale.domain();
    // A limit beyond the axis is not drawn. At the edge it would look as if it were there.
    if !(low..=high).contains(&at) {
        return;
    }
    let at = coordinate(scale.at(at));
    let frame = &axes.frame;
    let d = if upright {
        format!("M{at} {}V{}", coordinate(frame.bottom), coordinate(frame.top))
    } else {
        format!("M{} {at}H{}", coordinate(frame.left), coordinate(frame.right))
    };
    let _ = write!(svg, r#"<path class="s {look}" d="{d}"/>"#);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_held_value_has_corners() {
        let (x, y) = corners_of(&[0.0, 1.0, 2.0, 3.0], &[5.0, 5.0, 7.0, 7.0]);
        assert_eq!(x, [0.0, 2.0, 2.0, 3.0]);
        assert_eq!(y, [5.0, 5.0, 7.0, 7.0]);
    }
}
