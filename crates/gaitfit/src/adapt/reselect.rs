//! The choice among the last candidates of a search by walks that it has not seen.

use super::setup::Setup;
use crate::watch::Watch;
use gaitfit_adapt::fit::{CostOutcome, FallPenalty, FitError, Job, RunGeneration, evaluate};

/// Candidates that are compared again.
const MAX_CANDIDATES: usize = 24;
/// What is added to the cost times the share of walks in which a candidate falls. The robot did not fall, so a simulator in
/// which one walk in ten ends so is worse by more than candidates at the end of a search differ.
const FALL: f64 = 1.0;

/// Gives `outcome` the one among the best candidates of the search that comes nearest to the logs from other starts. The best
/// of thousands of candidates is the luckiest too: how a robot walks on the edge of a fall is chance.
///
/// `course`: the generations of the search. Nothing changes where each log is simulated once.
///
/// # Errors
/// A simulation that fails.
pub(super) fn reselect(
    setup: &Setup,
    number: usize,
    outcome: &mut CostOutcome,
    course: &[RunGeneration],
    watch: &Watch<'_>,
) -> Result<(), FitError> {
    let Some(unseen) = &setup.unseen else { return Ok(()) };
    let mut candidates = vec![outcome.values()];
    for one in course.iter().rev().filter(|one| one.cost == outcome.cost) {
        if candidates.len() < MAX_CANDIDATES && !candidates.contains(&one.best_values) {
            candidates.push(one.best_values.clone());
        }
    }
    let stop = || watch.stop();
    let jobs = |cost: usize, draw: u64| -> Vec<Job> {
        candidates.iter().map(|values| Job { cost, values: values.clone(), draw }).collect()
    };
    let falls = FallPenalty { penalty: Some(FALL), ..setup.options.falls };
    let costs = std::slice::from_ref(&unseen.cost);
    let found =
        evaluate(unseen.set.simulator.as_ref(), &setup.theta, costs, &falls, &jobs(0, UNSEEN), &stop)?;
    let least = found.iter().enumerate().filter_map(|(at, one)| one.cost.map(|cost| (at, cost)));
    let Some((chosen, _)) = least.min_by(|a, b| a.1.total_cmp(&b.1)).filter(|(at, _)| *at > 0) else {
        return Ok(());
    };
    let job = [Job { cost: number, values: candidates[chosen].clone(), draw: 0 }];
    let simulator = setup.searched().simulator.as_ref();
    let again = evaluate(simulator, &setup.theta, &setup.costs, &FallPenalty::NONE, &job, &stop)?;
    if let Some(cost) = again.first().and_then(|one| one.cost) {
        outcome.choose(&setup.theta, &candidates[chosen], cost);
    }
    Ok(())
}

/// The draw of noise in these walks: another one than the search's, which count from 0.
const UNSEEN: u64 = 1 << 40;
