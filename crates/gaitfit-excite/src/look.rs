//! How well logs identify the parameters: logs of command sequences, by walks in simulation, and recorded logs.

use super::information::Information;
use super::playlist::Sequence;
use gaitfit_adapt::Theta;
use gaitfit_adapt::fit::{Problem, Sensitivity, sensitivity};
use gaitfit_fit::adapt::{LogSet, Method};
use gaitfit_fit::log::Log;
use gaitfit_fit::walk::logs::{Purpose as Use, read};
use gaitfit_fit::walk::recorder::{NoisyRobot, Recorded, Recorder};
use gaitfit_fit::walk::walking::Walking;
use gaitfit_log::{Gains, Trajectory};
use gaitfit_random::{Purpose, derive_seed};
use gaitfit_run::watch::{Watch, Work};
use gaitfit_settings::Error;
use gaitfit_settings::settings::AdaptConfig;
use gaitfit_sim::Candidate;
use std::path::Path;
use std::sync::Arc;

/// How a fit looks at logs, and the robot that makes them.
pub(super) struct Look<'a> {
    pub config: &'a AdaptConfig,
    pub path: &'a Path,
    pub method: &'a Method,
    pub robot: Arc<Walking>,
    pub base: &'a Candidate,
    pub theta: &'a Theta,
    /// The values at which it looks, one an entry of θ.
    pub values: &'a [f64],
    /// Length of a sequence, s.
    pub seconds: f64,
    /// Standard deviation of random torques, N·m.
    pub torque_noise: f64,
    pub seed: u64,
}

impl Look<'_> {
    /// Logs of sequences; none where the robot falls. `round` tells noise of several calls apart.
    pub fn record(
        &self,
        pool: &[Sequence],
        round: u32,
        watch: &Watch<'_>,
    ) -> Result<Vec<Option<Log>>, Error> {
        let templates: Vec<Trajectory> = pool.iter().map(|one| self.template(one)).collect();
        let walks: Vec<&Trajectory> = templates.iter().collect();
        let recorder = Recorder::new(Arc::clone(&self.robot), self.base.clone(), &walks);
        let robot = NoisyRobot {
            values: self.values.to_vec(),
            noise: self.torque_noise,
            seed: derive_seed(self.seed, Purpose::TORQUE_NOISE, round),
        };
        let made = recorder.record(self.theta, &[robot], &|| watch.stop())?.pop();
        // An interrupted recording has fewer logs than sequences.
        if watch.stop() {
            return Err(interrupted());
        }
        let log = |trajectory: Trajectory| Log {
            name: "a simulated log".to_owned(),
            path: "a simulated log".into(),
            sidecars: Vec::new(),
            joints: trajectory.joints.clone(),
            trajectory,
            mounting: None,
            filled: Vec::new(),
        };
        let one = |(template, made): (&Trajectory, Recorded)| {
            made.fell_at.is_none().then(|| log(made.instead_of(template)))
        };
        Ok(templates.iter().zip(made.unwrap_or_default()).map(one).collect())
    }

    /// Logs as one set, which gives others their scaling.
    pub fn together(&self, logs: Vec<Log>) -> Result<LogSet, Error> {
        LogSet::new(self.config, self.method, self.base, logs)
    }

    /// The sensitivity of each log, in the scaling of `whole`; `None` where there is no log or its simulation diverges.
    pub fn sensitivities(
        &self,
        logs: Vec<Option<Log>>,
        whole: &LogSet,
        watch: &Watch<'_>,
    ) -> Result<Vec<Option<Sensitivity>>, Error> {
        let what = "identification by command sequences";
        let counting =
            watch.begin(Work { what, total: logs.len(), first: 0, parts: "sequences", seed: None });
        let mut sensitivities = Vec::with_capacity(logs.len());
        for (number, log) in logs.into_iter().enumerate() {
            if watch.stop() {
                return Err(interrupted());
            }
            sensitivities.push(match log {
                Some(log) => self.sensitivity(vec![log], whole)?,
                None => None,
            });
            counting.step(number + 1, 1, "");
        }
        Ok(sensitivities)
    }

    /// What the configuration's logs tell, if it names any, in the scaling of `whole`. `variance`:
    /// that of differences of simulated logs. The recorded ones are taken to be as hard to predict: what they differ by
    /// holds what these values lack of the robot's, which a fit takes away.
    pub fn recorded(&self, whole: &LogSet, variance: f64) -> Result<Option<OnRecord>, Error> {
        if self.config.logs.is_empty() {
            return Ok(None);
        }
        let (policy, task) = (&self.robot.policy, &self.robot.task);
        let notes = read(&self.config.logs, Use::Validation, self.config, self.path, policy, task)?;
        let seconds = notes.logs.iter().map(|log| log.trajectory.duration()).sum();
        let sensitivity = self.sensitivity(notes.logs, whole)?.ok_or_else(|| {
            Error::failed(
                "the simulation diverges on the given logs: give a theta.toml near the robot (--theta)",
            )
        })?;
        Ok(Some(OnRecord {
            information: Information::new(&sensitivity, variance),
            seconds,
            doubts: notes.warnings,
        }))
    }

    fn sensitivity(&self, logs: Vec<Log>, whole: &LogSet) -> Result<Option<Sensitivity>, Error> {
        let set = self.together(logs)?.scaled_as(whole);
        let costs = set.costs(self.config)?;
        let cost = costs.first().ok_or_else(|| Error::settings("`costs` names no cost"))?.as_ref();
        let (simulator, theta) = (set.simulator.as_ref(), self.theta);
        let problem = Problem { simulator, theta, cost, draw: 0, cancel: &gaitfit_adapt::never };
        sensitivity(problem, self.values, None).map_err(Error::failed)
    }

    /// A log of the commands, with a robot that stands.
    fn template(&self, sequence: &Sequence) -> Trajectory {
        let walker = &self.robot.task.walker;
        let interface = &walker.interface;
        let (dt, joints) = (interface.control_dt, interface.joints.len());
        // A log needs two samples.
        let samples = (self.seconds / dt).round().max(2.0) as usize;
        Trajectory {
            source: None,
            robot: Some(walker.model().name.clone()),
            joints: self.method.joints(),
            time: (0..samples).map(|sample| sample as f64 * dt).collect(),
            rate_hz: 1.0 / dt,
            position: interface.default_pose.repeat(samples),
            velocity: vec![0.0; samples * joints],
            target: None,
            action: None,
            command: Some((0..samples).flat_map(|sample| sequence.at(sample as f64 * dt)).collect()),
            motion: None,
            base: None,
            gains: Some(Gains { kp: interface.kp.clone(), kd: interface.kd.clone() }),
            lead: None,
            simulated_step: None,
            velocity_joints: Vec::new(),
            fell: false,
        }
    }
}

/// Logs that there are already.
pub(super) struct OnRecord {
    /// Their information about the parameters.
    pub information: Information,
    /// Their length, s.
    pub seconds: f64,
    /// Doubts about them, each one sentence.
    pub doubts: Vec<String>,
}

/// Variance of what a log's differences put into a fit.
pub(super) fn variance(sensitivity: &Sensitivity) -> f64 {
    sensitivity.difference * sensitivity.difference * sensitivity.together
}

/// The error of a run that the watch stopped.
pub(super) fn interrupted() -> Error {
    Error::interrupted_with_nothing("interrupted; nothing was written")
}
