//! Stepping a fit: metrics, progress, checkpoints, interruption.

use super::setup::Setup;
use crate::Error;
use crate::run::RunFolder;
use crate::run::inputs::Inputs;
use crate::watch::{Counting, Watch, Work};
use gaitfit_adapt::fit::{Checkpoint, CostOutcome, Fit, FitError, Generation, RunGeneration, Stop};
use serde::{Deserialize, Serialize};
use std::time::{Duration, Instant};

const CHECKPOINT: &str = "checkpoint.json";
/// One line a generation and run.
pub const METRICS: &str = "metrics.jsonl";

/// The checkpoint file.
#[derive(Serialize, Deserialize)]
struct Saved {
    /// The inputs of the fit.
    inputs: Inputs,
    /// Wall time spent so far, s.
    wall_seconds: f64,
    /// The fit.
    fit: Checkpoint,
}

/// One line of the metrics.
#[derive(Serialize, Deserialize)]
pub struct Metric {
    /// Generation, from 1.
    pub generation: usize,
    /// Wall time of the fit when it was done, s.
    pub wall_seconds: f64,
    /// The run's part of it.
    #[serde(flatten)]
    pub run: RunGeneration,
}

/// Fits to the end, from the folder's checkpoint if it has one. Returns the outcomes and the wall time of all
/// sessions, s.
pub fn fit(
    setup: &Setup,
    folder: &RunFolder,
    inputs: &Inputs,
    watch: &Watch<'_>,
) -> Result<(Vec<CostOutcome>, f64), Error> {
    let (mut fit, before) = start(setup, folder, inputs)?;
    let limit = setup.config.optimizer.max_seconds;
    // A limit of the search replaces the share that it has of the whole call's limit.
    let whole = setup.limit.filter(|_| limit == 0.0);
    let begun = Instant::now();
    // Sessions before this one count for the limit.
    let seconds = || before + begun.elapsed().as_secs_f64();
    let counting = watch.begin(Work {
        what: "generation",
        total: setup.options.max_generations(),
        first: fit.generation(),
        parts: "evaluations",
        seed: None,
    });
    let mut saved = Instant::now();
    let every = Duration::try_from_secs_f64(setup.config.checkpoint_seconds).unwrap_or(Duration::MAX);
    let save = |fit: &Fit<'_>| -> Result<(), Error> {
        let state = Saved { inputs: inputs.clone(), wall_seconds: seconds(), fit: fit.checkpoint() };
        let text = serde_json::to_vec(&state)
            .map_err(|error| Error::failed(format!("cannot write the checkpoint: {error}")))?;
        Ok(folder.write(CHECKPOINT, &text)?)
    };
    // Saved first: the message promises a checkpoint.
    let interrupted = |fit: &Fit<'_>| match save(fit) {
        Err(error) => error,
        Ok(()) => {
            let message = format!(
                "interrupted after generation {}; {} has the checkpoint, --resume continues",
                fit.generation(),
                folder.path().display()
            );
            Error::interrupted(message, folder.path())
        }
    };
    loop {
        let generation = match fit.step(&|| watch.stop()) {
            Ok(None) => break,
            Ok(Some(generation)) => generation,
            Err(FitError::Cancelled) => return Err(interrupted(&fit)),
            // A GPU that failed, a worker that is gone: the generations before are whole.
            Err(error @ FitError::Simulator(_)) if fit.generation() > 0 => {
                save(&fit)?;
                return Err(Error::failed(format!(
                    "{error}. {} has the checkpoint of generation {}, --resume continues.",
                    folder.path().display(),
                    fit.generation()
                )));
            }
            Err(error) => return Err(Error::failed(error)),
        };
        // Metrics are written before a checkpoint can name their generation.
        folder.append(METRICS, &metric_lines(&generation, seconds())?)?;
        tell_metrics(&counting, &generation);
        counting.step(fit.generation(), generation.evaluations, &best(setup, &fit));
        // Asked again, because a generation takes long and is whole now.
        if watch.stop() {
            return Err(interrupted(&fit));
        }
        if limit > 0.0 && seconds() >= limit && !fit.finished() {
            watch.note(&format!(
                "stopped after {limit} s (optimizer.max_seconds), generation {}",
                fit.generation()
            ));
            break;
        }
        if let Some(whole) = whole.filter(|whole| whole.search_over() && !fit.finished()) {
            watch.note(&format!(
                "the search stopped after {} s, half of max_seconds, generation {}; intervals are measured next",
                whole.search_seconds(),
                fit.generation()
            ));
            break;
        }
        if saved.elapsed() >= every {
            save(&fit)?;
            saved = Instant::now();
        }
    }
    // Ends the line of progress before the notes below.
    drop(counting);
    // A search that time ended is resumed from here under a higher limit.
    save(&fit)?;
    let outcomes = fit.outcomes();
    if let Some(why) = ended(&outcomes) {
        watch.note(&format!("the search ended after generation {}: {why}", fit.generation()));
    }
    Ok((outcomes, seconds()))
}

