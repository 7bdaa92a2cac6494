//! The joint that is not like the others: a spring is fitted on every joint, and only those stay that no sibling has.
//!
//! Something bent, a cable, a gas strut: what a joint feels depends on its angle, and nobody knows which joint it is. A
//! first fit by least squares gives every joint a stiffness and a torque beside what else is fitted. [`judge`] compares
//! each with the same joint of the other legs. The fit proper then has springs on the odd joints alone.

use super::setup::Setup;
use super::springs::FoundSpring;
use crate::Error;
use crate::run::RunFolder;
use crate::run::inputs::Inputs;
use crate::watch::{Watch, Work};
use gaitfit_adapt::fit::{Alternative, CostOutcome, Fit, FitError, Problem};
use gaitfit_adapt::{Theta, cost::Cost};
use gaitfit_model::patterns::compile;
use gaitfit_swing::{Judged, Measured};
use serde::{Deserialize, Serialize};
use std::time::Instant;

/// File of the first fit's result, in the run folder.
const FILE: &str = "odd_joints.json";
/// Springs whose stiffness is below this share of the joint's position gain are not named: they move the joint by less
/// than this share of its target's motion.
const MIN_SHARE: f64 = 0.02;
/// If a joint's gain is not known, springs with a smaller stiffness than this are not named, N·m/rad.
const MIN_STIFFNESS: f64 = 0.2;
/// The first fit ends when its steps are smaller than this share of the entries' deviations.
const TOLERANCE: f64 = 1e-2;

/// Every joint's spring, and which joints differ from their siblings.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct OddJoints {
    /// One spring for each joint.
    pub springs: Vec<JointSpring>,
    /// Names of the joints that differ, the oddest first.
    pub odd: Vec<String>,
    /// Wall time of the first fit, s.
    pub wall_seconds: f64,
}

/// A joint's spring in the fit that has one on every joint.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub struct JointSpring {
    /// Joint name.
    pub joint: String,
    /// N·m/rad.
    pub stiffness: f64,
    /// Standard deviation of the estimate, N·m/rad; infinite, in JSON null, if it is not known.
    #[serde(deserialize_with = "or_infinite")]
    pub deviation: f64,
    /// Difference from the median of its siblings, N·m/rad.
    pub off: f64,
    /// Difference from which on the joint is odd, N·m/rad; as `deviation` if that is not known.
    #[serde(deserialize_with = "or_infinite")]
    pub limit: f64,
}

/// Reads a number that JSON has as null because it is infinite.
fn or_infinite<'de, D: serde::Deserializer<'de>>(from: D) -> Result<f64, D::Error> {
    Ok(Option::<f64>::deserialize(from)?.unwrap_or(f64::INFINITY))
}

#[derive(Serialize, Deserialize)]
struct Saved {
    inputs: Inputs,
    found: OddJoints,
}

/// Finds the odd joints, or reads what an earlier session found.
///
/// # Errors
/// A fit that cannot continue; an interruption; files that cannot be written.
pub(super) fn find(
    setup: &Setup,
    folder: &RunFolder,
    inputs: &Inputs,
    watch: &Watch<'_>,
) -> Result<OddJoints, Error> {
    // A file of other inputs, or a damaged one, is ignored and written anew.
    if let Some(text) = folder.read(FILE)?
        && let Ok(saved) = serde_json::from_str::<Saved>(&text)
        && inputs.difference(&saved.inputs).is_none()
    {
        return Ok(saved.found);
    }
    let begun = Instant::now();
    let theta = setup.with_springs(&setup.method.joints())?;
    let outcome = fit(setup, &theta, watch).map_err(|error| match error {
        FitError::Cancelled => {
            let message =
                "interrupted while comparing joints; --resume begins the comparison again".to_owned();
            Error::interrupted(message, folder.path())
        }
        error => Error::failed(error),
    })?;
    let mut odd = compare(setup, &theta, &outcome);
    odd.wall_seconds = begun.elapsed().as_secs_f64();
    // Kept, so that a fit that is interrupted later does not compare the joints again.
    folder.write_json(FILE, &Saved { inputs: inputs.clone(), found: odd.clone() })?;
    Ok(odd)
}

/// Fits `theta` by least squares from its start, with the first cost.
fn fit(setup: &Setup, theta: &Theta, watch: &Watch<'_>) -> Result<CostOutcome, FitError> {
    let mut options = setup.options.clone();
    // This fit only chooses joints; the fit proper repeats the search with all seeds. So one seed and coarse
    // steps suffice.
    options.seeds.truncate(1);
    options.tolerance = options.tolerance.max(TOLERANCE);
    let simulator = setup.fit.simulator.as_ref();
    let costs: &[Box<dyn Cost>] = &setup.costs[..1];
    let mut fit = Fit::new(simulator, theta, costs, options)?;
    let work = Work {
        what: "springs on every joint: generation",
        total: setup.options.generations,
        first: 0,
        parts: "evaluations",
        seed: None,
    };
    let stop = || watch.stop();
    let counting = watch.begin(work);
    while let Some(generation) = fit.step(&stop)? {
        let best = fit.best_costs().first().copied().flatten().unwrap_or(f64::NAN);
        counting.step(fit.generation(), generation.evaluations, &format!("{} {best:.5}", costs[0].name()));
    }
    // The line of progress must end before the next one begins.
    drop(counting);
    let outcome = fit.outcomes().into_iter().next();
    let mut outcome =
        outcome.ok_or_else(|| FitError::Scan("no step of the comparison of joints ended".into()))?;
    // Other simulators show how far a stiffness is an error of this one.
    let others: Vec<Alternative<'_>> = setup.alternatives.iter().map(|other| other.alternative()).collect();
    let (cost, draw) = (costs[0].as_ref(), outcome.draw());
    outcome.trust(Problem { simulator, theta, cost, draw, cancel: &stop }, &others)?;
    Ok(outcome)
}

