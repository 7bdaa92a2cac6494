//! Everything a fine-tuning needs, read and checked before anything is written.

use super::policy;
use crate::Error;
use crate::adapt::CONTRADICTED;
use crate::device::Devices;
use crate::draws;
use crate::paths;
use crate::policy_file::{self, PolicyFile};
use crate::robot_file;
use crate::run::inputs::{Inputs, hash_file};
use crate::settings::{FinetuneConfig, changed, tamed};
use crate::train::{Parent, Plan, Setup, Start, advice, configuration, refused};
use crate::world::{self, World, WorldSettings};
use gaitfit_adapt::MAX_REASON;
use gaitfit_learn::Training;
use gaitfit_learn::task::TaskSettings;
use gaitfit_model::{escaped, shown_number};
use gaitfit_policy::Policy;
use std::path::{Path, PathBuf};
use toml::Table;

const PRINTED_BY: &str = "gaitfit config finetune";

/// Request for a fine-tuning.
#[derive(Clone, Debug)]
pub struct Request {
    /// All settings.
    pub config: FinetuneConfig,
    /// Where the settings were read: relative paths may start from its folder.
    pub path: Option<PathBuf>,
    /// Name of the run.
    pub name: String,
    /// Files that win over those of the settings.
    pub files: Files,
    /// Task: `velocity`, `biped`, or a file with a task's settings; the policy's own without one.
    pub task: Option<String>,
    /// Threads; none takes one a core.
    pub threads: Option<std::num::NonZeroUsize>,
    /// What computes; several share the seeds.
    pub devices: Devices,
}

/// Refuses fitted parameters that walks contradict, unless that is allowed.
fn uncontradicted(path: &Path, allow: &[String]) -> Result<(), Error> {
    let file = crate::theta::read(path)?;
    match file.contradicted.filter(|_| !allow.iter().any(|name| name == CONTRADICTED)) {
        None => Ok(()),
        Some(why) => Err(Error::settings(format!(
            "{}: walks that were not fitted contradict it: {}. A policy that is trained there can be worse than \
             before. Fit again with other parameters or logs. To train in spite of this, set `allow = \
             [\"{CONTRADICTED}\"]` (--set 'allow=[\"{CONTRADICTED}\"]')",
            path.display(),
            escaped(&why, MAX_REASON)
        ))),
    }
}

/// Reads policy, robot and fitted parameters, and checks the settings.
pub fn setup(request: Request) -> Result<Setup, Error> {
    let Request { mut config, path, name: run, files, task, threads, devices } = request;
    let path = path.as_deref();
    let wrong = |wrong: String| Error::settings(advice(path, &wrong, PRINTED_BY));
    config.name = Some(run.clone());
    let mut files = Found::find(&files, &mut config, path)?;
    let (mut policy, policy_sha256) = policy::read(&files.policy)?;
    // Checked next: the files are those that the settings were written for, and the fit may be trained in.
    let theta_sha256 = files.theta.as_deref().map(hash_file).transpose()?;
    // The hashes go into the written configuration, so that a resumed run finds changed files out.
    pinned(&mut config.policy_sha256, Some(&policy_sha256), &files.policy)?;
    if let Some(theta) = &files.theta {
        pinned(&mut config.theta_sha256, theta_sha256.as_ref(), theta)?;
        uncontradicted(theta, &config.allow)?;
    }
    if let Some(name) = config.allow.iter().find(|name| *name != CONTRADICTED) {
        return Err(wrong(format!(
            "`allow` has {name:?}; the finding that a training may pass over is \"{CONTRADICTED}\""
        )));
    }
    // The same world as an evaluation's, so that both agree on robot, task and θ; only it is randomised.
    let asked = WorldSettings {
        policy: files.policy.clone(),
        robot: files.robot.clone(),
        lenient: config.lenient,
        task,
        theta: files.theta.clone(),
        spring: config.spring.clone(),
        torque_noise: config.torque_noise,
        randomised: true,
        preset: config.preset,
        seed: 0,
        threads,
    };
    let (arguments, notes) = robot_file::settled(&asked, &policy)?;
    files.robot.clone_from(&arguments.robot);
    config.robot = files.robot.as_ref().map(|path| path.display().to_string());
    config.lenient = arguments.lenient;
    let robot_file =
        files.robot.as_deref().map(|path| robot_file::record(path, config.lenient)).transpose()?;
    // Noted now: `plan` writes the whole task into the configuration.
    let changed = !config.task.is_empty();
    let (plan, settings, new_critic) =
        plan(&mut config, &arguments, &mut policy, run).map_err(|error| wrong(error.to_string()))?;
    let mut warnings: Vec<String> =
        plan.untrained().into_iter().chain(files.notes.clone()).chain(notes).collect();
    let drawn = if config.randomise_theta {
        Some(files.draws().map_err(|error| wrong(error.to_string()))?)
    } else {
        None
    };
    let of_task = |error: Error| {
        // Settings of [task] lie upon those of the file.
        if changed && error.is_of_task() { wrong(error.to_string()) } else { arguments.of_task(error) }
    };
    let world = World::among(&arguments, policy, settings, drawn.as_deref()).map_err(of_task)?;
    warnings.extend(world.warnings.iter().cloned());
    let model = world.model.clone();
    let inputs = Inputs::new(files.all().chain(drawn.as_deref()), &model, &bound(&config))?;
    let parent = Parent {
        policy: files.policy.display().to_string(),
        policy_sha256,
        theta: files.theta.as_ref().map(|path| path.display().to_string()),
        theta_sha256,
        simulator: world.description(),
        new_critic,
    };
    let mut setup = Setup {
        plan,
        model,
        candidate: Some(world.candidate),
        drawn: world.drawn,
        scene: world.scene,
        start: Some(Start { policy: world.policy, parent }),
        inputs,
        robot_file,
        threads: arguments.threads(),
        devices,
        warnings,
    };
    // Any seed: this only shows whether policy and settings fit.
    setup.learner(0).map_err(|error| refused(path, &error, PRINTED_BY))?;
    setup.settle_device()?;
    Ok(setup)
}

