//! Sparing the motors, and staying near the default pose.

use crate::task::Moment;

fn squares(values: &[f32]) -> f32 {
    values.iter().map(|x| x * x).sum()
}

fn squared_distance(a: &[f32], b: &[f32]) -> f32 {
    a.iter().zip(b).map(|(x, y)| (x - y) * (x - y)).sum()
}

/// Squared motor torques, N²·m².
pub fn torque(m: &Moment<'_>) -> f32 {
    squares(m.torque)
}

/// Squared joint accelerations, rad²/s⁴.
pub fn joint_acceleration(m: &Moment<'_>) -> f32 {
    squares(m.joint_acceleration)
}

/// Squared change of the action since the last step.
pub fn action_rate(m: &Moment<'_>) -> f32 {
    squared_distance(m.action, m.last_action)
}

/// Squared distance from the default pose while the command is zero, rad².
pub fn stand_still(m: &Moment<'_>) -> f32 {
    if m.walking { 0.0 } else { joint_deviation(m) }
}

/// Squared distance from the default pose, rad².
pub fn joint_deviation(m: &Moment<'_>) -> f32 {
    squared_distance(m.joint_position, &m.task.walker.default_pose)
}
