//! Which motor is which joint.

use crate::RobotError;

/// Motors of a Go2.
pub const MOTORS: usize = 12;

/// The Go2's motors in the order of its messages' slots: legs FR, FL, RR, RL; in each hip, thigh, calf.
pub const MOTOR_NAMES: [&str; MOTORS] = [
    "FR_hip", "FR_thigh", "FR_calf", "FL_hip", "FL_thigh", "FL_calf", "RR_hip", "RR_thigh", "RR_calf",
    "RL_hip", "RL_thigh", "RL_calf",
];

/// For each of `joints`, its motor. A `_joint` suffix does not matter.
///
/// # Errors
/// A joint that the Go2 lacks, one that is named twice, or fewer than all twelve.
pub fn motors_of(joints: &[String]) -> Result<[usize; MOTORS], RobotError> {
    let mut found = [usize::MAX; MOTORS];
    for (index, joint) in joints.iter().enumerate() {
        let name = joint.strip_suffix("_joint").unwrap_or(joint);
        let motor =
            MOTOR_NAMES.iter().position(|&motor| motor == name).filter(|motor| !found.contains(motor));
        match (motor, found.get_mut(index)) {
            (Some(motor), Some(slot)) => *slot = motor,
            _ => return Err(RobotError::Joint { joint: joint.clone() }),
        }
    }
    match found.iter().position(|&motor| motor == usize::MAX) {
        Some(_) => Err(RobotError::Joints { count: joints.len() }),
        None => Ok(found),
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    fn names(order: [&str; 4]) -> Vec<String> {
        order
            .iter()
            .flat_map(|leg| ["hip", "thigh", "calf"].map(|kind| format!("{leg}_{kind}_joint")))
            .collect()
    }

    #[test]
    fn joints_are_matched_by_name_and_nothing_else() {
        let found = motors_of(&names(["FL", "FR", "RL", "RR"])).unwrap();
        assert_eq!(found, [3, 4, 5, 0, 1, 2, 9, 10, 11, 6, 7, 8]);
        assert_eq!(motors_of(&MOTOR_NAMES.map(str::to_owned)).unwrap(), std::array::from_fn(|k| k));
    }

    #[test]
    fn joints_of_another_robot_are_refused_by_name() {
        let mut odd = names(["FL", "FR", "RL", "RR"]);
        odd[4] = "FR_wheel_joint".to_owned();
        assert!(motors_of(&odd).unwrap_err().to_string().contains("FR_wheel_joint"));
        let mut twice = names(["FL", "FR", "RL", "RR"]);
        twice[5] = "FL_hip".to_owned();
        assert!(motors_of(&twice).unwrap_err().to_string().contains("FL_hip"));
        let all = names(["FL", "FR", "RL", "RR"]);
        assert!(motors_of(&all[..9]).unwrap_err().to_string().contains('9'));
        assert!(motors_of(&[all.clone(), all].concat()).is_err());
    }
}
