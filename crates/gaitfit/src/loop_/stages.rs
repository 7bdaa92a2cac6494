//! The stages of a loop. Each returns its result if it has ended, resumes if it was interrupted, or begins. The files that it
//! leaves are the same in each case.

use super::files::Times;
use super::results::{Measurement, tracking_error};
use super::settled;
use super::setup::Setup;
use super::training_robot::TrainingRobot;
use crate::Error;
use crate::adapt::{self, AdaptResults};
use crate::evaluate::{Evaluation, Plan, measure};
use crate::run::RunFolder;
use crate::settings::{AdaptConfig, FinetuneConfig, changed};
use crate::target::{PolicyFiles, Target};
use crate::watch::{Event, Watch};
use crate::world::WorldSettings;
use crate::{files as user_files, finetune, train};
use gaitfit_learn::TrainingSettings;
use gaitfit_log::csv_files;
use gaitfit_policy_files::{onnx, weights};
use serde::Serialize;
use std::path::{Path, PathBuf};
use std::time::Instant;

/// Data that the stages share.
pub struct Stages<'a> {
    /// The loop.
    pub setup: &'a Setup,
    /// Its folder.
    pub folder: &'a RunFolder,
    /// The robot, if it can be run from here.
    pub target: Option<Target>,
    /// Wall times.
    pub times: Times<'a>,
    /// Stages that were come to, and all there will be, if that is known.
    steps: (usize, Option<usize>),
    watch: &'a Watch<'a>,
}

impl<'a> Stages<'a> {
    /// The stages of a loop in a folder.
    ///
    /// # Errors
    /// A folder that cannot be read.
    pub fn new(
        setup: &'a Setup,
        folder: &'a RunFolder,
        target: Option<Target>,
        watch: &'a Watch<'a>,
    ) -> Result<Self, Error> {
        Ok(Self { setup, folder, target, times: Times::read(folder)?, steps: (0, None), watch })
    }

    /// Says from now on which of so many stages begins.
    pub fn counted(mut self, all: usize) -> Self {
        self.steps.1 = Some(all);
        self
    }

    /// Says that a stage begins.
    fn announce(&self, text: &str) {
        match self.steps {
            (number, Some(all)) => self.watch.tell(Event::Stage(&format!("[{number}/{all}] {text}"))),
            (_, None) => self.watch.tell(Event::Stage(text)),
        }
    }

    /// Tells something that the results say too.
    pub fn note(&self, text: &str) {
        self.watch.note(text);
    }

    /// Comes to the next stage, or stops before it when that was asked for.
    fn pause(&mut self) -> Result<(), Error> {
        self.steps.0 += 1;
        self.stopped()
    }

    /// An interruption, if it was asked for.
    fn stopped(&self) -> Result<(), Error> {
        if !self.watch.stop() {
            return Ok(());
        }
        let message =
            format!("interrupted; {} has what is done, --resume continues", self.folder.path().display());
        Err(Error::interrupted(message, self.folder.path()))
    }

    /// A file of the run's folder as seen from the current directory.
    pub fn path(&self, name: &str) -> PathBuf {
        self.folder.path().join(name)
    }

    /// Writes a policy under its number's name, in both formats.
    pub fn keep(&self, name: &str, stem: &str, bytes: &[u8]) -> Result<PolicyFiles, Error> {
        let policy = weights::read(bytes)?;
        let files = [format!("policies/{stem}.safetensors"), format!("policies/{stem}.onnx")];
        // Made before anything is written, so that a policy has both files or neither.
        let graph = onnx::write(&policy)?;
        self.folder.write(&files[0], bytes)?;
        self.folder.write(&files[1], &graph)?;
        let [safetensors, onnx] = files.map(|file| self.path(&file));
        Ok(PolicyFiles { name: name.to_owned(), safetensors, onnx, policy })
    }

