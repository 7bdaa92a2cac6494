//! The page of a whole loop: it says the numbers it was given, whatever is missing, strange, hostile or long.
#![allow(clippy::unwrap_used)] // A test that panics has failed.

use crate::invented_loop;
use crate::page;

use gaitfit_view::fit::{Fit, LogSummary, OptimizerRun, Parameter, SignalDistribution};
use gaitfit_view::loop_report::{DriftTrials, LoopReport, Round, Tracking};
use gaitfit_view::training::SeedCurve;
use gaitfit_view::{Doubt, DoubtKind, Link, Replay, Setting, loop_html};
use gaitfit_view::{Drift, Estimate};
use page::{HOSTILE, assert_finite, assert_harmless, assert_offline, parse, text};

fn sections(html: &str) -> Vec<String> {
    let document = parse(html);
    let named =
        document.descendants().filter(|n| n.has_tag_name("section") && n.attribute("class").is_none());
    named.filter_map(|n| n.attribute("id").map(str::to_string)).collect()
}

#[test]
fn the_page_holds_the_numbers_given() {
    let report = invented_loop::two_rounds(3, 40, 30);
    let html = loop_html(&report).unwrap();
    assert_offline(&html);
    assert_finite(&html);
    let document = parse(&html);
    let shown = text(&document);
    for expected in [
        // The headline, and how much less: 0.1216 of 0.2143 m/s.
        "0.214",
        "0.122",
        "43 % less",
        // Every policy on every simulator with its interval; falls in percent.
        "0.1189 ± 0.0014",
        "0.2764 ± 0.0039",
        "5.490 ± 0.022",
        "3.84 ± 0.46",
        "10\u{a0}000",
        "on adapted",
        // Drift: the first command's error before.
        "−0.336 ± 0.021",
        "1 of 60",
        // A parameter: value, the longer side of its interval, interval, truth.
        "0.197 ± 0.010",
        "0.1882 … 0.2074",
        "not identified by these logs",
        "6 of 7",
        // Costs.
        "nominal simulator: 1.480",
        "0.07242",
        // What not to trust.
        "clock jumps by 0.3 s",
        // The log.
        "3 falls cut out, 6.40\u{a0}s with their margins",
        "backward walking with a turn to the right",
        "W₁ 0.47 → 0.038 rad/s",
        "The fit gave 39 % less tracking error than domain randomisation.",
        "−0.0927 ± 0.0021",
        "−3.23 ± 0.41",
        "0.0121 against 0.0118 ± 0.0009",
        "explained variance",
        "the cost stopped falling",
        "Predicts walks that were not fitted 5.3 times better than the robot file.",
    ] {
        assert!(shown.contains(expected), "{expected} is missing");
    }
    let wanted = [
        "result",
        "parameters",
        "tracking",
        "drift",
        "motion",
        "convergence",
        "heldout",
        "distributions",
        "log",
        "learning",
        "settings",
    ];
    assert_eq!(sections(&html), wanted);
    let hrefs: Vec<&str> = document.descendants().filter_map(|n| n.attribute("href")).collect();
    for (href, id) in hrefs.iter().zip(wanted) {
        assert_eq!(href.trim_start_matches('#'), id);
    }
    assert!(hrefs.contains(&"round-2/policy.safetensors"));
    let ids: Vec<&str> = document.descendants().filter_map(|n| n.attribute("id")).collect();
    let unique: std::collections::HashSet<&&str> = ids.iter().collect();
    assert_eq!(ids.len(), unique.len(), "an id occurs twice");
    let figures = document.descendants().filter(|n| n.has_tag_name("figure")).count();
    // Four measures and a plan; in each round two convergence charts, 36 distributions, the commands, and six curves.
    assert_eq!(figures, 4 + 1 + 2 * (2 + 36 + 1 + 6));
}

