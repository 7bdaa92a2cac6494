//! Estimates of joints and sensors from walks without a simulation, for tables and for comparison with a fit's values.

use super::{explain, singles};
use crate::log::Log;
use crate::watch::Watch;
use gaitfit_adapt::{JointParameter, RobotNumber};
use gaitfit_log::{Gains, ReadOptions, Sensors, Trajectory, read_csv};
use gaitfit_model::Model;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

pub use gaitfit_log::Estimate;
pub use gaitfit_swing::{
    Effect, EffectKind, FrictionLaw, GroupEstimate, Standing, SwingError, SwingReport, SwingSettings, Walk,
    effects, estimate_walks, tilt_beside_twist, usual_groups,
};

/// Findings in the logs of one robot without a simulation.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct SwingFindings {
    /// Lags, biases and noise of sensors.
    pub sensors: Sensors,
    /// Findings about the inertial unit from standing feet.
    pub standing: Standing,
    /// The same, estimated together with the twist of joints; absent if no joints seem to twist. See [`Self::tilt`].
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub beside_twist: Option<Standing>,
    /// Faults that were removed from the logs before legs in the air were examined, each in a sentence.
    pub taken_out: Vec<String>,
    /// Names of the robot's slides. Estimates from legs in the air leave them out.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub slides: Vec<String>,
    /// Names of the hinges that follow others, lead others, or are held by a coupling. The estimates leave them out too.
    #[serde(default, skip_serializing_if = "Vec::is_empty")]
    pub coupled: Vec<String>,
    /// Effects of joints and ground that the model lacks, each alone, see [`super::explain`].
    #[serde(default)]
    pub effects: Vec<Effect>,
    /// Estimates from legs in the air; absent if there are none.
    pub swings: Option<SwingReport>,
    /// Why there are none.
    pub why_not: Option<String>,
    /// The estimates from legs in the air, corrected by simulated walks; absent if they are not corrected.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub corrected: Option<SwingReport>,
    /// Why they are not corrected, if a correction was tried; the end of a sentence.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub not_corrected: Option<String>,
}

impl SwingFindings {
    /// The findings from logs as they were recorded. Faults of sensors are taken out first. The delay counts from rows, as in a
    /// walk's fit, even if the log has the times at which targets were sent. If the caller stops the work, the findings are incomplete.
    pub fn new(model: &Model, logs: &[&Trajectory], settings: &SwingSettings, watch: &Watch<'_>) -> Self {
        let (mut findings, walks) = Self::without_effects(model, logs, settings, watch);
        findings.effects = findings.effects_of(model, &walks, settings);
        if let (Some(group), Some(swings)) = (explain::twisting(&findings), &findings.swings) {
            let left = tilt_beside_twist(model, &walks, swings, settings, &group);
            findings.beside_twist = left.map(|left| findings.standing.with_left(left));
        }
        singles::examine(&mut findings, model, walks, settings, watch);
        // Both would be gears, and gears are simulated only in robots without slides.
        let gear = |effect: &Effect| matches!(effect.kind, EffectKind::Elasticity | EffectKind::Backlash);
        findings.effects.retain(|effect| !(model.has_slides() && gear(effect)));
        findings
    }

    /// The tilt of the IMU about the base's x and y axes, rad. If joints twist, the one that was estimated together with their
    /// twist.
    pub fn tilt(&self) -> Option<[Estimate; 2]> {
        let twists = explain::twisting(self).is_some();
        self.beside_twist.filter(|_| twists).unwrap_or(self.standing).tilt
    }

    /// The effects beyond `model`; none if no legs swing.
    pub(crate) fn effects_of(&self, model: &Model, walks: &[Walk], settings: &SwingSettings) -> Vec<Effect> {
        self.swings.as_ref().map(|report| effects(model, walks, report, settings)).unwrap_or_default()
    }

