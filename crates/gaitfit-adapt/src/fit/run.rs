//! One run of a fit, by CMA-ES or least squares, and the checkpoint of all.

use super::fall_risk::FallRisk;
use super::generation::RunGeneration;
use super::least_squares::{GaussNewton, Stepped};
use super::options::FitOptions;
use super::stop::Stop;
use super::{Evaluation, FitError, Origin, RunOutcome};
use crate::Theta;
use crate::cmaes::{
    Best, CmaError, Population, RestartPlan, RestartStart, Search, SearchState, Settings, StopReason,
    default_population,
};
use serde::{Deserialize, Serialize};

/// One run: a cost and a seed.
#[derive(Clone, Debug)]
pub(super) struct Run {
    /// Index into the costs.
    pub cost: usize,
    pub seed: u64,
    pub stop: Option<Stop>,
    diverged: usize,
    falls: usize,
    /// Smallest cost of each generation of the present start, where patience is limited.
    course: Vec<f64>,
    risk: FallRisk,
    by: By,
}

/// How a run searches.
#[derive(Clone, Debug)]
enum By {
    CmaEs { search: Box<Search>, asked: Option<Population> },
    LeastSquares(GaussNewton),
}

impl Run {
    pub fn new(
        cost: usize,
        seed: u64,
        least_squares: bool,
        theta: &Theta,
        options: &FitOptions,
    ) -> Result<Self, FitError> {
        let by = if least_squares {
            // The first seed starts at θ's own start, the others elsewhere.
            By::LeastSquares(GaussNewton::new(theta, seed, options.seeds.first() == Some(&seed)))
        } else {
            let search = Search::new(settings(seed, theta, options), plan(options));
            By::CmaEs { search: Box::new(search.map_err(FitError::Optimizer)?), asked: None }
        };
        Ok(Self {
            cost,
            seed,
            stop: None,
            diverged: 0,
            falls: 0,
            course: Vec::new(),
            risk: FallRisk::default(),
            by,
        })
    }

    /// Number of the next generation, from 1, restarts counted on.
    pub fn generation(&self) -> u32 {
        self.done() + 1
    }

    fn done(&self) -> u32 {
        match &self.by {
            By::CmaEs { search, .. } => search.generation(),
            By::LeastSquares(search) => search.generation(),
        }
    }

    /// The candidates of the next generation; `None` of a run of least squares, see [`Self::least_squares`].
    pub fn ask(&mut self) -> Option<Vec<Vec<f64>>> {
        let By::CmaEs { search, asked } = &mut self.by else { return None };
        let population = search.ask();
        let candidates = population.x().to_vec();
        *asked = Some(population);
        Some(candidates)
    }

    /// Whether the run is one of least squares: it asks for no candidates.
    pub fn is_least_squares(&self) -> bool {
        matches!(self.by, By::LeastSquares(_))
    }

    /// The search of a run of least squares.
    pub fn least_squares(&mut self) -> Option<&mut GaussNewton> {
        match &mut self.by {
            By::LeastSquares(search) => Some(search),
            By::CmaEs { .. } => None,
        }
    }

    /// Takes what a step of its [`Self::least_squares`] gave. Returns the report, and the number of candidates that were simulated.
    ///
    /// # Errors
    /// [`FitError::StepDiverged`].
    pub fn stepped(
        &mut self,
        name: &str,
        stepped: Option<Stepped>,
    ) -> Result<(RunGeneration, usize), FitError> {
        let (seed, generation) = (self.seed, self.done() as usize);
        // A step that diverged was not counted.
        let diverged = || FitError::StepDiverged { cost: name.to_owned(), seed, generation: generation + 1 };
        let stepped = stepped.ok_or_else(diverged)?;
        // A step without a best candidate cannot have succeeded.
        let best = self.best().cloned().ok_or_else(diverged)?;
        self.diverged += stepped.diverged;
        self.falls += stepped.falls;
        if let By::LeastSquares(search) = &self.by {
            self.stop = search.stop();
        }
        let report = RunGeneration {
            cost: name.to_owned(),
            seed,
            best: stepped.cost,
            mean: stepped.mean,
            sigma: stepped.size,
            diverged: stepped.diverged,
            fallen: stepped.fallen,
            falls: stepped.falls,
            best_so_far: best.cost,
            best_values: best.x,
            stop: self.stop,
        };
        Ok((report, stepped.evaluations))
    }

