//! Observation terms of Isaac Lab and its relatives that are not read.

use gaitfit_policy::Quantity;

/// The quantities of a term of a policy that follows a motion, as mjlab and BeyondMimic name them.
pub(super) fn of_motion(name: &str) -> Option<&'static [Quantity]> {
    match name {
        "command" | "generated_commands" | "motion" => {
            Some(&[Quantity::ReferenceJointPosition, Quantity::ReferenceJointVelocity])
        }
        "motion_anchor_ori_b" => Some(&[Quantity::ReferenceOrientation]),
        _ => None,
    }
}

/// Whether only policies that follow a motion have a term of this name.
pub(super) fn is_of_tracking(name: &str) -> bool {
    name == "motion_anchor_ori_b"
}

/// Message about a term without a quantity.
pub(super) fn unknown(name: &str) -> String {
    if name == "motion_anchor_pos_b" {
        return "it observes `motion_anchor_pos_b`, for which it needs the robot's place in the world: robots do not measure it. \
                Train one without state estimation, as mjlab and BeyondMimic call it"
            .to_owned();
    }
    let known = Quantity::ALL.iter().filter_map(|quantity| quantity.foreign().last().copied());
    let known: Vec<&str> = known.filter(|name| Quantity::from_foreign(name).is_some()).collect();
    format!(
        "it observes `{}`, which gaitfit does not know. It knows {} of a velocity task",
        gaitfit_model::shown(name),
        known.join(", ")
    )
}
