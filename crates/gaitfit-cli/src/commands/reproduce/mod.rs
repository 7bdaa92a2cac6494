//! `gaitfit reproduce`: runs the paper's tables from experiment files and sets the results beside the paper's numbers.

mod text;

use crate::cli;
use crate::exit::Failure;
use crate::progress::Lines;
use crate::watcher::watched;
use crate::{interrupt, output, viewer};
use gaitfit::machine;
use gaitfit::reproduce::{self, Paper, Request};

/// Runs a table or continues it, or lists what there is.
pub fn run(args: &cli::Reproduce) -> Result<(), Failure> {
    if args.table == "list" {
        let paper = Paper::read()?;
        return if args.json {
            output::print_json(&paper.tables)
        } else {
            output::print(&text::list(&paper))
        };
    }
    let request = Request {
        table: args.table.clone(),
        full: args.full,
        seeds: u64::from(args.seeds.get()),
        only: args.only.clone(),
        set: args.set.clone(),
        experiments: args.experiments.clone(),
        threads: args.threads.map_or_else(machine::threads, std::num::NonZeroUsize::get),
        devices: args.device.clone(),
        jobs: args.jobs,
    };
    output::devices(&args.device);
    interrupt::listen()?;
    let (results, folder) = watched(Lines::Seconds(5), |watch| reproduce::run(&request, watch))?;
    let shown = text::text(&results);
    // Beside the runs, so that a table can be read again without computing it.
    folder.write("table.txt", shown.as_bytes())?;
    // An empty line between the progress and the table.
    output::note("");
    if args.json {
        output::print_json(&results)?;
    } else {
        output::print(&shown)?;
    }
    viewer::show(args.open, &folder.path().join("plot.svg"));
    Ok(())
}