    /// The folder `name` with logs of the policy on the target.
    pub fn collect(&mut self, name: &str, policy: &PolicyFiles, seed: u64) -> Result<PathBuf, Error> {
        self.pause()?;
        let folder = self.path(name);
        // A folder of logs has all of them or does not exist, so one that exists is not recorded again.
        if let (false, Some(target)) = (folder.is_dir(), &self.target) {
            self.announce(&format!("{name}: {} walks on the target, {}", policy.name, target.description()));
            let begun = Instant::now();
            target.collect(policy, seed, &folder, self.watch)?;
            self.times.set(name, begun.elapsed().as_secs_f64())?;
        }
        // Checked after a resume too: the folder may be one that held no log the first time.
        if csv_files(&folder)?.is_empty() {
            return Err(Error::failed(format!(
                "{} holds no logs: every robot fell before its log began",
                folder.display()
            )));
        }
        Ok(folder)
    }

    /// The fit in the folder `round/adapt`.
    pub fn adapt(
        &mut self,
        round: &str,
        config: &AdaptConfig,
    ) -> Result<(adapt::Setup, AdaptResults, PathBuf), Error> {
        self.pause()?;
        let stage = format!("{round}/adapt");
        let file = format!("{round}/adapt.toml");
        self.folder.make(round)?;
        self.write_config(&file, config)?;
        let recorded = self.path(&format!("{round}/logs"));
        let (threads, devices) = (Some(self.setup.threads), &self.setup.devices);
        let path = self.path(&file);
        let opening = adapt::Opening::new(config, &path).threads(threads).devices(devices);
        // An interruption comes before errors: reading that was stopped is no fault of the files.
        let setup = opening.watch(self.watch).open();
        self.stopped()?;
        // Errors of logs get advice: they may be few because some are held out, or bad as the target recorded
        // them.
        let mut setup = setup.map_err(|error| {
            let error = if config.validate.is_empty() {
                error
            } else {
                let (held, all) = (config.validate.len(), config.validate.len() + config.logs.len());
                error.advised(format!("{held} of {all} logs are held out; `held_out = 0` fits them too."))
            };
            // Logs that the user gave are not the target's to record again.
            if !recorded.is_dir() {
                return error;
            }
            let folder = recorded.display();
            error.advised(format!(
                "The target recorded these logs; remove {folder}, and --resume asks it for others."
            ))
        })?;
        self.announce(&format!(
            "{stage}: {} parameters are fitted to {} logs{}",
            setup.theta.len(),
            setup.fit.logs.len(),
            match config.validate.len() {
                0 => String::new(),
                held => format!(", {held} are held out"),
            }
        ));
        let folder = RunFolder::only(&self.path(round), "adapt")?;
        // Finished, resumed or begun: the folder of the fit shows which.
        let results = adapt::fit(&mut setup, &folder, self.watch)?;
        self.times.set(&stage, results.wall_seconds)?;
        Ok((setup, results, folder.path().join("theta.toml")))
    }

