//! A log drawn: small multiples of target and measured position as SVG, and one line a joint for terminals.

mod svg;
mod text;

pub use svg::log_picture_svg;
pub use text::log_picture_text;

use gaitfit_log::{Finding, Signal, Span, Trajectory};

/// Joints drawn at most; more make no picture anybody reads.
const JOINTS: usize = 64;
/// Longest joint name printed, characters.
const NAME: usize = 24;

/// Smallest and largest value; `None` where there is no finite one.
type Extent = Option<(f64, f64)>;

/// Smallest and largest finite value.
fn hull(values: &[f64]) -> Extent {
    values.iter().filter(|value| value.is_finite()).fold(None, |hull, &value| {
        Some(hull.map_or((value, value), |(low, high): (f64, f64)| (low.min(value), high.max(value))))
    })
}

/// The smallest interval that holds both.
fn union(a: Extent, b: Extent) -> Extent {
    match (a, b) {
        (Some((low_a, high_a)), Some((low_b, high_b))) => Some((low_a.min(low_b), high_a.max(high_b))),
        (a, b) => a.or(b),
    }
}

/// RMS of position minus target over the samples that have both; `None` without a target.
fn tracking_rms(log: &Trajectory, joint: usize) -> Option<f64> {
    let position = log.column_at(Signal::Position, joint)?;
    let target = log.column_at(Signal::Target, joint)?;
    let squares: Vec<f64> = position
        .iter()
        .zip(&target)
        .map(|(q, target)| (q - target).powi(2))
        .filter(|square| square.is_finite())
        .collect();
    (!squares.is_empty()).then(|| (squares.iter().sum::<f64>() / squares.len() as f64).sqrt())
}

/// Stretches that errors and warnings of `findings` mark; of `joint` or of the whole robot.
fn marked<'a>(findings: &'a [Finding], joint: Option<&'a str>) -> impl Iterator<Item = (&'a Finding, Span)> {
    findings
        .iter()
        .filter(|finding| finding.severity > gaitfit_log::Severity::Note)
        .filter(move |finding| match joint {
            Some(name) => finding.joints.is_empty() || finding.joints.iter().any(|joint| joint == name),
            None => true,
        })
        .filter_map(|finding| Some((finding, finding.span?)))
}

/// A name from a file for print: neither terminals nor XML take control characters, and it is not too long.
fn short_name(name: &str) -> String {
    printable(name, NAME)
}

/// At most `longest` characters of `text`, those replaced that terminals or XML do not take.
fn printable(text: &str, longest: usize) -> String {
    let strange = |c: char| c.is_control() || ('\u{fffe}'..='\u{ffff}').contains(&c);
    let clean = text.chars().map(|c| if strange(c) { '\u{fffd}' } else { c });
    if text.chars().count() <= longest {
        return clean.collect();
    }
    clean.take(longest - 1).chain(['…']).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "tests")]
mod tests {
    use super::*;
    use gaitfit_log::{FindingKind, Gains, Severity};

    /// Joints that ramp from 0 to 1 rad over 100 samples, the second one downwards, targets 0.5 above.
    fn ramps(joints: usize) -> Trajectory {
        let position: Vec<f64> = (0..100)
            .flat_map(|i| (0..joints).map(move |joint| (if joint == 1 { 99 - i } else { i }) as f64 / 99.0))
            .collect();
        Trajectory {
            source: Some("folder/run <1>.csv".into()),
            robot: Some("go2 & co".into()),
            joints: (0..joints).map(|joint| format!("joint_{joint}")).collect(),
            time: (0..100).map(|i| 3.0 + i as f64 / 100.0).collect(),
            rate_hz: 100.0,
            velocity: vec![0.0; position.len()],
            target: Some(position.iter().map(|q| q + 0.5).collect()),
            position,
            action: None,
            command: None,
            base: None,
            gains: Some(Gains { kp: vec![1.0; joints], kd: vec![1.0; joints] }),
            fell: false,
        }
    }

    fn stuck(joint: &str) -> Finding {
        Finding {
            kind: FindingKind::Stuck,
            severity: Severity::Error,
            joints: vec![joint.to_owned()],
            span: Some(Span { start: 50, end: 100, from_s: 3.5, to_s: 3.99 }),
            message: String::new(),
        }
    }

    #[test]
    fn the_text_picture_of_a_ramp() {
        // 8 characters for the name, 33 for the numbers, 8 for the curve: two of its 16 dot columns a level in
        // every four.
        let text = log_picture_text(&ramps(2), &[stuck("joint_0")], 49);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(lines[1], "joint_0 ⣀⣀⠤⠤⠒⠒⠉⠉       0.000 … 1.000        0.500");
        assert_eq!(lines[2], "joint_1 ⠉⠉⠒⠒⠤⠤⣀⣀       0.000 … 1.000        0.500");
        assert_eq!(lines[4], "            !!!!  ! see findings");
        assert_eq!(lines.len(), 5);
    }

