//! Least squares: Gauss and Newton's method with Marquardt's damping, for costs that sum differences of single samples.
//!
//! Where predictions are short the differences are smooth in θ, and a few steps along their derivatives find what
//! CMA-ES needs hundreds of candidates for. The loss is robust, see [`normal`]; the cost is reported as its own definition
//! says.
//!
//! Derivatives are the simulator's own where it has them ([`Simulator::differentiate`](crate::Simulator::differentiate)):
//! legs in the air. Elsewhere they are central differences of the simulation, wide ones: where feet touch the ground the
//! derivative at a point says less than the change over half a deviation.

mod correction;
mod indirect;
mod normal;
mod question;
mod residuals;
mod response;
mod sensitivity;
mod uncertainty;
mod unexplained;

pub use correction::{Correction, Round};
pub use indirect::{correct, sets};
pub use uncertainty::{Alternative, Shift, Uncertainty, uncertainty};
pub use unexplained::{Unexplained, descend, unexplained};

use super::FitError;
use super::stop::Stop;
use crate::cmaes::Best;
use crate::{Entry, Theta};
use gaitfit_random::{Purpose, Stream};
use normal::{Jacobian, Loss, Normal};
pub use question::{Comparison, Failure, Question, Replicate, Slope, World, answers};
pub use residuals::Problem;
use residuals::{Column, Residuals, residuals};
pub use sensitivity::{Sensitivity, sensitivity};
use serde::{Deserialize, Serialize};

/// Most entries that least squares takes.
pub const MAX_ENTRIES: usize = 200;
/// Distance of the two candidates of a derivative from their middle, in an entry's deviations: far enough for the effect
/// to stand out from feet that touch the ground a moment sooner or later.
const PROBE: f64 = 0.5;
/// Dampings tried in a generation, times the one that served last. All four are simulated together. The first one
/// lets the damping fall again.
const DAMPINGS: [f64; 4] = [1e-2, 1.0, 1e2, 1e4];
/// The damping of the first step, as in Press et al., "Numerical Recipes", section 15.5.
const FIRST_DAMPING: f64 = 1e-3;
/// A step with this damping counts as undamped.
const MIN_DAMPING: f64 = 1e-9;
const MAX_DAMPING: f64 = 1e9;
/// A loss that falls by less than this part has come to its end.
const PROGRESS: f64 = 1e-7;
/// How much the damping rises where no step is downhill. The least factor of the next [`DAMPINGS`] then gives the
/// largest damping that was tried.
const RISE: f64 = 1e6;
/// Where no step is downhill with this damping, none is. The largest trial has a damping of at least 1e6, and its
/// step is too short to matter.
const STEEP: f64 = 1e2;

/// The state of a search; one generation is one step.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct GaussNewton {
    /// Steps done.
    generation: u32,
    /// θ now.
    values: Vec<f64>,
    /// Marquardt's damping.
    damping: f64,
    /// The cost after the last step, and its θ.
    best: Option<Best>,
    /// Why it ended.
    stop: Option<Stop>,
}

/// The value nearest to `value` that is a deviation off the bounds of `entry`, or in their middle.
pub fn off_bounds(entry: &Entry, value: f64) -> f64 {
    // In a range narrower than two deviations the middle is as far off the bounds as can be.
    let room = (0.5 * (entry.upper - entry.lower)).min(entry.deviation);
    value.clamp(entry.lower + room, entry.upper - room)
}

/// The result of one step.
pub(super) struct Stepped {
    /// Cost after the step.
    pub cost: f64,
    /// Mean cost of the candidates tried.
    pub mean: f64,
    /// Largest part of the undamped step, in an entry's deviations; 0 where none was taken.
    pub size: f64,
    pub evaluations: usize,
    pub diverged: usize,
    pub fallen: usize,
    pub falls: usize,
}

impl GaussNewton {
    /// A search of run number `seed`: the first begins at θ's start, moved off its bounds, where a derivative says little.
    pub(super) fn new(theta: &Theta, seed: u64, first: bool) -> Self {
        let mut start = theta.start(seed);
        let mut draws = vec![0.0; start.len()];
        // Draws of 0 leave the first search at θ's own start.
        if !first {
            Stream::new(seed, Purpose::RESTART).fill_normals(0, &mut draws);
        }
        for ((value, entry), draw) in start.iter_mut().zip(theta.entries()).zip(draws) {
            // Off the bounds both neighbours of a value exist, so the first derivatives are central.
            *value = off_bounds(entry, *value + draw * entry.deviation);
        }
        Self { generation: 0, values: start, damping: FIRST_DAMPING, best: None, stop: None }
    }

