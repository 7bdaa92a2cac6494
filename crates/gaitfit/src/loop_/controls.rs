//! Policies that a loop's policy is compared with: trained as long from the same policy, for the same rewards, without
//! any logs. Domain randomisation among them is what there is without a fit, so it is what a fit has to beat.

use super::results::{DRAWN, KNOWN, Measurement, NOMINAL, RANDOMISED, RoundResult, TARGET, tracking_error};
use super::settled;
use super::setup::Setup;
use super::stages::{Stages, measurement};
use super::training_robot::TrainingRobot;
use crate::Error;
use crate::evaluate::{Better, Comparison, compare};
use crate::target::{PolicyFiles, Target};
use gaitfit_view::Estimate;
use std::path::PathBuf;

/// Names of the controls, and their folders.
pub const PLACES: [(&str, &str); 4] =
    [(NOMINAL, "nominal"), (RANDOMISED, "randomised"), (DRAWN, "draws"), (KNOWN, "truth")];

/// One of them: its name, its folder, and the simulator that it is trained in.
pub type Control = (&'static str, &'static str, TrainingRobot);

/// Returns the controls that are trained after a round with a fit, or without one.
///
/// # Errors
/// A file of numbers that cannot be read.
pub fn wanted(
    setup: &Setup,
    target: Option<&Target>,
    round: Option<&RoundResult>,
) -> Result<Vec<Control>, Error> {
    let controls = &setup.config.controls;
    // Without a measurement nobody would see what the controls are good for.
    if !target.is_some_and(Target::measures) {
        return Ok(Vec::new());
    }
    let drawn = round.filter(|_| controls.draws).map(|round| {
        let settled = settled::of_round(round)?;
        Ok(TrainingRobot::fitted(PathBuf::from(&round.theta), settled).drawn())
    });
    let known = controls.truth.as_ref().zip(setup.known.as_ref());
    let known = known.map(|(truth, theta)| TrainingRobot::known(theta, truth));
    // In the order of `PLACES`; each is absent if it was not asked for.
    let robots = [
        controls.nominal.then(|| Ok(TrainingRobot::nominal())),
        controls.randomised.then(|| Ok(TrainingRobot::randomised(controls))),
        drawn,
        known,
    ];
    // Both lists have the same order.
    let named = robots.into_iter().zip(PLACES);
    named.filter_map(|(robot, (name, place))| Some(robot?.map(|robot| (name, place, robot)))).collect()
}

/// Stages that they take after a fit.
pub fn count(setup: &Setup, target: Option<&Target>) -> usize {
    let controls = &setup.config.controls;
    let asked = [controls.nominal, controls.randomised, controls.draws, controls.truth.is_some()];
    // A training and a measurement each.
    if target.is_some_and(Target::measures) { 2 * asked.into_iter().filter(|&one| one).count() } else { 0 }
}

/// Trains and measures them. `round`: the one that trained the policy that they are compared with; `trainings`: how many the policy had that they are
/// compared with.
///
/// # Errors
/// As the stages.
pub fn run(
    stages: &mut Stages<'_>,
    policies: &[PolicyFiles],
    round: Option<&RoundResult>,
    trainings: usize,
    evaluations: &mut Vec<Measurement>,
) -> Result<(), Error> {
    let Some(first) = policies.first() else { return Ok(()) };
    for (name, folder, robot) in wanted(stages.setup, stages.target.as_ref(), round)? {
        // As many iterations in all as the loop's policy had in its rounds.
        let robot = TrainingRobot { times: u32::try_from(trainings).unwrap_or(u32::MAX), ..robot };
        let (_, _, bytes) = stages.finetune(&format!("controls/{folder}"), first, &robot)?;
        let policy = stages.keep(name, folder, &bytes)?;
        evaluations.extend(measurement(TARGET, stages.on_target(folder, &policy)?));
    }
    Ok(())
}

/// The policy called `after` beside all others where it was measured: on the target, or else in the last fitted simulator.
pub fn comparisons(after: &str, evaluations: &[Measurement]) -> Vec<Comparison> {
    let is_after = |one: &&Measurement| one.evaluation.policy == after;
    let on_target = |one: &&Measurement| one.on == TARGET;
    let reference = evaluations.iter().filter(is_after).find(on_target);
    // From the end: the newest fitted simulator is the last one.
    let Some(reference) = reference.or_else(|| evaluations.iter().rfind(is_after)) else { return Vec::new() };
    let others = evaluations.iter().filter(|one| one.on == reference.on && !is_after(one));
    others.map(|other| compare(&reference.on, &reference.evaluation, &other.evaluation)).collect()
}

