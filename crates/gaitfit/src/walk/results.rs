//! What a fit of walking logs found, as the one document that `--json` prints, `result.json` keeps, and tables and
//! report show.

use super::scan::Scan;
use super::setup::Ground;
use super::simulator::GroundSimulator;
use crate::Error;
use crate::settings::AdaptConfig;
use crate::watch::Watch;
use gaitfit_adapt::Theta;
use gaitfit_adapt::cost::Cost;
use gaitfit_adapt::fit::{
    CostOutcome, FallPenalty, Job, MOST_SCANNED, ParameterOutcome, RunOutcome, evaluate,
};
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Most parameters that tables and reports show: a network of features on every joint of a quadruped and its friction
/// and armature; not the 97 weights of a whole network, which say nothing one by one.
pub const MOST_SHOWN: usize = 90;

/// The result of one ground fit.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct GroundResults {
    /// Name of the run.
    pub name: String,
    /// Robot name.
    pub robot: String,
    /// What each cost found; the first is the one whose θ is kept.
    pub fits: Vec<GroundFit>,
    /// Trajectories that were compared.
    pub trajectories: usize,
    /// What counts of them together, s.
    pub seconds: f64,
    /// Logs in which the robot fell, and which were cut there.
    pub falls: usize,
    /// How far the logs' actions are from the policy's, as a share of their spread; over what base sensors the logs
    /// lack, the nearest. 0 is the policy that was given.
    #[serde(default)]
    pub action_mismatch: f64,
    /// Parts of the command space without data, in words.
    pub uncovered: Vec<String>,
    /// What to know before trusting the numbers.
    pub warnings: Vec<String>,
    /// Where the files are.
    pub run_folder: String,
    /// Wall time of the search, over all its sessions, and of what measures its result, s.
    pub wall_seconds: f64,
}

/// What one cost found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct GroundFit {
    /// Cost name.
    pub cost_name: String,
    /// Its smallest value.
    pub cost: f64,
    /// Its value for the simulator before the fit; absent if that diverged.
    pub nominal_cost: Option<f64>,
    /// Falls of the fitted simulator's robots.
    pub falls: usize,
    /// Falls before the fit.
    pub nominal_falls: usize,
    /// θ as found.
    pub parameters: Vec<GroundParameter>,
    /// Mean over the parameters with a known truth of |value / truth − 1|, percent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_error_percent: Option<f64>,
    /// The runs, in seed order.
    pub runs: Vec<RunOutcome>,
}

/// One entry of θ as found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct GroundParameter {
    /// Value, unit, spread, bounds, identification.
    #[serde(flatten)]
    pub found: ParameterOutcome,
    /// True value, from the configuration's `[truth]`.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub truth: Option<f64>,
}

impl GroundFit {
    /// θ as found.
    pub fn values(&self) -> Vec<f64> {
        self.parameters.iter().map(|parameter| parameter.found.value).collect()
    }
}

/// Scores the outcomes of a finished fit, whose search took `wall_seconds`.
pub fn results(
    config: &AdaptConfig,
    ground: &Ground,
    simulator: &GroundSimulator<'_>,
    costs: &[Box<dyn Cost>],
    outcomes: &[CostOutcome],
    [name, run_folder]: [String; 2],
    wall_seconds: f64,
    watch: &Watch<'_>,
) -> Result<GroundResults, Error> {
    if outcomes.is_empty() {
        return Err(Error::failed(
            "no candidate of the fit could be simulated to the end: narrow the bounds, lower the deviations or take \
             a smaller simulation.timestep",
        ));
    }
    let begun = Instant::now();
    let mut warnings = ground.warnings.clone();
    let mut fits = Vec::with_capacity(outcomes.len());
    for outcome in outcomes {
        let Some(cost) = costs.iter().find(|cost| cost.name() == outcome.cost) else { continue };
        let mut outcome = outcome.clone();
        if ground.theta.len() <= MOST_SCANNED {
            let scan = Scan::new(simulator, cost.name(), watch);
            let found = outcome.identify(&scan, &ground.theta, cost.as_ref(), 0);
            if watch.stop() {
                return Err(Error::Interrupted(format!(
                    "interrupted after the search; {run_folder} has it, --resume continues"
                )));
            }
            found.map_err(Error::failed)?;
        }
        let fit = fit(config, ground, simulator, std::slice::from_ref(cost), outcome)?;
        warn(&fit, &mut warnings);
        fits.push(fit);
    }
    let model = ground.scene.walker.batch.model();
    Ok(GroundResults {
        name,
        robot: model.name.clone(),
        fits,
        trajectories: ground.notes.logs.len(),
        seconds: ground.notes.logs.iter().map(|log| log.trajectory.duration() - config.skip_seconds()).sum(),
        falls: ground.notes.falls(),
        action_mismatch: ground.notes.policy_match.mismatch,
        uncovered: ground.notes.uncovered(),
        warnings,
        run_folder,
        wall_seconds: wall_seconds + begun.elapsed().as_secs_f64(),
    })
}

