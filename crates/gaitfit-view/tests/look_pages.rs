//! Pages to look at logs and runs: a log beside its simulation, a log alone, and runs side by side. They are whole, closed to
//! the network, and safe against hostile names and strange numbers.
#![allow(clippy::unwrap_used)] // A test that panics has failed.

use crate::go2;
use crate::page;

use gaitfit_view::fit::JointTrace;
use gaitfit_view::log_picture::{LogJoint, LogMark, LogPicture};
use gaitfit_view::runs::{Curve, Fit, Parameter, Run, RunsReport, Training};
use gaitfit_view::{Replay, SideBySide, log_picture_html, runs_html, side_by_side_html};
use page::{HOSTILE, assert_finite, assert_harmless, assert_offline, parse, text};

fn beside(name: &str) -> SideBySide {
    let time_s: Vec<f64> = (0..100).map(|row| 0.02 * f64::from(row)).collect();
    let curve = |late: f64| time_s.iter().map(|time| (3.0 * (time - late)).sin()).collect::<Vec<f64>>();
    let trace = |joint: usize| JointTrace {
        joint: format!("{name}{joint}"),
        file: name.into(),
        measured: curve(0.02),
        fitted: curve(0.03),
        nominal: curve(0.1),
        target: curve(0.0),
        time_s: time_s.clone(),
        slides: false,
    };
    SideBySide {
        title: name.into(),
        robot: name.into(),
        headline: name.into(),
        replay: Replay {
            dt: go2::DT,
            robots: vec![go2::trot(name, 100, 0.7), go2::trot("fitted", 100, 1.0)],
            ..Replay::default()
        },
        traces: (0..3).map(trace).collect(),
        aligned: true,
        warnings: vec![name.into()],
        ..SideBySide::default()
    }
}

#[test]
fn a_log_stands_beside_its_simulation() {
    let html = side_by_side_html(&beside("walk")).unwrap();
    assert_offline(&html);
    assert_finite(&html);
    let document = parse(&html);
    let panels = document.descendants().filter(|n| n.attribute("data-x").is_some()).count();
    assert_eq!(panels, 6, "positions and errors of three joints");
    let shown = text(&document);
    assert!(shown.contains("robot file → fitted") && shown.contains("walk2"), "{shown}");
    let mut sliding = beside("walk");
    sliding.traces[1].slides = true;
    let html = side_by_side_html(&sliding).unwrap();
    let captions = |end: &str| html.matches(end).count();
    assert_eq!((captions(" m</span>"), captions(" rad</span>")), (1, 2), "errors of slides are in m");
    // Without a simulation there are no errors to draw.
    let mut alone = beside("walk");
    alone.replay.robots.truncate(1);
    for trace in &mut alone.traces {
        trace.fitted.clear();
        trace.nominal.clear();
    }
    let html = side_by_side_html(&alone).unwrap();
    let document = parse(&html);
    assert_eq!(document.descendants().filter(|n| n.attribute("data-x").is_some()).count(), 3);
    assert!(!text(&document).contains("fitted simulator"));
    // A replay that cannot be drawn leaves the curves.
    let broken = SideBySide { replay: Replay::default(), ..beside("walk") };
    let html = side_by_side_html(&broken).unwrap();
    assert!(text(&parse(&html)).contains("The page has no replay") && html.contains("walk1"));
}

fn runs(name: &str) -> RunsReport {
    let parameter = |value: f64, half: Option<f64>| Parameter {
        name: name.into(),
        unit: "N·m".into(),
        value,
        interval: half.map(|half| [value - half, value + half]),
    };
    let fit = |value: f64| Fit {
        name: name.into(),
        cost_name: name.into(),
        cost: vec![1.0, 0.1],
        parameters: vec![parameter(value, Some(0.01))],
    };
    let curve = Curve {
        name: name.into(),
        unit: name.into(),
        iteration: (0..50).map(f64::from).collect(),
        value: (0..50).map(|k| 1.0 / f64::from(k + 1)).collect(),
    };
    let training = Training { name: name.into(), curves: vec![curve] };
    RunsReport {
        title: name.into(),
        runs: vec![Run { name: name.into(), report: "a/report.html".into(), ..Run::default() }],
        fits: vec![fit(0.2), fit(0.3), Fit { parameters: vec![parameter(f64::NAN, None)], ..fit(0.0) }],
        trainings: vec![training.clone(), training],
        ..RunsReport::default()
    }
}

#[test]
fn runs_stand_side_by_side() {
    let html = runs_html(&runs("friction")).unwrap();
    assert_offline(&html);
    assert_finite(&html);
    let shown = text(&parse(&html));
    assert!(shown.contains("0.200 ± 0.010") && shown.contains("differ"), "{shown}");
    assert_finite(&runs_html(&RunsReport::default()).unwrap());
    let mut unknown = runs("friction");
    let parameters = unknown.fits.iter_mut().flat_map(|fit| &mut fit.parameters);
    parameters.for_each(|one| one.interval = Some([f64::NAN; 2]));
    let html = runs_html(&unknown).unwrap();
    assert!(!html.contains(">agree<"), "nobody knows where these intervals lie");
    assert_finite(&html);
    let many = RunsReport { fits: vec![runs("x").fits[0].clone(); 30], ..runs("x") };
    assert!(runs_html(&many).unwrap().len() < 200_000, "the last eight fits alone");
}

fn picture(name: &str) -> LogPicture {
    let joint = LogJoint {
        name: name.into(),
        slides: false,
        position: vec![0.0, 0.1, f64::NAN, 0.3],
        target: vec![0.1; 4],
    };
    LogPicture {
        title: name.into(),
        facts: name.into(),
        time_s: vec![0.0, 0.1, 0.2, 0.3],
        // More than a picture draws.
        joints: vec![joint; 70],
        marks: vec![LogMark { joints: vec![name.into()], span_s: (0.1, f64::NAN), error: true }],
    }
}

#[test]
fn a_logs_joints_are_a_page() {
    let html = log_picture_html(&picture("FL_hip")).unwrap();
    assert_offline(&html);
    assert_eq!(html.matches("<figure>").count(), 64);
    assert!(text(&parse(&html)).contains("6 more joints are not drawn"));
}

#[test]
fn hostile_names_stay_text_here_too() {
    assert_harmless(&side_by_side_html(&beside(HOSTILE)).unwrap(), &side_by_side_html(&beside("a")).unwrap());
    assert_harmless(&runs_html(&runs(HOSTILE)).unwrap(), &runs_html(&runs("a")).unwrap());
    assert_harmless(&log_picture_html(&picture(HOSTILE)).unwrap(), &log_picture_html(&picture("a")).unwrap());
}