    #[test]
    fn no_line_is_wider_than_asked_and_every_joint_has_one() {
        let mut log = ramps(3);
        log.position[4] = f64::NAN;
        log.position[7] = f64::INFINITY;
        log.position.iter_mut().skip(2).step_by(3).for_each(|q| *q = f64::NAN);
        log.joints[0] = "a\nname\u{1b}[31m\u{ffff} that is much longer than anybody wants".into();
        for width in (0..60).chain([79, 80, 81, 149]) {
            let text = log_picture_text(&log, &[stuck("joint_1")], width);
            assert!(text.lines().all(|line| line.chars().count() <= width.max(1)), "{width}\n{text}");
            assert!(
                text.lines().count() >= 4 && roxmltree::Document::parse(&log_picture_svg(&log, &[])).is_ok()
            );
            assert!(!text.contains('\u{1b}'), "{width}\n{text}");
        }
        assert!(log_picture_text(&log, &[], 120).contains("no finite value"));
    }

    #[test]
    fn a_resting_joint_is_flat() {
        let mut log = ramps(1);
        log.position.iter_mut().enumerate().for_each(|(i, q)| *q = 1.0 + 1e-4 * (i as f64 * 1.7).sin());
        let text = log_picture_text(&log, &[], 60);
        let row: Vec<char> = text.lines().nth(1).unwrap().chars().skip(8).take(19).collect();
        // Only dots of the two middle rows.
        assert!(row.len() == 19 && row.iter().all(|c| (*c as u32 - 0x2800) & !0x36 == 0), "{text}");
    }

    #[test]
    fn the_svg_is_well_formed_with_a_panel_a_joint() {
        let log = ramps(4);
        let svg = log_picture_svg(&log, &[stuck("joint_2")]);
        let document = roxmltree::Document::parse(&svg).unwrap();
        let count = |tag: &str, color: &str| {
            let has = |node: &roxmltree::Node| {
                node.attributes().any(|a| a.value().eq_ignore_ascii_case(color)) && node.has_tag_name(tag)
            };
            document.descendants().filter(has).count()
        };
        // A curve a joint and one in the legend.
        assert_eq!((count("polyline", "#003F7F"), count("polyline", "#F2A03D")), (5, 5));
        assert_eq!(count("rect", "#D0211C"), 1, "one joint is marked");
        for name in
            ["joint_3 · 0.500 rad RMS from target", "run <1>.csv (go2 & co)", "100 samples at 100 Hz, 0.99 s"]
        {
            let shown =
                document.descendants().any(|node| node.text().is_some_and(|text| text.contains(name)));
            assert!(shown, "{name}");
        }
        assert!(!svg.contains("href"), "nothing is loaded from elsewhere");
    }

    #[test]
    fn long_curves_keep_peaks_and_gaps() {
        let mut log = ramps(1);
        let samples = 20_000;
        log.time = (0..samples).map(|i| i as f64 / 1000.0).collect();
        log.rate_hz = 1000.0;
        log.position = vec![0.0; samples];
        log.position[7777] = 40.0;
        log.position[12_000..13_000].fill(f64::NAN);
        log.velocity = vec![0.0; samples];
        log.target = None;
        let svg = log_picture_svg(&log, &[]);
        assert!(svg.len() < 40_000, "{}", svg.len());
        let document = roxmltree::Document::parse(&svg).unwrap();
        let curves: Vec<_> = document
            .descendants()
            .filter(|node| node.attribute("points").is_some_and(|p| p.len() > 400))
            .collect();
        assert_eq!(curves.len(), 2, "the gap divides the curve");
        let heights = curves.iter().flat_map(|curve| curve.attribute("points").unwrap().split_whitespace());
        let mut heights: Vec<f64> = heights.map(|p| p.split_once(',').unwrap().1.parse().unwrap()).collect();
        heights.sort_by(f64::total_cmp);
        assert!(heights[0] < heights[1] - 50.0, "the peak of one sample is drawn: {:?}", &heights[..3]);
    }

    #[test]
    fn strange_logs_still_give_pictures() {
        let mut cases = vec![ramps(1), ramps(100)];
        let empty = ramps(2).slice(0..0).unwrap();
        cases.extend([empty, ramps(2).slice(0..1).unwrap()]);
        for value in [f64::NAN, f64::INFINITY, f64::MAX, f64::MIN, 5e-324, -0.0] {
            let mut log = ramps(2);
            log.position.fill(value);
            log.target.as_mut().unwrap()[3] = -value;
            cases.push(log);
        }
        let mut malformed = ramps(2);
        malformed.position.pop();
        let mut backward = ramps(2);
        backward.time[50] = -1e300;
        cases.extend([malformed, backward]);
        for (case, log) in cases.iter().enumerate() {
            let svg = log_picture_svg(log, &[stuck("joint_0")]);
            let document = roxmltree::Document::parse(&svg).unwrap();
            assert!(document.root_element().has_tag_name("svg") || svg.contains("<svg"), "case {case}");
            assert!(
                document.descendants().filter(|node| node.has_tag_name("text")).count() > 0,
                "case {case}"
            );
            assert!(!svg.contains("NaN") && svg.len() < 2_000_000, "case {case}");
            assert!(!log_picture_text(log, &[stuck("joint_0")], 80).is_empty());
        }
    }
}