    /// The training in the folder `round/finetune`, from a policy, on a simulated robot. Gives the seed of the policy that
    /// is taken, and its bytes.
    pub fn finetune(
        &mut self,
        round: &str,
        policy: &PolicyFiles,
        robot: &TrainingRobot,
    ) -> Result<(train::Results, u64, Vec<u8>), Error> {
        self.pause()?;
        let stage = format!("{round}/finetune");
        let file = format!("{round}/finetune.toml");
        self.folder.make(round)?;
        let settings = &self.setup.config.finetune;
        // What the settings of the training state wins over what the fit settles.
        let mut task = settled::without_draws(changed(settings.task.clone(), &robot.task), &robot.settled);
        // The policy is trained where the robot was fitted.
        if let Some(step) = self.setup.config.adapt.simulation.robot_timestep {
            // A value of the training's own task stays.
            task.entry("robot_timestep").or_insert(toml::Value::Float(step));
        }
        if let Some(chosen) = &self.setup.config.adapt.simulation.self_contact {
            let chosen = toml::Value::try_from(chosen)
                .map_err(|error| Error::failed(format!("cannot write `self_contact`: {error}")))?;
            task.entry("self_contact").or_insert(chosen);
        }
        let config = FinetuneConfig {
            task,
            name: Some("finetune".to_owned()),
            policy: Some(policy.safetensors.display().to_string()),
            // A hash binds a configuration to a file elsewhere. Here the loop has written the file itself.
            policy_sha256: None,
            theta: robot.theta.as_ref().map(|path| path.display().to_string()),
            theta_sha256: None,
            // Draws are of a fit.
            randomise_theta: (settings.randomise_theta || robot.drawn) && robot.fitted,
            // A control is trained as long as all rounds of the loop together.
            train: TrainingSettings {
                iterations: settings.train.iterations.saturating_mul(robot.times),
                ..settings.train.clone()
            },
            robot: self.setup.robot.as_ref().map(|path| path.display().to_string()),
            lenient: self.setup.config.lenient,
            spring: robot.spring.clone(),
            torque_noise: robot.torque_noise,
            runs: self.path(round).display().to_string(),
            checkpoint_seconds: self.setup.config.checkpoint_seconds,
            ..settings.clone()
        };
        // Written before the training, so that the file is there to be read if it fails.
        self.write_config(&file, &config)?;
        let setup = finetune::setup(finetune::Request {
            config: config.clone(),
            path: Some(self.path(&file)),
            name: "finetune".to_owned(),
            files: finetune::Files::default(),
            task: None,
            threads: std::num::NonZeroUsize::new(self.setup.threads),
            // As many devices as can share the robots of each seed evenly.
            devices: self.setup.devices.sharing(config.seeds.len(), config.train.environments),
        })?;
        self.announce(&format!(
            "{stage}: {} is trained further for {} iterations with {} robots",
            policy.name, config.train.iterations, config.train.environments
        ));
        let folder = RunFolder::only(&self.path(round), "finetune")?;
        // As for the fit, the training's folder shows how far it is.
        let results = train::train_in(&setup, &folder, self.watch)?;
        self.times.set(&stage, results.wall_seconds)?;
        let mut trained = Vec::with_capacity(results.seeds.len());
        for one in &results.seeds {
            let path = Path::new(&one.policy);
            let bytes = user_files::read(path, user_files::MAX_BYTES)
                .map_err(|error| Error::unreadable(path, error))?;
            trained.push((one.seed, bytes));
        }
        let (seed, bytes) = self.best_of(&stage, robot, trained)?;
        Ok((results, seed, bytes))
    }

    /// Returns the training of a stage whose policy follows commands best in the simulator that all were
    /// trained in.
    /// Chance decides much of a training, and where a policy gets stuck it does so there too.
    fn best_of(
        &self,
        stage: &str,
        robot: &TrainingRobot,
        mut trained: Vec<(u64, Vec<u8>)>,
    ) -> Result<(u64, Vec<u8>), Error> {
        let mut evaluations = Vec::with_capacity(trained.len());
        // A single training needs no choice, so it is not measured.
        for (seed, bytes) in trained.iter().filter(|_| trained.len() > 1) {
            let policy = weights::read(bytes)?;
            let (spring, torque_noise) = (robot.spring.clone(), robot.torque_noise);
            let arguments = self.setup.world_arguments(robot.theta.clone());
            let world = self.setup.world(&policy, &WorldSettings { spring, torque_noise, ..arguments })?;
            let name = format!("seed {seed}");
            evaluations
                .push(measure(&world, &name, &self.setup.choice_of_trainings(), self.watch)?.evaluation);
        }
        // Without measurements all are equal, and the first is taken.
        let error = |number: usize| evaluations.get(number).map_or(f64::INFINITY, tracking_error);
        let best = (0..trained.len()).min_by(|a, b| error(*a).total_cmp(&error(*b))).unwrap_or_default();
        if evaluations.len() > 1 {
            let each: Vec<String> =
                evaluations.iter().map(|one| format!("{} {:.4}", one.policy, tracking_error(one))).collect();
            self.watch.note(&format!(
                "{stage}: the policy of {} is taken; tracking errors where they were trained (m/s and rad/s added): {}",
                evaluations[best].policy,
                each.join(", ")
            ));
        }
        if trained.is_empty() {
            return Err(Error::failed(format!("{stage} left no policy")));
        }
        Ok(trained.swap_remove(best))
    }

