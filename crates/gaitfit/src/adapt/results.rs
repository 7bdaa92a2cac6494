//! What a fit found, as the one document that `--json` prints, `result.json` keeps, and tables and report show.

use super::check::Check;
use super::doubts;
use super::held_out::{HeldOut, held_out};
use super::odd::OddJoints;
use super::outliers;
use super::score::{Robot, Score, Validation, baselines, joint_errors, mean, score, validation};
use super::setup::Setup;
use super::springs::FoundSpring;
use super::trust::identified;
use crate::Error;
use crate::run::RunFolder;
use crate::settings::CheckConfig;
use crate::watch::Watch;
use gaitfit_adapt::Theta;
use gaitfit_adapt::fit::{
    Agreement, Correction, CostOutcome, Evaluation, FallPenalty, FitError, Job, ParameterOutcome, Regression,
    RunGeneration, RunOutcome, Uncertainty, compare, evaluate,
};
use gaitfit_adapt::never;
use gaitfit_view::{Doubt, DoubtKind};
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Most parameters that tables and reports show: a network of features on every joint of a quadruped and its friction
/// and armature; not the 97 weights of a whole network, which say nothing one by one.
pub const MOST_SHOWN: usize = 90;

/// The result of one adaptation. What stands beside `fits` is its first one's.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AdaptResults {
    /// Name of the run.
    pub name: String,
    /// Robot name.
    pub robot: String,
    /// The result in a sentence, its doubts first.
    pub headline: String,
    /// Whether the search came to its end.
    pub converged: bool,
    /// Whether the fitted robot is closer to the logs than the robot before the fit.
    pub better_than_nominal: bool,
    /// Name of the cost.
    pub cost_name: String,
    /// Its value of the parameters on the fitted logs.
    pub cost: f64,
    /// Its value of the robot before the fit; absent if that diverged.
    pub nominal_cost: Option<f64>,
    /// θ as found.
    pub parameters: Vec<Parameter>,
    /// Springs that θ puts on joints.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub springs: Vec<FoundSpring>,
    /// Which joints differ from their siblings, if that was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub odd_joints: Option<OddJoints>,
    /// How well the fitted simulator predicts.
    pub fitted: Score,
    /// How well the robot before the fit does, and predictors that need no simulator.
    pub baselines: Vec<Score>,
    /// Prediction of logs that were not fitted.
    pub validation: Vec<Validation>,
    /// Walking logs that were not fitted: their distributions beside those of simulated walks, and a floor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held_out: Option<HeldOut>,
    /// What each cost found; the first is the one whose θ is kept.
    pub fits: Vec<CostFit>,
    /// Checks the configuration states.
    pub checks: Vec<Check>,
    /// What to know before trusting the numbers.
    pub warnings: Vec<String>,
    /// Logs, or stretches of logs, that were compared.
    pub trajectories: usize,
    /// What counts of them together, s.
    pub seconds: f64,
    /// Walking logs: those in which the robot fell, and which were cut there.
    pub falls: usize,
    /// Walking logs: how far their actions are from the policy's, as a share of their spread; over what base sensors
    /// the logs lack, the nearest. 0 is the policy that was given.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub action_mismatch: Option<f64>,
    /// Walking logs: parts of the command space without data, in words.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub uncovered: Vec<String>,
    /// Where the files are.
    pub run_folder: String,
    /// Wall time of the search, over all its sessions, and of what measures its result, s.
    pub wall_seconds: f64,
}

/// What one cost found.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct CostFit {
    /// Cost name.
    pub cost_name: String,
    /// Its value of the parameters: the smallest, or that of corrected ones.
    pub cost: f64,
    /// Its value of the robot before the fit; absent if that diverged.
    pub nominal_cost: Option<f64>,
    /// Whether the search came to its end.
    pub converged: bool,
    /// Whether the fitted robot is closer to the logs than the robot before the fit.
    pub better_than_nominal: bool,
    /// Why the fit must not be taken as it stands, the worst first.
    pub doubts: Vec<Doubt>,
    /// Falls of the fitted simulator's robots.
    pub falls: usize,
    /// Falls before the fit.
    pub nominal_falls: usize,
    /// θ as found.
    pub parameters: Vec<Parameter>,
    /// Mean over the parameters with a known truth of |value / truth − 1|, percent.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub mean_error_percent: Option<f64>,
    /// The runs, in seed order.
    pub runs: Vec<RunOutcome>,
    /// Prediction of logs that were not fitted.
    pub validation: Vec<Validation>,
    /// Joint uncertainty of the parameters, where least squares found them.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub uncertainty: Option<Uncertainty>,
    /// How simulated logs moved the values, where they did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub correction: Option<Correction>,
    /// How simulated robots moved the values, where they did.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub regression: Option<Regression>,
    /// Each parameter beside the first cost's; empty of the first cost.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub comparison: Vec<Agreement>,
}

