//! The page as a reader's browser gets it: well formed, closed to the network, safe against hostile names, whole
//! whatever is missing, and bounded in size.
#![allow(clippy::unwrap_used)] // A test that panics has failed.

use gaitfit_view::fit::{
    Bound, Comparison, ComparisonEntry, Fit, JointTrace, LogSummary, OptimizerRun, Parameter, PublishedRange,
    Score, Signal, SignalDistribution, Validation,
};
use gaitfit_view::{Doubt, DoubtKind, FitReport, Setting, fit_html as render};

use crate::page;
use page::{HOSTILE, assert_finite, assert_harmless, assert_offline, parse, text};

fn wave(count: usize, phase: f64) -> Vec<f64> {
    (0..count).map(|i| (i as f64 * 0.013 + phase).sin()).collect()
}

/// A report of `joints` joints with every section filled.
fn full(joints: usize, generations: usize) -> FitReport {
    let names: Vec<String> = (0..joints).map(|j| format!("joint_{j}")).collect();
    let trace = |name: &String| JointTrace {
        joint: name.clone(),
        file: "run_6.csv".into(),
        time_s: (0..4700).map(|i| i as f64 * 0.005).collect(),
        measured: wave(4700, 0.0),
        fitted: wave(4700, 0.01),
        nominal: wave(4700, 0.3),
        target: wave(4700, 0.5),
        slides: false,
    };
    let distribution = |name: &String, signal| {
        let (measured, nominal, fitted) = (wave(900, 0.0), wave(800, 0.3), wave(700, 0.01));
        SignalDistribution::from_samples(name, signal, &measured, &nominal, &fitted)
    };
    let parameter = |i: usize| Parameter {
        name: format!("armature[{i}]"),
        unit: ["kg·m²", "N·m", "s"][i % 3].into(),
        value: 0.02 + 0.001 * i as f64,
        lower: 0.0,
        upper: 0.5,
        start: 0.0,
        spread: 0.0012,
        per_run: vec![0.019, 0.021],
        at_bound: (i == 3).then_some(Bound::Lower),
        published: Some(PublishedRange { lower: 0.01, upper: 0.03, source: "GO2".into() }),
        identified: Some(i != 4),
        interval: Some([0.015, 0.025]),
        truth: None,
    };
    let score = |name: &str, rmse: f64| Score {
        name: name.into(),
        cost: rmse * 10.0,
        rmse_fit_rad: rmse,
        rmse_validation_rad: rmse,
    };
    let run = |seed: usize| OptimizerRun {
        label: format!("seed {seed}"),
        best_cost: 0.3,
        best: (0..generations).map(|g| 0.3 + 1.0 / (g + 1) as f64).collect(),
        mean: (0..generations).map(|g| 0.4 + 2.0 / (g + 1) as f64).collect(),
        sigma: (0..generations).map(|g| 1.0 / (g + 1) as f64).collect(),
    };
    FitReport {
        title: "full".into(),
        robot: "Go2".into(),
        created: "2026-01-01".into(),
        wall_seconds: 41.0,
        doubts: Vec::new(),
        converged: Some(true),
        held_out: None,
        fit_logs: vec!["run_0.csv".into()],
        log: None,
        fits: vec![Fit {
            cost_name: "MatchO".into(),
            parameters: (0..14).map(parameter).collect(),
            runs: (0..5).map(run).collect(),
            ..Fit::default()
        }],
        fitted: score("fitted", 0.0048),
        nominal: score("nominal", 0.0678),
        baselines: vec![score("echo of the target", 0.0794), score("best pure delay", 0.0426)],
        validation: vec![Validation {
            file: "run_6.csv".into(),
            rmse_rad: 0.0048,
            nominal_rmse_rad: 0.0678,
            rmse_per_joint: names.iter().map(|n| (n.clone(), 0.0048)).collect(),
            ..Validation::default()
        }],
        comparisons: vec![Comparison {
            first: "MatchO".into(),
            second: "Wass".into(),
            entries: vec![ComparisonEntry {
                name: "delay".into(),
                agrees: Some(false),
                ..Default::default()
            }],
            reasons: vec!["no time axis".into()],
        }],
        distributions: names
            .iter()
            .flat_map(|n| [distribution(n, Signal::Position), distribution(n, Signal::Velocity)])
            .collect(),
        traces: names.iter().map(trace).collect(),
        warnings: vec!["one warning".into()],
        settings: vec![Setting { name: "cost".into(), value: "MatchO".into() }],
        versions: vec![Setting { name: "gaitfit".into(), value: "0.1.0".into() }],
    }
}

