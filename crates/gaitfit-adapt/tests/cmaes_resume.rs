//! A run interrupted at any generation, saved as JSON and resumed, ends with the same bits.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_adapt::cmaes::{
    Cma, CmaError, CovarianceKind, RestartPlan, RestartStart, Search, SearchState, Settings, State,
};

fn cost(x: &[f64]) -> f64 {
    x.windows(2).map(|p| 100.0 * (p[1] - p[0] * p[0]).powi(2) + (1.0 - p[0]).powi(2)).sum()
}

fn costs(x: &[Vec<f64>], generation: u32) -> Vec<f64> {
    // A failure now and then, so that failed costs pass through the saved history.
    (0..).zip(x).map(|(k, x)| if (k + generation).is_multiple_of(11) { f64::NAN } else { cost(x) }).collect()
}

fn settings(covariance: CovarianceKind) -> Settings {
    let settings = Settings::new(vec![0.1, 0.2, 0.3, 0.4, 0.5], vec![0.3, 0.1, 0.2, 0.3, 0.3], 42);
    Settings { covariance, ..settings }.with_bounds(vec![-1.0; 5], vec![0.9, 0.9, 2.0, 2.0, f64::INFINITY])
}

fn advance(cma: &mut Cma) {
    let population = cma.ask();
    let costs = costs(population.x(), population.generation());
    cma.tell(&population, &costs).unwrap();
}

#[test]
fn resumed_runs_are_bit_identical() {
    for kind in [CovarianceKind::Full, CovarianceKind::Separable] {
        let mut undisturbed = Cma::new(settings(kind)).unwrap();
        let mut resumed = undisturbed.clone();
        for _ in 0..40 {
            advance(&mut undisturbed);
            let saved = serde_json::to_string(resumed.state()).unwrap();
            let state: State = serde_json::from_str(&saved).unwrap();
            resumed = Cma::resume(settings(kind), state).unwrap();
            advance(&mut resumed);
            assert_eq!(resumed, undisturbed);
        }
        // Equality of f64 cannot tell −0 from 0; the text can.
        let text = |cma: &Cma| serde_json::to_string(cma.state()).unwrap();
        assert_eq!(text(&resumed), text(&undisturbed));
    }
}

/// With 250 coordinates C is decomposed every second generation (appendix B.2 of the tutorial): between, C moves on and its
/// root does not. A run resumed between two decompositions ends with the same bits.
#[test]
fn many_coordinates_are_decomposed_now_and_then() {
    let n = 250;
    let settings = || Settings::new(vec![0.5; n], vec![0.3; n], 42);
    let mut undisturbed = Cma::new(settings()).unwrap();
    let mut resumed = undisturbed.clone();
    for generation in 1..=4 {
        let before = undisturbed.state().covariance.clone();
        advance(&mut undisturbed);
        let after = &undisturbed.state().covariance;
        assert_ne!(after.diagonal(), before.diagonal());
        let stale = after.axis_lengths() == before.axis_lengths();
        assert_eq!(stale, generation % 2 == 1, "generation {generation}");
        let state = serde_json::from_str(&serde_json::to_string(resumed.state()).unwrap()).unwrap();
        resumed = Cma::resume(settings(), state).unwrap();
        advance(&mut resumed);
        assert_eq!(resumed, undisturbed);
    }
}

#[test]
fn resumed_searches_are_bit_identical() {
    let mut settings = settings(CovarianceKind::Full);
    settings.upper[4] = 3.0;
    settings.tolerances.max_generations = Some(7);
    let plan = RestartPlan { runs: 3, population_factor: 2, start: RestartStart::Uniform };
    let mut undisturbed = Search::new(settings.clone(), plan).unwrap();
    let mut resumed = undisturbed.clone();
    let mut generations = 0;
    while !undisturbed.is_finished() {
        for search in [&mut undisturbed, &mut resumed] {
            let population = search.ask();
            let costs = costs(population.x(), population.generation());
            search.tell(&population, &costs).unwrap();
        }
        generations += 1;
        let saved = serde_json::to_string(&resumed.state()).unwrap();
        let state: SearchState = serde_json::from_str(&saved).unwrap();
        resumed = Search::resume(settings.clone(), plan, state).unwrap();
        assert_eq!(resumed, undisturbed);
    }
    assert_eq!(generations, 21);
    let populations: Vec<usize> = resumed.finished().iter().map(|run| run.population).collect();
    assert_eq!(populations, [8, 16, 32]);
    assert_eq!(resumed.evaluations(), 7 * (8 + 16 + 32));
    let population = resumed.ask();
    let costs = vec![0.0; population.x().len()];
    assert_eq!(resumed.tell(&population, &costs).unwrap_err(), CmaError::Finished);
}