/// One entry of θ as found, with what is known of it from elsewhere.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Parameter {
    /// Value, unit, spread, bounds, and how its interval was measured.
    #[serde(flatten)]
    pub found: ParameterOutcome,
    /// The values that fit as well, all others held: lower and upper end; absent where it was not measured.
    pub interval: Option<[f64; 2]>,
    /// Whether the logs determine it; absent where it was not measured.
    pub identified: Option<bool>,
    /// True value, from the configuration's `[truth]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub truth: Option<f64>,
    /// Published values, [smallest, largest], from the configuration's `[published]`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub published: Option<[f64; 2]>,
}

impl CostFit {
    /// θ as found.
    pub fn values(&self) -> Vec<f64> {
        self.parameters.iter().map(|parameter| parameter.found.value).collect()
    }

    /// The evidence of its doubts of a kind.
    fn doubt(&self, kind: DoubtKind) -> String {
        let of_kind = self.doubts.iter().filter(|doubt| doubt.kind == kind);
        of_kind.map(|doubt| doubt.text.as_str()).collect::<Vec<_>>().join(" ")
    }

    /// The fit in a sentence, its doubts first.
    pub fn headline(&self) -> String {
        if !self.doubts.is_empty() {
            let doubts = self.doubts.iter().map(|doubt| format!("{}: {}", doubt.kind.headline(), doubt.text));
            return doubts.collect::<Vec<_>>().join(" ");
        }
        let cost = format!("{} {:.5}", self.cost_name, self.cost);
        match self.nominal_cost {
            Some(nominal) if nominal > 0.0 => {
                let share = 100.0 * (1.0 - self.cost / nominal);
                format!(
                    "{cost}, {share:.0} % below the robot before the fit ({nominal:.5}); the search converged."
                )
            }
            _ => format!("{cost}; the robot before the fit diverges; the search converged."),
        }
    }
}

impl AdaptResults {
    /// The checks that failed, in words; none if all hold.
    pub fn failed_check(&self) -> Option<String> {
        super::check::failed(&self.checks)
    }

    /// Why the fit whose θ is kept must not be taken as it stands, the worst first: what its search says, what the logs
    /// say that were not fitted, and values that the search would have taken further.
    pub fn doubts(&self) -> Vec<Doubt> {
        let mut doubts = self.fits.first().map(|fit| fit.doubts.clone()).unwrap_or_default();
        doubts.extend(self.held_out.as_ref().and_then(HeldOut::doubt));
        let bound = |found: &&Parameter| doubts::stopped_by_bound(found);
        let bounded: Vec<&str> =
            self.parameters.iter().filter(bound).map(|found| found.found.name.as_str()).collect();
        if !bounded.is_empty() && doubts.iter().all(|doubt| doubt.kind != DoubtKind::Misfit) {
            let rest = if bounded.len() == 1 { "rests on a bound" } else { "rest on bounds" };
            let text = format!(
                "{} {rest} of the search: widen it, or fit what else may differ.",
                bounded.join(", ")
            );
            doubts.push(Doubt::new(DoubtKind::Misfit, text));
        }
        doubts.sort_by_key(|doubt| doubt.kind);
        doubts
    }

    /// What a fit must be known by elsewhere: the doubts of every cost, then the warnings.
    pub fn notes(&self) -> Vec<String> {
        let doubts = |fit: &CostFit| -> Vec<String> {
            let of = |doubt: &Doubt| format!("{}: {}: {}", fit.cost_name, doubt.kind.headline(), doubt.text);
            fit.doubts.iter().map(of).collect()
        };
        self.fits.iter().flat_map(doubts).chain(self.warnings.iter().cloned()).collect()
    }
}

