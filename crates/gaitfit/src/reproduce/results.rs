//! Results of a table: the one document that `--json` prints, `result.json` keeps, and table and plot show.

use super::paper::Kind;
use crate::adapt::CostFit;
use crate::evaluate::{DriftResult, Evaluation, of_few};
use gaitfit_view::Estimate;
use indexmap::IndexMap;
use serde::{Deserialize, Serialize};

/// A table.
#[derive(Clone, Debug, Serialize)]
pub struct Results {
    /// Its name.
    pub table: String,
    /// What it shows.
    pub title: String,
    /// What its cells went through.
    pub kind: Kind,
    /// Whether it was run at the paper's scale.
    pub full: bool,
    /// One a cell; for fine-tuning, the references come first.
    pub rows: Vec<Row>,
    /// Where the files are.
    pub run_folder: String,
}

/// A cell over its seeds. Of several seeds, means over them, and intervals by Student's t over the seeds' means; of
/// one seed, an evaluation's own intervals.
#[derive(Clone, Debug, Serialize)]
pub struct Row {
    /// Its name: scenario-modification-cost, or scenario-pi0, -reference, -nominal and -randomised.
    pub cell: String,
    /// What is different on the target.
    pub scenario: String,
    /// What was fitted; absent of references.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub modification: Option<String>,
    /// What was minimised; absent of references.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cost: Option<String>,
    /// Error of each parameter with a known truth, |value / truth − 1|, percent.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub errors_percent: IndexMap<String, Estimate>,
    /// Mean of these.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_error_percent: Option<Estimate>,
    /// Smallest value of the cost.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub cost_value: Option<Estimate>,
    /// How the policy walks on the target.
    #[serde(flatten, skip_serializing_if = "Option::is_none")]
    pub walk: Option<Walk>,
    /// Wall time, all seeds, s.
    pub seconds: f64,
    /// What the paper has.
    pub paper: PaperRow,
    /// The seeds one by one.
    pub seeds: Vec<SeedResult>,
}

/// The paper's numbers of a cell.
#[derive(Clone, Debug, Default, Serialize)]
pub struct PaperRow {
    /// Error of each parameter, percent.
    #[serde(skip_serializing_if = "IndexMap::is_empty")]
    pub errors_percent: IndexMap<String, f64>,
    /// Their mean, percent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_error_percent: Option<f64>,
    /// What its text says where it prints no number.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub says: Option<String>,
}

/// Result of one seed of a cell; `seed.json`.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SeedResult {
    /// Which, from 1.
    pub seed: u64,
    /// The fit.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub fit: Option<SeedFit>,
    /// How the policy walks on the target.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub walk: Option<Walk>,
    /// Wall time of fit and training, s; collecting does not count, as cells share their logs.
    pub seconds: f64,
    /// What to know of the fit before trusting its numbers. What is to be said of the logs stands in the fit's own
    /// `result.json`: all cells of a scenario share them.
    pub warnings: Vec<String>,
    /// Where the files are.
    pub run_folder: String,
}

/// A fit.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct SeedFit {
    /// Parameters that were found; those of networks are in `theta.toml` only.
    pub values: IndexMap<String, f64>,
    /// Their errors, percent, where the truth is known.
    pub errors_percent: IndexMap<String, f64>,
    /// Mean of these.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_error_percent: Option<f64>,
    /// Smallest value of the cost.
    pub cost: f64,
    /// Its value before the fit; absent if that diverged.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub nominal_cost: Option<f64>,
    /// Wall time, s.
    pub seconds: f64,
}

/// Measures of a policy's walk under random commands.
#[derive(Clone, Copy, Debug, Serialize, Deserialize)]
pub struct Walk {
    /// Summed reward.
    pub reward: Estimate,
    /// |v − c|, horizontal, m/s.
    pub linear_velocity_error: Estimate,
    /// |ω − c|, rad/s.
    pub angular_velocity_error: Estimate,
    /// Share of falls.
    pub fall_rate: Estimate,
    /// Mean distance from where constant commands lead, m; absent where it was not measured.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub drift: Option<Estimate>,
}

/// Entries of θ that are written one by one: more are a network's weights.
const MAX_SHOWN: usize = 50;

impl SeedFit {
    /// The result of a fit of one cost that took so many seconds.
    pub fn new(fit: &CostFit, seconds: f64) -> Self {
        let shown = if fit.parameters.len() <= MAX_SHOWN { fit.parameters.as_slice() } else { &[] };
        let error = |value: f64, truth: f64| 100.0 * (value / truth - 1.0).abs();
        Self {
            values: shown.iter().map(|one| (one.found.name.clone(), one.found.value)).collect(),
            errors_percent: shown
                .iter()
                .filter_map(|one| {
                    // A share of 0 means nothing.
                    let truth = one.truth.filter(|truth| *truth != 0.0)?;
                    Some((one.found.name.clone(), error(one.found.value, truth)))
                })
                .collect(),
            mean_error_percent: fit.mean_error_percent,
            cost: fit.cost,
            nominal_cost: fit.nominal_cost,
            seconds,
        }
    }
}

impl From<&Evaluation> for Walk {
    fn from(evaluation: &Evaluation) -> Self {
        Self {
            reward: evaluation.reward,
            linear_velocity_error: evaluation.linear_velocity_error,
            angular_velocity_error: evaluation.angular_velocity_error,
            fall_rate: evaluation.fall_rate,
            drift: drift(evaluation),
        }
    }
}