#[test]
fn a_full_page_is_well_formed_and_says_the_result() {
    let page = render(&full(12, 200)).unwrap();
    assert!(page.starts_with("<!DOCTYPE html>"));
    let document = parse(&page);
    let shown = text(&document);
    for expected in [
        "0.0678",
        "0.00480",
        "best pure delay",
        "0.0794",
        "1 of 14",
        "at the lower bound",
        "not identified by these logs",
        "0.0200",
        "0.0050",
        "one warning",
        "no time axis",
    ] {
        assert!(shown.contains(expected), "{expected} is missing");
    }
    let ids: Vec<&str> = document.descendants().filter_map(|n| n.attribute("id")).collect();
    let unique: std::collections::HashSet<&&str> = ids.iter().collect();
    assert_eq!(ids.len(), unique.len(), "an id occurs twice");
    let figures = document.descendants().filter(|n| n.has_tag_name("figure")).count();
    // Two convergence charts; a whole and a close trace and two distributions a joint.
    assert_eq!(figures, 2 + 12 * 4);
    assert!(page.len() < 3_000_000, "{} bytes", page.len());
}

#[test]
fn errors_of_slides_are_in_metres() {
    let mut report = full(2, 5);
    report.traces.iter_mut().for_each(|trace| trace.slides = true);
    report.distributions.iter_mut().for_each(|one| one.slides = true);
    let page = render(&report).unwrap();
    let shown = text(&parse(&page));
    assert!(shown.contains("validation logs (RMS, m)") && !page.contains(" rad<"), "{shown}");
}

#[test]
fn sections_without_data_are_left_out() {
    let page = render(&FitReport::default()).unwrap();
    let document = parse(&page);
    let sections: Vec<&str> = document
        .descendants()
        .filter(|n| n.has_tag_name("section"))
        .filter_map(|n| n.attribute("id"))
        .collect();
    assert_eq!(sections, ["result", "settings"]);
    let shown = text(&document);
    assert!(shown.contains('–') && !shown.contains("NaN"), "{shown}");
    let links = document.descendants().filter_map(|n| n.attribute("href")).map(|l| l.trim_start_matches('#'));
    assert_eq!(links.collect::<Vec<_>>(), sections);
}

#[test]
fn nothing_is_fetched() {
    let page = render(&full(3, 20)).unwrap();
    assert_offline(&page);
    let document = parse(&page);
    assert!(document.descendants().filter_map(|n| n.attribute("href")).all(|link| link.starts_with('#')));
}

#[test]
fn hostile_names_stay_text() {
    let hostile = HOSTILE;
    let mut report = full(2, 5);
    let honest = render(&report).unwrap();
    for name in [&mut report.title, &mut report.robot, &mut report.created, &mut report.fits[0].cost_name] {
        *name = hostile.into();
    }
    report.fit_logs = vec![hostile.into()];
    report.warnings = vec![hostile.into()];
    report.settings = vec![Setting { name: hostile.into(), value: hostile.into() }];
    report.versions = report.settings.clone();
    report.fitted.name = hostile.into();
    report.baselines[0].name = hostile.into();
    for parameter in &mut report.fits[0].parameters {
        (parameter.name, parameter.unit) = (hostile.into(), hostile.into());
        parameter.published.as_mut().unwrap().source = hostile.into();
    }
    report.fits[0].runs[0].label = hostile.into();
    report.validation[0].file = hostile.into();
    report.validation[0].rmse_per_joint[0].0 = hostile.into();
    let comparison = &mut report.comparisons[0];
    (comparison.first, comparison.second) = (hostile.into(), hostile.into());
    comparison.reasons = vec![hostile.into()];
    comparison.entries[0].name = hostile.into();
    report.traces[0].joint = hostile.into();
    report.traces[0].file = hostile.into();
    report.distributions[0].joint = hostile.into();

    let page = render(&report).unwrap();
    assert_harmless(&page, &honest);
    assert_eq!(honest.matches("<script").count(), 1);
}

#[test]
fn unknown_and_extreme_numbers_are_printed_sensibly() {
    let mut report = full(2, 5);
    report.fitted.rmse_validation_rad = f64::NAN;
    report.fits[0].runs.truncate(1);
    report.fits[0].runs[0].best = vec![f64::INFINITY, f64::NAN, 0.5, -1.0];
    report.fits[0].parameters = [1e-9, 1e9, 0.0, f64::NAN, f64::INFINITY, -1e300, 1e308]
        .map(|value| Parameter { name: "p".into(), unit: "N·m".into(), value, ..Parameter::default() })
        .to_vec();
    report.fits[0].parameters[0].lower = f64::NEG_INFINITY;
    report.traces[0].measured[100] = f64::NAN;
    report.traces[0].fitted = vec![f64::INFINITY; 4700];
    report.traces[1].measured.truncate(3);
    report.traces[1].time_s[5] = f64::NAN;
    report.distributions[0].log[1] = f64::NAN;
    report.distributions[1].nominal.truncate(2);
    report.fits[0].parameters[1].interval = Some([f64::NAN, f64::INFINITY]);
    report.fits[0].nominal_cost = f64::INFINITY;
    report.validation[0].rmse_per_joint[0].1 = f64::NAN;
    report.validation.push(Validation::default());

    let page = render(&report).unwrap();
    let document = parse(&page);
    let shown = text(&document);
    for expected in ["1.000\u{a0}×\u{a0}10⁻⁹", "1.000\u{a0}×\u{a0}10⁹", "–", "on the logs that the fit used"]
    {
        assert!(shown.contains(expected), "{expected} is missing");
    }
    assert_finite(&page);
}

