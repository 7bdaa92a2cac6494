//! `gaitfit finetune`: trains a policy further by PPO in a fitted simulator.

use super::adapt::checked;
use super::{run_name, train};
use crate::cli;
use crate::exit::Failure;
use crate::watcher::watched;
use crate::{interrupt, output};
use gaitfit::finetune::{Files, Request, setup};
use gaitfit::settings::{self, FinetuneConfig};

/// Trains all seeds, or continues them, and reports what came out.
pub fn run(args: &cli::Finetune) -> Result<(), Failure> {
    let path = args.config.as_deref();
    let mut config: FinetuneConfig = settings::load(path, &args.run.set)?;
    let name = run_name(args.run.name.as_ref(), config.name.as_ref(), path);
    // The command line wins over the file.
    if let Some(seeds) = &args.seeds {
        config.seeds = seeds.0.clone();
    }
    config.lenient |= args.lenient;
    if !args.spring.is_empty() {
        config.spring = args.spring.clone();
    }
    if let Some(noise) = args.torque_noise {
        config.torque_noise = noise;
    }
    let name = name.unwrap_or_else(|| "finetune".to_owned());
    let devices = args.run.devices(args.device.as_ref(), &config.runs, &name);
    let setup = setup(Request {
        config,
        path: args.config.clone(),
        name,
        files: Files { policy: args.policy.clone(), theta: args.theta.clone(), robot: args.robot.clone() },
        task: args.task.clone(),
        threads: args.run.threads,
        devices,
    })?;
    output::devices(&setup.devices);
    interrupt::listen()?;
    let results = watched(train::LINES, |watch| gaitfit::train::train(&setup, args.run.resume, watch))?;
    train::print(&results, &args.run)?;
    // `finetune` starts from a policy that walked. A new policy that does not walk yet may only need longer training.
    checked(results.unlearnt())
}
