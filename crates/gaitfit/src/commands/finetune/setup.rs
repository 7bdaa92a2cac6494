//! Everything a fine-tuning needs, read and checked before anything is written.

use super::policy;
use crate::cli::{Finetune, WorldArgs};
use crate::commands::train::{Parent, Plan, Setup, Start, advice, configuration, name, refused};
use crate::config::{self, FinetuneConfig, changed};
use crate::exit::Failure;
use crate::inputs::{self, Inputs};
use crate::output::note;
use crate::paths;
use crate::world::{self, World};
use gaitfit_learn::policy::Policy;
use gaitfit_learn::task::TaskSettings;
use std::path::{Path, PathBuf};
use toml::Table;

const PRINTED_BY: &str = "gaitfit config finetune";

/// Reads policy, robot and fitted parameters, and checks the settings.
pub fn setup(args: &Finetune) -> Result<Setup, Failure> {
    let path = args.config.as_deref();
    let wrong = |wrong: String| Failure::usage(advice(path, &wrong, PRINTED_BY));
    let mut config: FinetuneConfig = config::load(path, &args.set)?;
    let run = name(args.name.as_ref(), config.name.as_ref(), path).unwrap_or_else(|| "finetune".to_owned());
    config.name = Some(run.clone());
    if let Some(seeds) = &args.seeds {
        config.seeds = seeds.0.clone();
    }
    let files = Files::find(args, &mut config)?;
    let (mut policy, policy_sha256) = policy::read(&files.policy)?;
    let theta_sha256 = files.theta.as_deref().map(hash).transpose()?;
    pinned(&mut config.policy_sha256, Some(&policy_sha256), &files.policy)?;
    if let Some(theta) = &files.theta {
        pinned(&mut config.theta_sha256, theta_sha256.as_ref(), theta)?;
    }
    let arguments = world_arguments(args, &files, &mut config);
    let (plan, settings, new_critic) = plan(&mut config, &arguments, &mut policy, run).map_err(&wrong)?;
    if plan.ppo.critic_warmup.is_some_and(|updates| updates >= plan.train.iterations) {
        note(&format!(
            "note: the first {} updates teach the critic alone, so {} iterations leave the policy as it is; raise \
             train.iterations or lower ppo.critic_warmup",
            plan.ppo.critic_warmup.unwrap_or(0),
            plan.train.iterations
        ));
    }
    let world = World::with_task(&arguments, policy, settings)?;
    let model = world.scene.batch.model().clone();
    let inputs = Inputs::new(files.all(), &model, &bound(&config))?;
    let parent = Parent {
        policy: files.policy.display().to_string(),
        policy_sha256,
        theta: files.theta.as_ref().map(|path| path.display().to_string()),
        theta_sha256,
        simulator: world.description(),
        new_critic,
    };
    let setup = Setup {
        plan,
        model,
        candidate: Some(world.candidate),
        scene: world.scene,
        start: Some(Start { policy: world.policy, parent }),
        inputs,
        threads: World::threads(&arguments),
    };
    setup.learner(0).map_err(|error| refused(path, &error, PRINTED_BY))?;
    Ok(setup)
}

/// The training that the settings ask for, its task, and whether it begins with a new critic; settles what the policy
/// decides.
///
/// # Errors
/// In words.
fn plan(
    config: &mut FinetuneConfig,
    arguments: &WorldArgs,
    policy: &mut Policy,
    run: String,
) -> Result<(Plan, TaskSettings, bool), String> {
    let settings = task(arguments, policy, &mut config.task)?;
    policy::settle(&mut config.ppo, policy)?;
    let new_critic = policy.critic.is_none();
    if new_critic && policy.interface.critic_observation.is_empty() {
        // A policy trained elsewhere need not say what a critic would see: the task does.
        policy.interface.critic_observation = settings.policy.critic_observation.clone();
    }
    if policy.interface.critic_observation.is_empty() {
        return Err("neither policy nor task says what the critic sees (critic_observation)".to_owned());
    }
    let plan = Plan {
        name: run,
        runs: config.runs.clone(),
        seeds: config.seeds.clone(),
        checkpoint_seconds: config.checkpoint_seconds,
        preset: config.preset,
        train: config.train.clone(),
        ppo: config.ppo.clone(),
        task: arguments.task.clone().unwrap_or_else(|| "the policy's own".to_owned()),
        configuration: configuration(config).map_err(|failure| failure.message)?,
    };
    plan.check()?;
    Ok((plan, settings, new_critic))
}

