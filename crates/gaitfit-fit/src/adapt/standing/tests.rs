//! Tests of what a fit may be used for.

use super::*;
use crate::adapt::parameter::example;
use gaitfit_adapt::Prior;

fn parameter(name: &str, value: f64, interval: [f64; 2]) -> Parameter {
    example(name, value, [0.0, 2.0], interval)
}

fn fit(parameters: Vec<Parameter>) -> CostFit {
    CostFit {
        cost_name: "matchr1".to_owned(),
        cost: 0.1,
        nominal_cost: Some(0.2),
        converged: true,
        better_than_nominal: true,
        doubts: Vec::new(),
        falls: 0,
        nominal_falls: 0,
        parameters,
        mean_error_percent: None,
        runs: Vec::new(),
        validation: Vec::new(),
        uncertainty: None,
        correction: None,
        regression: None,
        redrawn: None,
        audit: None,
        leftover: None,
        comparison: Vec::new(),
    }
}

fn score(name: &str, cost: f64, rmse: Option<f64>) -> Score {
    Score {
        name: name.to_owned(),
        cost: Some(cost),
        rmse_fit_rad: rmse,
        rmse_validation_rad: None,
        cost_validation: None,
        delay_seconds: None,
    }
}

fn kinds(fit: &CostFit, baselines: &[Score], fitted: &Score) -> Vec<(DoubtKind, String)> {
    let evidence = Evidence { fitted, baselines, held_out: None, effort: Some(23.7), position_unit: "rad" };
    doubts(fit, &evidence).into_iter().map(|doubt| (doubt.kind, doubt.text)).collect()
}

#[test]
fn a_fit_without_doubts_is_sound() {
    let sound = fit(vec![parameter("frictionloss_hip", 0.2, [0.1, 0.3])]);
    let doubts = kinds(&sound, &[score("nominal", 0.2, None)], &score("fitted", 0.1, None));
    assert!(doubts.is_empty(), "{doubts:?}");
    assert_eq!(standing(&[], None), Standing::Sound);
    assert_eq!(standing(&[Doubt::new(DoubtKind::Misfit, "")], None), Standing::Doubtful);
}

#[test]
fn fits_that_are_wrong_are_refused_and_doubtful_ones_are_not() {
    let text = |kinds: &[DoubtKind]| {
        refusal(&kinds.iter().map(|kind| Doubt::new(*kind, "so")).collect::<Vec<_>>()).unwrap_or_default()
    };
    assert!(text(&[DoubtKind::Unexplained, DoubtKind::Disagreement, DoubtKind::NotConverged]).is_empty());
    let both = text(&[DoubtKind::Trivial, DoubtKind::Misfit, DoubtKind::Misfit, DoubtKind::NotConverged]);
    assert!(both.ends_with(": worse than a guess, misfit"), "{both}");
    assert!(text(&[DoubtKind::WorseThanNominal]).contains("worse than the nominal robot"));
}

#[test]
fn a_guess_that_predicts_better_is_said_first() {
    let doubted = CostFit { doubts: vec![Doubt::new(DoubtKind::NotConverged, "so")], ..fit(Vec::new()) };
    let guesses =
        [score("nominal", 0.2, Some(0.3)), score("echo", 0.5, Some(0.08)), score("late", 0.5, Some(0.04))];
    let doubts = kinds(&doubted, &guesses, &score("fitted", 0.1, Some(0.06)));
    assert!(doubts[0].0 == DoubtKind::Trivial && doubts[0].1.contains("\"late\""), "{doubts:?}");
    assert!(doubts[0].1.contains("0.04000 against 0.06000"), "errors count, not costs: {doubts:?}");
    let better = kinds(&fit(Vec::new()), &guesses, &score("fitted", 0.1, Some(0.02)));
    assert!(better.is_empty(), "{better:?}");
}

#[test]
fn errors_that_go_with_motion_are_a_doubt_and_widen_intervals() {
    let audit = Audit {
        memory: 0.05,
        explained: 0.25,
        strongest: ("change of the target".to_owned(), 0.4),
        worst_joint: ("FL_calf".to_owned(), 0.4),
    };
    assert_eq!(widening(&audit), 6.0);
    let lacking =
        CostFit { audit: Some(audit.clone()), ..fit(vec![parameter("frictionloss_hip", 0.4, [0.38, 0.42])]) };
    let doubts = kinds(&lacking, &[], &score("fitted", 0.1, None));
    assert!(doubts.len() == 1 && doubts[0].0 == DoubtKind::Unexplained, "{doubts:?}");
    let text = &doubts[0].1;
    assert!(
        text.contains("25 %") && text.contains("change of the target") && text.contains("\"delay\""),
        "{text}"
    );
    assert!(!text.contains("odd_joints"), "{text}");
    let one = Audit { worst_joint: ("RR_calf".to_owned(), 0.8), ..audit.clone() };
    let doubts = kinds(&CostFit { audit: Some(one), ..fit(Vec::new()) }, &[], &score("f", 0.1, None));
    assert!(doubts[0].1.contains("RR_calf is not like the other joints: `odd_joints"), "{doubts:?}");
    let quiet = Audit { explained: 0.03, ..audit };
    assert_eq!(widening(&quiet), 1.0);
    assert!(
        kinds(&CostFit { audit: Some(quiet), ..fit(Vec::new()) }, &[], &score("f", 0.1, None)).is_empty()
    );
}