    /// The findings of [`Self::new`] without effects beyond the model; and the logs as walks, without faults of
    /// sensors. There are no walks if the logs lack what is needed.
    pub fn without_effects(
        model: &Model,
        logs: &[&Trajectory],
        settings: &SwingSettings,
        watch: &Watch<'_>,
    ) -> (Self, Vec<Walk>) {
        // In walks a delay counts from the rows, as in a training, so the lead is left out.
        let mut rows: Vec<Trajectory> =
            logs.iter().map(|&log| Trajectory { lead: None, ..log.clone() }).collect();
        // Angles that jump by a turn would be differentiated as huge velocities.
        rows.iter_mut().for_each(Trajectory::unwrap_wheels);
        let logs: Vec<&Trajectory> = rows.iter().collect();
        let logs = logs.as_slice();
        let sensors = Sensors::new(logs);
        let mut taken_out = Vec::new();
        let mut better = |correct: &dyn Fn(&Trajectory) -> (Trajectory, Vec<String>),
                          logs: &[&Trajectory]| {
            let mut corrected = Vec::with_capacity(logs.len());
            for log in logs {
                let (log, said) = correct(log);
                taken_out.extend(said);
                corrected.push(log);
            }
            corrected
        };
        // Faults of sensors first: the tilt is measured on logs without them.
        let steady = better(&|log| sensors.corrected(log), logs);
        let steady: Vec<&Trajectory> = steady.iter().collect();
        let standing = Standing::new(model, &steady, settings.threads).unwrap_or_default();
        let level = better(&|log| standing.corrected(log), &steady);
        let walks = Walk::all(model, &level.iter().collect::<Vec<_>>(), settings.threads);
        let (walks, swings) = match walks {
            Ok(walks) => {
                let swings = watch.counted("regression", "regressions", |count| {
                    estimate_walks(model, &walks, settings, count)
                });
                (walks, swings)
            }
            Err(error) => (Vec::new(), Err(error)),
        };
        // Several logs have the same faults; each is said once.
        taken_out.sort();
        taken_out.dedup();
        let (swings, why_not) = match swings {
            Ok(report) => (Some(report), None),
            Err(error) => (None, Some(error.to_string())),
        };
        let named = |wanted: &dyn Fn(usize) -> bool| -> Vec<String> {
            let joints = (0..model.joints.len()).filter(|&joint| wanted(joint));
            joints.map(|joint| model.joints[joint].name.clone()).collect()
        };
        let is_hinge = |joint: usize| model.joints[joint].kind.is_hinge();
        let slides = named(&|joint| !is_hinge(joint));
        let coupled = named(&|joint| is_hinge(joint) && model.is_coupled(joint));
        (Self { sensors, standing, taken_out, slides, coupled, swings, why_not, ..Self::default() }, walks)
    }

    /// The estimates from legs in the air: the corrected ones if there are such.
    pub fn best(&self) -> Option<&SwingReport> {
        self.corrected.as_ref().or(self.swings.as_ref())
    }

    /// The findings from the logs of a fit of a robot that walked. A log of which every part counts is read again as it was
    /// recorded. `gains`: for logs that state none, in the order of the trajectory's joints.
    pub fn of_logs(model: &Model, logs: &[Log], gains: &Gains, settings: &SwingSettings) -> Self {
        let mut pieces: BTreeMap<_, usize> = BTreeMap::new();
        logs.iter().for_each(|log| *pieces.entry(&log.path).or_default() += 1);
        let trajectories: Vec<Trajectory> = logs
            .iter()
            .map(|log| {
                let whole = (pieces[&log.path] == 1).then(|| recorded(log)).flatten();
                let mut trajectory = whole.unwrap_or_else(|| log.trajectory.clone());
                trajectory.gains.get_or_insert_with(|| gains.clone());
                trajectory
            })
            .collect();
        Self::new(model, &trajectories.iter().collect::<Vec<_>>(), settings, &Watch::silent())
    }
}

/// The log at its own rate, under the robot's names; absent where a part of it does not count.
fn recorded(log: &Log) -> Option<Trajectory> {
    /// Samples before the first and after the last of the policy's steps, s.
    const ENDS_S: f64 = 0.1;
    let read = read_csv(&log.path, &ReadOptions::default()).ok()?;
    let mut whole = read.select_joints(&log.joints).ok()?;
    whole.joints.clone_from(&log.trajectory.joints);
    whole.velocity_joints.clone_from(&log.trajectory.velocity_joints);
    let enough = whole.duration() - log.trajectory.duration() < ENDS_S && whole.target.is_some();
    enough.then_some(whole)
}

/// An estimate from logs without a simulation, of a number that a fit can have.
#[derive(Clone, Debug, PartialEq)]
pub struct SwingNumber {
    /// The name of its kind, [`JointParameter::name`] or [`RobotNumber::name`].
    pub kind: &'static str,
    /// The joints, by the robot's names; empty: all, or a number of the whole robot.
    pub joints: Vec<String>,
    /// Value and standard error, in the parameter's unit.
    pub estimate: Estimate,
    /// Rise of the value where the motors' strength rises by 1.
    pub by_strength: f64,
    /// Fall of the value where the friction under load rises by 1.
    pub by_load: f64,
}

/// Max error of an estimate of the motors' strength; with a larger one it adds nothing to the usual range.
const SURE_STRENGTH: f64 = 0.1;

