//! Why a fit must not be taken as it stands, and what else to know of it.

use super::results::{CostFit, Parameter};
use gaitfit_adapt::fit::{CostOutcome, RunGeneration, Stop, unsettled};
use gaitfit_view::{Doubt, DoubtKind};

/// The doubts about what a cost found; `course`: the generations of its runs.
pub fn doubts(
    outcome: &CostOutcome,
    nominal_cost: Option<f64>,
    nominal_falls: usize,
    course: &[RunGeneration],
) -> Vec<Doubt> {
    let mut doubts = Vec::new();
    if let Some(nominal) = nominal_cost.filter(|nominal| *nominal <= outcome.best_cost) {
        let falls = if nominal_falls > 0 { " (some of its robots fall)" } else { "" };
        let text = format!(
            "{} {:.5} fitted, {nominal:.5} of the robot before the fit{falls}: nothing fits better than the robot as it \
             was. Fit other parameters.",
            outcome.cost, outcome.best_cost
        );
        doubts.push(Doubt::new(DoubtKind::WorseThanNominal, text));
    }
    let best = outcome.runs.iter().min_by(|a, b| a.best_cost.total_cmp(&b.best_cost));
    let seed = best.map(|run| run.seed);
    let course: Vec<f64> = course
        .iter()
        .filter(|one| one.cost == outcome.cost && Some(one.seed) == seed)
        .map(|one| one.best_so_far)
        .collect();
    let reasons = unsettled(outcome, &course);
    if !reasons.is_empty() {
        let apart =
            outcome.uncertainty.is_some() && best.is_some_and(|run| run.stop != Some(Stop::Generations));
        let more = if apart { "" } else { " Give it more generations (optimizer.generations)." };
        let text = format!("{}{more}", reasons.join(" "));
        doubts.push(Doubt::new(DoubtKind::NotConverged, text));
    }
    doubts
}

/// Whether a value would have gone on but for a bound of its search: 0 is an end of many quantities and no such bound.
pub fn stopped_by_bound(parameter: &Parameter) -> bool {
    let found = &parameter.found;
    let upper = found.value - found.lower >= found.upper - found.value;
    found.at_bound && (upper || found.lower != 0.0)
}

/// What a reader must know of one fit besides its doubts.
pub fn warnings(fit: &CostFit, several: bool) -> Vec<String> {
    let of = if several { format!("{}: ", fit.cost_name) } else { String::new() };
    let mut warnings = Vec::new();
    for parameter in &fit.parameters {
        let found = &parameter.found;
        if let Some(identification) = found.identification.as_ref().filter(|one| !one.identified) {
            let unit = if found.unit == "-" { String::new() } else { format!(" {}", found.unit) };
            warnings.push(format!(
                "{of}the logs do not identify {}: anything from {:.3} to {:.3}{unit} fits as well",
                found.name, identification.lower, identification.upper
            ));
        }
        if stopped_by_bound(parameter) {
            warnings
                .push(format!("{of}{} rests on a bound of its search: widen it, or distrust it", found.name));
        }
    }
    warnings.extend(moved(fit).map(|text| format!("{of}{text}")));
    if fit.falls > 0 {
        warnings.push(format!(
            "{of}the fitted robot falls in {} of the logs: a simulator that falls can match a bad log",
            fit.falls
        ));
    }
    let diverged: usize = fit.runs.iter().map(|run| run.diverged).sum();
    if diverged > 0 {
        warnings.push(format!("{of}{diverged} candidates diverged and were ranked last"));
    }
    warnings
}

/// A value that another simulator moves by this part, and by this part of its bounds, depends on the simulator.
const MOVED: (f64, f64) = (0.1, 0.005);

/// Values that depend on how the robot is simulated, a sentence for each other simulator.
fn moved(fit: &CostFit) -> impl Iterator<Item = String> {
    let shifts = fit.uncertainty.iter().flat_map(|uncertainty| &uncertainty.shifts);
    shifts.filter_map(|shift| {
        let far = |(parameter, by): (&Parameter, &f64)| {
            let found = &parameter.found;
            let least = (MOVED.0 * found.value.abs()).max(MOVED.1 * (found.upper - found.lower));
            let flat = parameter.identified == Some(false);
            (by.abs() > least && !flat).then(|| {
                format!(
                    "{} {:.3} instead of {:.3}",
                    found.name,
                    (found.value + by).clamp(found.lower, found.upper),
                    found.value
                )
            })
        };
        let far: Vec<String> = fit.parameters.iter().zip(&shift.by).filter_map(far).collect();
        (!far.is_empty()).then(|| format!("with {} the fit would find {}", shift.what, far.join(", ")))
    })
}
