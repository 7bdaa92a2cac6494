//! A policy on a real legged robot.
//!
//! - [`Robot`]: a robot's joints, motors, limits, gains, poses, messages and topics, from its file.
//! - [`unitree`]: the messages of Unitree's robots, bit for bit.
//! - [`ros`]: ROS 2's messages of joints, for any other robot.
//! - [`guard`]: what may be sent to the motors, and the reasons for sending damping instead.
//! - [`Supervisor`]: the states from idle over standing up and walking to lying down, with the guard before every command.
//! - [`link`]: a robot over DDS (with the feature `dds`), and one in the project's own engine.
//! - [`listen`]: messages of ROS 2 topics as they come.
//! - [`run`]: the loops that send commands and run the policy, who commands, the logs, what was measured.
//! - [`preflight`]: the first contact with a robot that hangs, by checklist.
//! - [`drift`]: the form of drift trials, and what it says once it is filled in.
//!
//! Only [`run::live`] and the link over DDS read a clock: to the rest times are given, so that a test is the same each time.

mod command;
pub mod drift;
mod error;
pub mod guard;
pub mod link;
pub mod listen;
mod per_motor;
pub mod preflight;
mod remote;
pub mod robot;
pub mod ros;
pub mod run;
mod state;
mod supervisor;
pub mod unitree;

pub use command::{Command, MotorCommand, damping};
pub use error::RobotError;
pub use per_motor::{MAX_MOTORS, PerMotor};
pub use robot::Robot;
pub use state::{Battery, Reading, RobotState, Seal};
pub use supervisor::{Phase, Postures, Supervisor, Times};
