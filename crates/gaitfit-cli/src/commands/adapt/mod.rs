//! `gaitfit fit`: fits the simulator's parameters to logs of a robot.

mod text;

pub use text::{checks, number, validation};

use super::run_name;
use crate::cli;
use crate::exit::{Exit, Failure};
use crate::progress::Lines;
use crate::watcher::watched;
use crate::{interrupt, output, viewer};
use gaitfit::adapt::{self, AdaptResults, Opening};
use gaitfit::loop_::fit_alone;
use gaitfit::run::RunFolder;
use gaitfit::settings::AdaptConfig;
use gaitfit_model::argument;
use std::num::NonZeroUsize;
use std::path::Path;

/// Runs or continues a fit and prints its result.
pub fn run(args: &cli::Fit) -> Result<(), Failure> {
    let mut config = fit_alone::settings(&args.config, &args.run.set)?;
    let name = run_name(args.run.name.as_ref(), config.name.as_ref(), Some(&args.config)).unwrap_or_default();
    config.name = Some(name.clone());
    let threads = args.run.threads.map(NonZeroUsize::get);
    // A run that resumes looks up its devices in the folder of the last run of this name.
    let devices = args.run.devices(args.device.as_ref(), &config.runs, &name);
    watched(Lines::Seconds(5), |watch| {
        let mut setup =
            Opening::new(&config, &args.config).threads(threads).devices(&devices).watch(watch).open()?;
        output::devices(&setup.devices);
        // Only now: a fit that cannot be opened leaves no folder behind.
        let folder = RunFolder::begin(Path::new(&config.runs), &name, args.run.resume)?;
        interrupt::listen()?;
        let results = adapt::fit(&mut setup, &folder, watch)?;
        if args.run.json {
            output::print_json(&results)?;
        } else {
            output::print(&text::text(&results, &setup.warnings))?;
            if results.failed_check().is_none() && results.refusal().is_none() {
                output::next(&next(&results, args, &config))?;
            }
        }
        // The page opens before the exit code is decided: it shows why a check failed.
        viewer::report(args.run.open, &results.run_folder);
        // A check that the configuration states comes first: the user asked for it.
        checked(results.failed_check().or_else(|| results.contradiction()).or_else(|| results.refusal()))
    })
}

/// The next commands after a fit of `config`. A fit with a time limit that has not converged is resumed first, with the same
/// name and settings.
fn next(results: &AdaptResults, args: &cli::Fit, config: &AdaptConfig) -> Vec<String> {
    let theta = argument(&Path::new(&results.run_folder).join("theta.toml"));
    if !results.converged && config.optimizer.max_seconds > 0.0 {
        let name = args
            .run
            .name
            .as_ref()
            .map_or(String::new(), |name| format!(" --name {}", argument(Path::new(name))));
        let limited = |set: &&String| set.contains("optimizer.max_seconds");
        let sets = args.run.set.iter().filter(|set| !limited(set));
        let sets: String = sets.map(|set| format!(" --set {}", argument(Path::new(set)))).collect();
        // Three times the limit that was too short. The old limit is taken out of `--set`, because the command has
        // a new one.
        let (path, seconds) = (argument(&args.config), 3.0 * config.optimizer.max_seconds);
        return vec![format!(
            "gaitfit fit {path}{name}{sets} --resume --set optimizer.max_seconds={seconds}"
        )];
    }
    // A fit of legs in the air has no policy, so nothing can be trained.
    let training = config.policy.as_ref().map(|policy| {
        let robot = robot_option(Path::new(policy), &config.robot);
        // Policies that cannot be trained are measured in the fitted simulator.
        let command = if is_trainable(Path::new(policy)) { "finetune" } else { "evaluate" };
        format!("gaitfit {command} {} --theta {theta}{robot}", argument(Path::new(policy)))
    });
    // In the order of work: other logs show whether the fit holds, before anything is trained with it.
    let validation = format!("gaitfit validate {theta} OTHER_LOG.csv");
    [validation].into_iter().chain(training).chain([format!("gaitfit export {theta} --out FOLDER")]).collect()
}

/// Whether a policy can be trained further, as far as its file can be read.
fn is_trainable(policy: &Path) -> bool {
    let path = gaitfit::policy_file::find(policy).map(|file| file.path).ok();
    let policy = path.and_then(|path| gaitfit_policy_files::read(&path).ok());
    // If the file cannot be read, `finetune` is named: it prints the error.
    policy.is_none_or(|policy| policy.untrainable().is_none())
}

/// The option that names `robot`, if a configuration does, for a command on a policy that does not remember its robot file.
pub fn robot_option(policy: &Path, robot: &str) -> String {
    // Read only if the configuration names a robot: a policy's file can be large.
    let remembers = || {
        let path = gaitfit::policy_file::find(policy).map(|file| file.path).ok();
        let policy = path.and_then(|path| gaitfit_policy_files::read(&path).ok());
        policy.is_some_and(|policy| policy.provenance.robot_file.is_some())
    };
    if robot.is_empty() || remembers() {
        String::new()
    } else {
        format!(" --robot {}", argument(Path::new(robot)))
    }
}

/// Ends with the exit code of a failed check, if one failed.
pub fn checked(failed: Option<String>) -> Result<(), Failure> {
    match failed {
        None => Ok(()),
        Some(message) => Err(Failure { exit: Exit::Check, message }),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn paths_with_spaces_are_one_argument() {
        let policy = Path::new("no such policy.safetensors");
        assert_eq!(robot_option(policy, "my robot.xml"), " --robot 'my robot.xml'");
        assert_eq!(robot_option(policy, ""), "");
    }
}
