//! Running cells: each is one round of a loop in a folder of its own; cells of a scenario share the target's logs and
//! the reference policies.

use super::experiments::{self, Experiment};
use super::paper::Kind;
use super::parts::{CELLS, LOGS, Part, PartKind, SEED, SHARED};
use super::results::{SeedFit, SeedResult, Walk};
use crate::crew::together;
use crate::device::{Device, Devices};
use crate::loop_::files;
use crate::loop_::results::{REFERENCE, policy_name};
use crate::loop_::rounds::add_truth;
use crate::loop_::setup::Setup;
use crate::loop_::stages::Stages;
use crate::loop_::training_robot::TrainingRobot;
use crate::loop_::{controls, settled};
use crate::run::RunFolder;
use crate::watch::{Event, Watch};
use crate::{Error, ErrorKind};
use indexmap::IndexMap;
use std::path::{Path, PathBuf};

/// A table being run.
pub struct Run<'a> {
    /// The table's cells.
    pub experiments: &'a [Experiment],
    /// What they go through.
    pub kind: Kind,
    /// Seeds of each cell.
    pub seeds: u64,
    /// The table's folder.
    pub folder: &'a RunFolder,
    /// Threads.
    pub threads: usize,
    /// What fits and trains.
    pub devices: &'a Devices,
    /// Cells at a time.
    pub jobs: usize,
    /// Who is told, and may stop it.
    pub watch: &'a Watch<'a>,
}

/// Results of a table's cells, by cell or scenario and by seed.
#[derive(Default)]
pub struct Outcome {
    /// By cell.
    pub cells: IndexMap<String, Vec<SeedResult>>,
    /// By scenario: π₀, the same for all seeds.
    pub first: IndexMap<String, SeedResult>,
    /// By scenario: fine-tuned on the target.
    pub reference: IndexMap<String, Vec<SeedResult>>,
    /// By scenario and name: fine-tuned without logs.
    pub controls: IndexMap<String, IndexMap<String, Vec<SeedResult>>>,
}

/// Logs and references that the cells of a scenario share.
struct Shared {
    logs: PathBuf,
    first: Option<SeedResult>,
    reference: Option<SeedResult>,
    controls: Vec<(String, SeedResult)>,
}

