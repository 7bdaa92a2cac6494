//! Springs and strengths of single joints, as legs in the air show them: in the model, in logs, and as numbers of a
//! fit.

use super::findings::SwingFindings;
use super::swing_numbers::SwingNumber;
use crate::watch::Watch;
use gaitfit_adapt::JointParameter;
use gaitfit_log::{Estimate, Trajectory};
use gaitfit_model::Model;
use gaitfit_model::patterns::plain;
use gaitfit_swing::{Effect, EffectKind, SwingReport, SwingSettings, Walk, estimate_walks};

/// Max number of times that logs are examined again with the springs and strengths that were found.
const SINGLE_ROUNDS: usize = 4;

/// Looks for springs and strengths of single joints in `findings`, which come from these walks, and examines the walks
/// again with the largest one, until there are no more.
pub fn examine(
    findings: &mut SwingFindings,
    model: &Model,
    mut walks: Vec<Walk>,
    settings: &SwingSettings,
    watch: &Watch<'_>,
) {
    let mut singles: Vec<Effect> = Vec::new();
    let Some(first) = &findings.swings else { return };
    // The first examination chose a clearance among all. The next rounds look only beside it, which saves
    // time.
    let again = near(first, settings);
    for _ in 0..SINGLE_ROUNDS {
        // One at a time: a joint with a spring changes what its siblings seem to have.
        let more = findings.singles().max_by(|a, b| a.share.total_cmp(&b.share)).cloned();
        let Some(more) = more else { break };
        // A strength changes the gains of the walks, a spring the model. The walks keep the strengths of earlier
        // rounds.
        let joint = model.joints.iter().position(|joint| joint.name == more.of);
        if let Some(joint) = joint.filter(|_| more.kind == EffectKind::OddStrength) {
            walks.iter_mut().for_each(|walk| walk.scale_gains(joint, 1.0 + more.size.value));
        }
        add_single(&mut singles, more);
        let sprung = with_springs(model, &singles);
        let report = watch
            .counted("regression", "regressions", |count| estimate_walks(&sprung, &walks, &again, count));
        // Without a report the findings of the round before stay.
        let Ok(report) = report else { break };
        findings.swings = Some(report);
        findings.effects = findings.effects_of(&sprung, &walks, settings);
    }
    // The last round sees only the rest of these effects. The effects that the rounds took out one by one replace it.
    let is_single = |effect: &Effect| matches!(effect.kind, EffectKind::OddSpring | EffectKind::OddStrength);
    findings.effects.retain(|effect| !is_single(effect));
    findings.effects.extend(singles);
}

/// Settings for further examinations of the same logs: the clearance of the first one, the next lower and the next
/// higher one. A spring does not change when feet touch the ground.
fn near(first: &SwingReport, settings: &SwingSettings) -> SwingSettings {
    let clearances = &settings.clearances_m;
    let place = clearances.iter().position(|&clearance| clearance >= first.clearance_m).unwrap_or_default();
    let clearances_m = clearances[place.saturating_sub(1)..clearances.len().min(place + 2)].to_vec();
    SwingSettings { clearances_m, ..settings.clone() }
}

/// Adds an effect of a single joint to `known` ones; those of one kind and joint become one.
fn add_single(known: &mut Vec<Effect>, one: Effect) {
    let Some(known) = known.iter_mut().find(|known| (known.kind, &known.of) == (one.kind, &one.of)) else {
        known.push(one);
        return;
    };
    let (before, error) = (known.size.value, one.size.error);
    if one.kind == EffectKind::OddStrength {
        // The walks had the earlier strength already, so the new one is a factor on it.
        known.size = Estimate { value: (1.0 + before) * (1.0 + one.size.value) - 1.0, error };
    } else {
        // Two springs on a joint act as one: stiffnesses add, and so do the torques at angle 0.
        let torque = torque_of(known) + torque_of(&one);
        known.size = Estimate { value: before + one.size.value, error };
        // Stiffnesses that add up to 0 have no angle of rest.
        known.rest = Some(torque / known.size.value).filter(|rest| rest.is_finite());
    }
}

/// The torque of a spring at angle 0, N·m.
fn torque_of(spring: &Effect) -> f64 {
    spring.size.value * spring.rest.unwrap_or_default()
}

/// Copies `logs`, with gains scaled by the strength of each motor.
pub fn with_strengths(logs: &[&Trajectory], singles: &[Effect]) -> Vec<Trajectory> {
    let mut logs: Vec<Trajectory> = logs.iter().map(|&log| log.clone()).collect();
    for strength in singles.iter().filter(|single| single.kind == EffectKind::OddStrength) {
        for log in &mut logs {
            // Logs and model may differ in endings such as `_joint`.
            let place = log.joints.iter().position(|joint| plain(joint) == plain(&strength.of));
            if let (Some(place), Some(gains)) = (place, &mut log.gains) {
                gains.kp[place] *= 1.0 + strength.size.value;
                gains.kd[place] *= 1.0 + strength.size.value;
            }
        }
    }
    logs
}

/// `model` with further springs on its joints.
pub fn with_springs(model: &Model, singles: &[Effect]) -> Model {
    let mut model = model.clone();
    for spring in singles.iter().filter(|single| single.kind == EffectKind::OddSpring) {
        let Some(joint) = model.joints.iter_mut().find(|joint| joint.name == spring.of) else { continue };
        let torque = joint.stiffness * joint.springref + torque_of(spring);
        joint.stiffness += spring.size.value;
        // Two springs that cancel each other have no angle of rest.
        joint.springref = if joint.stiffness == 0.0 { joint.springref } else { torque / joint.stiffness };
    }
    model
}

/// Least relative error of a spring or strength. Estimates of ten springs on robots in MuJoCo were wrong by up to 7 %.
const MIN_SINGLE_ERROR: f64 = 0.1;

/// Findings on single joints: stiffness and torque at angle 0 of a spring, or the strength of the motor.
pub fn single_numbers(findings: &SwingFindings) -> Vec<SwingNumber> {
    let number = |single: &Effect, kind: JointParameter, value: f64, error: f64| SwingNumber {
        kind: kind.name(),
        joints: vec![single.of.clone()],
        estimate: Estimate { value, error },
        by_strength: 0.0,
        by_load: 0.0,
    };
    let of_single = |single: &Effect| {
        let Estimate { value, error } = single.size;
        let error = error.max(MIN_SINGLE_ERROR * value.abs());
        if single.kind == EffectKind::OddStrength {
            return vec![number(single, JointParameter::TorqueScale, 1.0 + value, error)];
        }
        // An error of the stiffness moves the torque at angle 0 with it.
        let of_torque = error * single.rest.unwrap_or_default().abs().max(1.0);
        vec![
            number(single, JointParameter::Stiffness, value, error),
            number(single, JointParameter::SpringTorque, torque_of(single), of_torque),
        ]
    };
    findings.singles().flat_map(of_single).collect()
}
