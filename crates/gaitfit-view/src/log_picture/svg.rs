//! The SVG picture: a panel a joint.

use super::{Extent, JOINTS, hull, marked, printable, short_name, tracking_rms, union};
use gaitfit_log::{Finding, Severity, Signal, Trajectory};
use plotters::coord::Shift;
use plotters::prelude::*;

/// Size of a panel and of the heading, pixels.
const PANEL: (u32, u32) = (400, 170);
const HEADING: u32 = 46;
/// Stretches of which a long curve keeps the smallest and the largest sample.
const COLUMNS: usize = 240;

const MEASURED: RGBColor = RGBColor(0x00, 0x3f, 0x7f);
const TARGET: RGBColor = RGBColor(0xf2, 0xa0, 0x3d);
const INK: RGBColor = RGBColor(0x22, 0x22, 0x22);
const FAINT: RGBColor = RGBColor(0xe4, 0xe6, 0xe8);
const ERROR: RGBColor = RGBColor(0xd0, 0x21, 0x1c);
const WARNING: RGBColor = RGBColor(0xe5, 0xb4, 0x00);

type Area<'a> = DrawingArea<SVGBackend<'a>, Shift>;
/// What drawing can fail with; into memory it does not.
type Drawn = Result<(), Box<dyn std::error::Error>>;

