//! The result as tables.

use crate::table::table;
use gaitfit::evaluate::{DriftResult, Evaluation};
use gaitfit::loop_::results::{Measurement, ONE_TRAINING, RANDOMISED, REFERENCE, Results, TARGET};
use gaitfit::loop_::walked;
use gaitfit_view::Estimate;
use std::fmt::Write;

/// Before and after, drift, what to know, and where the files are.
pub fn text(results: &Results) -> String {
    let mut text = String::new();
    if let Some(absent) = results.absence() {
        let _ = writeln!(text, "{}: {}\n", absent.kind.headline().to_uppercase(), absent.text);
    }
    let divergence = results.divergence();
    if let Some(sentence) = &divergence {
        let _ = writeln!(text, "DIVERGED: {sentence}.\n");
    }
    for doubt in &results.doubts {
        let _ = writeln!(text, "{}: {}\n", doubt.kind.headline().to_uppercase(), doubt.text);
    }
    let rounds = results.rounds.len();
    let _ = writeln!(
        text,
        "{}: {} in {rounds} round{}, {:.0} s ({})\n",
        results.name,
        results.robot,
        if rounds == 1 { "" } else { "s" },
        results.wall_seconds,
        results.stopped_because
    );
    for round in &results.rounds {
        for fit in &round.adapt.fits {
            // Absent if the simulation before the fit diverges.
            let nominal = fit.nominal_cost.map_or_else(|| "none".to_owned(), |cost| format!("{cost:.5}"));
            let _ = write!(text, "round {}: {} {nominal} → {:.5}", round.round, fit.cost_name, fit.cost);
            if let Some(error) = fit.mean_error_percent {
                let _ = write!(text, ", mean parameter error {error:.2} %");
            }
            text.push('\n');
        }
        if let Some(held) = &round.adapt.held_out {
            let _ = writeln!(text, "round {}: {}", round.round, held.sentence());
        }
    }
    let _ = writeln!(text, "\nTracking of random commands, mean ± 95 %\n{}", tracking(results));
    // The column `on` has short names; these lines say what they stand for.
    for place in places(results).into_iter().filter_map(|name| place(results, name)) {
        let _ = writeln!(text, "{place}");
    }
    if let Some(promise) = promise(results) {
        let _ = writeln!(text, "\n{promise}");
    }
    if !results.walked.is_empty() {
        let _ = writeln!(text, "\nOn the robot\n{}", walked::sentences(&results.walked).join("\n"));
    }
    if !results.comparisons.is_empty() {
        let _ = writeln!(text, "\n{}", comparisons(results));
    }
    if let Some(bought) = &results.bought {
        let _ = writeln!(text, "{bought}\n{ONE_TRAINING}");
    }
    if let Some(drift) = drift(results) {
        let _ = writeln!(
            text,
            "\nDrift: stand, command for 4 s, stand; distance from the place of the command\n{drift}"
        );
    }
    text.push('\n');
    // The divergence is printed already.
    for warning in results.warnings.iter().filter(|warning| Some(*warning) != divergence.as_ref()) {
        let _ = writeln!(text, "note: {warning}");
    }
    // Without the robot it was said first.
    if let Some(next) = results.next.as_ref().filter(|_| results.absence().is_none()) {
        let _ = writeln!(text, "next: {next}");
    }
    let _ = writeln!(text, "policy: {}   {}", results.policy, results.onnx);
    if let Some(round) = results.best_round() {
        // The best policy may come from an earlier round than the last.
        let number = if rounds > 1 { format!(" (round {})", round.round) } else { String::new() };
        let _ = writeln!(text, "theta{number}: {}", round.theta);
    }
    let _ = writeln!(text, "report: {}/report.html", results.run_folder);
    text
}

/// The fitted simulator's prediction for both policies, compared with the robot.
fn promise(results: &Results) -> Option<String> {
    let error = |on: &str, policy: &str| {
        let measured =
            results.evaluations.iter().find(|one| one.on == on && one.evaluation.policy == policy)?;
        let mean = measured.evaluation.linear_velocity_error.mean;
        mean.is_finite().then_some(mean)
    };
    let pair = |on: &str| Some((error(on, &results.before)?, error(on, &results.after)?));
    let simulated =
        // From the end: the last round's simulator is the best fitted one.
        results.evaluations.iter().rev().find_map(|one| pair(&one.on).filter(|_| one.on != TARGET))?;
    let (before, after) = simulated;
    let text =
        format!("Velocity error: the fitted simulator predicts {before:.3} before and {after:.3} m/s after;");
    Some(match pair(TARGET) {
        Some((before, after)) => format!("{text} the robot showed {before:.3} and {after:.3} m/s."),
        None => format!("{text} the robot has not been measured."),
    })
}

/// Names of where policies were measured, the target's first.
fn places(results: &Results) -> Vec<&str> {
    let mut places: Vec<&str> = Vec::new();
    let on_target = results.evaluations.iter().filter(|one| one.on == TARGET);
    for one in on_target.chain(&results.evaluations) {
        if !places.contains(&one.on.as_str()) {
            places.push(&one.on);
        }
    }
    places
}

/// The meaning of such a name, and how much was measured there.
fn place(results: &Results, name: &str) -> Option<String> {
    let measured = results.evaluations.iter().find(|one| one.on == name)?;
    let Evaluation { simulator, trajectories, seconds, .. } = &measured.evaluation;
    let stands_for = if simulator.is_empty() { results.target.as_deref()? } else { simulator };
    let length = if *seconds > 0.0 { format!(" of {seconds} s") } else { String::new() };
    Some(format!("{name}: {stands_for}, {trajectories} trajectories{length}"))
}

