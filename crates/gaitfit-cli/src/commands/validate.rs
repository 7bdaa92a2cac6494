//! `gaitfit validate`: how well a finished fit predicts other logs.

use super::adapt::{checked, checks, number, validation};
use crate::cli;
use crate::exit::Failure;
use crate::output;
use crate::table::table;
use comfy_table::Table;
use gaitfit::adapt::{HeldOut, ValidateRequest, ValidateResults, validate};
use gaitfit::watch::Watch;
use std::fmt::Write;
use std::num::NonZeroUsize;

/// Simulates the logs and reports the errors.
pub fn run(args: &cli::Validate) -> Result<(), Failure> {
    let request = ValidateRequest {
        theta: args.theta.clone(),
        logs: args.logs.clone(),
        config: args.config.clone(),
        set: args.set.clone(),
        threads: args.threads.map(NonZeroUsize::get),
        // The policy of the fit's own configuration.
        policy: None,
    };
    // The program ends at once on Ctrl-C.
    let results = validate(&request, &Watch::silent())?;
    if args.json {
        output::print_json(&results)?;
    } else {
        output::print(&text(&results))?;
        if results.failed_check().is_none() && results.refusal().is_none() {
            output::next(&[format!(
                "gaitfit export {} --out FOLDER",
                gaitfit_model::argument(&results.theta)
            )])?;
        }
    }
    checked(results.failed_check().or_else(|| results.refusal()))
}

fn text(results: &ValidateResults) -> String {
    let mut text = format!("{}\n\n", results.headline);
    let _ =
        writeln!(text, "{}\n", validation(&results.validation, &results.cost_name, &results.position_unit));
    let cost = format!("{} cost", results.cost_name);
    // Samples of walks that run freely are not compared one by one; there is no error then.
    let errors = results.rmse_rad.is_some() || results.nominal_rmse_rad.is_some();
    let mut rows = match errors {
        true => table(&["all logs", &cost, &format!("rmse {}", results.position_unit)], &[1, 2]),
        false => table(&["all logs", &cost], &[1]),
    };
    for (robot, cost, rmse) in [
        ("fitted simulator", results.cost, results.rmse_rad),
        ("nominal model", results.nominal_cost, results.nominal_rmse_rad),
    ] {
        let mut row = vec![robot.to_owned(), number(cost)];
        row.extend(errors.then(|| number(rmse)));
        rows.add_row(row);
    }
    let _ = writeln!(text, "{rows}\n");
    if let Some(held) = &results.held_out {
        let _ = writeln!(text, "{}\n", distances(held));
    }
    checks(&mut text, &results.checks);
    for warning in &results.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    text
}

/// Distances of the joints' signals from the logs: of the robot before and after the fit, and of the robot itself.
fn distances(held: &HeldOut) -> Table {
    let header = ["W₁ on whole walks", "signal", "nominal", "fitted", "robot itself"];
    let mut rows = table(&header, &[2, 3, 4]);
    let shown = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| format!("{value:.4}"));
    for one in &held.distances {
        let numbers = [one.nominal, one.fitted, one.floor].map(shown);
        let mut row = vec![one.joint.clone(), one.signal.to_string()];
        row.extend(numbers);
        rows.add_row(row);
    }
    rows
}
