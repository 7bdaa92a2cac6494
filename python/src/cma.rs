//! CMA-ES alone: ask and tell.

use crate::errors::value;
use gaitfit_adapt::cmaes::{self, BoundHandling, CovarianceKind, Population, Settings, State};
use numpy::{PyArray1, PyArray2, PyReadonlyArray1};
use pyo3::prelude::*;

/// A run of CMA-ES. The Python class around it has the documentation.
#[pyclass(module = "gaitfit._gaitfit")]
pub struct Cma {
    run: cmaes::Cma,
    asked: Option<Population>,
}

#[pymethods]
impl Cma {
    #[new]
    #[pyo3(signature = (start, deviation, seed, lower, upper, population, reflect, separable, state))]
    fn new(
        start: Vec<f64>,
        deviation: Vec<f64>,
        seed: u64,
        lower: Option<Vec<f64>>,
        upper: Option<Vec<f64>>,
        population: Option<usize>,
        reflect: bool,
        separable: bool,
        state: Option<&str>,
    ) -> PyResult<Self> {
        let mut settings = Settings::new(start, deviation, seed);
        settings.lower = lower.unwrap_or(settings.lower);
        settings.upper = upper.unwrap_or(settings.upper);
        settings.population = population.unwrap_or(settings.population);
        settings.bound_handling = if reflect { BoundHandling::Reflect } else { BoundHandling::Resample };
        settings.covariance = if separable { CovarianceKind::Separable } else { CovarianceKind::Full };
        let run = match state {
            None => cmaes::Cma::new(settings),
            Some(text) => {
                let state: State =
                    serde_json::from_str(text).map_err(|error| value(format!("state: {error}")))?;
                cmaes::Cma::resume(settings, state)
            }
        };
        Ok(Self { run: run.map_err(value)?, asked: None })
    }

    /// The candidates of this generation, `population × n`; the same ones until they are result.
    fn ask<'py>(&mut self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<f64>>> {
        let run = &self.run;
        let population = py.detach(|| run.ask());
        let array = PyArray2::from_vec2(py, population.x()).map_err(value)?;
        self.asked = Some(population);
        Ok(array)
    }

    /// What the candidates that were asked for cost.
    fn tell(&mut self, py: Python<'_>, costs: PyReadonlyArray1<'_, f64>) -> PyResult<()> {
        let Some(population) = self.asked.take() else {
            return Err(value("tell() without ask(): there are no candidates that these costs could be of"));
        };
        let costs = costs.as_array().to_vec();
        let run = &mut self.run;
        let result = py.detach(|| run.tell(&population, &costs));
        if result.is_err() {
            self.asked = Some(population);
        }
        result.map_err(value)
    }

    /// Why the run has ended, or nothing.
    fn stop(&self) -> PyResult<Option<String>> {
        let name = |reason| serde_json::to_value(reason).map_err(value);
        let Some(reason) = self.run.stop() else { return Ok(None) };
        Ok(name(reason)?.as_str().map(str::to_owned))
    }

    /// The best candidate so far with its cost.
    fn best<'py>(&self, py: Python<'py>) -> Option<(Bound<'py, PyArray1<f64>>, f64)> {
        self.run.best().map(|best| (PyArray1::from_slice(py, &best.x), best.cost))
    }

    fn mean<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.run.mean())
    }

    fn deviations<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f64>> {
        PyArray1::from_vec(py, self.run.deviations())
    }

    fn sigma(&self) -> f64 {
        self.run.sigma()
    }

    fn generation(&self) -> u32 {
        self.run.generation()
    }

    fn evaluations(&self) -> u64 {
        self.run.evaluations()
    }

    /// All that changes, as JSON.
    fn state(&self) -> PyResult<String> {
        serde_json::to_string(self.run.state()).map_err(value)
    }
}
