//! Estimates of joints and sensors from walks without a simulation, for tables and for comparison with a fit's values.

pub use super::findings::SwingFindings;
use super::singles;
pub use super::swing_numbers::{SwingNumber, numbers, prior_key, prior_toml, sensor_numbers};
use crate::log::Log;
use crate::watch::Watch;
use gaitfit_adapt::JointParameter;
use gaitfit_log::{Gains, ImuSettings, ReadOptions, Sensors, Trajectory, read_csv};
use gaitfit_model::Model;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;

pub use gaitfit_log::Estimate;
pub use gaitfit_swing::{
    Effect, EffectKind, FrictionLaw, GroupEstimate, Standing, SwingError, SwingReport, SwingSettings, Walk,
    effects, estimate_walks, tilt_beside_twist, usual_groups,
};

impl SwingFindings {
    /// The findings from logs as they were recorded. Faults of sensors are taken out first. The delay counts from rows, as in a
    /// walk's fit, even if the log has the times at which targets were sent. If the caller stops the work, the findings are incomplete.
    pub fn new(model: &Model, logs: &[&Trajectory], settings: &SwingSettings, watch: &Watch<'_>) -> Self {
        let (mut findings, walks) = Self::without_effects(model, logs, settings, watch);
        findings.effects = findings.effects_of(model, &walks, settings);
        if let (Some(group), Some(swings)) = (findings.twisting(), &findings.swings) {
            let left = tilt_beside_twist(model, &walks, swings, settings, &group);
            findings.beside_twist = left.map(|left| findings.standing.with_left(left));
        }
        // Last, because it replaces estimates and effects by those of a model with the springs that it finds.
        singles::examine(&mut findings, model, walks, settings, watch);
        // Both would be gears, and gears are simulated only in robots without slides.
        let gear = |effect: &Effect| matches!(effect.kind, EffectKind::Elasticity | EffectKind::Backlash);
        findings.effects.retain(|effect| !(model.has_slides() && gear(effect)));
        findings
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

    /// The findings from the logs of a fit of a robot that walked. A log of which every part counts is read again as it was
    /// recorded. `gains`: for logs that state none, in the order of the trajectory's joints.
    /// If the caller stops the work, the findings are incomplete.
    pub fn of_logs(
        model: &Model,
        logs: &[Log],
        gains: &Gains,
        settings: &SwingSettings,
        watch: &Watch<'_>,
    ) -> Self {
        let mut pieces: BTreeMap<_, usize> = BTreeMap::new();
        logs.iter().for_each(|log| *pieces.entry(&log.path).or_default() += 1);
        let trajectories: Vec<Trajectory> = logs
            .iter()
            .map(|log| {
                // The recording has the log's own rate, which shows swings better than the policy's. A log
                // that was cut has parts that do not count.
                let whole = (pieces[&log.path] == 1).then(|| recorded(log)).flatten();
                let mut trajectory = whole.unwrap_or_else(|| log.trajectory.clone());
                trajectory.gains.get_or_insert_with(|| gains.clone());
                trajectory
            })
            .collect();
        Self::new(model, &trajectories.iter().collect::<Vec<_>>(), settings, watch)
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
    // The file has the readings of a unit that the policy showed to be turned as they were.
    if let Some(base) = &mut whole.base {
        ImuSettings { mounting: log.mounting, ..ImuSettings::default() }.apply(base);
    }
    // A longer recording has parts that were cut away, such as those behind the horizon.
    let enough = whole.duration() - log.trajectory.duration() < ENDS_S && whole.target.is_some();
    enough.then_some(whole)
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
            // Two standard errors, both sides together: 95 % of differences by chance are smaller.
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
