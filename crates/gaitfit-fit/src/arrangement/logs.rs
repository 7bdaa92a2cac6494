//! Whether a log's actions follow from its observations under another arrangement.

use super::orders::Limbs;
use super::search::search;
use super::{Arrangement, Change, Diagnosis};
use crate::walk::logs::actions_of;
use crate::walk::policy_check::{self, PolicyMatch};
use crate::walk::{rate, reference, wheels};
use crate::{Error, log_joints, machine};
use gaitfit_log::{ReadOptions, Trajectory, read_csv};
use gaitfit_model::Model;
use gaitfit_policy::{Front, Policy};
use gaitfit_sim::pool;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::Path;

/// Samples that the search compares: first all arrangements on few, as what a log lacks is searched for each.
const SAMPLES: usize = 45;
const SAMPLES_WITH_IMU: usize = 150;
/// Logs that are looked at, evenly over all, and rows of each from its beginning on: arrangements are copied with them.
const MAX_LOGS: usize = 6;
const MAX_ROWS: usize = 250;
/// Mismatch up to which an arrangement is the right one; one that is left by a right one is far larger.
const FITS: f64 = 0.15;
/// Mismatch that needs no further change.
const ENOUGH: f64 = 0.08;
/// A right arrangement has at most this share of the mismatch of a wrong one.
const CLEARLY: f64 = 0.4;

/// Searches an arrangement with which the logged actions follow from the policy; `None` if none that is tried does,
/// or if they follow as they are. `logs`: joints in the policy's order, at its rate, with actions.
pub fn of_logs(policy: &Policy, model: &Model, logs: &[&Trajectory]) -> Option<Diagnosis> {
    // A caller's function may be slow, or count its calls. A motion's joints would have to be arranged too.
    if matches!(policy.front, Some(Front::Function(_))) || policy.interface.reference.is_some() {
        return None;
    }
    // A few rows of a few logs spread over all: each arrangement is measured on all of them.
    let parts: Vec<Trajectory> = logs
        .iter()
        .step_by(logs.len().div_ceil(MAX_LOGS).max(1))
        .filter_map(|log| log.slice(0..log.len().min(MAX_ROWS)).ok())
        .collect();
    let logs: &[&Trajectory] = &parts.iter().collect::<Vec<_>>();
    let joints = policy.interface.resolve(model).ok()?;
    let limbs = Limbs::new(model, &joints);
    // Actions that were computed from targets change with scale and pose; logged ones do not.
    let derived = logs.iter().all(|log| is_derived(policy, log));
    let with_imu = logs.iter().all(|log| {
        log.base.as_ref().is_some_and(|base| base.quaternion.is_some() && base.angular_velocity.is_some())
    });
    let samples = if with_imu { SAMPLES_WITH_IMU } else { SAMPLES };
    // An arrangement without a measure is infinitely bad.
    let measure = |arrangement: &Arrangement, samples: usize| {
        let (policy, logs) = arranged(policy, logs, arrangement, derived);
        policy_check::mismatch_of(&policy, &logs.iter().collect::<Vec<_>>(), samples).unwrap_or(f64::INFINITY)
    };
    // The factor that meets the logged actions best.
    let fitting = |arrangement: &Arrangement| {
        let (policy, logs) = arranged(policy, logs, arrangement, derived);
        let slope = policy_check::slope_of(&policy, &logs.iter().collect::<Vec<_>>(), samples);
        // A factor that is 1 but for noise is no change.
        let usable = slope.is_finite() && (0.02..50.0).contains(&slope) && (slope - 1.0).abs() > 0.02;
        usable.then_some(Change::ActionScale(slope)).into_iter().collect()
    };
    let few = |tried: &[Arrangement]| {
        pool::map(tried.len(), machine::threads(), |number| measure(&tried[number], samples))
    };
    // With logged actions their columns may have another order; derived ones cannot.
    let (best, _) = search(&policy.interface, &limbs, [!derived, derived], ENOUGH, &few, &fitting);
    if best.changes.is_empty() {
        return None;
    }
    // The search compares few samples, for speed. The verdict takes more.
    // Measured on the same samples, so that both numbers can be compared.
    // Ten times the samples: of many arrangements the best one on few samples is partly best by chance.
    let [before, after] = [&Arrangement::new(&policy.interface), &best].map(|one| measure(one, 10 * samples));
    (after < FITS && after < CLEARLY * before).then_some(Diagnosis {
        changes: best.changes,
        settings: best.settings,
        measure: [before, after],
        measured: "difference of the actions relative to their spread",
    })
}