fn tracking(results: &Results) -> comfy_table::Table {
    let header = ["on", "policy", "linear error, m/s", "angular error, rad/s", "summed reward", "falls, %"];
    let mut rows = table(&header, &[2, 3, 4, 5]);
    let places = places(results);
    let mut evaluations: Vec<&Measurement> = results.evaluations.iter().collect();
    // One place after the other, the target first: what is to be compared stands together.
    evaluations.sort_by_key(|one| places.iter().position(|place| *place == one.on));
    for one in evaluations {
        let evaluation = &one.evaluation;
        let falls =
            Estimate { mean: 100.0 * evaluation.fall_rate.mean, ci95: 100.0 * evaluation.fall_rate.ci95 };
        rows.add_row([
            one.on.clone(),
            evaluation.policy.clone(),
            shown(evaluation.linear_velocity_error, 4),
            shown(evaluation.angular_velocity_error, 4),
            shown(evaluation.reward, 3),
            shown(falls, 2),
        ]);
    }
    rows
}

fn shown(estimate: Estimate, digits: usize) -> String {
    with_interval(format!("{:.digits$}", estimate.mean), estimate, digits)
}

/// `mean`, the estimate's mean in words, and the interval.
fn with_interval(mean: String, estimate: Estimate, digits: usize) -> String {
    match estimate {
        Estimate { mean, .. } if mean.is_nan() => "–".to_owned(),
        // One trajectory has a mean and no interval.
        Estimate { ci95, .. } if ci95.is_nan() => mean,
        Estimate { ci95, .. } => format!("{mean} ± {ci95:.digits$}"),
    }
}

/// The best policy minus each other one.
fn comparisons(results: &Results) -> comfy_table::Table {
    let header =
        [&format!("{} minus", results.after), "linear error, m/s", "angular error, rad/s", "falls, %", ""];
    let mut rows = table(&header, &[1, 2, 3]);
    for one in &results.comparisons {
        let falls = Estimate { mean: 100.0 * one.fall_rate.mean, ci95: 100.0 * one.fall_rate.ci95 };
        rows.add_row([
            one.against.clone(),
            difference(one.linear_velocity_error, 4),
            difference(one.angular_velocity_error, 4),
            difference(falls, 2),
            if one.paired { "same trajectories".to_owned() } else { "not paired".to_owned() },
        ]);
    }
    rows
}

fn difference(estimate: Estimate, digits: usize) -> String {
    with_interval(format!("{:+.digits$}", estimate.mean), estimate, digits)
}

/// On the target, or else in the last adapted simulator: a row a command, a column a policy.
fn drift(results: &Results) -> Option<comfy_table::Table> {
    // A robot that was not reached has no drift; the last simulator stands in for it.
    let on = match results.measured(&results.before, TARGET) {
        Some(_) => TARGET,
        None => &results.evaluations.last()?.on,
    };
    let columns: Vec<(&str, &Evaluation)> =
        [results.before.as_str(), results.after.as_str(), RANDOMISED, REFERENCE]
            .into_iter()
            .filter_map(|policy| Some((policy, results.measured(policy, on)?)))
            .filter(|(_, evaluation)| !evaluation.drift.is_empty())
            .collect();
    // The first policy's commands are the rows; all policies were measured under the same ones.
    let (_, first) = columns.first()?;
    let mut header = vec!["command"];
    header.extend(columns.iter().map(|(policy, _)| *policy));
    let mut rows = table(&header, &(1..=columns.len()).collect::<Vec<_>>());
    for (index, trial) in first.drift.iter().enumerate() {
        let mut row = vec![trial.label()];
        for (_, evaluation) in &columns {
            row.push(evaluation.drift.get(index).map_or_else(String::new, |trial| {
                let distance = trial.distance();
                if distance.is_nan() {
                    return "all fell".to_owned();
                }
                format!("{distance:.3} m {:+.3} rad", trial.yaw.mean)
            }));
        }
        rows.add_row(row);
    }
    let mut row = vec!["mean".to_owned()];
    row.extend(columns.iter().map(|(_, evaluation)| {
        let (distance, yaw) = mean_drift(evaluation);
        if distance.is_nan() { "all fell".to_owned() } else { format!("{distance:.3} m  {yaw:.3} rad") }
    }));
    rows.add_row(row);
    Some(rows)
}

/// Mean distance, m, and mean size of the turn, rad, over the commands under which any robot stood to the end.
fn mean_drift(evaluation: &Evaluation) -> (f64, f64) {
    let standing: Vec<_> = evaluation.drift.iter().filter(|trial| !trial.distance().is_nan()).collect();
    let mean = |part: fn(&DriftResult) -> f64| {
        standing.iter().map(|trial| part(trial)).sum::<f64>() / standing.len() as f64
    };
    // The size of the turn: turns to the left and to the right would cancel.
    (mean(DriftResult::distance), mean(|trial| trial.yaw.mean.abs()))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn one_trajectory_has_no_interval() {
        let one = Estimate { mean: 0.25, ci95: f64::NAN };
        assert_eq!((shown(one, 2), difference(one, 2)), ("0.25".to_owned(), "+0.25".to_owned()));
        let several = Estimate { mean: -0.5, ci95: 0.125 };
        assert_eq!(
            (shown(several, 3), difference(several, 1)),
            ("-0.500 ± 0.125".to_owned(), "-0.5 ± 0.1".to_owned())
        );
        let none = Estimate { mean: f64::NAN, ci95: f64::NAN };
        assert_eq!((shown(none, 3), difference(none, 3)), ("–".to_owned(), "–".to_owned()));
    }
}