/// Mean over the commands under which any robot stood to the end; the paper's hardware tables have one robot, so there is
/// no interval.
fn drift(evaluation: &Evaluation) -> Option<Estimate> {
    let distances: Vec<f64> =
        evaluation.drift.iter().map(DriftResult::distance).filter(|distance| distance.is_finite()).collect();
    let mean = gaitfit_sim::stats::mean(&distances)?;
    Some(Estimate { mean, ci95: f64::NAN })
}

impl Row {
    /// The row of a cell; `parts`: modification and cost, none of references.
    pub fn new(
        cell: String,
        scenario: String,
        parts: Option<[&str; 2]>,
        seeds: Vec<SeedResult>,
        paper: PaperRow,
    ) -> Self {
        let fits: Vec<&SeedFit> = seeds.iter().filter_map(|seed| seed.fit.as_ref()).collect();
        let over = |of: &dyn Fn(&SeedFit) -> Option<f64>| -> Vec<f64> {
            fits.iter().filter_map(|fit| of(fit)).collect()
        };
        // All seeds fit the same parameters.
        let names = fits.first().map(|fit| fit.errors_percent.keys().cloned().collect::<Vec<_>>());
        let errors_percent = names
            .unwrap_or_default()
            .into_iter()
            .map(|name| {
                let errors = over(&|fit| fit.errors_percent.get(&name).copied());
                (name, of_few(&errors))
            })
            .collect();
        // A table of trainings has no fits, and a table of fits no walks.
        let some = |values: Vec<f64>| (!values.is_empty()).then(|| of_few(&values));
        let mean_error_percent = some(over(&|fit| fit.mean_error_percent));
        let cost_value = some(over(&|fit| Some(fit.cost)));
        let walks: Vec<Walk> = seeds.iter().filter_map(|seed| seed.walk).collect();
        Self {
            cell,
            scenario,
            modification: parts.map(|[modification, _]| modification.to_owned()),
            cost: parts.map(|[_, cost]| cost.to_owned()),
            errors_percent,
            mean_error_percent,
            cost_value,
            walk: walk(&walks),
            seconds: seeds.iter().map(|seed| seed.seconds).sum(),
            paper,
            seeds,
        }
    }
}

/// The walk over seeds.
fn walk(walks: &[Walk]) -> Option<Walk> {
    let over_seeds = |which: fn(&Walk) -> Estimate| match walks {
        // A single seed keeps the interval over its trajectories; several have one over seeds.
        [one] => which(one),
        _ => of_few(&walks.iter().map(|walk| which(walk).mean).collect::<Vec<_>>()),
    };
    (!walks.is_empty()).then(|| Walk {
        reward: over_seeds(|walk| walk.reward),
        linear_velocity_error: over_seeds(|walk| walk.linear_velocity_error),
        angular_velocity_error: over_seeds(|walk| walk.angular_velocity_error),
        fall_rate: over_seeds(|walk| walk.fall_rate),
        drift: match walks {
            [one] => one.drift,
            _ => walks
                .iter()
                // One seed without drift trials leaves the mean out: a mean over fewer seeds would not compare.
                .map(|walk| Some(walk.drift?.mean))
                .collect::<Option<Vec<f64>>>()
                .map(|all| of_few(&all)),
        },
    })
}

impl Row {
    /// A row's name in tables and plots.
    pub fn label(&self) -> String {
        let scenario = &self.scenario;
        match self.cell.strip_prefix(scenario.as_str()) {
            Some("-pi0") => format!("π₀ ({scenario})"),
            Some("-reference") => format!("fine-tuned on the target ({scenario})"),
            Some("-nominal") => format!("fine-tuned, nominal ({scenario})"),
            Some("-randomised") => format!("fine-tuned, randomised ({scenario})"),
            _ => self.cell.clone(),
        }
    }
}

/// A mean, with its interval if it has one.
pub fn shown(estimate: Option<Estimate>, digits: usize) -> String {
    match estimate {
        Some(Estimate { mean, ci95 }) if ci95.is_finite() => format!("{mean:.digits$} ± {ci95:.digits$}"),
        Some(Estimate { mean, .. }) if mean.is_finite() => format!("{mean:.digits$}"),
        _ => "–".to_owned(),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn an_interval_over_seeds_is_students() {
        // Deviation 1, three values: 4.303 / √3.
        let estimate = of_few(&[1.0, 2.0, 3.0]);
        assert!((estimate.mean - 2.0).abs() < 1e-12 && (estimate.ci95 - 2.4843).abs() < 1e-3, "{estimate:?}");
        assert!(of_few(&[2.0]).ci95.is_nan());
    }

    #[test]
    fn one_seed_keeps_the_evaluations_interval_and_several_take_their_own() {
        let one = |mean: f64| Estimate { mean, ci95: 0.5 };
        let walk = |mean| Walk {
            reward: one(mean),
            linear_velocity_error: one(mean),
            angular_velocity_error: one(mean),
            fall_rate: one(mean),
            drift: Some(one(mean)),
        };
        let seed = |mean| SeedResult { walk: Some(walk(mean)), seconds: 2.0, ..SeedResult::default() };
        let row = |seeds| Row::new("a".to_owned(), "a".to_owned(), None, seeds, PaperRow::default());
        assert_eq!(row(vec![seed(3.0)]).walk.unwrap().reward, one(3.0));
        let both = row(vec![seed(1.0), seed(3.0)]);
        // Deviation √2, two values: 12.706 · √2 / √2.
        let reward = both.walk.unwrap().reward;
        assert!((reward.mean - 2.0).abs() < 1e-12 && (reward.ci95 - 12.706).abs() < 1e-9, "{reward:?}");
        assert_eq!(both.walk.unwrap().drift, Some(reward));
        assert_eq!(both.seconds, 4.0);
    }
}