    /// Takes the costs of the candidates that [`Self::ask`] gave. Candidates that diverged are ranked last. `risk_price`: what a
    /// candidate pays for each fall that is expected of it in all `recordings`, see
    /// [`FallPenalty::risk_price`](super::FallPenalty).
    pub fn tell(
        &mut self,
        name: &str,
        evaluations: &[Evaluation],
        risk_price: Option<f64>,
        recordings: usize,
        options: &FitOptions,
    ) -> Result<RunGeneration, FitError> {
        let generation = self.generation() as usize;
        let seed = self.seed;
        let all_diverged = || FitError::AllDiverged { cost: name.to_owned(), seed, generation };
        let By::CmaEs { search, asked } = &mut self.by else { return Err(all_diverged()) };
        // Read before `tell` changes it: these candidates were drawn with it.
        let sigma = search.current().sigma();
        // A run that was resumed has not asked; asking again gives the same candidates.
        let population = asked.take().unwrap_or_else(|| search.ask());
        let mut costs: Vec<f64> =
            evaluations.iter().map(|evaluation| evaluation.cost.unwrap_or(f64::INFINITY)).collect();
        // The price is learnt from this generation too, so that lucky candidates pay for it at once.
        if let Some(price) = risk_price {
            self.risk.remember(population.x(), evaluations);
            let risks = self.risk.expected_falls(population.x(), recordings);
            costs.iter_mut().zip(risks).for_each(|(cost, falls)| *cost += price * falls);
        }
        let finite: Vec<f64> = costs.iter().copied().filter(|cost| cost.is_finite()).collect();
        // The search returns a summary if its run ended by its own criteria. The next run, if any, has then begun.
        let restarted = search.tell(&population, &costs).map_err(FitError::Optimizer)?.is_some();
        // After the charge for risk: infinite costs stay the diverged ones.
        let diverged = evaluations.len() - finite.len();
        let falls = evaluations.iter().map(|evaluation| evaluation.falls).sum();
        self.diverged += diverged;
        self.falls += falls;
        // The search has been told already, but without any cost nothing was learnt.
        if finite.is_empty() {
            return Err(all_diverged());
        }
        // The search gives patience and tolerance the same name, so patience is remembered here.
        let mut stuck = false;
        if restarted {
            // Costs before a restart say nothing of the run after it.
            self.course.clear();
        } else {
            if options.patience > 0 {
                self.course.push(finite.iter().copied().fold(f64::INFINITY, f64::min));
                stuck = is_flat(&self.course, options.patience);
            }
            if stuck || settled(search, options) {
                search.end().map_err(FitError::Optimizer)?;
                self.course.clear();
            }
        }
        self.stop = why_stop(search).map(|stop| if stuck { Stop::Patience } else { stop });
        let best = search.best().ok_or_else(all_diverged)?;
        Ok(RunGeneration {
            cost: name.to_owned(),
            seed,
            best: finite.iter().copied().fold(f64::INFINITY, f64::min),
            mean: finite.iter().sum::<f64>() / finite.len() as f64,
            sigma,
            diverged,
            fallen: evaluations.iter().filter(|evaluation| evaluation.falls > 0).count(),
            falls,
            best_so_far: best.cost,
            best_values: best.x.clone(),
            stop: self.stop,
        })
    }

    /// The result of the run so far; `None` before its first finite cost.
    pub fn outcome(&self) -> Option<RunOutcome> {
        let best = self.best()?;
        Some(RunOutcome {
            seed: self.seed,
            best_cost: best.cost,
            values: best.x.clone(),
            generations: self.done() as usize,
            stop: self.stop,
            diverged: self.diverged,
            falls: self.falls,
            deviations: self.deviations(),
            mean: match &self.by {
                By::CmaEs { search, .. } => {
                    search.best_run().map_or_else(|| search.current().mean(), |start| start.mean.clone())
                }
                By::LeastSquares(_) => Vec::new(),
            },
        })
    }

    /// Width of the search in each entry where it was left, see [`RunOutcome::deviations`].
    fn deviations(&self) -> Vec<f64> {
        let By::CmaEs { search, .. } = &self.by else { return Vec::new() };
        match search.best_run() {
            // Later starts do not show how far the one with the best values came.
            Some(start) if reason(start.stop) != Stop::Converged => start.deviations.clone(),
            None if !matches!(self.stop, Some(Stop::Tolerance | Stop::Converged)) => {
                search.current().deviations()
            }
            // A search that came to its end has no spread left that could widen an interval.
            _ => Vec::new(),
        }
    }

