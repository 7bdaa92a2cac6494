//! The terminal picture: a braille row a joint.

use super::{Extent, JOINTS, hull, marked, short_name, tracking_rms};
use gaitfit_log::{Finding, Signal, Trajectory};

/// Dots of a braille character: two columns of four, the bits of U+2800 from the top down.
const DOTS: [[u32; 4]; 2] = [[0x01, 0x02, 0x04, 0x40], [0x08, 0x10, 0x20, 0x80]];
/// Characters for the numbers behind a row, and the least for the row itself.
const NUMBERS: usize = 33;
const CURVE: usize = 8;
/// Least height of a row, rad.
const LEAST_RANGE: f64 = 0.02;

/// Positions over time for a terminal `width` characters wide (at least 1): for each joint its name, the curve in
/// braille from its smallest to its largest value (but at least 0.02 rad high), that range (rad), and the RMS distance from the target (rad).
/// A last row marks the stretches that errors and warnings of `findings` name. No line is wider than `width`;
/// where it is narrow, numbers and then names give way.
pub fn log_picture_text(log: &Trajectory, findings: &[Finding], width: usize) -> String {
    let width = width.max(1);
    let shown = log.joints.len().min(JOINTS);
    let names: Vec<String> = log.joints[..shown].iter().map(|name| short_name(name)).collect();
    let longest = names.iter().map(|name| name.chars().count()).max().unwrap_or(0) + 1;
    let name_width = if longest + CURVE <= width { longest } else { 0 };
    let numbers = name_width + CURVE + NUMBERS <= width;
    let curve = width - name_width - if numbers { NUMBERS } else { 0 };

    let mut lines = Vec::with_capacity(shown + 3);
    if numbers {
        lines.push(format!("{:1$}{2:>25}{3:>8}", "", name_width + curve, "position, rad", "error"));
    }
    for (joint, name) in names.iter().enumerate() {
        let column = log.column_at(Signal::Position, joint).unwrap_or_default();
        let mut line = if name_width > 0 { format!("{name:name_width$}") } else { String::new() };
        line.push_str(&braille(&extents(&column, 2 * curve), hull(&column)));
        if numbers {
            line.push_str(&match hull(&column) {
                Some((low, high)) => format!("  {:>10} … {:<10}", number(low), number(high)),
                None => format!("{:25}", "  no finite value"),
            });
            line.push_str(&match tracking_rms(log, joint) {
                Some(rms) => format!("{:>8}", number(rms)),
                None => " ".repeat(8),
            });
        }
        lines.push(line.trim_end().to_owned());
    }
    if log.joints.len() > shown {
        lines.push(cut(&format!("… and {} more joints", log.joints.len() - shown), width));
    }
    lines.push(cut(&format!("{:name_width$}{}", "", time_axis(log, curve)), width));
    if let Some(marks) = marks(log, findings, curve) {
        lines.push(format!("{:name_width$}{marks}", ""));
        if numbers {
            let last = lines.len() - 1;
            lines[last].push_str("  ! see findings");
        }
    }
    lines.into_iter().map(|line| cut(&line, width) + "\n").collect()
}

/// Extents of `values` in `columns` equal stretches of samples. With fewer samples than columns, columns repeat.
fn extents(values: &[f64], columns: usize) -> Vec<Extent> {
    (0..columns)
        .map(|column| {
            let from = column * values.len() / columns;
            let to = ((column + 1) * values.len() / columns).max(from + 1).min(values.len());
            values.get(from..to).and_then(hull)
        })
        .collect()
}

/// Two columns of dots a character, each filled from the smallest to the largest value of its samples.
fn braille(columns: &[Extent], range: Extent) -> String {
    let Some((low, high)) = range else { return " ".repeat(columns.len() / 2) };
    // Encoder noise of a resting joint is not to look like motion.
    let slack = (0.5 * LEAST_RANGE - (0.5 * high - 0.5 * low)).max(0.0);
    let (low, high) = (low - slack, high + slack);
    let level = |value: f64| -> usize {
        // Halves, because the difference of extreme values overflows.
        let share = (0.5 * value - 0.5 * low) / (0.5 * high - 0.5 * low);
        // 3: the bottom row of dots.
        3 - ((share * 4.0) as usize).min(3)
    };
    columns
        .chunks(2)
        .map(|pair| {
            let mut bits = 0x2800;
            for (column, dots) in pair.iter().zip(DOTS) {
                if let Some((low, high)) = column {
                    (level(*high)..=level(*low)).for_each(|row| bits |= dots[row]);
                }
            }
            char::from_u32(bits).unwrap_or(' ')
        })
        .collect()
}

fn time_axis(log: &Trajectory, curve: usize) -> String {
    let end = |time: Option<&f64>| time.map_or(String::new(), |time| format!("{time:.2} s"));
    let (first, last) = (end(log.time.first()), end(log.time.last()));
    match curve.checked_sub(first.chars().count() + last.chars().count()) {
        Some(gap) if gap > 0 => format!("{first}{}{last}", " ".repeat(gap)),
        _ => cut(&first, curve),
    }
}

/// `!` under every character whose samples a finding marks; `None` when none is marked.
fn marks(log: &Trajectory, findings: &[Finding], curve: usize) -> Option<String> {
    let samples = log.len().max(1);
    let mut row = vec![' '; curve];
    for (_, span) in marked(findings, None) {
        let from = (span.start * curve / samples).min(curve - 1);
        let to = (span.end * curve).div_ceil(samples).clamp(from + 1, curve);
        row[from..to].fill('!');
    }
    row.contains(&'!').then(|| row.into_iter().collect())
}

/// A number in at most ten characters.
fn number(value: f64) -> String {
    if value == 0.0 || (1e-3..1e4).contains(&value.abs()) {
        format!("{value:.3}")
    } else {
        format!("{value:.2e}")
    }
}

fn cut(line: &str, width: usize) -> String {
    line.chars().take(width).collect()
}