#[test]
fn foreign_and_damaged_states_are_refused() {
    let mut cma = Cma::new(settings(CovarianceKind::Full)).unwrap();
    advance(&mut cma);
    let good = cma.state().clone();
    let refused = |state: State| Cma::resume(settings(CovarianceKind::Full), state).unwrap_err().to_string();

    let state = State { mean: vec![0.0; 4], ..good.clone() };
    assert!(refused(state).contains("mean has 4 entries for 5 coordinates"));
    assert!(refused(State { sigma: 0.0, ..good.clone() }).contains("sigma is 0"));
    assert!(refused(State { history: Vec::new(), ..good.clone() }).contains("history"));
    let other = Cma::new(settings(CovarianceKind::Separable)).unwrap().state().clone();
    assert!(refused(State { covariance: other.covariance, ..good.clone() }).contains("Separable"));
    let other = |change: fn(&mut Settings), words: &str| {
        let mut settings = settings(CovarianceKind::Full);
        change(&mut settings);
        let error = Cma::resume(settings, good.clone()).unwrap_err().to_string();
        assert!(error.contains(words), "`{words}` is not in `{error}`");
    };
    other(|settings| settings.start[2] += 1e-12, "another start");
    other(|settings| settings.deviation[0] = 0.31, "other deviations");
    other(|settings| settings.upper[4] = 3.0, "other bounds");
    other(|settings| settings.seed = 43, "seed 42, the settings say 43");
    other(|settings| settings.sigma = 2.0, "sigma 1, the settings say 2");
    other(|settings| settings.max_resampling = 1, "outside the bounds");
    let text = serde_json::to_string(&good).unwrap().replace("\"sigma\":", "\"sgima\":");
    assert!(serde_json::from_str::<State>(&text).is_err());
}

#[test]
fn wrong_settings_and_answers_are_refused() {
    let base = Settings::new(vec![0.0; 2], vec![1.0; 2], 0);
    let refused = |settings: Settings| Cma::new(settings).unwrap_err();
    assert_eq!(refused(Settings::new(vec![], vec![], 0)), CmaError::NoCoordinates);
    assert!(matches!(refused(Settings::new(vec![0.0], vec![1.0, 1.0], 0)), CmaError::Length { .. }));
    assert!(matches!(refused(Settings::new(vec![0.0], vec![0.0], 0)), CmaError::Coordinate { .. }));
    assert!(matches!(
        refused(Settings::new(vec![f64::NAN], vec![1.0], 0)),
        CmaError::StartOutsideBounds { .. }
    ));
    assert!(matches!(
        refused(base.clone().with_bounds(vec![0.5, -1.0], vec![1.0; 2])),
        CmaError::StartOutsideBounds { index: 0, .. }
    ));
    assert!(matches!(refused(Settings { population: 1, ..base.clone() }), CmaError::Setting { .. }));
    assert!(matches!(refused(Settings { sigma: f64::NAN, ..base.clone() }), CmaError::Setting { .. }));
    let uniform = RestartPlan { runs: 2, start: RestartStart::Uniform, ..RestartPlan::default() };
    assert!(matches!(Search::new(base.clone(), uniform).unwrap_err(), CmaError::Coordinate { .. }));

    let mut cma = Cma::new(base).unwrap();
    let population = cma.ask();
    assert!(matches!(cma.tell(&population, &[1.0]).unwrap_err(), CmaError::CostCount { .. }));
    cma.tell(&population, &vec![1.0; population.x().len()]).unwrap();
    let error = cma.tell(&population, &vec![1.0; population.x().len()]).unwrap_err();
    assert_eq!(error, CmaError::Generation { got: 0, expected: 1 });
}