/// Why the searches ended, if none was cut short; `None` without searches.
fn ended(outcomes: &[CostOutcome]) -> Option<String> {
    let runs = outcomes.iter().flat_map(|outcome| &outcome.runs);
    let mut reasons = Vec::new();
    for run in runs {
        let reason = match run.stop? {
            Stop::Generations => "all generations are done (optimizer.generations)",
            Stop::Tolerance => "its distribution is as small as optimizer.tolerance",
            Stop::Patience => "the smallest costs are steady",
            Stop::Converged => "nothing changes any more",
            Stop::Degenerate => "it cannot continue",
        };
        if !reasons.contains(&reason) {
            reasons.push(reason);
        }
    }
    (!reasons.is_empty()).then(|| reasons.join("; for another seed: "))
}

/// A fresh fit, or the checkpoint's with the metrics cut back to it.
fn start<'a>(setup: &'a Setup, folder: &RunFolder, inputs: &Inputs) -> Result<(Fit<'a>, f64), Error> {
    // Everything is read and compared before the metrics are cut: a refused resumption leaves the folder as it
    // was.
    let (simulator, theta, costs) =
        (setup.searched().simulator.as_ref(), &setup.theta, setup.costs.as_slice());
    let options = setup.options.clone();
    let Some(text) = folder.read(CHECKPOINT)? else {
        folder.write(METRICS, b"")?;
        let fit = Fit::new(simulator, theta, costs, options).map_err(Error::failed)?;
        return Ok((fit, 0.0));
    };
    let shown = folder.path().join(CHECKPOINT);
    let saved: Saved = serde_json::from_str(&text).map_err(|error| {
        Error::failed(format!(
            "{}: not a checkpoint of this version: {error}. Start afresh without --resume.",
            shown.display()
        ))
    })?;
    if let Some(difference) = inputs.difference(&saved.inputs) {
        return Err(Error::settings(format!(
            "{} cannot be continued: {difference} since. Restore it, or start afresh without --resume.",
            shown.display()
        )));
    }
    let generation = saved.fit.generation;
    let fit = Fit::resume(simulator, theta, costs, options, saved.fit).map_err(Error::failed)?;
    // Metrics are written every generation, checkpoints more seldom. So the file may be ahead of the
    // checkpoint.
    let metrics = folder.read(METRICS)?.unwrap_or_default();
    // Generations after the checkpoint are done again.
    let kept = metrics.lines().filter(|line| {
        serde_json::from_str::<Metric>(line).is_ok_and(|metric| metric.generation <= generation)
    });
    let kept: String = kept.flat_map(|line| [line, "\n"]).collect();
    folder.write(METRICS, kept.as_bytes())?;
    Ok((fit, saved.wall_seconds))
}

/// The generations of a folder's runs, as far as its metrics can be read.
pub fn metrics(folder: &RunFolder) -> Result<Vec<RunGeneration>, Error> {
    let text = folder.read(METRICS)?.unwrap_or_default();
    let run = |line: &str| serde_json::from_str::<Metric>(line).ok().map(|metric| metric.run);
    Ok(text.lines().filter_map(run).collect())
}

fn metric_lines(generation: &Generation, wall_seconds: f64) -> Result<String, Error> {
    let mut lines = String::new();
    for run in &generation.runs {
        let metric = Metric { generation: generation.generation, wall_seconds, run: run.clone() };
        let line = serde_json::to_string(&metric)
            .map_err(|error| Error::failed(format!("cannot write {METRICS}: {error}")))?;
        lines.push_str(&line);
        lines.push('\n');
    }
    Ok(lines)
}

/// The numbers of a generation by name, such as `wass/seed-1/best_so_far`.
fn tell_metrics(counting: &Counting<'_>, generation: &Generation) {
    let named = generation.runs.iter().flat_map(|run| {
        let name = |what: &str| format!("{}/seed-{}/{what}", run.cost, run.seed);
        [
            (name("best_so_far"), run.best_so_far),
            (name("best"), run.best),
            (name("mean"), run.mean),
            (name("sigma"), run.sigma),
            (name("diverged"), run.diverged as f64),
            (name("fallen"), run.fallen as f64),
        ]
    });
    let named: Vec<(String, f64)> = named.collect();
    let metrics: Vec<(&str, f64)> = named.iter().map(|(name, value)| (name.as_str(), *value)).collect();
    counting.metrics(&metrics);
}