/// Whether a log's actions are what its targets and the policy's pose and scale say.
fn is_derived(policy: &Policy, log: &Trajectory) -> bool {
    let (Some(target), Some(action)) = (&log.target, &log.action) else { return false };
    let derived = actions_of(target, &policy.interface);
    // Logs have decimal digits: equal means equal but for rounding.
    derived.iter().zip(action).all(|(a, b)| (a - b).abs() <= 1e-6 * (1.0 + b.abs()))
}

/// The policy and the logs under an arrangement.
fn arranged(
    policy: &Policy,
    logs: &[&Trajectory],
    arrangement: &Arrangement,
    derived: bool,
) -> (Policy, Vec<Trajectory>) {
    let Arrangement { interface, order, action_order, action_factor, .. } = arrangement;
    let policy = Policy { interface: interface.clone(), ..policy.clone() };
    let pick = |values: &[f64], order: &[usize]| -> Vec<f64> {
        values.chunks_exact(order.len()).flat_map(|row| order.iter().map(|&from| row[from])).collect()
    };
    let log = |log: &&Trajectory| {
        let target = log.target.as_ref().map(|target| pick(target, order));
        let action = match (&target, &log.action) {
            (Some(target), _) if derived => Some(actions_of(target, interface)),
            // Logged actions are brought to what the policy would have put out: the order first, then the factor.
            (_, Some(action)) => {
                let action = pick(action, action_order);
                let factors = action_factor.iter().cycle();
                Some(action.iter().zip(factors).map(|(action, factor)| action / factor).collect())
            }
            (_, None) => None,
        };
        Trajectory {
            joints: interface.joints.clone(),
            position: pick(&log.position, order),
            velocity: pick(&log.velocity, order),
            target,
            action,
            ..(*log).clone()
        }
    };
    let logs = logs.iter().map(log).collect();
    (policy, logs)
}

/// A log beside a policy.
#[derive(Clone, Debug, Serialize)]
pub struct LogMatch {
    /// Agreement of its actions with the policy.
    pub policy_match: PolicyMatch,
    /// Doubts, each a sentence; empty if the policy walked in this log.
    pub doubts: Vec<String>,
    /// Assumptions, each a sentence.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub notes: Vec<String>,
    /// Whether another policy walked in this log. Without it, what else is doubtful need not be wrong.
    pub is_other: bool,
    /// An arrangement with which they follow, where they do not.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub diagnosis: Option<Diagnosis>,
}

/// Compares the log at `path` with a policy called `name`.
///
/// # Errors
/// A log that cannot be read, or without commands, or without actions and targets; joints that are not the policy's.
pub fn match_log(policy: &Policy, name: &str, model: &Model, path: &Path) -> Result<LogMatch, Error> {
    let log = read_csv(path, &ReadOptions::default())?;
    let joints = policy.interface.resolve(model).map_err(Error::failed)?;
    let (mut log, _) = log_joints::of_robot(&log, path, &BTreeMap::new(), model, &joints)?;
    let shown = path.display().to_string();
    if log.command.is_none() {
        return Err(Error::failed(format!(
            "{shown}: the log has no commands (columns vx_cmd, vy_cmd, wz_cmd); record them, or write zeros if the policy observes \
             none"
        )));
    }
    wheels::settle(&mut log, &policy.interface).map_err(|what| Error::failed(format!("{shown}: {what}")))?;
    // A log of targets alone: the actions follow from the interface's pose and scale.
    if log.action.is_none() {
        let Some(target) = &log.target else {
            return Err(Error::failed(format!(
                "{shown}: the log has neither actions (columns act_…) nor position targets (qdes_…)"
            )));
        };
        log.action = Some(actions_of(target, &policy.interface));
    }
    let placed = reference::settle(&mut log, &policy.interface, &shown)
        .map_err(|what| Error::failed(format!("{shown}: {what}")))?;
    rate::check(log.rate_hz, policy.interface.control_dt, &shown)?;
    let failed = |error: gaitfit_log::LogError| Error::failed(format!("{shown}: {error}"));
    let log = rate::to_control(&log, policy.interface.control_dt).map_err(failed)?.trajectory;
    let policy_match = policy_check::check(policy, &[&log]);
    // The search takes long. It is only made where the actions do not follow and enough of them are there.
    let diagnosis = if policy_match.agrees() || !policy_match.is_enough() {
        None
    } else {
        of_logs(policy, model, &[&log])
    };
    let (doubts, is_other) = match policy_match.judge(name, &[&shown]) {
        Ok(warnings) => (warnings, false),
        Err(error) => (vec![error.to_string()], true),
    };
    Ok(LogMatch { policy_match, doubts, notes: placed.into_iter().collect(), is_other, diagnosis })
}
