//! When a run ends.

use super::{Settings, State};
use serde::{Deserialize, Serialize};

/// Thresholds of the criteria (tutorial, appendix B.3; values and exact comparisons as the `cmaes` package).
#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct Tolerances {
    /// Stop when best and worst costs of the last 10 + ⌈30 n/λ⌉ generations span less; 1e-12.
    pub tolfun: f64,
    /// Stop when σ·C_ii and σ·p_c are below this times the initial σ in every coordinate; 1e-12.
    pub tolx: f64,
    /// Stop when σ times the longest axis exceeds this (in scaled coordinates); 1e4.
    pub tolxup: f64,
    /// Stop when the ratio of the longest to the shortest axis exceeds this; 1e14.
    pub conditioncov: f64,
    /// Stop after this many generations; none by default.
    pub max_generations: Option<u32>,
    /// Stop when a cost at or below this was seen; none by default.
    pub target_cost: Option<f64>,
}

impl Default for Tolerances {
    fn default() -> Self {
        Self {
            tolfun: 1e-12,
            tolx: 1e-12,
            tolxup: 1e4,
            conditioncov: 1e14,
            max_generations: None,
            target_cost: None,
        }
    }
}

/// Why a run ended.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum StopReason {
    /// Costs no longer change.
    TolFun,
    /// Steps have become negligible.
    TolX,
    /// Steps grow without bound: the initial deviation is far too small, or the cost has no minimum.
    TolXUp,
    /// Adding a fifth of a standard deviation to some coordinate does not change the mean.
    NoEffectCoordinate,
    /// Adding a tenth of a principal axis does not change the mean.
    NoEffectAxis,
    /// The covariance is too elongated for double precision.
    ConditionCov,
    /// `max_generations` reached.
    MaxGenerations,
    /// `target_cost` reached.
    TargetCost,
    /// Whoever runs the search ended this run, see [`Search::end`](super::Search::end).
    Ended,
    /// An update left the finite numbers and was dropped.
    NumericalFailure,
}

/// Generations that `tolfun` looks back: 10 + ⌈30 n/λ⌉.
pub(crate) fn history_length(n: usize, population: usize) -> usize {
    10 + (30 * n).div_ceil(population)
}

/// The first criterion met, if any.
pub(crate) fn reason(settings: &Settings, state: &State) -> Option<StopReason> {
    let tolerances = &settings.tolerances;
    let best = state.best.as_ref().map(|best| best.cost);
    // A reached target comes before all others: the search needs no further runs then.
    if tolerances.target_cost.zip(best).is_some_and(|(target, cost)| cost <= target) {
        return Some(StopReason::TargetCost);
    }
    if tolerances.max_generations.is_some_and(|limit| state.generation >= limit) {
        return Some(StopReason::MaxGenerations);
    }
    if state.numerical_failure {
        return Some(StopReason::NumericalFailure);
    }
    // Before, the ring still has the zeros that it began with.
    if state.generation as usize > state.history.len() {
        let smallest = state.history.iter().map(|[best, _]| *best).fold(f64::INFINITY, f64::min);
        let largest = state.history.iter().map(|[_, worst]| *worst).fold(f64::NEG_INFINITY, f64::max);
        if largest - smallest < tolerances.tolfun {
            return Some(StopReason::TolFun);
        }
    }
    let (mean, sigma) = (&state.mean, state.sigma);
    let diagonal = state.covariance.diagonal();
    let tolx = tolerances.tolx * settings.sigma;
    // As the package `cmaes` does: C_ii instead of its root, and p_c with its sign.
    if diagonal.iter().chain(&state.p_c).all(|value| sigma * value < tolx) {
        return Some(StopReason::TolX);
    }
    let lengths = state.covariance.axis_lengths();
    let longest = lengths.iter().copied().fold(0.0, f64::max);
    let shortest = lengths.iter().copied().fold(f64::INFINITY, f64::min);
    if sigma * longest > tolerances.tolxup {
        return Some(StopReason::TolXUp);
    }
    // Floating-point numbers absorb so small a step, so no draw would differ from the mean.
    if mean.iter().zip(&diagonal).any(|(m, variance)| *m == m + 0.2 * sigma * variance.sqrt()) {
        return Some(StopReason::NoEffectCoordinate);
    }
    // One axis a generation, in turn.
    let i = state.generation as usize % mean.len();
    let axis = state.covariance.axis(i);
    if mean.iter().zip(&axis).all(|(m, component)| *m == m + 0.1 * sigma * lengths[i] * component) {
        return Some(StopReason::NoEffectAxis);
    }
    (longest / shortest > tolerances.conditioncov).then_some(StopReason::ConditionCov)
}
