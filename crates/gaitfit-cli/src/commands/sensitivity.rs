//! `gaitfit sensitivity`: how precisely logs can tell each parameter.

use crate::cli;
use crate::exit::Failure;
use crate::output;
use crate::table::table;
use comfy_table::Table;
use gaitfit::adapt::{Opening, ParameterSensitivity, SensitivityResults, sensitivity};
use gaitfit::settings::{self, AdaptConfig};

use gaitfit_model::{argument, significant};
use std::fmt::Write;
use std::num::NonZeroUsize;

/// Simulates the logs with derivatives and reports what they tell.
pub fn run(args: &cli::Sensitivity) -> Result<(), Failure> {
    let config: AdaptConfig = settings::load(Some(&args.config), &args.set)?;
    let setup = Opening::new(&config, &args.config).threads(args.threads.map(NonZeroUsize::get)).open()?;
    if let Some(bad) = args.difference.filter(|one| !(one.is_finite() && *one > 0.0)) {
        return Err(Failure::usage(format!("--difference is {bad}; it must be positive")));
    }
    let results = sensitivity(&setup, args.theta.as_deref(), args.difference)?;
    if args.json {
        return output::print_json(&results);
    }
    output::print(&text(&results))?;
    output::next(&[format!("gaitfit fit {}", argument(&args.config))])
}

fn text(results: &SensitivityResults) -> String {
    let mut text = format!(
        "Expected precision from {} of {} with {}, if the fitted simulator differs from them by {:.2e} of half the \
         joints' range, with errors that last {:.3} s.\n\n",
        if results.logs == 1 { "one log".to_owned() } else { format!("{} logs", results.logs) },
        results.robot,
        results.cost_name,
        results.difference,
        results.together_seconds,
    );
    let _ = writeln!(text, "{}", parameters(&results.parameters));
    for warning in &results.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    text
}

/// A table of how well logs identify each parameter.
pub fn parameters(sensitivities: &[ParameterSensitivity]) -> Table {
    let header = ["parameter", "at", "deviation", "if others known", "unit", "identified", "correlates with"];
    let mut rows = table(&header, &[1, 2, 3]);
    // Absent if the logs do not identify the parameter at all.
    let number = |value: Option<f64>| value.map_or_else(|| "–".to_owned(), |value| significant(value, 3));
    for ParameterSensitivity { name, unit, value, deviation, alone, identified, like } in sensitivities {
        rows.add_row([
            name.clone(),
            format!("{value:.5}"),
            number(*deviation),
            number(*alone),
            unit.clone(),
            if *identified { "yes" } else { "no" }.to_owned(),
            like.as_ref().map_or_else(String::new, |(other, by)| format!("{other} ({by:+.2})")),
        ]);
    }
    rows
}
