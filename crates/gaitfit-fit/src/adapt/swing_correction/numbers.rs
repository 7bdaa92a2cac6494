//! The numbers that legs in the air show, as a list: friction, damping and armature of each joint group, then the delay.

use crate::walk::swing::{Estimate, GroupEstimate, SwingReport};
use gaitfit_adapt::{JointParameter, ParameterRule, Sharing, Theta, ThetaError};
use gaitfit_model::Model;

/// The names of the joint groups.
pub(super) fn groups_of(report: &SwingReport) -> impl Iterator<Item = &str> {
    report.groups.iter().map(|group| group.group.as_str())
}

/// Numbers of each robot: those that are estimated, and the torque noise.
pub(super) fn numbers_of(report: &SwingReport) -> usize {
    values_of(report).len() + 1
}

/// Friction, damping and armature of each group, then the delay.
pub(super) fn values_of(report: &SwingReport) -> Vec<f64> {
    // `slots` gives places to write to, so that there is one order for reading and for writing.
    slots(&mut report.clone()).map(|one| one.value).collect()
}

/// The kind of each value, as its index in `MIN_ERRORS`.
pub(super) fn kinds(count: usize) -> impl Iterator<Item = usize> {
    // Three numbers for each group, and the delay as the last one of all.
    (0..count).map(move |at| if at + 1 < count { at % 3 } else { 3 })
}

/// Standard errors of the values.
pub(super) fn errors_of(report: &SwingReport) -> Vec<f64> {
    slots(&mut report.clone()).map(|one| one.error).collect()
}

/// The estimates, in the order of [`values_of`].
pub(super) fn slots(report: &mut SwingReport) -> impl Iterator<Item = &mut Estimate> {
    let groups = report.groups.iter_mut();
    groups
        .flat_map(|group| [&mut group.friction, &mut group.damping, &mut group.armature])
        .chain([&mut report.delay])
}

/// The numbers that `report` estimates, in its order.
pub(super) fn theta_of(report: &SwingReport, model: &Model) -> Result<Theta, ThetaError> {
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
    // The entries of θ have the order of `values_of`, so that lists of values fit both.
    let rules: Vec<ParameterRule> = report.groups.iter().flat_map(of_group).chain([delay]).collect();
    Theta::from_rules(&rules, &[], &joints)
}