/// Scores the outcomes of a finished fit, whose search took `wall_seconds`; `course`: the generations of its runs;
/// `odd_joints`: what the comparison of joints before it found.
pub(super) fn results(
    setup: &Setup,
    outcomes: &[CostOutcome],
    course: &[RunGeneration],
    odd_joints: Option<OddJoints>,
    folder: &RunFolder,
    wall_seconds: f64,
    watch: &Watch<'_>,
) -> Result<AdaptResults, Error> {
    let begun = Instant::now();
    let mut fits: Vec<CostFit> = Vec::with_capacity(outcomes.len());
    let mut found: Vec<CostOutcome> = Vec::with_capacity(outcomes.len());
    let mut uncorrected: Vec<String> = Vec::new();
    for outcome in outcomes {
        let Some(cost) = setup.costs.iter().position(|cost| cost.name() == outcome.cost) else { continue };
        let (outcome, refused) = identified(setup, cost, outcome.clone(), folder, watch)?;
        uncorrected.extend(refused.map(|reason| doubts::uncorrected(&outcome, &reason)));
        let mut fit = fit(setup, cost, &outcome, course)?;
        if let Some(first) = found.first().filter(|_| setup.theta.len() <= MOST_SHOWN) {
            fit.comparison = beside(setup, first, &outcome)?;
        }
        fits.push(fit);
        found.push(outcome);
    }
    if let Some(fit) = fits.first_mut().filter(|_| setup.aligned() && setup.method.walking().is_none()) {
        let (values, given) = (fit.values(), setup.config.costs[0].given());
        let robot = Robot { theta: &setup.theta, values: &values };
        fit.doubts.extend(outliers::doubt(&joint_errors(&setup.fit, |set| {
            robot.simulate(set.simulator.as_ref(), given)
        })?));
    }
    let Some(first) = fits.first().cloned() else {
        return Err(Error::failed(
            "no candidate of the fit could be simulated to the end: narrow the bounds, lower the deviations or take \
             a smaller simulation.timestep",
        ));
    };
    let robot = Robot { theta: &setup.theta, values: &first.values() };
    let given = setup.config.costs[0].given();
    let fitted = score("fitted simulator", setup, Some(first.cost), |set| {
        robot.simulate(set.simulator.as_ref(), given)
    })?;
    let mut warnings = setup.warnings.clone();
    warnings.extend(uncorrected);
    for fit in &fits {
        warnings.extend(doubts::warnings(fit, fits.len() > 1));
    }
    let notes = setup.notes.as_ref();
    let counted = |log: &crate::log::Log| log.trajectory.duration() - setup.config.skip_seconds();
    Ok(AdaptResults {
        name: setup.config.name.clone().unwrap_or_else(|| folder.name()),
        robot: setup.method.model().name.clone(),
        headline: first.headline(),
        converged: first.converged,
        better_than_nominal: first.better_than_nominal,
        cost_name: first.cost_name.clone(),
        cost: first.cost,
        nominal_cost: first.nominal_cost,
        parameters: first.parameters.clone(),
        springs: FoundSpring::of(&setup.theta, &first.values(), first.uncertainty.as_ref()),
        checks: checks(setup, &first, &fitted),
        baselines: baselines(setup, first.nominal_cost)?,
        fitted,
        validation: first.validation.clone(),
        held_out: beside_others(setup, robot)?,
        fits,
        warnings,
        trajectories: setup.fit.logs.len(),
        seconds: setup.fit.logs.iter().map(counted).sum(),
        falls: notes.map_or(0, |notes| notes.falls()),
        action_mismatch: notes.map(|notes| notes.policy_match.mismatch),
        uncovered: notes.map(|notes| notes.uncovered()).unwrap_or_default(),
        run_folder: folder.path().display().to_string(),
        wall_seconds: wall_seconds
            + odd_joints.as_ref().map_or(0.0, |odd| odd.wall_seconds)
            + begun.elapsed().as_secs_f64(),
        odd_joints,
    })
}

/// Walks under the commands of the logs that were not fitted, beside them.
fn beside_others(setup: &Setup, robot: Robot<'_>) -> Result<Option<HeldOut>, Error> {
    let Some(set) = setup.validate.first() else { return Ok(None) };
    let (theta, values): (Theta, &[f64]) = (Theta::default(), &[]);
    let before = Robot { theta: &theta, values };
    held_out(&setup.config, &setup.method, [(set, robot), (set, before)])
}

/// One evaluation of a robot by cost number `cost`, without a charge for falls.
fn evaluated(
    setup: &Setup,
    cost: usize,
    theta: &Theta,
    values: Vec<f64>,
) -> Result<Option<Evaluation>, Error> {
    let jobs = [Job { cost, values, draw: 0 }];
    let simulator = setup.fit.simulator.as_ref();
    let found =
        evaluate(simulator, theta, &setup.costs, &FallPenalty::NONE, &jobs, &never).map_err(Error::failed)?;
    Ok(found.into_iter().next())
}

