//! Training one seed: iterations, metrics, checkpoints, interruption.

use super::metrics::{self, Metric};
use super::setup::Setup;
use crate::Error;
use crate::device::{Devices, Trainer, start_training, store_training};
use crate::run::RunFolder;
use crate::tensorboard::EventFile;
use crate::watch::{Watch, Work};
use gaitfit_learn::{Training, TrainingError};
use gaitfit_policy_files::weights;
use std::path::Path;
use std::time::{Duration, Instant, SystemTime};

/// Files of a seed, in its folder.
pub struct Files {
    /// The folder.
    pub folder: String,
    /// One line an iteration.
    pub metrics: String,
    /// The whole state.
    pub checkpoint: String,
    /// The policy of the checkpoint.
    pub policy: String,
    /// Scalars for TensorBoard.
    pub events: String,
    /// The policy at work.
    pub replay: String,
}

impl Files {
    /// The files of `seed`.
    pub fn new(seed: u64) -> Self {
        let folder = format!("seed-{seed}");
        let file = |name: &str| format!("{folder}/{name}");
        Self {
            metrics: file("metrics.jsonl"),
            checkpoint: file("checkpoint.safetensors"),
            policy: file("policy.safetensors"),
            events: file("events.out.tfevents.0.gaitfit"),
            replay: file("replay.html"),
            folder,
        }
    }
}

/// Trains a seed to its end on `devices`, of which several GPUs share the robots, from its checkpoint if it has one.
pub fn train(
    setup: &Setup,
    folder: &RunFolder,
    seed: u64,
    devices: &Devices,
    watch: &Watch<'_>,
) -> Result<(), Error> {
    let files = Files::new(seed);
    folder.make(&files.folder)?;
    let learner = setup.learner(seed).map_err(Error::settings)?;
    let settings = &setup.plan.train;
    // With draws of a fit, each robot of the training varies around one of them. Otherwise all vary around
    // one robot.
    let training = if setup.drawn.is_empty() {
        Training::new(&setup.scene, setup.candidate.as_ref(), settings, learner, seed)
    } else {
        Training::among(&setup.scene, &setup.drawn, settings, learner, seed)
    };
    let training = training.map_err(Error::settings)?;
    let (trainer, before, begun) = (None, 0.0, Instant::now());
    let mut session =
        Session { setup, folder, files, seed, devices, training, trainer, before, begun, watch };
    session.start()?;
    session.run()
}

/// One seed in this process.
struct Session<'a> {
    setup: &'a Setup,
    folder: &'a RunFolder,
    files: Files,
    seed: u64,
    devices: &'a Devices,
    training: Training<'a>,
    /// The training on a GPU; then `training` is what was last saved.
    trainer: Option<Trainer<'a>>,
    /// Wall time of earlier sessions, s.
    before: f64,
    begun: Instant,
    watch: &'a Watch<'a>,
}

