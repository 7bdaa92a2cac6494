//! Whether a search came to its end.

use super::{CostOutcome, MAX_SCANNED, ParameterOutcome, Stop};
use gaitfit_model::listed;

/// A rise of the cost below this part, over the last quarter of a run, is no progress.
const PROGRESS: f64 = 0.01;
/// Seeds whose values differ by more than this part of the bounds (one standard deviation) found different ones.
const APART: f64 = 0.05;
/// Min generations of a search that its time limit did not end; with fewer it has shown nothing. CMA-ES also needs
/// [`GENERATIONS_PER_ENTRY`].
const MIN_GENERATIONS: usize = 4;
/// Min generations for each entry of θ. With fewer CMA-ES has hardly left its start.
const GENERATIONS_PER_ENTRY: usize = 2;
/// Min generations of a search that its time limit ended; with fewer it has shown nothing.
const MIN_GENERATIONS_IN_TIME: usize = 30;
/// Parameters named in a reason.
const NAMED: usize = 4;

/// Why the search for `outcome` has not converged, each reason a sentence; empty if it has. `course`: the smallest cost
/// so far of the best run, one a generation.
///
/// It had not, if changing one parameter alone lowers the cost by three standard errors or more
/// ([`super::Identification::better`]). It had not either, if the best run was cut short by its generations, a time
/// limit or the optimiser's failure before its deviations shrank to the tolerance, and its cost was still falling or
/// the seeds' values lie apart. Values of parameters that the logs do not identify may lie apart, and so may those of
/// more than [`MAX_SCANNED`] parameters: weights of networks that do the same can differ.
///
/// Least squares goes downhill from where it begins. So it has not converged either if no more than half of its seeds
/// ended where the best one did.
pub fn unsettled(outcome: &CostOutcome, course: &[f64]) -> Vec<String> {
    let mut reasons = Vec::new();
    let better = |one: &ParameterOutcome| {
        let value = one.identification.as_ref()?.better?;
        Some(format!("{} = {value:.4}", one.name))
    };
    let better: Vec<String> = outcome.parameters.iter().filter_map(better).collect();
    match better.len() {
        0 => {}
        1 => reasons.push(format!("{} fits better than the value found.", better[0])),
        _ => {
            reasons.push(format!("Each alone, {} fit better than the values found.", listed(&better, NAMED)))
        }
    }
    let best = outcome.runs.iter().min_by(|a, b| a.best_cost.total_cmp(&b.best_cost));
    let ended = best.and_then(|run| run.stop);
    // The search came to its end by its own criterion, so its course needs no further look.
    if matches!(ended, Some(Stop::Tolerance | Stop::Patience | Stop::Converged)) {
        reasons.extend(elsewhere(outcome));
        return reasons;
    }
    if ended == Some(Stop::Degenerate) {
        reasons.push(
            "The optimiser could not continue: its steps grew without bound or lost all but one direction."
                .into(),
        );
    }
    let generations = best.map_or(0, |run| run.generations);
    // Reasons from here on follow from an early end.
    let settled = reasons.len();
    // A network has thousands of weights. Without the limit no search over them would have enough generations.
    let few = outcome.parameters.len().min(MAX_SCANNED) * GENERATIONS_PER_ENTRY;
    let least = if ended.is_none() { MIN_GENERATIONS_IN_TIME } else { MIN_GENERATIONS };
    // Least squares needs few steps whatever the number of entries.
    let min = if outcome.uncertainty.is_none() { least.max(few) } else { least };
    if generations < min && !course.is_empty() {
        let plural = if generations == 1 { "" } else { "s" };
        reasons.push(format!("It was cut short after {generations} generation{plural}."));
    }
    if let Some(fall) = late_fall(course).filter(|fall| *fall > PROGRESS) {
        reasons.push(format!(
            "The best cost still fell by {:.1} % over the last quarter of {generations} generations.",
            100.0 * fall
        ));
    }
    // Many weights of networks can do the same work, so their values may differ.
    let scanned = outcome.parameters.len() <= MAX_SCANNED;
    let apart = outcome.parameters.iter().filter(|one| scanned && apart(one)).map(spread);
    let apart: Vec<String> = apart.collect();
    if !apart.is_empty() {
        reasons
            .push(format!("After {generations} generations the seeds lie apart: {}.", listed(&apart, NAMED)));
    }
    // Only a limit of time ends a run without a reason of its own.
    if ended.is_none() && best.is_some() && reasons.len() > settled {
        // Before the reasons that it explains.
        reasons.insert(
            settled,
            "Its time limit ended it (max_seconds or optimizer.max_seconds): raise it.".into(),
        );
    }
    reasons
}

