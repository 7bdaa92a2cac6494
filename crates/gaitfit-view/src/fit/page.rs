//! The page as the template sees it: text and pictures, ready to be placed.

use super::FitReport;
use super::distributions::{self, DistributionGroup};
use super::held_out::{self, HeldOutView};
use super::joints::{self, Traces};
use super::log::{self, LogView};
use super::parameters::{self, ComparisonTable};
use super::scores::{self, Scores};
use super::sections::{self, FitView};
use super::validation::{self, ValidationTable};
use crate::format::{clean, duration};
use crate::page::{ShownDoubt, doubts, is_severe, lines, settings};
use crate::{Doubt, DoubtKind, Setting};
use serde::Serialize;

/// Comparisons shown at most.
const MAX_COMPARISONS: usize = 6;

/// The whole page.
#[derive(Serialize)]
pub(super) struct Page {
    title: String,
    robot: String,
    created: String,
    wall_time: String,
    doubts: Vec<ShownDoubt>,
    fit_logs: Vec<String>,
    warnings: Vec<String>,
    scores: Scores,
    fits: Vec<FitView>,
    has_parameters: bool,
    has_runs: bool,
    comparisons: Vec<ComparisonTable>,
    traces: Traces,
    distributions: Vec<DistributionGroup>,
    log: Option<LogView>,
    validation: Option<ValidationTable>,
    held_out: Option<HeldOutView>,
    settings: Vec<Setting>,
    versions: Vec<Setting>,
}

impl Page {
    pub fn new(report: &FitReport) -> Page {
        let said = all_doubts(report);
        let fits = sections::build(&report.fits);
        Page {
            title: clean(&report.title),
            robot: clean(&report.robot),
            created: clean(&report.created),
            wall_time: duration(report.wall_seconds),
            doubts: doubts(&said),
            fit_logs: lines(&report.fit_logs),
            warnings: lines(&report.warnings),
            scores: scores::build(report, is_severe(&said)),
            has_parameters: fits.iter().any(|fit| fit.parameters.is_some()),
            has_runs: fits.iter().any(|fit| fit.runs.is_some()),
            fits,
            comparisons: report
                .comparisons
                .iter()
                .take(MAX_COMPARISONS)
                .filter_map(parameters::compare)
                .collect(),
            traces: joints::build(&report.traces),
            distributions: distributions::build(&report.distributions),
            log: report.log.as_ref().map(log::view),
            validation: validation::build(&report.validation),
            held_out: report.held_out.as_ref().map(held_out::view),
            settings: settings(&report.settings),
            versions: settings(&report.versions),
        }
    }
}

/// The caller's doubts, and that the fit is worse than nothing where the numbers say so.
fn all_doubts(report: &FitReport) -> Vec<Doubt> {
    let mut doubts = report.doubts.clone();
    let known = doubts.iter().any(|doubt| doubt.kind == DoubtKind::WorseThanNominal);
    // The caller's own words win: it knows more than the numbers of the page.
    if !known && let Some(text) = scores::worse_than_nominal(report) {
        doubts.push(Doubt::new(DoubtKind::WorseThanNominal, text));
    }
    doubts
}
