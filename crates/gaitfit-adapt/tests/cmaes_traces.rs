//! CMA-ES against the Python package `cmaes` 0.13, generation by generation on the same normal draws
//! (tools/make_cmaes_traces.py).
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

use gaitfit_adapt::cmaes::{Cma, Covariance, CovarianceKind, NormalSource, Settings};
use serde::Deserialize;

#[derive(Deserialize)]
struct Traces {
    traces: Vec<Trace>,
}

#[derive(Deserialize)]
struct Trace {
    name: String,
    kind: CovarianceKind,
    function: String,
    start: Vec<f64>,
    deviation: Vec<f64>,
    sigma: f64,
    bounds: Option<Vec<[f64; 2]>>,
    population: usize,
    resampling: u32,
    generations: Vec<Generation>,
}

#[derive(Deserialize)]
struct Generation {
    /// By candidate, attempt and coordinate.
    draws: Vec<Vec<Vec<f64>>>,
    mean: Vec<f64>,
    sigma: f64,
    /// Lower triangle by rows, or the diagonal.
    covariance: Option<Vec<f64>>,
    stop: bool,
}

/// The recorded draws; asking for one the package did not draw fails the test.
struct Recorded<'a>(&'a [Generation]);

impl NormalSource for Recorded<'_> {
    fn fill(&self, generation: u32, candidate: u32, attempt: u32, out: &mut [f64]) {
        out.copy_from_slice(&self.0[generation as usize].draws[candidate as usize][attempt as usize]);
    }
}

fn function(name: &str, x: &[f64]) -> f64 {
    match name {
        "sphere" => x.iter().map(|x| x * x).sum(),
        "rosenbrock" => {
            x.windows(2).map(|p| 100.0 * (p[1] - p[0] * p[0]).powi(2) + (1.0 - p[0]).powi(2)).sum()
        }
        "ellipsoid" => {
            let last = (x.len() - 1) as f64;
            x.iter().enumerate().map(|(i, x)| 10_f64.powf(4.0 * i as f64 / last) * x * x).sum()
        }
        other => panic!("unknown function {other}"),
    }
}

#[test]
fn every_generation_agrees_with_the_package() {
    let traces: Traces = serde_json::from_str(include_str!("fixtures/cmaes_traces.json")).unwrap();
    assert_eq!(traces.traces.len(), 11);
    for trace in &traces.traces {
        let settings = Settings {
            sigma: trace.sigma,
            covariance: trace.kind,
            population: trace.population,
            max_resampling: trace.resampling,
            ..Settings::new(trace.start.clone(), trace.deviation.clone(), 0)
        };
        let settings = match &trace.bounds {
            Some(bounds) => settings
                .with_bounds(bounds.iter().map(|b| b[0]).collect(), bounds.iter().map(|b| b[1]).collect()),
            None => settings,
        };
        let mut cma = Cma::new(settings).unwrap();
        let mut worst = 0.0_f64;
        let (mut redrawn, mut clipped) = (0, 0);
        for (number, expected) in trace.generations.iter().enumerate() {
            let population = cma.ask_from(&Recorded(&trace.generations));
            redrawn += expected.draws.iter().filter(|draws| draws.len() > 1).count();
            clipped += expected.draws.iter().filter(|draws| draws.len() as u32 > trace.resampling).count();
            let costs: Vec<f64> = population.x().iter().map(|x| function(&trace.function, x)).collect();
            cma.tell(&population, &costs).unwrap();

            // Distances in units of the step size: near the optimum the mean itself is small.
            let state = cma.state();
            for (ours, theirs) in state.mean.iter().zip(&expected.mean) {
                worst = worst.max((ours - theirs).abs() / expected.sigma);
            }
            worst = worst.max((state.sigma / expected.sigma - 1.0).abs());
            if let Some(covariance) = &expected.covariance {
                let size = covariance.iter().fold(0.0_f64, |size, value| size.max(value.abs()));
                for (ours, theirs) in triangle(&state.covariance).iter().zip(covariance) {
                    worst = worst.max((ours - theirs).abs() / size);
                }
            }
            assert!(worst < 1e-9, "{}: {worst:e} in generation {number}", trace.name);
            assert_eq!(cma.stop().is_some(), expected.stop, "{} in generation {number}", trace.name);
        }
        println!("{}: largest difference {worst:.1e}, {redrawn} redrawn, {clipped} clipped", trace.name);
        assert_eq!(redrawn > 0, trace.bounds.is_some(), "{}: the bounds are not exercised", trace.name);
        assert!(clipped > 0 || trace.resampling >= 8, "{}: clipping is not exercised", trace.name);
    }
}

fn triangle(covariance: &Covariance) -> Vec<f64> {
    match covariance {
        Covariance::Full { c, d, .. } => {
            let n = d.len();
            (0..n).flat_map(|i| (0..=i).map(move |j| c[i * n + j])).collect()
        }
        Covariance::Separable { c, .. } => c.clone(),
    }
}
