//! The gait as one SVG: contacts, foot heights, velocities and torque spectra below one another.

use super::{GaitPicture, TorqueSpectrum};
use crate::charts::panel::{self, Panel};
use crate::charts::path::coordinate;
use crate::charts::scale::{self, Scale};
use crate::format::{escape, fixed};
use std::fmt::Write;

/// Points a line at most, feet and joint groups at most.
const POINTS: usize = 700;
const FEET: usize = 12;
const GROUPS: usize = 8;

const WIDTH: f64 = 960.0;
const LEFT: f64 = 56.0;
/// Room at the right for duty factors.
const RIGHT: f64 = 880.0;
const ROW: f64 = 17.0;

/// Foot contacts, foot heights, commanded and measured velocity over time, and torque by frequency. Colours come
/// from the style sheet of the page it is placed in. Parts without data are left out; nothing at all is an empty
/// string.
pub(crate) fn draw(gait: &GaitPicture) -> String {
    let mut body = String::new();
    let mut top = 8.0;
    if let Some((from, to)) = scale::extent(gait.time_s.iter().copied()) {
        let x = Scale::linear(Some((from, to)), LEFT, RIGHT);
        top = contacts(&mut body, gait, x, top);
        top = heights(&mut body, gait, x, top);
        top = velocities(&mut body, gait, x, top);
    }
    top = spectra(&mut body, &gait.spectra, top);
    if body.is_empty() {
        return body;
    }
    let mut svg = panel::open_svg(WIDTH, top, "Foot contacts, foot heights, velocities and torque spectra");
    svg.push_str(&body);
    svg.push_str("</svg>");
    svg
}

