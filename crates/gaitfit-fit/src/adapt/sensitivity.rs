//! How precisely logs can tell each parameter of a fit, before any fit is made.

use super::setup::Setup;
use crate::Error;
use crate::settings::{AdaptConfig, Base};
use gaitfit_adapt::fit::{MAX_IDENTIFIED_SHARE, Problem, Sensitivity, off_bounds, sensitivity as measured};
use gaitfit_adapt::{Entry, SavedParameter, Theta};
use gaitfit_model::shown_number;
use serde::{Deserialize, Serialize};
use std::path::Path;

/// Correlations above this make two parameters hard to tell apart.
const ALIKE: f64 = 0.8;

/// Precision with which logs identify the parameters.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SensitivityResults {
    /// Robot name.
    pub robot: String,
    /// Name of the cost whose differences are looked at: the configuration's first.
    pub cost_name: String,
    /// Logs.
    pub logs: usize,
    /// Root mean square of the differences that the deviations hold for, where the robot's range is 2.
    pub difference: f64,
    /// Time over which differences count as one, s.
    pub together_seconds: f64,
    /// The parameters.
    pub parameters: Vec<ParameterSensitivity>,
    /// Facts to know before trusting the numbers.
    pub warnings: Vec<String>,
}

/// Precision with which logs identify a parameter.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct ParameterSensitivity {
    /// Its name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// The value at which this holds.
    pub value: f64,
    /// Standard deviation to expect of a fit; absent if the logs do not identify it.
    pub deviation: Option<f64>,
    /// The same if all other parameters were known.
    pub alone: Option<f64>,
    /// Whether a 95 % interval covers less than half of its bounds.
    #[serde(rename = "told")]
    pub identified: bool,
    /// The parameter whose estimate goes most with this one's, and their correlation, where it is above 0.8.
    pub like: Option<(String, f64)>,
}

/// Whether a 95 % interval of an estimate with this standard deviation covers less than half of the entry's bounds.
pub fn identifies(entry: &Entry, deviation: f64) -> bool {
    // A 95 % interval is about four standard deviations wide.
    4.0 * deviation < MAX_IDENTIFIED_SHARE * (entry.upper - entry.lower)
}

/// `value`, if the search of `entry` could find it; `place` says where it is written.
fn within(entry: &Entry, value: f64, place: &str) -> Result<f64, Error> {
    // A value on a bound may lie a little beyond it where it was rounded for a file.
    let slack = 1e-6 * (entry.upper - entry.lower);
    if value >= entry.lower - slack && value <= entry.upper + slack {
        return Ok(value.clamp(entry.lower, entry.upper));
    }
    Err(Error::settings(format!(
        "{place} gives `{}` the value {}, and the search's bounds are {} to {}; correct the value, or widen `lower` and \
         `upper` of its rule",
        entry.name,
        shown_number(value),
        shown_number(entry.lower),
        shown_number(entry.upper)
    )))
}

/// Values of every entry of θ: those of `path`, a fit's theta.toml, or where it does not name them of the configuration's
/// `[truth]`, or else the start of the search.
///
/// # Errors
/// A file that cannot be read or names none of them; values beyond the search's bounds.
pub fn known_values(config: &AdaptConfig, theta: &Theta, path: Option<&Path>) -> Result<Vec<f64>, Error> {
    let of_file = path.map_or_else(String::new, |path| path.display().to_string());
    let file = path.map(crate::theta::read).transpose()?;
    let saved: &[SavedParameter] = file.as_ref().map_or(&[], |file| &file.parameter);
    let entries = theta.entries();
    let named = |entry: &Entry| saved.iter().find(|one| one.name == entry.name).map(|one| one.value);
    // A file of another fit would silently leave all values at their starts.
    if !saved.is_empty() && !entries.iter().any(|entry| named(entry).is_some()) {
        let names: Vec<&str> = entries.iter().map(|entry| entry.name.as_str()).collect();
        return Err(Error::settings(format!(
            "{of_file} names none of the fit's parameters ({}); give the theta.toml of this fit",
            names.join(", ")
        )));
    }
    let value = |(entry, start): (&Entry, f64)| {
        let stated = || config.truth.get(&entry.name).map(|value| (*value, "[truth]".to_owned()));
        // The file wins over `[truth]`, and both over the start.
        match named(entry).map(|value| (value, of_file.clone())).or_else(stated) {
            Some((known, place)) => within(entry, known, &place),
            // On a bound one of the two neighbours is missing, and the derivative with it.
            None => Ok(off_bounds(entry, start)),
        }
    };
    entries.iter().zip(theta.start(config.optimizer.seed)).map(value).collect()
}