/// A sentence if most seeds of least squares ended at other values than the best one.
fn elsewhere(outcome: &CostOutcome) -> Option<String> {
    // Runs of CMA-ES have no uncertainty, and a single seed has no other to agree with.
    outcome.uncertainty.as_ref().filter(|_| outcome.runs.len() > 1)?;
    let far = |one: &ParameterOutcome, value: f64| {
        // Where the cost is flat, seeds may end anywhere.
        let flat = one.identification.as_ref().is_some_and(|identification| !identification.identified);
        !flat && (value - one.value).abs() > APART * (one.upper - one.lower)
    };
    let agrees = |run: &usize| !outcome.parameters.iter().any(|one| far(one, one.per_run[*run]));
    let agreeing = (0..outcome.runs.len()).filter(agrees).count();
    // Most seeds agree with the best one: the lowest point is then likely the right one.
    if 2 * agreeing > outcome.runs.len() {
        return None;
    }
    let named = outcome.parameters.iter().filter(|one| one.per_run.iter().any(|value| far(one, *value)));
    let named: Vec<String> = named.map(spread).collect();
    let costs = || outcome.runs.iter().map(|run| run.best_cost);
    Some(format!(
        "Seeds of least squares ended apart, at costs of {:.5} to {:.5}: {}. They find the lowest point near their \
         start: add seeds (optimizer.seeds), or begin nearer (`start` of a [[parameter]]).",
        costs().fold(f64::INFINITY, f64::min),
        costs().fold(0.0, f64::max),
        listed(&named, NAMED)
    ))
}

fn spread(one: &ParameterOutcome) -> String {
    format!("{} {:.4} ± {:.4}", one.name, one.value, one.spread.unwrap_or(0.0))
}

fn apart(one: &ParameterOutcome) -> bool {
    let range = one.upper - one.lower;
    let flat = one.identification.as_ref().is_some_and(|identification| !identification.identified);
    !flat && one.spread.is_some_and(|spread| spread > APART * range)
}

