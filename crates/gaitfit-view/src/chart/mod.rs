//! Charts as SVG text: axes with lines, steps, points, stairs, bands and boxes in them, legends, and rows of bars.
//!
//! A [`Figure`] is one SVG of a fixed size in user units (pixels, until it is scaled). [`Figure::plot`] draws a
//! [`Plot`], which is two axes with series between them, into a rectangle of the figure, and a figure may hold many.
//! [`Plot::figure`] does both for a chart of its own. [`Figure::standalone`] gives the text of an `.svg` file with its
//! style inside; [`Figure::inline`] gives an element for an HTML page that has [`STYLE`] among its styles.
//!
//! ```
//! use gaitfit_view::chart::{Axis, Look, Plot, Series};
//!
//! let (time, position) = ([0.0, 0.1, 0.2, 0.3], [0.0, 0.4, 0.5, 0.45]);
//! let plot = Plot {
//!     x: Axis { title: "time (s)", ..Axis::default() },
//!     y: Axis { title: "position (rad)", ..Axis::default() },
//!     series: vec![Series::Line { name: "FL_calf", look: Look::MEASURED, x: &time, y: &position }],
//!     ..Plot::default()
//! };
//! let figure = plot.figure("FL_calf over time", 480.0, 240.0).expect("there are numbers to draw");
//! assert!(figure.standalone().starts_with("<svg xmlns="));
//! ```
//!
//! What is not finite is not drawn: it leaves a gap in a line and no mark elsewhere. Every text is escaped, so names
//! may come from files. Long series are thinned so that no peak is lost.

mod axes;
mod bars;
mod figure;
pub(crate) mod intervals;
mod look;
mod path;
pub(crate) mod plan;
mod plot;
pub(crate) mod scale;
mod series;
pub(crate) mod strip;

pub use axes::Axis;
pub use bars::{Bar, BarGroup, bar_figure};
pub use figure::{Anchor, Figure, Frame};
pub use look::{Look, STYLE};
pub use plot::Plot;
pub use scale::{Scale, Tick, extent};
pub use series::{Corners, Series};
