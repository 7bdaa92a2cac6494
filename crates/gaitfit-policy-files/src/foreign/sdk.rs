//! Unitree's robots: the places of their motors in the vendor's SDK, and the joint at each.

const LEGS: [&str; 12] = [
    "FR_hip_joint",
    "FR_thigh_joint",
    "FR_calf_joint",
    "FL_hip_joint",
    "FL_thigh_joint",
    "FL_calf_joint",
    "RR_hip_joint",
    "RR_thigh_joint",
    "RR_calf_joint",
    "RL_hip_joint",
    "RL_thigh_joint",
    "RL_calf_joint",
];
const H1: [&str; 20] = [
    "right_hip_roll_joint",
    "right_hip_pitch_joint",
    "right_knee_joint",
    "left_hip_roll_joint",
    "left_hip_pitch_joint",
    "left_knee_joint",
    "torso_joint",
    "left_hip_yaw_joint",
    "right_hip_yaw_joint",
    "",
    "left_ankle_joint",
    "right_ankle_joint",
    "right_shoulder_pitch_joint",
    "right_shoulder_roll_joint",
    "right_shoulder_yaw_joint",
    "right_elbow_joint",
    "left_shoulder_pitch_joint",
    "left_shoulder_roll_joint",
    "left_shoulder_yaw_joint",
    "left_elbow_joint",
];
const G1: [&str; 29] = [
    "left_hip_pitch_joint",
    "left_hip_roll_joint",
    "left_hip_yaw_joint",
    "left_knee_joint",
    "left_ankle_pitch_joint",
    "left_ankle_roll_joint",
    "right_hip_pitch_joint",
    "right_hip_roll_joint",
    "right_hip_yaw_joint",
    "right_knee_joint",
    "right_ankle_pitch_joint",
    "right_ankle_roll_joint",
    "waist_yaw_joint",
    "waist_roll_joint",
    "waist_pitch_joint",
    "left_shoulder_pitch_joint",
    "left_shoulder_roll_joint",
    "left_shoulder_yaw_joint",
    "left_elbow_joint",
    "left_wrist_roll_joint",
    "left_wrist_pitch_joint",
    "left_wrist_yaw_joint",
    "right_shoulder_pitch_joint",
    "right_shoulder_roll_joint",
    "right_shoulder_yaw_joint",
    "right_elbow_joint",
    "right_wrist_roll_joint",
    "right_wrist_pitch_joint",
    "right_wrist_yaw_joint",
];

/// A robot's name and its joints in the order of the SDK; places without a motor have an empty name.
pub(crate) type Places = (&'static str, Vec<&'static str>);

/// All robots that are known, smaller ones first.
pub(crate) fn robots() -> [Places; 4] {
    // The G1 with 23 joints keeps the places of waist and wrists up to the right wrist's roll.
    let missing = ["waist_roll", "waist_pitch", "left_wrist_pitch", "left_wrist_yaw"];
    let kept =
        |&name: &&'static str| if missing.iter().any(|part| name.starts_with(part)) { "" } else { name };
    [
        ("Go2 (or B2, Go1, A1)", LEGS.to_vec()),
        ("H1", H1.to_vec()),
        ("G1 with 23 joints", G1[..27].iter().map(kept).collect()),
        ("G1", G1.to_vec()),
    ]
}

/// The robot with so many places.
pub(crate) fn with_places(count: usize) -> Option<Places> {
    robots().into_iter().find(|(_, places)| places.len() == count)
}

/// The robot that has all of these joints. The larger G1 is taken for its legs alone: the smaller one is the robot of 23
/// joints, and nothing else.
pub(crate) fn with_joints<'a>(joints: impl Iterator<Item = &'a str> + Clone) -> Option<Places> {
    let has = |places: &[&str]| joints.clone().all(|joint| places.contains(&joint));
    let motors = |places: &[&str]| places.iter().filter(|name| !name.is_empty()).count();
    let count = joints.clone().count();
    let mut robots_with_joints: Vec<Places> =
        robots().into_iter().filter(|(_, places)| has(places)).collect();
    match robots_with_joints.iter().position(|(_, places)| motors(places) == count) {
        Some(exact) => Some(robots_with_joints.swap_remove(exact)),
        // Robots are listed from the smallest on, so the last one has the most motors.
        None => robots_with_joints.pop(),
    }
}