fn fit(
    setup: &Setup,
    cost: usize,
    outcome: &CostOutcome,
    course: &[RunGeneration],
) -> Result<CostFit, Error> {
    let config = &setup.config;
    let values = outcome.values();
    let fitted = evaluated(setup, cost, &setup.theta, values.clone())?;
    let nominal = evaluated(setup, cost, &Theta::default(), Vec::new())?;
    let (nominal_cost, nominal_falls) = nominal.map_or((None, 0), |nominal| (nominal.cost, nominal.falls));
    let doubts = doubts::doubts(outcome, nominal_cost, nominal_falls, course);
    let has = |kind| doubts.iter().any(|doubt| doubt.kind == kind);
    let parameters: Vec<Parameter> = outcome
        .parameters
        .iter()
        .map(|found| Parameter {
            truth: config.truth.get(&found.name).copied(),
            published: config.published.get(&found.name).copied(),
            interval: found.identification.as_ref().map(|one| [one.lower, one.upper]),
            identified: found.identification.as_ref().map(|one| one.identified),
            found: found.clone(),
        })
        .collect();
    let error = |parameter: &Parameter| {
        let truth = parameter.truth.filter(|truth| *truth != 0.0)?;
        Some(100.0 * (parameter.found.value / truth - 1.0).abs())
    };
    let errors = parameters.iter().filter_map(error).map(Some);
    let theta = Theta::default();
    let (robot, before) =
        (Robot { theta: &setup.theta, values: &values }, Robot { theta: &theta, values: &[] });
    Ok(CostFit {
        cost_name: outcome.cost.clone(),
        cost: outcome.best_cost,
        nominal_cost,
        converged: !has(DoubtKind::NotConverged),
        better_than_nominal: !has(DoubtKind::WorseThanNominal),
        doubts,
        falls: fitted.map_or(0, |fitted| fitted.falls),
        nominal_falls,
        mean_error_percent: mean(errors),
        validation: validation(
            config.costs[cost],
            &setup.validate,
            setup.aligned(),
            |set| robot.simulate(set.simulator.as_ref(), config.costs[cost].given()),
            |set| before.simulate(set.simulator.as_ref(), config.costs[cost].given()),
        )?,
        parameters,
        runs: outcome.runs.clone(),
        uncertainty: outcome.uncertainty.clone(),
        correction: outcome.correction.clone(),
        regression: outcome.regression.clone(),
        comparison: Vec::new(),
    })
}

/// The parameters of `other` beside those of `first`.
fn beside(setup: &Setup, first: &CostOutcome, other: &CostOutcome) -> Result<Vec<Agreement>, Error> {
    let cost_of = |name: &str| {
        let cost = setup.costs.iter().position(|cost| cost.name() == name).unwrap_or_default();
        move |candidates: &[Vec<f64>]| -> Result<Vec<Option<f64>>, FitError> {
            let jobs: Vec<Job> =
                candidates.iter().map(|values| Job { cost, values: values.clone(), draw: 0 }).collect();
            let (simulator, falls) = (setup.fit.simulator.as_ref(), &setup.options.falls);
            let found = evaluate(simulator, &setup.theta, &setup.costs, falls, &jobs, &never)?;
            Ok(found.into_iter().map(|found| found.cost).collect())
        }
    };
    compare(first, other, cost_of(&first.cost), cost_of(&other.cost)).map_err(Error::failed)
}

/// The checks that the configuration states.
fn checks(setup: &Setup, first: &CostFit, fitted: &Score) -> Vec<Check> {
    let check = &setup.config.check;
    let mut checks = Vec::new();
    if check.better_than_nominal {
        let found = first.doubt(DoubtKind::WorseThanNominal);
        checks.push(Check::holds("better than the nominal robot", first.better_than_nominal, &found));
    }
    if check.converged {
        let found = first.doubt(DoubtKind::NotConverged);
        checks.push(Check::holds("converged", first.converged, &found));
    }
    if let Some(limit) = check.cost {
        checks.push(Check::at_most("cost", limit, Some(first.cost)));
    }
    checks.extend(validation_checks(check, &first.validation, fitted.cost_validation));
    checks
}

/// The checks on validation logs that the configuration states.
pub(super) fn validation_checks(
    check: &CheckConfig,
    validation: &[Validation],
    cost: Option<f64>,
) -> Vec<Check> {
    let mut checks = Vec::new();
    if let Some(limit) = check.validation_cost {
        checks.push(Check::at_most("validation_cost", limit, cost));
    }
    if let Some(limit) = check.rmse_rad {
        let value = mean(validation.iter().map(|log| log.rmse_rad));
        checks.push(Check::at_most("rmse_rad (mean over validation logs)", limit, value));
    }
    checks
}
