//! Why a fit must not be used without checking, and what else a reader must know of it.

use super::cost_result::CostFit;
use super::parameter::Parameter;
use super::standing::stopped_by_bound;
use gaitfit_adapt::fit::{CostOutcome, Likeness, RunGeneration, Stop, unsettled};
use gaitfit_view::{Doubt, DoubtKind};

/// The doubts about what a cost found; `course`: the generations of its runs.
pub fn doubts(
    outcome: &CostOutcome,
    nominal_cost: Option<f64>,
    nominal_falls: usize,
    course: &[RunGeneration],
) -> Vec<Doubt> {
    let mut doubts = Vec::new();
    // As good as before the fit counts as no better.
    if let Some(nominal) = nominal_cost.filter(|nominal| *nominal <= outcome.best_cost) {
        let falls = if nominal_falls > 0 { " (some of its robots fall)" } else { "" };
        let text = format!(
            "{} {:.5} fitted, {nominal:.5} of the robot before the fit{falls}: no fitted robot is better than the \
             robot before the fit. Fit other parameters.",
            outcome.cost, outcome.best_cost
        );
        doubts.push(Doubt::new(DoubtKind::WorseThanNominal, text));
    }
    let best = outcome.runs.iter().min_by(|a, b| a.best_cost.total_cmp(&b.best_cost));
    // The course is that of the best run alone: other seeds' falling costs do not matter.
    let seed = best.map(|run| run.seed);
    let course: Vec<f64> = course
        .iter()
        .filter(|one| one.cost == outcome.cost && Some(one.seed) == seed)
        .map(|one| one.best_so_far)
        .collect();
    let reasons = unsettled(outcome, &course);
    if !reasons.is_empty() {
        // More generations help neither least squares that ended by itself nor a search that its time limit cut.
        let apart =
            outcome.uncertainty.is_some() && best.is_some_and(|run| run.stop != Some(Stop::Generations));
        let cut = best.is_some_and(|run| run.stop.is_none());
        let more = if apart || cut { "" } else { " Give it more generations (optimizer.generations)." };
        let text = format!("{}{more}", reasons.join(" "));
        doubts.push(Doubt::new(DoubtKind::NotConverged, text));
    }
    if let Some(cost) = outcome.unlike {
        let text = format!(
            "No simulated robot has logs like these. A search found values with a {} of {:.3}; the values by a regression \
             on simulated robots have {cost:.3}. Robots with the search's values are nearer to the logs. The \
             model lacks an effect, and these values compensate for it. `gaitfit explain` looks for such effects; `odd_joints` \
             with the cost `matchr1` looks for a joint that differs from its siblings.",
            outcome.cost, outcome.best_cost
        );
        doubts.push(Doubt::new(DoubtKind::Unexplained, text));
    }
    let likeness = outcome.regression.as_ref().and_then(|regression| regression.likeness);
    if let Some(likeness) = likeness.filter(Likeness::unlike) {
        let text = format!(
            "The logs differ by more than chance from those of simulated robots with the values found and their errors. The mean \
             square difference is {:.1} times their variance; chance explains at most {:.1}. The model lacks an effect. \
             `gaitfit explain` looks for effects. If it names none, fit more parameters (the default ones), or look for a \
             joint that differs from its siblings: `odd_joints` with the cost `matchr1`.",
            likeness.distance, likeness.by_chance,
        );
        doubts.push(Doubt::new(DoubtKind::Unexplained, text));
    }
    doubts
}

/// Warnings about one fit besides its doubts, the most important first.
pub fn warnings(fit: &CostFit, several: bool) -> Vec<String> {
    let prefix = if several { format!("{}: ", fit.cost_name) } else { String::new() };
    let mut warnings = Vec::new();
    if fit.falls > 0 {
        warnings.push(format!(
            "{prefix}the fitted robot falls in {} of the logs: a simulator that falls can match a bad log",
            fit.falls
        ));
    }
    // Draws that the search did not use show whether the robot only seemed to walk by luck.
    if let Some(redrawn) = fit.redrawn.filter(|redrawn| redrawn.falls > 0) {
        warnings.push(format!(
            "{prefix}the fitted robot falls in {} of {} walks that were simulated again with other draws",
            redrawn.falls, redrawn.simulations
        ));
    }
    for parameter in fit.parameters.iter().filter(|one| stopped_by_bound(one)) {
        let name = &parameter.found.name;
        warnings.push(format!("{prefix}{name} rests on a bound of its search: widen it, or distrust it"));
    }
    warnings.extend(unidentified(fit).map(|text| format!("{prefix}{text}")));
    warnings.extend(moved(fit).map(|text| format!("{prefix}{text}")));
    warnings.extend(corrected(fit).map(|text| format!("{prefix}{text}")));
    warnings.extend(regressed(fit).map(|text| format!("{prefix}{text}")));
    let diverged: usize = fit.runs.iter().map(|run| run.diverged).sum();
    if diverged > 0 {
        warnings.push(format!("{prefix}{diverged} candidates diverged and were ranked last"));
    }
    warnings
}

/// Parameters that the logs do not identify, each with the range in which it fits as well.
fn unidentified(fit: &CostFit) -> Option<String> {
    let range = |parameter: &Parameter| {
        let estimate = &parameter.found;
        let [lower, upper] = parameter.interval.filter(|_| parameter.identified == Some(false))?;
        let unit = if estimate.unit == "-" { String::new() } else { format!(" {}", estimate.unit) };
        Some(format!("{} (anything from {lower:.3} to {upper:.3}{unit} is possible)", estimate.name))
    };
    let ranges: Vec<String> = fit.parameters.iter().filter_map(range).collect();
    (!ranges.is_empty()).then(|| format!("the logs do not identify {}", ranges.join(", ")))
}

