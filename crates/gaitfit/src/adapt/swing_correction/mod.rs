//! Estimates from legs in the air, corrected by simulated walks.
//!
//! Torque noise moves a joint in its own direction, so friction seems smaller and damping larger; and readings at 50 Hz miss
//! when a slow joint turns. So robots with drawn values walk in the simulator under the logs' commands, and their logs are
//! looked at in the same way. A regression learns how the estimate answers to the values (indirect inference: Gourieroux,
//! Monfort and Renault 1993).

mod response;

use crate::log::Log;
use crate::settings::AdaptConfig;
use crate::walk::explain::{self, Cause, CauseKind};
use crate::walk::recorder::{Recorded, Recorder};
use crate::walk::swing::{Estimate, GroupEstimate, SwingFindings, SwingReport, SwingSettings};
use crate::walk::walking::Walking;
use gaitfit_adapt::{JointParameter, ParameterRule, Sharing, Theta, ThetaError, never};
use gaitfit_log::{Gains, Trajectory};
use gaitfit_model::Model;
use gaitfit_policy::Policy;
use gaitfit_random::{Purpose, Stream, derive_seed};
use gaitfit_sim::{Candidate, pool};
use response::{Answer, Response};
use std::sync::{Arc, Mutex, PoisonError};

/// Rounds of simulated robots, each around the values of the last one.
const ROUNDS: usize = 2;
/// Robots of a round.
const ROBOTS: usize = 14;
/// Half the width of a round, in standard errors.
const WIDTH: f64 = 2.0;
/// Least standard errors for that: friction, N·m; damping, N·m·s/rad; armature, kg·m²; delay, s.
const LEAST: [f64; 4] = [0.02, 0.01, 5e-4, 4e-4];
/// Torque noise of the first robot that has some, N·m.
const NOISE: f64 = 0.5;
/// Physics step of the simulated robots if nothing states the real one's, s.
const STEP_S: f64 = 1e-3;
/// This part of a correction counts as one standard deviation.
const DOUBT: f64 = 0.3;
/// Torque noise that leaves this many times as much unexplained shows in a group.
const SHOWN: f64 = 1.2;
/// Largest torque noise, part of the weakest joint's torque limit.
const MAX_NOISE: f64 = 0.06;
/// Errors above this part of the width of a round say nothing.
const UNSURE: f64 = 1.0;
const ALIKE: &str = "estimates of simulated robots hardly depend on their values";
/// Effects that simulated joints lack. What they leave unexplained looks like torque noise.
const LACKING: [CauseKind; 2] = [CauseKind::Elasticity, CauseKind::Backlash];
/// Least share of the logs that a simulated robot must walk without a fall.
const WALKED: f64 = 0.5;
/// Part of a log before a fall that does not count, s.
const BEFORE_FALL_S: f64 = 0.3;
/// Logs of which simulated robots make the like, s in all.
const SIMULATED_S: f64 = 60.0;

/// The robot of a fit.
pub struct Robot<'a> {
    /// The fit's settings.
    pub config: &'a AdaptConfig,
    /// The policy that walked.
    pub policy: &'a Policy,
    /// The model.
    pub model: &'a Model,
    /// What the fit changes.
    pub base: &'a Candidate,
    /// Threads.
    pub threads: usize,
}

/// Corrects what legs in the air say in `found`, which is of `logs`, and notes it there, or why it does not.
pub fn correct(found: &mut SwingFindings, robot: &Robot<'_>, logs: &[Log]) {
    let Some(report) = &found.swings else { return };
    let of_joints = |cause: &Cause| LACKING.contains(&cause.kind);
    if let Some(cause) = explain::causes(found).into_iter().find(of_joints) {
        found.not_corrected = Some(format!("simulated joints lack what these have: {}", cause.text));
        return;
    }
    match robot.corrected(logs, report) {
        Ok(report) => found.corrected = Some(report),
        Err(why) => found.not_corrected = Some(why),
    }
}

/// What simulated robots are like, and what is estimated of them.
struct World<'a> {
    robot: &'a Robot<'a>,
    recorder: Recorder,
    theta: Theta,
    settings: SwingSettings,
    /// The logs, of which only the length and the commands count.
    logs: Vec<Trajectory>,
}

