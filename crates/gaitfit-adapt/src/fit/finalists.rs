//! Chooses among the last candidates of a search whose simulations have random draws.
//!
//! A search keeps the candidate with the smallest cost so far. Torque noise and starts are drawn anew in each generation.
//! So this candidate may only have been lucky: with other draws its cost may be larger, and its robot may fall. Therefore
//! the last best candidates and the means of the searches' distributions are compared again, all with the same fresh draws.

use super::options::RandomNumbers;
use super::outcome::Redrawn;
use super::{CostOutcome, FallPenalty, FitError, Job, evaluate};
use crate::cost::Cost;
use crate::{Cancel, Simulator, Theta};

// Together with the draws below these are up to 128 simulations of all recordings.
/// Max candidates that are compared again.
const MAX_FINALISTS: usize = 16;
/// Draws with which each of them is simulated.
const FRESH_DRAWS: u32 = 8;

/// The simulator, the search space and the cost with which finalists are compared.
pub struct FinalComparison<'a> {
    /// Simulates all recordings.
    pub simulator: &'a dyn Simulator,
    /// The parameters of the search and their bounds.
    pub theta: &'a Theta,
    /// The costs of the fit.
    pub costs: &'a [Box<dyn Cost>],
    /// Index in `costs` of the outcome's cost.
    pub cost: usize,
    /// The cost of falls.
    pub falls: &'a FallPenalty,
    /// Called now and then; returns whether to stop.
    pub cancel: &'a Cancel<'a>,
}

impl CostOutcome {
    /// Takes the finalist with the smallest mean cost over fresh draws, the charge for falls included. `best_cost` becomes
    /// this mean without the charge, because the robot before the fit is not charged either. Finalists that diverge are
    /// left out; if all diverge, nothing changes. Finalists are the means of the runs' distributions and the last of `best`.
    /// `best`: the best values so far, after each generation of the search, in the order of θ.
    ///
    /// # Errors
    /// As [`evaluate`].
    pub fn choose_finalist<'a>(
        &mut self,
        comparison: &FinalComparison<'_>,
        best: impl DoubleEndedIterator<Item = &'a [f64]>,
    ) -> Result<(), FitError> {
        let entries = comparison.theta.entries();
        // Means of a mirrored distribution may lie outside the bounds.
        let clamped = |mean: &Vec<f64>| -> Vec<f64> {
            let pairs = mean.iter().zip(entries);
            pairs.map(|(value, entry)| value.clamp(entry.lower, entry.upper)).collect()
        };
        let means = self.runs.iter().map(|run| clamped(&run.mean)).filter(|mean| !mean.is_empty());
        let mut finalists: Vec<Vec<f64>> = Vec::new();
        // Means first, then the last best values: if there are too many, the oldest are left out.
        for values in means.chain(best.rev().map(<[f64]>::to_vec)) {
            if finalists.len() < MAX_FINALISTS && !finalists.contains(&values) {
                finalists.push(values);
            }
        }
        let Some(run) = self.runs.iter().min_by(|a, b| a.best_cost.total_cmp(&b.best_cost)) else {
            return Ok(());
        };
        // The search ended before these generations, so it did not use their draws.
        let first = u32::try_from(run.generations).unwrap_or(u32::MAX).saturating_add(1);
        let draws = |draw: u32| RandomNumbers::Generation.draw(run.seed, first.saturating_add(draw), 0);
        let draws: Vec<u64> = (0..FRESH_DRAWS).map(draws).collect();
        let job =
            |values: &[f64], draw: &u64| Job { cost: comparison.cost, values: values.to_vec(), draw: *draw };
        let jobs: Vec<Job> =
            finalists.iter().flat_map(|values| draws.iter().map(move |draw| job(values, draw))).collect();
        let FinalComparison { simulator, theta, costs, falls, cancel, .. } = *comparison;
        let evaluations = evaluate(simulator, theta, costs, falls, &jobs, cancel)?;
        let (charged, recordings) = (costs[comparison.cost].as_ref(), simulator.recordings());
        // Mean cost with the charge for falls, mean cost without it, and number of falls.
        let mean = |of_finalist: &[super::Evaluation]| -> Option<(f64, f64, usize)> {
            let count = of_finalist.len() as f64;
            // One diverged draw makes a finalist unusable.
            let costs: Option<Vec<f64>> = of_finalist.iter().map(|evaluation| evaluation.cost).collect();
            let cost = costs?.iter().sum::<f64>() / count;
            let charges = of_finalist.iter().map(|one| falls.charge(charged, one.falls, recordings));
            let charge = charges.sum::<f64>() / count;
            Some((cost, cost - charge, of_finalist.iter().map(|one| one.falls).sum()))
        };
        let means = evaluations.chunks(draws.len()).map(mean);
        let chosen = finalists.iter().zip(means).filter_map(|(values, mean)| Some((values, mean?)));
        if let Some((values, (_, cost, fell))) = chosen.min_by(|a, b| a.1.0.total_cmp(&b.1.0)) {
            self.best_cost = cost;
            self.redrawn = Some(Redrawn { simulations: draws.len() * recordings, falls: fell });
            for (parameter, (entry, &value)) in self.parameters.iter_mut().zip(entries.iter().zip(values)) {
                parameter.value = value;
                parameter.at_bound = entry.at_bound(value);
            }
        }
        Ok(())
    }
}