impl Run<'_> {
    /// Runs the selected cells; the first seed of all comes before the second of any.
    pub fn run(&self) -> Result<Outcome, Error> {
        let mut outcome = Outcome::default();
        let selected: Vec<&Experiment> = self.experiments.iter().filter(|one| one.selected).collect();
        for seed in 1..=self.seeds {
            let mut shared: IndexMap<&str, Shared> = IndexMap::new();
            let suffix =
                if self.seeds > 1 { format!(", seed {seed} of {}", self.seeds) } else { String::new() };
            // Logs and references first: all cells of a scenario share them.
            for experiment in &selected {
                let scenario = experiment.scenario.as_str();
                if shared.contains_key(scenario) {
                    continue;
                }
                self.watch.tell(Event::Stage(&format!("\n{scenario}{suffix}: logs and references")));
                let made =
                    self.shared(experiment, seed).map_err(|error| self.explained(error, &experiment.file))?;
                if let Some(first) = &made.first {
                    // The first policy is measured on the same trajectories for every seed, so one result is
                    // enough.
                    outcome.first.entry(scenario.to_owned()).or_insert_with(|| first.clone());
                }
                let reference = made.reference.clone();
                outcome.reference.entry(scenario.to_owned()).or_default().extend(reference);
                let controls = outcome.controls.entry(scenario.to_owned()).or_default();
                for (name, control) in &made.controls {
                    controls.entry(name.clone()).or_default().push(control.clone());
                }
                shared.insert(scenario, made);
            }
            let one = |number: usize, worker: usize, watch: &Watch<'_>| {
                let experiment = selected[number];
                let name = &experiment.paper.name;
                // A blank line between cells that come one after the other.
                let gap = if self.jobs > 1 { "" } else { "\n" };
                watch.tell(Event::Stage(&format!("{gap}[{}/{}] {name}{suffix}", number + 1, selected.len())));
                let failed = |failure| self.explained(failure, &experiment.file);
                let Some(with) = shared.get(experiment.scenario.as_str()) else {
                    return Err(Error::failed(format!("{name} has no logs")));
                };
                // Workers take the devices in turn.
                let device = self.devices.device(worker);
                let result = self.cell(experiment, seed, &with.logs, device, watch).map_err(failed)?;
                watch.tell(Event::Stage(&headline(&result)));
                Ok(result)
            };
            // One after the other without threads, so that progress bars and lines appear as they come.
            let results = if self.jobs > 1 {
                let names: Vec<&str> = selected.iter().map(|one| one.paper.name.as_str()).collect();
                together(&names, self.jobs, self.watch, &one)?
            } else {
                (0..selected.len())
                    .map(|number| one(number, 0, self.watch))
                    .collect::<Result<Vec<SeedResult>, Error>>()?
            };
            for (experiment, result) in selected.iter().zip(results) {
                outcome.cells.entry(experiment.paper.name.clone()).or_default().push(result);
            }
        }
        Ok(outcome)
    }

    /// Makes one part alone, in the table's folder; a cell's scenario was made before.
    ///
    /// # Errors
    /// A part that the table does not have; as [`Self::run`].
    pub fn part(&self, part: &Part) -> Result<(), Error> {
        let Part { kind, name, seed, .. } = part;
        let belongs = |one: &&Experiment| match kind {
            PartKind::Shared => one.scenario == *name,
            PartKind::Cell => one.paper.name == *name,
        };
        let Some(experiment) = self.experiments.iter().find(belongs) else {
            return Err(Error::settings(format!("the table has no {name}")));
        };
        let made = match kind {
            PartKind::Shared => self.shared(experiment, *seed).map(|_| ()),
            PartKind::Cell => {
                let logs = self.folder.path().join(part.needs()).join(LOGS);
                self.cell(experiment, *seed, &logs, self.devices.device(0), self.watch).map(|_| ())
            }
        };
        made.map_err(|error| self.explained(error, &experiment.file))
    }

    /// The logs of a scenario's target and, for fine-tuning, both references.
    fn shared(&self, experiment: &Experiment, seed: u64) -> Result<Shared, Error> {
        let scenario = &experiment.scenario;
        let Some(config) = experiments::shared(self.experiments, scenario, seed) else {
            return Err(Error::failed(format!("the table has no cell of {scenario}")));
        };
        let mut setup = Setup::open(config, &experiment.file, self.threads)?;
        // The shared parts are made one after the other, so they need one device.
        setup.devices = self.devices.first().into();
        let folder = self.open(&format!("{SHARED}/{scenario}"), seed, &setup)?;
        let Some(target) = setup.config.target.clone() else {
            return Err(Error::settings("an experiment needs a [target]"));
        };
        let mut stages = stages(&setup, &folder, self.watch)?;
        let first = stages.keep(&policy_name(0), "policy-0", &setup.policy_bytes)?;
        let logs = stages.collect(LOGS, &first, target.seed)?;
        // These tables compare fitted numbers alone, so nothing is trained.
        if self.kind == Kind::Identification {
            return Ok(Shared { logs, first: None, reference: None, controls: Vec::new() });
        }
        let result = |walk: Option<Walk>, seconds: f64| SeedResult {
            seed,
            walk,
            seconds,
            run_folder: folder.path().display().to_string(),
            ..SeedResult::default()
        };
        let walk = stages.on_target("policy-0", &first)?.as_ref().map(Walk::from);
        // Nothing was fitted or trained, so it took no time.
        let before = result(walk, 0.0);
        let robot = TrainingRobot::target(files::truth(&folder), &target);
        let (trained, _, bytes) = stages.finetune("reference", &first, &robot)?;
        let policy = stages.keep(REFERENCE, "reference", &bytes)?;
        let walk = stages.on_target("reference", &policy)?.as_ref().map(Walk::from);
        let reference = result(walk, trained.wall_seconds);
        let mut controls = Vec::new();
        for (name, place, robot) in controls::wanted(&setup, stages.target.as_ref(), None)? {
            let (trained, _, bytes) = stages.finetune(&format!("controls/{place}"), &first, &robot)?;
            let policy = stages.keep(name, place, &bytes)?;
            let walk = stages.on_target(place, &policy)?.as_ref().map(Walk::from);
            controls.push((place.to_owned(), result(walk, trained.wall_seconds)));
        }
        Ok(Shared { logs, first: Some(before), reference: Some(reference), controls })
    }

    /// One seed of a cell: as it was finished, or made now.
    fn cell(
        &self,
        experiment: &Experiment,
        seed: u64,
        logs: &Path,
        device: Device,
        watch: &Watch<'_>,
    ) -> Result<SeedResult, Error> {
        let mut setup = Setup::open(experiment.seeded(seed), &experiment.file, self.threads)?;
        setup.devices = device.into();
        // The folder is bound to settings and files, so a result in it belongs to this very cell.
        let folder = self.open(&format!("{CELLS}/{}", experiment.paper.name), seed, &setup)?;
        // A table that was interrupted goes on with the first cell that is missing.
        if let Some(text) = folder.read(SEED)? {
            watch.note("finished earlier");
            return serde_json::from_str(&text).map_err(|error| {
                let file = folder.path().join(SEED);
                Error::failed(format!(
                    "{}: not a result of this version: {error}; remove it, and it is made again",
                    file.display()
                ))
            });
        }
        let mut stages = stages(&setup, &folder, watch)?;
        let first = stages.keep(&policy_name(0), "policy-0", &setup.policy_bytes)?;
        let round = "round-1";
        let mut adapt =
            setup.config.adapt(1, first.safetensors.display().to_string(), vec![logs.display().to_string()]);
        adapt.runs = stages.path(round).display().to_string();
        // The truth only rates the fit; the search does not see it.
        add_truth(&setup, &mut adapt);
        let (fitted, results, theta) = stages.adapt(round, &adapt)?;
        let mut result = SeedResult {
            seed,
            fit: results.fits.first().map(|fit| SeedFit::new(fit, results.wall_seconds)),
            walk: None,
            seconds: results.wall_seconds,
            warnings: results.notes().into_iter().filter(|one| !fitted.warnings.contains(one)).collect(),
            run_folder: folder.path().display().to_string(),
        };
        if self.kind == Kind::Finetuning {
            let robot = TrainingRobot::fitted(theta.clone(), settled::of_fit(&results, &theta)?);
            let (trained, _, bytes) = stages.finetune(round, &first, &robot)?;
            let policy = stages.keep(&policy_name(1), "policy-1", &bytes)?;
            result.walk = stages.on_target("policy-1", &policy)?.as_ref().map(Walk::from);
            result.seconds += trained.wall_seconds;
        }
        // Last: the file says that the cell is finished.
        folder.write_json(SEED, &result)?;
        Ok(result)
    }

    /// The folder of a seed, which belongs to these settings and inputs.
    fn open(&self, within: &str, seed: u64, setup: &Setup) -> Result<RunFolder, Error> {
        let folder = RunFolder::only(&self.folder.path().join(within), &format!("seed-{seed}"))?;
        let protocol = files::protocol(&folder, setup)?;
        // Old results of other settings must not stand beside new ones in one table.
        if let Some(difference) = protocol.difference()? {
            return Err(Error::settings(format!(
                "{} was made with other settings: {difference}. Give those, or write elsewhere with --set runs=FOLDER.",
                folder.path().display()
            )));
        }
        // A finished folder stays as it is.
        if folder.read(SEED)?.is_none() {
            protocol.begin()?;
            files::begin(&folder, setup)?;
        }
        Ok(folder)
    }

    /// A failure of a cell, which names the cell's file; how to continue after an interruption.
    fn explained(&self, error: Error, file: &Path) -> Error {
        let file = file.display().to_string();
        if error.kind() == ErrorKind::Interrupted {
            let folder = self.folder.path();
            let message =
                format!("interrupted; {} has what is done, the same command continues", folder.display());
            return Error::interrupted(message, folder);
        }
        // Errors of settings name their file already.
        if error.to_string().contains(&file) { error } else { error.within(format!("{file}:")) }
    }
}

/// The stages of one round in a folder.
fn stages<'a>(setup: &'a Setup, folder: &'a RunFolder, watch: &'a Watch<'a>) -> Result<Stages<'a>, Error> {
    let target = setup.config.target.as_ref();
    let target = target.map(|target| setup.target(target, files::truth(folder), None)).transpose()?;
    Stages::new(setup, folder, target, watch)
}

/// A finished cell in a line.
fn headline(result: &SeedResult) -> String {
    let mut parts = Vec::new();
    if let Some(fit) = &result.fit {
        parts.push(match fit.nominal_cost {
            Some(nominal) => format!("cost {nominal:.5} → {:.5}", fit.cost),
            None => format!("cost {:.5}", fit.cost),
        });
        parts.extend(fit.mean_error_percent.map(|error| format!("mean parameter error {error:.2} %")));
    }
    if let Some(walk) = &result.walk {
        let (linear, angular) = (walk.linear_velocity_error, walk.angular_velocity_error);
        parts.push(format!("on the target: reward {:.2}", walk.reward.mean));
        parts.push(format!("errors {:.3} m/s, {:.3} rad/s", linear.mean, angular.mean));
    }
    parts.push(format!("{:.0} s", result.seconds));
    parts.join(", ")
}
