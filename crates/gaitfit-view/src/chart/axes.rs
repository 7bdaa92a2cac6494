//! A pair of axes: grid, numbers and titles around a rectangle.

use super::figure::Frame;
use super::path::coordinate;
use super::scale::Scale;
use crate::format::escape;
use std::fmt::Write;

/// One axis of a [`Plot`](super::Plot).
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Axis<'a> {
    /// Title with its unit; empty: none.
    pub title: &'a str,
    /// Smallest and largest value; `None`: those of the series.
    pub range: Option<(f64, f64)>,
    /// Share of its length added at both ends, of a linear axis.
    pub pad: f64,
    /// Logarithmic, where all values are positive.
    pub log: bool,
    /// About how many numbers stand at the axis; 0: none.
    pub ticks: usize,
}

impl Default for Axis<'_> {
    fn default() -> Self {
        Axis { title: "", range: None, pad: 0.0, log: false, ticks: 5 }
    }
}

/// Scales that lie in a frame.
pub(super) struct Axes<'a> {
    pub x: Scale,
    pub y: Scale,
    pub frame: Frame,
    pub titles: [&'a str; 2],
    pub ticks: [usize; 2],
}

impl Axes<'_> {
    /// Opens a group and draws grid, numbers and titles. The data attributes let the page's script turn pointer
    /// positions back into values. The caller closes the group.
    pub fn open(&self, svg: &mut String) {
        let ((x0, x1), (y0, y1)) = (self.x.domain(), self.y.domain());
        let Frame { left, top, right, bottom } = self.frame;
        let box_text = [left, top, right, bottom].map(coordinate).join(" ");
        let _ = write!(
            svg,
            // The script turns positions back into values with these numbers, so they are not rounded.
            r#"<g class="panel" data-box="{box_text}" data-x="{x0} {x1}" data-y="{y0} {y1}" data-log="{}" data-xlog="{}">"#,
            u8::from(self.y.is_log()),
            u8::from(self.x.is_log())
        );
        self.draw_y(svg);
        self.draw_x(svg);
    }

    fn draw_y(&self, svg: &mut String) {
        let Frame { left, top, right, .. } = self.frame;
        let mut grid = String::new();
        let ticks = if self.ticks[1] > 0 { self.y.ticks(self.ticks[1]) } else { Vec::new() };
        for tick in ticks {
            let y = self.y.at(tick.value);
            // All grid lines are one path: an element each would make pages with many charts larger.
            let _ = write!(grid, "M{} {}H{}", coordinate(left), coordinate(y), coordinate(right));
            let _ = write!(
                svg,
                r#"<text class="t e" x="{}" y="{}">{}</text>"#,
                // 5 units to the left of the axis. 3.5 units are about half the height of a digit, so that the
                // number stands at the middle of its line.
                coordinate(left - 5.0),
                coordinate(y + 3.5),
                tick.label
            );
        }
        if !grid.is_empty() {
            let _ = write!(svg, r#"<path class="grid" d="{grid}"/>"#);
        }
        if !self.titles[1].is_empty() {
            // The title begins where the numbers do, above the axis.
            let (x, y) = (coordinate((left - 44.0).max(2.0)), coordinate(top - 10.0));
            let _ = write!(svg, r#"<text class="t" x="{x}" y="{y}">{}</text>"#, escape(self.titles[1]));
        }
    }

    fn draw_x(&self, svg: &mut String) {
        let Frame { left, right, bottom, .. } = self.frame;
        let line = format!("M{} {}H{}", coordinate(left), coordinate(bottom), coordinate(right));
        let mut marks = String::new();
        let ticks = if self.ticks[0] > 0 { self.x.ticks(self.ticks[0]) } else { Vec::new() };
        for tick in ticks {
            let x = coordinate(self.x.at(tick.value));
            let _ = write!(marks, "M{x} {}v4", coordinate(bottom));
            // Below the mark of 4 units, and above the title at 30.
            let y = coordinate(bottom + 15.0);
            let _ = write!(svg, r#"<text class="t m" x="{x}" y="{y}">{}</text>"#, tick.label);
        }
        let _ = write!(svg, r#"<path class="axis" d="{line}{marks}"/>"#);
        if !self.titles[0].is_empty() {
            let (x, y) = (coordinate((left + right) / 2.0), coordinate(bottom + 30.0));
            let _ = write!(svg, r#"<text class="t m" x="{x}" y="{y}">{}</text>"#, escape(self.titles[0]));
        }
    }
}
