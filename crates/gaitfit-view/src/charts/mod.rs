//! One chart kind a file; each returns inline SVG whose colours come from the page's style sheet.
//!
//! Charts with axes have a fixed shape and scale with the page; bars and intervals place their marks in percent of
//! the width, so that they stretch without stretching their text.

pub(crate) mod bars;
pub(crate) mod cumulative;
pub(crate) mod curves;
pub(crate) mod distribution;
pub(crate) mod histogram;
pub(crate) mod intervals;
pub(crate) mod panel;
pub(crate) mod path;
pub(crate) mod plan;
pub(crate) mod scale;
pub(crate) mod traces;

/// A position in percent of the width.
fn percent(x: f64) -> String {
    format!("{}%", path::coordinate(x))
}
