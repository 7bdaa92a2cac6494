//! Two axes and the series between them.

use super::axes::{Axes, Axis};
use super::figure::{Figure, Frame};
use super::scale::{self, Scale};
use super::series::Series;

/// A chart: axes and series. It is drawn in the order of the series.
#[derive(Clone, Debug, PartialEq)]
pub struct Plot<'a> {
    /// The axis to the right.
    pub x: Axis<'a>,
    /// The axis upwards.
    pub y: Axis<'a>,
    /// Series, drawn in this order.
    pub series: Vec<Series<'a>>,
    /// About how many points a line has at most; more than the pixels of its width do not show.
    pub points: usize,
}

impl Default for Plot<'_> {
    fn default() -> Self {
        Plot { x: Axis::default(), y: Axis::default(), series: Vec::new(), points: 800 }
    }
}

impl Plot<'_> {
    /// A figure of its own, in user units, with room for numbers and titles. `label` says to those who do not see it
    /// what it is. `None` when there is nothing to draw.
    pub fn figure(&self, label: &str, width: f64, height: f64) -> Option<Figure> {
        let mut figure = Figure::new(label, width, height);
        let below = if self.x.title.is_empty() { 20.0 } else { 35.0 };
        let above = if self.y.title.is_empty() { 10.0 } else { 25.0 };
        let frame = Frame { left: 54.0, top: above, right: width - 10.0, bottom: height - below };
        figure.plot(self, frame).then_some(figure)
    }

    /// The axes in a frame; `None` when an axis has neither a range nor a value.
    pub(super) fn axes(&self, frame: Frame) -> Option<Axes<'_>> {
        let scale = |axis: &Axis, number: usize, from: f64, to: f64| {
            let values = || self.series.iter().flat_map(|s| s.values(number));
            let (low, high) = axis.range.or_else(|| scale::extent(values()))?;
            // Values of zero or less have no logarithm: the axis is linear then.
            if axis.log && low > 0.0 {
                // 5 % of room as a factor: on a logarithmic axis a sum would be more at one end than at the other.
                // A range that was given is kept.
                let room = if axis.range.is_some() { 1.0 } else { 1.05 };
                return Some(Scale::log(low / room, high * room, from, to));
            }
            Some(Scale::linear(Some((low, high)), from, to).padded(axis.pad))
        };
        Some(Axes {
            x: scale(&self.x, 0, frame.left, frame.right)?,
            // SVG counts y downwards.
            y: scale(&self.y, 1, frame.bottom, frame.top)?,
            frame,
            titles: [self.x.title, self.y.title],
            ticks: [self.x.ticks, self.y.ticks],
        })
    }
}
