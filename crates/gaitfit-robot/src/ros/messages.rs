//! Messages of ROS 2, field by field as the packages `std_msgs`, `sensor_msgs` and `control_msgs` define them.

use serde::de::{Error, Visitor};
use serde::{Deserialize, Deserializer, Serialize, Serializer};

use super::bounded::{items, name, names};

/// A time since 1970 (`builtin_interfaces/msg/Time`).
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Stamp {
    /// Seconds.
    pub sec: i32,
    /// Nanoseconds beyond them.
    pub nanosec: u32,
}

impl Stamp {
    /// It in ms, modulo 2³²; 0 if it is not set.
    pub fn ms(self) -> u32 {
        // The cast keeps the low 32 bits. The guard takes differences modulo 2³².
        (i64::from(self.sec) * 1000 + i64::from(self.nanosec / 1_000_000)) as u32
    }
}

/// The name of a frame: passed over, whatever its length; written as none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Frame;

impl Serialize for Frame {
    fn serialize<S: Serializer>(&self, to: S) -> Result<S::Ok, S::Error> {
        to.serialize_str("")
    }
}

impl<'de> Deserialize<'de> for Frame {
    fn deserialize<D: Deserializer<'de>>(from: D) -> Result<Self, D::Error> {
        struct Any;

        impl Visitor<'_> for Any {
            type Value = Frame;

            fn expecting(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
                f.write_str("the name of a frame")
            }

            fn visit_str<E: Error>(self, _: &str) -> Result<Frame, E> {
                Ok(Frame)
            }
        }

        from.deserialize_str(Any)
    }
}

/// `std_msgs/msg/Header`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Header {
    /// Time at which it was measured or made.
    pub stamp: Stamp,
    /// Name of the frame of its numbers.
    pub frame_id: Frame,
}

/// `sensor_msgs/msg/JointState`: arrays as long as the names, or empty.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct JointState {
    /// Its head.
    pub header: Header,
    /// Names of the joints.
    #[serde(deserialize_with = "names")]
    pub name: Vec<String>,
    /// Angles, rad.
    #[serde(deserialize_with = "items")]
    pub position: Vec<f64>,
    /// Velocities, rad/s.
    #[serde(deserialize_with = "items")]
    pub velocity: Vec<f64>,
    /// Torques, N·m.
    #[serde(deserialize_with = "items")]
    pub effort: Vec<f64>,
}

/// `geometry_msgs/msg/Vector3`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Vector3 {
    /// Ahead.
    pub x: f64,
    /// To the left.
    pub y: f64,
    /// Up.
    pub z: f64,
}

/// `geometry_msgs/msg/Quaternion`, whose order is x, y, z, w.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Quaternion {
    /// Coefficient of i.
    pub x: f64,
    /// Coefficient of j.
    pub y: f64,
    /// Coefficient of k.
    pub z: f64,
    /// The real part.
    pub w: f64,
}

/// `sensor_msgs/msg/Imu`. A covariance whose first number is −1 says that its quantity is not measured.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Imu {
    /// Its head.
    pub header: Header,
    /// Orientation, from the unit's frame to the world's.
    pub orientation: Quaternion,
    /// Its covariance, row after row.
    pub orientation_covariance: [f64; 9],
    /// rad/s, in the unit's frame.
    pub angular_velocity: Vector3,
    /// Its covariance.
    pub angular_velocity_covariance: [f64; 9],
    /// Proper acceleration, m/s², in the unit's frame.
    pub linear_acceleration: Vector3,
    /// Its covariance.
    pub linear_acceleration_covariance: [f64; 9],
}

/// `control_msgs/msg/InterfaceValue`: numbers of a joint, with their names.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct InterfaceValue {
    /// Names, such as `position`.
    #[serde(deserialize_with = "names")]
    pub interface_names: Vec<String>,
    /// Their values.
    #[serde(deserialize_with = "items")]
    pub values: Vec<f64>,
}

/// `control_msgs/msg/DynamicJointState`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct DynamicJointState {
    /// Its head.
    pub header: Header,
    /// Names of the joints.
    #[serde(deserialize_with = "names")]
    pub joint_names: Vec<String>,
    /// The numbers of each.
    #[serde(deserialize_with = "items")]
    pub interface_values: Vec<InterfaceValue>,
}

/// `std_msgs/msg/MultiArrayDimension`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Dimension {
    /// Name of the axis.
    #[serde(deserialize_with = "name")]
    pub label: String,
    /// Its length.
    pub size: u32,
    /// Numbers from here to the end.
    pub stride: u32,
}

/// `std_msgs/msg/MultiArrayLayout`.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub struct Layout {
    /// Dimensions, the outermost first.
    #[serde(deserialize_with = "items")]
    pub dim: Vec<Dimension>,
    /// Numbers before the first.
    pub data_offset: u32,
}

/// `std_msgs/msg/Float64MultiArray`.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Float64MultiArray {
    /// Sizes and strides of the numbers.
    pub layout: Layout,
    /// The numbers.
    #[serde(deserialize_with = "items")]
    pub data: Vec<f64>,
}