/// A self-contained SVG document: for each joint its target and measured position (rad) over time (s), with the
/// stretches shaded that errors (red) and warnings (yellow) of `findings` name. Three panels a row when the
/// joints are a multiple of three, as legs are, otherwise four; 64 joints at most. Curves keep every peak.
/// A trajectory that is malformed or empty gives a picture that says so.
pub fn log_picture_svg(log: &Trajectory, findings: &[Finding]) -> String {
    let problem = match log.validate() {
        Err(error) => Some(error.to_string()),
        Ok(()) if log.is_empty() => Some("no samples".to_owned()),
        Ok(()) => None,
    };
    let shown = log.joints.len().min(JOINTS);
    let columns = if shown.is_multiple_of(3) { 3 } else { 4.min(shown.max(1)) };
    let rows = if problem.is_some() { 0 } else { shown.div_ceil(columns) };
    let size = (PANEL.0 * columns.max(2) as u32, HEADING + PANEL.1 * rows as u32);
    let mut svg = String::new();
    let drawn = draw(&mut svg, size, log, findings, problem, (rows, columns));
    match drawn {
        Ok(()) => svg,
        Err(_) => String::from(r#"<svg xmlns="http://www.w3.org/2000/svg" width="1" height="1"/>"#),
    }
}

fn draw(
    svg: &mut String,
    size: (u32, u32),
    log: &Trajectory,
    findings: &[Finding],
    problem: Option<String>,
    (rows, columns): (usize, usize),
) -> Drawn {
    let root = SVGBackend::with_string(svg, size).into_drawing_area();
    root.fill(&WHITE)?;
    let (head, body) = root.split_vertically(HEADING);
    let text = ("sans-serif", 14).into_font().color(&INK);
    if let Some(problem) = problem {
        head.draw_text(&problem, &text, (12, 14))?;
        root.present()?;
        return Ok(());
    }
    heading(&head, log, size.0 as i32)?;
    for (joint, area) in
        body.split_evenly((rows, columns)).iter().enumerate().take(log.joints.len().min(JOINTS))
    {
        panel(area, log, findings, joint)?;
    }
    root.present()?;
    Ok(())
}

fn heading(area: &Area, log: &Trajectory, width: i32) -> Drawn {
    let source = log.source.as_deref().and_then(|path| path.file_name()).map(|name| name.to_string_lossy());
    let title = match (&source, &log.robot) {
        (Some(source), Some(robot)) => format!("{} ({})", source, short_name(robot)),
        (Some(source), None) => source.to_string(),
        (None, Some(robot)) => short_name(robot),
        (None, None) => "log".to_owned(),
    };
    let title = printable(&title, 60);
    let left_out = match log.joints.len() {
        count if count > JOINTS => format!(", first {JOINTS} of {count} joints"),
        _ => String::new(),
    };
    let facts = format!(
        "{} samples at {} Hz, {:.2} s{left_out}; position, rad, over time, s",
        log.len(),
        log.rate_hz,
        log.duration()
    );
    area.draw_text(&title, &("sans-serif", 16).into_font().style(FontStyle::Bold).color(&INK), (12, 4))?;
    area.draw_text(&facts, &("sans-serif", 13).into_font().color(&INK), (12, 25))?;
    let mut legend = vec![("measured", MEASURED, width - 120)];
    if log.target.is_some() {
        legend.push(("target", TARGET, width - 220));
    }
    for (label, color, x) in legend {
        area.draw(&PathElement::new(vec![(x, 22), (x + 24, 22)], color.stroke_width(3)))?;
        area.draw_text(label, &("sans-serif", 13).into_font().color(&INK), (x + 30, 14))?;
    }
    Ok(())
}

fn panel(area: &Area, log: &Trajectory, findings: &[Finding], joint: usize) -> Drawn {
    let position = log.column_at(Signal::Position, joint).unwrap_or_default();
    let target = log.column_at(Signal::Target, joint);
    let values = union(hull(&position), target.as_deref().and_then(hull));
    let (low, high) = padded(values);
    let (start, end) = padded_time(hull(&log.time));

    let mut caption = short_name(&log.joints[joint]);
    if let Some(rms) = tracking_rms(log, joint) {
        caption.push_str(&format!(" · {rms:.3} rad RMS from target"));
    }
    let mut chart = ChartBuilder::on(area)
        .margin(6)
        .margin_right(14)
        .caption(caption, ("sans-serif", 13).into_font().color(&INK))
        .x_label_area_size(20)
        .y_label_area_size(48)
        .build_cartesian_2d(start..end, low..high)?;
    for (finding, span) in marked(findings, Some(&log.joints[joint])) {
        let color = if finding.severity == Severity::Error { ERROR } else { WARNING };
        let corners = [(span.from_s.clamp(start, end), low), (span.to_s.clamp(start, end), high)];
        chart.draw_series([Rectangle::new(corners, color.mix(0.13).filled())])?;
    }
    chart
        .configure_mesh()
        .light_line_style(TRANSPARENT)
        .bold_line_style(FAINT)
        .axis_style(INK.mix(0.5))
        .x_labels(6)
        .y_labels(5)
        .x_label_formatter(&|time| label(*time, end - start))
        .y_label_formatter(&|value| label(*value, high - low))
        .label_style(("sans-serif", 11).into_font().color(&INK))
        .draw()?;
    let curves = target.map(|target| (target, TARGET, 3)).into_iter().chain([(position, MEASURED, 1)]);
    for (values, color, width) in curves {
        for mut stretch in polylines(&log.time, &values) {
            // Pixels far outside overflow in the drawing library.
            stretch.iter_mut().for_each(|(x, y)| (*x, *y) = (x.clamp(start, end), y.clamp(low, high)));
            chart.draw_series([PathElement::new(stretch, color.stroke_width(width))])?;
        }
    }
    Ok(())
}

/// The curve as lines, broken where values are missing. A long curve keeps the smallest and the largest sample of
/// each of `COLUMNS` stretches, at their own times.
fn polylines(time: &[f64], values: &[f64]) -> Vec<Vec<(f64, f64)>> {
    let stretches = if values.len() <= 2 * COLUMNS { values.len() } else { COLUMNS };
    let mut lines: Vec<Vec<(f64, f64)>> = vec![Vec::new()];
    for stretch in 0..stretches {
        let samples = stretch * values.len() / stretches..(stretch + 1) * values.len() / stretches;
        let finite = || samples.clone().filter(|&i| values[i].is_finite());
        let low = finite().min_by(|&a, &b| values[a].total_cmp(&values[b]));
        let high = finite().max_by(|&a, &b| values[a].total_cmp(&values[b]));
        match (low, high, lines.last_mut()) {
            (Some(low), Some(high), Some(line)) => {
                let (first, second) = (low.min(high), low.max(high));
                line.push((time[first], values[first]));
                if second != first {
                    line.push((time[second], values[second]));
                }
            }
            _ => lines.push(Vec::new()),
        }
    }
    // A point alone is no line.
    lines.retain(|line| line.len() > 1);
    lines
}

/// Largest magnitude drawn; beyond it differences and axis ticks overflow.
const LARGEST: f64 = 1e9;

fn padded(values: Extent) -> (f64, f64) {
    let (low, high) = values.unwrap_or((-1.0, 1.0));
    let (low, high) = (low.clamp(-LARGEST, LARGEST), high.clamp(-LARGEST, LARGEST));
    let pad = (0.06 * (high - low)).max(1e-3).max(1e-6 * high.abs().max(low.abs()));
    (low - pad, high + pad)
}

fn padded_time(time: Extent) -> (f64, f64) {
    let (start, end) = time.unwrap_or((0.0, 1.0));
    let (start, end) = (start.clamp(-1e12, 1e12), end.clamp(-1e12, 1e12));
    (start, end.max(start + 1e-3 + 1e-9 * start.abs()))
}

/// A tick label with as many decimals as an axis of this length needs.
fn label(value: f64, length: f64) -> String {
    let decimals = (1.0 - length.log10().floor()).clamp(0.0, 6.0) as usize;
    let text = format!("{value:.decimals$}");
    let text = if text.contains('.') { text.trim_end_matches('0').trim_end_matches('.') } else { &text };
    if text == "-0" { "0".to_owned() } else { text.replace('-', "−") }
}