    pub(super) fn generation(&self) -> u32 {
        self.generation
    }

    pub(super) fn best(&self) -> Option<&Best> {
        self.best.as_ref()
    }

    pub(super) fn stop(&self) -> Option<Stop> {
        self.stop
    }

    /// Whether the state belongs to `theta`.
    pub(super) fn fits(&self, theta: &Theta) -> bool {
        let inside = |(value, entry): (&f64, &Entry)| (entry.lower..=entry.upper).contains(value);
        let whole =
            |values: &[f64]| values.len() == theta.len() && values.iter().zip(theta.entries()).all(inside);
        let best = match &self.best {
            Some(best) => whole(&best.x) && best.cost.is_finite(),
            // Without a best candidate the search must not have begun.
            None => self.stop.is_none() && self.generation == 0,
        };
        whole(&self.values) && best && (MIN_DAMPING..=MAX_DAMPING).contains(&self.damping)
    }

    /// Puts another limit of generations in the place of the one that the state was saved under.
    ///
    /// # Errors
    /// In words: more generations are done than that.
    pub(super) fn limit(&mut self, generations: usize) -> Result<(), String> {
        let done = self.generation as usize;
        if done > generations {
            return Err(format!("it has done {done} generations, and the limit is {generations} now"));
        }
        // A search that only its limit had ended resumes. One that has done the new limit's generations ends.
        match self.stop {
            Some(Stop::Generations) if done < generations => self.stop = None,
            None if done == generations && done > 0 => self.stop = Some(Stop::Generations),
            _ => {}
        }
        Ok(())
    }

    /// One step. `None` if the simulation of the present θ diverges.
    ///
    /// # Errors
    /// As [`Problem::residuals`]; the state is then as it was before.
    pub(super) fn step(
        &mut self,
        problem: &Problem<'_>,
        generations: usize,
        tolerance: f64,
    ) -> Result<Option<Stepped>, FitError> {
        Ok(step(&mut [(self, *problem)], generations, tolerance)?.pop().flatten())
    }

    /// Candidates for the next step, one per damping.
    fn trials(&self, theta: &Theta, slopes: &Slopes) -> Vec<Trial> {
        let dampings = DAMPINGS.iter().map(|factor| (self.damping * factor).clamp(MIN_DAMPING, MAX_DAMPING));
        let trial = |damping: f64| {
            let step = slopes.normal.step(damping, &slopes.free)?;
            Some(Trial { damping, values: moved(theta, &self.values, step.iter()) })
        };
        dampings.filter_map(trial).collect()
    }

    /// Goes to the best of `trials`, if one is downhill. `tried`: their differences.
    fn choose(
        &mut self,
        theta: &Theta,
        slopes: &Slopes,
        (trials, tried): (&[Trial], &[Option<Residuals>]),
        (generations, tolerance): (usize, f64),
    ) -> Stepped {
        let Slopes { here, loss, normal, free } = slopes;
        let before = loss.mean(&here.residuals);
        // Losses decide, not costs: steps minimise the robust loss, and the cost is only reported.
        let losses = tried.iter().enumerate().filter_map(|(at, one)| Some((at, loss.mean(one.as_ref()?))));
        let lowest = losses.min_by(|a, b| a.1.total_cmp(&b.1));
        let costs: Vec<f64> = tried.iter().flatten().map(|one| one.cost).collect();
        // Falls at the present point count as well, so that the report shows what the step was made of.
        let residuals = tried.iter().flatten().chain([&here.residuals]);
        let (fallen, falls) = residuals
            .fold((0, 0), |(fallen, falls), one| (fallen + usize::from(one.falls > 0), falls + one.falls));
        self.generation += 1;
        let mut stepped = Stepped {
            cost: here.residuals.cost,
            mean: costs.iter().sum::<f64>() / costs.len().max(1) as f64,
            size: 0.0,
            evaluations: here.evaluations + tried.len(),
            diverged: tried.iter().filter(|one| one.is_none()).count(),
            fallen,
            falls,
        };
        let accepted = lowest.filter(|(_, lowest)| *lowest < before * (1.0 - PROGRESS));
        // A step, then the three ways in which there is none: nothing free to move, no way down, or too long a
        // step.
        match accepted.and_then(|(at, _)| Some((at, tried[at].as_ref()?))) {
            Some((at, residuals)) => {
                let Trial { damping, values } = &trials[at];
                // The step that no damping shortens says how far the end is.
                let whole = normal.step(MIN_DAMPING, free);
                let left = whole.map(|step| moved(theta, &self.values, step.iter()));
                stepped.size = size(theta, &self.values, left.as_ref().unwrap_or(values));
                stepped.cost = residuals.cost;
                self.damping = *damping;
                self.values.clone_from(values);
                if stepped.size <= tolerance {
                    self.stop = Some(Stop::Tolerance);
                }
            }
            None if trials.is_empty() => self.stop = Some(Stop::Degenerate),
            // No direction is downhill: this is the lowest point, but for the rounding of the simulation.
            None if self.damping >= STEEP => self.stop = Some(Stop::Converged),
            // At least `STEEP`, so that the search ends if the next trials fail too.
            None => self.damping = (self.damping * RISE).clamp(STEEP, MAX_DAMPING),
        }
        if self.stop.is_none() && self.generation as usize >= generations {
            self.stop = Some(Stop::Generations);
        }
        // The last values are the answer: the loss falls with every step, the cost nearly so.
        self.best =
            Some(Best { x: self.values.clone(), cost: stepped.cost, generation: self.generation - 1 });
        stepped
    }
}

