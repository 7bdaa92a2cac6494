//! Commands for a walking policy, chosen by what their logs can tell.

use super::design::choose;
use super::information::Information;
use super::look::{Look, interrupted, variance};
use super::playlist::Sequence;
use super::pool::Pool;
use gaitfit_adapt::cost::CostKind;
use gaitfit_adapt::fit::Sensitivity;
use gaitfit_adapt::{ParameterRule, RobotNumber, RobotRule, Theta};
use gaitfit_fit::adapt::{LogSet, Robot, identifies, known_values, simulated};
use gaitfit_fit::walk::walking::{Walking, rest_angles};
use gaitfit_model::patterns::covered;
use gaitfit_model::shown_number;
use gaitfit_random::{Purpose, Stream};
use gaitfit_run::machine;
use gaitfit_run::watch::Watch;
use gaitfit_settings::Error;
use gaitfit_settings::settings::{self, AdaptConfig, Base};
use serde::Serialize;
use std::num::NonZeroUsize;
use std::path::PathBuf;
use std::sync::Arc;

/// Min and max number of candidates.
const POOL: std::ops::RangeInclusive<usize> = 8..=10_000;
/// Max number of samples of all candidates together: a sample takes about a kilobyte, so these take 2 GB.
const MAX_ROWS: f64 = 2e6;
/// Number of random sets of sequences that the chosen ones are compared with.
const RANDOM_SETS: u32 = 200;
/// Number of rounds in which variants of the chosen sequences are tried, and the pool's size over that of a round.
const ROUNDS: u32 = 2;
const VARIANTS: usize = 4;
/// Largest `reach`.
const MAX_REACH: f64 = 10.0;

/// Settings of the choice of commands.
#[derive(Clone, Debug)]
pub struct CommandSettings {
    /// Configuration of the fit of walking logs: what is fitted, and how. Its logs, if it names any, are those that there
    /// are already.
    pub config: PathBuf,
    /// Changes of its settings.
    pub set: Vec<String>,
    /// The policy that walks.
    pub policy: PathBuf,
    /// Values of the parameters, a theta.toml; none: the configuration's truth, or the search's start.
    pub theta: Option<PathBuf>,
    /// Parameters whose spread is to be small: patterns over their names; none: those that the configuration's logs leave
    /// unidentified, or all.
    pub parameters: Vec<String>,
    /// Sequences to choose.
    pub trajectories: usize,
    /// Length of each, s.
    pub seconds: f64,
    /// Sequences to choose from at first; variants of the best are half as many more.
    pub pool: usize,
    /// Largest commands over the largest that the task draws.
    pub reach: f64,
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
    /// Candidates that were simulated.
    pub pool: usize,
    /// Number of candidates under which the robot fell, or whose simulation diverged.
    pub fell: usize,
    /// Length of the configuration's logs, s; absent if it names none.
    pub recorded_seconds: Option<f64>,
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

/// Expected standard deviations of a parameter.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct Expected {
    /// Name.
    pub name: String,
    /// Unit.
    pub unit: String,
    /// Whether its spread was to be small.
    pub counts: bool,
    /// Standard deviation with the configuration's logs alone; absent where they do not tell it, or there are none.
    pub recorded: Option<f64>,
    /// Deviation with these and commands as they are usually drawn; absent where they do not tell it.
    pub random: Option<f64>,
    /// Deviation with these and the chosen commands.
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
        } else if !(1.0..=MAX_REACH).contains(&self.reach) {
            format!("`reach` (--reach) is {}; give 1 to {MAX_REACH}", shown_number(self.reach))
        } else if !(self.torque_noise.is_finite() && (0.0..=1000.0).contains(&self.torque_noise)) {
            "`torque_noise` (--torque-noise) must be 0 to 1000 N·m".to_owned()
        } else {
            return Ok(());
        };
        Err(Error::settings(wrong))
    }
}

/// The configuration of the fit as it is used here, and its first cost if another one stands in for it.
fn configuration(settings: &CommandSettings) -> Result<(AdaptConfig, Option<CostKind>), Error> {
    let mut config: AdaptConfig = settings::load(Some(&settings.config), &settings.set)?;
    config.policy = Some(settings.policy.display().to_string());
    config.base = Base::Free;
    let stated = config.costs.first().copied();
    let distributions = stated.filter(|cost| *cost == CostKind::Wass);
    if distributions.is_some() {
        config.costs = vec![CostKind::MatchR(NonZeroUsize::MIN)];
        // Only distributions show torque noise: costs that compare samples cannot fit it.
        config.number.retain(|rule| rule.kind != RobotNumber::TorqueNoise);
    }
    config.parameter.iter_mut().for_each(ParameterRule::resolve);
    config.number.iter_mut().for_each(RobotRule::resolve);
    Ok((config, distributions))
}

