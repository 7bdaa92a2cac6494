//! The result as tables.

use super::results::{REFERENCE, Results, TARGET};
use crate::table::table;
use crate::target::Evaluation;
use gaitfit_view::loop_report::Estimate;
use std::fmt::Write;

/// Before and after, drift, what to know, and where the files are.
pub fn text(results: &Results) -> String {
    let mut text = String::new();
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
            let nominal = fit.nominal_cost.map_or_else(|| "none".to_owned(), |cost| format!("{cost:.5}"));
            let _ = write!(text, "round {}: {} {nominal} → {:.5}", round.round, fit.cost_name, fit.cost);
            if let Some(error) = fit.mean_error_percent {
                let _ = write!(text, ", mean parameter error {error:.2} %");
            }
            text.push('\n');
        }
    }
    let _ = writeln!(text, "\nTracking of random commands, mean ± 95 %\n{}", tracking(results));
    if let Some(drift) = drift(results) {
        let _ = writeln!(
            text,
            "\nDrift: stand, command for 4 s, stand; how far from where it should it ends\n{drift}"
        );
    }
    text.push('\n');
    for warning in &results.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    if let Some(next) = &results.next {
        let _ = writeln!(text, "next: {next}");
    }
    let _ = writeln!(text, "policy: {}   {}", results.policy, results.onnx);
    if let Some(round) = results.rounds.last() {
        let _ = writeln!(text, "theta: {}", round.theta);
    }
    let _ = writeln!(text, "report: {}/report.html", results.run_folder);
    text
}

fn tracking(results: &Results) -> comfy_table::Table {
    let header = ["on", "policy", "linear error, m/s", "angular error, rad/s", "summed reward", "falls, %"];
    let mut rows = table(&header, &[2, 3, 4, 5]);
    for one in &results.evaluations {
        let found = &one.evaluation;
        let falls = Estimate { mean: 100.0 * found.fall_rate.mean, ci95: 100.0 * found.fall_rate.ci95 };
        rows.add_row([
            one.on.clone(),
            found.policy.clone(),
            shown(found.linear_velocity_error, 4),
            shown(found.angular_velocity_error, 4),
            shown(found.reward, 3),
            shown(falls, 2),
        ]);
    }
    rows
}

fn shown(estimate: Estimate, digits: usize) -> String {
    if estimate.mean.is_nan() {
        "–".to_owned()
    } else {
        format!("{:.digits$} ± {:.digits$}", estimate.mean, estimate.ci95)
    }
}

/// On the target, or else in the last adapted simulator: a row a command, a column a policy.
fn drift(results: &Results) -> Option<comfy_table::Table> {
    let on = match results.measured(&results.before, TARGET) {
        Some(_) => TARGET,
        None => &results.evaluations.last()?.on,
    };
    let columns: Vec<(&str, &Evaluation)> = [results.before.as_str(), results.after.as_str(), REFERENCE]
        .into_iter()
        .filter_map(|policy| Some((policy, results.measured(policy, on)?)))
        .filter(|(_, found)| !found.drift.is_empty())
        .collect();
    let (_, first) = columns.first()?;
    let mut header = vec!["command"];
    header.extend(columns.iter().map(|(policy, _)| *policy));
    let mut rows = table(&header, &(1..=columns.len()).collect::<Vec<_>>());
    for (index, trial) in first.drift.iter().enumerate() {
        let mut row = vec![trial.label()];
        for (_, found) in &columns {
            row.push(found.drift.get(index).map_or_else(String::new, |trial| {
                let distance = trial.distance();
                if distance.is_nan() {
                    return "all fell".to_owned();
                }
                format!("{distance:.3} m {:+.3} rad", trial.yaw.mean)
            }));
        }
        rows.add_row(row);
    }
    Some(rows)
}
