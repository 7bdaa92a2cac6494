//! `report.html` of one adaptation: one file that opens offline and asks the network for nothing.

mod adapt;
mod data;
mod joints;
pub(crate) mod parameters;
pub(crate) mod runs;
mod scores;
mod validation;

pub use data::{
    AdaptReport, Bound, Comparison, ComparisonEntry, JointDistribution, JointTrace, OptimizerRun, Parameter,
    PublishedRange, Quantity, Score, Setting, Validation,
};

use crate::page;
use adapt::Page;

/// Why no page came out.
#[derive(Debug, thiserror::Error)]
pub enum ReportError {
    /// The page template and the data disagree: a defect of this crate, not of the data.
    #[error("the report page could not be filled in ({0}); report this with the run's metrics file")]
    Template(#[from] minijinja::Error),
}

/// Renders the page as UTF-8 HTML.
///
/// # Errors
/// [`ReportError::Template`] if the embedded template cannot be filled in.
pub fn render(report: &AdaptReport) -> Result<String, ReportError> {
    page::render(include_str!("adapt.html"), Page::new(report))
}
