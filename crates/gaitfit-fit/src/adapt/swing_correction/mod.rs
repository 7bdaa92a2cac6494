//! Estimates from legs in the air, corrected by simulated walks.
//!
//! Torque noise moves a joint in its own direction, so friction seems smaller and damping larger. Readings at 50 Hz also miss
//! when a slow joint reverses. So robots with drawn values walk in the simulator under the logs' commands, and the same
//! estimator runs on their logs. A regression learns how estimates depend on true values (indirect inference: Gourieroux,
//! Monfort and Renault 1993).

mod comparison;
mod noise;
mod numbers;
mod response;

use super::replicas::WALKED;
use crate::Error;
use crate::device::Gpu;
use crate::log::Log;
use crate::settings::AdaptConfig;
use crate::walk::explain::{self, Cause, CauseKind};
use crate::walk::recorder::{NoisyRobot, Recorded, Recorder};
use crate::walk::singles::{with_springs, with_strengths};
use crate::walk::swing::{Effect, Estimate, SwingFindings, SwingReport, SwingSettings};
use crate::walk::walking::Walking;
use crate::watch::{Counting, Watch, Work};
use gaitfit_adapt::Theta;
use gaitfit_log::{Gains, Trajectory};
use gaitfit_model::Model;
use gaitfit_policy::Policy;
use gaitfit_random::{Purpose, Stream, derive_seed};
use gaitfit_sim::{Candidate, pool};
use noise::Noise;
use numbers::{errors_of, groups_of, kinds, numbers_of, slots, theta_of, values_of};
use response::{Answer, Response};
use std::sync::atomic::{AtomicUsize, Ordering};
use std::sync::{Arc, Mutex, PoisonError};

/// Rounds of simulated robots, each around the values of the last one.
const ROUNDS: usize = 2;
/// Robots before the first round. Their logs show how much torque noise the real robot has.
const FIRST_ROBOTS: usize = 2;
/// Min robots of a round; and how many more robots than numbers of each.
const ROBOTS: usize = 14;
const MORE_ROBOTS: usize = 3;
/// Half the width of a round, in standard errors.
const WIDTH: f64 = 2.0;
/// Min standard errors for that width: friction, N·m; damping, N·m·s/rad; armature, kg·m²; delay, s.
const MIN_ERRORS: [f64; 4] = [0.02, 0.01, 5e-4, 4e-4];
/// Torque noise of the first robot that has some, N·m.
const NOISE: f64 = 0.5;
/// Physics step of the simulated robots if nothing states the real one's, s: the usual period of motor boards.
const STEP_S: f64 = 1e-3;
/// This part of a correction is added to its error as a standard deviation.
const DOUBT: f64 = 0.3;
/// Max standard error of a corrected value, in half widths of a round.
const MAX_ERROR: f64 = 1.0;
/// Why there is no correction.
const ALIKE: &str = "too few simulated robots walk, or their estimates hardly depend on their values";
/// Effects that simulated joints lack. On a real robot they look like torque noise.
const LACKING: [CauseKind; 2] = [CauseKind::Elasticity, CauseKind::Backlash];
/// Part of a log before a fall that does not count, s.
const BEFORE_FALL_S: f64 = 0.3;
/// Logs that each robot simulates: the first ones, until they last this long together, s.
const SIMULATED_S: f64 = 60.0;

/// The robot of a fit.
pub struct Robot<'a> {
    /// The fit's settings.
    pub config: &'a AdaptConfig,
    /// The policy that walked.
    pub policy: &'a Policy,
    /// The model.
    pub model: &'a Model,
    /// The robot that the fit changes.
    pub base: &'a Candidate,
    /// Threads.
    pub threads: usize,
    /// GPUs that make the logs of simulated robots. Without a GPU the CPU makes them.
    pub gpus: Vec<Gpu>,
}

