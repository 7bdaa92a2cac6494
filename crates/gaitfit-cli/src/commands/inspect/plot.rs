//! A picture of a log: every joint's position and target over time, with what was found.

use crate::exit::Failure;
use gaitfit::files;
use gaitfit_log::{Finding, Severity, Signal, Trajectory};
use gaitfit_model::Model;
use gaitfit_view::log_picture::{LogJoint, LogMark, LogPicture};
use gaitfit_view::{log_picture_html, log_picture_svg};
use std::path::Path;

/// Refuses an ending that is neither a picture's nor a page's.
pub fn check(path: &Path) -> Result<(), Failure> {
    let ending = path.extension().map(|ending| ending.to_string_lossy().to_lowercase());
    match ending.as_deref() {
        Some("svg" | "html") => Ok(()),
        _ => Err(Failure::usage(format!(
            "--plot writes a file whose name ends in .svg (a picture) or .html (a page); {} does not",
            path.display()
        ))),
    }
}

/// Writes the picture: as a page if the name ends so, or else as SVG.
pub fn write(
    log: &Trajectory,
    findings: &[Finding],
    model: Option<&Model>,
    path: &Path,
) -> Result<(), Failure> {
    let picture = picture(log, findings, model);
    let text = match path.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("html")) {
        true => log_picture_html(&picture).map_err(Failure::failed)?,
        false => log_picture_svg(&picture),
    };
    Ok(files::write(path, text.as_bytes())?)
}

fn picture(log: &Trajectory, findings: &[Finding], model: Option<&Model>) -> LogPicture {
    let source = log.source.as_deref().and_then(Path::file_name).map(|name| name.to_string_lossy());
    // By the file's name; its folder may be long and says little.
    let title = match (&source, &log.robot) {
        (Some(source), Some(robot)) => format!("{source} ({robot})"),
        (Some(source), None) => source.to_string(),
        (None, Some(robot)) => robot.clone(),
        (None, None) => "log".to_owned(),
    };
    let joint = |(number, name): (usize, &String)| LogJoint {
        name: name.clone(),
        slides: model.is_some_and(|model| model.slides(name)),
        position: log.column_at(Signal::Position, number).unwrap_or_default(),
        target: log.column_at(Signal::Target, number).unwrap_or_default(),
    };
    // Notes are no faults, so they do not colour the picture.
    let mark = |finding: &Finding| {
        let span = finding.span.filter(|_| finding.severity > Severity::Note)?;
        Some(LogMark {
            joints: finding.joints.clone(),
            span_s: (span.from_s, span.to_s),
            error: finding.severity == Severity::Error,
        })
    };
    LogPicture {
        title,
        facts: format!("{} samples at {} Hz, {:.2} s", log.len(), log.rate_hz, log.duration()),
        time_s: log.time.clone(),
        joints: log.joints.iter().enumerate().map(joint).collect(),
        marks: findings.iter().filter_map(mark).collect(),
    }
}
