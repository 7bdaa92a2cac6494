//! Priors of a fit from estimates that need no simulation: of joints (legs in the air) and of sensors.

use crate::walk::swing::{Estimate, SwingNumber};
use gaitfit_adapt::{Entry, JointParameter, Prior, SavedParameter, Theta, ThetaFile};
use gaitfit_model::patterns::compile;
use gaitfit_model::shown;
use std::collections::BTreeMap;
use std::path::Path;

/// Min standard error of a prior, as a part of the entry's range. With a smaller one walks could not change the value.
const MIN_ERROR: f64 = 0.005;

/// Whether an estimate is of this kind and covers all these joints. An estimate without joints covers all of them; a number of
/// the whole robot has none.
fn covers(number: &SwingNumber, kind: &str, joints: &[String]) -> bool {
    let covered = |joint| number.joints.is_empty() || number.joints.contains(joint);
    number.kind == kind && (number.joints.is_empty() || !joints.is_empty()) && joints.iter().all(covered)
}

/// A friction estimate above this multiple of the search's upper bound is wrong.
const IMPOSSIBLE: f64 = 2.0;

/// The `given` priors, and priors from `measured` estimates for the other entries of `theta`. An entry whose joints belong to
/// several estimates takes none of them.
pub fn priors(
    theta: &Theta,
    measured: &[SwingNumber],
    given: &BTreeMap<String, Prior>,
) -> BTreeMap<String, Prior> {
    // What the user states wins over what is measured.
    let mut priors = given.clone();
    // A joint that moves in the air has less friction than its motor has torque. A weakly driven one, such as a humanoid's
    // ankle with a small gain, may seem to have tens of times more; then its swings do not show its other numbers either.
    let impossible: Vec<&SwingNumber> = theta
        .entries()
        .iter()
        .filter(|entry| entry.kind == JointParameter::FrictionLoss.name())
        .filter_map(|entry| {
            let beyond = |one: &&SwingNumber| {
                covers(one, entry.kind, &entry.joints) && one.estimate.value > IMPOSSIBLE * entry.upper
            };
            measured.iter().find(beyond)
        })
        .collect();
    let possible =
        |one: &SwingNumber| !impossible.iter().any(|bad| !one.joints.is_empty() && bad.joints == one.joints);
    // An entry takes the first possible estimate that covers all its joints.
    for entry in theta.entries() {
        let measurement = measured.iter().filter(|one| possible(one)).find(|one| {
            let Estimate { value, error } = one.estimate;
            covers(one, entry.kind, &entry.joints) && value.is_finite() && error.is_finite() && error > 0.0
        });
        if let Some(one) = measurement {
            let Estimate { value, error } = one.estimate;
            let deviation = error.max(MIN_ERROR * (entry.upper - entry.lower));
            let prior =
                Prior { by_strength: one.by_strength, by_load: one.by_load, ..Prior::new(value, deviation) };
            priors.entry(entry.name.clone()).or_insert(prior);
        }
    }
    priors
}

