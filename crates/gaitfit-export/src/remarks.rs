//! Numbers that Isaac Lab's actuators have no setting for, and what takes their place.

use gaitfit_adapt::{JointParameter, RobotNumber};
use gaitfit_model::Model;
use gaitfit_sim::Candidate;

/// Kinds of parameters, and what says them. Names before a colon are those of theta.json.
const REMARKS: &[(&[&str], &str)] = &[
    (&["encoder_bias"], "encoder_bias: subtract it from position targets"),
    (&["torque_offset"], "torque_offset: add it as a joint effort target"),
    (
        &["stiction", "stribeck_velocity"],
        "stribeck_velocity: friction falls from `friction` to `dynamic_friction` there at once",
    ),
    (
        &["load_friction"],
        "load_friction: add it times the absolute joint effort to `friction` and `dynamic_friction` at every physics step",
    ),
    (
        &["play", "compliance"],
        "play, compliance: a second joint between motor and link, with a spring of stiffness 1 / compliance in a gap of that \
         width",
    ),
    (
        &["no_load_speed", "stall_torque"],
        "no_load_speed, stall_torque: DCMotorCfg's velocity_limit and saturation_effort; it has no delay",
    ),
    (
        &["stiffness", "spring_torque"],
        "stiffness, spring_torque: add spring_torque - stiffness * q as an effort",
    ),
    (&["torque_noise"], "torque_noise: add normal numbers to the joint efforts at every physics step"),
    (
        &["imu_roll", "imu_pitch", "gyro_bias_x", "gyro_bias_y", "gyro_bias_z"],
        "imu_roll, imu_pitch, gyro_bias: drive.imu reads projected_gravity and base_ang_vel so; put it into their observation \
         terms",
    ),
    (
        &["imu_delay"],
        "imu_delay: drive.LateImu reads projected_gravity and base_ang_vel so; put it into their observation terms",
    ),
    (
        &["velocity_lag"],
        "velocity_lag: drive.Velocities reads joint_vel so; put it into its observation term",
    ),
    (
        &["ground_softness"],
        "ground_softness: softer contacts (compliant_contact_stiffness and _damping of the ground's material)",
    ),
    (
        &["ground_impedance"],
        "ground_impedance: firmer contacts at first touch; no setting is needed where the simulator's contacts are rigid",
    ),
    (&["floor_friction"], "friction_factor: multiply the friction of the ground's material"),
    (
        &["base_mass", "payload_mass", "payload_x", "payload_y", "payload_z"],
        "base: an event term randomize_rigid_body_mass with a constant",
    ),
    (
        &["base_com_x", "base_com_y", "base_com_z"],
        "base: shift the centre of mass of the base by com, an event term randomize_rigid_body_com with a constant",
    ),
    (
        &["link_mass", "link_com_x", "link_com_y", "link_com_z"],
        "links: scale mass and inertia of these bodies by mass_factor and shift their centres of mass",
    ),
];

/// Kinds that do nothing without the kinds beside them in a row: they alone are no reason for a remark.
const DEPENDENT: [&str; 5] = ["stribeck_velocity", "stall_torque", "payload_x", "payload_y", "payload_z"];

/// A remark for each kind of parameter in which the robot differs from its model.
pub(super) fn remarks(model: &Model, candidate: &Candidate) -> Vec<&'static str> {
    let nominal = Candidate::nominal(model);
    let differs = |kind: &str| {
        let joints = JointParameter::searched().find(|one| one.name() == kind);
        let number = RobotNumber::ALL.iter().find(|one| one.name() == kind);
        joints.is_some_and(|one| candidate.robot.joints(one) != nominal.robot.joints(one))
            || number.is_some_and(|one| one.value(candidate) != one.value(&nominal))
    };
    let mut remarks: Vec<&str> = REMARKS
        .iter()
        .filter(|(kinds, _)| kinds.iter().any(|kind| !DEPENDENT.contains(kind) && differs(kind)))
        .map(|&(_, remark)| remark)
        .collect();
    if !candidate.networks.is_empty() {
        remarks.push("networks: drive.py evaluates them");
    }
    remarks
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Kinds among the settings of Isaac Lab's actuators.
    const SETTINGS: [&str; 7] =
        ["frictionloss", "armature", "damping", "delay", "torque_scale", "kp_scale", "kd_scale"];

    #[test]
    fn every_kind_has_a_setting_or_a_remark() {
        let joints = JointParameter::searched().map(JointParameter::name);
        for kind in joints.chain(RobotNumber::ALL.iter().map(|one| one.name())) {
            let remarked = REMARKS.iter().filter(|(kinds, _)| kinds.contains(&kind)).count();
            assert_eq!(remarked + usize::from(SETTINGS.contains(&kind)), 1, "{kind}");
        }
    }
}
