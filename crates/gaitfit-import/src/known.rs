//! Names that other programs give to a log's quantities, and what they are called here.
//!
//! Inside this crate a column is called as in gaitfit's CSV logs: `q_<joint>`, `dq_<joint>`, `qdes_<joint>`,
//! `act_<joint>`, `vx_cmd`, `base_quat_w`, `roll`, `wx` and so on. A joint without a name is `#3` where the file numbers
//! joints, and `#m3` where it numbers the motors of a Unitree robot.

use gaitfit_log::column_names::{
    BASE_POSITION, BASE_QUATERNION, BASE_RATES, BASE_VELOCITY, COMMAND, MOTION, PROJECTED_GRAVITY,
    ROLL_PITCH_YAW,
};

/// Motors of Unitree's Go2 and B2 (unitree_go) in the order of LowState and LowCmd.
pub(crate) const UNITREE_GO: [&str; 12] = [
    "FR_hip", "FR_thigh", "FR_calf", "FL_hip", "FL_thigh", "FL_calf", "RR_hip", "RR_thigh", "RR_calf",
    "RL_hip", "RL_thigh", "RL_calf",
];

/// Motors of Unitree's G1 with 29 joints (unitree_hg) in the order of LowState and LowCmd.
pub(crate) const UNITREE_HG: [&str; 29] = [
    "left_hip_pitch",
    "left_hip_roll",
    "left_hip_yaw",
    "left_knee",
    "left_ankle_pitch",
    "left_ankle_roll",
    "right_hip_pitch",
    "right_hip_roll",
    "right_hip_yaw",
    "right_knee",
    "right_ankle_pitch",
    "right_ankle_roll",
    "waist_yaw",
    "waist_roll",
    "waist_pitch",
    "left_shoulder_pitch",
    "left_shoulder_roll",
    "left_shoulder_yaw",
    "left_elbow",
    "left_wrist_roll",
    "left_wrist_pitch",
    "left_wrist_yaw",
    "right_shoulder_pitch",
    "right_shoulder_roll",
    "right_shoulder_yaw",
    "right_elbow",
    "right_wrist_roll",
    "right_wrist_pitch",
    "right_wrist_yaw",
];

/// Joints of a walk-these-ways log in its order.
pub(crate) const WALK_THESE_WAYS: [&str; 12] = [
    "FL_hip", "FL_thigh", "FL_calf", "FR_hip", "FR_thigh", "FR_calf", "RL_hip", "RL_thigh", "RL_calf",
    "RR_hip", "RR_thigh", "RR_calf",
];

/// Meaning of an array.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    Time,
    Position,
    Velocity,
    Target,
    Action,
    /// vx, vy, yaw rate.
    Command,
    /// vx, vy.
    CommandXy,
    /// Yaw rate, and more that is not taken.
    CommandYaw,
    Quaternion,
    RollPitchYaw,
    AngularVelocity,
    JointNames,
    Kp,
    Kd,
    /// Desired joint velocities.
    TargetVelocity,
    /// Feed-forward torques of the joints.
    FeedForward,
    /// Gravity in the base's frame.
    Gravity,
    /// Numbers that a policy observed.
    Observation,
}

impl Role {
    /// Names of the columns of an array with this role and so many components; `None` if it has too few.
    pub fn columns(self, width: usize) -> Option<Vec<String>> {
        let joints = |prefix: &str| Some((0..width).map(|i| format!("{prefix}#{i}")).collect());
        let fixed =
            |names: &[&str]| (width >= names.len()).then(|| names.iter().map(|n| n.to_string()).collect());
        match self {
            Role::Position => joints("q_"),
            Role::Velocity => joints("dq_"),
            Role::Target => joints("qdes_"),
            Role::Action => joints("act_"),
            Role::Kp => joints("kp_"),
            Role::Kd => joints("kd_"),
            Role::TargetVelocity => joints("dqdes_"),
            Role::FeedForward => joints("tauff_"),
            Role::Observation => joints("obs_"),
            // An array of another width is something else of that name.
            Role::Gravity if width == 3 => fixed(&PROJECTED_GRAVITY),
            // A command may have more numbers than are taken.
            Role::Command => fixed(&COMMAND),
            Role::CommandXy => fixed(&COMMAND[..2]),
            Role::CommandYaw => fixed(&COMMAND[2..]),
            Role::Quaternion if width == 4 => fixed(&BASE_QUATERNION),
            Role::RollPitchYaw if width == 3 => fixed(&ROLL_PITCH_YAW),
            Role::AngularVelocity if width == 3 => fixed(&BASE_RATES),
            Role::Time
            | Role::JointNames
            | Role::Quaternion
            | Role::RollPitchYaw
            | Role::AngularVelocity
            | Role::Gravity => None,
        }
    }

