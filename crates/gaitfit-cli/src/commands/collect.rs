//! `gaitfit collect`: logs of a policy in a simulator.

use super::folder;
use crate::cli;
use crate::exit::Failure;
use crate::interrupt;
use crate::output;
use crate::progress::Lines;
use crate::watcher::watched;
use gaitfit::CollectSettings;
use gaitfit_model::{argument, counted};
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
    if let Some(robot) = args.on_robot() {
        return super::run::run(&on_robot(args, robot)?);
    }
    let link = &args.link;
    // Without a robot these options would be passed over in silence.
    let paced = link.pause.is_some() || link.stand.is_some() || link.patience != cli::PATIENCE;
    if paced || link.interface.is_some() || link.yes || link.dry_run || link.domain != 0 {
        return Err(Failure::usage(
            "--interface, --domain, --pause, --stand, --patience, --yes and --dry-run are for a robot: name it, --robot unitree-go2 or \
             simulated",
        ));
    }
    folder(&args.out, "the logs go")?;
    // One number is both ends of the range.
    let low = args.log_shift.first().copied().unwrap_or(0.0);
    let settings = CollectSettings {
        world: args.world.settings(),
        trajectories: args.trajectories.get(),
        seconds: args.seconds,
        log_shift: [low, args.log_shift.last().copied().unwrap_or(low)],
        privileged: args.privileged,
        commands: args.commands.clone(),
        // The number of a file's sequences is known later.
        device: match args.commands {
            Some(_) => args.device,
            None => args.device.for_trajectories(args.trajectories.get()),
        },
    };
    let line =
        if args.commands.is_some() { settings.device.line_by_robots() } else { settings.device.line() };
    output::note(&line);
    interrupt::listen()?;
    let collection = watched(Lines::Seconds(5), |watch| gaitfit::collect(&settings, &args.out, watch))?;
    // The number of files may be smaller than asked for: a robot that fell before its log began has none.
    let document = Document {
        simulator: collection.simulator,
        trajectories: collection.files.len(),
        seconds: args.seconds,
        falls: collection.falls,
        files: collection.files,
    };
    if args.json {
        return output::print_json(&document);
    }
    output::print(&format!(
        "{} of {} s in {}, {} ({})\n",
        counted(document.trajectories, "log"),
        args.seconds,
        args.out.display(),
        counted(document.falls, "fall"),
        document.simulator
    ))?;
    let robot =
        args.world.robot.as_ref().map_or(String::new(), |robot| format!(" --robot {}", argument(robot)));
    let policy = argument(&args.world.policy);
    output::next(&[format!(
        "gaitfit new --policy {policy}{robot} --logs {} --out my-robot.toml",
        argument(&args.out)
    )])
}

/// The same on a robot: what only a simulator can do is refused.
fn on_robot(args: &cli::Collect, robot: cli::RobotKind) -> Result<cli::Run, Failure> {
    let world = &args.world;
    // A robot would walk all the same, and its logs would look as if the option had counted.
    for (given, option) in [
        (world.theta.is_some(), "--theta"),
        (!world.spring.is_empty(), "--spring"),
        (world.torque_noise != 0.0, "--torque-noise"),
        (world.randomised, "--randomised"),
        (world.lenient, "--lenient"),
        (world.preset != cli::Preset::Fast, "--preset"),
        (world.threads.is_some(), "--threads"),
        (world.task.is_some(), "--task"),
        (args.device != cli::Device::Cpu, "--device"),
        (args.privileged, "--privileged"),
        (args.log_shift.iter().any(|shift| *shift != 0.0), "--log-shift"),
    ] {
        if given {
            return Err(Failure::usage(format!("{option} is for simulators; it cannot change a real robot")));
        }
    }
    if args.commands.is_some() && world.seed != 0 {
        return Err(Failure::usage(
            "--seed is for random commands; a robot that plays --commands draws nothing",
        ));
    }
    // The same command as `gaitfit run`, so that one guard and one confirmation serve both.
    Ok(cli::Run {
        policy: world.policy.clone(),
        robot,
        commands: args.commands.clone(),
        seconds: Some(args.seconds),
        random: args.commands.is_none().then_some(args.seconds),
        remote: false,
        keyboard: false,
        drift: None,
        drift_speeds: Vec::new(),
        trajectories: args.commands.is_none().then_some(args.trajectories),
        beyond_training: false,
        of_collect: true,
        seed: world.seed,
        out: args.out.clone(),
        json: args.json,
        link: args.link.clone(),
    })
}
