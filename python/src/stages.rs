//! The stages of the method: files and settings in, one JSON document out.

use crate::errors::{failed, to_py_err, value};
use crate::own_policy::Source;
use crate::share::OwnCrew;
use crate::watch::{Caller, watched, watched_acting};
use gaitfit::adapt::{Limit, Opening, ValidateRequest};
use gaitfit::device::{Device, Devices};
use gaitfit::evaluate::{Evaluation, GroundChoice};
use gaitfit::finetune::{Files, Request};
use gaitfit::run::RunFolder;
use gaitfit::settings::{self, AdaptConfig, FinetuneConfig, LoopConfig, Preset, TrainConfig};
use gaitfit::world::{World as Open, WorldSettings};
use gaitfit::{CollectSettings, Error, EvaluateSettings, Spring, loop_, machine};
use pyo3::prelude::*;
use serde::Serialize;
use std::num::NonZeroUsize;
use std::path::{Path, PathBuf};
use std::sync::Arc;

/// What every stage that keeps a run folder takes.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct Run {
    config: Option<PathBuf>,
    sets: Vec<String>,
    name: Option<String>,
    resume: Resume,
    threads: Option<usize>,
    device: String,
    max_seconds: Option<f64>,
}

/// Whether to continue an earlier run.
enum Resume {
    /// Yes or no.
    Always(bool),
    /// `"auto"`: if there is one.
    IfThere,
}

impl<'py> FromPyObject<'_, 'py> for Resume {
    type Error = PyErr;

    fn extract(given: Borrowed<'_, 'py, PyAny>) -> PyResult<Self> {
        if given.extract::<&str>().is_ok_and(|text| text == "auto") {
            return Ok(Self::IfThere);
        }
        Ok(Self::Always(given.extract()?))
    }
}

impl Run {
    fn threads(&self) -> PyResult<Option<NonZeroUsize>> {
        self.threads
            .map(|threads| NonZeroUsize::new(threads).ok_or_else(|| value("threads must be at least 1")))
            .transpose()
    }

    fn devices(&self) -> PyResult<Devices> {
        self.device.parse().map_err(|wrong: String| value(format!("device is {:?}; {wrong}", self.device)))
    }

    /// Whether to continue the run `name` in the folder `runs`.
    fn resumes(&self, runs: &str, name: &str) -> bool {
        match &self.resume {
            Resume::Always(resume) => *resume,
            Resume::IfThere => Path::new(runs).join(name).is_dir(),
        }
    }

    /// The configuration's file as errors name it.
    fn path(&self) -> &Path {
        self.config.as_deref().unwrap_or(Path::new("settings"))
    }

    /// The name given, the configuration's own, or that of its file.
    fn name(&self, own: Option<&String>, otherwise: &str) -> String {
        let stem = || {
            self.config.as_deref().and_then(Path::file_stem).map(|stem| stem.to_string_lossy().into_owned())
        };
        self.name.as_ref().or(own).cloned().or_else(stem).unwrap_or_else(|| otherwise.to_owned())
    }
}

fn device_of(text: &str) -> PyResult<Device> {
    text.parse().map_err(|wrong: String| value(format!("device is {text:?}; {wrong}")))
}

fn json<T: Serialize>(found: Result<T, Error>) -> PyResult<String> {
    serde_json::to_string(&found.map_err(|error| to_py_err(&error))?).map_err(failed)
}

/// A fit to logs; `policy`: a function that walked, in the place of the configuration's file; `crew` simulates, if there is
/// one.
#[pyfunction]
pub fn adapt(
    py: Python<'_>,
    run: Run,
    policy: Option<Source>,
    progress: Option<Py<PyAny>>,
    crew: Option<Py<PyAny>>,
) -> PyResult<String> {
    let mut config: AdaptConfig =
        settings::load(run.config.as_deref(), &run.sets).map_err(|error| to_py_err(&error))?;
    let name = run.name(config.name.as_ref(), "fit");
    config.name = Some(name.clone());
    let (threads, devices) = (run.threads()?.map(NonZeroUsize::get), run.devices()?);
    let path = run.path();
    let crew = crew.map(|crew| Arc::new(OwnCrew::new(crew)));
    // A fit gives what it has when its time is over; other stages stop.
    let limit = run.max_seconds.map(Limit::new);
    let act = policy.as_ref().and_then(Source::act);
    let found = watched_acting(py, progress.as_ref(), None, act, |watch, caller| {
        let policy = policy.as_ref().map_or(Ok(None), |policy| policy.policy(caller.asked()))?;
        let mut setup = Opening::new(&config, path)
            .threads(threads)
            .devices(&devices)
            .policy(policy.as_ref())
            .watch(watch)
            .open()?;
        setup.limit = limit;
        let folder = RunFolder::begin(Path::new(&config.runs), &name, run.resumes(&config.runs, &name))?;
        if let Some(crew) = &crew {
            crew.open(&setup)?;
            setup = setup.shared(crew.clone());
        }
        gaitfit::adapt::fit(&mut setup, &folder, watch)
    })?;
    match crew.and_then(|crew| crew.raised()) {
        // What the crew raised says more than that the fit failed.
        Some(raised) if found.is_err() => Err(raised),
        _ => json(found),
    }
}

