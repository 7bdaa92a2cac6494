//! The page of an evaluated policy: means with their intervals, distributions of errors, drift, and the gait.

mod data;
pub(crate) mod drift;
mod histogram;
mod page;

pub use data::{EvaluationReport, Ground, Histogram, Measure};

use crate::ReportError;

/// Renders the page as UTF-8 HTML: one file that opens offline.
///
/// # Errors
/// [`ReportError::Template`] if the embedded template cannot be filled in.
pub fn evaluation_html(report: &EvaluationReport) -> Result<String, ReportError> {
    crate::page::render(include_str!("evaluation.html"), page::Page::new(report))
}
