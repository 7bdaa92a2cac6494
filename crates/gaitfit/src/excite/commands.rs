//! Commands for a walking policy, chosen by what their logs can tell.

use super::design::{choose, deviations};
use super::playlist::Sequence;
use crate::adapt::{LogSet, Method, Robot, known_values, simulated};
use crate::log::Log;
use crate::settings::{self, AdaptConfig, Base};
use crate::walk::recorder::Recorder;
use crate::walk::walking::Walking;
use crate::watch::{Watch, Work};
use crate::{Error, machine};
use gaitfit_adapt::Theta;
use gaitfit_adapt::fit::{Problem, Sensitivity, sensitivity};
use gaitfit_learn::task::Task;
use gaitfit_log::{Gains, Trajectory};
use gaitfit_model::patterns::covered;
use gaitfit_model::shown_number;
use gaitfit_random::{Purpose, Stream, derive_seed};
use gaitfit_sim::Candidate;
use nalgebra::DMatrix;
use serde::Serialize;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;

/// Fewest and most candidates.
const POOL: std::ops::RangeInclusive<usize> = 8..=10_000;
/// Most samples of all candidates together: a robot takes about a kilobyte each.
const MOST_ROWS: f64 = 2e6;
/// Sets of random sequences that the chosen ones are compared with.
const RANDOM_SETS: u32 = 200;
/// Times after which commands change: of the task, and shorter ones.
const QUICK: [f64; 2] = [1.0, 0.5];

/// What commands are for.
#[derive(Clone, Debug)]
pub struct CommandSettings {
    /// Configuration of the fit of walking logs: what is fitted, and how. Its logs are not read.
    pub config: PathBuf,
    /// Changes of its settings.
    pub set: Vec<String>,
    /// The policy that walks.
    pub policy: PathBuf,
    /// Values of the parameters, a theta.toml; none: the configuration's truth, or the search's start.
    pub theta: Option<PathBuf>,
    /// Parameters whose spread is to be small: patterns over their names; none: all.
    pub parameters: Vec<String>,
    /// Sequences to choose.
    pub trajectories: usize,
    /// Length of each, s.
    pub seconds: f64,
    /// Sequences to choose from.
    pub pool: usize,
    /// Standard deviation of random torques at every joint, N·m.
    pub torque_noise: f64,
    /// Seed of commands and noise.
    pub seed: u64,
    /// Threads.
    pub threads: Option<NonZeroUsize>,
}

/// Commands that were chosen.
#[derive(Clone, Debug, Serialize)]
pub struct Commands {
    /// The robot.
    pub robot: String,
    /// Candidates that were simulated, and how many of them fell.
    pub pool: usize,
    /// Those that fell.
    pub fell: usize,
    /// Expected standard deviations, one a parameter.
    pub parameters: Vec<Expected>,
    /// Geometric mean of the deviations that count, chosen over random, where both tell them; none where there is no such.
    pub ratio: Option<f64>,
    /// Things to know.
    pub notes: Vec<String>,
    /// The sequences.
    #[serde(skip)]
    pub sequences: Vec<Sequence>,
}

/// What to expect of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Expected {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Whether its spread was to be small.
    pub counts: bool,
    /// Standard deviation with commands as they are usually drawn; absent where they do not tell it.
    pub random: Option<f64>,
    /// With the chosen commands.
    pub chosen: Option<f64>,
}

impl CommandSettings {
    fn check(&self) -> Result<(), Error> {
        let wrong = if !(self.seconds.is_finite() && (1.0..=600.0).contains(&self.seconds)) {
            format!("`seconds` (--seconds) is {}; a sequence takes 1 to 600 s", shown_number(self.seconds))
        } else if !POOL.contains(&self.pool) {
            format!("`pool` (--pool) is {}; give {} to {}", self.pool, POOL.start(), POOL.end())
        } else if self.trajectories == 0 || 2 * self.trajectories > self.pool {
            format!(
                "`trajectories` (--trajectories) is {}; give 1 to half of the pool, {} (--pool)",
                self.trajectories,
                self.pool / 2
            )
        } else if !(self.torque_noise.is_finite() && (0.0..=1000.0).contains(&self.torque_noise)) {
            "`torque_noise` (--torque-noise) must be 0 to 1000 N·m".to_owned()
        } else {
            return Ok(());
        };
        Err(Error::settings(wrong))
    }
}