/// States the gain of the fit over the best training without logs: over randomisation, or else over the
/// nominal simulator.
pub fn bought(comparisons: &[Comparison], evaluations: &[Measurement]) -> Option<String> {
    let against = |name: &str| comparisons.iter().find(|one| one.against == name);
    // Randomisation is the stronger rival; a gain over the nominal simulator alone says less.
    let (comparison, than) = against(RANDOMISED)
        .map(|comparison| (comparison, "domain randomisation"))
        .or_else(|| against(NOMINAL).map(|comparison| (comparison, "the nominal simulator")))?;
    let error = |policy: &str| -> Option<f64> {
        let measured = |one: &&Measurement| one.on == comparison.on && one.evaluation.policy == policy;
        evaluations.iter().find(measured).map(|one: &Measurement| tracking_error(&one.evaluation))
    };
    let (fitted, other) = (error(&comparison.policy)?, error(&comparison.against)?);
    let less = |small: f64, large: f64| {
        let share = 100.0 * (1.0 - small / large);
        // Without a finite share the sentence states no percentage.
        if share.is_finite() { format!("{share:.0} % ") } else { String::new() }
    };
    // The sentence ends with the numbers, so that nobody has to believe its words.
    let numbers = comparison.numbers();
    Some(match comparison.better() {
        Better::Policy => {
            format!("The fit gave {}less tracking error than {than}: {numbers}.", less(fitted, other))
        }
        // One of both errors may be smaller beyond chance though their sum is not.
        Better::Neither => match less_of(comparison) {
            Some(which) => format!(
                "The fit gave less {which} error than {than}, but the sum of both errors does not differ from \
                 chance: {numbers}."
            ),
            None => {
                format!("The fit's gain over {than} does not differ from chance: {numbers}.")
            }
        },
        Better::Other => format!(
            "The fit gave nothing: a policy trained with {than} and no logs has {}less tracking error. Fitted minus \
             other: {numbers}.",
            less(other, fitted)
        ),
    })
}

/// Name of the error that is smaller beyond chance; `None` if neither is.
fn less_of(comparison: &Comparison) -> Option<&'static str> {
    // The whole 95 % interval is below zero.
    let less = |difference: Estimate| difference.mean + difference.ci95 < 0.0;
    match (less(comparison.linear_velocity_error), less(comparison.angular_velocity_error)) {
        (true, _) => Some("linear"),
        (_, true) => Some("angular"),
        _ => None,
    }
}

/// Warns that the policy is no better than one trained without logs.
pub fn warning(comparison: &Comparison) -> Option<String> {
    let without_logs = [NOMINAL, RANDOMISED].contains(&comparison.against.as_str());
    (without_logs && comparison.better() != Better::Policy).then(|| {
        format!(
            "{} tracks no better than the policy {}, which was trained without logs",
            comparison.policy, comparison.against
        )
    })
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::evaluate::Evaluation;

    fn measured(policy: &str, on: &str, errors: impl Fn(u32) -> f64) -> Measurement {
        let rows: Vec<[f64; 3]> = (0..100).map(|k| [errors(k), 0.1, 0.0]).collect();
        let mean = rows.iter().map(|row| row[0]).sum::<f64>() / rows.len() as f64;
        let estimate = |mean: f64| serde_json::json!({ "mean": mean, "ci95": 0.05 });
        let document = serde_json::json!({
            "policy": policy, "seconds": 4.0, "trajectories": 100, "errors": rows,
            "linear_velocity_error": estimate(mean), "angular_velocity_error": estimate(0.1),
            "fall_rate": estimate(0.0),
        });
        let evaluation: Evaluation = serde_json::from_value(document).unwrap();
        assert!(evaluation.wrong().is_none());
        Measurement { on: on.to_owned(), evaluation }
    }

    /// Returns the text and warnings for π₁ with this much more error than the randomised policy, and of the
    /// nominal one 0.2 worse.
    fn said(more: f64) -> (Option<String>, Vec<String>) {
        let hard = |k: u32| 0.2 + f64::from(k % 10) / 20.0;
        let noise = |k: u32| if k.is_multiple_of(2) { 0.004 } else { -0.004 };
        let evaluations = [
            measured("π₀", TARGET, |k| hard(k) + 0.3),
            measured("π₁", TARGET, |k| hard(k) + more + noise(k)),
            measured("π₁", "adapted", |_| 9.0),
            measured(NOMINAL, TARGET, |k| hard(k) + 0.2),
            measured(RANDOMISED, TARGET, hard),
        ];
        let comparisons = comparisons("π₁", &evaluations);
        assert_eq!(comparisons.len(), 3, "the same place, each once");
        assert!(comparisons.iter().all(|one| one.paired && one.on == TARGET));
        (bought(&comparisons, &evaluations), comparisons.iter().filter_map(warning).collect())
    }

    #[test]
    fn what_the_fit_bought_is_said_as_it_is() {
        let (text, warnings) = said(-0.05);
        assert!(
            text.as_ref().unwrap().starts_with("The fit gave 10 % less tracking error than domain"),
            "{text:?}"
        );
        assert!(text.unwrap().contains("linear error -0.0500 ± 0.0008 m/s") && warnings.is_empty());
        let (text, warnings) = said(0.0001);
        assert!(text.unwrap().contains("gain over domain randomisation does not differ from chance"));
        assert_eq!(warnings.len(), 1);
        let mixed = Comparison {
            linear_velocity_error: Estimate { mean: -0.012, ci95: 0.003 },
            tracking_error: Estimate { mean: -0.006, ci95: 0.007 },
            ..comparisons("π₁", &[measured("π₁", TARGET, |_| 0.1), measured(RANDOMISED, TARGET, |_| 0.1)])[0]
                .clone()
        };
        let evaluations = [measured("π₁", TARGET, |_| 0.1), measured(RANDOMISED, TARGET, |_| 0.1)];
        assert!(
            bought(&[mixed], &evaluations)
                .unwrap()
                .contains("less linear error than domain randomisation, but")
        );
        let (text, warnings) = said(0.05);
        assert!(text.unwrap().contains("no logs has 9 % less tracking error"), "{warnings:?}");
        assert!(warnings[0].contains(RANDOMISED), "{warnings:?}");
        assert_eq!(bought(&[], &[]), None);
    }
}