/// Bars where feet touch the ground; returns where the next part begins.
fn contacts(svg: &mut String, gait: &GaitPicture, x: Scale, top: f64) -> f64 {
    let feet: Vec<_> = gait.feet.iter().filter(|f| !f.contact.is_empty()).take(FEET).collect();
    if feet.is_empty() {
        return top;
    }
    let mut y = title(svg, "foot contacts", top);
    let _ = write!(
        svg,
        r#"<text class="t e" x="{}" y="{}">on the ground</text>"#,
        coordinate(WIDTH - 2.0),
        coordinate(top + 10.0)
    );
    for (row, foot) in feet.iter().enumerate() {
        let count = foot.contact.len().min(gait.time_s.len());
        let _ = write!(
            svg,
            r#"<text class="t e" x="{}" y="{}">{}</text>"#,
            coordinate(LEFT - 6.0),
            coordinate(y + 11.0),
            escape(&foot.name)
        );
        let (from, width) = (coordinate(LEFT), coordinate(RIGHT - LEFT));
        let _ = write!(
            svg,
            r#"<rect class="track" x="{from}" y="{}" width="{width}" height="{}"/>"#,
            coordinate(y + 1.0),
            ROW - 4.0
        );
        let bars = bars(&foot.contact[..count], &gait.time_s, x, y + 1.0);
        let _ = write!(svg, r#"<path class="bar{}" d="{bars}"/>"#, row % 8);
        let on = foot.contact[..count].iter().filter(|c| **c).count();
        if count > 0 {
            let share = fixed(100.0 * on as f64 / count as f64, 0);
            let _ = write!(
                svg,
                r#"<text class="t e" x="{}" y="{}">{share} %</text>"#,
                coordinate(WIDTH - 2.0),
                coordinate(y + 11.0)
            );
        }
        y += ROW;
    }
    y + 12.0
}

/// A closed outline a stretch of contact. Stretches that fall within half a unit of the picture are one.
fn bars(contact: &[bool], time: &[f64], x: Scale, y: f64) -> String {
    let mut stretches: Vec<(f64, f64)> = Vec::new();
    for (i, _) in contact.iter().enumerate().filter(|(i, touches)| **touches && time[*i].is_finite()) {
        let next = time.get(i + 1).copied().filter(|t| t.is_finite()).unwrap_or(time[i]);
        let (from, to) = (x.at(time[i]), x.at(next.max(time[i])));
        match stretches.last_mut() {
            Some(last) if from <= last.1 + 0.5 => last.1 = to.max(last.1),
            _ => stretches.push((from, to)),
        }
    }
    stretches.iter().fold(String::new(), |mut d, (from, to)| {
        let (a, b) = (coordinate(*from), coordinate(to.max(from + 0.5)));
        let _ = write!(d, "M{a} {}H{b}v{}H{a}z", coordinate(y), ROW - 4.0);
        d
    })
}

fn heights(svg: &mut String, gait: &GaitPicture, x: Scale, top: f64) -> f64 {
    let feet: Vec<_> = gait.feet.iter().take(FEET).collect();
    let Some((_, high)) = scale::extent(feet.iter().flat_map(|f| f.height_m.iter().copied())) else {
        return top;
    };
    let chart = Panel {
        x,
        y: Scale::linear(Some((0.0, high.max(0.01))), top + 112.0, top + 22.0).padded(0.04),
        left: LEFT,
        right: RIGHT,
        top: top + 22.0,
        bottom: top + 112.0,
        x_title: "",
        y_title: "foot height (m)",
        x_ticks: 10,
        y_ticks: 3,
    };
    chart.open(svg);
    // Diagonal feet swing together in a trot: dashes let one line show through the other.
    let look = |i: usize| format!("c{}{}", i % 8, if i < 2 { "" } else { " over" });
    for (i, foot) in feet.iter().enumerate() {
        chart.series(svg, &foot.name, &look(i), &gait.time_s, &foot.height_m, POINTS);
    }
    panel::close(svg);
    let looks: Vec<String> = (0..feet.len()).map(look).collect();
    let entries: Vec<_> = feet.iter().zip(&looks).map(|(f, look)| (f.name.as_str(), look.as_str())).collect();
    legend(svg, top + 11.0, &entries);
    top + 128.0
}

fn velocities(svg: &mut String, gait: &GaitPicture, x: Scale, top: f64) -> f64 {
    let named = ["forward (m/s)", "left (m/s)", "turn (rad/s)"];
    let mut tracks: Vec<_> = gait.velocity.iter().zip(named).collect();
    tracks.retain(|(t, _)| scale::extent(t.measured.iter().chain(&t.command).copied()).is_some());
    let mut y = top;
    for (i, (track, name)) in tracks.iter().enumerate() {
        let is_last = i + 1 == tracks.len();
        let hull = scale::extent(track.measured.iter().chain(&track.command).copied().chain([0.0]));
        let (low, high) = hull.unwrap_or((0.0, 0.0));
        // A component that hardly moves is not blown up to the height of the panel.
        let middle = (low + high) / 2.0;
        let half = ((high - low) / 2.0).max(0.15);
        let chart = Panel {
            x,
            y: Scale::linear(Some((middle - half, middle + half)), y + 88.0, y + 22.0).padded(0.06),
            left: LEFT,
            right: RIGHT,
            top: y + 22.0,
            bottom: y + 88.0,
            x_title: if is_last { "time (s)" } else { "" },
            y_title: name,
            x_ticks: 10,
            y_ticks: 3,
        };
        chart.open(svg);
        chart.series(svg, "measured", "fitted", &gait.time_s, &track.measured, POINTS);
        chart.series(svg, "command", "nominal", &gait.time_s, &track.command, 2 * POINTS);
        panel::close(svg);
        if i == 0 {
            legend(svg, y + 11.0, &[("command", "nominal"), ("measured", "fitted")]);
        }
        y += if is_last { 136.0 } else { 102.0 };
    }
    y
}

fn spectra(svg: &mut String, spectra: &[TorqueSpectrum], top: f64) -> f64 {
    // Zero hertz holds no power and has no place on a logarithmic axis.
    let positive = |s: &TorqueSpectrum| -> (Vec<f64>, Vec<f64>) {
        s.frequency_hz
            .iter()
            .zip(&s.density)
            .filter(|(f, p)| f.is_finite() && **f > 0.0 && p.is_finite() && **p > 0.0)
            .unzip()
    };
    let drawn: Vec<_> = spectra.iter().take(GROUPS).map(|s| (s, positive(s))).collect();
    let frequencies = scale::extent(drawn.iter().flat_map(|(_, (f, _))| f.iter().copied()));
    let powers = scale::extent(drawn.iter().flat_map(|(_, (_, p))| p.iter().copied()));
    let (Some((slowest, fastest)), Some((_, high))) = (frequencies, powers) else { return top };
    // Five decades tell a peak from what does not matter.
    let low = powers.map_or(0.0, |(low, _)| low.max(high * 1e-5));
    let chart = Panel {
        x: Scale::log(slowest, fastest, LEFT, RIGHT),
        y: Scale::log(low, high * 1.3, top + 172.0, top + 22.0),
        left: LEFT,
        right: RIGHT,
        top: top + 22.0,
        bottom: top + 172.0,
        x_title: "frequency (Hz)",
        y_title: "joint torque ((N·m)²/Hz)",
        x_ticks: 9,
        y_ticks: 5,
    };
    chart.open(svg);
    for (i, (spectrum, (frequency, power))) in drawn.iter().enumerate() {
        let held: Vec<f64> = power.iter().map(|p| p.max(low)).collect();
        chart.series(svg, &spectrum.group, &format!("c{}", i % 8), frequency, &held, POINTS);
    }
    panel::close(svg);
    let looks: Vec<String> = (0..drawn.len()).map(|i| format!("c{}", i % 8)).collect();
    let entries: Vec<_> =
        drawn.iter().zip(&looks).map(|((s, _), l)| (s.group.as_str(), l.as_str())).collect();
    legend(svg, top + 11.0, &entries);
    top + 210.0
}

fn title(svg: &mut String, text: &str, top: f64) -> f64 {
    let _ = write!(svg, r#"<text class="t" x="2" y="{}">{text}</text>"#, coordinate(top + 10.0));
    top + 16.0
}

/// Names beside strokes in the look of their lines.
fn legend(svg: &mut String, y: f64, entries: &[(&str, &str)]) {
    let mut x = 220.0;
    for (name, class) in entries {
        let shown: String = name.chars().take(16).collect();
        let _ = write!(
            svg,
            r#"<path class="k {class}" d="M{} {}h18"/><text class="t" x="{}" y="{}">{}</text>"#,
            coordinate(x),
            coordinate(y - 4.0),
            coordinate(x + 23.0),
            coordinate(y),
            escape(&shown)
        );
        x += 42.0 + 7.0 * shown.chars().count() as f64;
        if x > RIGHT {
            break;
        }
    }
}
