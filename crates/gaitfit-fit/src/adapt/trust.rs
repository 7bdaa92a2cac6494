//! How far the values of a fit can be trusted: their correction and their intervals.

use super::alternatives::Other;
use super::doubts;
use super::limit::within;
use super::robots;
use super::scan::Scan;
use super::setup::Setup;
use crate::Error;
use crate::run::RunFolder;
use crate::watch::Watch;
use gaitfit_adapt::Resets;
use gaitfit_adapt::fit::{
    Alternative, CostOutcome, FinalComparison, FitError, Problem, RunGeneration, cost_error,
};

/// The outcome of cost number `cost`, corrected where that can be, with the interval of each parameter, where there are not
/// too many; and why it is not corrected where it should be. `course`: the generations of its runs.
pub(super) fn identified(
    setup: &Setup,
    cost: usize,
    mut outcome: CostOutcome,
    course: &[RunGeneration],
    folder: &RunFolder,
    watch: &Watch<'_>,
) -> Result<(CostOutcome, Option<String>), Error> {
    let least_squares = setup
        .options
        .method
        .least_squares(setup.costs[cost].as_ref(), &setup.theta)
        .map_err(Error::failed)?;
    // Kept for a time limit: the search's own values, in case no interval can be measured.
    let searched = outcome.clone();
    // Measuring has its own share of a whole limit.
    let measured = within(setup.limit, watch, |watch| {
        let (number, cost) = (cost, setup.costs[cost].as_ref());
        let scan = Scan::new(setup.searched().simulator.as_ref(), cost.name(), watch);
        let stop = || watch.stop();
        // Least squares has differences and their derivatives; CMA-ES has costs alone, so the cost is scanned.
        if least_squares {
            let (theta, draw) = (&setup.theta, outcome.draw());
            let problem = Problem { simulator: &scan, theta, cost, draw, cancel: &stop };
            return trusted(setup, number, &mut outcome, problem, watch);
        }
        choose_among_last(setup, number, &mut outcome, course, watch)?;
        measured(setup, number, &mut outcome, course, &scan, watch)
    });
    match measured {
        Ok(Some(refused)) => {
            let warning = refused.map(|reason| doubts::uncorrected(&outcome, &reason));
            Ok((outcome, warning))
        }
        // Intervals of values that are not corrected would be too narrow.
        Ok(None) => {
            let name = &searched.cost;
            let warning =
                format!("{name}: the time limit (max_seconds) was over before the end. {NO_INTERVALS}");
            Ok((searched, Some(warning)))
        }
        Err(error) => Err(stopped(error, folder)),
    }
}

/// Consequence of a time limit that ended the fit, as a sentence of a warning.
const NO_INTERVALS: &str = "So the parameters have no intervals: the same fit, resumed with a higher limit or without one, measures them.";

/// Takes the best of the last candidates over fresh draws of the torque noise and of the starts. Where a simulation has neither,
/// nothing changes.
fn choose_among_last(
    setup: &Setup,
    cost: usize,
    outcome: &mut CostOutcome,
    course: &[RunGeneration],
    watch: &Watch<'_>,
) -> Result<(), FitError> {
    if !setup.options.falls.random {
        return Ok(());
    }
    let comparison = FinalComparison {
        simulator: setup.searched().simulator.as_ref(),
        theta: &setup.theta,
        costs: &setup.costs,
        cost,
        falls: &setup.options.falls,
        cancel: &|| watch.stop(),
    };
    // A copy, because `outcome` changes while its name is compared.
    let name = outcome.cost.clone();
    let best = course.iter().filter(|one| one.cost == name).map(|one| one.best_values.as_slice());
    outcome.choose_finalist(&comparison, best)
}

/// The error that ended the work after a search, whose values `folder` has.
pub(super) fn stopped(error: FitError, folder: &RunFolder) -> Error {
    if !matches!(error, FitError::Cancelled) {
        return Error::failed(error);
    }
    let path = folder.path();
    let message = format!("interrupted after the search; {} has it, --resume continues", path.display());
    Error::interrupted(message, path)
}

