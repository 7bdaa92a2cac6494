//! Limits parameter rules over all joints of a walking robot to the joints that they can affect.

use crate::Error;
use gaitfit_adapt::{JointParameter, ParameterRule, Sharing};
use gaitfit_model::{patterns, shown};
use gaitfit_policy::Interface;

/// Parameters that a wheel does not have: its controller has no kp, and its angle has neither a zero nor a place of rest.
const NOT_FOR_WHEELS: [JointParameter; 4] = [
    JointParameter::KpScale,
    JointParameter::EncoderBias,
    JointParameter::Stiffness,
    JointParameter::SpringTorque,
];

/// Limits rules over all joints to joints that they can affect. Rules with values for joints or groups cover only joints that
/// the policy moves: held joints hardly move, and logs often lack them. Rules about angles cover no wheels. Rules that name
/// joints stay as they are. `joints`: all joints of the robot.
///
/// # Errors
/// A rule about angles whose patterns cover a wheel.
pub fn limit(rules: &mut [ParameterRule], interface: &Interface, joints: &[String]) -> Result<(), Error> {
    let moves = |joint: &String| interface.joints.contains(joint);
    let is_wheel = |joint: &String| interface.velocity_joints.contains(joint);
    let any_moves = joints.iter().any(moves);
    for rule in rules.iter_mut().filter(|rule| rule.joints == ["*"]) {
        let about_angles = NOT_FOR_WHEELS.contains(&rule.kind);
        // One value for all joints needs no joint that shows it alone; and without any moved joint nothing is
        // limited.
        let only_moved = rule.per != Sharing::All && any_moves;
        let has_effect =
            |joint: &&String| (moves(joint) || !only_moved) && !(is_wheel(joint) && about_angles);
        let kept: Vec<String> = joints.iter().filter(has_effect).cloned().collect();
        // A rule that keeps all joints stays "*". One that would lose all of them is left to the check below.
        if !kept.is_empty() && kept.len() < joints.len() {
            rule.joints = kept;
        }
    }
    // Rules that name joints are not changed, so a wheel in them is refused.
    let names: Vec<&str> = joints.iter().map(String::as_str).collect();
    for rule in rules.iter().filter(|rule| NOT_FOR_WHEELS.contains(&rule.kind)) {
        // Patterns that match nothing are refused elsewhere.
        let covered = patterns::covered(&rule.joints, "the robot", &names).unwrap_or_default();
        if let Some(&wheel) = covered.iter().find(|&&joint| is_wheel(&joints[joint])) {
            let kind = rule.kind.name();
            return Err(Error::settings(format!(
                "a [[parameter]] of kind \"{kind}\" covers `{}`, but {kind} does not apply to joints with velocity targets: leave this \
                 joint out of `joints`.",
                shown(&joints[wheel])
            )));
        }
    }
    Ok(())
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use crate::walk::fixtures::{policy, scene};

    #[test]
    fn held_joints_and_wheels_are_left_out_of_rules_over_all_joints() {
        let mut interface = policy(&scene(), 1).interface;
        let joints = interface.joints.clone();
        let kinds = [JointParameter::KpScale, JointParameter::EncoderBias, JointParameter::Damping];
        let rules = kinds.map(ParameterRule::new);
        let limited = |rules: &[ParameterRule], interface: &Interface| {
            let mut rules = rules.to_vec();
            limit(&mut rules, interface, &joints).unwrap();
            rules.into_iter().map(|rule| rule.joints).collect::<Vec<_>>()
        };
        let star = vec!["*".to_owned()];
        assert_eq!(limited(&rules, &interface), vec![star.clone(); 3]);
        interface.velocity_joints = vec![joints[2].clone()];
        let others: Vec<String> = joints.iter().filter(|name| **name != joints[2]).cloned().collect();
        assert_eq!(limited(&rules, &interface), [others.clone(), others, star.clone()]);
        let named =
            ParameterRule { joints: vec![joints[2].clone()], ..ParameterRule::new(JointParameter::KpScale) };
        let error = limit(&mut [named.clone()], &interface, &joints).unwrap_err().to_string();
        assert!(error.contains("kp_scale") && error.contains(&joints[2]), "{error}");
        interface.velocity_joints.clear();
        assert_eq!(limited(&[named], &interface), [vec![joints[2].clone()]]);
        interface.joints.truncate(8);
        let one = ParameterRule { per: Sharing::All, ..rules[2].clone() };
        assert_eq!(limited(&[rules[2].clone(), one], &interface), [interface.joints.clone(), star]);
    }
}
