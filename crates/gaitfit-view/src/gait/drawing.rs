//! The gait as one figure: contacts, foot heights, velocities and torque spectra below one another.

use super::{FootTrack, GaitPicture, TorqueSpectrum};
use crate::chart::{Anchor, Axis, Corners, Figure, Frame, Look, Plot, Series, extent};
use crate::format::fixed;

/// Max number of points of a line.
const POINTS: usize = 700;
/// Max number of feet.
const FEET: usize = 12;
/// Max number of joint groups: as many as there are colours.
const GROUPS: usize = 8;

/// Width of the figure, user units.
const WIDTH: f64 = 960.0;
/// Left end of the axes; numbers and names of feet stand beside it.
const LEFT: f64 = 56.0;
/// Room at the right for duty factors.
const RIGHT: f64 = 880.0;
/// Height of a foot's row of contacts.
const ROW: f64 = 17.0;
/// Where legends begin, beside the titles.
const LEGEND: f64 = 220.0;

/// Foot contacts, foot heights, commanded and measured velocity over time, and torque by frequency. Parts without
/// data are left out.
pub(super) fn draw(gait: &GaitPicture) -> Figure {
    let label = "Foot contacts, foot heights, velocities and torque spectra";
    let mut figure = Figure::new(label, WIDTH, 40.0);
    let mut top = 8.0;
    if let Some(times) = extent(gait.time_s.iter().copied()) {
        top = contacts(&mut figure, gait, times, top);
        top = heights(&mut figure, gait, times, top);
        top = velocities(&mut figure, gait, times, top);
    }
    top = spectra(&mut figure, &gait.spectra, top);
    figure.set_height(top.max(40.0));
    figure
}

fn frame(top: f64, height: f64) -> Frame {
    Frame { left: LEFT, top, right: RIGHT, bottom: top + height }
}

/// Bars where feet touch the ground; returns where the next part begins.
fn contacts(figure: &mut Figure, gait: &GaitPicture, times: (f64, f64), top: f64) -> f64 {
    let feet: Vec<&FootTrack> = gait.feet.iter().filter(|f| !f.contact.is_empty()).take(FEET).collect();
    if feet.is_empty() {
        return top;
    }
    figure.text(12.0, top + 10.0, Anchor::Start, "foot contacts");
    figure.text(WIDTH - 2.0, top + 10.0, Anchor::End, "on the ground");
    let area = frame(top + 18.0, ROW * feet.len() as f64);
    // Rows are counted upwards from the axis.
    let height = |row: usize| {
        let middle = (feet.len() - row) as f64 - 0.5;
        // Three quarters of the row's height; the rest separates the feet.
        (middle - 0.38, middle + 0.38)
    };
    // A pale track under each row; infinite ends are cut at the axes.
    let tracks: Vec<Corners> =
        (0..feet.len()).map(|row| [(f64::NEG_INFINITY, f64::INFINITY), height(row)]).collect();
    // The time of about a pixel: nobody sees a shorter gap.
    let shortest = (times.1 - times.0) / (RIGHT - LEFT);
    let stretches: Vec<Vec<Corners>> = feet
        .iter()
        .enumerate()
        .map(|(row, foot)| {
            let on = on_ground(&foot.contact, &gait.time_s, shortest);
            on.into_iter().map(|stretch| [stretch, height(row)]).collect()
        })
        .collect();
    let bars = stretches.iter().enumerate();
    let bars = bars.map(|(row, corners)| Series::Boxes { look: Look::color(row), corners });
    let plot = Plot {
        x: Axis { range: Some(times), ticks: 0, ..Axis::default() },
        y: Axis { range: Some((0.0, feet.len() as f64)), ticks: 0, ..Axis::default() },
        series: std::iter::once(Series::Boxes { look: Look::CELL, corners: &tracks }).chain(bars).collect(),
        ..Plot::default()
    };
    figure.plot(&plot, area);
    for (row, foot) in feet.iter().enumerate() {
        let base = area.top + ROW * row as f64 + 12.0;
        // The room beside the axis is 50 units wide, and a letter about 6.
        let name: String = foot.name.chars().take(8).collect();
        figure.text(LEFT - 6.0, base, Anchor::End, &name);
        let count = foot.contact.len().min(gait.time_s.len());
        let on = foot.contact[..count].iter().filter(|c| **c).count();
        if count > 0 {
            let share = fixed(100.0 * on as f64 / count as f64, 0);
            figure.text(WIDTH - 2.0, base, Anchor::End, &format!("{share} %"));
        }
    }
    area.bottom + 14.0
}

/// Stretches of time on the ground, s; those that lie closer than `shortest` are one.
fn on_ground(contact: &[bool], time: &[f64], shortest: f64) -> Vec<(f64, f64)> {
    let mut stretches: Vec<(f64, f64)> = Vec::new();
    for (i, at) in time.iter().enumerate().take(contact.len()) {
        if !contact[i] || !at.is_finite() {
            continue;
        }
        // Contact holds until the next sample.
        let next = time.get(i + 1).copied().filter(|t| t.is_finite()).unwrap_or(*at).max(*at);
        match stretches.last_mut() {
            Some(last) if *at <= last.1 + shortest => last.1 = next.max(last.1),
            _ => stretches.push((*at, next)),
        }
    }
    stretches
}