/// A fit on other logs.
#[pyfunction]
pub fn validate(
    py: Python<'_>,
    theta: PathBuf,
    logs: Vec<String>,
    config: Option<PathBuf>,
    sets: Vec<String>,
    threads: Option<usize>,
    policy: Option<Source>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let act = policy.as_ref().and_then(Source::act);
    json(watched_acting(py, progress.as_ref(), None, act, |watch, caller| {
        let policy = policy.as_ref().map_or(Ok(None), |policy| policy.policy(caller.asked()))?;
        gaitfit::adapt::validate(&ValidateRequest { theta, logs, config, set: sets, threads, policy }, watch)
    })?)
}

/// A training from nothing, read and checked.
fn training(run: &Run, robot: Option<String>, seeds: Option<Vec<u64>>) -> PyResult<gaitfit::train::Setup> {
    let mut config: TrainConfig =
        settings::load(run.config.as_deref(), &run.sets).map_err(|error| to_py_err(&error))?;
    let name = run.name(config.name.as_ref(), config.task.base.name());
    config.name = Some(name.clone());
    config.robot = robot.or(config.robot);
    config.seeds = seeds.unwrap_or(config.seeds);
    let threads = run.threads()?.map_or_else(machine::threads, NonZeroUsize::get);
    gaitfit::train::setup(&config, &name, run.config.as_deref(), threads, &run.devices()?)
        .map_err(|error| to_py_err(&error))
}

/// The run folder of a fit, which is begun, and the files that the fit reads. Logs and settings are checked.
#[pyfunction]
pub fn adapt_plan(run: Run) -> PyResult<(PathBuf, Vec<PathBuf>)> {
    let mut config: AdaptConfig =
        settings::load(run.config.as_deref(), &run.sets).map_err(|error| to_py_err(&error))?;
    let name = run.name(config.name.as_ref(), "fit");
    config.name = Some(name.clone());
    let threads = run.threads()?.map(NonZeroUsize::get);
    let setup = Opening::new(&config, run.path())
        .threads(threads)
        .devices(&run.devices()?)
        .open()
        .map_err(|error| to_py_err(&error))?;
    let folder = RunFolder::begin(Path::new(&config.runs), &name, run.resumes(&config.runs, &name))
        .map_err(gaitfit::Error::from)
        .map_err(|error| to_py_err(&error))?;
    let parts = setup.files.iter().flat_map(|file| gaitfit::robot::parts(file));
    let files = run.config.iter().cloned().chain(parts).chain(setup.files.iter().cloned()).collect();
    Ok((folder.path().to_owned(), files))
}

/// A training from nothing.
#[pyfunction]
pub fn train(
    py: Python<'_>,
    run: Run,
    robot: Option<String>,
    seeds: Option<Vec<u64>>,
    terms: Option<Py<PyAny>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let setup = training(&run, robot, seeds)?;
    trained(py, &run, setup, terms.as_ref(), progress.as_ref())
}

/// Trains. `terms` are functions of the user that change rewards and ends of episodes.
fn trained(
    py: Python<'_>,
    run: &Run,
    mut setup: gaitfit::train::Setup,
    terms: Option<&Py<PyAny>>,
    progress: Option<&Py<PyAny>>,
) -> PyResult<String> {
    if let Some(terms) = terms {
        let interface = serde_json::to_string(&setup.scene.walker.interface).map_err(failed)?;
        terms.call_method1(py, "begin", (interface,))?;
        // A run that has terms does not continue without.
        setup.inputs.settings.push_str("-with-terms");
    }
    json(watched_acting(py, progress, run.max_seconds, terms, |watch, caller| {
        setup.scene.user_terms = terms.map(|_| crate::terms::user_terms(caller));
        gaitfit::train::train(&setup, run.resumes(&setup.plan.runs, &setup.plan.name), watch)
    })?)
}