    /// Measures a policy on the target; `None` if that is impossible.
    pub fn on_target(&mut self, stem: &str, policy: &PolicyFiles) -> Result<Option<Evaluation>, Error> {
        self.measured_on_target(&format!("{stem}-target"), policy, self.setup.plan())
    }

    /// As [`Self::on_target`], on other trajectories, by which a policy is chosen: those by which it is
    /// reported must not choose it.
    pub fn for_choice(&mut self, stem: &str, policy: &PolicyFiles) -> Result<Option<Evaluation>, Error> {
        self.measured_on_target(&format!("{stem}-choice"), policy, self.setup.choice())
    }

    fn measured_on_target(
        &mut self,
        name: &str,
        policy: &PolicyFiles,
        plan: Plan,
    ) -> Result<Option<Evaluation>, Error> {
        // Taken out for the call, which borrows all of the stages.
        let Some(target) = self.target.take_if(|target| target.measures()) else { return Ok(None) };
        let watch = self.watch;
        let what = format!("{} on the target, {}", policy.name, target.description());
        let evaluation = self.evaluation(name, &what, || target.evaluate(policy, &plan, watch));
        self.target = Some(target);
        evaluation
    }

    /// Measures a policy in the simulator of a fit.
    pub fn on_adapted(
        &mut self,
        stem: &str,
        policy: &PolicyFiles,
        round: u32,
        theta: &Path,
    ) -> Result<Option<Evaluation>, Error> {
        let (setup, watch) = (self.setup, self.watch);
        let what = format!("{} in the simulator of round {round}", policy.name);
        self.evaluation(&format!("{stem}-adapted-{round}"), &what, || {
            let world = setup.adapted(policy, theta.to_owned())?;
            let evaluation = measure(&world, &policy.name, &setup.plan(), watch)?.evaluation;
            // Not the file's path: documents must be the same wherever the run's folder is.
            Ok(Some(Evaluation { simulator: format!("the simulator of round {round}"), ..evaluation }))
        })
    }

    /// An evaluation as it was written, or made and written now; `what` says of which policy and where.
    fn evaluation(
        &mut self,
        name: &str,
        what: &str,
        make: impl FnOnce() -> Result<Option<Evaluation>, Error>,
    ) -> Result<Option<Evaluation>, Error> {
        self.pause()?;
        let file = format!("evaluations/{name}.json");
        // A resumed run takes what it measured before.
        if let Some(text) = self.folder.read(&file)? {
            return serde_json::from_str(&text).map(Some).map_err(|error| {
                let problem = format!(
                    "not an evaluation of this version: {error}. Remove it and --resume makes it again."
                );
                Error::content(&self.path(&file), problem)
            });
        }
        // Only for the line: a choice has as many trajectories.
        let plan = self.setup.plan();
        self.announce(&format!("evaluations: {what}, {} trajectories", plan.trajectories));
        let begun = Instant::now();
        let evaluation = make()?;
        if let Some(evaluation) = &evaluation {
            self.folder.write_json(&file, evaluation)?;
            self.times.set(&format!("evaluations/{name}"), begun.elapsed().as_secs_f64())?;
        }
        Ok(evaluation)
    }

    /// Writes a stage's configuration, as the stage's own command reads it.
    fn write_config<C: Serialize>(&self, name: &str, config: &C) -> Result<(), Error> {
        let text = toml::to_string_pretty(config)
            .map_err(|error| Error::failed(format!("cannot write {name}: {error}")))?;
        Ok(self.folder.write(name, text.as_bytes())?)
    }
}

/// Adds the name of the place where a policy was measured.
pub fn measurement(on: &str, evaluation: Option<Evaluation>) -> Option<Measurement> {
    evaluation.map(|evaluation| Measurement { on: on.to_owned(), evaluation })
}
