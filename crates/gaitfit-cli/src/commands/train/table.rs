//! The result as a table.

use crate::table::table;
use gaitfit::train::{LAST, Results};
use gaitfit_view::DoubtKind;
use std::fmt::Write;

/// One row a seed, and where the files are.
pub fn text(results: &Results) -> String {
    let mut text = String::new();
    // This doubt must be seen before the numbers.
    for doubt in results.doubts.iter().filter(|doubt| doubt.kind == DoubtKind::NotLearnt) {
        let _ = writeln!(text, "{}: {}\n", doubt.kind.headline().to_uppercase(), doubt.text);
    }
    for warning in &results.warnings {
        let _ = writeln!(text, "note: {warning}");
    }
    let done = if results.trained { "trained" } else { "NOT trained" };
    let _ = writeln!(
        text,
        "{}: {} {done} for `{}`, {} robots, {:.0} s\n",
        results.name, results.robot, results.task, results.environments, results.wall_seconds
    );
    if let Some(parent) = &results.parent {
        let _ = writeln!(text, "from {} in {}\n", parent.policy, parent.simulator);
    }
    let header = [
        "seed",
        "iterations",
        "return",
        "error m/s",
        "error rad/s",
        "episode s",
        "falls",
        "action rate",
        "samples/s",
        "time s",
    ];
    let mut rows = table(&header, &[0, 1, 2, 3, 4, 5, 6, 7, 8, 9]);
    let known = |value: Option<f64>, digits: usize| match value {
        Some(value) => format!("{value:.digits$}"),
        None => "–".to_owned(),
    };
    for seed in &results.seeds {
        rows.add_row([
            seed.seed.to_string(),
            seed.iterations.to_string(),
            known(seed.episode_return, 2),
            format!("{:.3}", seed.linear_velocity_error),
            format!("{:.3}", seed.angular_velocity_error),
            known(seed.episode_seconds, 1),
            seed.fall_rate.map_or_else(|| "–".to_owned(), |share| format!("{:.1} %", 100.0 * share)),
            format!("{:.2}", seed.gait.action_rate),
            format!("{:.0}", seed.samples_per_second),
            format!("{:.0}", seed.wall_seconds),
        ]);
    }
    let _ = writeln!(text, "{rows}\n");
    let _ = writeln!(text, "means of the last {LAST} iterations, with the noise and pushes of training");
    for seed in &results.seeds {
        let _ = writeln!(text, "policy: {}   watch: {}", seed.policy, seed.replay);
    }
    let _ = writeln!(text, "report: {}/report.html", results.run_folder);
    text
}
