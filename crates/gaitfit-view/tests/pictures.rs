//! Pictures that stand alone: `.svg` files of logs and charts.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_view::chart::{Axis, Look, Plot, Series};
use gaitfit_view::log_picture::{LogJoint, LogMark, LogPicture};
use gaitfit_view::log_picture_svg;
use roxmltree::{Document, Node};

/// Joints that ramp from 0 to 1 rad over 100 samples, targets 0.5 above.
fn ramps(joints: usize) -> LogPicture {
    let position: Vec<f64> = (0..100).map(|i| f64::from(i) / 99.0).collect();
    let joint = |number: usize| LogJoint {
        name: format!("joint_{number}"),
        target: position.iter().map(|q| q + 0.5).collect(),
        position: position.clone(),
        slides: number == 1,
    };
    LogPicture {
        title: "run <1>.csv (go2 & co)".into(),
        facts: "100 samples at 100 Hz, 0.99 s".into(),
        time_s: (0..100).map(|i| 3.0 + f64::from(i) / 100.0).collect(),
        joints: (0..joints).map(joint).collect(),
        marks: vec![LogMark { joints: vec!["joint_2".into()], span_s: (3.5, 3.99), error: true }],
    }
}

fn with_class<'a>(document: &'a Document, class: &str) -> Vec<Node<'a, 'a>> {
    document.descendants().filter(|n| n.attribute("class") == Some(class)).collect()
}

/// Positions of a path of straight lines.
fn corners(path: &Node) -> Vec<[f64; 2]> {
    let d = path.attribute("d").unwrap();
    let points = d.split(['M', 'L']).filter(|point| !point.is_empty());
    points
        .map(|p| p.split_once(' ').unwrap())
        .map(|(x, y)| [x.parse().unwrap(), y.parse().unwrap()])
        .collect()
}

#[test]
fn a_log_has_a_panel_a_joint() {
    let svg = log_picture_svg(&ramps(4));
    let document = Document::parse(&svg).unwrap();
    // A curve a joint and one in the legend.
    assert_eq!(with_class(&document, "s c0").len(), 5);
    assert_eq!(with_class(&document, "s c1").len(), 5);
    assert_eq!(with_class(&document, "f wrong").len(), 1, "one joint is marked");
    for name in [
        "joint_1 · 0.500 m RMS from target",
        "joint_3 · 0.500 rad RMS from target",
        "position (rad, slides: m) over time",
        "run <1>.csv (go2 & co)",
        "100 samples at 100 Hz",
    ] {
        assert!(document.descendants().any(|n| n.text().is_some_and(|t| t.contains(name))), "{name}");
    }
    assert!(!svg.contains("href") && !svg.contains("var("), "it needs nothing else");
}

#[test]
fn long_curves_keep_peaks_and_gaps() {
    let mut log = ramps(1);
    let samples = 20_000;
    log.time_s = (0..samples).map(|i| f64::from(i) / 1000.0).collect();
    log.joints[0].target.clear();
    log.joints[0].position = vec![0.0; samples as usize];
    log.joints[0].position[7777] = 40.0;
    log.joints[0].position[12_000..13_000].fill(f64::NAN);
    let svg = log_picture_svg(&log);
    assert!(svg.len() < 40_000, "{}", svg.len());
    let document = Document::parse(&svg).unwrap();
    let curve = with_class(&document, "s c0").into_iter().find(|n| n.has_attribute("data-n")).unwrap();
    assert_eq!(curve.attribute("d").unwrap().matches('M').count(), 2, "the gap divides the curve");
    let mut heights: Vec<f64> = corners(&curve).iter().map(|[_, y]| *y).collect();
    // SVG counts y downwards, so the peak has the smallest y.
    heights.sort_by(f64::total_cmp);
    assert!(heights[0] < heights[1] - 50.0, "the peak of one sample is drawn: {:?}", &heights[..3]);
}

#[test]
fn strange_logs_still_give_pictures() {
    let mut cases = vec![LogPicture::default(), ramps(1), ramps(100)];
    for value in [f64::NAN, f64::INFINITY, f64::MAX, f64::MIN, 5e-324, -0.0] {
        let mut log = ramps(2);
        log.joints[0].position.fill(value);
        log.joints[0].target[3] = -value;
        log.marks[0] = LogMark { span_s: (value, -value), ..LogMark::default() };
        cases.push(log);
    }
    let mut shorter = ramps(2);
    shorter.joints[0].position.pop();
    shorter.time_s[50] = -1e300;
    let mut hostile = ramps(3);
    hostile.title = "</style><script>\u{1b}[31m\u{0}".into();
    hostile.joints[0].name = "a\nname\u{1b}[31m\u{ffff}<script>".repeat(20);
    cases.extend([shorter, hostile]);
    for (case, log) in cases.iter().enumerate() {
        let svg = log_picture_svg(log);
        let document = Document::parse(&svg).unwrap();
        assert!(document.root_element().has_tag_name("svg"), "case {case}");
        assert!(!svg.contains("NaN") && !svg.contains("inf") && svg.len() < 2_000_000, "case {case}");
        assert!(!svg.contains("<script") && svg.chars().all(|c| c == '\n' || !c.is_control()), "case {case}");
    }
}

#[test]
fn every_series_lies_where_its_numbers_are() {
    let (x, y) = ([0.0, 1.0, 2.0, 4.0], [0.0, 1.0, f64::NAN, 4.0]);
    let (low, high) = ([0.0, 0.5, 1.0, 1.0], [1.0, 1.0, 2.0, 3.0]);
    let boxes = [[(1.0, 2.0), (f64::NEG_INFINITY, f64::INFINITY)]];
    let plot = Plot {
        x: Axis { range: Some((0.0, 4.0)), ..Axis::default() },
        y: Axis { range: Some((0.0, 4.0)), ..Axis::default() },
        series: vec![
            Series::Line { name: "a", look: Look::color(0), x: &x, y: &y },
            Series::Step { name: "b", look: Look::color(1), x: &x, y: &low },
            Series::Points { look: Look::color(2), x: &x, y: &y, radius: 2.0, ring: false },
            Series::Stairs { look: Look::color(3), edges: &x, heights: &[1.0, 2.0, 3.0], filled: true },
            Series::Band { look: Look::color(4), x: &x, low: &low, high: &high },
            Series::Boxes { look: Look::color(5), corners: &boxes },
            Series::Rule { look: Look::LIMIT, at: 3.0, upright: false },
        ],
        ..Plot::default()
    };
    // 54 units at the left and 10 at the right, 10 above and 20 below: 100 units a step of one, both ways.
    let svg = plot.figure("all", 464.0, 430.0).unwrap().standalone();
    let document = Document::parse(&svg).unwrap();
    let path = |class: &str| with_class(&document, class)[0].attribute("d").unwrap().to_string();
    assert_eq!(path("s c0"), "M54 410L154 310M454 10", "the pen is lifted where a value is not known");
    assert_eq!(path("s c1"), "M54 410L154 410L154 360L254 360L254 310L454 310");
    assert_eq!(with_class(&document, "f c2").len(), 3, "one point is not known");
    assert_eq!(path("f c3"), "M54 410V310H154V210H254V110H454V410");
    assert_eq!(path("f c4"), "M54 310L154 310L254 210L454 110L454 310L254 310L154 360L54 410Z");
    assert_eq!(path("f c5"), "M154 410H254V10H154Z");
    assert_eq!(path("s limit"), "M54 110H454");
    assert!(Plot::default().figure("nothing", 100.0, 100.0).is_none());
}
