//! CMA-ES on the standard test functions: a stated precision within a stated number of evaluations, five seeds each.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_adapt::cmaes::{
    BoundHandling, Cma, CovarianceKind, RestartPlan, RestartStart, Search, Settings, StopReason,
};
use std::f64::consts::PI;

fn sphere(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x).sum()
}

/// Condition 1e6.
fn ellipsoid(x: &[f64]) -> f64 {
    let ratio = 10_f64.powf(6.0 / (x.len() - 1) as f64);
    x.iter().fold((0.0, 1.0), |(sum, weight), x| (sum + weight * x * x, weight * ratio)).0
}

/// The ellipsoid in coordinates mixed by a Householder reflection: not separable.
fn rotated_ellipsoid(x: &[f64]) -> f64 {
    let norm = x.len() as f64;
    let projection = 2.0 * x.iter().sum::<f64>() / norm;
    ellipsoid(&x.iter().map(|x| x - projection).collect::<Vec<_>>())
}

fn rosenbrock(x: &[f64]) -> f64 {
    x.windows(2).map(|p| 100.0 * (p[1] - p[0] * p[0]).powi(2) + (1.0 - p[0]).powi(2)).sum()
}

fn rastrigin(x: &[f64]) -> f64 {
    x.iter().map(|x| x * x + 10.0 * (1.0 - (2.0 * PI * x).cos())).sum()
}

/// Evaluations to reach `target`, within `limit`.
fn evaluations(mut settings: Settings, function: fn(&[f64]) -> f64, target: f64, limit: u64) -> u64 {
    settings.tolerances.target_cost = Some(target);
    let mut cma = Cma::new(settings).unwrap();
    loop {
        match cma.stop() {
            Some(StopReason::TargetCost) => return cma.evaluations(),
            Some(other) => panic!("stopped by {other:?} at {:?}", cma.best()),
            None => assert!(cma.evaluations() < limit, "best after {limit}: {:?}", cma.best()),
        }
        let population = cma.ask();
        let costs: Vec<f64> = population.x().iter().map(|x| function(x)).collect();
        cma.tell(&population, &costs).unwrap();
    }
}

fn reaches(
    name: &str,
    settings: impl Fn(u64) -> Settings,
    function: fn(&[f64]) -> f64,
    target: f64,
    limit: u64,
) {
    let counts: Vec<u64> = (0..5).map(|seed| evaluations(settings(seed), function, target, limit)).collect();
    println!("{name}: {counts:?} evaluations");
}

fn plain(n: usize, seed: u64) -> Settings {
    Settings::new(vec![1.0; n], vec![0.5; n], seed)
}

#[test]
fn sphere_10() {
    reaches("sphere", |seed| plain(10, seed), sphere, 1e-10, 2_500);
}

#[test]
fn one_coordinate() {
    for covariance in [CovarianceKind::Full, CovarianceKind::Separable] {
        reaches("one coordinate", |seed| Settings { covariance, ..plain(1, seed) }, sphere, 1e-10, 400);
    }
}

#[test]
fn ellipsoid_10() {
    reaches("ellipsoid", |seed| plain(10, seed), ellipsoid, 1e-10, 8_000);
    reaches("rotated ellipsoid", |seed| plain(10, seed), rotated_ellipsoid, 1e-10, 8_000);
}

/// Deviations that match the scales make the ellipsoid a sphere.
#[test]
fn deviations_precondition() {
    let settings = |seed| {
        let deviation = (0..10).map(|i| 0.5 * 10_f64.powf(-3.0 * f64::from(i) / 9.0)).collect();
        Settings::new(vec![1.0; 10], deviation, seed)
    };
    reaches("ellipsoid with deviations", settings, ellipsoid, 1e-10, 6_000);
}

/// Started at the origin, from where few runs end in the local minimum near (−1, 1, …, 1).
#[test]
fn rosenbrock_8() {
    let settings = |seed| Settings::new(vec![0.0; 8], vec![0.3; 8], seed);
    reaches("rosenbrock", settings, rosenbrock, 1e-10, 10_000);
}

#[test]
fn rastrigin_5_with_a_large_population() {
    let settings = |seed| Settings { population: 400, ..Settings::new(vec![3.0; 5], vec![2.5; 5], seed) };
    reaches("rastrigin", settings, rastrigin, 1e-8, 30_000);
}

#[test]
fn separable_on_many_coordinates() {
    let settings = |seed| Settings { covariance: CovarianceKind::Separable, ..plain(100, seed) };
    reaches("separable ellipsoid, n = 100", settings, ellipsoid, 1e-8, 120_000);
}

/// The minimum of Σ (x + 1)² on [0, 2]ⁿ is the corner 0, cost n. Every candidate and the mean stay in the box.
fn corner_error(settings: Settings, generations: u32) -> f64 {
    let n = settings.start.len();
    let mut settings = settings.with_bounds(vec![0.0; n], vec![2.0; n]);
    settings.tolerances.max_generations = Some(generations);
    let mut cma = Cma::new(settings).unwrap();
    while cma.stop().is_none() {
        let population = cma.ask();
        assert!(population.x().iter().flatten().chain(&cma.mean()).all(|x| (0.0..=2.0).contains(x)));
        let costs: Vec<f64> =
            population.x().iter().map(|x| x.iter().map(|x| (x + 1.0).powi(2)).sum()).collect();
        cma.tell(&population, &costs).unwrap();
    }
    cma.best().unwrap().cost - n as f64
}