/// Compares the joints of an outcome.
fn compare(setup: &Setup, theta: &Theta, outcome: &CostOutcome) -> OddJoints {
    let springs = theta.springs(&outcome.values());
    let deviation = |joint: &str| {
        let place = theta.entries().iter().position(|entry| {
            entry.kind == gaitfit_adapt::JointParameter::Stiffness.name() && entry.joints == [joint]
        });
        let known = outcome.uncertainty.as_ref().zip(place);
        // A spring without a known error is never odd.
        known.map_or(f64::INFINITY, |(uncertainty, place)| uncertainty.deviation[place])
    };
    let groups = groups(setup);
    let gains = setup.method.walking().map(|walking| walking.task.walker.interface.kp.as_slice());
    // One limit for all joints, by the softest.
    let gain = gains.unwrap_or_default().iter().copied().filter(|gain| *gain > 0.0).reduce(f64::min);
    let min = gain.map_or(MIN_STIFFNESS, |gain| MIN_SHARE * gain);
    let stiffness: Vec<Measured<'_>> = springs
        .iter()
        .map(|spring| Measured {
            group: group(&groups, &spring.joint),
            value: spring.stiffness,
            deviation: deviation(&spring.joint),
            min,
        })
        .collect();
    let judged = Judged::new(&stiffness);
    let odd = judged.odd().into_iter().map(|at| springs[at].joint.clone()).collect();
    let compared = springs.iter().enumerate().map(|(at, spring)| JointSpring {
        joint: spring.joint.clone(),
        stiffness: spring.stiffness,
        deviation: stiffness[at].deviation,
        off: judged.off[at],
        limit: judged.limit[at],
    });
    OddJoints { springs: compared.collect(), odd, wall_seconds: 0.0 }
}

/// Groups of joints with their patterns.
fn groups(setup: &Setup) -> Vec<(String, Vec<gaitfit_model::patterns::Pattern>)> {
    let groups = setup.config.groups.clone().into_iter();
    groups.filter_map(|(name, patterns)| Some((name, compile(&patterns).ok()?))).collect()
}

/// The group of a joint; itself if it is in none.
fn group<'a>(groups: &'a [(String, Vec<gaitfit_model::patterns::Pattern>)], joint: &'a str) -> &'a str {
    let has = |(_, patterns): &&(String, Vec<gaitfit_model::patterns::Pattern>)| {
        patterns.iter().any(|pattern| pattern.covers(joint))
    };
    groups.iter().find(has).map_or(joint, |(name, _)| name)
}

impl OddJoints {
    /// The findings, a sentence each; `springs`: of the fit proper.
    pub fn sentences(&self, springs: &[FoundSpring]) -> Vec<String> {
        if self.odd.is_empty() {
            let max = self.springs.iter().map(|one| one.off.abs()).fold(0.0, f64::max);
            let limit = self.springs.iter().map(|one| one.limit).fold(0.0, f64::max);
            let counts = match limit.is_finite() {
                true => format!("{limit:.2} would count"),
                false => "their errors are not known, so none counts".to_owned(),
            };
            return vec![format!(
                "no joint differs from its siblings: springs were fitted on every joint. Between the same joints of \
                 different legs they differ by at most {max:.2} N·m/rad; {counts}"
            )];
        }
        let alone = if self.odd.len() == 1 { "no other joint has" } else { "its siblings do not have" };
        let sentence = |joint: &String| {
            let spring = springs.iter().find(|spring| spring.joint == *joint)?;
            let text = spring.text();
            Some(if spring.stiffness > 0.0 {
                format!("{joint} has a spring that {alone}: {text}")
            } else {
                format!(
                    "{joint} differs from its siblings as if it had a spring of negative stiffness: {text}; its motor \
                     may be weak or its gain low"
                )
            })
        };
        self.odd.iter().filter_map(sentence).collect()
    }
}

impl Setup {
    /// Gives the fit proper springs on the joints that are odd.
    pub(super) fn take(&mut self, odd: &OddJoints) -> Result<(), Error> {
        // θ is built anew from the settings, so a second call does not add springs a second time.
        if !odd.odd.is_empty() {
            self.theta = self.with_springs(&odd.odd)?;
        }
        Ok(())
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    #[test]
    fn springs_without_known_errors_are_read_back() {
        let spring = JointSpring {
            joint: "hip".to_owned(),
            stiffness: 1.0,
            deviation: f64::INFINITY,
            off: 0.5,
            limit: f64::INFINITY,
        };
        let odd = OddJoints { springs: vec![spring], odd: Vec::new(), wall_seconds: 0.0 };
        let text = serde_json::to_string(&odd).unwrap();
        assert_eq!(serde_json::from_str::<OddJoints>(&text).unwrap(), odd, "{text}");
        assert!(odd.sentences(&[])[0].ends_with("their errors are not known, so none counts"));
    }
}
