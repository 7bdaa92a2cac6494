//! Pieces that the pages of several commands are made of.

use crate::Error;
use crate::machine::machine;
use crate::search::Metric;
use gaitfit_adapt::fit::{ParameterOutcome, RunOutcome};
use gaitfit_view::Setting;
use gaitfit_view::fit::{Bound, OptimizerRun, Parameter};
use serde::Serialize;

/// A fitted parameter, without what is known of it from elsewhere.
pub fn parameter(found: &ParameterOutcome) -> Parameter {
    let bound =
        if found.value - found.lower < found.upper - found.value { Bound::Lower } else { Bound::Upper };
    Parameter {
        name: found.name.clone(),
        unit: if found.unit == "-" { String::new() } else { found.unit.clone() },
        value: found.value,
        lower: found.lower,
        upper: found.upper,
        start: found.start,
        spread: found.spread.unwrap_or(f64::NAN),
        per_run: found.per_run.clone(),
        at_bound: found.at_bound.then_some(bound),
        published: None,
        identified: found.identification.as_ref().map(|identification| identification.identified),
        interval: found.identification.as_ref().map(|one| [one.lower, one.upper]),
        truth: None,
    }
}

/// The courses of a cost's runs, from the lines of the metrics file.
pub fn runs(cost: &str, runs: &[RunOutcome], metrics: &str) -> Vec<OptimizerRun> {
    let metrics: Vec<Metric> = metrics.lines().filter_map(|line| serde_json::from_str(line).ok()).collect();
    let run = |run: &RunOutcome| {
        let own: Vec<&Metric> =
            metrics.iter().filter(|metric| metric.run.cost == cost && metric.run.seed == run.seed).collect();
        OptimizerRun {
            label: format!("seed {}", run.seed),
            best_cost: run.best_cost,
            best: own.iter().map(|metric| metric.run.best).collect(),
            mean: own.iter().map(|metric| metric.run.mean).collect(),
            sigma: own.iter().map(|metric| metric.run.sigma).collect(),
        }
    };
    runs.iter().map(run).collect()
}

/// Wasserstein-1 distance of simulated and measured samples; NaN where one is not finite.
pub fn distance(simulated: &[f64], measured: &[f64]) -> f64 {
    if simulated.iter().chain(measured).any(|value| !value.is_finite()) {
        return f64::NAN;
    }
    let mut simulated: Vec<f32> = simulated.iter().map(|value| *value as f32).collect();
    let mut measured = measured.to_vec();
    simulated.sort_by(f32::total_cmp);
    measured.sort_by(f64::total_cmp);
    gaitfit_adapt::cost::wasserstein1(&simulated, &measured)
}

/// A resolved configuration, one line a value.
pub fn settings<C: Serialize>(config: &C) -> Result<Vec<Setting>, Error> {
    fn flatten(name: &str, value: &toml::Value, into: &mut Vec<Setting>) {
        match value {
            toml::Value::Table(table) => {
                for (key, value) in table {
                    let name = if name.is_empty() { key.clone() } else { format!("{name}.{key}") };
                    flatten(&name, value, into);
                }
            }
            toml::Value::Array(array) if array.iter().any(toml::Value::is_table) => {
                for (index, value) in array.iter().enumerate() {
                    flatten(&format!("{name}.{index}"), value, into);
                }
            }
            _ => into.push(Setting { name: name.to_owned(), value: value.to_string() }),
        }
    }
    let value = toml::Value::try_from(config)
        .map_err(|error| Error::failed(format!("cannot list the settings: {error}")))?;
    let mut settings = Vec::new();
    flatten("", &value, &mut settings);
    Ok(settings)
}

/// Program and machine.
pub fn versions() -> Vec<Setting> {
    let machine = machine();
    [
        ("gaitfit", machine.gaitfit.to_owned()),
        ("platform", machine.platform),
        ("processor", machine.processor),
        ("threads", machine.threads.to_string()),
        ("features", machine.features.join(", ")),
    ]
    .map(|(name, value)| Setting { name: name.to_owned(), value })
    .to_vec()
}