/// Values that a step may lead to, and its damping.
struct Trial {
    damping: f64,
    values: Vec<f64>,
}

/// The equations of a step.
struct Slopes {
    here: Around,
    loss: Loss,
    normal: Normal,
    free: Vec<bool>,
}

impl Slopes {
    fn new(problem: &Problem<'_>, values: &[f64], here: Around) -> Self {
        let loss = Loss::new(&here.residuals);
        let normal = Normal::whole(&here.jacobian, &here.residuals, loss, problem.simulator.threads());
        let free = free(problem.theta, values, &normal);
        Self { here, loss, normal, free }
    }
}

/// One step of each of some searches with the same simulator and θ, whose candidates are simulated together. `None` in the place of
/// a search if the simulation of its present θ diverges.
///
/// # Errors
/// As [`Problem::residuals`]; no search has moved then.
pub(super) fn step(
    searches: &mut [(&mut GaussNewton, Problem<'_>)],
    generations: usize,
    tolerance: f64,
) -> Result<Vec<Option<Stepped>>, FitError> {
    // The present points of all searches and their derivatives are one batch.
    let points: Vec<(Problem<'_>, &[f64])> =
        searches.iter().map(|(search, problem)| (*problem, search.values.as_slice())).collect();
    let around = around_all(&points)?.into_iter().zip(&points);
    let slopes: Vec<Option<Slopes>> =
        // A search whose present point diverges has no slopes and no trials, but keeps its place in the list.
        around.map(|(here, (problem, values))| Some(Slopes::new(problem, values, here?))).collect();
    // The trials of all searches are a second one.
    let trials: Vec<Vec<Trial>> = searches
        .iter()
        .zip(&slopes)
        .map(|((search, problem), slopes)| {
            slopes.as_ref().map_or_else(Vec::new, |slopes| search.trials(problem.theta, slopes))
        })
        .collect();
    // Values are copied out of the trials, because `residuals` takes plain lists of candidates.
    let candidates: Vec<Vec<Vec<f64>>> =
        trials.iter().map(|trials| trials.iter().map(|one| one.values.clone()).collect()).collect();
    let asked: Vec<(Problem<'_>, &[Vec<f64>])> =
        searches.iter().zip(&candidates).map(|((_, problem), all)| (*problem, all.as_slice())).collect();
    let tried = residuals(&asked)?;
    // Each search chooses among its own trials.
    let known = slopes.iter().zip(trials.iter().zip(&tried));
    let chosen = searches.iter_mut().zip(known).map(|((search, problem), (slopes, (trials, tried)))| {
        let slopes = slopes.as_ref()?;
        Some(search.choose(problem.theta, slopes, (trials, tried), (generations, tolerance)))
    });
    Ok(chosen.collect())
}

/// A point of θ with the derivatives there.
struct Around {
    residuals: Residuals,
    jacobian: Jacobian,
    evaluations: usize,
}

/// Simulates `values` with derivatives, or else with its neighbours; `None` if one of them diverges.
fn around(problem: &Problem<'_>, values: &[f64]) -> Result<Option<Around>, FitError> {
    Ok(around_all(&[(*problem, values)])?.pop().flatten())
}

/// Does what [`around`] does for several points, which are simulated together.
fn around_all(points: &[(Problem<'_>, &[f64])]) -> Result<Vec<Option<Around>>, FitError> {
    let near = points.iter().map(|(problem, values)| Neighbourhood::new(*problem, values));
    let near = near.collect::<Result<Vec<_>, _>>()?;
    let asked: Vec<(Problem<'_>, &[Vec<f64>])> =
        near.iter().map(|near| (near.problem, near.simulated())).collect();
    let simulated = residuals(&asked)?;
    near.into_iter().zip(simulated).map(|(near, residuals)| near.around(residuals)).collect()
}

/// A point and its neighbours.
struct Neighbourhood<'a> {
    problem: Problem<'a>,
    /// The point, and behind it the two neighbours of each entry.
    candidates: Vec<Vec<f64>>,
    /// Distance between the two neighbours of each entry, in its unit.
    steps: Vec<f64>,
    /// The simulator's own derivatives at the point: its neighbours are not needed then.
    exact: Option<Vec<Column>>,
}

impl<'a> Neighbourhood<'a> {
    fn new(problem: Problem<'a>, values: &[f64]) -> Result<Self, FitError> {
        let mut candidates = vec![values.to_vec()];
        let mut steps = Vec::with_capacity(values.len());
        for (at, entry) in problem.theta.entries().iter().enumerate() {
            let room = 0.5 * (entry.upper - entry.lower);
            // At most half of the range, so that one of the two neighbours always has its full distance.
            let probe = (PROBE * entry.deviation).min(room);
            let mut at_most = |to: f64| {
                let mut candidate = values.to_vec();
                candidate[at] = to.clamp(entry.lower, entry.upper);
                candidates.push(candidate);
                candidates.last().map_or(to, |candidate| candidate[at])
            };
            // At a bound one of the two stays where it is, and the difference is one-sided.
            steps.push(at_most(values[at] + probe) - at_most(values[at] - probe));
        }
        // Refused before anything is simulated: a long simulation must not end for want of memory.
        problem.check(problem.differences()?.count(), candidates.len())?;
        let exact = problem.derivatives(values)?;
        Ok(Self { problem, candidates, steps, exact })
    }

    /// The candidates that must be simulated.
    fn simulated(&self) -> &[Vec<f64>] {
        if self.exact.is_some() { &self.candidates[..1] } else { &self.candidates }
    }

    /// [`around`], from the differences of the candidates that were simulated.
    fn around(self, residuals: Vec<Option<Residuals>>) -> Result<Option<Around>, FitError> {
        let (width, threads) = (self.problem.differences()?.width(), self.problem.simulator.threads());
        // One neighbour that diverges leaves a column without a derivative, so there is no step at all.
        let all: Option<Vec<Residuals>> = residuals.into_iter().collect();
        let mut all = all.into_iter().flatten();
        let Some(residuals) = all.next() else { return Ok(None) };
        if let Some(columns) = self.exact {
            let jacobian = Jacobian::exact(columns, width);
            // An exact derivative counts as one simulation.
            return Ok(Some(Around { residuals, jacobian, evaluations: 1 + self.steps.len() }));
        }
        let mut pairs = Vec::with_capacity(self.steps.len());
        while let (Some(up), Some(down)) = (all.next(), all.next()) {
            pairs.push((up, down, self.steps[pairs.len()]));
        }
        let jacobian = Jacobian::new(pairs, width, threads);
        Ok(Some(Around { residuals, jacobian, evaluations: self.candidates.len() }))
    }
}

/// Entries that may move: all but those on a bound beyond which the loss falls.
fn free(theta: &Theta, values: &[f64], normal: &Normal) -> Vec<bool> {
    let held = |(at, entry): (usize, &Entry)| {
        let slope = normal.slope[at];
        // A step goes against the slope: a positive slope pushes downwards.
        values[at] <= entry.lower && slope > 0.0 || values[at] >= entry.upper && slope < 0.0
    };
    theta.entries().iter().enumerate().map(|one| !held(one)).collect()
}

/// `values` after a step, within the bounds.
fn moved<'a>(theta: &Theta, values: &[f64], step: impl Iterator<Item = &'a f64>) -> Vec<f64> {
    let entries = theta.entries().iter().zip(values).zip(step);
    entries.map(|((entry, value), step)| (value + step).clamp(entry.lower, entry.upper)).collect()
}

/// Largest part of a step, in an entry's deviations.
fn size(theta: &Theta, from: &[f64], to: &[f64]) -> f64 {
    let entries = theta.entries().iter().zip(from).zip(to);
    entries.map(|((entry, from), to)| (to - from).abs() / entry.deviation).fold(0.0, f64::max)
}
