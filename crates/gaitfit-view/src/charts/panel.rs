//! One pair of axes with lines in it: what time series, convergence curves and distributions share.

use super::path::{self, coordinate};
use super::scale::Scale;
use crate::format::escape;
use std::fmt::Write;

/// A rectangle of an SVG with its scales and labels.
pub(crate) struct Panel<'a> {
    /// Positions in the SVG; `x` maps to left..right, `y` to bottom..top.
    pub x: Scale,
    pub y: Scale,
    pub left: f64,
    pub right: f64,
    pub top: f64,
    pub bottom: f64,
    /// Axis titles with units; an empty one is left out, and with it the x axis' numbers.
    pub x_title: &'a str,
    pub y_title: &'a str,
    /// About how many ticks.
    pub x_ticks: usize,
    pub y_ticks: usize,
}

impl Panel<'_> {
    /// Opens the panel's group and draws grid and axes. The data attributes let the page's script turn pointer
    /// positions back into values. Close it with [`close`].
    pub fn open(&self, svg: &mut String) {
        let ((x0, x1), (y0, y1)) = (self.x.domain(), self.y.domain());
        let (left, right, top, bottom) =
            (coordinate(self.left), coordinate(self.right), coordinate(self.top), coordinate(self.bottom));
        let _ = write!(
            svg,
            r#"<g class="panel" data-box="{left} {top} {right} {bottom}" data-x="{x0} {x1}" data-y="{y0} {y1}" data-log="{}" data-xlog="{}">"#,
            u8::from(self.y.is_log()),
            u8::from(self.x.is_log())
        );
        let mut grid = String::new();
        for tick in self.y.ticks(self.y_ticks) {
            let y = coordinate(self.y.at(tick.value));
            let _ = write!(grid, "M{left} {y}H{right}");
            let label_y = coordinate(self.y.at(tick.value) + 3.5);
            let label_x = coordinate(self.left - 5.0);
            let _ = write!(svg, r#"<text class="t e" x="{label_x}" y="{label_y}">{}</text>"#, tick.label);
        }
        let _ = write!(svg, r#"<path class="grid" d="{grid}"/>"#);
        let _ = write!(svg, r#"<path class="axis" d="M{left} {bottom}H{right}"/>"#);
        if !self.x_title.is_empty() {
            let mut marks = String::new();
            for tick in self.x.ticks(self.x_ticks) {
                let x = coordinate(self.x.at(tick.value));
                let _ = write!(marks, "M{x} {bottom}v4");
                let label_y = coordinate(self.bottom + 15.0);
                let _ = write!(svg, r#"<text class="t m" x="{x}" y="{label_y}">{}</text>"#, tick.label);
            }
            let _ = write!(svg, r#"<path class="axis" d="{marks}"/>"#);
            let (x, y) = (coordinate((self.left + self.right) / 2.0), coordinate(self.bottom + 30.0));
            let _ = write!(svg, r#"<text class="t m" x="{x}" y="{y}">{}</text>"#, escape(self.x_title));
        }
        if !self.y_title.is_empty() {
            let y = coordinate(self.top - 11.0);
            let _ = write!(svg, r#"<text class="t" x="2" y="{y}">{}</text>"#, escape(self.y_title));
        }
    }

    /// Draws a series thinned to about `points` points, named for the read-out, in the style sheet's `class`.
    pub fn series(&self, svg: &mut String, name: &str, class: &str, x: &[f64], y: &[f64], points: usize) {
        let y = &y[..y.len().min(x.len())];
        let d = path::line(path::thin(y, points).into_iter().map(|i| {
            let fits = |scale: &Scale, value: f64| value.is_finite() && (!scale.is_log() || value > 0.0);
            let inside = fits(&self.x, x[i]) && fits(&self.y, y[i]);
            if inside { (self.x.at(x[i]), self.y.at(y[i])) } else { (f64::NAN, f64::NAN) }
        }));
        if !d.is_empty() {
            let _ = write!(svg, r#"<path class="s {class}" data-n="{}" d="{d}"/>"#, escape(name));
        }
    }
}

/// Opens an SVG of a size in user units with an accessible name.
pub(crate) fn open_svg(width: f64, height: f64, label: &str) -> String {
    format!(r#"<svg viewBox="0 0 {width} {height}" role="img" aria-label="{}">"#, escape(label))
}

/// Closes a panel's group.
pub(crate) fn close(svg: &mut String) {
    svg.push_str("</g>");
}