fn heights(figure: &mut Figure, gait: &GaitPicture, times: (f64, f64), top: f64) -> f64 {
    let feet: Vec<&FootTrack> = gait.feet.iter().take(FEET).collect();
    let Some((low, high)) = extent(feet.iter().flat_map(|f| f.height_m.iter().copied())) else {
        return top;
    };
    // Diagonal feet swing together in a trot: dashes let one line show through the other.
    let look = |i: usize| if i < 2 { Look::color(i) } else { Look::color(i).dashed() };
    let line = |(i, foot): (usize, &&'_ FootTrack)| (foot.name.clone(), look(i));
    let entries: Vec<(String, Look)> = feet.iter().enumerate().map(line).collect();
    let plot = Plot {
        x: Axis { range: Some(times), ticks: 0, ..Axis::default() },
        y: Axis {
            title: "foot height (m)",
            // The ground is in view, and a foot that never rises is not blown up.
            range: Some((low.min(0.0), high.max(0.01))),
            pad: 0.04,
            ticks: 3,
            ..Axis::default()
        },
        series: feet
            .iter()
            .zip(&entries)
            .map(|(foot, (name, look))| Series::Line {
                name,
                look: *look,
                x: &gait.time_s,
                y: &foot.height_m,
            })
            .collect(),
        points: POINTS,
    };
    figure.plot(&plot, frame(top + 22.0, 90.0));
    legend(figure, top + 12.0, &entries);
    top + 128.0
}

fn velocities(figure: &mut Figure, gait: &GaitPicture, times: (f64, f64), top: f64) -> f64 {
    let named = ["forward (m/s)", "left (m/s)", "turn (rad/s)"];
    // Command and measurement share a panel, so its axis must hold both.
    let hull = |t: &super::VelocityTrack| extent(t.measured.iter().chain(&t.command).copied());
    let tracks: Vec<_> = gait.velocity.iter().zip(named).filter(|(t, _)| hull(t).is_some()).collect();
    let mut y = top;
    for (i, (track, name)) in tracks.iter().enumerate() {
        let is_last = i + 1 == tracks.len();
        let (low, high) = hull(track).map_or((0.0, 0.0), |(low, high)| (low.min(0.0), high.max(0.0)));
        // A component that hardly moves is not blown up to the height of the panel.
        let middle = (low + high) / 2.0;
        let half = ((high - low) / 2.0).max(0.15);
        // The panels share the time axis, so its numbers stand below the last one alone.
        let (title, ticks) = if is_last { ("time (s)", 10) } else { ("", 0) };
        let plot = Plot {
            x: Axis { title, range: Some(times), ticks, ..Axis::default() },
            y: Axis {
                title: name,
                range: Some((middle - half, middle + half)),
                pad: 0.06,
                ticks: 3,
                ..Axis::default()
            },
            series: vec![
                Series::Line { name: "measured", look: Look::FITTED, x: &gait.time_s, y: &track.measured },
                Series::Line { name: "command", look: Look::NOMINAL, x: &gait.time_s, y: &track.command },
            ],
            points: 2 * POINTS,
        };
        figure.plot(&plot, frame(y + 22.0, 66.0));
        // All panels have the same two lines, so one legend is enough.
        if i == 0 {
            figure.legend(LEGEND, y + 12.0, RIGHT, &[("command", Look::NOMINAL), ("measured", Look::FITTED)]);
        }
        y += if is_last { 136.0 } else { 102.0 };
    }
    y
}

fn spectra(figure: &mut Figure, spectra: &[TorqueSpectrum], top: f64) -> f64 {
    // Zero hertz holds no power and has no place on a logarithmic axis.
    let positive = |s: &TorqueSpectrum| -> (Vec<f64>, Vec<f64>) {
        s.frequency_hz
            .iter()
            .zip(&s.density)
            .filter(|(f, p)| f.is_finite() && **f > 0.0 && p.is_finite() && **p > 0.0)
            .unzip()
    };
    let drawn: Vec<_> = spectra.iter().take(GROUPS).map(|s| (s, positive(s))).collect();
    let frequencies = extent(drawn.iter().flat_map(|(_, (f, _))| f.iter().copied()));
    let powers = extent(drawn.iter().flat_map(|(_, (_, p))| p.iter().copied()));
    let (Some(range), Some((lowest, high))) = (frequencies, powers) else { return top };
    // Five decades tell a peak from what does not matter.
    let low = lowest.max(high * 1e-5);
    // Below that a line runs along the lower edge instead of out of the plot.
    let held: Vec<Vec<f64>> =
        drawn.iter().map(|(_, (_, power))| power.iter().map(|p| p.max(low)).collect()).collect();
    let slides = drawn.iter().any(|(spectrum, _)| spectrum.slides);
    let lines = drawn.iter().zip(&held).enumerate();
    let plot = Plot {
        x: Axis { title: "frequency (Hz)", range: Some(range), log: true, ticks: 9, ..Axis::default() },
        y: Axis {
            title: if slides {
                "joint torque ((N·m)²/Hz, slides: N²/Hz)"
            } else {
                "joint torque ((N·m)²/Hz)"
            },
            // Room above the peak; on a logarithmic axis it is a factor.
            range: Some((low, high * 1.3)),
            log: true,
            ..Axis::default()
        },
        series: lines
            .map(|(i, ((spectrum, (frequency, _)), power))| Series::Line {
                name: &spectrum.group,
                look: Look::color(i),
                x: frequency,
                y: power,
            })
            .collect(),
        points: POINTS,
    };
    figure.plot(&plot, frame(top + 22.0, 150.0));
    let entries: Vec<(String, Look)> =
        drawn.iter().enumerate().map(|(i, (s, _))| (s.group.clone(), Look::color(i))).collect();
    legend(figure, top + 12.0, &entries);
    top + 210.0
}

fn legend(figure: &mut Figure, y: f64, entries: &[(String, Look)]) {
    let shown: Vec<(&str, Look)> = entries.iter().map(|(name, look)| (name.as_str(), *look)).collect();
    figure.legend(LEGEND, y, RIGHT, &shown);
}
