//! `gaitfit evaluate`: how well a policy walks in a simulator.

mod page;
mod text;

use crate::cli;
use crate::exit::Failure;
use crate::output;
use gaitfit::files;
use gaitfit::settings::MOST_DRIFT;
use gaitfit::target::{Evaluation, Plan, measure};
use gaitfit::world::World;
use gaitfit::{gait, replay};
use gaitfit_learn::evaluate::record_gait;
use serde::Serialize;
use std::time::Instant;

/// Everything `--json` prints.
#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    evaluation: &'a Evaluation,
    wall_seconds: f64,
}

/// Longest trajectory, s, and most control steps of one call.
const LONGEST: f64 = 3600.0;
const MOST_STEPS: f64 = 2e9;

/// Measures and prints.
pub fn run(args: &cli::Evaluate) -> Result<(), Failure> {
    for (path, option) in [(&args.report, "--report"), (&args.replay, "--replay")] {
        if let Some(path) = path {
            files::check(path, option, "html")?;
        }
    }
    let world = World::open(&args.world.settings())?;
    world.warnings.iter().for_each(|warning| output::note(&format!("warning: {warning}")));
    let count = args.trajectories.get();
    let steps = count as f64 * args.seconds / world.scene.walker.interface.control_dt;
    if !(args.seconds > 0.0 && args.seconds <= LONGEST && steps <= MOST_STEPS) {
        return Err(Failure::usage(format!(
            "{count} trajectories of {} s: give a time above 0 and at most {LONGEST} s, and at most {MOST_STEPS:.0e} \
             control steps in all",
            args.seconds
        )));
    }
    if args.drift > MOST_DRIFT {
        return Err(Failure::usage(format!("--drift {}: give at most {MOST_DRIFT} robots", args.drift)));
    }
    let begun = Instant::now();
    let plan = Plan {
        trajectories: count,
        seconds: args.seconds,
        drift: args.drift,
        seed: args.world.seed,
        threads: World::threads(&args.world.settings()),
    };
    let measured = measure(&world, &args.world.policy.display().to_string(), &plan)?;
    let wall_seconds = begun.elapsed().as_secs_f64();
    let evaluation = &measured.evaluation;
    if args.json {
        output::print_json(&Document { evaluation, wall_seconds })?;
    } else {
        output::print(&text::text(evaluation, wall_seconds))?;
    }
    // A page that cannot be written costs no numbers.
    if let Some(path) = &args.report {
        let page = page::page(args, &world, &measured, wall_seconds)?;
        files::write(path, page.as_bytes())?;
    }
    if let Some(path) = &args.replay {
        files::write(path, replay(args, &world)?.as_bytes())?;
    }
    Ok(())
}

/// A tour over the commands as a 3-D replay.
fn replay(args: &cli::Evaluate, world: &World) -> Result<String, Failure> {
    let commands = gait::tour(&world.scene.settings.command);
    let record = record_gait(&world.subject(args.world.seed), &commands).map_err(Failure::failed)?;
    let replay = gaitfit_view::Replay {
        title: args.world.policy.display().to_string(),
        note: world.description(),
        dt: record.dt,
        robots: vec![replay::robot("", world.scene.walker.batch.model(), &record)],
    };
    gaitfit_view::replay_html(&replay).map_err(Failure::failed)
}