    /// Prefix of a joint's column.
    pub fn prefix(self) -> Option<&'static str> {
        match self {
            Role::Position => Some("q_"),
            Role::Velocity => Some("dq_"),
            Role::Target => Some("qdes_"),
            Role::Action => Some("act_"),
            Role::Kp => Some("kp_"),
            Role::Kd => Some("kd_"),
            Role::TargetVelocity => Some("dqdes_"),
            Role::FeedForward => Some("tauff_"),
            Role::Observation => Some("obs_"),
            _ => None,
        }
    }
}

/// What an array called `name` holds, by the names that PACE, walk-these-ways, Isaac Lab, legged_gym and their like use.
pub(crate) fn role(name: &str) -> Option<Role> {
    // Only the last part of a path names the quantity.
    let name = name.rsplit(['/', '.']).next().unwrap_or(name).to_lowercase();
    Some(match name.as_str() {
        "time" | "t" | "times" | "timestamp" | "timestamps" | "stamp" | "__time" | "time_s" | "time_ms"
        | "time_us" | "time_ns" => Role::Time,
        "q" | "position" | "positions" | "joint_pos" | "joint_position" | "joint_positions" | "dof_pos"
        | "dof_positions" | "joint_q" | "actual_dof_pos" | "robot0_joint_pos" | "actual_q" | "q_actual" => {
            Role::Position
        }
        "dq" | "qd" | "velocity" | "velocities" | "joint_vel" | "joint_velocity" | "joint_velocities"
        | "dof_vel" | "dof_velocities" | "joint_dq" | "robot0_joint_vel" | "actual_dq" | "dq_actual" => {
            Role::Velocity
        }
        "qdes" | "q_des" | "des_dof_pos" | "joint_pos_target" | "joint_pos_des" | "dof_pos_target"
        | "target" | "targets" | "joint_target" | "joint_targets" | "target_dof_pos" | "q_target"
        | "target_q" | "position_target" => Role::Target,
        "action" | "actions" | "act" => Role::Action,
        "command" | "commands" | "cmd" | "velocity_command" | "velocity_commands" | "cmd_vel" | "vel_cmd" => {
            Role::Command
        }
        "body_linear_vel_cmd" => Role::CommandXy,
        "body_angular_vel_cmd" => Role::CommandYaw,
        "base_quat" | "base_quat_wxyz" | "quat_wxyz" | "imu_quat_wxyz" => Role::Quaternion,
        "rpy" | "roll_pitch_yaw" | "base_rpy" | "imu_rpy" => Role::RollPitchYaw,
        "body_angular_vel" | "base_ang_vel" | "gyro" | "gyroscope" | "imu_gyro" | "omega_body"
        | "ang_vel" | "imu_ang_vel" | "angular_velocity" => Role::AngularVelocity,
        "projected_gravity" | "proj_gravity" | "gravity" | "gravity_ori" | "gravity_vec"
        | "gravity_vector" | "base_gravity" => Role::Gravity,
        "obs" | "observation" | "observations" | "obs_buf" | "policy_obs" => Role::Observation,
        "dqdes" | "dq_des" | "target_dq" | "dq_target" | "joint_vel_target" | "des_dof_vel"
        | "velocity_target" => Role::TargetVelocity,
        "tau_ff" | "tauff" | "torque_ff" | "ff_torque" | "tau_feedforward" | "feedforward_torque"
        | "target_tau" => Role::FeedForward,
        "joint_names" | "joints" | "dof_names" | "joint_order" | "names" => Role::JointNames,
        "kp" | "p_gains" | "stiffness" => Role::Kp,
        "kd" | "d_gains" | "damping" => Role::Kd,
        _ => return None,
    })
}