/// Refuses more samples than fit in memory.
fn check_size(settings: &CommandSettings, control_dt: f64) -> Result<(), Error> {
    let rows = settings.pool as f64 * settings.seconds / control_dt;
    if rows > MAX_ROWS {
        return Err(Error::settings(format!(
            "`pool` (--pool) sequences of `seconds` (--seconds) have {rows:.0} samples together; at most {MAX_ROWS:.0} are \
             simulated: give fewer or shorter ones"
        )));
    }
    Ok(())
}

/// Results of the first walks.
struct FirstWalks {
    choice: Choice,
    /// Information of the sequences that are drawn as the task draws them.
    usual: Vec<Information>,
    /// Mean variance of these walks' residuals.
    variance: f64,
    /// The logs of these walks.
    logs: LogSet,
}

impl FirstWalks {
    /// Walks under sequences of `source`, the first half of which are drawn as the task draws them.
    fn new(
        settings: &CommandSettings,
        source: &Pool,
        look: &Look<'_>,
        watch: &Watch<'_>,
    ) -> Result<Self, Error> {
        // Half of the pool stands for the random commands that the chosen ones are compared with.
        let usual = settings.pool.div_ceil(2);
        let drawn = source.draw(settings.pool, usual);
        let logs = look.record(&drawn, 0, watch)?;
        let few = |fell: usize| {
            Error::failed(format!(
                "the policy falls under {fell} of {} command sequences in simulation, and too few are left; take a theta.toml \
                 nearer to the robot (--theta), or a policy that walks",
                settings.pool
            ))
        };
        // A sequence under which the robot falls tells nothing, and must not be sent to it.
        let fell = logs.iter().filter(|one| one.is_none()).count();
        let whole: Vec<_> = logs[..usual].iter().flatten().cloned().collect();
        if whole.len() < settings.trajectories || settings.pool - fell < 2 * settings.trajectories {
            return Err(few(fell));
        }
        // All sensitivities are scaled alike, by the usual walks, so that information of different walks can
        // be added.
        let whole = look.together(whole)?;
        let sensitivities = look.sensitivities(logs, &whole, watch)?;
        let usual: Vec<&Sensitivity> = sensitivities[..usual].iter().flatten().collect();
        let variances: f64 = usual.iter().map(|one| variance(one)).sum();
        let mut choice = Choice::default();
        choice.take(drawn, &sensitivities);
        let usual: Vec<Information> = usual.iter().map(|one| Information::new(one, variance(one))).collect();
        if usual.len() < settings.trajectories || choice.information.len() < 2 * settings.trajectories {
            return Err(few(choice.failed));
        }
        Ok(Self { variance: variances / usual.len() as f64, choice, usual, logs: whole })
    }
}

/// Expected deviations with all of `parts` beside what is known.
fn together<'a>(known: &Information, parts: impl Iterator<Item = &'a Information>) -> Vec<f64> {
    let mut sum = known.clone();
    parts.for_each(|one| sum.add(one, 1.0));
    sum.deviations()
}

/// Refuses sequences that say nothing of any entry `wanted`; `deviations` are those with all sequences.
fn check_identified(theta: &Theta, wanted: &[usize], deviations: &[f64]) -> Result<(), Error> {
    if wanted.iter().any(|&entry| deviations[entry].is_finite()) {
        return Ok(());
    }
    let names: Vec<&str> = wanted.iter().map(|&entry| theta.entries()[entry].name.as_str()).collect();
    Err(Error::failed(format!(
        "no command sequence identifies {}: the simulated walks are the same with all their values; check what they act on \
         (docs/fit.md), and give values near the robot's (--theta)",
        names.join(", ")
    )))
}

