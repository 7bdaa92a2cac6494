//! The files of a run folder besides those of its seeds.

use super::metrics::{self, Metric};
#[cfg(feature = "report")]
use super::report;
use super::results::{Results, SeedResult};
use super::seed::Files;
use super::setup::{Plan, Setup};
use super::show::{self, Shown};
use crate::Error;
use crate::evaluate::{MANY_FALLS, goes_nowhere};
#[cfg(feature = "report")]
use crate::run::protocol::CONFIG;
use crate::run::{Protocol, RunFolder};
use crate::watch::Watch;
use gaitfit_learn::MEND_DIVERGENCE;
use gaitfit_policy_files::weights;
use gaitfit_view::{Doubt, DoubtKind};
use serde::{Deserialize, Serialize};
use toml::{Table, Value};

/// Amount of training that is asked for.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub struct Asked {
    iterations: u32,
    seeds: Vec<u64>,
}

/// Settings that do not change what an iteration does; files count as what they are, not by their names.
const FREE: [&str; 9] = [
    "name",
    "runs",
    "seeds",
    "checkpoint_seconds",
    "robot",
    "lenient",
    "policy",
    "theta",
    "train.iterations",
];

/// The run of a training in its folder.
pub fn protocol<'a>(folder: &'a RunFolder, setup: &Setup) -> Protocol<'a, Asked> {
    let plan = &setup.plan;
    Protocol {
        folder,
        settings: plan.configuration.clone(),
        free: &FREE,
        inputs: setup.inputs.clone(),
        same_files: false,
        seeds: plan.seeds.clone(),
        devices: setup.devices.to_string(),
        asked: Asked { iterations: plan.train.iterations, seeds: plan.seeds.clone() },
    }
}

/// Refuses to resume with fewer iterations or without a seed.
pub fn check_grown(protocol: &Protocol<'_, Asked>, plan: &Plan) -> Result<(), Error> {
    let shrunk = protocol.saved()?.and_then(|saved| shrunk(&saved, plan));
    shrunk.map_or(Ok(()), |less| {
        Err(Error::settings(format!(
            "{} cannot be continued: {less}, or start afresh without --resume",
            protocol.folder.path().display()
        )))
    })
}

/// Names iterations or seeds that the run has and the settings now lack, with a remedy.
fn shrunk(saved: &Table, plan: &Plan) -> Option<String> {
    let iterations = saved.get("train")?.get("iterations")?.as_integer()?;
    // More iterations continue the training; fewer would ask for a state that was not kept.
    if i64::from(plan.train.iterations) < iterations {
        let now = plan.train.iterations;
        return Some(format!(
            "`train.iterations` was {iterations}, now it is {now}, and it may only grow: give --set \
             train.iterations={iterations}"
        ));
    }
    let seeds = saved.get("seeds")?.as_array()?.iter().filter_map(Value::as_integer);
    // A seed that is left out would stay in the folder without a result.
    let gone =
        seeds.into_iter().find(|&seed| !plan.seeds.iter().any(|&kept| i64::try_from(kept) == Ok(seed)))?;
    Some(format!(
        "`seeds` had {gone} and now lacks it, and the list may only grow: give all of the run's seeds"
    ))
}

/// Data of a trained seed for the report.
pub struct Trained {
    /// Its result.
    pub result: SeedResult,
    /// All its metrics.
    pub metrics: Vec<Metric>,
    /// Its policy at work.
    pub shown: Shown,
    /// Replay on its page.
    #[cfg(feature = "report")]
    pub replay: gaitfit_view::Replay,
}

/// Share of the way from the first commands to the final ones below which a warning says so.
const NEARLY_ALL: f64 = 0.95;

/// Warns that a seed's commands did not grow to the final ranges.
fn small_commands(seed: &Trained) -> Option<String> {
    let level = seed.metrics.last()?.command_level.filter(|level| *level < NEARLY_ALL)?;
    Some(format!(
        "seed {}: its commands grew {:.0} % of the way to task.command's ranges; it has not learnt the rest. Train \
         longer, or let them grow sooner (task.command.curriculum)",
        seed.result.seed,
        100.0 * level
    ))
}

/// Warns that the simulation of robots diverged.
fn diverged(setup: &Setup, seed: &Trained) -> Option<String> {
    let SeedResult { seed, diverged, iterations, .. } = seed.result;
    (diverged > 0).then(|| {
        format!(
            "seed {seed}: {diverged} episodes of {} robots and {iterations} iterations ended because the simulation \
             diverged; they counted as falls. {MEND_DIVERGENCE}",
            setup.plan.train.environments
        )
    })
}

