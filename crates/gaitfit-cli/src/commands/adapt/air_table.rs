//! The result as tables.

use crate::table::table;
use comfy_table::Table;
use gaitfit::air::results::{OtherFit, Results};
use std::fmt::Write;

/// Parameters, predictors, validation, the other fits, and what to know besides what was `said` already.
pub fn text(results: &Results, said: &[String]) -> String {
    let mut text = String::new();
    let seeds = results.runs.len();
    let _ = writeln!(
        text,
        "{}: {} fitted by {}, cost {:.5}, {seeds} seed{}, {:.1} s\n",
        results.name,
        results.robot,
        results.cost_name,
        results.cost,
        if seeds == 1 { "" } else { "s" },
        results.wall_seconds
    );
    let _ = writeln!(text, "{}\n\n{}", parameters(results), predictors(results));
    if !results.validation.is_empty() {
        let _ = writeln!(text, "\n{}", validation(results));
    }
    for other in &results.other_fits {
        let _ = writeln!(text, "\n{}", comparison(&results.cost_name, other));
        for reason in other.comparison.iter().filter_map(|one| one.reason.as_deref()) {
            let _ = writeln!(text, "  {reason}");
        }
    }
    text.push('\n');
    for check in &results.checks {
        let _ = writeln!(text, "{}: {}", if check.passed { "passed" } else { "FAILED" }, check.text());
    }
    for warning in results.warnings.iter().filter(|warning| !said.contains(warning)) {
        let _ = writeln!(text, "note: {warning}");
    }
    let _ = writeln!(text, "report: {}/report.html", results.run_folder);
    text
}

fn parameters(results: &Results) -> Table {
    let known = results.parameters.iter().any(|parameter| parameter.truth.is_some());
    let published = results.parameters.iter().any(|parameter| parameter.published.is_some());
    let mut header = vec!["parameter", "value", "spread", "unit", "bounds"];
    if known {
        header.extend(["truth", "error"]);
    }
    if published {
        header.push("published");
    }
    header.push("");
    let mut table = table(&header, if known { &[1, 2, 5, 6] } else { &[1, 2] });
    for parameter in &results.parameters {
        let found = &parameter.found;
        let mut row = vec![
            found.name.clone(),
            format!("{:.4}", found.value),
            found.spread.map_or_else(|| "–".to_owned(), |spread| format!("±{spread:.4}")),
            found.unit.clone(),
            format!("[{}, {}]", found.lower, found.upper),
        ];
        if known {
            row.push(parameter.truth.map_or_else(String::new, |truth| format!("{truth:.4}")));
            let error = parameter
                .truth
                .filter(|truth| *truth != 0.0)
                .map(|truth| 100.0 * (found.value / truth - 1.0));
            row.push(error.map_or_else(String::new, |error| format!("{error:+.1} %")));
        }
        if published {
            row.push(parameter.published.map_or_else(String::new, |[low, high]| format!("{low} – {high}")));
        }
        row.push(if found.at_bound { "at its bound".to_owned() } else { String::new() });
        table.add_row(row);
    }
    table
}

fn predictors(results: &Results) -> Table {
    let cost = format!("{} cost", results.cost_name);
    let mut table = table(&["predictor", &cost, "rmse fit rad", "rmse validation rad"], &[1, 2, 3]);
    for score in std::iter::once(&results.fitted).chain(&results.baselines) {
        table.add_row([
            score.name.clone(),
            number(score.cost),
            number(score.rmse_fit_rad),
            number(score.rmse_validation_rad),
        ]);
    }
    table
}

fn validation(results: &Results) -> Table {
    let mut table = table(&["validation log", "rmse rad", "nominal rad", "worst joint"], &[1, 2]);
    for log in &results.validation {
        let worst = log.rmse_per_joint.iter().max_by(|a, b| a.1.total_cmp(b.1));
        table.add_row([
            log.file.clone(),
            number(log.rmse_rad),
            number(log.nominal_rmse_rad),
            worst.map_or_else(|| "–".to_owned(), |(joint, error)| format!("{joint} {error:.4}")),
        ]);
    }
    table
}

fn comparison(first: &str, other: &OtherFit) -> Table {
    let second = other.outcome.cost.as_str();
    let mut table = table(&["parameter", first, "spread", second, "spread", "unit", "agrees"], &[1, 2, 3, 4]);
    let spread =
        |spread: Option<f64>| spread.map_or_else(|| "–".to_owned(), |spread| format!("±{spread:.4}"));
    for one in &other.comparison {
        table.add_row([
            one.name.clone(),
            format!("{:.4}", one.first),
            spread(one.first_spread),
            format!("{:.4}", one.second),
            spread(one.second_spread),
            one.unit.clone(),
            match one.agrees {
                Some(true) => "yes".to_owned(),
                Some(false) => "no".to_owned(),
                None => "–".to_owned(),
            },
        ]);
    }
    let rmse: Vec<f64> = other.validation.iter().filter_map(|log| log.rmse_rad).collect();
    if !rmse.is_empty() {
        let mean = rmse.iter().sum::<f64>() / rmse.len() as f64;
        table.add_row([
            "rmse validation".to_owned(),
            String::new(),
            String::new(),
            format!("{mean:.5}"),
            String::new(),
            "rad".to_owned(),
            String::new(),
        ]);
    }
    table
}

fn number(value: Option<f64>) -> String {
    value.map_or_else(|| "diverged or none".to_owned(), |value| format!("{value:.5}"))
}