/// The training that the settings ask for, its task, and whether it begins with a new critic; settles what the policy
/// decides.
///
/// # Errors
/// Settings that do not fit the policy.
fn plan(
    config: &mut FinetuneConfig,
    arguments: &WorldSettings,
    policy: &mut Policy,
    run: String,
) -> Result<(Plan, TaskSettings, bool), Error> {
    let settings = task(arguments, policy, &mut config.task)?;
    policy::settle(&mut config.ppo, policy)?;
    let new_critic = policy.critic.is_none();
    if new_critic && policy.interface.critic_observation.is_empty() {
        // A policy trained elsewhere need not say what a critic would see: the task does.
        policy.interface.critic_observation = settings.policy.critic_observation.clone();
    }
    if policy.interface.critic_observation.is_empty() {
        return Err(Error::settings(
            "neither policy nor task states what the critic observes (critic_observation)",
        ));
    }
    let mut plan = Plan {
        name: run,
        runs: config.runs.clone(),
        seeds: config.seeds.clone(),
        checkpoint_seconds: config.checkpoint_seconds,
        preset: config.preset,
        train: config.train.clone(),
        ppo: config.ppo.clone(),
        task: arguments.task.clone().unwrap_or_else(|| "the policy's own".to_owned()),
        configuration: Table::new(),
    };
    plan.check()?;
    // Seeds beyond TOML's numbers are refused by name before they are written.
    plan.configuration = configuration(config)?;
    Ok((plan, settings, new_critic))
}

/// Refuses settings that no training can be made of, for programs that train later: `arguments` say on which robot.
///
/// # Errors
/// Usage, naming the setting.
pub fn check(config: &FinetuneConfig, arguments: &WorldSettings, policy: &Policy) -> Result<(), Error> {
    let mut policy = policy.clone();
    // The later training has a folder of its own, and `Plan::check` refuses an empty one.
    let mut config = FinetuneConfig { runs: ".".to_owned(), ..config.clone() };
    let (_, settings, _) =
        plan(&mut config, arguments, &mut policy, "finetune".to_owned()).map_err(Error::settings)?;
    let world = World::with_task(arguments, policy, settings)?;
    let learner = Training::learner_from(&world.scene, &config.ppo, &world.policy, 0);
    learner.map(|_| ()).map_err(|error| refused(None, &error, PRINTED_BY))
}

/// Files that are asked for beside the settings.
#[derive(Clone, Debug, Default)]
pub struct Files {
    /// Policy to train further.
    pub policy: Option<PathBuf>,
    /// Fitted parameters.
    pub theta: Option<PathBuf>,
    /// Robot.
    pub robot: Option<PathBuf>,
}

/// The files that a fine-tuning reads.
struct Found {
    policy: PathBuf,
    theta: Option<PathBuf>,
    robot: Option<PathBuf>,
    /// Notes on the choice of the policy.
    notes: Vec<String>,
}

