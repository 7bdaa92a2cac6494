//! Fits parameters that the fit did not have, to see whether they explain its remaining errors.

use crate::Error;
use crate::adapt::setup::Setup;
use gaitfit_adapt::fit::{Problem, descend};
use gaitfit_adapt::{JointParameter, ParameterRule, RobotNumber, RobotRule, Sharing, Theta};
use serde::{Deserialize, Serialize};

/// Max steps of least squares for a suspect.
pub(super) const STEPS: usize = 20;
/// Step at which they end, in deviations.
pub(super) const TOLERANCE: f64 = 1e-3;
/// A suspect is named if it lowers the cost to this share. On a real Go2 other gains lower it to 0.84.
const NAMED: f64 = 0.7;
/// It replaces a simpler suspect if its cost is at most this share of the simpler one's.
const BETTER: f64 = 0.8;
/// Values that a doubt shows.
const SHOWN: usize = 6;

/// Parameters that were not fitted and explain the errors of a fit.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct Suspect {
    /// The parameters, in words.
    pub what: String,
    /// The remedy, in words: what to record or fit otherwise.
    pub remedy: String,
    /// Their names and values.
    pub values: Vec<(String, f64)>,
    /// The cost with them.
    pub cost: f64,
    /// Values of the fitted parameters with them.
    pub moved: Vec<f64>,
}

impl Suspect {
    /// Names and values, for a message.
    pub(super) fn shown(&self) -> String {
        if self.values.is_empty() {
            return String::new();
        }
        let values = self.values.iter().take(SHOWN).map(|(name, value)| format!("{name} {value:.4}"));
        let more = if self.values.len() > SHOWN { ", …" } else { "" };
        format!(" ({}{more})", values.collect::<Vec<_>>().join(", "))
    }
}

/// `other`, if it lowers the cost enough below `first`'s, or below `min`, the cost of the fit, if there is no `first`;
/// else `first`.
pub(super) fn better(first: Option<Suspect>, other: Suspect, min: f64) -> Option<Suspect> {
    let limit = first.as_ref().map_or(NAMED * min, |one| BETTER * one.cost);
    if other.cost < limit { Some(other) } else { first }
}

/// A group of parameters that may be wrong besides what is fitted.
pub(super) struct Suspicion {
    what: &'static str,
    remedy: &'static str,
    rules: Vec<ParameterRule>,
    /// Numbers of the whole robot.
    numbers: Vec<RobotRule>,
}

/// Those whose parameters are not fitted already, the simplest first.
pub(super) fn suspicions(setup: &Setup) -> Vec<Suspicion> {
    let rule = |kind, per| ParameterRule { per, ..ParameterRule::new(kind) };
    let within = |lower, upper, rule| ParameterRule { lower: Some(lower), upper: Some(upper), ..rule };
    // The bounds are wide, because a stated gain may be wrong by a large factor.
    let scale = |kind| within(0.1, 10.0, ParameterRule::new(kind));
    let suspicions = [
        Suspicion {
            what: "a delay",
            remedy: "add a [[parameter]] of kind \"delay\"",
            // The clamped simulator keeps targets for 50 ms if no delay is fitted, see `SUSPECTED_DELAY`.
            rules: vec![within(0.0, 0.05, rule(JointParameter::Delay, Sharing::All))],
            numbers: Vec::new(),
        },
        Suspicion {
            what: "what resists motion",
            remedy: "fit frictionloss, armature and damping together",
            rules: [JointParameter::FrictionLoss, JointParameter::Armature, JointParameter::Damping]
                .map(ParameterRule::new)
                .to_vec(),
            numbers: Vec::new(),
        },
        Suspicion {
            what: "other gains",
            remedy: "check kp and kd in the log and in [gains]; if they are right, the motors are weaker or stronger \
                     than stated: fit kp_scale and kd_scale",
            rules: vec![scale(JointParameter::KpScale), scale(JointParameter::KdScale)],
            numbers: Vec::new(),
        },
        Suspicion {
            what: "other encoder offsets",
            remedy: "check the zeros of the joints' positions, or fit encoder_bias with per = \"joint\"",
            rules: vec![within(-0.3, 0.3, rule(JointParameter::EncoderBias, Sharing::Joint))],
            numbers: Vec::new(),
        },
        Suspicion {
            what: "joint velocities that are read late",
            remedy: "add a [[number]] of kind \"velocity_lag\"",
            rules: Vec::new(),
            numbers: vec![RobotRule::new(RobotNumber::VelocityLag)],
        },
    ];
    let fitted_number = |kind: RobotNumber| setup.config.number.iter().any(|rule| rule.kind == kind);
    let fitted = |kind: JointParameter| setup.config.parameter.iter().any(|rule| rule.kind == kind);
    // Only parameters that the fit does not have can explain its remaining errors.
    let open = |mut one: Suspicion| {
        one.rules.retain(|rule| !fitted(rule.kind));
        one.numbers.retain(|rule| !fitted_number(rule.kind));
        (!(one.rules.is_empty() && one.numbers.is_empty())).then_some(one)
    };
    suspicions.into_iter().filter_map(open).collect()
}

impl Suspicion {
    /// Fits its parameters besides, from `values` on, to see what they explain. `None` if they cannot be fitted.
    pub(super) fn tried(
        self,
        setup: &Setup,
        problem: Problem<'_>,
        values: &[f64],
    ) -> Result<Option<Suspect>, Error> {
        // A suspicion is only tried: one that this robot cannot have does not stop the fit.
        let Ok(theta) = beside(setup, self.rules, self.numbers) else { return Ok(None) };
        // Fitted parameters begin where the fit ended, new ones at their start.
        let fitted = setup.theta.entries();
        let place = |name: &str| fitted.iter().position(|entry| entry.name == name);
        let start: Vec<f64> = theta
            .entries()
            .iter()
            .map(|entry| place(&entry.name).map_or(entry.start, |at| values[at]))
            .collect();
        let problem = Problem { theta: &theta, ..problem };
        let minimum = descend(problem, &start, STEPS, TOLERANCE).map_err(Error::failed)?;
        let Some((end, cost)) = minimum else { return Ok(None) };
        let mut suspect = Suspect {
            what: self.what.to_owned(),
            remedy: self.remedy.to_owned(),
            values: Vec::new(),
            cost,
            moved: values.to_vec(),
        };
        // The result is split: how far the fit's values move, and the values of the new ones.
        for (entry, value) in theta.entries().iter().zip(&end) {
            match place(&entry.name) {
                Some(at) => suspect.moved[at] = *value,
                None => suspect.values.push((entry.name.clone(), *value)),
            }
        }
        Ok(Some(suspect))
    }
}

/// θ with further parameters.
fn beside(setup: &Setup, more: Vec<ParameterRule>, numbers: Vec<RobotRule>) -> Result<Theta, Error> {
    let joints: Vec<String> = setup.method.model().joints.iter().map(|joint| joint.name.clone()).collect();
    let mut rules = setup.config.rules();
    for rule in more {
        rules.parameter.extend(rule.by_kind(setup.method.model(), true).map_err(Error::settings)?);
    }
    rules.robot.extend(numbers);
    rules.resolve();
    rules.theta(&setup.config.groups(&joints), &joints, &vec![0.0; joints.len()]).map_err(Error::settings)
}