/// Measures it on the logs of `setup` around the values of `theta`, a fit's theta.toml, or where it does not name them of the
/// configuration's `[truth]`, or else the start of the search. `difference`: what the fitted simulator will differ by;
/// without it, what these values do.
///
/// # Errors
/// A file that cannot be read; a cost that compares distributions; a simulation that diverges.
pub fn sensitivity(
    setup: &Setup,
    theta: Option<&Path>,
    difference: Option<f64>,
) -> Result<SensitivityResults, Error> {
    let values = known_values(&setup.config, &setup.theta, theta)?;
    let cost = setup.costs[0].as_ref();
    // Distributions have no differences of single samples to derive.
    if cost.differences().is_none() {
        let comparing = if setup.config.base == Base::Free { "matchr" } else { "matcho" };
        return Err(Error::settings(format!(
            "sensitivity looks at differences sample by sample, and the configuration's first cost, `{}`, compares \
             distributions; name one that compares samples first: --set 'costs=[\"{comparing}\"]'",
            cost.name()
        )));
    }
    let simulator = setup.fit.simulator.as_ref();
    let problem = Problem { simulator, theta: &setup.theta, cost, draw: 0, cancel: &gaitfit_adapt::never };
    let (sensitivity, parameters) = sensitivities(problem, &values, difference)?.ok_or_else(|| {
        Error::failed(
            "the simulation of these values diverges: give others with --theta, or a smaller simulation.timestep",
        )
    })?;
    // Logs that are fitted together share one rate.
    let dt = setup.fit.logs.first().map_or(0.0, |log| log.trajectory.dt());
    Ok(SensitivityResults {
        robot: setup.method.model().name.clone(),
        cost_name: cost.name().to_owned(),
        logs: setup.fit.logs.len(),
        difference: sensitivity.difference,
        together_seconds: sensitivity.together * dt,
        parameters,
        warnings: setup.warnings.clone(),
    })
}

/// Precision with which the logs of `problem` identify every entry of θ around `values`; `None` if the simulation
/// there diverges.
///
/// # Errors
/// The errors of [`sensitivity`].
pub fn sensitivities(
    problem: Problem<'_>,
    values: &[f64],
    difference: Option<f64>,
) -> Result<Option<(Sensitivity, Vec<ParameterSensitivity>)>, Error> {
    let entries = problem.theta.entries();
    let Some(sensitivity) = measured(problem, values, difference).map_err(Error::failed)? else {
        return Ok(None);
    };
    let of_entry = |at: usize| {
        let entry = &entries[at];
        let deviation = sensitivity.deviation[at];
        let correlations =
            // Every estimate goes completely with itself.
            sensitivity.correlation[at].iter().copied().enumerate().filter(|(other, _)| *other != at);
        let like = correlations.max_by(|a, b| a.1.abs().total_cmp(&b.1.abs()));
        ParameterSensitivity {
            name: entry.name.clone(),
            unit: entry.unit.clone(),
            value: values[at],
            deviation,
            alone: sensitivity.alone[at],
            identified: deviation.is_some_and(|one| identifies(entry, one)),
            like: like
                .filter(|(_, correlation)| correlation.abs() > ALIKE)
                .map(|(other, correlation)| (entries[other].name.clone(), correlation)),
        }
    };
    let parameters = (0..entries.len()).map(of_entry).collect();
    Ok(Some((sensitivity, parameters)))
}
