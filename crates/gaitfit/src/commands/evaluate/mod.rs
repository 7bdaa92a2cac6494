//! `gaitfit evaluate`: how well a policy walks in a simulator.

mod page;
mod text;

use crate::cli;
use crate::exit::Failure;
use crate::output;
use crate::output_file;
use crate::world::World;
use crate::{gait, replay};
use gaitfit_learn::evaluate::{
    DriftTrial, GaitRecord, GaitSummary, Trial, TrialSummary, drift, record_gait, run_trials, summarise,
};
use serde::Serialize;
use std::time::Instant;

/// Everything `--json` prints.
#[derive(Serialize)]
struct Document {
    policy: String,
    simulator: String,
    seconds: f64,
    seed: u64,
    #[serde(flatten)]
    summary: TrialSummary,
    drift: Vec<DriftTrial>,
    gait: Option<GaitSummary>,
    wall_seconds: f64,
}

/// What was measured, and the rows behind it.
struct Measured {
    document: Document,
    trials: Vec<Trial>,
    gait: Option<GaitRecord>,
}

/// Longest trajectory, s, and most control steps of one call.
const LONGEST: f64 = 3600.0;
const MOST_STEPS: f64 = 2e9;

/// Measures and prints.
pub fn run(args: &cli::Evaluate) -> Result<(), Failure> {
    for (path, option) in [(&args.report, "--report"), (&args.replay, "--replay")] {
        if let Some(path) = path {
            output_file::check(path, option, "html")?;
        }
    }
    let world = World::open(&args.world)?;
    let count = args.trajectories.get();
    let steps = count as f64 * args.seconds / world.scene.interface.control_dt;
    if !(args.seconds > 0.0 && args.seconds <= LONGEST && steps <= MOST_STEPS) {
        return Err(Failure::usage(format!(
            "{count} trajectories of {} s: give a time above 0 and at most {LONGEST} s, and at most {MOST_STEPS:.0e} \
             control steps in all",
            args.seconds
        )));
    }
    let measured = measure(args, &world)?;
    if let Some(path) = &args.report {
        output_file::write(path, page::page(args, &world, &measured)?.as_bytes())?;
    }
    if let Some(path) = &args.replay {
        output_file::write(path, replay(args, &world)?.as_bytes())?;
    }
    if args.json {
        output::print_json(&measured.document)
    } else {
        output::print(&text::text(&measured.document))
    }
}

fn measure(args: &cli::Evaluate, world: &World) -> Result<Measured, Failure> {
    let begun = Instant::now();
    let subject = world.subject(args.world.seed);
    let threads = World::threads(&args.world);
    let trials =
        run_trials(&subject, args.trajectories.get(), args.seconds, threads).map_err(Failure::failed)?;
    let drift =
        if args.drift == 0 { Vec::new() } else { drift(&subject, args.drift).map_err(Failure::failed)? };
    let limits = &world.scene.settings.command;
    let ahead = [0.5 * limits.x[1], 0.0, 0.0];
    let record = record_gait(&subject, &[(1.0, [0.0; 3]), (4.0, ahead)]).map_err(Failure::failed)?;
    let walked = limits.x[1] > 0.0 && !record.fell;
    let gait = walked.then(|| record.summary(&world.scene.gait_group));
    let document = Document {
        policy: args.world.policy.display().to_string(),
        simulator: world.description(),
        seconds: args.seconds,
        seed: args.world.seed,
        summary: summarise(&trials),
        drift,
        gait,
        wall_seconds: begun.elapsed().as_secs_f64(),
    };
    Ok(Measured { document, trials, gait: walked.then_some(record) })
}

/// A tour over the commands as a 3-D replay.
fn replay(args: &cli::Evaluate, world: &World) -> Result<String, Failure> {
    let commands = gait::tour(&world.scene.settings.command);
    let record = record_gait(&world.subject(args.world.seed), &commands).map_err(Failure::failed)?;
    let replay = gaitfit_view::Replay {
        title: args.world.policy.display().to_string(),
        note: world.description(),
        dt: record.dt,
        robots: vec![replay::robot("", world.scene.batch.model(), &record)],
    };
    gaitfit_view::replay_html(&replay).map_err(Failure::failed)
}
