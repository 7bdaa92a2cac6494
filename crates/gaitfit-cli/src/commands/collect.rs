//! `gaitfit collect`: logs of a policy in a simulator.

use super::folder;
use crate::cli;
use crate::exit::Failure;
use crate::output;
use crate::progress::Lines;
use crate::watcher::watched;
use gaitfit::CollectSettings;
use serde::Serialize;
use std::path::PathBuf;

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
    folder(&args.out, "the logs go")?;
    let low = args.log_shift.first().copied().unwrap_or(0.0);
    let settings = CollectSettings {
        world: args.world.settings(),
        trajectories: args.trajectories.get(),
        seconds: args.seconds,
        log_shift: [low, args.log_shift.last().copied().unwrap_or(low)],
        privileged: args.privileged,
        commands: args.commands.clone(),
    };
    let found = watched(Lines::Seconds(5), |watch| gaitfit::collect(&settings, &args.out, watch))?;
    let document = Document {
        simulator: found.simulator,
        trajectories: found.files.len(),
        seconds: args.seconds,
        falls: found.falls,
        files: found.files,
    };
    if args.json {
        return output::print_json(&document);
    }
    output::print(&format!(
        "{} logs of {} s in {}, {} falls ({})\n",
        document.trajectories,
        args.seconds,
        args.out.display(),
        document.falls,
        document.simulator
    ))
}