/// Refuses settings that no training can be made of, for programs that train later: `arguments` say on which robot.
///
/// # Errors
/// Usage, naming the setting.
pub fn check(config: &FinetuneConfig, arguments: &WorldArgs, policy: &Policy) -> Result<(), Failure> {
    let mut policy = policy.clone();
    let mut config = FinetuneConfig { runs: ".".to_owned(), ..config.clone() };
    let (_, settings, _) =
        plan(&mut config, arguments, &mut policy, "finetune".to_owned()).map_err(Failure::usage)?;
    World::with_task(arguments, policy, settings).map(|_| ())
}

/// The files that a fine-tuning reads.
struct Files {
    policy: PathBuf,
    theta: Option<PathBuf>,
    robot: Option<PathBuf>,
}

impl Files {
    /// The command line's, else the configuration's, which then names the former. A file asked for on the command line
    /// need not have the hash that the configuration asks for.
    fn find(args: &Finetune, config: &mut FinetuneConfig) -> Result<Self, Failure> {
        if args.policy.is_some() {
            config.policy_sha256 = None;
        }
        if args.theta.is_some() {
            config.theta_sha256 = None;
        }
        let find =
            |asked: &Option<PathBuf>, configured: &mut Option<String>, what: &str| match (asked, &configured)
            {
                (Some(path), _) => {
                    *configured = Some(path.display().to_string());
                    Ok(Some(path.clone()))
                }
                (None, Some(named)) => {
                    paths::find(named, what, args.config.as_deref().unwrap_or(Path::new("--set"))).map(Some)
                }
                (None, None) => Ok(None),
            };
        let policy = find(&args.policy, &mut config.policy, "policy")?.ok_or_else(|| {
            Failure::usage(
                "no policy to go on from; give one, for example `gaitfit finetune runs/velocity/seed-1/policy.safetensors \
                 --theta runs/fit/theta.toml`",
            )
        })?;
        let theta = find(&args.theta, &mut config.theta, "theta")?;
        let robot = find(&args.robot, &mut config.robot, "robot")?;
        Ok(Self { policy, theta, robot })
    }

    fn all(&self) -> impl Iterator<Item = &Path> {
        [Some(&self.policy), self.theta.as_ref(), self.robot.as_ref()]
            .into_iter()
            .flatten()
            .map(PathBuf::as_path)
    }
}

fn hash(path: &Path) -> Result<String, Failure> {
    let bytes = std::fs::read(path)
        .map_err(|error| Failure::failed(format!("cannot read {}: {error}", path.display())))?;
    Ok(inputs::hash(&bytes))
}

/// Holds a file to the hash that the configuration asks for, or writes its own there.
fn pinned(asked: &mut Option<String>, found: Option<&String>, path: &Path) -> Result<(), Failure> {
    match (&asked, found) {
        (Some(asked), Some(found)) if asked != found => Err(Failure::usage(format!(
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

/// The simulator as [`World`] takes it; what the command line adds enters the configuration.
fn world_arguments(args: &Finetune, files: &Files, config: &mut FinetuneConfig) -> WorldArgs {
    config.lenient |= args.lenient;
    if !args.spring.is_empty() {
        config.spring = args.spring.clone();
    }
    if let Some(noise) = args.torque_noise {
        config.torque_noise = noise;
    }
    WorldArgs {
        policy: files.policy.clone(),
        robot: files.robot.clone(),
        lenient: config.lenient,
        task: args.task.clone(),
        theta: files.theta.clone(),
        spring: config.spring.clone(),
        torque_noise: config.torque_noise,
        randomised: true,
        preset: config.preset.into(),
        seed: 0,
        threads: args.threads,
    }
}

/// The task: the policy's own or the one asked for, with the changes of the configuration, which becomes the whole.
///
/// # Errors
/// In words.
fn task(arguments: &WorldArgs, policy: &Policy, changes: &mut Table) -> Result<TaskSettings, String> {
    for (key, why) in [
        ("base", "name the built-in task with --task"),
        ("policy", "what the policy sees and does is its own"),
    ] {
        if changes.contains_key(key) {
            return Err(format!("`task.{key}` cannot be set in fine-tuning: {why}"));
        }
    }
    let own = policy.interface.control_dt;
    let mut settings = world::task(arguments, policy).map_err(|failure| failure.message)?;
    settings.control_dt = own;
    let whole = Table::try_from(&settings).map_err(|error| error.to_string())?;
    let mut whole = changed(whole, changes);
    let settings: TaskSettings =
        whole.clone().try_into().map_err(|error| format!("[task] {}", error.to_string().trim_end()))?;
    if settings.control_dt != own {
        let asked = settings.control_dt;
        return Err(format!(
            "`task.control_dt` is {asked} s, and the policy acts every {own} s: leave it out"
        ));
    }
    whole.remove("policy");
    *changes = whole;
    Ok(settings)
}

/// What a run is bound to: its settings without those that do not change what an iteration does. Files count by their
/// hashes, the robot as what it is.
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
