//! Robot logs: the trajectory type, the CSV reader and writer, and the checks.
//!
//! # Columns of a CSV log
//! In any order, found by name; other columns are left out and listed.
//!
//! | columns | meaning |
//! | --- | --- |
//! | `time` | s; milli-, micro- and nanoseconds are recognised, and `time_ms`, `time_us`, `time_ns` say them |
//! | `q_J`, `dq_J` | position (rad) and velocity (rad/s) of joint J; both needed for every joint |
//! | `qdes_J`, `act_J` | position target (rad), policy action; for all joints or none |
//! | `vx_cmd`, `vy_cmd`, `wz_cmd` (or `cmd_vx`, …) | command, m/s and rad/s |
//! | `motion_time`, `motion_heading` | place in the motion that the policy follows: time, s, and its turn about the vertical, rad |
//! | `base_pos_x` … `z` | base position, m, world frame |
//! | `base_quat_w`, `x`, `y`, `z` | base orientation, wxyz, unit |
//! | `roll`, `pitch`, `yaw` | base orientation, rad, R = Rz(yaw)·Ry(pitch)·Rx(roll); read where there is no `base_quat_` |
//! | `base_vel_x` … `z` | base linear velocity, m/s, world frame |
//! | `wx`, `wy`, `wz` | base angular velocity, rad/s, body frame |
//! | `projected_gravity_x` … `z` (or `gravity_x`, …) | gravity in the body frame, (0, 0, −1) when upright; read where there is no other orientation |
//! | `kp_J`, `kd_J` | gains of joint J at each sample, N·m/rad and N·m·s/rad; for all joints or none |
//! | `dqdes_J`, `tauff_J` | desired velocity (rad/s) and feed-forward torque (N·m) of joint J; for all joints or none |
//!
//! Comment lines above the header, or a sidecar file `<stem>.toml` or `log.toml` beside the log, state the rest:
//! `robot = "go2"`, `rate_hz = 200`, `kp = 25` or `kp = [20, 20, 40]` (in the order of the `q_` columns) or
//! `kp = { "*_hip" = 20, "*_thigh" = 20, "*_calf" = 40 }`, and `kd` likewise;
//! `target_lead_s = 0.0003`, how long after its row's time a target was sent ([`Lead`]).
//!
//! # Use
//! ```no_run
//! use gaitfit_log::{CheckSpec, ReadOptions, check, read_csv, summary};
//!
//! let log = read_csv("run_0.csv".as_ref(), &ReadOptions::default())?;
//! println!("{} samples at {} Hz", log.len(), summary(&log).rate_hz);
//! for finding in check(&log, &CheckSpec::default()) {
//!     println!("{finding}");
//! }
//! # Ok::<(), gaitfit_log::LogError>(())
//! ```

mod assemble;
mod attitude;
mod check;
pub mod column_names;
mod columns;
mod error;
mod estimate;
mod files;
mod finding;
mod folder;
mod imu;
mod imu_fit;
mod imu_settings;
mod lines;
mod metadata;
mod motion;
mod motor;
mod names;
mod ops;
mod read;
mod read_report;
mod regular;
pub mod regular_file;
mod resample;
mod scale;
mod sensors;
mod spacing;
mod stamps;
mod stats;
mod summary;
mod time_unit;
mod trajectory;
mod wheels;
mod write;

pub use assemble::measured_rate;
pub use attitude::orientation_of_gravity;
pub use check::{CheckSpec, Fall, FallSign, VelocityLag, check, falls, settle_angles, settle_imu, zero_rows};
pub use columns::gravity_axis;
pub use error::LogError;
pub use estimate::{BLOCK_S, Estimate, MEDIAN_TO_DEVIATION};
pub use files::{check_entry, csv_files};
pub use finding::{Finding, FindingKind, Severity, Span, allow};
pub use folder::{FindingGroup, FolderSummary, LogContent, LogEntry, RateCount, summarise_folder};
pub use imu_settings::{ImuSettings, QuaternionOrder, RateFrame, RateUnit};
pub use metadata::{PerJoint, Stated, stated};
pub use motor::{MotorColumns, fold, gains as gains_of_columns};
pub use ops::Signal;
pub use read::{ReadOptions, read_csv, read_csv_report};
pub use read_report::{Hole, IgnoredColumn, ReadReport};
pub use regular::Regular;
pub use sensors::{Sensors, gyro_bias, velocity_lag};
pub use spacing::{Lost, Spacing, spacing};
pub use stamps::{CoarseStamps, EvenRows, Stamps, is_news, look as look_at_stamps, rate_of_velocities};
pub use summary::{JointSummary, LogSummary, SignalSummary, summary, summary_with_report};
pub use time_unit::{ConvertedTime, TimeUnit, recognise as recognise_time_unit};
pub use trajectory::*;
pub use write::{check_names, write_csv};