/// Values of the file `known` at `path` that entries of `theta` replace, one sentence each.
pub fn replaced(known: &ThetaFile, path: &Path, theta: &Theta) -> Vec<String> {
    let sentence = |saved: &SavedParameter| {
        let patterns = compile(&saved.joints).unwrap_or_default();
        let shared = |entry: &&Entry| {
            let covers = |joint: &String| patterns.iter().any(|pattern| pattern.covers(joint));
            entry.kind == saved.kind && (entry.joints.is_empty() || entry.joints.iter().any(covers))
        };
        let searched: Vec<&str> =
            theta.entries().iter().filter(shared).map(|entry| entry.name.as_str()).collect();
        (!searched.is_empty()).then(|| {
            format!(
                "{}: it states `{}`, and the fit searches {}: the fitted value replaces the stated one. Leave one of them out",
                path.display(),
                shown(&saved.name),
                searched.join(", ")
            )
        })
    };
    known.parameter.iter().filter_map(sentence).collect()
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::walk::swing::{Standing, SwingFindings, sensor_numbers};
    use gaitfit_adapt::{ParameterRule, RobotNumber, RobotRule, Rules, Sharing};
    use gaitfit_log::Sensors;

    #[test]
    fn a_known_value_that_is_searched_too_is_named() {
        let joints = ["FL_hip", "FL_calf"].map(str::to_owned).to_vec();
        let rules = [
            ParameterRule { per: Sharing::Joint, ..ParameterRule::new(JointParameter::FrictionLoss) },
            ParameterRule { per: Sharing::All, ..ParameterRule::new(JointParameter::Delay) },
        ];
        let theta = Theta::from_rules(&rules, &[], &joints).unwrap();
        let known = |kind: &str, joints: &str| {
            let text = format!(
                "format = 2\n[[parameter]]\nname = 'x'\nkind = '{kind}'\njoints = {joints}\nvalue = 0.1\n"
            );
            replaced(&ThetaFile::parse(&text).unwrap(), Path::new("mine.toml"), &theta)
        };
        let messages = known("frictionloss", "['*_calf']");
        assert_eq!(messages.len(), 1);
        assert!(
            messages[0].contains("mine.toml") && messages[0].contains("searches frictionloss_FL_calf:"),
            "{messages:?}"
        );
        assert_eq!(known("armature", "['*_calf']"), Vec::<String>::new(), "it is not searched");
        assert_eq!(known("frictionloss", "['*_thigh']"), Vec::<String>::new(), "another joint's");
    }

    #[test]
    fn estimates_reach_the_entries_of_their_joints_and_what_is_given_wins() {
        let joints = ["FL_hip", "FR_hip", "FL_calf", "FR_calf"].map(str::to_owned).to_vec();
        let groups = ["hip", "calf"].map(|name| (name.to_owned(), vec![format!("*_{name}")]));
        let rules = [
            ParameterRule::new(JointParameter::FrictionLoss),
            ParameterRule { per: Sharing::All, ..ParameterRule::new(JointParameter::Delay) },
            ParameterRule { per: Sharing::All, ..ParameterRule::new(JointParameter::Armature) },
        ];
        let theta = Theta::from_rules(&rules, &groups, &joints).unwrap();
        let measured = |kind: JointParameter, of: &[usize], value, error| SwingNumber {
            by_strength: 0.0,
            by_load: 0.0,
            kind: kind.name(),
            joints: of.iter().map(|joint| joints[*joint].clone()).collect(),
            estimate: Estimate { value, error },
        };
        let all = [
            measured(JointParameter::FrictionLoss, &[0, 1], -0.01, 0.05),
            measured(JointParameter::FrictionLoss, &[2, 3], 0.55, 1e-6),
            measured(JointParameter::Armature, &[0, 1], 0.01, 0.002),
            measured(JointParameter::Delay, &[], 0.009, f64::NAN),
            measured(JointParameter::Delay, &[], 0.008, 0.002),
        ];
        let estimates = priors(&theta, &all, &BTreeMap::new());
        assert_eq!(estimates["frictionloss_hip"], Prior::new(-0.01, 0.05));
        assert_eq!(estimates["frictionloss_calf"], Prior::new(0.55, 0.0025), "half a hundredth of [0, 0.5]");
        assert_eq!(estimates["delay"], Prior::new(0.008, 0.002));
        assert!(
            !estimates.contains_key("armature"),
            "one value for all joints, measured of hips alone: {estimates:?}"
        );
        let swings = [
            measured(JointParameter::FrictionLoss, &[2, 3], 39.0, 14.6),
            measured(JointParameter::Damping, &[2, 3], 0.0, 0.1),
            measured(JointParameter::FrictionLoss, &[0, 1], 0.3, 0.05),
        ];
        let damped = [rules[0].clone(), ParameterRule::new(JointParameter::Damping)];
        let theta_of_swings = Theta::from_rules(&damped, &groups, &joints).unwrap();
        let estimates = priors(&theta_of_swings, &swings, &BTreeMap::new());
        assert_eq!(estimates.keys().collect::<Vec<_>>(), ["frictionloss_hip"], "39 N·m is no friction");
        let stated = BTreeMap::from([("delay".to_owned(), Prior::new(0.02, 0.001))]);
        assert_eq!(priors(&theta, &all, &stated)["delay"], stated["delay"]);
        // Errors of sensors are of no joint.
        let robot = [RobotNumber::ImuPitch, RobotNumber::VelocityLag].map(RobotRule::new).to_vec();
        let theta = Rules { robot, ..Rules::default() }.theta(&groups, &joints, &[]).unwrap();
        let sure = |value| Estimate { value, error: 0.0001 };
        let shown = SwingFindings {
            standing: Standing { tilt: Some([sure(0.02); 2]) },
            sensors: Sensors { velocity_lag: Some(sure(0.006)), ..Sensors::default() },
            ..SwingFindings::default()
        };
        let all: Vec<SwingNumber> = all.into_iter().chain(sensor_numbers(&shown, Some(0.005))).collect();
        let estimates = priors(&theta, &all, &BTreeMap::new());
        assert_eq!(estimates["imu_pitch"], Prior::new(0.02, 0.003));
        assert!((estimates["velocity_lag"].value - 0.0035).abs() < 1e-12, "less half a step: {estimates:?}");
        assert_eq!((estimates["velocity_lag"].deviation, estimates.len()), (0.002, 2));
    }
}