#[test]
fn large_reports_stay_small_pages() {
    let mut report = full(40, 10_000);
    report.fits[0].parameters = vec![report.fits[0].parameters[0].clone(); 1164];
    for name in report.traces.iter_mut().map(|t| &mut t.joint) {
        *name = "very_long_".repeat(1000);
    }
    let page = render(&report).unwrap();
    parse(&page);
    assert!(page.len() < 5_000_000, "{} bytes", page.len());
    assert!(page.contains("964 more are in the run folder"));
}

/// What a reader sees from the top of the result down.
fn result_text(page: &str) -> String {
    let document = parse(page);
    let section = document.descendants().find(|n| n.attribute("id") == Some("result")).unwrap();
    let texts = section.descendants().filter(|n| n.is_text()).filter_map(|n| n.text());
    texts.map(str::trim).filter(|text| !text.is_empty()).collect::<Vec<_>>().join(" ")
}

#[test]
fn doubts_come_before_anything_good() {
    let mut report = full(2, 5);
    report.doubts = vec![
        Doubt::new(DoubtKind::OwnSimulatorOnly, ""),
        Doubt::new(DoubtKind::NotConverged, "The step size is still 0.4 after 60 generations."),
    ];
    let page = render(&report).unwrap();
    let shown = result_text(&page);
    assert!(shown.starts_with("Not converged The step size is still 0.4"), "{shown}");
    let own = shown.find("Measured in gaitfit's own simulator only").unwrap();
    assert!(own < shown.find("0.0678").unwrap(), "{shown}");
    assert!(page.contains(r#"class="verdicts doubted""#), "no green ticks beside a doubt");
    // Without any, the result comes first.
    report.doubts.clear();
    let page = render(&report).unwrap();
    assert!(result_text(&page).starts_with("The search converged") && page.contains(r#"class="verdicts""#));
}

#[test]
fn a_fit_worse_than_the_nominal_robot_says_so_itself() {
    let mut report = full(2, 5);
    report.fitted.rmse_validation_rad = 0.0701;
    let shown = result_text(&render(&report).unwrap());
    assert!(shown.starts_with("Worse than the nominal robot"), "{shown}");
    assert!(shown.contains("0.0701 rad after the fit and 0.0678 rad before it"), "{shown}");
    // The caller's own words are not doubled.
    report.doubts = vec![Doubt::new(DoubtKind::WorseThanNominal, "So it is.")];
    let shown = result_text(&render(&report).unwrap());
    assert_eq!(shown.matches("Worse than the nominal robot").count(), 1, "{shown}");
}

#[test]
fn a_walking_fit_is_the_same_page() {
    let clamped = full(2, 5);
    let fit = |cost: &str| Fit {
        cost_name: cost.into(),
        nominal_cost: 1.52,
        fitted_cost: 0.0721,
        ..clamped.fits[0].clone()
    };
    let report = FitReport {
        log: Some(LogSummary {
            source: "64 logs".into(),
            trajectories: 64,
            seconds: 256.0,
            falls: 3,
            commands: vec![[0.1, 0.2, 0.3]],
            uncovered: vec!["backward with a left turn".into()],
            ..LogSummary::default()
        }),
        fits: vec![fit("Wass"), fit("MatchS(1)")],
        distributions: clamped.distributions,
        ..FitReport::default()
    };
    let page = render(&report).unwrap();
    let document = parse(&page);
    let sections: Vec<&str> = document
        .descendants()
        .filter(|n| n.has_tag_name("section"))
        .filter_map(|n| n.attribute("id"))
        .collect();
    assert_eq!(sections, ["result", "parameters", "convergence", "distributions", "log", "settings"]);
    let shown = text(&document);
    for expected in [
        "1.52",
        "The cost Wass that the fit minimises",
        "4.7 % of the nominal simulator's cost",
        "Cost MatchS(1)",
        "13 of 14",
        "3 falls cut out",
        "backward with a left turn",
        "64, 4.27\u{a0}min",
    ] {
        assert!(shown.contains(expected), "{expected} is missing");
    }
    assert!(!shown.contains("RMS error of the joint positions"));
}

#[test]
fn control_characters_in_names_do_not_reach_the_page() {
    let evil = "a\u{1b}[31mb\u{7}\u{85}\u{9b}c<script>d\r\ne";
    let mut report = full(1, 3);
    report.traces[0].joint = evil.into();
    report.distributions[0].joint = evil.into();
    report.fits[0].parameters[0].name = evil.into();
    report.doubts = vec![Doubt::new(DoubtKind::Diverged, evil)];
    report.log =
        Some(LogSummary { source: evil.into(), uncovered: vec![evil.into()], ..LogSummary::default() });
    let page = render(&report).unwrap();
    assert!(page.chars().all(|c| c == '\n' || !c.is_control()), "a control character is in the page");
    assert_eq!(page.matches("<script").count(), render(&full(1, 3)).unwrap().matches("<script").count());
    assert!(text(&parse(&page)).contains("a[31mbc<script>d e"));
}