impl Session<'_> {
    fn seconds(&self) -> f64 {
        self.before + self.begun.elapsed().as_secs_f64()
    }

    /// Takes up the checkpoint, or writes the first one; metrics are cut back to it.
    fn start(&mut self) -> Result<(), Error> {
        let name = &self.files.checkpoint;
        match self.folder.read_bytes(name)? {
            Some(bytes) => {
                let restored = self.training.restore(&bytes, &self.setup.origin(self.seed));
                self.before = restored.map_err(|error| {
                    let problem = format!("{error}. Restore it, or start afresh without --resume.");
                    Error::content(&self.folder.path().join(name), problem)
                })?;
            }
            // Without this a lost checkpoint would train the seed from nothing over its finished policy.
            None if self.folder.read(&self.files.metrics)?.is_some_and(|lines| !lines.is_empty()) => {
                return Err(Error::failed(format!(
                    "{} is missing, and the seed has been trained already; restore it, or start afresh without \
                     --resume (the policy is where it was)",
                    self.folder.path().join(name).display()
                )));
            }
            // Before the first iteration, so that a run that dies early can be resumed as well.
            None => self.save()?,
        }
        // The checkpoint is restored on the CPU, and a GPU then takes its state from there.
        let gpus = self.devices.open()?;
        if !gpus.is_empty() && self.setup.scene.user_terms.is_some() {
            return Err(Error::settings(
                "rewards and ends of episodes by a function of yours need the device cpu",
            ));
        }
        if !gpus.is_empty() {
            match start_training(&gpus, &mut self.training) {
                Ok(trainer) => self.trainer = Some(trainer),
                Err(error) => match self.devices.instead(&error) {
                    Some(note) => self.watch.note(&note),
                    None => return Err(error),
                },
            }
        }
        // Iterations after the checkpoint are done again, so their lines go.
        let kept = metrics::read(self.folder, &self.files.metrics, self.training.iteration())?;
        let mut lines = String::new();
        for metric in kept {
            lines.push_str(&metric.line()?);
        }
        Ok(self.folder.write(&self.files.metrics, lines.as_bytes())?)
    }

    /// Writes policy and checkpoint. The checkpoint comes last: what it counts as done is on the disk.
    fn save(&mut self) -> Result<(), Error> {
        // On a GPU the state of the last iterations is in its memory only. It is copied here before it is
        // written.
        if let Some(trainer) = &self.trainer {
            store_training(trainer, &mut self.training)?;
        }
        let mut policy = self.training.policy(&self.setup.inputs.settings, env!("CARGO_PKG_VERSION"));
        policy.provenance.robot_file.clone_from(&self.setup.robot_file);
        if let Some(start) = &self.setup.start {
            policy.provenance.parent = start.parent.policy_sha256.clone();
            policy.provenance.theta = start.parent.theta_sha256.clone().unwrap_or_default();
        }
        let bytes = weights::write(&policy)?;
        self.folder.write(&self.files.policy, &bytes)?;
        let seconds = self.seconds();
        let state = self.training.save(&self.setup.origin(self.seed), seconds)?;
        Ok(self.folder.write(&self.files.checkpoint, &state)?)
    }

    fn run(mut self) -> Result<(), Error> {
        let event_path = self.folder.path().join(&self.files.events);
        let unwritable = |error| Error::unwritable(&event_path, error);
        let first = self.training.iteration();
        let mut events = EventFile::open(&event_path, Some(u64::from(first))).map_err(unwritable)?;
        // A resumed run may have more iterations behind it than its settings ask for.
        let total = (self.setup.plan.train.iterations as usize).max(first as usize);
        let what = format!("seed {}, iteration", self.seed);
        let work =
            Work { what: &what, total, first: first as usize, parts: "samples", seed: Some(self.seed) };
        let counting = self.watch.begin(work);
        let every = Duration::try_from_secs_f64(self.setup.plan.checkpoint_seconds).unwrap_or(Duration::MAX);
        // When and at which iteration the last checkpoint was written.
        let mut saved = (Instant::now(), first);
        while !self.finished() {
            // An error leaves the files of the last checkpoint, from which a resumed run goes on.
            let iteration = match &mut self.trainer {
                Some(trainer) => match trainer.iterate() {
                    Ok(iteration) => iteration,
                    Err(error) => return Err(self.stopped(&error, saved.1)),
                },
                None => match self.training.iterate(self.setup.threads) {
                    Ok(iteration) => iteration,
                    // Who stops a function in the middle of an iteration stops the training. Nothing is saved: the robots
                    // are past the iteration's beginning, so a resumed training would not have the same bits.
                    Err(TrainingError::UserTerms { .. }) if self.watch.stop() => {
                        return Err(self.interrupted(saved.1));
                    }
                    Err(error) => return Err(self.stopped(&error, saved.1)),
                },
            };
            let metric = Metric::new(&iteration, &self.setup.scene, self.seconds());
            // The line comes before the checkpoint: lines too many are cut, lines too few would be missing
            // for good.
            self.folder.append(&self.files.metrics, &metric.line()?)?;
            let scalars = metric.scalars();
            let scalars: Vec<(&str, f64)> = scalars.iter().map(|(tag, x)| (tag.as_str(), *x)).collect();
            let now = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).unwrap_or_default();
            let step = u64::from(metric.iteration);
            events.scalars(step, now.as_secs_f64(), &scalars).map_err(unwritable)?;
            // A rollout has the same number of samples in every iteration.
            let steps = self.setup.plan.train.environments * self.setup.plan.train.steps;
            counting.metrics(&scalars);
            counting.step(metric.iteration as usize, steps, &state(&metric));
            let interrupted = self.watch.stop();
            // An interruption saves first, so nothing that was computed is lost.
            if interrupted || saved.0.elapsed() >= every || self.finished() {
                self.folder.sync(&self.files.metrics)?;
                self.save()?;
                saved = (Instant::now(), metric.iteration);
            }
            if interrupted && !self.finished() {
                return Err(self.interrupted(saved.1));
            }
        }
        drop(counting);
        // Asked in a seed's last iteration: the next ones, and the report, wait for --resume.
        if self.watch.stop() { Err(self.interrupted(saved.1)) } else { Ok(()) }
    }

    /// The error of an interruption. `kept`: the iteration of the last checkpoint.
    fn interrupted(&self, kept: u32) -> Error {
        let path = self.folder.path();
        let message =
            interruption(self.training.iteration(), kept, self.seed, &path.join(&self.files.folder));
        Error::interrupted(message, path)
    }

    fn finished(&self) -> bool {
        self.trainer.as_ref().map_or_else(|| self.training.finished(), Trainer::finished)
    }

    /// Error that states why the training stopped and what was kept.
    fn stopped(&self, error: &dyn std::error::Error, kept: u32) -> Error {
        let path = self.folder.path();
        Error::failed(format!(
            "seed {}, {error}. Kept from iteration {kept}: {} and {}",
            self.seed,
            path.join(&self.files.checkpoint).display(),
            path.join(&self.files.policy).display()
        ))
    }
}

/// The message of an interruption after `iteration`, where `folder` has the checkpoint of iteration `kept`.
fn interruption(iteration: u32, kept: u32, seed: u64, folder: &Path) -> String {
    let of = if kept == iteration { String::new() } else { format!(" of iteration {kept}") };
    format!(
        "interrupted after iteration {iteration} of seed {seed}; {} has the checkpoint{of}, --resume continues",
        folder.display()
    )
}

/// Reward, errors and falls, for the progress bar.
fn state(metric: &Metric) -> String {
    let shown = |value: Option<f64>, unit: &str| match value {
        Some(value) => format!("{value:.1} {unit}"),
        None => format!("– {unit}"),
    };
    format!(
        "reward {:.3}  error {:.2} m/s {:.2} rad/s  episode {}  falls {}",
        metric.reward,
        metric.linear_velocity_error,
        metric.angular_velocity_error,
        shown(metric.episode_seconds, "s"),
        shown(metric.fall_rate.map(|share| 100.0 * share), "%")
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn an_interruption_names_an_older_checkpoint() {
        let text = |kept| interruption(55, kept, 1, Path::new("runs/a/seed-1"));
        assert_eq!(
            text(55),
            "interrupted after iteration 55 of seed 1; runs/a/seed-1 has the checkpoint, --resume continues"
        );
        assert!(text(40).contains("has the checkpoint of iteration 40, --resume"), "{}", text(40));
    }
}
