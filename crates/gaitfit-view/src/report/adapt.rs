//! The page as the template sees it: text and pictures, ready to be placed.

use super::joints::{self, Joints};
use super::parameters::{self, ComparisonTable, Known, ParameterTable};
use super::runs::{self, Runs};
use super::scores::{self, Scores};
use super::validation::{self, ValidationTable};
use super::{AdaptReport, Setting};
use crate::format::{clean, duration};
use crate::page::{lines, settings};
use serde::Serialize;

/// The whole page.
#[derive(Serialize)]
pub(super) struct Page {
    title: String,
    robot: String,
    created: String,
    wall_time: String,
    fit_logs: Vec<String>,
    warnings: Vec<String>,
    scores: Scores,
    parameters: Option<ParameterTable>,
    comparison: Option<ComparisonTable>,
    runs: Option<Runs>,
    joints: Joints,
    validation: Option<ValidationTable>,
    settings: Vec<Setting>,
    versions: Vec<Setting>,
}

impl Page {
    pub fn new(report: &AdaptReport) -> Page {
        Page {
            title: clean(&report.title),
            robot: clean(&report.robot),
            created: clean(&report.created),
            wall_time: duration(report.wall_seconds),
            fit_logs: lines(&report.fit_logs),
            warnings: lines(&report.warnings),
            scores: scores::build(report),
            parameters: parameters::build(&report.parameters.iter().map(Known::from).collect::<Vec<_>>()),
            comparison: report.comparison.as_ref().and_then(parameters::compare),
            runs: runs::build(&report.runs, &report.cost_unit, &[]),
            joints: joints::build(report),
            validation: validation::build(&report.validation),
            settings: settings(&report.settings),
            versions: settings(&report.versions),
        }
    }
}