/// Geometric mean of the deviations `wanted`, chosen over usual ones, where both are finite; `notes` gain the others.
fn mean_ratio(
    theta: &Theta,
    wanted: &[usize],
    usual: &[f64],
    chosen: &[f64],
    notes: &mut Vec<String>,
) -> Option<f64> {
    let both = |entry: &usize| usual[*entry].is_finite() && chosen[*entry].is_finite();
    let (compared, apart): (Vec<usize>, Vec<usize>) = wanted.iter().partition(|entry| both(entry));
    notes.extend(apart.into_iter().map(|entry| {
        let which = match (usual[entry].is_finite(), chosen[entry].is_finite()) {
            (_, true) => "random commands may not identify it",
            (true, _) => "the chosen commands do not identify it",
            (false, false) => "no commands identify it here",
        };
        format!("`{}` is not in the mean: {which}", theta.entries()[entry].name)
    }));
    // Geometric: a ratio of 2 and one of 1/2 cancel out.
    let logs: f64 = compared.iter().map(|&entry| (chosen[entry] / usual[entry]).ln()).sum();
    (!compared.is_empty()).then(|| (logs / compared.len() as f64).exp())
}

/// Draws sequences as the task does, and slow, fast and changing ones, lets the policy walk under each in simulation, and
/// chooses those whose logs, with the configuration's own, tell the parameters best. Then it tries variants of them.
///
/// # Errors
/// Settings out of range; files that cannot be read or do not fit each other; a policy that falls under too many.
pub fn commands(settings: &CommandSettings, watch: &Watch<'_>) -> Result<Commands, Error> {
    settings.check()?;
    let (config, distributions) = configuration(settings)?;
    let threads = settings.threads.map_or_else(machine::threads, NonZeroUsize::get);
    // From here on everything is read and checked before the first walk is simulated.
    let Robot { model, policy, base, .. } = Robot::read(&config, &settings.config, None)?;
    let policy = policy.ok_or_else(|| Error::settings("`policy` names no policy"))?;
    if !policy.interface.observes_command() {
        return Err(Error::settings(
            "the policy observes no command, so no command changes what it does: collect logs of it as it is (`gaitfit collect`), or \
             excite the legs in the air (leave --policy out)",
        ));
    }
    let names: Vec<String> = model.joints.iter().map(|joint| joint.name.clone()).collect();
    let rest = rest_angles(&policy, &model)?;
    let config = config.by_kind(&model).map_err(Error::settings)?;
    let theta = config.rules().theta(&config.groups(&names), &names, &rest).map_err(Error::settings)?;
    let values = known_values(&config, &theta, settings.theta.as_deref())?;
    let asked = asked(&settings.parameters, &theta)?;
    // The replay that the fit compares logs with.
    let method = simulated(&config, Some(policy.clone()), model.clone(), &theta, &base, Some(threads))?;
    // The walking robot that makes the logs.
    let robot = Arc::new(Walking::robot(&config, policy, &model, &theta, &base, threads)?);
    check_size(settings, robot.task.walker.interface.control_dt)?;
    let command = robot.task.settings.command.clone();
    let source = Pool::new(&command, settings.reach, settings.seconds, settings.seed);
    let look = Look {
        config: &config,
        path: &settings.config,
        method: &method,
        robot,
        base: &base,
        theta: &theta,
        values: &values,
        seconds: settings.seconds,
        torque_noise: settings.torque_noise,
        seed: settings.seed,
    };

    let FirstWalks { mut choice, usual, variance, logs } = FirstWalks::new(settings, &source, &look, watch)?;
    let recorded = look.recorded(&logs, variance)?;
    let mut notes = gaitfit_settings::robot::remarks(&model);
    notes.extend(distributions.map(|cost| {
        format!(
            "the configuration's first cost, {cost}, compares distributions; the deviations are those of matchr1, which \
             compares samples. --set 'costs=[\"matchr2\"]' takes another"
        )
    }));
    let nothing = Information::nothing(theta.len());
    let known = recorded.as_ref().map_or(&nothing, |recorded| &recorded.information);
    // What the recorded logs identify already need not be excited again.
    let before = known.deviations();
    let wanted = match asked {
        Some(wanted) => wanted,
        None => unidentified(&theta, &before, recorded.is_some(), &mut notes),
    };
    check_identified(&theta, &wanted, &together(known, choice.information.iter()))?;
    let stop = || watch.stop();
    let mut chosen = choose(known, &choice.information, settings.trajectories, &wanted, &stop);
    // Each round tries variants of the best sequences so far and chooses anew from all.
    for round in 1..=ROUNDS {
        let best: Vec<&Sequence> = chosen.iter().map(|&one| &choice.sequences[one]).collect();
        // Numbers beyond those of earlier sequences, so that no two share their draws.
        let first = settings.pool * (1 + round as usize);
        let variants = source.variants(&best, first, settings.pool / VARIANTS);
        let sensitivities = look.sensitivities(look.record(&variants, round, watch)?, &logs, watch)?;
        choice.take(variants, &sensitivities);
        chosen = choose(known, &choice.information, settings.trajectories, &wanted, &stop);
    }
    if watch.stop() {
        return Err(interrupted());
    }

    let after = together(known, chosen.iter().map(|&one| &choice.information[one]));
    let usual = usual_spread(settings, known, &usual, theta.len());
    let ratio = mean_ratio(&theta, &wanted, &usual, &after, &mut notes);
    let finite = |value: f64| Some(value).filter(|value| value.is_finite());
    let parameters = theta.entries().iter().enumerate().map(|(at, entry)| Expected {
        name: entry.name.clone(),
        unit: entry.unit.clone(),
        counts: wanted.contains(&at),
        recorded: finite(before[at]),
        random: finite(usual[at]),
        chosen: finite(after[at]),
    });
    let parameters = parameters.collect();
    let recorded_seconds = recorded.as_ref().map(|recorded| recorded.seconds);
    notes.extend(recorded.into_iter().flat_map(|recorded| recorded.doubts));
    Ok(Commands {
        robot: model.name.clone(),
        pool: choice.sequences.len() + choice.failed,
        fell: choice.failed,
        recorded_seconds,
        parameters,
        ratio,
        notes,
        sequences: chosen.into_iter().map(|one| choice.sequences[one].clone()).collect(),
    })
}

