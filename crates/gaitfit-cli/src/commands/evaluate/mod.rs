//! `gaitfit evaluate`: how well a policy walks in a simulator.

mod page;
mod text;

use crate::cli;
use crate::exit::{Exit, Failure};
use crate::progress::Lines;
use crate::watcher::watched;
use crate::{interrupt, output, viewer};
use gaitfit::EvaluateSettings;
use gaitfit::arrangement::Diagnosis;
use gaitfit::evaluate::{Evaluated, Evaluation, GroundChoice, OnGround};
use gaitfit::files::{self, Output};
use gaitfit::world::World;
use gaitfit::{gait, policy_file, replay};
use gaitfit_learn::evaluate::{record_gait, record_gait_on};
use gaitfit_model::argument;
use gaitfit_view::Replay;
use serde::Serialize;
use std::path::Path;

/// Everything `--json` prints.
#[derive(Serialize)]
struct Document<'a> {
    #[serde(flatten)]
    evaluation: &'a Evaluation,
    /// Whether it walks, in a sentence.
    #[serde(skip_serializing_if = "Option::is_none")]
    verdict: Option<&'a str>,
    /// The arrangement of joints with which it walks, if it does not walk as its file states them.
    #[serde(skip_serializing_if = "Option::is_none")]
    diagnosis: Option<&'a Diagnosis>,
    wall_seconds: f64,
}

/// Measures and prints.
pub fn run(args: &cli::Evaluate) -> Result<(), Failure> {
    if args.open && args.report.is_none() && args.replay.is_none() {
        return Err(Failure::usage("--open opens what --report or --replay writes: give one of them"));
    }
    let named = [(&args.report, "--report"), (&args.replay, "--replay")];
    // An option that is not given has no output to check.
    let output =
        |(path, option)| Some(Output { path: Option::as_deref(path)?, option, ending: Some("html") });
    // All names are checked first: a measurement takes long, and its page must not fail at the end.
    let outputs: Vec<Output<'_>> = named.into_iter().filter_map(output).collect();
    // `--terrain` takes names too. Only a file can be overwritten by an output.
    let ground_file = Some(Path::new(&args.terrain)).filter(|_| args.terrain.ends_with(".toml"));
    files::check(&outputs, args.world.files().chain(ground_file))?;
    let drift_speeds = match args.drift_speeds.as_slice() {
        [] => None,
        &[x, y, yaw] => Some([x, y, yaw]),
        other => {
            let message = format!("--drift-speeds has {} numbers: give three, X,Y,YAW", other.len());
            return Err(Failure { exit: Exit::Usage, message });
        }
    };
    let settings = EvaluateSettings {
        world: args.world.settings(),
        trajectories: args.trajectories.get(),
        seconds: args.seconds,
        // `None` stays different from the default above: only who asked for drift trials is told that they have no
        // effect.
        drift: args.drift.unwrap_or(cli::DRIFT),
        drift_speeds,
        ground: GroundChoice::read(&args.terrain)?,
        ground_robots: args.terrain_robots,
        device: args.device,
        // If the policy does not walk, the order and signs of its joints may be stated wrongly.
        diagnose: true,
    };
    output::note(&settings.device.line_by_robots());
    interrupt::listen()?;
    let evaluated = watched(Lines::Seconds(5), |watch| gaitfit::evaluate(&settings, watch))?;
    let Evaluated { measured, verdict, world, ground, diagnosis, wall_seconds } = evaluated;
    let evaluation = &measured.evaluation;
    let verdict = verdict.as_ref();
    if evaluation.motion_error.is_some() && args.drift.is_some_and(|robots| robots > 0) {
        output::note("note: --drift has no effect: the policy follows a motion, not commands");
    }
    if args.json {
        output::print_json(&Document {
            evaluation,
            verdict: verdict.map(|one| one.text.as_str()),
            diagnosis: diagnosis.as_ref(),
            wall_seconds,
        })?;
    } else {
        output::print(&text::text(evaluation, verdict, wall_seconds))?;
        if let Some(diagnosis) = &diagnosis {
            output::print(&format!("\nThis policy walks with another arrangement. {}.\n", diagnosis.text()))?;
        }
        if verdict.is_some_and(|one| one.walks) {
            output::next(&[format!("gaitfit collect {} --out logs", argument(&args.world.policy))])?;
        }
    }
    // A page that cannot be written costs no numbers.
    let replay = match (&args.report, &args.replay) {
        (None, None) => None,
        _ => Some(replay(args, &world, ground.as_ref())?),
    };
    if let Some(path) = &args.report {
        let page = page::page(args, &world, &measured, verdict, replay.clone(), wall_seconds)?;
        files::write(path, page.as_bytes())?;
    }
    if let (Some(path), Some(replay)) = (&args.replay, &replay) {
        let page = gaitfit_view::replay_html(replay).map_err(Failure::failed)?;
        files::write(path, page.as_bytes())?;
    }
    if let Some(path) = args.report.as_ref().or(args.replay.as_ref()) {
        viewer::show(args.open, path);
    }
    // Last: the numbers and pages are there, and the exit code tells scripts not to trust them.
    match evaluation.divergence() {
        Some(message) => Err(Failure { exit: Exit::Check, message }),
        None => Ok(()),
    }
}

/// Time that a robot of a replay walks over uneven ground, s.
const ACROSS: f64 = 12.0;

/// A tour over the commands, or straight over uneven ground, as a 3-D replay.
fn replay(args: &cli::Evaluate, world: &World, ground: Option<&OnGround>) -> Result<Replay, Failure> {
    let record = match ground {
        None => {
            let commands = gait::tour(&world.scene.settings.command);
            record_gait(&world.subject(args.world.seed), &commands)
        }
        Some(ground) => {
            let commands = [(0.5, [0.0; 3]), (ACROSS, [ground.speed, 0.0, 0.0])];
            record_gait_on(&ground.world.subject(args.world.seed), Some(ground.cell()), &commands)
        }
    };
    let record = record.map_err(Failure::failed)?;
    // The uneven ground is part of the model, so it has a world of its own.
    let world = ground.map_or(world, |ground| &ground.world);
    Ok(Replay {
        title: policy_file::title(&args.world.policy),
        note: world.description(),
        dt: record.dt,
        robots: vec![replay::robot_on("", &world.scene.walker, &record)],
    })
}
