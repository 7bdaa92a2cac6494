//! `gaitfit collect`: logs of a policy in a simulator.

use crate::cli;
use crate::exit::Failure;
use crate::output;
use gaitfit::target::write_logs;
use gaitfit::world::World;
use gaitfit_learn::collect::{CollectOptions, collect};
use serde::Serialize;
use std::path::PathBuf;

/// Most trajectories and seconds of one call: a million rows a robot would not fit in memory.
const MOST_ROWS: f64 = 2e7;

#[derive(Serialize)]
struct Document {
    simulator: String,
    trajectories: usize,
    seconds: f64,
    falls: usize,
    files: Vec<PathBuf>,
}

/// Runs the policy and writes one log a trajectory.
pub fn run(args: &cli::Collect) -> Result<(), Failure> {
    let world = World::open(&args.world.settings())?.with_plain_starts();
    world.warnings.iter().for_each(|warning| output::note(&format!("warning: {warning}")));
    let count = args.trajectories.get();
    let [low, high] = [args.log_shift[0], *args.log_shift.last().unwrap_or(&args.log_shift[0])];
    if !(0.0 <= low && low <= high && high <= 10.0) {
        return Err(Failure::usage(format!(
            "--log-shift {low} {high}: give two times from 0 to 10 s, the shorter first"
        )));
    }
    let rows = count as f64 * args.seconds / world.scene.walker.interface.control_dt;
    if !(args.seconds > 0.0 && rows >= count as f64 && rows <= MOST_ROWS) {
        return Err(Failure::usage(format!(
            "{count} trajectories of {} s are {rows:.0} rows; give at least one a trajectory, at most {MOST_ROWS:.0}",
            args.seconds
        )));
    }
    if !gaitfit::target::csv_files(&args.out).unwrap_or_default().is_empty() {
        return Err(Failure::usage(format!(
            "--out {0}: holds CSV files already, and logs of two runs would be mixed; give another folder, or empty it",
            args.out.display()
        )));
    }
    std::fs::create_dir_all(&args.out)
        .map_err(|error| Failure::failed(format!("cannot make {}: {error}", args.out.display())))?;
    let options =
        CollectOptions { count, seconds: args.seconds, shift: [low, high], privileged: args.privileged };
    let logs = collect(&world.subject(args.world.seed), &options, World::threads(&args.world.settings()))
        .map_err(Failure::failed)?;
    let written = write_logs(&args.out, &logs)?;
    for number in &written.without {
        output::note(&format!("note: trajectory {number} fell before its log began; it has no file"));
    }
    let (files, falls) = (written.files, written.falls);
    let document = Document {
        simulator: world.description(),
        trajectories: files.len(),
        seconds: args.seconds,
        falls,
        files,
    };
    if args.json {
        return output::print_json(&document);
    }
    output::print(&format!(
        "{} logs of {} s in {}, {falls} falls ({})\n",
        document.trajectories,
        args.seconds,
        args.out.display(),
        document.simulator
    ))
}