fn fit(
    config: &AdaptConfig,
    ground: &Ground,
    simulator: &GroundSimulator<'_>,
    // The outcome's cost, alone.
    alone: &[Box<dyn Cost>],
    outcome: CostOutcome,
) -> Result<GroundFit, Error> {
    let score = |theta: &Theta, values: Vec<f64>| {
        let jobs = [Job { cost: 0, values, draw: 0 }];
        let found = evaluate(simulator, theta, alone, &FallPenalty::NONE, &jobs).map_err(Error::failed)?;
        Ok::<_, Error>(found.into_iter().next())
    };
    let fitted = score(&ground.theta, outcome.values())?;
    let nominal = score(&Theta::default(), Vec::new())?;
    let parameters: Vec<GroundParameter> = outcome
        .parameters
        .iter()
        .map(|found| GroundParameter { truth: config.truth.get(&found.name).copied(), found: found.clone() })
        .collect();
    let errors: Vec<f64> = parameters
        .iter()
        .filter_map(|parameter| {
            let truth = parameter.truth.filter(|truth| *truth != 0.0)?;
            Some(100.0 * (parameter.found.value / truth - 1.0).abs())
        })
        .collect();
    Ok(GroundFit {
        cost_name: outcome.cost.clone(),
        cost: outcome.best_cost,
        nominal_cost: nominal.as_ref().and_then(|nominal| nominal.cost),
        falls: fitted.map_or(0, |fitted| fitted.falls),
        nominal_falls: nominal.map_or(0, |nominal| nominal.falls),
        mean_error_percent: (!errors.is_empty()).then(|| errors.iter().sum::<f64>() / errors.len() as f64),
        parameters,
        runs: outcome.runs,
    })
}

/// What a reader must know of one fit.
fn warn(fit: &GroundFit, warnings: &mut Vec<String>) {
    let mut better = Vec::new();
    for GroundParameter { found, .. } in &fit.parameters {
        let Some(identification) = &found.identification else { continue };
        if !identification.identified {
            let unit = if found.unit == "-" { String::new() } else { format!(" {}", found.unit) };
            warnings.push(format!(
                "{}: the logs do not identify {}: anything from {:.3} to {:.3}{unit} fits as well",
                fit.cost_name, found.name, identification.lower, identification.upper
            ));
        }
        better.extend(identification.better.map(|value| format!("{} = {value:.4}", found.name)));
    }
    if !better.is_empty() {
        let (verb, alone) = if better.len() == 1 { ("fits", "") } else { ("fit", ", each alone,") };
        warnings.push(format!(
            "{}: {}{alone} {verb} better than what the search found; give it more generations",
            fit.cost_name,
            better.join(", ")
        ));
    }
    if fit.falls > 0 {
        warnings.push(format!(
            "{}: the fitted robot falls in {} of the logs: a simulator that falls can match a bad log",
            fit.cost_name, fit.falls
        ));
    }
    if fit.nominal_cost.is_some_and(|nominal| nominal <= fit.cost) {
        warnings.push(format!(
            "{}: nothing fits better than the robot as it was; fit other parameters",
            fit.cost_name
        ));
    }
}