/// Draws sequences as the task does, some that change sooner and some at the ends of its ranges, lets the policy walk
/// under each in simulation, and chooses those whose logs together tell the parameters best.
///
/// # Errors
/// Settings out of range; files that cannot be read or do not fit each other; a policy that falls under too many.
pub fn commands(settings: &CommandSettings, watch: &Watch<'_>) -> Result<Commands, Error> {
    settings.check()?;
    let mut config: AdaptConfig = settings::load(Some(&settings.config), &settings.set)?;
    config.policy = Some(settings.policy.display().to_string());
    config.base = Base::Free;
    config.parameter.iter_mut().for_each(gaitfit_adapt::ParameterRule::resolve);
    config.number.iter_mut().for_each(gaitfit_adapt::RobotRule::resolve);
    let threads = settings.threads.map_or_else(machine::threads, NonZeroUsize::get);
    let Robot { model, policy, base, .. } = Robot::read(&config, &settings.config, None)?;
    let policy = policy.ok_or_else(|| Error::settings("`policy` names no policy"))?;
    let names: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
    let rest = crate::walk::walking::rest_angles(&policy, &model)?;
    let theta = config.rules().theta(&config.groups(), &names, &rest).map_err(Error::settings)?;
    let values = known_values(&config, &theta, settings.theta.as_deref())?;
    let of = counted(&settings.parameters, &theta)?;
    let method = simulated(&config, Some(policy.clone()), model.clone(), &theta, &base, Some(threads))?;
    let robot = Arc::new(Walking::robot(&config, policy, &model, &theta, &base, threads)?);
    let rows = settings.pool as f64 * settings.seconds / robot.task.walker.interface.control_dt;
    if rows > MOST_ROWS {
        return Err(Error::settings(format!(
            "`pool` (--pool) sequences of `seconds` (--seconds) have {rows:.0} samples together; at most {MOST_ROWS:.0} are \
             simulated: give fewer or shorter ones"
        )));
    }
    let pool = pool(settings, &robot.task);
    let look =
        Look { settings, config: &config, method: &method, base: &base, theta: &theta, values: &values };
    let mut found = look.informations(&robot, &pool, watch)?;
    let fell = found.iter().filter(|one| one.is_none()).count();
    let usual = settings.pool.div_ceil(2);
    let random: Vec<DMatrix<f64>> = found[..usual].iter().flatten().cloned().collect();
    let (places, stood): (Vec<usize>, Vec<DMatrix<f64>>) =
        found.iter_mut().enumerate().filter_map(|(at, one)| Some((at, one.take()?))).unzip();
    if random.len() < settings.trajectories || stood.len() < 2 * settings.trajectories {
        return Err(Error::failed(format!(
            "the policy falls under {fell} of {} command sequences in simulation, and too few are left; take a theta.toml \
             nearer to the robot (--theta), or a policy that walks",
            settings.pool
        )));
    }
    let together = |places: &mut dyn Iterator<Item = usize>| {
        places.fold(DMatrix::zeros(theta.len(), theta.len()), |sum, one| sum + &stood[one])
    };
    let told = deviations(&together(&mut (0..stood.len())));
    if !of.iter().any(|&entry| told[entry].is_finite()) {
        let names: Vec<&str> = of.iter().map(|&entry| theta.entries()[entry].name.as_str()).collect();
        return Err(Error::failed(format!(
            "no command sequence tells {}: the simulated walks are the same whatever the values; look at what they act on \
             (docs/loop.md), and give values near the robot's (--theta)",
            names.join(", ")
        )));
    }
    let chosen = choose(&stood, settings.trajectories, &of, &|| watch.stop());
    if watch.stop() {
        return Err(interrupted());
    }
    let deviation = deviations(&together(&mut chosen.iter().copied()));
    let usual = usual_spread(settings, &random, theta.len());
    let finite = |value: f64| Some(value).filter(|value| value.is_finite());
    let both = |entry: &usize| usual[*entry].is_finite() && deviation[*entry].is_finite();
    let (compared, apart): (Vec<usize>, Vec<usize>) = of.iter().partition(|entry| both(entry));
    let mut notes = crate::robot::remarks(&model);
    notes.extend(apart.into_iter().map(|entry| {
        let which = match (usual[entry].is_finite(), deviation[entry].is_finite()) {
            (_, true) => "random commands may not tell it",
            (true, _) => "the chosen commands do not tell it",
            (false, false) => "no commands tell it here",
        };
        format!("`{}` is not in the mean: {which}", theta.entries()[entry].name)
    }));
    let logs: f64 = compared.iter().map(|&entry| (deviation[entry] / usual[entry]).ln()).sum();
    let parameters = theta.entries().iter().enumerate().map(|(at, entry)| Expected {
        name: entry.name.clone(),
        unit: entry.unit.clone(),
        counts: of.contains(&at),
        random: finite(usual[at]),
        chosen: finite(deviation[at]),
    });
    Ok(Commands {
        robot: model.name.clone(),
        pool: settings.pool,
        fell,
        parameters: parameters.collect(),
        ratio: (!compared.is_empty()).then(|| (logs / compared.len() as f64).exp()),
        notes,
        sequences: chosen.into_iter().map(|one| pool[places[one]].clone()).collect(),
    })
}