/// A sentence that the values of `outcome` are not corrected by simulated logs, and why.
pub fn uncorrected(outcome: &CostOutcome, reason: &str) -> String {
    format!(
        "{}: the values are not corrected by simulated logs: they hold errors of the fit's step and of torque noise. \
         {reason}",
        outcome.cost
    )
}

/// The values that a correction moved, in words.
fn moves(fit: &CostFit) -> String {
    let far = |parameter: &&Parameter| {
        let estimate = &parameter.found;
        // Small numbers near 0 change by large parts, so the bound is on the range too.
        let before = estimate.uncorrected.unwrap_or(estimate.value);
        let min = (LITTLE.0 * before.abs()).max(LITTLE.1 * (estimate.upper - estimate.lower));
        (estimate.value - before).abs() > min
    };
    let far: Vec<String> = (fit.parameters.iter().filter(far))
        .map(|one| {
            let estimate = &one.found;
            format!(
                "{} {:.4} to {:.4}",
                estimate.name,
                estimate.uncorrected.unwrap_or(estimate.value),
                estimate.value
            )
        })
        .collect();
    let mut by = far[..far.len().min(NAMED)].join(", ");
    if far.is_empty() {
        // The sentence must have an object even if nothing moved.
        by = "none by more than a hundredth".to_owned();
    } else if far.len() > NAMED {
        by.push_str(&format!(" and {} more (result.json has all)", far.len() - NAMED));
    }
    by
}

/// Sentences that simulated robots gave the values, how far these moved, and where the real robot is not like them.
fn regressed(fit: &CostFit) -> Option<String> {
    let regression = fit.regression.as_ref()?;
    let best = fit.runs.iter().map(|run| run.best_cost).fold(f64::INFINITY, f64::min);
    let robots = regression.robots;
    // A regression whose values are not taken still gives the intervals.
    let mut text = if regression.taken {
        format!(
            "the values are corrected by the logs of {robots} simulated robots whose values are known: {}. Before, {} was \
             {best:.5}",
            moves(fit),
            fit.cost_name
        )
    } else {
        format!(
            "the search gave the values; {robots} simulated robots, whose values are known, gave the intervals by their logs"
        )
    };
    let unlike = fit.parameters.iter().enumerate().filter(|(at, _)| regression.unlike(*at));
    let unlike: Vec<&str> = unlike.map(|(_, one)| one.found.name.as_str()).collect();
    if !unlike.is_empty() {
        text.push_str(&format!(
            ". Signals of the real robot's legs disagree about {} more than those of simulated robots do: the simulator lacks \
             something, and the intervals are wider for it",
            unlike.join(", ")
        ));
    }
    if let Some(likeness) = regression.likeness.filter(Likeness::unlike) {
        text.push_str(&format!(
            ". The logs are further from those of simulated robots than chance explains, so the intervals are {:.1} times as \
             wide",
            likeness.ratio()
        ));
    }
    Some(text)
}

/// Values that a correction moves by less than this part, and by this part of their bounds, are not named.
const LITTLE: (f64, f64) = (0.01, 0.002);
/// Values that a note of a correction names.
const NAMED: usize = 6;

/// Sentences that the values are corrected, how far, and what the differences of logs show of the robot.
fn corrected(fit: &CostFit) -> Option<String> {
    let correction = fit.correction.as_ref()?;
    let best = fit.runs.iter().map(|run| run.best_cost).fold(f64::INFINITY, f64::min);
    Some(format!(
        "the values are corrected by {} sets of logs of the simulated robot: {}. Before, {} was {best:.5}. The logs \
         differ from predictions like those of a robot with torque noise of {:.1} N·m; this includes sensor noise and \
         everything else that the simulator lacks",
        correction.replicates,
        moves(fit),
        fit.cost_name,
        correction.torque_noise
    ))
}

/// A value that another simulator moves by this part, and by this part of its bounds, depends on the simulator.
const MOVED: (f64, f64) = (0.1, 0.005);

/// Values that depend on how the robot is simulated, a sentence for each other simulator. Corrected ones have lost what the
/// simulator makes of them.
fn moved(fit: &CostFit) -> impl Iterator<Item = String> {
    let shifts = fit
        .uncertainty
        .iter()
        .filter(|_| fit.correction.is_none())
        .flat_map(|uncertainty| &uncertainty.shifts);
    shifts.filter_map(|shift| {
        let far = |(parameter, by): (&Parameter, &f64)| {
            let estimate = &parameter.found;
            let min = (MOVED.0 * estimate.value.abs()).max(MOVED.1 * (estimate.upper - estimate.lower));
            // A value that the logs do not identify moves with every change of the simulator. This says
            // nothing of the simulator.
            let flat = parameter.identified == Some(false);
            (by.abs() > min && !flat).then(|| {
                format!(
                    "{} {:.3} instead of {:.3}",
                    estimate.name,
                    (estimate.value + by).clamp(estimate.lower, estimate.upper),
                    estimate.value
                )
            })
        };
        let far: Vec<String> = fit.parameters.iter().zip(&shift.by).filter_map(far).collect();
        (!far.is_empty()).then(|| format!("with {} the fit would give {}", shift.what, far.join(", ")))
    })
}
