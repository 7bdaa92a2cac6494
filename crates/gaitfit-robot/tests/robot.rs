//! Tests of the robot's messages, of every rule of the guard, and of what a robot feels when something fails.
#![allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]

#[cfg(all(feature = "dds", target_os = "linux"))]
#[path = "robot/dds.rs"]
mod dds;
#[cfg(all(feature = "dds", target_os = "linux"))]
#[path = "robot/dds_faults.rs"]
mod dds_faults;
#[cfg(all(feature = "dds", target_os = "linux"))]
#[path = "robot/each_robot.rs"]
mod each_robot;
#[path = "robot/faults.rs"]
mod faults;
#[path = "robot/held.rs"]
mod held;
#[cfg(all(feature = "dds", target_os = "linux"))]
#[path = "robot/kinds_faults.rs"]
mod kinds_faults;
#[path = "robot/limits.rs"]
mod limits;
#[cfg(all(feature = "dds", target_os = "linux"))]
#[path = "robot/listen.rs"]
mod listen;
#[path = "robot/messages.rs"]
mod messages;
#[cfg(all(feature = "dds", target_os = "linux"))]
#[path = "robot/motion.rs"]
mod motion;
#[path = "robot/pilot.rs"]
mod pilot;
#[path = "robot/preflight.rs"]
mod preflight;
#[cfg(all(feature = "dds", target_os = "linux"))]
#[path = "robot/ros2.rs"]
mod ros2;
#[path = "robot/ros2_messages.rs"]
mod ros2_messages;
#[path = "robot/ros2_rules.rs"]
mod ros2_rules;
#[path = "robot/rules.rs"]
mod rules;
#[cfg(all(feature = "dds", target_os = "linux"))]
#[path = "robot/server.rs"]
mod server;
#[path = "robot/session.rs"]
mod session;
#[path = "robot/toy.rs"]
mod toy;
#[path = "robot/wheels.rs"]
mod wheels;