/// The part by which the cost fell over the last quarter of the generations.
fn late_fall(course: &[f64]) -> Option<f64> {
    let last = *course.last()?;
    // A quarter of a short course may round to 0, and the course may be a single cost.
    let before = *course.get(course.len() - 1 - (course.len() / 4).max(1).min(course.len() - 1))?;
    // A cost of 0 cannot fall, and there is no share of it.
    (before > 0.0).then(|| (before - last) / before)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::fit::{Identification, NoiseSource, RunOutcome};

    fn outcome(stop: Option<Stop>, spread: f64) -> CostOutcome {
        let run = RunOutcome {
            seed: 1,
            best_cost: 1.0,
            values: vec![0.5],
            generations: 8,
            stop,
            diverged: 0,
            falls: 0,
            deviations: Vec::new(),
            mean: Vec::new(),
        };
        let parameter = ParameterOutcome {
            name: "p".into(),
            value: 0.5,
            uncorrected: None,
            unit: "-".into(),
            spread: Some(spread),
            lower: 0.0,
            upper: 1.0,
            start: 0.0,
            at_bound: false,
            per_run: vec![0.5],
            identification: None,
        };
        CostOutcome {
            cost: "matcho".into(),
            best_cost: 1.0,
            parameters: vec![parameter],
            runs: vec![run],
            uncertainty: None,
            correction: None,
            regression: None,
            redrawn: None,
            unlike: None,
        }
    }

    #[test]
    fn a_run_that_was_cut_short_is_judged_by_progress_and_spread() {
        let flat = [2.0, 1.1, 1.0, 1.0, 1.0, 1.0, 1.0, 1.0];
        let falling = [8.0, 7.0, 6.0, 5.0, 4.0, 3.0, 2.0, 1.0];
        let reasons = |stop, spread, course: &[f64]| unsettled(&outcome(stop, spread), course);
        assert!(reasons(Some(Stop::Generations), 0.01, &flat).is_empty());
        assert!(
            reasons(Some(Stop::Tolerance), 0.2, &falling).is_empty(),
            "it shrank: others are worse, no more"
        );
        let progress = reasons(Some(Stop::Generations), 0.01, &falling);
        assert!(progress.len() == 1 && progress[0].contains("66.7 %"), "{progress:?}");
        let apart = reasons(None, 0.2, &flat);
        assert!(apart.len() == 3 && apart[2].contains("p 0.5000 ± 0.2000"), "{apart:?}");
        assert!(apart[0].contains("optimizer.max_seconds"), "{apart:?}");
        let short = reasons(None, 0.01, &flat);
        assert!(short.len() == 2 && short[1].contains("cut short after 8 generations"), "{short:?}");
        let mut long = outcome(None, 0.01);
        long.runs[0].generations = 40;
        assert!(unsettled(&long, &flat).is_empty(), "it had settled when its time ended");
        let mut many = outcome(Some(Stop::Generations), 0.01);
        many.parameters = vec![many.parameters[0].clone(); 5];
        let few = unsettled(&many, &flat);
        assert!(few.len() == 1 && few[0].contains("cut short after 8"), "five parameters want ten: {few:?}");
    }

    #[test]
    fn seeds_of_least_squares_that_end_apart_are_told_unless_most_agree() {
        let seeds = |values: &[f64]| {
            let mut one = outcome(Some(Stop::Converged), 0.2);
            let run = one.runs[0].clone();
            let seed = |(k, value): (usize, &f64)| RunOutcome {
                seed: k as u64,
                best_cost: 1.0 + k as f64,
                values: vec![*value],
                ..run.clone()
            };
            one.runs = values.iter().enumerate().map(seed).collect();
            one.parameters[0].per_run = values.to_vec();
            one
        };
        let least_squares = |values: &[f64]| {
            let uncertainty = crate::fit::Uncertainty {
                sampling: vec![0.01],
                shifts: Vec::new(),
                deviation: vec![0.01],
                interval: vec![[0.48, 0.52]],
                draws: Vec::new(),
            };
            CostOutcome { uncertainty: Some(uncertainty), ..seeds(values) }
        };
        let apart = unsettled(&least_squares(&[0.5, 0.8]), &[]);
        assert!(apart.len() == 1 && apart[0].contains("1.00000 to 2.00000: p 0.5000"), "{apart:?}");
        assert!(unsettled(&least_squares(&[0.5, 0.52, 0.9]), &[]).is_empty(), "two of three agree");
        assert!(unsettled(&least_squares(&[0.5]), &[]).is_empty());
        assert!(unsettled(&seeds(&[0.5, 0.8]), &[]).is_empty(), "CMA-ES: others are worse, no more");
    }

    #[test]
    fn what_the_logs_do_not_identify_may_lie_apart_and_a_better_value_never_converged() {
        let identification = |identified, better| Identification {
            lower: 0.0,
            upper: 1.0,
            rise: 0.1,
            noise: NoiseSource::Recordings,
            identified,
            better,
        };
        let mut one = outcome(Some(Stop::Generations), 0.2);
        one.parameters[0].identification = Some(identification(false, None));
        assert!(unsettled(&one, &[1.0, 1.0]).is_empty());
        let mut one = outcome(Some(Stop::Tolerance), 0.0);
        one.parameters[0].identification = Some(identification(true, Some(0.7)));
        assert_eq!(unsettled(&one, &[]), ["p = 0.7000 fits better than the value found."]);
    }
}
