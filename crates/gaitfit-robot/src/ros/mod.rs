//! ROS 2's messages of a robot's joints: states and inertial units in, targets with gains out.

mod bounded;
mod commands;
mod messages;
mod states;

pub use bounded::{MAX_ITEMS, MAX_NAME};
pub use commands::{array, dynamic};
pub use messages::{
    Dimension, DynamicJointState, Float64MultiArray, Frame, Header, Imu, InterfaceValue, JointState, Layout,
    Quaternion, Stamp, Vector3,
};
pub use states::{States, Taken};
