//! The result of a fit as tables.

use crate::swings;
use crate::table::table;
use comfy_table::Table;
use gaitfit::adapt::{AdaptResults, Check, CostFit, MAX_SHOWN, Validation};
use gaitfit_view::Doubt;
use std::fmt::Write;

/// Parameters that are listed where there are too many.
const FEW: usize = 20;

/// Doubts first; then parameters, predictors, validation, further costs, and what to know besides what was `said`
/// already.
pub fn text(results: &AdaptResults, said: &[String]) -> String {
    let mut text = String::new();
    if !results.doubts.is_empty() {
        let _ = writeln!(text, "{}\n", results.headline);
    }
    let logs = results.trajectories;
    let _ = writeln!(
        text,
        "{}: {} fitted to {logs} log{}, of which {:.0} s count, in {:.1} s",
        results.name,
        results.robot,
        plural(logs),
        results.seconds,
        results.wall_seconds
    );
    // The first cost decides, so its doubts are the doubts of the whole result.
    for (number, fit) in results.fits.iter().enumerate() {
        let doubts = if number == 0 { &results.doubts } else { &fit.doubts };
        let _ = writeln!(text, "\n{}\n\n{}", headline(fit, doubts), parameters(fit));
    }
    for sentence in results.springs_in_words() {
        let _ = writeln!(text, "\n{sentence}");
    }
    let _ = writeln!(text, "\n{}", predictors(results));
    if !results.validation.is_empty() {
        let _ = writeln!(
            text,
            "\n{}",
            validation(&results.validation, &results.cost_name, &results.position_unit)
        );
    }
    if let Some(findings) = results.swings.as_ref().filter(|findings| findings.swings.is_some()) {
        let _ = writeln!(text, "\n{}", swings::text(findings, &results.causes, &results.beside_swings));
    }
    if let Some(held) = &results.held_out {
        let _ = writeln!(text, "\nnot fitted: {}", held.sentence());
    }
    // The first cost is compared with each further one.
    for other in results.fits.iter().filter(|fit| !fit.comparison.is_empty()) {
        let _ = writeln!(text, "\n{}", comparison(&results.cost_name, other, &results.position_unit));
        for reason in other.comparison.iter().filter_map(|one| one.reason.as_deref()) {
            let _ = writeln!(text, "  {reason}");
        }
    }
    text.push('\n');
    checks(&mut text, &results.checks);
    for warning in results.warnings.iter().filter(|warning| !said.contains(warning)) {
        let _ = writeln!(text, "note: {warning}");
    }
    let _ = writeln!(text, "theta: {0}/theta.toml   report: {0}/report.html", results.run_folder);
    text
}

/// Which checks passed and which failed.
pub fn checks(text: &mut String, checks: &[Check]) {
    for check in checks {
        let _ = writeln!(text, "{}: {}", if check.passed { "passed" } else { "FAILED" }, check.text());
    }
}

fn plural(count: usize) -> &'static str {
    if count == 1 { "" } else { "s" }
}

fn headline(fit: &CostFit, doubts: &[Doubt]) -> String {
    let seeds = fit.runs.len();
    let nominal =
        fit.nominal_cost.map_or_else(|| "a simulation that diverges".to_owned(), |cost| format!("{cost:.5}"));
    let mut text = format!(
        "{}: cost {:.5}, from {nominal} before the fit; {seeds} seed{}",
        fit.cost_name,
        fit.cost,
        plural(seeds)
    );
    if let Some(error) = fit.mean_error_percent {
        let _ = write!(text, "; mean error {error:.2} %");
    }
    let mut kinds: Vec<_> = doubts.iter().map(|doubt| doubt.kind).collect();
    // Several doubts of one kind need its headline once.
    kinds.dedup();
    for kind in kinds {
        let _ = write!(text, "; {}", kind.headline().to_uppercase());
    }
    text
}

/// The number after ±: the longer side of the interval, not the difference between runs of the optimiser.
fn half(half: Option<f64>) -> String {
    half.map_or_else(|| "–".to_owned(), |half| format!("±{half:.4}"))
}

fn parameters(fit: &CostFit) -> Table {
    // Columns that no parameter fills are left out.
    let known = fit.parameters.iter().any(|parameter| parameter.truth.is_some());
    let published = fit.parameters.iter().any(|parameter| parameter.published.is_some());
    // A regression may have been computed and not used. Only a used one changes the values.
    let corrected = fit.correction.is_some() || fit.regression.as_ref().is_some_and(|one| one.taken);
    let value = if corrected { "corrected" } else { "value" };
    let mut header = vec!["parameter", value, "±", "interval", "unit", "bounds"];
    if known {
        header.extend(["truth", "error"]);
    }
    if published {
        header.push("published");
    }
    if corrected {
        header.push("found");
    }
    header.push("");
    let mut table = table(&header, if known { &[1, 2, 3, 6, 7] } else { &[1, 2, 3] });
    let count = fit.parameters.len();
    // Weights of a network are thousands of parameters, which no reader looks through.
    let shown = if count <= MAX_SHOWN { count } else { FEW };
    for parameter in &fit.parameters[..shown] {
        let estimate = &parameter.found;
        // The table has both: ± is easy to read, and the two ends show that an interval is not symmetric.
        let interval = parameter.interval.map(|[lower, upper]| format!("{lower:.4} … {upper:.4}"));
        let mut row = vec![
            estimate.name.clone(),
            format!("{:.4}", estimate.value),
            half(parameter.half()),
            interval.unwrap_or_else(|| "–".to_owned()),
            estimate.unit.clone(),
            format!("[{}, {}]", estimate.lower, estimate.upper),
        ];
        if known {
            row.push(parameter.truth.map_or_else(String::new, |truth| format!("{truth:.4}")));
            // A truth of 0 has no relative error.
            let error = parameter.truth.filter(|truth| *truth != 0.0);
            let error = error.map(|truth| 100.0 * (estimate.value / truth - 1.0));
            row.push(error.map_or_else(String::new, |error| format!("{error:+.2} %")));
        }
        if published {
            row.push(parameter.published.map_or_else(String::new, |[low, high]| format!("{low} – {high}")));
        }
        if corrected {
            row.push(estimate.uncorrected.map_or_else(String::new, |value| format!("{value:.4}")));
        }
        row.push(match parameter.identified {
            Some(false) => "not identified".to_owned(),
            _ if estimate.at_bound => "at its bound".to_owned(),
            _ => String::new(),
        });
        table.add_row(row);
    }
    if shown < count {
        table.add_row([format!("… {} more, in theta.toml", count - shown)]);
    }
    table
}