/// Corrects the estimates from legs in the air in `findings`, which come from `logs`. Stores the corrected ones there, or the
/// reason why there are none. Adds to its effects what simulated robots without them show.
///
/// # Errors
/// An interruption.
pub fn correct(
    findings: &mut SwingFindings,
    robot: &Robot<'_>,
    logs: &[Log],
    watch: &Watch<'_>,
) -> Result<(), Error> {
    let Some(report) = &findings.swings else { return Ok(()) };
    let singles: Vec<Effect> = findings.singles().cloned().collect();
    // Real logs are measured once, at the policy's rate, as those of simulated robots are.
    let (corrected, compared) = match robot.world(logs, report, &singles, watch) {
        Ok((world, real)) => (world.corrected(report, &real.0), world.compared(real.1)),
        Err(why) => (Err(why), Vec::new()),
    };
    // An interruption also looks like a correction without a result, so it is asked for first.
    if watch.stop() {
        return Err(Error::interrupted_with_nothing("interrupted before the fit began"));
    }
    let is_compared = !compared.is_empty();
    for effect in compared {
        if let Some(slot) = findings.effects.iter_mut().find(|other| other.is_same(&effect)) {
            *slot = effect;
        }
    }
    let of_joints = |cause: &Cause| LACKING.contains(&cause.kind);
    // The order matters: if not even a comparison was possible, that is the reason to give. An effect that
    // simulated joints lack makes the corrected numbers wrong, so it comes before them.
    match (explain::causes(findings).into_iter().find(of_joints), corrected) {
        (_, Err(why)) if !is_compared => findings.not_corrected = Some(why),
        (Some(cause), _) => {
            findings.not_corrected = Some(format!("simulated joints lack this effect: {}", cause.text));
        }
        (None, Ok(report)) => findings.corrected = Some(report),
        (None, Err(why)) => findings.not_corrected = Some(why),
    }
    Ok(())
}

/// Estimates and effects that the logs of one robot show.
type Shown = (SwingReport, Vec<Effect>);

/// The simulated robots, and the settings with which their logs are estimated.
struct World<'a> {
    robot: &'a Robot<'a>,
    recorder: Recorder,
    theta: Theta,
    settings: SwingSettings,
    /// The joint groups of the real robot's estimates.
    groups: Vec<String>,
    /// The logs, of which only the length and the commands count.
    logs: Vec<Trajectory>,
    watch: &'a Watch<'a>,
    counting: Counting<'a>,
    /// Robots that were simulated.
    done: AtomicUsize,
    /// The effects that each robot of the latest round shows.
    effects_shown: Mutex<Vec<Vec<Effect>>>,
}

impl Robot<'_> {
    /// Robots like that of `report` for simulation under the commands of `logs`, and what the real logs show at the policy's
    /// rate. `singles`: springs and strengths of single joints of the real robot, which simulated ones do not have.
    ///
    /// # Errors
    /// Why there are none.
    fn world<'a>(
        &'a self,
        logs: &[Log],
        report: &SwingReport,
        singles: &[Effect],
        watch: &'a Watch<'a>,
    ) -> Result<(World<'a>, Shown), String> {
        // Simulated logs are shorter than real ones, so they may have more windows for their time. This does not shift estimates.
        // Choices of the real estimate are fixed, so that all simulated logs are treated alike.
        let settings = SwingSettings {
            clearances_m: vec![report.clearance_m],
            law: Some(report.law),
            bounded: false,
            others: false,
            threads: self.threads,
            ..SwingSettings::default()
        };
        let interface = &self.policy.interface;
        let gains = Gains { kp: interface.kp.clone(), kd: interface.kd.clone() };
        let rows = |log: &Log| {
            // Simulated logs have no lead, so it is taken away from both sides.
            let mut rows = Trajectory { lead: None, ..log.trajectory.clone() };
            rows.gains.get_or_insert_with(|| gains.clone());
            rows
        };
        let with_gains: Vec<Trajectory> = logs.iter().map(rows).collect();
        // Oddities of single joints are taken out of the real logs, because simulated robots do not have them.
        let real = with_strengths(&with_gains.iter().collect::<Vec<_>>(), singles);
        let (real, effects) = shown(&with_springs(self.model, singles), &real, &settings, true)?;
        // The regression compares numbers in order, so both must have the same groups.
        if !groups_of(&real).eq(groups_of(report)) {
            return Err("other joints swing at the policy's rate than at that of the logs".to_owned());
        }
        // From here the simulated robots: their parameters are the numbers that the real report has.
        let theta = theta_of(&real, self.model).map_err(|error| error.to_string())?;
        let mut config = self.config.clone();
        config.simulation.robot_timestep.get_or_insert(STEP_S);
        let walking =
            Walking::robot(&config, self.policy.clone(), self.model, &theta, self.base, self.threads)
                .map_err(|error| error.to_string())?;
        let walking = Walking { gpus: self.gpus.clone(), ..walking };
        let mut left = SIMULATED_S;
        // Logs are taken until their time is enough.
        let short = |log: &Trajectory| {
            let first = left > 0.0;
            left -= log.duration();
            first.then(|| log.clone())
        };
        let logs: Vec<Trajectory> = with_gains.iter().map_while(short).collect();
        let recorder = Recorder::new(Arc::new(walking), self.base.clone(), &logs.iter().collect::<Vec<_>>());
        let groups = groups_of(&real).map(str::to_owned).collect();
        // Both rounds are counted. The second is left out where torque noise cannot explain the logs.
        let counting = watch.begin(Work {
            what: "legs in the air, simulated robot",
            total: FIRST_ROBOTS + ROUNDS * robots_for(numbers_of(&real)),
            first: 0,
            parts: "robots",
            seed: None,
        });
        let (done, effects_shown) = (AtomicUsize::new(0), Mutex::new(Vec::new()));
        let world = World {
            robot: self,
            recorder,
            theta,
            settings,
            groups,
            logs,
            watch,
            counting,
            done,
            effects_shown,
        };
        Ok((world, (real, effects)))
    }
}