/// The log's name of a column of numbers called `name`, if it is known.
pub(crate) fn canonical(name: &str) -> Option<String> {
    if let Some(known) = known_name(name) {
        return Some(known);
    }
    // a[3]/b, a.3.b and a/3/b are one notation.
    let even: String =
        name.chars().filter(|c| *c != ']').map(|c| if c == '[' || c == '.' { '/' } else { c }).collect();
    let parts: Vec<&str> = even.split('/').filter(|part| !part.is_empty()).collect();
    // Larger numbers are part of a name: no robot has so many motors.
    let number = |text: &str| text.parse::<usize>().ok().filter(|number| *number < 1024);
    // From the most specific path to the most general: an element of an array fits almost anything.
    match parts.as_slice() {
        [.., "motor_state", i, "q"] => number(i).map(|i| format!("q_#m{i}")),
        [.., "motor_state", i, "dq"] => number(i).map(|i| format!("dq_#m{i}")),
        [.., "motor_cmd", i, "q"] => number(i).map(|i| format!("qdes_#m{i}")),
        [.., "motor_cmd", i, "dq"] => number(i).map(|i| format!("dqdes_#m{i}")),
        [.., "motor_cmd", i, "tau"] => number(i).map(|i| format!("tauff_#m{i}")),
        [.., "motor_cmd", i, "kp"] => number(i).map(|i| format!("kp_#m{i}")),
        [.., "motor_cmd", i, "kd"] => number(i).map(|i| format!("kd_#m{i}")),
        [.., "imu_state", "quaternion", i] => BASE_QUATERNION.get(number(i)?).map(|n| n.to_string()),
        [.., "imu_state", "gyroscope", i] => BASE_RATES.get(number(i)?).map(|n| n.to_string()),
        [topic @ .., "orientation", axis] if is_imu(topic) => {
            let place = ["w", "x", "y", "z"].iter().position(|name| name == axis)?;
            Some(BASE_QUATERNION[place].to_owned())
        }
        [topic @ .., "angular_velocity", axis] if is_imu(topic) => {
            let place = ["x", "y", "z"].iter().position(|name| name == axis)?;
            Some(BASE_RATES[place].to_owned())
        }
        // PlotJuggler names the parts of a JointState so: topic, joint, quantity.
        [topic @ .., joint, "position"] if !topic.is_empty() && number(joint).is_none() => {
            Some(format!("{}{joint}", if is_command(topic) { "qdes_" } else { "q_" }))
        }
        [topic @ .., joint, "velocity"] if !topic.is_empty() && number(joint).is_none() => {
            (!is_command(topic)).then(|| format!("dq_{joint}"))
        }
        [topic @ .., "linear", axis @ ("x" | "y")] if is_velocity_command(topic) => {
            Some(COMMAND[usize::from(*axis == "y")].to_owned())
        }
        [topic @ .., "angular", "z"] if is_velocity_command(topic) => Some(COMMAND[2].to_owned()),
        [.., array, i] => element(role(array)?, i),
        [single] => {
            // dof_pos_3
            let (array, i) = single.rsplit_once('_')?;
            element(role(array)?, i)
        }
        _ => None,
    }
}

/// The column of element `i`, a number or an axis, of an array with this role.
fn element(role: Role, i: &str) -> Option<String> {
    let number = i.parse::<usize>().ok().filter(|number| *number < 1024);
    if let (Some(prefix), Some(number)) = (role.prefix(), number) {
        return Some(format!("{prefix}#{number}"));
    }
    let names = match role {
        Role::Command => &COMMAND,
        Role::RollPitchYaw => &ROLL_PITCH_YAW,
        Role::AngularVelocity => &BASE_RATES,
        Role::Gravity => &PROJECTED_GRAVITY,
        _ => return None,
    };
    let axis = match (role, i) {
        (Role::Command, "yaw" | "wz") => Some(2),
        // The third number of a command is a yaw rate, no velocity along z.
        (Role::Command, "z") => None,
        _ => number.or_else(|| ["x", "y", "z"].iter().position(|axis| *axis == i)),
    };
    names.get(axis?).map(|name| (*name).to_owned())
}

/// Whether a topic's name says that it is an inertial unit's.
fn is_imu(topic: &[&str]) -> bool {
    topic.iter().any(|part| part.to_lowercase().contains("imu"))
}

/// Quantities that every joint has, by the beginnings of their columns' names.
pub(crate) const PER_JOINT: [&str; 9] = ["q", "dq", "qdes", "act", "kp", "kd", "dqdes", "tauff", "obs"];

/// Names that are called so here already. A joint `q_3` is a number.
fn known_name(name: &str) -> Option<String> {
    let fixed = [
        &COMMAND[..],
        &MOTION,
        &BASE_QUATERNION,
        &ROLL_PITCH_YAW,
        &BASE_RATES,
        &BASE_POSITION,
        &BASE_VELOCITY,
    ];
    if fixed.iter().any(|names| names.contains(&name)) {
        return Some(name.to_owned());
    }
    if let Some(axis) = ["cmd_vx", "cmd_vy", "cmd_wz"].iter().position(|alias| *alias == name) {
        return Some(COMMAND[axis].to_owned());
    }
    if let Some(axis) = gaitfit_log::gravity_axis(name) {
        return Some(PROJECTED_GRAVITY[axis].to_owned());
    }
    // Columns that this crate's readers have numbered.
    let marked = |name: &str| name.split_once("_#").is_some_and(|(prefix, _)| PER_JOINT.contains(&prefix));
    if marked(name) {
        return Some(name.to_owned());
    }
    // `q_des_x` is a target, not a joint called des_x.
    let (prefix, joint) =
        ["q_des_", "qdes_", "dq_des_", "dqdes_", "dq_", "act_", "q_", "kp_", "kd_", "tau_ff_", "tauff_"]
            .iter()
            .find_map(|prefix| Some((*prefix, name.strip_prefix(prefix)?)))
            .filter(|(_, joint)| !joint.is_empty() && !joint.contains(['/', '[']))?;
    let prefix = match prefix {
        "q_des_" => "qdes_",
        "dq_des_" => "dqdes_",
        "tau_ff_" => "tauff_",
        prefix => prefix,
    };
    Some(match joint.parse::<u16>() {
        Ok(number) => format!("{prefix}#{number}"),
        Err(_) => format!("{prefix}{joint}"),
    })
}