/// Entries whose spread is to be small.
fn counted(patterns: &[String], theta: &Theta) -> Result<Vec<usize>, Error> {
    let names: Vec<&str> = theta.entries().iter().map(|entry| entry.name.as_str()).collect();
    match patterns {
        [] => Ok((0..names.len()).collect()),
        patterns => covered(patterns, "the fit", &names)
            .map_err(|error| Error::settings(format!("`parameters` (--parameters): {error}"))),
    }
}

/// Candidates: the first half as the task draws them, then those that change sooner, then those at the ends of the ranges.
fn pool(settings: &CommandSettings, task: &Task) -> Vec<Sequence> {
    let command = &task.settings.command;
    let ranges = [command.x, command.y, command.yaw];
    let usual = settings.pool.div_ceil(2);
    let quick = settings.pool / 4;
    let one = |number: usize| {
        let period = match number {
            number if number < usual => command.seconds,
            number if number < usual + quick => QUICK[number % QUICK.len()],
            _ => command.seconds,
        };
        let ends = number >= usual + quick;
        let stream = Stream::new(settings.seed, Purpose::EXCITATION).environment(number as u32);
        let steps = (settings.seconds / period - 1e-9).ceil().max(1.0) as u32;
        let drawn = |step: u32| {
            let draw = |k: usize| stream.step(2 + step).uniform(k as u32);
            let within = |[low, high]: [f64; 2], part: f64| low + (high - low) * part;
            let end = |part: f64| {
                if part < 1.0 / 3.0 {
                    0.0
                } else if part < 2.0 / 3.0 {
                    0.5
                } else {
                    1.0
                }
            };
            let part = |k: usize| if ends { end(draw(k)) } else { draw(k) };
            let stands = !ends && draw(3) < command.standing;
            let value = std::array::from_fn(|k| if stands { 0.0 } else { within(ranges[k], part(k)) });
            (f64::from(step) * period, value)
        };
        Sequence { steps: (0..steps).map(drawn).collect() }
    };
    (0..settings.pool).map(one).collect()
}

/// That the watch stopped it.
fn interrupted() -> Error {
    Error::Interrupted { message: "interrupted; nothing was written".to_owned(), kept: None }
}

/// Geometric mean of each parameter's deviation over random sets of the usual sequences.
fn usual_spread(settings: &CommandSettings, random: &[DMatrix<f64>], entries: usize) -> Vec<f64> {
    let mut logs = vec![0.0; entries];
    for set in 0..RANDOM_SETS {
        let draws = Stream::new(settings.seed, Purpose::BOOTSTRAP).environment(set);
        let mut sum = DMatrix::zeros(entries, entries);
        for draw in 0..settings.trajectories as u32 {
            let at = (draws.uniform(draw) * random.len() as f64) as usize;
            sum += &random[at.min(random.len() - 1)];
        }
        logs.iter_mut().zip(deviations(&sum)).for_each(|(sum, own)| *sum += own.ln());
    }
    logs.into_iter().map(|sum| (sum / f64::from(RANDOM_SETS)).exp()).collect()
}