impl Robot<'_> {
    /// `found` of `logs` at the policy's rate, corrected.
    ///
    /// # Errors
    /// Why it is not.
    fn corrected(&self, logs: &[Log], found: &SwingReport) -> Result<SwingReport, String> {
        let settings = SwingSettings {
            clearances_m: vec![found.clearance_m],
            law: Some(found.law),
            bounded: false,
            others: false,
            ..SwingSettings::default()
        };
        let interface = &self.policy.interface;
        let gains = Gains { kp: interface.kp.clone(), kd: interface.kd.clone() };
        let rows = |log: &Log| {
            let mut rows = Trajectory { lead: None, ..log.trajectory.clone() };
            rows.gains.get_or_insert_with(|| gains.clone());
            rows
        };
        let all: Vec<Trajectory> = logs.iter().map(rows).collect();
        let real = estimate(self.model, &all, &settings)?;
        let theta = theta_of(&real, self.model).map_err(|error| error.to_string())?;
        let mut config = self.config.clone();
        config.simulation.robot_timestep.get_or_insert(STEP_S);
        let walking = Walking::robot(&config, self.policy.clone(), self.model, &theta, self.base, 1)
            .map_err(|error| error.to_string())?;
        let mut left = SIMULATED_S;
        let short = |log: &Trajectory| {
            let first = left > 0.0;
            left -= log.duration();
            first.then(|| log.clone())
        };
        let logs: Vec<Trajectory> = all.iter().map_while(short).collect();
        let recorder = Recorder::new(Arc::new(walking), self.base.clone(), &logs.iter().collect::<Vec<_>>());
        let mut corrected = World { robot: self, recorder, theta, settings, logs }.correct(&real)?;
        // Errors by other choices of swings are those of the recorded logs.
        for (slot, found) in slots(&mut corrected).zip(errors_of(found)) {
            slot.error = slot.error.hypot(found);
        }
        Ok(corrected)
    }
}

impl World<'_> {
    fn correct(&self, real: &SwingReport) -> Result<SwingReport, String> {
        let (asked, errors) = (values_of(real), errors_of(real));
        let (noise, slope, group) = self.noise(real, &asked)?;
        let mut half: Vec<f64> = errors
            .iter()
            .zip(kinds(asked.len()))
            .map(|(error, kind)| WIDTH * error.max(LEAST[kind]))
            .collect();
        half.push((0.5 * noise).max(0.2 * NOISE * NOISE));
        let left = |report: &SwingReport| report.groups[group].residual.powi(2) / slope;
        let with_left = |report: &SwingReport| {
            let mut observed = values_of(report);
            observed.push(left(report));
            observed
        };
        let wanted = with_left(real);
        let mut centre = asked;
        centre.push(noise);
        let mut response = Response::default();
        let mut answer = None;
        for round in 0..ROUNDS {
            let first = 2 + round * ROBOTS;
            let robots = self.draw(&centre, &half, first);
            let said = self.observe(&robots, first)?;
            for (robot, said) in robots.into_iter().zip(said) {
                let Some(said) = said else { continue };
                response.estimates.push(with_left(&said));
                response.values.push(robot);
            }
            let found = response.answer(&wanted, &half).ok_or(ALIKE)?;
            for ((centre, value), half) in centre.iter_mut().zip(&found.values).zip(&half) {
                *centre = value.clamp(*centre - 2.0 * half, *centre + 2.0 * half);
            }
            answer = Some(found);
        }
        let Answer { values, errors: sure } = answer.ok_or(ALIKE)?;
        let worse = sure.iter().zip(&half).any(|(sure, half)| *sure > UNSURE * half);
        if worse {
            return Err(ALIKE.to_owned());
        }
        let mut corrected = real.clone();
        for ((slot, value), sure) in slots(&mut corrected).zip(values).zip(sure) {
            let moved = DOUBT * (value - slot.value);
            *slot = Estimate { value: value.max(0.0), error: sure.hypot(moved) };
        }
        Ok(corrected)
    }

    /// The square of the torque noise that leaves as much unexplained as the real logs do, (N·m)²; what that adds to the mean
    /// square of what a group leaves, per 1; and the group which asks for the least. Whatever the model lacks leaves
    /// something too, but seldom in all groups.
    fn noise(&self, real: &SwingReport, asked: &[f64]) -> Result<(f64, f64, usize), String> {
        let robots =
            [0.0, NOISE * NOISE].map(|noise| asked.iter().copied().chain([noise]).collect::<Vec<f64>>());
        let said = self.observe(&robots, 0)?;
        let [Some(quiet), Some(noisy)] = [0, 1].map(|at| said.get(at).cloned().flatten()) else {
            return Err("the simulated robot falls in most logs".to_owned());
        };
        let square = |report: &SwingReport, group: usize| report.groups[group].residual.powi(2);
        let asks = |group: usize| {
            let (none, some) = (square(&quiet, group), square(&noisy, group));
            let slope = (some - none) / (NOISE * NOISE);
            (some > SHOWN * none).then(|| (((square(real, group) - none) / slope).max(0.0), slope, group))
        };
        let least = (0..real.groups.len()).filter_map(asks).min_by(|a, b| a.0.total_cmp(&b.0));
        let (noise, slope, group) = least.ok_or(ALIKE)?;
        let model = self.robot.model;
        let efforts = (0..model.joints.len()).filter_map(|joint| model.effort(joint));
        let most = MAX_NOISE * efforts.fold(f64::INFINITY, f64::min);
        if noise.sqrt() > most {
            return Err(format!(
                "they leave more unexplained than torque noise of {most:.2} N·m would: the model lacks something else"
            ));
        }
        Ok((noise, slope, group))
    }

    /// Robots around `centre`.
    fn draw(&self, centre: &[f64], half: &[f64], first: usize) -> Vec<Vec<f64>> {
        let stream = Stream::new(self.robot.config.optimizer.seed, Purpose::SIMULATED_ROBOTS);
        let robot = |number: usize| {
            let draws = stream.environment(u32::MAX).step(u32::try_from(first + number).unwrap_or(u32::MAX));
            let within = centre.iter().zip(half).enumerate();
            within
                .map(|(at, (centre, half))| centre + half * (2.0 * draws.uniform(at as u32) - 1.0))
                .collect()
        };
        (0..ROBOTS).map(robot).collect()
    }

    /// What is estimated of each robot; `None` of one that falls in most logs.
    fn observe(&self, robots: &[Vec<f64>], first: usize) -> Result<Vec<Option<SwingReport>>, String> {
        let found = Mutex::new(vec![Ok(None); robots.len()]);
        pool::for_each(
            robots.len(),
            self.robot.threads,
            || (),
            |(), at| {
                let one = self.observe_one(&robots[at], first + at);
                found.lock().unwrap_or_else(PoisonError::into_inner)[at] = one;
            },
        );
        found.into_inner().unwrap_or_else(PoisonError::into_inner).into_iter().collect()
    }

    fn observe_one(&self, robot: &[f64], number: usize) -> Result<Option<SwingReport>, String> {
        let values: Vec<f64> = robot[..robot.len() - 1].iter().map(|value| value.max(0.0)).collect();
        let values = self.in_theta(&values);
        let noise = robot[robot.len() - 1].max(0.0).sqrt();
        let number = u32::try_from(number).unwrap_or(u32::MAX);
        let seed =
            derive_seed(self.robot.config.optimizer.seed, Purpose::TORQUE_NOISE, number.wrapping_add(1));
        let set = self
            .recorder
            .record(&self.theta, &values, noise, &[seed], &never)
            .map_err(|error| format!("The robot cannot be simulated: {error}."))?
            .pop()
            .unwrap_or_default();
        let before = (BEFORE_FALL_S / self.robot.policy.interface.control_dt).ceil() as usize;
        let walked = |(log, recorded): (&Trajectory, Recorded)| {
            let end = recorded.fell_at.map(|fell| fell.saturating_sub(before));
            let whole = recorded.instead_of(log);
            match end {
                None => Some(whole),
                Some(end) if end > before => whole.slice(0..end).ok(),
                Some(_) => None,
            }
        };
        let walked: Vec<Trajectory> = self.logs.iter().zip(set).filter_map(walked).collect();
        if (walked.len() as f64) < WALKED * self.logs.len() as f64 {
            return Ok(None);
        }
        let said = estimate(self.robot.model, &walked, &self.settings).ok();
        Ok(said.filter(|said| values_of(said).len() + 1 == robot.len()))
    }

    /// The values as the recorder's physics steps have them.
    fn in_theta(&self, values: &[f64]) -> Vec<f64> {
        let mut values = values.to_vec();
        if let Some(delay) = values.last_mut() {
            *delay += self.recorder.physics_step() / 2.0;
        }
        values
    }
}

