//! The pages of training and evaluation: what they say, and that neither names nor numbers can break them.
#![allow(clippy::unwrap_used)] // A test that panics has failed.

use crate::invented;
use crate::{go2, page};

use gaitfit_view::Drift;
use gaitfit_view::evaluation::{EvaluationReport, Ground, Histogram, Measure};
use gaitfit_view::gait::{FootTrack, GaitPicture, TorqueSpectrum, VelocityTrack};
use gaitfit_view::training::{SeedCurve, SeedResult, Series, TrainingReport};
use gaitfit_view::{Doubt, DoubtKind, Link, Setting, evaluation_html, training_report};
use page::{HOSTILE, assert_finite, assert_harmless, assert_offline, parse, text};

fn figures(html: &str) -> usize {
    parse(html).descendants().filter(|n| n.has_tag_name("figure")).count()
}

fn hrefs(html: &str) -> Vec<String> {
    parse(html).descendants().filter_map(|n| n.attribute("href").map(str::to_string)).collect()
}

#[test]
fn a_training_page_says_how_every_seed_ended() {
    let report = invented::training(3, 200);
    let html = training_report(&report).unwrap();
    assert_offline(&html);
    assert_finite(&html);
    let document = parse(&html);
    let shown = text(&document);
    for seed in &report.seeds {
        assert!(shown.contains(&format!("{:.3}", seed.result.linear_velocity_error)), "seed {}", seed.seed);
    }
    let mean = report.seeds.iter().map(|s| s.result.angular_velocity_error).sum::<f64>() / 3.0;
    assert!(shown.contains(&format!("{mean:.3}")));
    for expected in
        ["stopped by hand", "10,000 trajectories of 4 s", "explained variance", "clip = 0.2", "60 %"]
    {
        assert!(shown.contains(expected), "{expected} is missing");
    }
    // Every series once, and the gait.
    assert_eq!(figures(&html), 5 + 6 + 7 + 1);
    assert!(hrefs(&html).contains(&"seed-1/replay.html".to_string()));
    // A thin line a seed, and their mean, in every chart.
    let means = document.descendants().filter(|n| n.attribute("class") == Some("s mean")).count();
    let thin = document
        .descendants()
        .filter(|n| n.attribute("class").is_some_and(|c| c.starts_with("s c") && c.ends_with(" thin")));
    // The legend is there three times.
    assert_eq!((means, thin.count()), (18 + 3, 3 * 18));
}