fn predictors(results: &AdaptResults) -> Table {
    let cost = format!("{} cost", results.cost_name);
    // The fit is the first row, so that all guesses are compared with it.
    let scores = || std::iter::once(&results.fitted).chain(&results.baselines);
    let mut columns = vec!["predictor".to_owned(), cost];
    // A column appears if any predictor has its number. Free walks have no error by sample.
    let errors = scores().any(|score| score.rmse_fit_rad.is_some());
    let validated = scores().any(|score| score.cost_validation.is_some());
    let validated_errors = scores().any(|score| score.rmse_validation_rad.is_some());
    let unit = &results.position_unit;
    let more = [
        (errors, format!("rmse fit {unit}")),
        (validated, "cost validation".to_owned()),
        (validated_errors, format!("rmse validation {unit}")),
    ];
    columns.extend(more.into_iter().filter(|(shown, _)| *shown).map(|(_, name)| name));
    let header: Vec<&str> = columns.iter().map(String::as_str).collect();
    let mut table = table(&header, &[1, 2, 3, 4]);
    for score in scores() {
        let mut row = vec![score.name.clone(), number(score.cost)];
        let more = [
            (errors, score.rmse_fit_rad),
            (validated, score.cost_validation),
            (validated_errors, score.rmse_validation_rad),
        ];
        row.extend(more.iter().filter(|(shown, _)| *shown).map(|(_, value)| number(*value)));
        table.add_row(row);
    }
    table
}

/// Logs that were not fitted, one a row. `unit`: that of position errors.
pub fn validation(validation: &[Validation], cost_name: &str, unit: &str) -> Table {
    let (cost, errors) = (
        validation.iter().any(|log| log.cost.is_some()),
        // Either may be missing alone: one of the two robots may diverge.
        validation.iter().any(|log| log.rmse_rad.is_some() || log.nominal_rmse_rad.is_some()),
    );
    let mut columns = vec!["validation log".to_owned()];
    if cost {
        columns.extend([cost_name.to_owned(), "nominal".to_owned()]);
    }
    if errors {
        columns.extend([format!("rmse {unit}"), format!("nominal {unit}"), "worst joint".to_owned()]);
    }
    columns.push(String::new());
    let header: Vec<&str> = columns.iter().map(String::as_str).collect();
    let mut table = table(&header, if cost { &[1, 2, 3, 4] } else { &[1, 2] });
    for log in validation {
        let mut row = vec![log.file.clone()];
        if cost {
            row.extend([number(log.cost), number(log.nominal_cost)]);
        }
        if errors {
            // The joint to look at first if the mean over joints is large.
            let worst = log.rmse_per_joint.iter().max_by(|a, b| a.1.total_cmp(b.1));
            let worst = worst.map_or_else(|| "–".to_owned(), |(joint, error)| format!("{joint} {error:.4}"));
            row.extend([number(log.rmse_rad), number(log.nominal_rmse_rad), worst]);
        }
        row.push(if log.fell { "fell".to_owned() } else { String::new() });
        table.add_row(row);
    }
    table
}

fn comparison(first: &str, other: &CostFit, unit: &str) -> Table {
    let second = other.cost_name.as_str();
    let mut table = table(&["parameter", first, "±", second, "±", "unit", "agrees"], &[1, 2, 3, 4]);
    for one in &other.comparison {
        table.add_row([
            one.name.clone(),
            format!("{:.4}", one.first),
            half(one.first_half),
            format!("{:.4}", one.second),
            half(one.second_half),
            one.unit.clone(),
            match one.agrees {
                Some(true) => "yes".to_owned(),
                Some(false) => "no".to_owned(),
                None => "–".to_owned(),
            },
        ]);
    }
    // The second cost's values predict the validation logs too. A small error speaks for its column.
    let rmse: Vec<f64> = other.validation.iter().filter_map(|log| log.rmse_rad).collect();
    if !rmse.is_empty() {
        let mean = rmse.iter().sum::<f64>() / rmse.len() as f64;
        let mut row = vec![String::new(); 7];
        row[0] = "rmse validation".to_owned();
        // Below the values of the second cost.
        row[3] = format!("{mean:.5}");
        row[5] = unit.to_owned();
        table.add_row(row);
    }
    table
}

/// A number that may be missing.
pub fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "diverged".to_owned(), |value| format!("{value:.5}"))
}