/// What sequences tell, one by one.
struct Look<'a> {
    settings: &'a CommandSettings,
    config: &'a AdaptConfig,
    method: &'a Method,
    base: &'a Candidate,
    theta: &'a Theta,
    values: &'a [f64],
}

impl Look<'_> {
    /// The information of the log of each sequence; none where the robot falls.
    fn informations(
        &self,
        robot: &Arc<Walking>,
        pool: &[Sequence],
        watch: &Watch<'_>,
    ) -> Result<Vec<Option<DMatrix<f64>>>, Error> {
        let templates: Vec<Trajectory> = pool.iter().map(|one| self.template(&robot.task, one)).collect();
        let recorder =
            Recorder::new(Arc::clone(robot), self.base.clone(), &templates.iter().collect::<Vec<_>>());
        let seed = derive_seed(self.settings.seed, Purpose::TORQUE_NOISE, 0);
        let stop = || watch.stop();
        let recorded =
            recorder.record(self.theta, self.values, self.settings.torque_noise, &[seed], &stop)?.pop();
        if watch.stop() {
            return Err(interrupted());
        }
        let what = "what command sequences tell";
        let counting = watch.begin(Work { what, total: pool.len(), first: 0, parts: "sequences" });
        let mut found = Vec::with_capacity(pool.len());
        for (number, (template, made)) in templates.iter().zip(recorded.unwrap_or_default()).enumerate() {
            if watch.stop() {
                return Err(interrupted());
            }
            found.push(match made.fell_at {
                Some(_) => None,
                None => self.information(made.instead_of(template))?,
            });
            counting.step(number + 1, 1, "");
        }
        Ok(found)
    }

    /// A log of the commands, with a robot that stands.
    fn template(&self, task: &Task, sequence: &Sequence) -> Trajectory {
        let interface = &task.walker.interface;
        let (dt, joints) = (interface.control_dt, interface.joints.len());
        let samples = (self.settings.seconds / dt).round().max(2.0) as usize;
        Trajectory {
            source: None,
            robot: Some(task.walker.model().name.clone()),
            joints: self.method.joints(),
            time: (0..samples).map(|sample| sample as f64 * dt).collect(),
            rate_hz: 1.0 / dt,
            position: interface.default_pose.repeat(samples),
            velocity: vec![0.0; samples * joints],
            target: None,
            action: None,
            command: Some((0..samples).flat_map(|sample| sequence.at(sample as f64 * dt)).collect()),
            base: None,
            gains: Some(Gains { kp: interface.kp.clone(), kd: interface.kd.clone() }),
            fell: false,
        }
    }

    /// The information of a log; none if the simulation diverges.
    fn information(&self, trajectory: Trajectory) -> Result<Option<DMatrix<f64>>, Error> {
        let log = Log {
            name: "a simulated log".to_owned(),
            path: "a simulated log".into(),
            sidecars: Vec::new(),
            joints: trajectory.joints.clone(),
            trajectory,
        };
        let set = LogSet::new(self.config, self.method, self.base, vec![log])?;
        let costs = set.costs(self.config)?;
        let cost = costs.first().ok_or_else(|| Error::settings("`costs` names no cost"))?.as_ref();
        let (simulator, theta) = (set.simulator.as_ref(), self.theta);
        let problem = Problem { simulator, theta, cost, draw: 0, cancel: &gaitfit_adapt::never };
        let found = sensitivity(problem, self.values, None).map_err(Error::failed)?;
        Ok(found.as_ref().map(information))
    }
}

/// The inverse of the covariance that was found; 0 for what a log does not tell.
fn information(found: &Sensitivity) -> DMatrix<f64> {
    let told: Vec<(usize, f64)> =
        found.deviation.iter().enumerate().filter_map(|(at, own)| Some((at, (*own)?))).collect();
    let mut all = DMatrix::zeros(found.deviation.len(), found.deviation.len());
    let correlation = DMatrix::from_fn(told.len(), told.len(), |i, j| {
        if i == j { 1.0 } else { found.correlation[told[i].0][told[j].0] }
    });
    if let Some(inverse) = correlation.cholesky().map(|solved| solved.inverse()) {
        for (i, (row, own)) in told.iter().enumerate() {
            for (j, (column, other)) in told.iter().enumerate() {
                all[(*row, *column)] = inverse[(i, j)] / (own * other);
            }
        }
    }
    all
}