    /// The best candidate so far.
    pub fn best(&self) -> Option<&Best> {
        match &self.by {
            By::CmaEs { search, .. } => search.best(),
            By::LeastSquares(search) => search.best(),
        }
    }

    /// State to save, under the cost's name.
    pub fn save(&self, cost: &str) -> SavedRun {
        SavedRun {
            cost: cost.to_owned(),
            seed: self.seed,
            stop: self.stop,
            diverged: self.diverged,
            falls: self.falls,
            course: self.course.clone(),
            risk: self.risk.clone(),
            state: match &self.by {
                By::CmaEs { search, .. } => SavedSearch::CmaEs(Box::new(search.state())),
                By::LeastSquares(search) => SavedSearch::LeastSquares(search.clone()),
            },
        }
    }

    /// This run in the state `saved`.
    pub fn restored(
        &self,
        cost: &str,
        saved: SavedRun,
        theta: &Theta,
        options: &FitOptions,
    ) -> Result<Self, FitError> {
        if saved.cost != cost || saved.seed != self.seed {
            let found = format!("it holds {} with seed {}", saved.cost, saved.seed);
            return Err(FitError::Checkpoint(format!("{found} where {cost} with seed {} is due", self.seed)));
        }
        let broken = |what: String| FitError::Checkpoint(what);
        let refused = |error: CmaError| match error {
            CmaError::State(what) => broken(what),
            other => broken(other.to_string()),
        };
        // The search resumes under the new limits, so it is asked anew whether and why it has stopped.
        let (by, stop) = match (&self.by, saved.state) {
            (By::CmaEs { .. }, SavedSearch::CmaEs(state)) => {
                let mut search = Search::resume(settings(self.seed, theta, options), plan(options), *state)
                    .map_err(refused)?;
                // A run that had ended at the limit of generations, which is higher now, may have settled there.
                if saved.stop == Some(Stop::Generations) && !search.is_finished() && settled(&search, options)
                {
                    search.end().map_err(refused)?;
                }
                // To the search, patience and tolerance are the same: this run ended it.
                let patient = saved.stop == Some(Stop::Patience);
                let stop = why_stop(&search).map(|stop| match stop {
                    Stop::Tolerance if patient => Stop::Patience,
                    other => other,
                });
                (By::CmaEs { search: Box::new(search), asked: None }, stop)
            }
            (By::LeastSquares(_), SavedSearch::LeastSquares(mut search)) if search.fits(theta) => {
                search.limit(options.generations).map_err(broken)?;
                let stop = search.stop();
                (By::LeastSquares(search), stop)
            }
            // A file of the other kind of search, or of another θ.
            _ => return Err(broken("its search is another one".into())),
        };
        Ok(Self {
            cost: self.cost,
            seed: self.seed,
            stop,
            diverged: saved.diverged,
            falls: saved.falls,
            course: saved.course,
            risk: saved.risk,
            by,
        })
    }
}

/// Whether the deviations of the run under way shrank to the tolerance.
fn settled(search: &Search, options: &FitOptions) -> bool {
    let current = search.current();
    let first = &current.settings().deviation;
    // The largest of all: the search has settled once its last entry has.
    let left = current.deviations().iter().zip(first).map(|(now, first)| now / first).fold(0.0, f64::max);
    left <= options.tolerance
}

/// Costs are flat if their mean changes by less than this part from the first half of the patience to the second.
const FLAT: f64 = 0.02;

/// Whether the smallest cost of each generation hardly changed over the last `patience` generations. These are cut into two
/// halves. The difference between the means of the halves plus its standard error must be less than [`FLAT`] of the first
/// mean. Draws differ from generation to generation, so one small cost shows little. Costs that rise, for example because
/// robots begin to fall, are not flat.
fn is_flat(course: &[f64], patience: usize) -> bool {
    // An odd patience is rounded up, so that both halves have the same length. A half of one has no standard error.
    let half = patience.div_ceil(2).max(2);
    let Some(last) = course.len().checked_sub(2 * half).map(|first| &course[first..]) else { return false };
    let mean = |costs: &[f64]| costs.iter().sum::<f64>() / half as f64;
    let (before, now) = (mean(&last[..half]), mean(&last[half..]));
    let apart = |costs: &[f64], mean: f64| costs.iter().map(|cost| (cost - mean).powi(2)).sum::<f64>();
    let squares = apart(&last[..half], before) + apart(&last[half..], now);
    // The standard error of the difference of two means, by the variance of both halves together.
    let error = (squares / (half - 1) as f64 / half as f64).sqrt();
    // Costs of diverged generations are infinite; their difference is no number.
    now.is_finite() && (before - now).abs() + error < FLAT * before.abs()
}

