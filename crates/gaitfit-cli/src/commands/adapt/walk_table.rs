//! The result of a ground fit as tables.

use crate::table::table;
use comfy_table::Table;
use gaitfit::walk::results::{GroundFit, GroundResults, MOST_SHOWN};
use std::fmt::Write;

/// Parameters that are listed where there are too many.
const FEW: usize = 20;

/// Costs and parameters of each fit, and what to know besides what was `said` already.
pub fn text(results: &GroundResults, said: &[String]) -> String {
    let mut text = String::new();
    let _ = writeln!(
        text,
        "{}: {} fitted to {} trajectories, of which {:.0} s count, in {:.1} s",
        results.name, results.robot, results.trajectories, results.seconds, results.wall_seconds
    );
    for fit in &results.fits {
        let _ = writeln!(text, "\n{}\n\n{}", headline(fit), parameters(fit));
    }
    text.push('\n');
    for warning in results.warnings.iter().filter(|warning| !said.contains(warning)) {
        let _ = writeln!(text, "note: {warning}");
    }
    let _ = writeln!(text, "theta: {0}/theta.toml   report: {0}/report.html", results.run_folder);
    text
}

fn headline(fit: &GroundFit) -> String {
    let seeds = fit.runs.len();
    let nominal =
        fit.nominal_cost.map_or_else(|| "a simulation that diverges".to_owned(), |c| format!("{c:.5}"));
    let mut text = format!(
        "{}: cost {:.5}, from {nominal} before the fit; {seeds} seed{}",
        fit.cost_name,
        fit.cost,
        if seeds == 1 { "" } else { "s" }
    );
    if let Some(error) = fit.mean_error_percent {
        let _ = write!(text, "; mean error {error:.2} %");
    }
    text
}

fn parameters(fit: &GroundFit) -> Table {
    let known = fit.parameters.iter().any(|parameter| parameter.truth.is_some());
    let mut header = vec!["parameter", "value", "spread", "interval", "unit", "bounds"];
    if known {
        header.extend(["truth", "error"]);
    }
    header.push("");
    let mut table = table(&header, if known { &[1, 2, 3, 6, 7] } else { &[1, 2, 3] });
    let count = fit.parameters.len();
    let shown = if count <= MOST_SHOWN { count } else { FEW };
    for parameter in &fit.parameters[..shown] {
        let found = &parameter.found;
        let identification = found.identification.as_ref();
        let mut row = vec![
            found.name.clone(),
            format!("{:.4}", found.value),
            found.spread.map_or_else(|| "–".to_owned(), |spread| format!("±{spread:.4}")),
            identification
                .map_or_else(|| "–".to_owned(), |one| format!("{:.4} … {:.4}", one.lower, one.upper)),
            found.unit.clone(),
            format!("[{}, {}]", found.lower, found.upper),
        ];
        if known {
            row.push(parameter.truth.map_or_else(String::new, |truth| format!("{truth:.4}")));
            let error = parameter.truth.filter(|truth| *truth != 0.0);
            let error = error.map(|truth| 100.0 * (found.value / truth - 1.0));
            row.push(error.map_or_else(String::new, |error| format!("{error:+.2} %")));
        }
        row.push(match identification {
            Some(one) if !one.identified => "not identified".to_owned(),
            _ if found.at_bound => "at its bound".to_owned(),
            _ => String::new(),
        });
        table.add_row(row);
    }
    if shown < count {
        table.add_row([format!("… {} more, in theta.toml", count - shown)]);
    }
    table
}
