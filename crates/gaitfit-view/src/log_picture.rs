//! A picture of a log: a panel a joint with its target and its measured position over time; as one SVG, or as a page whose
//! panels stand below one another on a phone.

use crate::ReportError;
use crate::chart::{Anchor, Axis, Corners, Figure, Frame, Look, Plot, Series, extent};
use crate::format::{clean, clean_prose};
use crate::page;
use serde::Serialize;

/// Joints drawn at most; more make no picture anybody reads.
const JOINTS: usize = 64;
/// Points of a line at most.
const POINTS: usize = 480;
/// Size of a panel, user units.
const PANEL: (f64, f64) = (400.0, 176.0);
/// Height of the heading, user units.
const HEADING: f64 = 54.0;

/// Content of the picture. Names are untrusted; positions are in rad, times in s.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogPicture {
    /// Heading, e.g. the log's file name.
    pub title: String,
    /// A line below it, e.g. samples, rate and length.
    pub facts: String,
    /// Sample times, s, ascending.
    pub time_s: Vec<f64>,
    /// In the order to draw them.
    pub joints: Vec<LogJoint>,
    /// Stretches to mark.
    pub marks: Vec<LogMark>,
}

/// One joint over the times of a [`LogPicture`].
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogJoint {
    /// Its name.
    pub name: String,
    /// Whether it slides: its positions are in m.
    pub slides: bool,
    /// Measured position, rad; one a time.
    pub position: Vec<f64>,
    /// Position target, rad, held until the next; one a time, or empty.
    pub target: Vec<f64>,
}

/// A stretch of the log in which something is wrong.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct LogMark {
    /// Names of the joints it is about; empty: all.
    pub joints: Vec<String>,
    /// First and last time, s.
    pub span_s: (f64, f64),
    /// Whether it must be mended, rather than looked at.
    pub error: bool,
}

/// A self-contained SVG document: for each joint its target and its measured position over time, with marked
/// stretches shaded. Three panels a row when the joints are a multiple of three, as legs are, otherwise four; 64
/// joints at most. Long curves keep every peak.
pub fn log_picture_svg(log: &LogPicture) -> String {
    let shown = log.joints.len().min(JOINTS);
    // A leg has three joints in many robots, so rows of three put one leg into each row.
    let columns = if shown.is_multiple_of(3) { 3 } else { 4.min(shown.max(1)) };
    let rows = shown.div_ceil(columns);
    // At least two panels wide, so that title and legend have room above a single joint.
    let width = PANEL.0 * columns.max(2) as f64;
    let mut figure = Figure::new(&format!("Log {}", log.title), width, HEADING + PANEL.1 * rows as f64 + 8.0);
    figure.heading(12.0, 22.0, &clean(&log.title));
    let left_out = match log.joints.len() {
        count if count > JOINTS => format!("; the first {JOINTS} of {count} joints"),
        _ => String::new(),
    };
    let facts = format!("{}{left_out}; position ({}) over time (s)", log.facts, log.unit());
    // Without facts the text would begin with the separator.
    figure.text(12.0, 41.0, Anchor::Start, facts.trim_start_matches("; "));
    // Two entries of about 85 units, in the line of the heading.
    figure.legend(width - 190.0, 22.0, width, &[("measured", Look::color(0)), ("target", Look::color(1))]);
    for (number, joint) in log.joints.iter().take(JOINTS).enumerate() {
        let left = PANEL.0 * (number % columns) as f64;
        let top = HEADING + PANEL.1 * (number / columns) as f64;
        panel(&mut figure, log, joint, left, top);
    }
    figure.standalone()
}

impl LogPicture {
    /// The unit of positions.
    fn unit(&self) -> &'static str {
        if self.joints.iter().any(|joint| joint.slides) { "rad, slides: m" } else { "rad" }
    }
}

/// The page as the template sees it.
#[derive(Serialize)]
struct Page {
    title: String,
    facts: String,
    unit: &'static str,
    panels: Vec<String>,
    /// Joints that are not drawn.
    left_out: usize,
    marked: bool,
}

/// Renders the same as a page: one HTML file that opens offline, with as many panels a row as its window has room for.
///
/// # Errors
/// [`ReportError::Template`] if the embedded template cannot be filled in.
pub fn log_picture_html(log: &LogPicture) -> Result<String, ReportError> {
    let draw = |joint: &LogJoint| {
        let mut figure = Figure::new(&clean(&joint.name), PANEL.0, PANEL.1);
        panel(&mut figure, log, joint, 0.0, 0.0);
        figure.inline()
    };
    let page = Page {
        title: clean(&log.title),
        facts: clean_prose(&log.facts),
        unit: log.unit(),
        panels: log.joints.iter().take(JOINTS).map(draw).collect(),
        left_out: log.joints.len().saturating_sub(JOINTS),
        marked: !log.marks.is_empty(),
    };
    page::render(include_str!("log_picture.html"), page)
}

fn panel(figure: &mut Figure, log: &LogPicture, joint: &LogJoint, left: f64, top: f64) {
    // A panel without samples keeps its axes, so that the joint is not missing from the picture.
    let times = extent(log.time_s.iter().copied()).unwrap_or((0.0, 1.0));
    let values = extent(joint.position.iter().chain(&joint.target).copied()).unwrap_or((-1.0, 1.0));
    // A mark that names no joint is about all of them.
    let about = |mark: &&LogMark| mark.joints.is_empty() || mark.joints.contains(&joint.name);
    let corners = |error: bool| -> Vec<Corners> {
        let marks = log.marks.iter().filter(about).filter(|mark| mark.error == error);
        // Infinite ends are cut at the axes: a mark fills the whole height.
        marks.map(|mark| [mark.span_s, (f64::NEG_INFINITY, f64::INFINITY)]).collect()
    };
    // Errors are drawn above warnings, so that a stretch with both is red.
    let (wrong, doubtful) = (corners(true), corners(false));
    let mut title = clean(&joint.name);
    if let Some(rms) = tracking_rms(joint) {
        let unit = if joint.slides { "m" } else { "rad" };
        title.push_str(&format!(" · {rms:.3} {unit} RMS from target"));
    }
    let plot = Plot {
        x: Axis { range: Some(times), ticks: 6, ..Axis::default() },
        y: Axis { title: &title, range: Some(values), pad: 0.06, ticks: 4, ..Axis::default() },
        series: vec![
            Series::Boxes { look: Look::DOUBTFUL, corners: &doubtful },
            Series::Boxes { look: Look::WRONG, corners: &wrong },
            Series::Step { name: "target", look: Look::color(1), x: &log.time_s, y: &joint.target },
            Series::Line { name: "measured", look: Look::color(0), x: &log.time_s, y: &joint.position },
        ],
        points: POINTS,
    };
    // Numbers stand to the left of a panel, its title above it, and the seconds below.
    let frame = Frame {
        left: left + 56.0,
        top: top + 24.0,
        right: left + PANEL.0 - 12.0,
        bottom: top + PANEL.1 - 24.0,
    };
    figure.plot(&plot, frame);
}

/// RMS of position minus target over the samples that have both; `None` without a target.
fn tracking_rms(joint: &LogJoint) -> Option<f64> {
    let both = joint.position.iter().zip(&joint.target);
    // A gap in either signal gives NaN and is left out.
    let squares: Vec<f64> = both.map(|(q, target)| (q - target).powi(2)).filter(|x| x.is_finite()).collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}