/// What a training needs to be made in parts: its name, its run folder, which is begun, its seeds, and the files that it
/// reads.
type Parts = (String, PathBuf, Vec<u64>, Vec<PathBuf>);

fn plan(run: &Run, setup: &gaitfit::train::Setup) -> PyResult<Parts> {
    let plan = &setup.plan;
    let folder = RunFolder::begin(Path::new(&plan.runs), &plan.name, run.resumes(&plan.runs, &plan.name))
        .map_err(gaitfit::Error::from)
        .map_err(|error| to_py_err(&error))?;
    let read: Vec<PathBuf> = setup.inputs.files.keys().map(PathBuf::from).collect();
    let parts = read.iter().flat_map(|file| gaitfit::robot::parts(file));
    let files = run.config.iter().cloned().chain(parts).chain(read.iter().cloned()).collect();
    Ok((plan.name.clone(), folder.path().to_owned(), plan.seeds.clone(), files))
}

/// The parts of a training from nothing.
#[pyfunction]
pub fn train_plan(run: Run, robot: Option<String>, seeds: Option<Vec<u64>>) -> PyResult<Parts> {
    plan(&run, &training(&run, robot, seeds)?)
}

/// The parts of a training that goes on from a policy.
#[pyfunction]
pub fn finetune_plan(run: Run, world: World, seeds: Option<Vec<u64>>) -> PyResult<Parts> {
    plan(&run, &tuning(&run, world, seeds)?)
}

/// A training that goes on from a policy, read and checked.
fn tuning(run: &Run, world: World, seeds: Option<Vec<u64>>) -> PyResult<gaitfit::train::Setup> {
    let mut config: FinetuneConfig =
        settings::load(run.config.as_deref(), &run.sets).map_err(|error| to_py_err(&error))?;
    let name = run.name(config.name.as_ref(), "finetune");
    config.lenient |= world.lenient;
    config.seeds = seeds.unwrap_or(config.seeds);
    let springs = world.springs()?;
    if !springs.is_empty() {
        config.spring = springs;
    }
    if world.torque_noise != 0.0 {
        config.torque_noise = world.torque_noise;
    }
    gaitfit::finetune::setup(Request {
        config,
        path: run.config.clone(),
        name,
        files: Files { policy: Some(world.policy.name()), theta: world.theta, robot: world.robot },
        task: world.task,
        threads: run.threads()?,
        devices: run.devices()?,
    })
    .map_err(|error| to_py_err(&error))
}

/// A training that goes on from a policy.
#[pyfunction]
pub fn finetune(
    py: Python<'_>,
    run: Run,
    world: World,
    seeds: Option<Vec<u64>>,
    terms: Option<Py<PyAny>>,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let setup = tuning(&run, world, seeds)?;
    trained(py, &run, setup, terms.as_ref(), progress.as_ref())
}

/// The loop.
#[pyfunction]
pub fn run_loop(py: Python<'_>, run: Run, progress: Option<Py<PyAny>>) -> PyResult<String> {
    let mut config: LoopConfig =
        settings::load(run.config.as_deref(), &run.sets).map_err(|error| to_py_err(&error))?;
    let name = run.name(config.name.as_ref(), "loop");
    config.name = Some(name.clone());
    let threads = run.threads()?.map_or_else(machine::threads, NonZeroUsize::get);
    let opened = config.check(run.path()).and_then(|()| loop_::Setup::open(config, run.path(), threads));
    let setup = loop_::Setup { devices: run.devices()?, ..opened.map_err(|error| to_py_err(&error))? };
    let resume = run.resumes(&setup.config.runs, &name);
    json(watched(py, progress.as_ref(), run.max_seconds, |watch| loop_::run(&setup, &name, resume, watch))?)
}

/// A policy and the simulator it runs in.
#[derive(FromPyObject)]
#[pyo3(from_item_all)]
pub struct World {
    policy: Source,
    robot: Option<PathBuf>,
    lenient: bool,
    task: Option<String>,
    theta: Option<PathBuf>,
    spring: Vec<String>,
    torque_noise: f64,
    randomised: bool,
    preset: String,
    seed: u64,
    threads: Option<usize>,
    max_seconds: Option<f64>,
}