/// What legs in the air say, without the effects that the model lacks.
fn estimate(model: &Model, logs: &[Trajectory], settings: &SwingSettings) -> Result<SwingReport, String> {
    let logs: Vec<&Trajectory> = logs.iter().collect();
    let (found, _) = SwingFindings::without_effects(model, &logs, settings);
    found.swings.ok_or_else(|| found.why_not.unwrap_or_default())
}

/// Friction, damping and armature of each group, then the delay.
fn values_of(report: &SwingReport) -> Vec<f64> {
    slots(&mut report.clone()).map(|one| one.value).collect()
}

/// What each of them is, by its place in [`LEAST`].
fn kinds(count: usize) -> impl Iterator<Item = usize> {
    (0..count).map(move |at| if at + 1 < count { at % 3 } else { 3 })
}

/// Standard errors of the values.
fn errors_of(report: &SwingReport) -> Vec<f64> {
    slots(&mut report.clone()).map(|one| one.error).collect()
}

/// The estimates, in the order of [`values_of`].
fn slots(report: &mut SwingReport) -> impl Iterator<Item = &mut Estimate> {
    let groups = report.groups.iter_mut();
    groups
        .flat_map(|group| [&mut group.friction, &mut group.damping, &mut group.armature])
        .chain([&mut report.delay])
}

/// The numbers that `report` estimates, in its order.
fn theta_of(report: &SwingReport, model: &Model) -> Result<Theta, ThetaError> {
    let joints = crate::robot::joint_names(model);
    let kinds = [JointParameter::FrictionLoss, JointParameter::Damping, JointParameter::Armature];
    let of_group = |group: &GroupEstimate| {
        kinds.map(|kind| ParameterRule {
            per: Sharing::All,
            joints: group.joints.clone(),
            name: Some(format!("{}_{}", kind.name(), group.group)),
            ..ParameterRule::new(kind)
        })
    };
    let delay = ParameterRule { per: Sharing::All, ..ParameterRule::new(JointParameter::Delay) };
    let rules: Vec<ParameterRule> = report.groups.iter().flat_map(of_group).chain([delay]).collect();
    Theta::from_rules(&rules, &[], &joints)
}
