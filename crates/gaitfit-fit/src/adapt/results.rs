//! The result of a fit, as the one document that `--json` prints, `result.json` keeps, and tables and report show.

use super::check::{Check, checks};
use super::cost_fit::{beside, fit};
use super::cost_result::CostFit;
use super::doubts;
use super::held_out::{HeldOut, Verdict, held_out};
use super::leftover::leftover;
use super::odd::OddJoints;
use super::outliers;
use super::parameter::Parameter;
use super::score::{Robot, Score, Validation, baselines, joint_errors, score};
use super::setup::Setup;
use super::springs::FoundSpring;
use super::standing::{self, CONTRADICTED, Evidence, Standing, standing};
use super::swing;
use super::trust::{identified, stopped};
use crate::Error;
use crate::robot::joint_names;
use crate::run::RunFolder;
use crate::walk::explain::{self, Cause};
use crate::walk::swing::{Beside, SwingFindings, doubt};
use crate::watch::{Watch, Work};
use gaitfit_adapt::Theta;
use gaitfit_adapt::fit::{CostOutcome, FitError, RunGeneration};
use gaitfit_model::{JointKind, Model};
use gaitfit_view::{Doubt, DoubtKind};
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// Most parameters that tables and reports show: a network of features on every joint of a quadruped and its friction
/// and armature; not the 97 weights of a whole network, which say nothing one by one.
pub const MAX_SHOWN: usize = 90;

/// Checks of a result: how the fitted robot predicts, how others do, and what the logs show without a simulation.
const CHECKS: usize = 3;

/// The result of one adaptation. What stands beside `fits` is its first one's.
#[derive(Clone, Debug, Serialize, Deserialize)]
pub struct AdaptResults {
    /// Name of the run.
    pub name: String,
    /// Robot name.
    pub robot: String,
    /// The result in a sentence, its doubts first.
    pub headline: String,
    /// Firmness of the result.
    #[serde(default)]
    pub standing: Standing,
    /// The verdict of walks that were not fitted; absent without such walks.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub verdict: Option<Verdict>,
    /// Why the fit whose θ is kept must not be taken as it stands, the worst first: what its search says, what the logs
    /// say that were not fitted, what its errors go with, and values that the search would have taken further.
    #[serde(default)]
    pub doubts: Vec<Doubt>,
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
    /// Joints that differ from their siblings, if that was asked for.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub odd_joints: Option<OddJoints>,
    /// Score of the fitted simulator.
    pub fitted: Score,
    /// Scores of the robot before the fit, and of predictors that need no simulator.
    pub baselines: Vec<Score>,
    /// Prediction of logs that were not fitted.
    pub validation: Vec<Validation>,
    /// Unit of the position errors over all joints: `rad`, of robots with slides also m.
    #[serde(default = "super::score::rad", skip_serializing_if = "super::score::is_rad")]
    pub position_unit: String,
    /// Walking logs that were not fitted: their distributions beside those of simulated walks, and a floor.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub held_out: Option<HeldOut>,
    /// Walking logs: what they say of joints and sensors without a simulation.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub swings: Option<SwingFindings>,
    /// Effects that the fitted logs show without a simulation and that the fitted simulator lacks, the weightiest
    /// first.
    #[serde(default)]
    pub causes: Vec<Cause>,
    /// The values beside what legs in the air say of them.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub beside_swings: Vec<Beside>,
    /// The fit of each cost; the θ of the first is kept.
    pub fits: Vec<CostFit>,
    /// Checks the configuration states.
    pub checks: Vec<Check>,
    /// Facts to know before trusting the numbers.
    pub warnings: Vec<String>,
    /// Logs, or stretches of logs, that were compared.
    pub trajectories: usize,
    /// Total time of them that counts, s.
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
    /// Folder of the run's files.
    pub run_folder: String,
    /// Wall time of the search (all sessions) and of the measurements of its result, s.
    pub wall_seconds: f64,
}

impl AdaptResults {
    /// The checks that failed, in words; `None` if all hold.
    pub fn failed_check(&self) -> Option<String> {
        super::check::failed(&self.checks)
    }

    /// Why no policy may be trained in the fit, in words; absent unless walks that were not fitted contradict it.
    pub fn contradiction(&self) -> Option<String> {
        let held = self.held_out.as_ref().filter(|_| self.standing == Standing::Contradicted)?;
        Some(format!(
            "walks that were not fitted contradict the fit: {}. Trainings refuse it unless `allow` names \"{CONTRADICTED}\"",
            held.sentence()
        ))
    }

    /// Why the result must not be used, in words; absent of results that are sound, or doubtful with intervals that
    /// know it.
    pub fn refusal(&self) -> Option<String> {
        standing::refusal(&self.doubts).map(|why| format!("{why}. All results are in {}", self.run_folder))
    }

