//! The page as the template sees it: text and pictures, ready to be placed.

use super::joints::{self, Joints};
use super::parameters::{self, ComparisonTable, ParameterTable};
use super::runs::{self, Runs};
use super::scores::{self, Scores};
use super::validation::{self, ValidationTable};
use super::{AdaptReport, Setting};
use crate::format::{clean, clean_prose, duration};
use serde::Serialize;

/// Settings and warnings listed at most.
const MOST_LINES: usize = 500;

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
    style: &'static str,
    script: &'static str,
}

impl Page {
    pub fn new(report: &AdaptReport) -> Page {
        let names = |list: &[String]| list.iter().take(MOST_LINES).map(|s| clean_prose(s)).collect();
        let settings = |list: &[Setting]| {
            let cleaned = |s: &Setting| Setting { name: clean(&s.name), value: clean_prose(&s.value) };
            list.iter().take(MOST_LINES).map(cleaned).collect()
        };
        Page {
            title: clean(&report.title),
            robot: clean(&report.robot),
            created: clean(&report.created),
            wall_time: duration(report.wall_seconds),
            fit_logs: names(&report.fit_logs),
            warnings: names(&report.warnings),
            scores: scores::build(report),
            parameters: parameters::build(&report.parameters),
            comparison: report.comparison.as_ref().and_then(parameters::compare),
            runs: runs::build(report),
            joints: joints::build(report),
            validation: validation::build(&report.validation),
            settings: settings(&report.settings),
            versions: settings(&report.versions),
            style: include_str!("style.css"),
            script: include_str!("script.js"),
        }
    }
}