impl World<'_> {
    /// `report`, whose estimates at the policy's rate are `real`, corrected.
    ///
    /// # Errors
    /// Why there is no correction.
    fn corrected(&self, report: &SwingReport, real: &SwingReport) -> Result<SwingReport, String> {
        let estimates = self.correct(real)?;
        let mut corrected = report.clone();
        for (slot, Estimate { value, error }) in slots(&mut corrected).zip(estimates) {
            // The recorded logs show how much other choices of swings change an estimate.
            *slot = Estimate { value, error: error.hypot(slot.error) };
        }
        Ok(corrected)
    }

    /// The corrected estimates, in the order of [`values_of`].
    fn correct(&self, real: &SwingReport) -> Result<Vec<Estimate>, String> {
        let (uncorrected, errors) = (values_of(real), errors_of(real));
        let Noise { variance: noise, slope, group, too_large } = self.noise(real, &uncorrected)?;
        // The region from which robots are drawn: a few errors of the estimates to each side.
        let mut half: Vec<f64> = errors
            .iter()
            .zip(kinds(uncorrected.len()))
            .map(|(error, kind)| WIDTH * error.max(MIN_ERRORS[kind]))
            .collect();
        // The last number is the noise. Its region must not shrink to 0 where the real robot shows no noise.
        half.push((0.5 * noise).max(0.2 * NOISE * NOISE));
        // The estimates, and the residual in units of the noise's variance.
        // The residual is one more observation, which shows the noise.
        let with_residual = |report: &SwingReport| {
            let mut estimates = values_of(report);
            estimates.push(report.groups[group].residual.powi(2) / slope);
            estimates
        };
        let observed = with_residual(real);
        let mut centre = uncorrected;
        centre.push(noise);
        let least: Vec<f64> = self.least(centre.len()).collect();
        // The region must not reach to values that no robot can have.
        centre.iter_mut().zip(&least).for_each(|(centre, least)| *centre = centre.max(*least));
        let mut response = Response::default();
        let mut answer = None;
        // If torque noise cannot explain the logs, there is no correction. One round is enough for the comparison.
        let rounds = if too_large.is_some() { 1 } else { ROUNDS };
        // Each round draws robots around the centre, lets them walk, and asks which values give the real
        // estimates.
        for round in 0..rounds {
            // Numbers of robots continue from round to round, so that no two have the same draws.
            let first = FIRST_ROBOTS + round * robots_for(centre.len());
            let robots = self.draw(&centre, &half, first);
            self.effects_shown.lock().unwrap_or_else(PoisonError::into_inner).clear();
            let reports = self.observe(&robots, first, true)?;
            if let Some(why) = &too_large {
                return Err(why.clone());
            }
            for (robot, report) in robots.into_iter().zip(reports) {
                // A robot that falls teaches nothing.
                let Some(report) = report else { continue };
                response.estimates.push(with_residual(&report));
                response.values.push(robot);
            }
            let corrected = response.answer(&observed, &half).ok_or(ALIKE)?;
            for (((centre, value), half), least) in
                centre.iter_mut().zip(&corrected.values).zip(&half).zip(&least)
            {
                // Beyond what was drawn the regression is a guess: the next round looks there.
                *centre = value.clamp(*centre - 2.0 * half, *centre + 2.0 * half).max(*least);
            }
            answer = Some(corrected);
        }
        let Answer { values, errors } = answer.ok_or(ALIKE)?;
        // Errors as large as the region that was drawn: the estimates hardly answer to the values.
        // `half` is the same in all rounds, so it measures the region of the last one.
        if errors.iter().zip(&half).any(|(error, half)| *error > MAX_ERROR * half) {
            return Err(ALIKE.to_owned());
        }
        // Friction, damping and armature are not below 0. A delay below 0 counts as an error of at least that size later.
        // A delay may be negative where targets act before their row.
        let kinds = kinds(values.len() - 1);
        let bounded =
            values.iter().zip(kinds).map(|(value, kind)| if kind < 3 { value.max(0.0) } else { *value });
        let moved = values.iter().zip(values_of(real)).map(|(value, before)| DOUBT * (value - before));
        let errors = errors.iter().zip(moved).map(|(error, moved)| error.hypot(moved));
        Ok(bounded.zip(errors).map(|(value, error)| Estimate { value, error }).collect())
    }

    /// Robots around `centre` that can exist: no number is below 0, and no target acts before it is sent.
    fn draw(&self, centre: &[f64], half: &[f64], first: usize) -> Vec<Vec<f64>> {
        let stream = Stream::new(self.robot.config.optimizer.seed, Purpose::SIMULATED_ROBOTS);
        let robot = |number: usize| {
            // The last environment: other draws of simulated robots have lower ones.
            let draws = stream.environment(u32::MAX).step(u32::try_from(first + number).unwrap_or(u32::MAX));
            let within = centre.iter().zip(half).zip(self.least(centre.len())).enumerate();
            within
                .map(|(at, ((centre, half), least))| {
                    (centre + half * (2.0 * draws.uniform(at as u32) - 1.0)).max(least)
                })
                .collect()
        };
        (0..robots_for(centre.len())).map(robot).collect()
    }

    /// The least that each of `count` numbers of a robot can be: friction, damping and armature of the groups, the delay, the
    /// variance of the torque noise.
    fn least(&self, count: usize) -> impl Iterator<Item = f64> {
        let step = self.recorder.physics_step();
        // In semi-implicit steps of h targets act h/2 early, so a delay of 0 in the simulation is −h/2 in time.
        (0..count).map(move |at| if at + 2 == count { -step / 2.0 } else { 0.0 })
    }

    /// The estimates from each robot's logs; `None` for a robot that falls in too many of them. `effects`: whether to keep the
    /// effects that the logs show.
    fn observe(
        &self,
        robots: &[Vec<f64>],
        first: usize,
        effects: bool,
    ) -> Result<Vec<Option<SwingReport>>, String> {
        let walking = robots.iter().enumerate().map(|(at, robot)| self.walking(robot, first + at));
        let walking = walking.collect::<Result<Vec<NoisyRobot>, String>>()?;
        // A GPU makes all logs at once. The CPU makes a few at a time, so that progress is visible and the user can stop.
        let at_once = if self.robot.gpus.is_empty() { self.robot.threads } else { walking.len() };
        let parts = walking.chunks(at_once.max(1)).map(|part| self.observe_part(part, effects));
        Ok(parts.collect::<Result<Vec<_>, String>>()?.concat())
    }

    fn observe_part(&self, robots: &[NoisyRobot], effects: bool) -> Result<Vec<Option<SwingReport>>, String> {
        if self.watch.stop() {
            // The caller asks `watch` too, so these robots are not taken for robots that fell.
            return Ok(vec![None; robots.len()]);
        }
        let recorded = self
            .recorder
            .record(&self.theta, robots, &|| self.watch.stop())
            .map_err(|error| format!("The robot cannot be simulated: {error}."))?;
        let sets: Vec<Mutex<Vec<Recorded>>> = recorded.into_iter().map(Mutex::new).collect();
        let reports = pool::map(sets.len(), self.robot.threads, |at| {
            if self.watch.stop() {
                return Ok(None);
            }
            let set = std::mem::take(&mut *sets[at].lock().unwrap_or_else(PoisonError::into_inner));
            let report = self.observe_one(set, effects);
            self.counting.step(self.done.fetch_add(1, Ordering::Relaxed) + 1, 1, "");
            report
        });
        reports.into_iter().collect()
    }

    /// The robot with this number, its values, noise and seed.
    fn walking(&self, robot: &[f64], number: usize) -> Result<NoisyRobot, String> {
        // The noise is drawn as a variance, in which mean square residuals are linear.
        let (noise, values) = robot.split_last().ok_or("a robot without numbers")?;
        let number = u32::try_from(number).unwrap_or(u32::MAX);
        Ok(NoisyRobot {
            values: self.in_theta(values),
            noise: noise.max(0.0).sqrt(),
            seed: derive_seed(
                self.robot.config.optimizer.seed,
                Purpose::TORQUE_NOISE,
                number.wrapping_add(1),
            ),
        })
    }

    fn observe_one(&self, set: Vec<Recorded>, effects: bool) -> Result<Option<SwingReport>, String> {
        // Rows before a fall are no walk any more.
        let before = (BEFORE_FALL_S / self.robot.policy.interface.control_dt).ceil() as usize;
        let pairs = self.logs.iter().zip(set);
        let walked = pairs
            .map(|(log, recorded)| recorded.before_fall(log, before, before))
            .collect::<Result<Vec<_>, _>>()?;
        let walked: Vec<Trajectory> = walked.into_iter().flatten().collect();
        if (walked.len() as f64) < WALKED * self.logs.len() as f64 {
            return Ok(None);
        }
        // Too few swings: the robot does not walk as the real one.
        let Ok((report, shown)) = shown(self.robot.model, &walked, &self.settings, effects) else {
            return Ok(None);
        };
        // Numbers are compared with those of the real robot in order, so both need the same joint groups.
        if !groups_of(&report).eq(self.groups.iter().map(String::as_str)) {
            return Ok(None);
        }
        if effects {
            self.effects_shown.lock().unwrap_or_else(PoisonError::into_inner).push(shown);
        }
        Ok(Some(report))
    }

    /// The values as the recorder's physics steps have them.
    fn in_theta(&self, values: &[f64]) -> Vec<f64> {
        let mut values = values.to_vec();
        if let Some(delay) = values.last_mut() {
            // Targets act half a step early in the simulation, so its delay is longer by that.
            *delay += self.recorder.physics_step() / 2.0;
        }
        values
    }
}

/// The estimates from legs in the air; with `effects` also the effects that the logs show.
fn shown(
    model: &Model,
    logs: &[Trajectory],
    settings: &SwingSettings,
    effects: bool,
) -> Result<Shown, String> {
    let logs: Vec<&Trajectory> = logs.iter().collect();
    let (findings, walks) = SwingFindings::without_effects(model, &logs, settings, &Watch::silent());
    let effects = if effects { findings.effects_of(model, &walks, settings) } else { Vec::new() };
    Ok((findings.swings.ok_or_else(|| findings.why_not.unwrap_or_default())?, effects))
}

/// Robots of a round, for `count` numbers of each.
fn robots_for(count: usize) -> usize {
    ROBOTS.max(count + MORE_ROBOTS)
}

#[cfg(test)]
mod tests;