    /// The doubts of every cost, then the warnings, for other places that name the fit.
    pub fn notes(&self) -> Vec<String> {
        let doubts = |fit: &CostFit| -> Vec<String> {
            let line =
                |doubt: &Doubt| format!("{}: {}: {}", fit.cost_name, doubt.kind.headline(), doubt.text);
            fit.doubts.iter().map(line).collect()
        };
        self.fits.iter().flat_map(doubts).chain(self.warnings.iter().cloned()).collect()
    }
}

/// A finished search.
pub(super) struct Searched<'a> {
    /// One for each cost.
    pub outcomes: &'a [CostOutcome],
    /// The generations of its runs.
    pub course: &'a [RunGeneration],
    /// Result of the comparison of joints before it.
    pub odd_joints: Option<OddJoints>,
    /// Duration of the search, s.
    pub seconds: f64,
}

/// Scores the outcomes of a finished search. `swings`: finds what legs in the air show, if `setup` does not know it.
pub(super) fn results(
    setup: &Setup,
    searched: Searched<'_>,
    swings: impl FnOnce() -> Option<SwingFindings>,
    folder: &RunFolder,
    watch: &Watch<'_>,
) -> Result<AdaptResults, Error> {
    let Searched { outcomes, course, odd_joints, seconds: wall_seconds } = searched;
    let begun = Instant::now();
    // First the values: corrected, with intervals and with the doubts of each cost by itself.
    let (mut fits, uncorrected) = cost_fits(setup, outcomes, course, folder, watch)?;
    // Doubts of one cost about another come only when all are known.
    standing::reconcile(&mut fits);
    // A clone, because `fits` is kept whole in the results.
    let Some(first) = fits.first().cloned() else {
        return Err(Error::failed(
            "no candidate of the fit could be simulated to the end: narrow the bounds, lower the deviations or take \
             a smaller simulation.timestep",
        ));
    };
    let robot = Robot { theta: &setup.theta, values: &first.values() };
    let given = setup.config.costs[0].given();
    let what = "check of the result";
    let checks_done = watch.begin(Work { what, total: CHECKS, first: 0, parts: "checks", seed: None });
    // Each check simulates for a while, so stopping is asked for between them.
    let checked = |done: usize| {
        checks_done.step(done, 1, "");
        let stopped = "interrupted while the result was checked; --resume continues";
        if watch.stop() { Err(Error::interrupted(stopped, folder.path())) } else { Ok(()) }
    };
    // Then how the fitted robot predicts, beside simpler predictors and logs that were not fitted.
    let fitted = score("fitted simulator", setup, Some(first.cost), |set| {
        robot.simulate(set.simulator.as_ref(), given)
    })?;
    checked(1)?;
    let mut warnings = setup.warnings.clone();
    warnings.extend(uncorrected);
    for fit in &fits {
        warnings.extend(doubts::warnings(fit, fits.len() > 1));
    }
    let (baselines, held) = (baselines(setup, first.nominal_cost)?, beside_others(setup, robot, watch));
    // An interruption is not a failure, so it is looked for first.
    checked(2)?;
    let held = held?;
    // All that speaks against the fit becomes one list of doubts, by which the result is judged.
    let evidence = Evidence {
        fitted: &fitted,
        baselines: &baselines,
        held_out: held.as_ref(),
        effort: least_effort(setup.method.model()),
        position_unit: &setup.method.model().units("rad"),
    };
    let mut doubts = standing::doubts(&first, &evidence);
    let swings = setup.swings.clone().or_else(swings);
    checked(CHECKS)?;
    let causes = causes(setup, swings.as_ref());
    doubts.extend(
        explain::missing(&causes, &setup.theta, &setup.base, &joint_names(setup.method.model()))
            .map(|text| Doubt::new(DoubtKind::Unexplained, text)),
    );
    let play = |findings: &SwingFindings| explain::false_play(findings, &setup.theta, &first.values());
    warnings.extend(swings.iter().flat_map(play));
    // A stable sort: within one kind the order above stays.
    doubts.sort_by_key(|doubt| doubt.kind);
    // Nothing touches a leg in the air, so these estimates check the values without any contact.
    let beside_swings = swings
        .as_ref()
        .map_or_else(Vec::new, |findings| swing::compared(setup, findings, &setup.theta, &first.parameters));
    warnings.extend(doubt(&beside_swings));
    let notes = setup.notes.as_ref();
    let counted = |log: &crate::log::Log| log.trajectory.duration() - setup.config.skip_seconds();
    Ok(AdaptResults {
        name: setup.config.name.clone().unwrap_or_else(|| folder.name()),
        robot: setup.method.model().name.clone(),
        headline: first.headline(&doubts),
        standing: standing(&doubts, held.as_ref()),
        verdict: held.as_ref().map(HeldOut::verdict),
        converged: first.converged,
        better_than_nominal: first.better_than_nominal,
        cost_name: first.cost_name.clone(),
        cost: first.cost,
        nominal_cost: first.nominal_cost,
        parameters: first.parameters.clone(),
        springs: FoundSpring::all(&setup.theta, &first.values(), first.uncertainty.as_ref()),
        checks: checks(setup, &first, &doubts, &fitted),
        doubts,
        baselines,
        fitted,
        validation: first.validation.clone(),
        position_unit: setup.method.model().units("rad"),
        held_out: held,
        swings,
        causes,
        beside_swings,
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

/// The effects that the logs show and the fitted simulator lacks.
fn causes(setup: &Setup, swings: Option<&SwingFindings>) -> Vec<Cause> {
    let joints = joint_names(setup.method.model());
    let mut causes = swings.map_or_else(Vec::new, explain::causes);
    // The fit already has parameters for these effects, so they cannot cause the remaining errors.
    causes.retain(|cause| !explain::covered(cause, &setup.theta, &setup.base, &joints));
    causes
}

/// The smallest torque limit above 0 of any joint, N·m; `None` if no joint has a limit.
fn least_effort(model: &Model) -> Option<f64> {
    let efforts = (0..model.joints.len()).filter_map(|joint| model.effort(joint));
    // A joint whose limit is 0 is switched off. Beside it any noise would be loud.
    efforts.filter(|effort| effort.is_finite() && *effort > 0.0).reduce(f64::min)
}

/// The fits of all costs, and the reasons why estimates of some were not corrected.
fn cost_fits(
    setup: &Setup,
    outcomes: &[CostOutcome],
    course: &[RunGeneration],
    folder: &RunFolder,
    watch: &Watch<'_>,
) -> Result<(Vec<CostFit>, Vec<String>), Error> {
    let mut fits: Vec<CostFit> = Vec::with_capacity(outcomes.len());
    let mut finished: Vec<CostOutcome> = Vec::with_capacity(outcomes.len());
    let mut uncorrected: Vec<String> = Vec::new();
    for outcome in outcomes {
        // Costs that have no finished run have no outcome, so positions cannot be taken from the order.
        let Some(cost) = setup.costs.iter().position(|cost| cost.name() == outcome.cost) else { continue };
        let (mut outcome, warning) = identified(setup, cost, outcome.clone(), course, folder, watch)?;
        if outcome.correction.is_none() && !outcome.regression.as_ref().is_some_and(|one| one.taken) {
            // The search's cost contains the price for leaving the priors, which is not a distance from the logs.
            outcome.best_cost -= setup.theta.prior_cost(&outcome.values());
        }
        uncorrected.extend(warning);
        let noise_alone = outcome.uncertainty.is_some();
        // What remains in the errors is examined first, because it widens the intervals of the fit.
        let left = leftover(setup, cost, &outcome.values(), outcome.best_cost, noise_alone, &|| watch.stop());
        // An interruption is not a failure.
        let left = left.map_err(|error| match watch.stop() {
            true => stopped(FitError::Cancelled, folder),
            false => error,
        })?;
        let mut fit = fit(setup, cost, &outcome, course, left)?;
        // Comparing evaluates one candidate a parameter, and pages show no more than these.
        if let Some(first) = finished.first().filter(|_| setup.theta.len() <= MAX_SHOWN) {
            fit.comparison = beside(setup, first, &outcome)?;
        }
        fits.push(fit);
        finished.push(outcome);
    }
    // A joint that is much worse than the others shows only where samples are compared one by one.
    if let Some(fit) = fits.first_mut().filter(|_| setup.aligned() && setup.method.walking().is_none()) {
        // The kept θ is the first cost's, so only its doubts get this one.
        let (values, given) = (fit.values(), setup.config.costs[0].given());
        let robot = Robot { theta: &setup.theta, values: &values };
        let errors = joint_errors(&setup.fit, |set| robot.simulate(set.simulator.as_ref(), given))?;
        let model = setup.method.model();
        fit.doubts.extend(outliers::doubt(&errors, |name| {
            if model.slides(name) { JointKind::Slide } else { JointKind::Hinge }
        }));
    }
    Ok((fits, uncorrected))
}

/// Walks under the commands of the logs that were not fitted, beside them.
fn beside_others(setup: &Setup, robot: Robot<'_>, watch: &Watch<'_>) -> Result<Option<HeldOut>, Error> {
    let Some(set) = setup.validate.first() else { return Ok(None) };
    let (theta, values): (Theta, &[f64]) = (Theta::default(), &[]);
    let before = Robot { theta: &theta, values };
    let robots = [(set, robot), (set, before)];
    held_out(&setup.config, &setup.method, robots, &setup.fit.logs, (&|| watch.stop(), &|_| ()))
}