#[test]
fn more_torque_noise_than_motors_have_is_a_doubt() {
    let with_noise = |noise| {
        let parameter = example("torque_noise", noise, [0.0, 10.0], [noise - 0.2, noise + 0.2]);
        kinds(&fit(vec![parameter]), &[], &score("fitted", 0.1, None))
    };
    let doubts = with_noise(2.9);
    assert!(doubts.len() == 1 && doubts[0].0 == DoubtKind::Unexplained, "{doubts:?}");
    assert!(doubts[0].1.contains("2.9 N·m, 12 % of"), "{doubts:?}");
    assert!(with_noise(1.3).is_empty());
}

#[test]
fn values_at_bounds_and_at_nothing_count() {
    let at = |name, value, interval| {
        kinds(&fit(vec![parameter(name, value, interval)]), &[], &score("f", 0.1, None))
    };
    assert!(at("frictionloss_hip", 2.0, [1.9, 2.0])[0].1.contains("rests on a bound"));
    let nothing = at("frictionloss_hip", 0.0, [0.0, 0.01]);
    assert!(nothing.len() == 1 && nothing[0].1.contains("rests at 0"), "{nothing:?}");
    assert!(at("frictionloss_hip", 0.0, [0.0, 0.3]).is_empty(), "0 is allowed, and so is more");
    assert!(at("damping_hip", 0.0, [0.0, 0.01]).is_empty(), "joints without damping exist");
    let rigid = example("ground_impedance", 0.99, [0.0, 0.99], [0.9, 0.99]);
    assert!(kinds(&fit(vec![rigid]), &[], &score("f", 0.1, None)).is_empty(), "contacts may be rigid");
    let less = example("ground_impedance", 0.8, [0.0, 0.8], [0.7, 0.8]);
    assert_eq!(kinds(&fit(vec![less]), &[], &score("f", 0.1, None)).len(), 1, "a bound of the user's is one");
    let known = Parameter { truth: Some(0.0), ..parameter("frictionloss_hip", 0.0, [0.0, 0.01]) };
    assert!(kinds(&fit(vec![known]), &[], &score("f", 0.1, None)).is_empty());
}

#[test]
fn whole_walks_and_short_predictions_that_disagree_say_so_and_reach_to_both() {
    let agreement = |agrees| gaitfit_adapt::fit::Agreement {
        name: "frictionloss_hip".to_owned(),
        unit: "N·m".to_owned(),
        first: 0.2,
        first_half: Some(0.1),
        second: 0.9,
        second_half: Some(0.1),
        agrees: Some(agrees),
        reason: None,
    };
    let fits = |other: &str, agrees| {
        let first =
            CostFit { cost_name: "wass".into(), ..fit(vec![parameter("frictionloss_hip", 0.2, [0.1, 0.3])]) };
        let other =
            CostFit { cost_name: other.into(), comparison: vec![agreement(agrees)], ..fit(Vec::new()) };
        let mut both = vec![first, other];
        reconcile(&mut both);
        both.swap_remove(0)
    };
    let apart = fits("matchr1", false);
    assert_eq!(apart.parameters[0].interval, Some([0.1, 0.9]));
    assert!(
        apart.doubts[0].kind == DoubtKind::Disagreement && apart.doubts[0].text.contains("0.2000 and 0.9000")
    );
    assert!(fits("matchr1", true).doubts.is_empty());
}

#[test]
fn walks_that_contradict_what_was_known_say_so() {
    let prior = Some(Prior::new(0.55, 0.1));
    let reached = |value| {
        fit(vec![Parameter { prior, ..parameter("frictionloss_calf", value, [value - 0.1, value + 0.1]) }])
    };
    let doubts = kinds(&reached(1.25), &[], &score("f", 0.1, None));
    assert!(
        doubts[0].0 == DoubtKind::Disagreement && doubts[0].1.contains("1.2500 for 0.5500 ± 0.1000"),
        "{doubts:?}"
    );
    assert!(kinds(&reached(0.7), &[], &score("f", 0.1, None)).is_empty());
}
