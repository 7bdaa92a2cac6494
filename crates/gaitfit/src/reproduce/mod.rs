//! The paper's tables from experiment files, with the paper's numbers beside.

mod cells;
mod experiments;
mod paper;
mod parts;
#[cfg(feature = "report")]
mod plot;
mod results;

pub use paper::{Kind, Paper, Table};
pub use parts::{Part, PartKind, Plan, make, plan};
pub use results::{PaperRow, Results, Row, Walk, shown};

use crate::Error;
use crate::device::Devices;
use crate::run::RunFolder;
use crate::watch::Watch;
use cells::{Outcome, Run};
use experiments::Experiment;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};

/// Request for a table.
#[derive(Clone, Debug)]
pub struct Request {
    /// Which table; [`Paper::tables`] names them.
    pub table: String,
    /// The paper's scale instead of one for two cores.
    pub full: bool,
    /// Repetitions of every cell with other seeds.
    pub seeds: u64,
    /// Cells to run, a pattern; the others are left out of the table.
    pub only: Option<String>,
    /// Changes of every cell's settings, `key=value`.
    pub set: Vec<String>,
    /// Folder of the experiment files.
    pub experiments: PathBuf,
    /// Threads.
    pub threads: usize,
    /// What fits and trains; cells are shared among several.
    pub devices: Devices,
    /// Cells at a time; none for one a device.
    pub jobs: Option<NonZeroUsize>,
}

/// A table, read and checked, with its folder.
struct Opened {
    paper: Paper,
    title: String,
    kind: Kind,
    experiments: Vec<Experiment>,
    folder: RunFolder,
}

impl Opened {
    fn new(request: &Request) -> Result<Self, Error> {
        request.devices.check()?;
        let paper = Paper::read()?;
        let table = paper.table(&request.table)?;
        let only = request.only.as_deref();
        let experiments =
            experiments::read(&paper, table, &request.experiments, request.full, &request.set, only)?;
        // Cells of one scenario have the same folder. A table has one folder, so the first cell names it.
        let runs = experiments.first().map_or("runs", |one| one.config.runs.as_str());
        // Both scales of a table may be run, each in a folder of its own.
        let scale = if request.full { "-full" } else { "" };
        let folder = RunFolder::only(Path::new(runs), &format!("reproduce-{}{scale}", table.name))?;
        let (title, kind) = (table.title.clone(), table.kind);
        Ok(Self { paper, title, kind, experiments, folder })
    }

    fn run<'a>(&'a self, request: &'a Request, watch: &'a Watch<'a>) -> Run<'a> {
        Run {
            experiments: &self.experiments,
            kind: self.kind,
            seeds: request.seeds,
            folder: &self.folder,
            threads: request.threads,
            devices: &request.devices,
            jobs: request.jobs.map_or(request.devices.all().len(), NonZeroUsize::get),
            watch,
        }
    }
}

/// Runs a table or continues it. Returns its results and its folder, which has all files but the printed table.
pub fn run(request: &Request, watch: &Watch<'_>) -> Result<(Results, RunFolder), Error> {
    let opened = Opened::new(request)?;
    let outcome = opened.run(request, watch).run()?;
    let Opened { paper, title, kind, experiments, folder } = opened;
    let results = Results {
        table: request.table.clone(),
        title,
        kind,
        full: request.full,
        rows: rows(&paper, kind, &experiments, outcome),
        run_folder: folder.path().display().to_string(),
    };
    #[cfg(feature = "report")]
    folder.write("plot.svg", plot::svg(&results).as_bytes())?;
    folder.write_json("result.json", &results)?;
    Ok((results, folder))
}

/// A row for each reference of each scenario, then one for each cell that was run.
fn rows(paper: &Paper, kind: Kind, experiments: &[Experiment], mut outcome: Outcome) -> Vec<Row> {
    let mut rows = Vec::new();
    // The policy before any fit and the one trained with the truth stand first: they bound what a fit can
    // give.
    if kind == Kind::Finetuning {
        for (scenario, first) in outcome.first {
            let none = PaperRow::default;
            rows.push(Row::new(format!("{scenario}-pi0"), scenario.clone(), None, vec![first], none()));
            let seeds = outcome.reference.shift_remove(&scenario).unwrap_or_default();
            rows.push(Row::new(format!("{scenario}-reference"), scenario.clone(), None, seeds, none()));
            for (name, seeds) in outcome.controls.shift_remove(&scenario).unwrap_or_default() {
                rows.push(Row::new(format!("{scenario}-{name}"), scenario.clone(), None, seeds, none()));
            }
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