impl World {
    fn springs(&self) -> PyResult<Vec<Spring>> {
        self.spring.iter().map(|text| text.parse::<Spring>().map_err(value)).collect()
    }

    fn settings(&self) -> PyResult<WorldSettings> {
        let preset: Preset = self.preset.parse().map_err(|error| value(format!("preset: {error}")))?;
        let threads = |count| NonZeroUsize::new(count).ok_or_else(|| value("threads must be at least 1"));
        Ok(WorldSettings {
            policy: self.policy.name(),
            robot: self.robot.clone(),
            lenient: self.lenient,
            task: self.task.clone(),
            theta: self.theta.clone(),
            spring: self.springs()?,
            torque_noise: self.torque_noise,
            randomised: self.randomised,
            preset,
            seed: self.seed,
            threads: self.threads.map(threads).transpose()?,
        })
    }
}

impl World {
    /// The policy, a file's or one that `caller` asks for actions, in its simulator.
    fn open(&self, settings: &WorldSettings, caller: Caller) -> Result<Open, Error> {
        match self.policy.policy(caller.asked())? {
            Some(policy) => Open::new(settings, policy),
            None => Open::open(settings),
        }
    }
}

/// How well a policy walks.
#[pyfunction]
pub fn evaluate(
    py: Python<'_>,
    world: World,
    trajectories: usize,
    seconds: Option<f64>,
    drift: usize,
    drift_speeds: Option<[f64; 3]>,
    terrain: &str,
    diagnose: bool,
    device: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<String> {
    let settings = EvaluateSettings {
        world: world.settings()?,
        trajectories,
        seconds,
        drift,
        drift_speeds,
        ground: GroundChoice::read(terrain).map_err(|error| to_py_err(&error))?,
        ground_robots: 32,
        device: device_of(device)?,
        diagnose,
    };
    let found =
        watched_acting(py, progress.as_ref(), world.max_seconds, world.policy.act(), |watch, caller| {
            gaitfit::evaluate_in(world.open(&settings.world, caller)?, &settings, watch)
        })?;
    let found = found.map_err(|error| to_py_err(&error))?;
    let mut document = serde_json::to_value(&found.measured.evaluation).map_err(failed)?;
    if let Some(fields) = document.as_object_mut() {
        if let Some(verdict) = &found.verdict {
            fields.insert("verdict".to_owned(), verdict.text.clone().into());
        }
        if let Some(diagnosis) = &found.diagnosis {
            fields.insert("diagnosis".to_owned(), serde_json::to_value(diagnosis).map_err(failed)?);
        }
        fields.insert("wall_seconds".to_owned(), found.wall_seconds.into());
    }
    serde_json::to_string(&document).map_err(failed)
}

/// One evaluation minus another, both as JSON.
#[pyfunction]
pub fn compare(policy: &str, against: &str, on: &str) -> PyResult<String> {
    let read = |text: &str| serde_json::from_str::<Evaluation>(text).map_err(value);
    let found = gaitfit::evaluate::compare(on, &read(policy)?, &read(against)?);
    serde_json::to_string(&found).map_err(failed)
}

/// Logs of a policy in a simulator: what simulated, the files, and how many robots fell.
#[pyfunction]
pub fn collect(
    py: Python<'_>,
    world: World,
    out: PathBuf,
    trajectories: usize,
    seconds: f64,
    log_shift: [f64; 2],
    privileged: bool,
    commands: Option<PathBuf>,
    device: &str,
    progress: Option<Py<PyAny>>,
) -> PyResult<(String, Vec<PathBuf>, usize)> {
    let (world_settings, device) = (world.settings()?, device_of(device)?.for_trajectories(trajectories));
    let settings = CollectSettings {
        world: world_settings,
        trajectories,
        seconds,
        log_shift,
        privileged,
        commands,
        device,
    };
    let found =
        watched_acting(py, progress.as_ref(), world.max_seconds, world.policy.act(), |watch, caller| {
            gaitfit::collect_in(world.open(&settings.world, caller)?, &settings, &out, watch)
        })?;
    let found = found.map_err(|error| to_py_err(&error))?;
    Ok((found.simulator, found.files, found.falls))
}