#[test]
fn one_seed_has_no_mean() {
    let html = training_report(&invented::training(1, 50)).unwrap();
    assert!(!html.contains(r#"class="s mean""#) && !html.contains(">mean<"));
    assert_eq!(figures(&html), 19);
}

#[test]
fn pages_without_data_are_whole() {
    let html = training_report(&TrainingReport::default()).unwrap();
    assert_finite(&html);
    assert_eq!(hrefs(&html), ["#result", "#settings"]);
    let html = evaluation_html(&EvaluationReport::default()).unwrap();
    assert_finite(&html);
    assert_eq!(hrefs(&html), ["#result", "#settings"]);
    let nothing = TrainingReport { gait: Some(GaitPicture::default()), ..TrainingReport::default() };
    assert_eq!(figures(&training_report(&nothing).unwrap()), 0);
}

#[test]
fn an_evaluation_begins_with_its_verdict_and_plays() {
    let html = evaluation_html(&invented::evaluation(100)).unwrap();
    let document = parse(&html);
    let verdict = document.descendants().find(|n| n.attribute("class") == Some("state good")).unwrap();
    assert!(verdict.text().unwrap().starts_with("Walks:"));
    let large = document.descendants().filter(|n| n.attribute("class") == Some("big"));
    let large: Vec<&str> = large.filter_map(|n| n.text()).map(str::trim).collect();
    assert_eq!(large, ["0.11200", "0.14300", "1.31"], "decimals as asked for, or as the interval says");
    for html in [html.as_str(), &training_report(&invented::training(1, 20)).unwrap()] {
        let document = parse(html);
        let player = document.descendants().find(|n| n.attribute("id") == Some("player")).unwrap();
        assert_eq!(player.attribute("class"), Some("embedded"));
        assert!(hrefs(html).contains(&"#motion".to_string()));
    }
    let stands = vec![Doubt::new(DoubtKind::NotLearnt, "Seed 1: 85 % of its last episodes end in a fall.")];
    let report = TrainingReport { doubts: stands, ..invented::training(1, 20) };
    let shown = text(&parse(&training_report(&report).unwrap()));
    assert!(shown.find("Has not learnt to walk yet") < shown.find("mean linear-velocity error"), "{shown}");
}

#[test]
fn doubts_come_first() {
    let doubts = vec![Doubt::new(DoubtKind::Diverged, "3 of 100 robots diverged; they count as falls.")];
    let report = EvaluationReport { doubts: doubts.clone(), ..invented::evaluation(100) };
    let html = evaluation_html(&report).unwrap();
    let shown = text(&parse(&html));
    assert!(shown.find("3 of 100 robots diverged") < shown.find("Means over"), "{shown}");
    assert!(!html.contains(r#"class="badge ok""#), "nothing is praised");
    let report = TrainingReport { doubts, ..invented::training(1, 20) };
    let shown = text(&parse(&training_report(&report).unwrap()));
    assert!(shown.find("3 of 100 robots diverged") < shown.find("mean linear-velocity error"), "{shown}");
}

#[test]
fn strange_numbers_leave_gaps() {
    let mut report = invented::training(3, 100);
    report.seeds[0].progress[0].values = vec![f64::NAN; 100];
    report.seeds[1].progress[1].values = vec![f64::INFINITY, -1e308, 1e308, f64::NAN];
    report.seeds[2].diagnostics[0].values = vec![0.0; 100];
    report.seeds[1].iteration.clear();
    report.seeds[2].iteration.truncate(7);
    report.seeds[0].result = SeedResult::default();
    report.seeds[1].result.fall_rate = f64::INFINITY;
    report.wall_seconds = f64::NAN;
    let gait = report.gait.as_mut().unwrap();
    gait.time_s[3] = f64::NAN;
    gait.feet[0].contact.truncate(2);
    gait.feet[1].height_m = vec![f64::NAN; 3];
    gait.velocity[0].measured = vec![f64::INFINITY; 200];
    gait.spectra[0].density = vec![0.0, -1.0, f64::NAN];
    gait.spectra.push(TorqueSpectrum::default());
    let html = training_report(&report).unwrap();
    assert_finite(&html);

    let mut report = invented::evaluation(100);
    report.measures[0] = Measure { mean: f64::INFINITY, ..Measure::default() };
    report.measures[1].histogram = Some(Histogram { edges: vec![0.0, f64::NAN], counts: vec![1] });
    report.measures[2].histogram = Some(Histogram { edges: vec![0.0, 1.0], counts: vec![1, 2, 3] });
    report.measures[3].histogram = Some(Histogram { edges: vec![0.0, 1.0], counts: vec![0] });
    report.drift[0].path[3] = [f64::NAN, 1e308];
    report.drift[1].error = [f64::NAN; 3];
    report.drift[2].intended = vec![[f64::INFINITY; 2]];
    report.drift.push(Drift::default());
    assert_finite(&evaluation_html(&report).unwrap());
}

#[test]
fn hostile_names_stay_text() {
    let hostile = || HOSTILE.to_string();
    let setting = || vec![Setting { name: hostile(), value: hostile() }];
    let link = || vec![Link { text: hostile(), path: "javascript:alert(1)".into() }];
    let mut gait = go2::gait(20);
    gait.feet[0].name = hostile();
    gait.spectra[0].group = hostile();

    let mut report = invented::training(2, 20);
    let honest = training_report(&report).unwrap();
    for text in [
        &mut report.title,
        &mut report.robot,
        &mut report.created,
        &mut report.measured_on,
        &mut report.gait_caption,
        &mut report.configuration,
    ] {
        *text = hostile();
    }
    report.warnings = vec![hostile()];
    (report.facts, report.versions, report.links) = (setting(), setting(), link());
    report.gait = Some(gait.clone());
    let seed = &mut report.seeds[0];
    for series in [&mut seed.progress, &mut seed.rewards, &mut seed.diagnostics] {
        (series[0].name, series[0].unit) = (hostile(), hostile());
    }
    let html = training_report(&report).unwrap();
    assert_harmless(&html, &honest);
    assert!(hrefs(&html).iter().all(|h| h.starts_with('#')), "links elsewhere are text");

    let mut report = invented::evaluation(50);
    let honest = evaluation_html(&report).unwrap();
    for text in [&mut report.title, &mut report.robot, &mut report.created, &mut report.gait_caption] {
        *text = hostile();
    }
    report.warnings = vec![hostile()];
    (report.settings, report.versions, report.links) = (setting(), setting(), link());
    report.gait = Some(gait.clone());
    (report.measures[0].name, report.measures[0].unit) = (hostile(), hostile());
    report.drift[0].name = hostile();
    assert_harmless(&evaluation_html(&report).unwrap(), &honest);
}

#[test]
fn an_evaluation_names_means_limits_and_drift() {
    let report = invented::evaluation(10_000);
    let html = evaluation_html(&report).unwrap();
    assert_offline(&html);
    assert_finite(&html);
    let document = parse(&html);
    let shown = text(&document);
    for expected in
        ["10\u{a0}000 trajectories of 4 s", "0.11200", "± 0.00067", "exceeded", "+yaw 1 rad/s", "0 of 10"]
    {
        assert!(shown.contains(expected), "{expected} is missing");
    }
    assert_eq!(shown.matches("kept").count(), 2);
    // Three histograms, the paths, the gait.
    assert_eq!(figures(&html), 3 + 1 + 1);
    let rings =
        document.descendants().filter(|n| n.attribute("class").is_some_and(|c| c.starts_with("s ring")));
    assert_eq!(rings.count(), 7);
}

#[test]
fn uneven_ground_is_a_table_level_by_level() {
    let html = evaluation_html(&invented::evaluation(100)).unwrap();
    assert!(hrefs(&html).contains(&"#ground".to_owned()), "{:?}", hrefs(&html));
    let text = text(&parse(&html));
    for part in ["Uneven ground", "stairs up", "steps of 20 cm", "100", "45"] {
        assert!(text.contains(part), "{part}");
    }
    let hostile = Ground { name: HOSTILE.into(), ..Ground::default() };
    let with = |title: &str, ground: Ground| {
        let ground = vec![ground; 1000];
        evaluation_html(&EvaluationReport { title: title.into(), ground, ..EvaluationReport::default() })
    };
    let html = with(HOSTILE, hostile).unwrap();
    assert_harmless(&html, &with("p", Ground::default()).unwrap());
    assert!(html.contains("600 more levels"));
}

#[test]
fn paths_from_above_have_equal_scales() {
    let square = vec![[0.0, 0.0], [1.0, 0.0], [1.0, 3.0]];
    let drift = vec![Drift { path: square, ..Drift::default() }];
    let html = evaluation_html(&EvaluationReport { drift, ..EvaluationReport::default() }).unwrap();
    let document = parse(&html);
    let path = document.descendants().find(|n| n.attribute("class") == Some("s c0")).unwrap();
    let numbers: Vec<f64> =
        path.attribute("d").unwrap().split(['M', 'L', ' ']).filter_map(|n| n.parse().ok()).collect();
    let (across, up) = (numbers[2] - numbers[0], numbers[3] - numbers[5]);
    assert!((up - 3.0 * across).abs() < 0.05, "{numbers:?}");
}

#[test]
fn large_runs_stay_small_pages() {
    let mut report = invented::training(5, 5000);
    report.seeds = (0..60).map(|i| SeedCurve { seed: i, ..report.seeds[i as usize % 5].clone() }).collect();
    let long = "very_long_".repeat(1000);
    report.seeds[0]
        .rewards
        .extend((0..1000).map(|i| Series { name: format!("{i}{long}"), ..Series::default() }));
    report.configuration = "x = 1\n".repeat(1_000_000);
    let mut gait = go2::gait(10);
    gait.time_s = (0..20_000).map(|i| i as f64 * 0.001).collect();
    let contact: Vec<bool> = (0..20_000).map(|i| i % 2 == 0).collect();
    gait.feet = vec![FootTrack { name: long, contact, height_m: vec![0.1; 20_000] }; 50];
    let waves: Vec<f64> = (0..20_000).map(|i| (i as f64).sin()).collect();
    gait.velocity = [0; 3].map(|_| VelocityTrack { command: waves.clone(), measured: waves.clone() });
    report.gait = Some(gait);
    let html = training_report(&report).unwrap();
    assert!(html.len() < 12_000_000, "{} bytes", html.len());
    assert!(text(&parse(&html)).contains("20 more seeds"));

    let usual = training_report(&invented::training(5, 1000)).unwrap();
    assert!(usual.len() < 1_000_000, "{} bytes", usual.len());

    let mut report = invented::evaluation(1000);
    let long: Vec<[f64; 2]> = (0..5000).map(|i| [f64::from(i), f64::from(i % 7)]).collect();
    report.drift = vec![Drift { path: long.clone(), intended: long, ..Drift::default() }; 200];
    let html = evaluation_html(&report).unwrap();
    assert!(html.len() < 2_000_000, "{} bytes", html.len());
}

#[test]
fn histograms_count_every_sample_once() {
    let samples: Vec<f64> = (0..1000).map(f64::from).chain([f64::NAN, 1e9]).collect();
    let histogram = Histogram::from_samples(&samples, 10);
    assert_eq!(histogram.counts.iter().sum::<u64>(), 1001);
    assert_eq!(histogram.edges.len(), 11);
    assert!(histogram.edges[10] < 1000.0, "one far sample does not stretch the axis");
    assert_eq!(histogram.counts[0], 100);
    assert!(Histogram::from_samples(&[f64::NAN], 10).counts.is_empty());
    assert_eq!(Histogram::from_samples(&[2.0; 7], 0).counts, [7]);
    assert_eq!(Histogram::from_samples(&samples, 1000).counts.len(), 400, "no more are drawn");
}