/// The numbers of a report, converted to a simulation with physics steps of `step` s. In semi-implicit steps targets act half
/// a step early, so the delay of the simulation is longer.
pub fn numbers(report: &SwingReport, step: f64) -> Vec<SwingNumber> {
    let mut numbers = Vec::new();
    for group in &report.groups {
        let kinds = [JointParameter::FrictionLoss, JointParameter::Damping, JointParameter::Armature];
        let estimates = [group.friction, group.damping, group.armature];
        let slopes = group.by_strength.into_iter().zip(group.by_load);
        for ((kind, estimate), (by_strength, by_load)) in kinds.into_iter().zip(estimates).zip(slopes) {
            numbers.push(SwingNumber {
                kind: kind.name(),
                joints: group.joints.clone(),
                estimate,
                by_strength,
                by_load,
            });
        }
    }
    numbers.push(SwingNumber {
        kind: JointParameter::Delay.name(),
        joints: Vec::new(),
        estimate: delay(report, step),
        by_strength: report.delay_by_strength,
        by_load: 0.0,
    });
    // A strength that is hardly known would be a prior of no use.
    if report.strength.error < SURE_STRENGTH {
        numbers.push(SwingNumber {
            kind: JointParameter::TorqueScale.name(),
            joints: Vec::new(),
            estimate: report.strength,
            by_strength: 0.0,
            by_load: 0.0,
        });
    }
    numbers
}

/// The delay in a simulation with physics steps of `step` s. No target acts before it is sent: a delay below 0 is an error of
/// at least that size. Logs of simulators with long steps, and of fast joints at 50 Hz, show such delays.
fn delay(report: &SwingReport, step: f64) -> Estimate {
    let Estimate { value, error } = report.delay;
    let value = value + step / 2.0;
    Estimate { value: value.max(0.0), error: error.hypot(value.min(0.0)) }
}

/// Min standard error of a tilt, rad: on simulated robots whose unit was late and whose encoders were coarse, the estimate
/// was off by up to 0.002 rad, with standard errors of 0.0002 to 0.0007 rad.
const MIN_TILT_ERROR: f64 = 0.003;

/// Min standard error of a lag of velocities, s: on simulated walks at 50 Hz the estimate was up to 1.8 ms too large.
const MIN_LAG_ERROR: f64 = 2e-3;

/// The errors of sensors that a fit can have among its parameters, converted to a simulation with physics steps of `step` s.
/// In a semi-implicit step, velocities belong to a time half a step before the positions.
pub fn sensor_numbers(findings: &SwingFindings, step: Option<f64>) -> Vec<SwingNumber> {
    let number = |kind: RobotNumber, estimate: &Estimate| SwingNumber {
        kind: kind.name(),
        joints: Vec::new(),
        estimate: *estimate,
        by_strength: 0.0,
        by_load: 0.0,
    };
    let careful = |tilt: Estimate| Estimate { error: tilt.error.max(MIN_TILT_ERROR), ..tilt };
    let tilt = findings.tilt().into_iter().flatten().map(careful);
    let tilt = [RobotNumber::ImuRoll, RobotNumber::ImuPitch].into_iter().zip(tilt);
    let bias = [RobotNumber::GyroBiasX, RobotNumber::GyroBiasY, RobotNumber::GyroBiasZ];
    let bias = bias.into_iter().zip(findings.sensors.gyro_bias.iter().flatten().copied());
    let sensor_lag = |lag: Estimate, step: f64| Estimate {
        value: (lag.value - step / 2.0).max(0.0),
        error: lag.error.max(MIN_LAG_ERROR),
    };
    let lag = findings
        .sensors
        .velocity_lag
        .zip(step)
        .map(|(lag, step)| (RobotNumber::VelocityLag, sensor_lag(lag, step)));
    tilt.chain(bias).chain(lag).map(|(kind, estimate)| number(kind, &estimate)).collect()
}

/// The numbers as the table `[prior]` of a fit with physics steps of `step` s. Numbers of sensors are comments, because no fit
/// has them by default. The user must leave out the lines of parameters that the fit does not change.
pub fn prior_toml(findings: &SwingFindings, report: &SwingReport, step: f64) -> String {
    let mut text = format!("[prior] # by legs in the air, for physics steps of {} ms\n", 1e3 * step);
    let mut line = |kind: JointParameter, group: &str, one: Estimate, slope: f64, by_load: f64| {
        let Estimate { value, error } = one;
        let name = if group.is_empty() { kind.name().to_owned() } else { format!("{}_{group}", kind.name()) };
        // A prior needs a deviation above 0 in five decimals.
        let error = error.max(1e-5);
        let load = if by_load == 0.0 { String::new() } else { format!(", by_load = {by_load:.5}") };
        text += &format!(
            "{name} = {{ value = {value:.5}, deviation = {error:.5}, by_strength = {slope:.5}{load} }}\n"
        );
    };
    for group in &report.groups {
        line(
            JointParameter::FrictionLoss,
            &group.group,
            group.friction,
            group.by_strength[0],
            group.by_load[0],
        );
        line(JointParameter::Armature, &group.group, group.armature, group.by_strength[2], group.by_load[2]);
        line(JointParameter::Damping, &group.group, group.damping, group.by_strength[1], group.by_load[1]);
    }
    line(JointParameter::Delay, "", delay(report, step), report.delay_by_strength, 0.0);
    for SwingNumber { kind, estimate: Estimate { value, error }, .. } in sensor_numbers(findings, Some(step))
    {
        text += &format!("# {kind} = {{ value = {value:.5}, deviation = {:.5} }}\n", error.max(1e-5));
    }
    text
}