/// Sequences under which the robot walks, with the information of each.
#[derive(Default)]
struct Choice {
    sequences: Vec<Sequence>,
    information: Vec<Information>,
    /// Sequences under which it falls, or whose simulation diverges.
    failed: usize,
}

impl Choice {
    fn take(&mut self, sequences: Vec<Sequence>, sensitivities: &[Option<Sensitivity>]) {
        for (sequence, sensitivity) in sequences.into_iter().zip(sensitivities) {
            match sensitivity {
                Some(sensitivity) => {
                    self.sequences.push(sequence);
                    self.information.push(Information::new(sensitivity, variance(sensitivity)));
                }
                None => self.failed += 1,
            }
        }
    }
}

/// Entries whose spread is to be small, where the settings name them.
fn asked(patterns: &[String], theta: &Theta) -> Result<Option<Vec<usize>>, Error> {
    if patterns.is_empty() {
        return Ok(None);
    }
    let names: Vec<&str> = theta.entries().iter().map(|entry| entry.name.as_str()).collect();
    let entries = covered(patterns, "the fit", &names);
    entries.map(Some).map_err(|error| Error::settings(format!("`parameters` (--parameters): {error}")))
}

/// Entries that logs with these deviations do not identify; all if there are no logs, or they identify all.
fn unidentified(theta: &Theta, deviation: &[f64], recorded: bool, notes: &mut Vec<String>) -> Vec<usize> {
    let entries = 0..theta.len();
    let left: Vec<usize> =
        entries.clone().filter(|&at| !identifies(&theta.entries()[at], deviation[at])).collect();
    if !left.is_empty() {
        return left;
    }
    if recorded {
        notes.push("the configuration's logs identify every parameter: all count".to_owned());
    }
    entries.collect()
}

/// Geometric mean of each parameter's deviation over random sets of the usual sequences, beside the logs `known`.
fn usual_spread(
    settings: &CommandSettings,
    known: &Information,
    random: &[Information],
    entries: usize,
) -> Vec<f64> {
    let mut logs = vec![0.0; entries];
    for set in 0..RANDOM_SETS {
        let draws = Stream::new(settings.seed, Purpose::BOOTSTRAP).environment(set);
        let mut sum = known.clone();
        for draw in 0..settings.trajectories as u32 {
            // With replacement, as in a bootstrap. The minimum below is for a draw that rounds up to 1.
            let at = (draws.uniform(draw) * random.len() as f64) as usize;
            sum.add(&random[at.min(random.len() - 1)], 1.0);
        }
        logs.iter_mut().zip(sum.deviations()).for_each(|(sum, own)| *sum += own.ln());
    }
    logs.into_iter().map(|sum| (sum / f64::from(RANDOM_SETS)).exp()).collect()
}