/// Mirrored bounds reach a corner to full precision, from inside and from the corner itself.
#[test]
fn reflected_bounds_reach_a_corner() {
    for covariance in [CovarianceKind::Full, CovarianceKind::Separable] {
        for start in [1.0, 0.0, 2.0] {
            for seed in 0..5 {
                let settings = Settings::new(vec![start; 6], vec![0.5; 6], seed);
                let settings = Settings { covariance, bound_handling: BoundHandling::Reflect, ..settings };
                let error = corner_error(settings, 300);
                assert!(error < 1e-8, "{covariance:?} from {start}, seed {seed}: {error:e}");
            }
        }
    }
}

/// Resampled bounds, as in the `cmaes` package: near the corner with the full covariance, whose step size then
/// diverges, and at it with the separable one.
#[test]
fn resampled_bounds_come_near_a_corner() {
    for seed in 0..5 {
        let settings = Settings::new(vec![1.0; 4], vec![0.5; 4], seed);
        let error = corner_error(settings.clone(), 200);
        assert!(error < 0.1, "seed {seed}: {error:e}");
        let error = corner_error(Settings { covariance: CovarianceKind::Separable, ..settings }, 200);
        assert!(error < 1e-6, "separable, seed {seed}: {error:e}");
    }
}

/// Bounds that do not bind do not disturb.
#[test]
fn reflected_bounds_around_an_inner_optimum() {
    let settings = |seed| {
        let settings = Settings { bound_handling: BoundHandling::Reflect, ..plain(10, seed) };
        settings.with_bounds(vec![-0.1; 10], vec![2.0; 10])
    };
    reaches("ellipsoid in a box", settings, ellipsoid, 1e-10, 8_000);
}

/// A third of the candidates fail; the search still converges, and never panics.
#[test]
fn failed_candidates_do_not_stop_the_search() {
    let mut settings = plain(5, 3);
    settings.tolerances.target_cost = Some(1e-8);
    let mut cma = Cma::new(settings).unwrap();
    while cma.stop().is_none() {
        assert!(cma.evaluations() < 6_000);
        let population = cma.ask();
        let costs: Vec<f64> = (0..)
            .zip(population.x())
            .map(|(k, x)| match (k + cma.generation()) % 6 {
                0 => f64::NAN,
                1 => f64::INFINITY,
                _ => sphere(x),
            })
            .collect();
        cma.tell(&population, &costs).unwrap();
    }
    assert_eq!(cma.stop(), Some(StopReason::TargetCost));
}

#[test]
fn a_generation_of_failures_leaves_the_distribution() {
    let mut cma = Cma::new(plain(3, 1)).unwrap();
    let population = cma.ask();
    cma.tell(&population, &vec![f64::NAN; population.x().len()]).unwrap();
    assert_eq!((cma.generation(), cma.sigma(), cma.best()), (1, 1.0, None));
    assert_ne!(cma.ask().x(), population.x(), "the next generation draws anew");
}

/// A cost that falls for ever ends by a criterion, not by overflow.
#[test]
fn divergence_ends() {
    let mut cma = Cma::new(plain(3, 1)).unwrap();
    while cma.stop().is_none() {
        assert!(cma.generation() < 500);
        let population = cma.ask();
        let costs: Vec<f64> = population.x().iter().map(|x| x[0]).collect();
        cma.tell(&population, &costs).unwrap();
    }
    assert_eq!(cma.stop(), Some(StopReason::TolXUp));
}

/// Doubling populations solve Rastrigin where the default population gets caught.
#[test]
fn restarts_with_doubling_population() {
    let mut settings = Settings::new(vec![3.0; 4], vec![1.0; 4], 5).with_bounds(vec![-5.0; 4], vec![5.0; 4]);
    settings.tolerances.target_cost = Some(1e-8);
    let plan = RestartPlan { runs: 9, population_factor: 2, start: RestartStart::Uniform };
    let mut search = Search::new(settings, plan).unwrap();
    while !search.is_finished() {
        let population = search.ask();
        let costs: Vec<f64> = population.x().iter().map(|x| rastrigin(x)).collect();
        search.tell(&population, &costs).unwrap();
    }
    let runs = search.finished();
    assert!(runs.len() > 1, "the first run was meant to fail");
    assert_eq!(runs[1].population, 2 * runs[0].population);
    assert_eq!(runs.last().unwrap().stop, StopReason::TargetCost);
    assert!(search.best().unwrap().cost <= 1e-8);
    assert!(runs.windows(2).all(|pair| pair[0].seed != pair[1].seed));
    println!("rastrigin with restarts: {} runs, {} evaluations", runs.len(), search.evaluations());
}
