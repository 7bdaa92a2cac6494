//! The choice among the last candidates of a search whose simulations have random draws.
//!
//! A search remembers the candidate with the smallest cost that it ever saw. Draws (torque noise) change from generation to
//! generation, so this candidate is partly the luckiest one: on other draws its robot may cost more, and may fall. So the
//! last best candidates, and the means of the searches' distributions, are compared again under the same fresh draws.

use super::driver::RandomNumbers;
use super::{CostOutcome, FallPenalty, FitError, Job, evaluate};
use crate::cost::Cost;
use crate::{Cancel, Simulator, Theta};

/// Candidates that are compared again, and the draws with which each is simulated.
const MAX_FINALISTS: usize = 16;
const FRESH_DRAWS: u32 = 8;

/// What finalists are simulated with.
pub struct Final<'a> {
    /// Simulates all recordings.
    pub simulator: &'a dyn Simulator,
    /// What is searched.
    pub theta: &'a Theta,
    /// The costs of the fit.
    pub costs: &'a [Box<dyn Cost>],
    /// Which of them is the outcome's.
    pub cost: usize,
    /// What falls cost.
    pub falls: &'a FallPenalty,
    /// Asked now and then whether to stop.
    pub cancel: &'a Cancel<'a>,
}

impl CostOutcome {
    /// Takes the finalist with the smallest mean cost over fresh draws. Finalists are the last of `best`, which are the best
    /// values so far after each generation of the search, and the mean of each run's distribution. A finalist that diverges
    /// is left out; if all do, nothing changes.
    ///
    /// # Errors
    /// As [`evaluate`].
    pub fn choose<'a>(
        &mut self,
        contest: &Final<'_>,
        best: impl DoubleEndedIterator<Item = &'a [f64]>,
    ) -> Result<(), FitError> {
        let entries = contest.theta.entries();
        let inside = |mean: &Vec<f64>| -> Vec<f64> {
            let pairs = mean.iter().zip(entries);
            pairs.map(|(value, entry)| value.clamp(entry.lower, entry.upper)).collect()
        };
        let means = self.runs.iter().map(|run| inside(&run.mean)).filter(|mean| !mean.is_empty());
        let mut finalists: Vec<Vec<f64>> = Vec::new();
        for values in means.chain(best.rev().map(<[f64]>::to_vec)) {
            if finalists.len() < MAX_FINALISTS && !finalists.contains(&values) {
                finalists.push(values);
            }
        }
        let Some(run) = self.runs.iter().min_by(|a, b| a.best_cost.total_cmp(&b.best_cost)) else {
            return Ok(());
        };
        // Generations that the search did not come to.
        let first = u32::try_from(run.generations).unwrap_or(u32::MAX).saturating_add(1);
        let draws = |draw: u32| RandomNumbers::Generation.draw(run.seed, first.saturating_add(draw), 0);
        let draws: Vec<u64> = (0..FRESH_DRAWS).map(draws).collect();
        let job =
            |values: &[f64], draw: &u64| Job { cost: contest.cost, values: values.to_vec(), draw: *draw };
        let jobs: Vec<Job> =
            finalists.iter().flat_map(|values| draws.iter().map(move |draw| job(values, draw))).collect();
        let Final { simulator, theta, costs, falls, cancel, .. } = *contest;
        let found = evaluate(simulator, theta, costs, falls, &jobs, cancel)?;
        let mean = |one: &[super::Evaluation]| -> Option<f64> {
            let costs: Option<Vec<f64>> = one.iter().map(|found| found.cost).collect();
            costs.map(|costs| costs.iter().sum::<f64>() / costs.len() as f64)
        };
        let means = found.chunks(draws.len()).map(mean);
        let chosen = finalists.iter().zip(means).filter_map(|(values, mean)| Some((values, mean?)));
        if let Some((values, cost)) = chosen.min_by(|a, b| a.1.total_cmp(&b.1)) {
            self.best_cost = cost;
            for (parameter, (entry, &value)) in self.parameters.iter_mut().zip(entries.iter().zip(values)) {
                parameter.value = value;
                parameter.at_bound = entry.at_bound(value);
            }
        }
        Ok(())
    }
}
