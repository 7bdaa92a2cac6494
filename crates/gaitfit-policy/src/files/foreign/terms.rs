//! Names of observation terms in Isaac Lab and its relatives.

use crate::Quantity;

/// The quantity of a term as Isaac Lab, mjlab and unitree_rl_lab name it in their velocity tasks.
pub(super) fn quantity(name: &str) -> Option<Quantity> {
    Some(match name {
        "base_lin_vel" => Quantity::BaseLinearVelocity,
        "base_ang_vel" => Quantity::BaseAngularVelocity,
        "projected_gravity" => Quantity::ProjectedGravity,
        "joint_pos" | "joint_pos_rel" => Quantity::JointPosition,
        "joint_vel" | "joint_vel_rel" => Quantity::JointVelocity,
        "actions" | "last_action" => Quantity::LastAction,
        "command" | "velocity_commands" => Quantity::Command,
        _ => return None,
    })
}

/// What to say of a term without a quantity.
pub(super) fn unknown(name: &str) -> String {
    format!(
        "it observes `{}`, which gaitfit does not know. It knows base_lin_vel, base_ang_vel, projected_gravity, \
         joint_pos, joint_vel, actions and command of a velocity task",
        gaitfit_model::shown(name)
    )
}

/// The name of a quantity in unitree_rl_lab's deployment, where it is registered.
pub(in crate::files) fn name(quantity: Quantity) -> &'static str {
    match quantity {
        Quantity::BaseLinearVelocity => "base_lin_vel",
        Quantity::BaseAngularVelocity => "base_ang_vel",
        Quantity::ProjectedGravity => "projected_gravity",
        Quantity::JointPosition => "joint_pos_rel",
        Quantity::JointVelocity => "joint_vel_rel",
        Quantity::LastAction => "last_action",
        Quantity::Command => "velocity_commands",
        Quantity::GaitPhase => "gait_phase",
    }
}
