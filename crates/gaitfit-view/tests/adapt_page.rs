//! The page as a reader's browser gets it: well formed, closed to the network, safe against hostile names, whole
//! whatever is missing, and bounded in size.
#![allow(clippy::unwrap_used)] // A test that panics has failed.

use gaitfit_view::report::{
    AdaptReport, Bound, Comparison, ComparisonEntry, JointDistribution, JointTrace, OptimizerRun, Parameter,
    PublishedRange, Quantity, Score, Setting, Validation, render,
};

#[path = "common/page.rs"]
mod page;
use page::{HOSTILE, assert_finite, assert_harmless, assert_offline, parse, text};

fn wave(count: usize, phase: f64) -> Vec<f64> {
    (0..count).map(|i| (i as f64 * 0.013 + phase).sin()).collect()
}

/// A report of `joints` joints with every section filled.
fn full(joints: usize, generations: usize) -> AdaptReport {
    let names: Vec<String> = (0..joints).map(|j| format!("joint_{j}")).collect();
    let trace = |name: &String| JointTrace {
        joint: name.clone(),
        file: "run_6.csv".into(),
        time_s: (0..4700).map(|i| i as f64 * 0.005).collect(),
        measured: wave(4700, 0.0),
        fitted: wave(4700, 0.01),
        nominal: wave(4700, 0.3),
        target: wave(4700, 0.5),
    };
    let distribution = |name: &String, quantity| {
        let (measured, nominal, fitted) = (wave(900, 0.0), wave(800, 0.3), wave(700, 0.01));
        JointDistribution::from_samples(name, quantity, &measured, &nominal, &fitted, 1000)
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
    AdaptReport {
        title: "full".into(),
        robot: "Go2".into(),
        created: "2026-01-01".into(),
        wall_seconds: 41.0,
        fit_logs: vec!["run_0.csv".into()],
        cost_name: "MatchO".into(),
        cost_unit: String::new(),
        fitted: score("fitted", 0.0048),
        nominal: score("nominal", 0.0678),
        baselines: vec![score("echo of the target", 0.0794), score("best pure delay", 0.0426)],
        noise_floor_rad: Some(0.0044),
        parameters: (0..14).map(parameter).collect(),
        runs: (0..5).map(run).collect(),
        validation: vec![Validation {
            file: "run_6.csv".into(),
            rmse_rad: 0.0048,
            nominal_rmse_rad: 0.0678,
            rmse_per_joint: names.iter().map(|n| (n.clone(), 0.0048)).collect(),
        }],
        comparison: Some(Comparison {
            first: "MatchO".into(),
            second: "Wass".into(),
            entries: vec![ComparisonEntry {
                name: "delay".into(),
                agrees: Some(false),
                ..Default::default()
            }],
            reasons: vec!["no time axis".into()],
        }),
        distributions: names
            .iter()
            .flat_map(|n| [distribution(n, Quantity::Position), distribution(n, Quantity::Velocity)])
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
        "at lower bound",
        "not determined by these logs",
        "0.0200",
        "0.0012",
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
fn sections_without_data_are_left_out() {
    let page = render(&AdaptReport::default()).unwrap();
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
    for name in [&mut report.title, &mut report.robot, &mut report.created, &mut report.cost_name] {
        *name = hostile.into();
    }
    report.cost_unit = hostile.into();
    report.fit_logs = vec![hostile.into()];
    report.warnings = vec![hostile.into()];
    report.settings = vec![Setting { name: hostile.into(), value: hostile.into() }];
    report.versions = report.settings.clone();
    report.fitted.name = hostile.into();
    report.baselines[0].name = hostile.into();
    for parameter in &mut report.parameters {
        (parameter.name, parameter.unit) = (hostile.into(), hostile.into());
        parameter.published.as_mut().unwrap().source = hostile.into();
    }
    report.runs[0].label = hostile.into();
    report.validation[0].file = hostile.into();
    report.validation[0].rmse_per_joint[0].0 = hostile.into();
    let comparison = report.comparison.as_mut().unwrap();
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
    report.runs.truncate(1);
    report.runs[0].best = vec![f64::INFINITY, f64::NAN, 0.5, -1.0];
    report.parameters = [1e-9, 1e9, 0.0, f64::NAN, f64::INFINITY, -1e300, 1e308]
        .map(|value| Parameter { name: "p".into(), unit: "N·m".into(), value, ..Parameter::default() })
        .to_vec();
    report.parameters[0].lower = f64::NEG_INFINITY;
    report.traces[0].measured[100] = f64::NAN;
    report.traces[0].fitted = vec![f64::INFINITY; 4700];
    report.traces[1].measured.truncate(3);
    report.traces[1].time_s[5] = f64::NAN;
    report.distributions[0].edges[1] = f64::NAN;
    report.distributions[1].nominal.truncate(2);
    report.validation[0].rmse_per_joint[0].1 = f64::NAN;
    report.validation.push(Validation::default());
    report.noise_floor_rad = Some(f64::NAN);

    let page = render(&report).unwrap();
    let document = parse(&page);
    let shown = text(&document);
    for expected in ["1.000\u{a0}×\u{a0}10⁻⁹", "1.000\u{a0}×\u{a0}10⁹", "–", "on the logs the fit used"]
    {
        assert!(shown.contains(expected), "{expected} is missing");
    }
    assert_finite(&page);
}

#[test]
fn large_reports_stay_small_pages() {
    let mut report = full(40, 10_000);
    report.parameters = vec![report.parameters[0].clone(); 1164];
    for name in report.traces.iter_mut().map(|t| &mut t.joint) {
        *name = "very_long_".repeat(1000);
    }
    let page = render(&report).unwrap();
    parse(&page);
    assert!(page.len() < 5_000_000, "{} bytes", page.len());
    assert!(page.contains("964 more are in the run folder"));
}

#[test]
fn data_survive_json_with_their_unknowns() {
    let mut report = full(1, 3);
    report.parameters[0].spread = f64::NAN;
    report.runs[0].best[1] = f64::NAN;
    report.validation[0].rmse_per_joint[0].1 = f64::NAN;
    let json = serde_json::to_string(&report).unwrap();
    let back: AdaptReport = serde_json::from_str(&json).unwrap();
    assert!(back.parameters[0].spread.is_nan() && back.runs[0].best[1].is_nan());
    assert_eq!(serde_json::to_string(&back).unwrap(), json);
    // A report written before a field existed still reads.
    let sparse: AdaptReport =
        serde_json::from_str(r#"{"title": "old", "parameters": [{"name": "a"}]}"#).unwrap();
    assert!(sparse.parameters[0].value.is_nan() && sparse.wall_seconds == 0.0);
}

#[test]
fn histograms_are_densities() {
    let samples: Vec<f64> = (0..1000).map(|i| i as f64 / 999.0).collect();
    let with_gap = [0.25, f64::NAN, 0.75];
    let d = JointDistribution::from_samples("j", Quantity::Position, &samples, &with_gap, &[], 10);
    assert_eq!(d.edges.len(), 11);
    for density in [&d.measured, &d.nominal] {
        let mass: f64 = density.iter().zip(d.edges.windows(2)).map(|(p, e)| p * (e[1] - e[0])).sum();
        assert!((mass - 1.0).abs() < 1e-12, "{mass}");
    }
    assert!(d.fitted.is_empty());
    assert!((d.measured[3] - 1.0).abs() < 0.01);
    let constant = JointDistribution::from_samples("j", Quantity::Velocity, &[0.0; 5], &[], &[], 4);
    assert!(constant.measured.iter().all(|p| p.is_finite()));
    let nothing = JointDistribution::from_samples("j", Quantity::Velocity, &[], &[], &[f64::NAN], 4);
    assert!(nothing.edges.is_empty());
}
