//! `gaitfit loop`: collect, adapt, fine-tune, evaluate, repeated while it helps.

mod table;

use super::run::check_link;
use super::run_name;
use crate::cli::{self, RobotKind};
use crate::exit::{Exit, Failure};
use crate::progress::Lines;
use crate::watcher::watched;
use crate::{interrupt, output, viewer};
use gaitfit::loop_::{self, Setup};
use gaitfit::settings::{self, LoopConfig, TargetKind};
use gaitfit_view::loop_report::plain_names;
use std::path::Path;
use std::str::FromStr;

/// The robot of a target: a built-in one's name, or a file that is looked for here and beside the configuration.
fn robot_of(named: &str, config: &Path) -> Result<String, Failure> {
    let wrong = |why: String| Failure::usage(format!("{}: target.robot: {why}", config.display()));
    let beside = config.parent().unwrap_or(Path::new("")).join(named);
    // A file in the current folder wins.
    let is_beside = named.ends_with(".toml") && !Path::new(named).exists() && beside.exists();
    let named = if is_beside { beside.display().to_string() } else { named.to_owned() };
    match RobotKind::from_str(&named).map_err(wrong)? {
        RobotKind::Simulated => Err(wrong("a simulated robot is kind = \"simulated-go2\"".to_owned())),
        // The robot's file is read once here, so that its faults show before hours of fitting.
        kind => kind.robot().map(|_| named).map_err(|error| wrong(error.to_string())),
    }
}

/// Runs or continues a loop and reports what came out.
pub fn run(args: &cli::Loop) -> Result<(), Failure> {
    let mut config: LoopConfig = settings::load(Some(&args.config), &args.run.set)?;
    let name = run_name(args.run.name.as_ref(), config.name.as_ref(), Some(&args.config));
    let name = name.unwrap_or_else(|| "loop".to_owned());
    config.name = Some(name.clone());
    config.check(&args.config)?;
    let threads = args.run.threads();
    let devices = args.run.devices(args.device.as_ref(), &config.runs, &name);
    output::devices(&devices);
    // The link is checked now, before anything is computed.
    if let Some(target) = config.target.as_mut().filter(|target| target.kind == TargetKind::Robot) {
        target.robot = robot_of(&target.robot, &args.config)?;
        check_link(&target.interface, target.domain)
            .map_err(|failure| Failure { message: format!("[target] {failure}"), ..failure })?;
    }
    // The loop starts this program again to walk the robot.
    let program = crate::SELF.get().cloned();
    let opened = Setup::open(config, &args.config, threads)?;
    let setup = Setup { devices, program: program.unwrap_or_else(|| opened.program.clone()), ..opened };
    interrupt::listen()?;
    let results = watched(Lines::Seconds(5), |watch| loop_::run(&setup, &name, args.run.resume, watch))?;
    if args.run.json {
        output::print_json(&results)?;
    } else {
        output::print(&plain_names(&table::text(&results), &results.after))?;
    }
    viewer::report(args.run.open, &results.run_folder);
    match results.divergence().or_else(|| results.fallback()) {
        Some(message) => Err(Failure { exit: Exit::Check, message }),
        None => Ok(()),
    }
}
