//! `gaitfit runs`: what was run, with numbers.

use crate::cli::Runs;
use crate::exit::Failure;
use crate::table::table;
use crate::{output, viewer};
use gaitfit::files::{self, Output};
use gaitfit::runs;
use gaitfit_model::{argument, shown};

/// Lists the run folders and their results.
pub fn run(args: &Runs) -> Result<(), Failure> {
    let runs = runs::list(&args.folder)?;
    if let Some(path) = &args.html {
        files::check(&[Output { path, option: "--html", ending: Some("html") }], [])?;
        files::write(path, runs::page(&args.folder, path, &runs)?.as_bytes())?;
        viewer::show(args.open, path);
    }
    if args.json {
        return output::print_json(&runs);
    }
    if runs.is_empty() {
        return output::print(&format!(
            "{} holds no runs; `gaitfit fit`, `train`, `finetune` and `loop` write them\n",
            args.folder.display()
        ));
    }
    let mut rows = table(&["run", "command", "begun", "time", "robot", "cost", "result"], &[3]);
    for run in &runs {
        let cost = run.cost.as_ref().map(|(name, before, after)| format!("{name} {before:.3} → {after:.4}"));
        rows.add_row([
            shown(&run.folder),
            run.kind.name().to_owned(),
            // ISO 8601 without seconds: `2026-01-31T12:34`. A damaged file may hold a shorter text.
            shown(run.begun.get(..16).unwrap_or(&run.begun)).replace('T', " "),
            run.wall_seconds.map_or("–".to_owned(), |seconds| format!("{seconds:.0} s")),
            run.robot.as_deref().map_or("–".to_owned(), shown),
            cost.unwrap_or_else(|| "–".to_owned()),
            shown(&run.summary),
        ]);
    }
    output::print(&format!(
        "{rows}\n\nA run's report.html shows it; `gaitfit runs RUN --json` prints its parameters.\n"
    ))?;
    match &args.html {
        Some(page) => output::print(&format!("page: {}\n", page.display())),
        None => output::next(&[format!("gaitfit runs {} --html runs.html", argument(&args.folder))]),
    }
}