#[test]
fn where_it_was_measured_comes_first() {
    let mut report = invented_loop::two_rounds(1, 5, 5);
    let shown = text(&parse(&loop_html(&report).unwrap()));
    let place =
        shown.find("before → after, measured on the robot (MuJoCo): 10000 trajectories of 4 s").unwrap();
    assert!(place < shown.find("Linear-velocity error").unwrap());
    report.doubts = vec![
        Doubt::new(DoubtKind::WorseThanNominal, "worse"),
        Doubt::new(DoubtKind::RobotAbsent, "They walked in the fitted simulator."),
    ];
    let html = loop_html(&report).unwrap();
    let document = parse(&html);
    let banner = document.descendants().find(|n| n.attribute("class") == Some("doubt")).unwrap();
    assert!(banner.descendants().any(|n| n.text() == Some("Not measured on the robot")), "the first line");
    assert!(!html.contains("class=\"good\""), "nothing is praised without the robot");
}

#[test]
fn the_truth_stands_beside_what_was_found_and_settings_are_folded() {
    let html = loop_html(&invented_loop::two_rounds(1, 5, 5)).unwrap();
    let document = parse(&html);
    let heads = document.descendants().filter(|n| n.has_tag_name("tr")).find_map(|row| {
        let cells: Vec<_> = row.children().filter_map(|cell| cell.text()).collect();
        cells.contains(&"Truth").then_some(cells)
    });
    assert_eq!(heads.unwrap()[..3], ["Parameter", "Value", "Truth"]);
    assert!(text(&document).contains("true 0.2"), "also beside the picture");
    let within = |n: &roxmltree::Node| n.ancestors().any(|a| a.has_tag_name("details"));
    let setting = document.descendants().find(|n| n.text() == Some("collect.trajectories")).unwrap();
    assert!(within(&setting));
}

#[test]
fn the_replay_plays_within_the_page() {
    let html = loop_html(&invented_loop::two_rounds(1, 5, 40)).unwrap();
    let document = parse(&html);
    let packed = document.descendants().find(|n| n.attribute("id") == Some("replay")).unwrap();
    let data: serde_json::Value = serde_json::from_str(packed.text().unwrap()).unwrap();
    assert_eq!(data["robots"].as_array().unwrap().len(), 2);
    assert_eq!(data["robots"][1]["name"], "after");
    // One clock for all robots.
    for id in ["play", "time", "clock"] {
        assert_eq!(document.descendants().filter(|n| n.attribute("id") == Some(id)).count(), 1);
    }
    let player = document.descendants().find(|n| n.attribute("id") == Some("player")).unwrap();
    assert_eq!(player.attribute("class"), Some("embedded"), "it leaves keys and wheel to the page");
}

#[test]
fn every_section_may_be_missing() {
    let html = loop_html(&LoopReport::default()).unwrap();
    assert_finite(&html);
    assert_eq!(sections(&html), ["result", "settings"]);

    let full = invented_loop::two_rounds(2, 10, 5);
    let only = LoopReport { tracking: full.tracking[..1].to_vec(), ..LoopReport::default() };
    let html = loop_html(&only).unwrap();
    assert_eq!(sections(&html), ["result", "tracking", "settings"]);
    let shown = text(&parse(&html));
    assert!(
        shown.contains("before, measured on target") && !shown.contains("% less"),
        "one policy has nothing beside it"
    );
    let only = LoopReport { drift: full.drift.clone(), ..LoopReport::default() };
    assert_eq!(sections(&loop_html(&only).unwrap()), ["result", "drift", "settings"]);

    let of = |round: Round| loop_html(&LoopReport { rounds: vec![round], ..LoopReport::default() }).unwrap();
    let first = &full.rounds[0];
    let html = of(Round { fits: first.fits.clone(), ..Round::default() });
    assert_eq!(sections(&html), ["result", "parameters", "convergence", "settings"]);
    assert!(text(&parse(&html)).contains("Round 1"), "a round without a name has its number");
    let html = of(Round { distributions: first.distributions.clone(), ..Round::default() });
    assert_eq!(sections(&html), ["result", "distributions", "settings"]);
    let html = of(Round { log: first.log.clone(), ..Round::default() });
    assert_eq!(sections(&html), ["result", "log", "settings"]);
    let html = of(Round { fine_tuning: first.fine_tuning.clone(), ..Round::default() });
    assert_eq!(sections(&html), ["result", "learning", "settings"]);
}

