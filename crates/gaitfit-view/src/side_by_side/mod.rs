//! The page of `gaitfit view`: a log and its simulation as robots on one clock, and each joint's curves below, in which a
//! line shows the clock's time. A click on a curve sets the clock.

use crate::fit::traces::{self, MAX_JOINTS, POINT_BUDGET};
use crate::fit::{JointTrace, joints};
use crate::format::{clean, clean_prose, significant};
use crate::page;
use crate::replay::{Motion, Replay};
use crate::{ReportError, Setting};
use serde::Serialize;

/// Curves of a joint: four positions and two residuals.
const CURVES: usize = 6;

/// Content of the page. Names are untrusted.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct SideBySide {
    /// Heading, e.g. the log's file name.
    pub title: String,
    /// Robot name and the file it was read from.
    pub robot: String,
    /// The result in a sentence.
    pub headline: String,
    /// Facts that help to read the page, e.g. rates and lengths.
    pub facts: Vec<Setting>,
    /// The robots. The time of a frame counts from the log's first sample that is shown.
    pub replay: Replay,
    /// Curves of each joint; times count as the replay's.
    pub traces: Vec<JointTrace>,
    /// Whether samples of log and simulation can be compared one by one: then curves have their RMS error.
    pub aligned: bool,
    /// Warnings that the reader must know before trusting the page.
    pub warnings: Vec<String>,
}

#[derive(Serialize)]
struct Page {
    title: String,
    robot: String,
    headline: String,
    facts: Vec<Setting>,
    motion: Motion,
    cards: Vec<Card>,
    /// Joints that are not drawn.
    left_out: usize,
    has_fitted: bool,
    has_nominal: bool,
    has_target: bool,
    aligned: bool,
    warnings: Vec<String>,
    link: &'static str,
    link_style: &'static str,
}

#[derive(Serialize)]
struct Card {
    joint: String,
    before: String,
    after: String,
    unit: &'static str,
    svg: String,
}

/// Renders the page as UTF-8 HTML: one file that opens offline.
///
/// # Errors
/// [`ReportError::Template`] if the embedded template cannot be filled in. A replay that cannot be drawn becomes a warning
/// on the page.
pub fn side_by_side_html(report: &SideBySide) -> Result<String, ReportError> {
    let (motion, problem) = Motion::new(Some(&report.replay));
    let shown = &report.traces[..report.traces.len().min(MAX_JOINTS)];
    // More points than in a fit's page: each joint has one chart, and a reader looks at single samples beside the
    // robot.
    let points = (POINT_BUDGET / (CURVES * shown.len().max(1))).clamp(120, 900);
    let has = |series: fn(&JointTrace) -> &Vec<f64>| report.traces.iter().any(|one| !series(one).is_empty());
    let page = Page {
        title: clean(&report.title),
        robot: clean(&report.robot),
        headline: clean_prose(&report.headline),
        facts: page::settings(&report.facts),
        motion,
        cards: shown.iter().filter_map(|trace| card(trace, points, report.aligned)).collect(),
        left_out: report.traces.len() - shown.len(),
        has_fitted: has(|one| &one.fitted),
        has_nominal: has(|one| &one.nominal),
        has_target: has(|one| &one.target),
        aligned: report.aligned,
        warnings: page::lines(&report.warnings).into_iter().chain(problem).collect(),
        link: include_str!("link.js"),
        link_style: include_str!("link.css"),
    };
    page::render(include_str!("side_by_side.html"), page)
}

fn card(trace: &JointTrace, points: usize, aligned: bool) -> Option<Card> {
    // With the nominal error: here both simulators are looked at, not only the fitted one.
    let size = traces::Size { width: 560.0, height: 300.0, residual: 66.0, nominal_residual: true, points };
    let error = |simulated: &[f64]| {
        let error = joints::root_mean_square(&traces::residual(simulated, &trace.measured));
        // Walks drift apart, and a difference sample by sample would say nothing of them.
        if aligned && error.is_finite() { significant(error, 3) } else { String::new() }
    };
    Some(Card {
        joint: clean(&trace.joint),
        before: error(&trace.nominal),
        after: error(&trace.fitted),
        unit: trace.unit(),
        svg: traces::trace(trace, 0..trace.time_s.len(), &size)?,
    })
}