/// A value of a fit beside the estimate from swings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Beside {
    /// The parameter's name.
    pub name: String,
    /// Its unit.
    pub unit: String,
    /// The fit's value.
    pub fitted: f64,
    /// The estimate from swings.
    pub swings: Estimate,
    /// Whether they differ by more than their errors, and by an amount that changes how a robot walks.
    pub differ: bool,
}

/// A value that a fit found.
#[derive(Clone, Debug, PartialEq)]
pub struct Fitted<'a> {
    /// The parameter's name.
    pub name: &'a str,
    /// The name of its kind ([`JointParameter::name`]).
    pub kind: &'a str,
    /// Its unit.
    pub unit: &'a str,
    /// The joints it covers, by the robot's names.
    pub joints: &'a [String],
    /// The value.
    pub value: f64,
    /// Its 95 % interval, where there is one.
    pub interval: Option<[f64; 2]>,
}

/// Differences that change how a robot walks: N·m, N·m·s/rad, kg·m², s.
fn matters(kind: &str) -> f64 {
    match kind {
        "armature" => 0.006,
        "delay" => 0.003,
        _ => 0.1,
    }
}

/// Each fitted value for which swings have an estimate, beside that estimate. `step`: physics step of the fit, s. `strength`:
/// the fitted strength of motors and its standard error, for which the swings' estimates are computed.
pub fn beside<'a>(
    report: &SwingReport,
    step: f64,
    strength: Estimate,
    fitted: impl IntoIterator<Item = Fitted<'a>>,
) -> Vec<Beside> {
    let numbers = numbers(report, step);
    let fitted: Vec<Fitted<'a>> = fitted.into_iter().collect();
    // A 95 % interval is about four standard errors wide.
    let error_of = |one: &Fitted<'_>| one.interval.map_or(0.0, |[low, high]| (high - low) / 4.0);
    // Value and standard error of the fitted friction under load of these joints.
    let load_of = |joints: &[String]| {
        let covers = |load: &&Fitted<'_>| {
            // Friction under load covers all joints of a group, or it says nothing of the group.
            load.kind == JointParameter::LoadFriction.name()
                && joints.iter().all(|joint| load.joints.contains(joint))
        };
        fitted.iter().find(covers).map_or((0.0, 0.0), |load| (load.value, error_of(load)))
    };
    let beside = |one: &Fitted<'a>| {
        let covers = |number: &&SwingNumber| {
            // A number of all joints covers any entry; one of some joints must cover all of the entry's.
            number.kind == one.kind
                && (number.joints.is_empty()
                    || (!one.joints.is_empty()
                        && one.joints.iter().all(|joint| number.joints.contains(joint))))
        };
        let number = numbers.iter().find(covers)?;
        let error = error_of(one);
        let Estimate { value, error: sure } = number.estimate;
        let (load, load_error) = load_of(one.joints);
        // Swings assume full strength and no friction under load; the fit's own values are put in for both.
        let swings = Estimate {
            value: value + number.by_strength * (strength.value - 1.0) - number.by_load * load,
            error: sure.hypot(number.by_strength * strength.error).hypot(number.by_load * load_error),
        };
        let apart = (one.value - swings.value).abs();
        Some(Beside {
            name: one.name.to_owned(),
            unit: one.unit.to_owned(),
            fitted: one.value,
            swings,
            differ: apart > 2.0 * error.hypot(swings.error) && apart > matters(number.kind),
        })
    };
    fitted.iter().filter_map(beside).collect()
}

/// The values that differ, in a sentence; absent where none does.
pub fn doubt(beside: &[Beside]) -> Option<String> {
    let apart: Vec<String> = beside
        .iter()
        .filter(|one| one.differ)
        .map(|one| {
            let Beside { name, unit, fitted, swings: Estimate { value, error }, .. } = one;
            format!("{name} {fitted:.3} fitted, {value:.3} ± {error:.3} {unit} in swings")
        })
        .collect();
    (!apart.is_empty()).then(|| {
        format!(
            "the fit and legs in the air disagree: {}. Nothing touches a leg in the air, so contact or sensors may \
             have changed the fit's values.",
            apart.join("; ")
        )
    })
}

#[cfg(test)]
#[path = "swing_test.rs"]
mod tests;