/// Why the last restart ended, once it has.
fn why_stop(search: &Search) -> Option<Stop> {
    Some(reason(search.finished().last().filter(|_| search.is_finished())?.stop))
}

fn reason(stop: StopReason) -> Stop {
    match stop {
        StopReason::TolXUp | StopReason::ConditionCov | StopReason::NumericalFailure => Stop::Degenerate,
        StopReason::MaxGenerations => Stop::Generations,
        // A run ends its search at the tolerance, or by patience, which [`Run::tell`] then names instead.
        StopReason::Ended => Stop::Tolerance,
        _ => Stop::Converged,
    }
}

fn settings(seed: u64, theta: &Theta, options: &FitOptions) -> Settings {
    let each = |field: fn(&crate::Entry) -> f64| -> Vec<f64> { theta.entries().iter().map(field).collect() };
    let mut settings = Settings::new(theta.start(seed), each(|entry| entry.deviation), seed)
        .with_bounds(each(|entry| entry.lower), each(|entry| entry.upper));
    settings.population =
        if options.population == 0 { default_population(theta.len()) } else { options.population };
    settings.covariance = options.covariance;
    settings.bound_handling = options.bounds;
    settings.tolerances.max_generations = Some(u32::try_from(options.generations).unwrap_or(u32::MAX));
    settings
}

/// Restarts from the same start with twice the population each time (Auger and Hansen, CEC 2005).
fn plan(options: &FitOptions) -> RestartPlan {
    // Each restart doubles the population, as IPOP-CMA-ES does.
    RestartPlan { runs: options.restarts.saturating_add(1), population_factor: 2, start: RestartStart::Same }
}

/// Everything that a fit needs to resume.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Checkpoint {
    /// Generations done.
    pub generation: usize,
    /// The inputs of the fit at its beginning.
    pub origin: Origin,
    /// The runs, costs first, then seeds.
    pub runs: Vec<SavedRun>,
}

/// One run as saved.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SavedRun {
    /// Cost name.
    pub cost: String,
    /// Seed.
    pub seed: u64,
    /// Why it ended, if it has.
    pub stop: Option<Stop>,
    /// Candidates that diverged so far.
    pub diverged: usize,
    /// Falls of candidates so far.
    #[serde(default)]
    pub falls: usize,
    /// Smallest cost of each generation of the present start, where patience is limited.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub course: Vec<f64>,
    /// The last candidates, if some of them fell.
    #[serde(default, skip_serializing_if = "FallRisk::is_empty")]
    pub risk: FallRisk,
    /// The optimiser.
    pub state: SavedSearch,
}

/// The optimiser's state.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum SavedSearch {
    /// CMA-ES.
    CmaEs(Box<SearchState>),
    /// Least squares.
    LeastSquares(GaussNewton),
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_course_is_flat_once_it_changes_by_less_than_a_fiftieth_from_half_to_half() {
        let course = [1.0, 0.5, 0.4, 0.38, 0.379, 0.381, 0.38];
        assert!(!is_flat(&course[..3], 4), "it is shorter than the patience");
        assert!(!is_flat(&[0.4, 0.4], 1), "two costs have no standard error");
        assert!(is_flat(&[0.4; 4], 1), "four have one");
        assert!(!is_flat(&course[..5], 4), "from 0.45 to 0.3795");
        assert!(!is_flat(&course[..6], 4), "from 0.39 to 0.38");
        assert!(is_flat(&course, 4), "from 0.3795 to 0.3805");
        assert!(!is_flat(&[0.9, 0.2, 0.8, 0.7, 0.6, 0.5], 4), "one lucky generation does not end a search");
        assert!(!is_flat(&[0.6, 0.4, 0.4, 0.6], 4), "draws hide a change");
        assert!(!is_flat(&[0.4, 0.4, 0.5, 0.5], 4), "it rises");
        assert!(!is_flat(&[f64::INFINITY; 9], 4), "nothing was simulated to the end");
    }
}