/// The best so far, for the progress bar: each cost, and the first values of θ of the first one.
fn best(setup: &Setup, fit: &Fit<'_>) -> String {
    const SHOWN: usize = 3;
    let costs = setup.costs.iter().zip(fit.best_costs());
    let mut text: Vec<String> =
        costs.filter_map(|(cost, best)| Some(format!("{} {:.5}", cost.name(), best?))).collect();
    if let Some(values) = fit.best_values(0) {
        let shown = setup.theta.entries().iter().zip(values).take(SHOWN);
        text.extend(shown.map(|(entry, value)| format!("{} {value:.3}", entry.name)));
    }
    text.join("  ")
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use crate::adapt::{Opening, Setup, fit};
    use crate::run::RunFolder;
    use crate::settings;
    use crate::watch::Watch;
    use gaitfit_adapt::cost::Cost;
    use gaitfit_adapt::fit::{Evaluation, FitError, Job};
    use gaitfit_adapt::{Cancel, Consume, Identity, Rollout, Simulator, SimulatorError, Theta};
    use std::path::Path;
    use std::sync::atomic::{AtomicUsize, Ordering};

    /// A simulator whose GPU fails after some generations.
    struct Failing {
        inner: Box<gaitfit_adapt::SharedSimulator>,
        left: AtomicUsize,
    }

    impl Simulator for Failing {
        fn identity(&self) -> &Identity {
            self.inner.identity()
        }

        fn simulate(
            &self,
            theta: &Theta,
            candidates: &[Rollout],
            consume: &Consume<'_>,
            cancel: &Cancel<'_>,
        ) -> Result<(), SimulatorError> {
            self.inner.simulate(theta, candidates, consume, cancel)
        }

        fn costs(
            &self,
            theta: &Theta,
            costs: &[Box<dyn Cost>],
            jobs: &[Job],
            cancel: &Cancel<'_>,
        ) -> Result<Vec<Evaluation>, FitError> {
            let left =
                self.left.fetch_update(Ordering::Relaxed, Ordering::Relaxed, |left| left.checked_sub(1));
            left.map_err(|_| SimulatorError::failed("cuda:1: the bus is cut"))?;
            self.inner.costs(theta, costs, jobs, cancel)
        }
    }

    /// A short fit of the demo's log.
    fn open(generations: usize) -> Setup {
        let file = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../examples/go2-demo/adapt.toml");
        let changes = [
            "optimizer.seeds=1".to_owned(),
            format!("optimizer.generations={generations}"),
            "simulation.timestep=0.005".to_owned(),
            "check={}".to_owned(),
            "robot=../../assets/go2.xml".to_owned(),
            "logs=[\"../../examples/go2-demo/fit.csv\"]".to_owned(),
            "validate=[]".to_owned(),
        ];
        Opening::new(&settings::load(Some(&file), &changes).unwrap(), &file).threads(2).open().unwrap()
    }

    fn values(results: &crate::adapt::AdaptResults) -> Vec<f64> {
        results.parameters.iter().map(|one| one.found.value).collect()
    }

    #[test]
    fn no_reason_is_given_without_searches() {
        assert_eq!(super::ended(&[]), None);
    }

    #[test]
    fn a_finished_fit_continues_where_more_generations_are_asked_for() {
        let runs = tempfile::tempdir().unwrap();
        let folder = |name: &str| RunFolder::only(runs.path(), name).unwrap();
        let fitted = |generations, name: &str| fit(&mut open(generations), &folder(name), &Watch::silent());
        let whole = fitted(6, "whole").unwrap();
        let first = fitted(3, "more").unwrap();
        assert_ne!(values(&first), values(&whole));
        let more = fitted(6, "more").unwrap();
        assert_eq!((more.cost, values(&more)), (whole.cost, values(&whole)));
        assert_eq!(crate::adapt::metrics(&folder("more")).unwrap().len(), 6);
        let fewer = fitted(3, "more").unwrap_err().to_string();
        assert!(fewer.contains("6 generations"), "{fewer}");
    }

    #[test]
    fn a_fit_whose_gpu_fails_goes_on_where_it_was() {
        let runs = tempfile::tempdir().unwrap();
        let folder = |name: &str| RunFolder::only(runs.path(), name).unwrap();
        let whole = fit(&mut open(6), &folder("whole"), &Watch::silent()).unwrap();
        let mut broken = open(6);
        let nothing = open(6).fit.simulator;
        let inner = std::mem::replace(&mut broken.fit.simulator, nothing);
        broken.fit.simulator = Box::new(Failing { inner, left: AtomicUsize::new(4) });
        let error = fit(&mut broken, &folder("broken"), &Watch::silent()).unwrap_err().to_string();
        assert!(error.contains("cuda:1: the bus is cut") && error.contains("of generation 4"), "{error}");
        // The last checkpoint by the clock is older: `checkpoint_seconds` are not over.
        let resumed = fit(&mut open(6), &folder("broken"), &Watch::silent()).unwrap();
        assert_eq!((resumed.cost, resumed.fits.len()), (whole.cost, whole.fits.len()));
        assert_eq!(values(&resumed), values(&whole));
    }
}
