//! `report.html` of one fit: one file that opens offline and asks the network for nothing.

mod commands;
mod cumulative;
mod data;
pub(crate) mod distributions;
pub(crate) mod held_out;
pub(crate) mod joints;
pub(crate) mod log;
mod page;
pub(crate) mod parameters;
mod runs;
mod scores;
pub(crate) mod sections;
mod signals;
mod standing;
pub(crate) mod traces;
mod validation;

pub use data::{
    Bound, Comparison, ComparisonEntry, Fit, FitReport, OptimizerRun, Parameter, PublishedRange, Score,
    Validation,
};
pub use held_out::{HeldOut, JointDistance};
pub use log::LogSummary;
pub use signals::{JointTrace, Signal, SignalDistribution};

use crate::ReportError;

/// Renders the page as UTF-8 HTML.
///
/// # Errors
/// [`ReportError::Template`] if the embedded template cannot be filled in.
pub fn fit_html(report: &FitReport) -> Result<String, ReportError> {
    crate::page::render(include_str!("fit.html"), page::Page::new(report))
}