/// Whether a topic's name says that its joints are commanded.
pub(crate) fn is_command(topic: &[&str]) -> bool {
    topic.iter().any(|part| {
        let part = part.to_lowercase();
        ["cmd", "command", "target", "desired", "reference", "setpoint"]
            .iter()
            .any(|word| part.contains(word))
    })
}

/// Whether a topic's name says that its joints' values are a policy's actions.
pub(crate) fn is_action(topic: &[&str]) -> bool {
    topic.last().is_some_and(|part| part.to_lowercase().ends_with("actions"))
}

fn is_velocity_command(topic: &[&str]) -> bool {
    topic.iter().any(|part| {
        let part = part.to_lowercase();
        ["cmd_vel", "command", "cmd"].iter().any(|word| part.contains(word))
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_of_other_programs_are_known() {
        for (name, want) in [
            ("q_FL_hip", "q_FL_hip"),
            ("q_3", "q_#3"),
            ("q_des_FL_hip", "qdes_FL_hip"),
            ("/joint_states/FL_hip_joint/position", "q_FL_hip_joint"),
            ("/joint_states/FL_hip_joint/velocity", "dq_FL_hip_joint"),
            ("/joint_commands/FL_hip_joint/position", "qdes_FL_hip_joint"),
            ("/lowstate/motor_state[3]/q", "q_#m3"),
            ("/lowstate/motor_state.3.dq", "dq_#m3"),
            ("/lowcmd/motor_cmd[11]/q", "qdes_#m11"),
            ("/lowstate/imu_state/quaternion[0]", "base_quat_w"),
            ("/lowstate/imu_state/gyroscope[2]", "wz"),
            ("/cmd_vel/linear/x", "vx_cmd"),
            ("/cmd_vel/angular/z", "wz_cmd"),
            ("dof_pos[4]", "q_#4"),
            ("dof_pos_4", "q_#4"),
            ("cmd_vy", "vy_cmd"),
            ("/imu/orientation/x", "base_quat_x"),
            ("/imu/data/orientation/w", "base_quat_w"),
            ("/imu/angular_velocity/z", "wz"),
            ("/cmd_vel/twist/linear/y", "vy_cmd"),
            ("/lowcmd/motor_cmd[3]/tau", "tauff_#m3"),
            ("kp_11", "kp_#11"),
            ("kd_FL_hip", "kd_FL_hip"),
            ("dq_des_3", "dqdes_#3"),
            ("tau_ff_FL_hip", "tauff_FL_hip"),
            ("gravity_ori_z", "projected_gravity_z"),
            ("projected_gravity[1]", "projected_gravity_y"),
            ("ang_vel_2", "wz"),
            ("imu_rpy_0", "roll"),
            ("vel_cmd_yaw", "wz_cmd"),
            ("cmd_vel_1", "vy_cmd"),
            ("actual_q_7", "q_#7"),
            ("obs_44", "obs_#44"),
        ] {
            assert_eq!(canonical(name).as_deref(), Some(want), "{name}");
        }
        for name in [
            "temperature",
            "/odom/linear/x",
            "/odom/pose/orientation/x",
            "vel_cmd_z",
            "/lowstate/motor_state[3]/temperature",
            "q_",
            "torque_3",
        ] {
            assert_eq!(canonical(name), None, "{name}");
        }
    }

    #[test]
    fn arrays_with_too_few_components_are_not_taken() {
        assert_eq!(Role::Quaternion.columns(3), None);
        assert_eq!(Role::Command.columns(2), None);
        assert_eq!(Role::Command.columns(15).map(|names| names.len()), Some(3));
        assert_eq!(Role::Position.columns(2), Some(vec!["q_#0".to_owned(), "q_#1".to_owned()]));
    }
}