impl Found {
    /// The files asked for, else the configuration's, which then names the former. A file asked for need not have the
    /// hash that the configuration asks for.
    fn find(asked: &Files, config: &mut FinetuneConfig, path: Option<&Path>) -> Result<Self, Error> {
        // The hash belongs to the file that the configuration names, not to the one that replaces it.
        if asked.policy.is_some() {
            config.policy_sha256 = None;
        }
        if asked.theta.is_some() {
            config.theta_sha256 = None;
        }
        let find =
            |asked: &Option<PathBuf>, configured: &mut Option<String>, what: &str| match (asked, &configured)
            {
                (Some(path), _) => {
                    *configured = Some(path.display().to_string());
                    Ok(Some(path.clone()))
                }
                (None, Some(named)) => paths::find(named, what, path.unwrap_or(Path::new("--set"))).map(Some),
                (None, None) => Ok(None),
            };
        let policy = find(&asked.policy, &mut config.policy, "policy")?.ok_or_else(|| {
            Error::settings(
                "no policy to train further; give one, for example `gaitfit finetune runs/velocity --theta \
                 runs/fit/theta.toml`",
            )
        })?;
        let PolicyFile { path: policy, note } = policy_file::find(&policy)?;
        config.policy = Some(policy.display().to_string());
        let theta = find(&asked.theta, &mut config.theta, "theta")?;
        let robot = find(&asked.robot, &mut config.robot, "robot")?;
        Ok(Self { policy, theta, robot, notes: note.into_iter().collect() })
    }

    /// The draws of the fit.
    ///
    /// # Errors
    /// There is no fit.
    fn draws(&self) -> Result<PathBuf, Error> {
        let missing = "`randomise_theta` takes draws of fitted parameters, and there are none: give `theta` (--theta), or \
                       set it to false";
        self.theta.as_deref().map(draws::beside).ok_or_else(|| Error::settings(missing))
    }

    fn all(&self) -> impl Iterator<Item = &Path> {
        [Some(&self.policy), self.theta.as_ref(), self.robot.as_ref()]
            .into_iter()
            .flatten()
            .map(PathBuf::as_path)
    }
}

/// Holds a file to the hash that the configuration asks for, or writes its own there.
fn pinned(asked: &mut Option<String>, found: Option<&String>, path: &Path) -> Result<(), Error> {
    match (&asked, found) {
        (Some(asked), Some(found)) if asked != found => Err(Error::settings(format!(
            "{} has SHA-256 {found}, the configuration asks for {asked}; give the file it was written for, or leave \
             the hash out",
            path.display()
        ))),
        _ => {
            *asked = found.cloned();
            Ok(())
        }
    }
}

/// The task: the policy's own or the one asked for, with the changes of the configuration, which becomes the whole.
///
/// # Errors
/// Settings that do not fit the policy.
fn task(arguments: &WorldSettings, policy: &Policy, changes: &mut Table) -> Result<TaskSettings, Error> {
    for (key, why) in
        [("base", "name the built-in task with --task"), ("policy", "the policy's own interface decides it")]
    {
        if changes.contains_key(key) {
            return Err(Error::settings(format!("`task.{key}` cannot be set in fine-tuning: {why}")));
        }
    }
    let control_dt = policy.interface.control_dt;
    let mut settings = world::task(arguments, policy)?;
    // A task file may have been written for another policy; only a change in [task] is a wish, and is refused
    // below.
    settings.control_dt = control_dt;
    // The policy knows the final commands: it begins with them, unless [task] says otherwise.
    settings.command.curriculum = None;
    let whole = Table::try_from(&settings).map_err(Error::failed)?;
    let mut whole = changed(whole, changes);
    let settings: TaskSettings = whole
        .clone()
        .try_into()
        .map_err(|error| Error::settings(format!("[task] {}", tamed(error.to_string().trim_end(), 4000))))?;
    if settings.control_dt != control_dt {
        let asked = settings.control_dt;
        return Err(Error::settings(format!(
            "`task.control_dt` is {} s, and the policy acts every {control_dt} s: leave it out",
            shown_number(asked)
        )));
    }
    // The policy's own interface decides it; the configuration does not repeat it.
    whole.remove("policy");
    *changes = whole;
    Ok(settings)
}

/// Returns the settings that a run is bound to: all without those that do not change what an iteration does.
/// Files count by their hashes, the robot as what it is.
fn bound(config: &FinetuneConfig) -> FinetuneConfig {
    let mut bound = config.clone();
    bound.name = None;
    bound.policy = None;
    bound.theta = None;
    bound.robot = None;
    bound.lenient = false;
    bound.runs = String::new();
    bound.seeds = Vec::new();
    bound.checkpoint_seconds = 0.0;
    bound.train.iterations = 0;
    bound
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_adapt::ThetaFile;

    #[test]
    fn a_fit_that_walks_contradict_is_refused_unless_it_is_allowed_by_name() {
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("theta.toml");
        let write = |contradicted: Option<&str>| {
            let file = ThetaFile { contradicted: contradicted.map(str::to_owned), ..ThetaFile::nominal() };
            std::fs::write(&path, file.to_toml().unwrap()).unwrap();
        };
        write(Some("1.54 against 0.34"));
        let error = uncontradicted(&path, &[]).unwrap_err().to_string();
        assert!(error.contains("1.54 against 0.34") && error.contains("allow"), "{error}");
        assert!(uncontradicted(&path, &[CONTRADICTED.to_owned()]).is_ok());
        write(None);
        assert!(uncontradicted(&path, &[]).is_ok());
    }
}
