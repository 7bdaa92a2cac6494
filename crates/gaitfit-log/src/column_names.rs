//! Names of a log's columns that do not depend on its joints.

/// Command: velocity forward and to the left, m/s, and yaw rate, rad/s.
pub const COMMAND: [&str; 3] = ["vx_cmd", "vy_cmd", "wz_cmd"];
/// Time and heading of a reference motion.
pub const MOTION: [&str; 2] = ["motion_time", "motion_heading"];
/// Position of the base, m, world frame.
pub const BASE_POSITION: [&str; 3] = ["base_pos_x", "base_pos_y", "base_pos_z"];
/// Orientation of the base.
pub const BASE_QUATERNION: [&str; 4] = ["base_quat_w", "base_quat_x", "base_quat_y", "base_quat_z"];
/// Orientation of the base as angles, rad.
pub const ROLL_PITCH_YAW: [&str; 3] = ["roll", "pitch", "yaw"];
/// Linear velocity of the base, m/s, world frame.
pub const BASE_VELOCITY: [&str; 3] = ["base_vel_x", "base_vel_y", "base_vel_z"];
/// Angular velocity of the base, rad/s, base frame.
pub const BASE_RATES: [&str; 3] = ["wx", "wy", "wz"];
/// Unit vector of gravity in the base's frame.
pub const PROJECTED_GRAVITY: [&str; 3] =
    ["projected_gravity_x", "projected_gravity_y", "projected_gravity_z"];
