//! `report.html` of a training run: learning curves over several seeds, diagnostics, and the gait that came out.

pub(crate) mod curves;
mod data;
mod page;

pub use data::{SeedCurve, SeedResult, Series, TrainingReport};

use crate::ReportError;

/// Renders the page as UTF-8 HTML: one file that opens offline.
///
/// # Errors
/// [`ReportError::Template`] if the embedded template cannot be filled in.
pub fn training_report(report: &TrainingReport) -> Result<String, ReportError> {
    crate::page::render(include_str!("training.html"), page::Page::new(report))
}
