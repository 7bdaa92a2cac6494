//! `gaitfit reproduce`: runs the paper's tables from experiment files and sets the results beside the paper's numbers.

mod cells;
mod experiments;
mod paper;
mod plot;
mod results;
mod text;

use crate::cli;
use crate::exit::Failure;
use crate::interrupt;
use crate::machine;
use crate::output::{self, note};
use crate::run_folder::RunFolder;
use cells::{Outcome, Run};
use experiments::Experiment;
use paper::{Kind, Paper, Table};
use results::{PaperRow, Results, Row};
use std::path::Path;

/// Runs a table or continues it, or lists what there is.
pub fn run(args: &cli::Reproduce) -> Result<(), Failure> {
    let paper = Paper::read()?;
    if args.table == "list" {
        return if args.json {
            output::print_json(&paper.tables)
        } else {
            output::print(&text::list(&paper))
        };
    }
    let table = paper.table(&args.table)?;
    let only = args.only.as_deref();
    let experiments = experiments::read(&paper, table, &args.experiments, args.full, &args.set, only)?;
    let threads = args.threads.map_or_else(machine::threads, std::num::NonZeroUsize::get);
    interrupt::listen()?;
    let runs = experiments.first().map_or("runs", |one| one.config.runs.as_str());
    let scale = if args.full { "-full" } else { "" };
    let folder = RunFolder::only(Path::new(runs), &format!("reproduce-{}{scale}", table.name))?;
    let seeds = u64::from(args.seeds.get());
    let run = Run { experiments: &experiments, kind: table.kind, seeds, folder: &folder, threads };
    let outcome = run.run()?;
    let results = Results {
        table: table.name.clone(),
        title: table.title.clone(),
        kind: table.kind,
        full: args.full,
        rows: rows(&paper, table, &experiments, outcome),
        run_folder: folder.path().display().to_string(),
    };
    let shown = text::text(&results);
    folder.write("table.txt", shown.as_bytes())?;
    folder.write("plot.svg", plot::svg(&results)?.as_bytes())?;
    folder.write_json("result.json", &results)?;
    note("");
    if args.json { output::print_json(&results) } else { output::print(&shown) }
}

/// A row for each reference of each scenario, then one for each cell that was run.
fn rows(paper: &Paper, table: &Table, experiments: &[Experiment], mut outcome: Outcome) -> Vec<Row> {
    let mut rows = Vec::new();
    if table.kind == Kind::Finetuning {
        for (scenario, first) in outcome.first {
            let none = PaperRow::default;
            rows.push(Row::new(format!("{scenario}-pi0"), scenario.clone(), None, vec![first], none()));
            let seeds = outcome.reference.shift_remove(&scenario).unwrap_or_default();
            rows.push(Row::new(format!("{scenario}-reference"), scenario.clone(), None, seeds, none()));
        }
    }
    for one in experiments {
        let Some(seeds) = outcome.cells.shift_remove(&one.paper.name) else { continue };
        let beside = PaperRow {
            errors_percent: paper.errors(&one.paper),
            mean_error_percent: paper.mean_error(&one.paper),
            says: one.paper.says.clone(),
        };
        let [modification, cost] = &one.parts;
        let parts = Some([modification.as_str(), cost.as_str()]);
        rows.push(Row::new(one.paper.name.clone(), one.scenario.clone(), parts, seeds, beside));
    }
    rows
}
