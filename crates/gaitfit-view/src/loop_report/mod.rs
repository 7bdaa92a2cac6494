//! `report.html` of a whole loop: what the robot's log changed in the simulator, and the policy trained there beside
//! the one it came from.

mod data;
mod drift;
mod headline;
mod names;
mod page;
mod policies;
mod rounds;
mod tracking;

pub use crate::fit::{HeldOut, JointDistance};
pub use data::{Difference, DriftTrials, LoopReport, Round, Tracking};
pub use names::plain as plain_names;

use crate::ReportError;

/// Renders the page as UTF-8 HTML: one file that opens offline, its replay included.
///
/// # Errors
/// [`ReportError::Template`] if the embedded template cannot be filled in.
pub fn loop_html(report: &LoopReport) -> Result<String, ReportError> {
    let page = crate::page::render(include_str!("loop.html"), page::Page::new(report))?;
    Ok(names::plain(&page, &report.after))
}