/// Why `outcome` is not corrected, if its time limit ended it. A correction takes minutes, and needs a search that was not cut
/// short. Without it there are no intervals: they would be narrower than those of a search that ended.
fn cut_short(outcome: &CostOutcome) -> Option<String> {
    let cut = outcome.runs.iter().any(|run| run.stop.is_none());
    cut.then(|| format!("The time limit ended the search. {NO_INTERVALS}"))
}

/// Corrects what CMA-ES found by simulated robots, where that can be, or else scans the cost around it. Returns why it does
/// not correct, if it should. Intervals reach to all values on the search's way that fit as well. Without a correction because of
/// a time limit there are none.
fn measured(
    setup: &Setup,
    number: usize,
    outcome: &mut CostOutcome,
    course: &[RunGeneration],
    scan: &Scan<'_>,
    watch: &Watch<'_>,
) -> Result<Option<String>, FitError> {
    let (cost, theta, stop) = (setup.costs[number].as_ref(), &setup.theta, || watch.stop());
    let replicas =
        setup.replicas.as_ref().filter(|_| robots::applies(&setup.config, setup.config.costs[number]));
    // A search that time ended may still be far from the minimum.
    if let Some(why) = replicas.and_then(|_| cut_short(outcome)) {
        return Ok(Some(why));
    }
    let mut refused = None;
    if let Some(replicas) = replicas {
        let problem =
            Problem { simulator: setup.searched().simulator.as_ref(), theta, cost, draw: 0, cancel: &stop };
        refused = robots::correct(setup, replicas, outcome, problem, watch)?;
        // The regression has given intervals already.
        if refused.is_none() {
            return Ok(None);
        }
    }
    // A simulator that differs only in the use of sensor readings says nothing of a cost without them.
    let others = setup.alternatives.iter().filter(|other| other.walks() || cost.resets() != Resets::Never);
    let others: Vec<_> = others.map(Other::alternative).collect();
    outcome.identify(scan, theta, cost, &others, 0, &stop)?;
    let name = outcome.cost.clone();
    let generations = course.iter().filter(|one| one.cost == name);
    let others = generations.map(|one| (one.best_so_far, one.best_values.as_slice()));
    let simulator = setup.searched().simulator.as_ref();
    // The cost's own error says which values on the search's way fit as well.
    if let Some(error) = cost_error(simulator, theta, cost, &outcome.values(), 0, &stop)? {
        outcome.widen(theta, others, error);
    }
    // A refused regression still shows how unsure the values are.
    if let Some(regression) = refused.as_ref().and_then(|refused| refused.regression.as_ref()) {
        outcome.widen_by(theta, regression);
    }
    Ok(refused.map(|refused| refused.why))
}

/// Corrects what least squares found, where that can be, and measures its uncertainty. Returns why it does not correct, if
/// it should.
fn trusted(
    setup: &Setup,
    cost: usize,
    outcome: &mut CostOutcome,
    problem: Problem<'_>,
    watch: &Watch<'_>,
) -> Result<Option<String>, FitError> {
    // Without progress lines: the correction shows its own.
    // Least squares compares samples, so each log is simulated once: `fit` and the searched set are the same.
    let quiet = Problem { simulator: setup.fit.simulator.as_ref(), ..problem };
    let replicas = setup.replicas.as_ref().filter(|_| setup.config.costs[cost].needs_imu());
    if let Some(why) = replicas.and_then(|_| cut_short(outcome)) {
        return Ok(Some(why));
    }
    let refused = match replicas {
        None => None,
        Some(replicas) => replicas.correct(setup, cost, outcome, quiet, watch)?,
    };
    let corrected = outcome.correction.is_some();
    // A correction by simulated logs takes the error of those simulators away.
    let others = setup.alternatives.iter().filter(|other| !(corrected && other.corrected));
    let others: Vec<Alternative<'_>> = others.map(Other::alternative).collect();
    outcome.trust(problem, &others)?;
    Ok(refused)
}