/// States that policies fall or stand where they should walk.
fn not_learnt(setup: &Setup, trained: &[Trained]) -> Option<Doubt> {
    let command = &setup.scene.settings.command;
    let why = |seed: &Trained| {
        let result = &seed.result;
        if let Some(falls) = result.fall_rate.filter(|falls| *falls > MANY_FALLS) {
            return Some(format!("{:.0} % of its last episodes end in a fall", 100.0 * falls));
        }
        // The replay has no noise and no pushes. A policy that falls there has not learnt to walk, whatever the
        // episodes say.
        if let Some(time) = seed.shown.fell() {
            return Some(format!("It falls {time:.1} s into its replay"));
        }
        // While ranges grow, it is not known what a robot that stands still would have.
        let error = Some(result.linear_velocity_error).filter(|_| command.curriculum.is_none());
        error.and_then(|error| goes_nowhere(error, command))
    };
    let sentences: Vec<String> = trained
        .iter()
        .filter_map(|seed| Some(format!("Seed {}: {}.", seed.result.seed, why(seed)?)))
        .collect();
    (!sentences.is_empty()).then(|| {
        Doubt::new(DoubtKind::NotLearnt, format!("{} Train longer (train.iterations).", sentences.join(" ")))
    })
}

/// Shows the policies and writes the page.
pub fn results(folder: &RunFolder, setup: &Setup, watch: &Watch<'_>) -> Result<Results, Error> {
    let plan = &setup.plan;
    let mut trained = Vec::with_capacity(plan.seeds.len());
    for &seed in &plan.seeds {
        trained.push(seed_results(folder, setup, seed, watch)?);
    }
    // A policy that was not trained has not learnt anything to be doubted.
    let doubts = match plan.trains() {
        true => not_learnt(setup, &trained).into_iter().collect(),
        false => vec![Doubt::new(DoubtKind::Untrained, plan.untrained().unwrap_or_default())],
    };
    let results = Results {
        trained: plan.trains(),
        doubts,
        warnings: plan
            .untrained()
            .into_iter()
            .chain(trained.iter().filter_map(|seed| diverged(setup, seed)))
            .chain(trained.iter().filter_map(small_commands))
            .collect(),
        name: folder.name(),
        robot: setup.model.name.clone(),
        task: plan.task.clone(),
        environments: plan.train.environments,
        steps: plan.train.steps,
        parent: setup.start.as_ref().map(|start| start.parent.clone()),
        configuration_hash: setup.inputs.settings.clone(),
        seeds: trained.iter().map(|seed| seed.result.clone()).collect(),
        run_folder: folder.path().display().to_string(),
        wall_seconds: trained.iter().map(|seed| seed.result.wall_seconds).sum(),
    };
    #[cfg(feature = "report")]
    {
        let configuration = folder.read(CONFIG)?.unwrap_or_default();
        let page = report::page(&configuration, setup, &results, &trained)?;
        folder.write("report.html", page.as_bytes())?;
    }
    Ok(results)
}

fn seed_results(folder: &RunFolder, setup: &Setup, seed: u64, watch: &Watch<'_>) -> Result<Trained, Error> {
    let files = Files::new(seed);
    let path = folder.path().join(&files.policy);
    let bytes = folder.read_bytes(&files.policy)?.unwrap_or_default();
    let policy = weights::read(&bytes).map_err(|error| Error::content(&path, error))?;
    let metrics = metrics::read(folder, &files.metrics, policy.provenance.iteration)?;
    // The policy file says how many iterations there were; the file of metrics may have lost some.
    if metrics.len() != policy.provenance.iteration as usize {
        watch.note(&format!(
            "{} has {} of {} iterations: the results and curves leave the others out",
            folder.path().join(&files.metrics).display(),
            metrics.len(),
            policy.provenance.iteration
        ));
    }
    let shown = show::show(setup, &policy)?;
    #[cfg(feature = "report")]
    let replay = report::replay(&format!("{}, seed {seed}", folder.name()), &setup.model, &policy, &shown);
    #[cfg(feature = "report")]
    folder.write(&files.replay, gaitfit_view::replay_html(&replay)?.as_bytes())?;
    let result = SeedResult::new(seed, &metrics, shown.summary(), folder.path());
    Ok(Trained {
        result,
        metrics,
        shown,
        #[cfg(feature = "report")]
        replay,
    })
}