#[test]
fn a_replay_that_cannot_be_drawn_costs_only_itself() {
    let mut report = invented_loop::two_rounds(1, 5, 5);
    report.replay.as_mut().unwrap().robots[1].frames.clear();
    let html = loop_html(&report).unwrap();
    assert!(!sections(&html).contains(&"motion".to_string()));
    let shown = text(&parse(&html));
    assert!(shown.contains("The page has no replay: replay of robot \"after\": has 0 frames"), "{shown}");
    report.replay = Some(Replay::default());
    assert!(text(&parse(&loop_html(&report).unwrap())).contains("The page has no replay"));
}

#[test]
fn doubts_come_before_anything_good() {
    let mut report = invented_loop::two_rounds(1, 5, 5);
    assert!(loop_html(&report).unwrap().contains(r#"<p class="good">43 % less</p>"#));
    report.doubts = vec![Doubt::new(DoubtKind::OwnSimulatorOnly, "")];
    let html = loop_html(&report).unwrap();
    let shown = text(&parse(&html));
    assert!(shown.find("own simulator only") < shown.find("0.214"), "{shown}");
    report.doubts.push(Doubt::new(DoubtKind::NotConverged, "The fit of round 2 ended early."));
    let html = loop_html(&report).unwrap();
    let shown = text(&parse(&html));
    assert!(shown.find("Not converged") < shown.find("own simulator only"), "the worst first");
    assert!(!html.contains(r#"class="good""#), "nothing is praised");
}

#[test]
fn strange_numbers_leave_gaps() {
    let mut report = invented_loop::two_rounds(2, 10, 5);
    report.wall_seconds = f64::NAN;
    report.tracking[0].linear_velocity_error = Estimate { mean: f64::NAN, ci95: f64::INFINITY };
    report.tracking[1].reward = Estimate { mean: f64::INFINITY, ci95: f64::NAN };
    report.tracking.push(Tracking::default());
    report.drift[0].trials[0].path[3] = [f64::NAN, 1e308];
    report.drift[0].trials[1].error = [f64::NAN; 3];
    report.drift[1].trials[2].intended = vec![[f64::INFINITY; 2]];
    report.drift[1].trials.push(Drift::default());
    report.drift.push(DriftTrials::default());
    let round = &mut report.rounds[0];
    round.fits.push(Fit::default());
    let fit = &mut round.fits[0];
    fit.nominal_cost = f64::INFINITY;
    fit.runs[0].best = vec![f64::NAN, f64::INFINITY, 0.0, -1.0];
    fit.runs.push(OptimizerRun::default());
    fit.parameters[0].value = f64::NAN;
    fit.parameters[1].interval = Some([f64::NEG_INFINITY, f64::NAN]);
    fit.parameters[2].interval = Some([-1e308, 1e308]);
    fit.parameters[3].truth = Some(f64::NAN);
    fit.parameters.push(Parameter::default());
    round.distributions[0].log = vec![f64::NAN; 5];
    round.distributions[1].nominal = vec![-1e308, f64::INFINITY, 1e308];
    round.distributions[2].fitted = vec![1.0];
    round.distributions.push(SignalDistribution::default());
    round.fine_tuning[0].progress[0].values = vec![f64::NAN; 150];
    round.fine_tuning.push(SeedCurve::default());
    let log = round.log.as_mut().unwrap();
    (log.seconds, log.cut_seconds, log.trajectories) = (f64::NAN, f64::INFINITY, 0);
    log.commands[0] = [f64::NAN, 1e308, 0.0];
    log.commands[1] = [1e308; 3];
    report.rounds.push(Round { log: Some(LogSummary::default()), ..Round::default() });
    report.rounds.push(Round::default());
    assert_finite(&loop_html(&report).unwrap());
    // All the log's distributions unknown, and a range that is none.
    let round = &mut report.rounds[1];
    round.distributions.iter_mut().for_each(|d| d.log.clear());
    round.log.as_mut().unwrap().command_range = [[f64::NAN, 1.0], [2.0, 1.0], [0.0, 0.0]];
    assert_finite(&loop_html(&report).unwrap());
}

#[test]
fn hostile_names_stay_text() {
    let hostile = || HOSTILE.to_string();
    let mut report = invented_loop::two_rounds(2, 5, 5);
    let honest = loop_html(&report).unwrap();
    for text in [&mut report.title, &mut report.robot, &mut report.created] {
        *text = hostile();
    }
    (report.before, report.target) = (hostile(), hostile());
    report.warnings = vec![hostile()];
    report.facts = vec![Setting { name: hostile(), value: hostile() }];
    (report.settings, report.versions) = (report.facts.clone(), report.facts.clone());
    report.links = vec![Link { text: hostile(), path: "javascript:alert(1)".into() }];
    (report.tracking[0].policy, report.tracking[0].simulator) = (hostile(), hostile());
    (report.drift[0].policy, report.drift[0].simulator) = (hostile(), hostile());
    report.drift[0].trials[0].name = hostile();
    let replay = report.replay.as_mut().unwrap();
    (replay.title, replay.note) = (hostile(), hostile());
    (replay.robots[0].name, replay.robots[0].feet[0]) = (hostile(), hostile());
    for round in &mut report.rounds {
        round.name = hostile();
        round.fine_tuning[0].progress[0].name = hostile();
        round.fine_tuning[0].progress[0].unit = hostile();
        round.distributions[0].joint = hostile();
        let fit = &mut round.fits[0];
        (fit.cost_name, fit.runs[0].label) = (hostile(), hostile());
        let parameter = &mut fit.parameters[5];
        (parameter.name, parameter.unit) = (hostile(), hostile());
        let log = round.log.as_mut().unwrap();
        (log.source, log.uncovered) = (hostile(), vec![hostile()]);
    }
    let html = loop_html(&report).unwrap();
    assert_harmless(&html, &honest);
    let document = parse(&html);
    let hrefs: Vec<&str> = document.descendants().filter_map(|n| n.attribute("href")).collect();
    assert!(hrefs.iter().all(|h| h.starts_with('#')), "{hrefs:?}");
}

#[test]
fn long_loops_stay_small_pages() {
    let usual = loop_html(&invented_loop::two_rounds(5, 200, 500)).unwrap();
    assert!(usual.len() < 1_200_000, "{} bytes", usual.len());

    let mut report = invented_loop::two_rounds(1, 3000, 5);
    let frames = &mut report.replay.as_mut().unwrap().robots[0].frames;
    *frames = vec![frames[0].clone(); 20_000];
    let round = &mut report.rounds[0];
    let log = round.log.as_mut().unwrap();
    log.commands =
        (0..20_000).map(|i| [(f64::from(i) * 0.37).sin(), (f64::from(i) * 0.11).cos(), 0.0]).collect();
    log.uncovered = vec!["very long ".repeat(10_000); 1000];
    let fit = &mut round.fits[0];
    fit.runs = vec![fit.runs[0].clone(); 50];
    fit.parameters = vec![fit.parameters[0].clone(); 300];
    round.distributions = vec![round.distributions[0].clone(); 60];
    let long: Vec<[f64; 2]> = (0..5000).map(|i| [f64::from(i), f64::from(i % 7)]).collect();
    report.drift[0].trials[0].path = long.clone();
    report.drift[0].trials[0].intended = long;
    report.drift = vec![report.drift[0].clone(); 100];
    report.tracking = vec![report.tracking[0].clone(); 1000];
    report.differences = vec![report.differences[0].clone(); 100];
    report.rounds = vec![report.rounds[0].clone(); 8];
    let html = loop_html(&report).unwrap();
    assert!(html.len() < 12_000_000, "{} bytes", html.len());
    let document = parse(&html);
    let shown = text(&document);
    for left_out in [
        "100 more are in the run folder",
        "10 more runs",
        "12 more joints",
        "936 more are in the result",
        "36 more differences are in the result",
    ] {
        assert!(shown.contains(left_out), "{left_out}");
    }
    let packed = document.descendants().find(|n| n.attribute("id") == Some("replay")).unwrap();
    let data: serde_json::Value = serde_json::from_str(packed.text().unwrap()).unwrap();
    assert_eq!(data["robots"][0]["frames"], 6000);
}
