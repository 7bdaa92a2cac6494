//! Fields of the messages that bags without definitions hold. The order of fields is the wire's: it is what the packages
//! `common_interfaces`, `control_msgs`, `unitree_go` and `unitree_hg` define.

use super::schema::short_name;
use std::fmt::Write;

/// Types whose messages a log can be made of.
const MESSAGES: [&str; 11] = [
    "sensor_msgs/JointState",
    "sensor_msgs/Imu",
    "geometry_msgs/Twist",
    "geometry_msgs/TwistStamped",
    "trajectory_msgs/JointTrajectory",
    "control_msgs/DynamicJointState",
    "std_msgs/Float64MultiArray",
    "unitree_go/LowState",
    "unitree_go/LowCmd",
    "unitree_hg/LowState",
    "unitree_hg/LowCmd",
];

/// Whether messages of this type, such as `sensor_msgs/msg/JointState`, are read without a definition.
pub fn is_known(kind: &str) -> bool {
    MESSAGES.contains(&short_name(kind).as_str())
}

/// The types that are read without a definition.
pub fn known_types() -> Vec<String> {
    MESSAGES.iter().map(|name| name.replacen('/', "/msg/", 1)).collect()
}

/// The definition of a type with those of all types in it, as a bag has it.
pub(crate) fn whole_definition(kind: &str) -> Option<String> {
    let root = short_name(kind);
    let mut text = definition(&root)?.to_owned() + "\n";
    let mut names = vec![root];
    let mut next = 0;
    // The list grows while it is walked: types bring further types.
    while next < names.len() {
        let package = names[next].split('/').next().unwrap_or_default().to_owned();
        for line in definition(&names[next])?.lines() {
            // A type ends at the space before its field's name, or at the bracket of an array.
            let field = line.split([' ', '[']).next().unwrap_or_default();
            // Types of the same package are named without it.
            let name = if field.contains('/') { field.to_owned() } else { format!("{package}/{field}") };
            if let Some(part) = definition(&name).filter(|_| !names.contains(&name)) {
                let _ = write!(text, "{}\nMSG: {name}\n{part}\n", "=".repeat(80));
                names.push(name);
            }
        }
        next += 1;
    }
    Some(text)
}

/// The definition of a type called `pkg/Name`.
pub(crate) fn definition(name: &str) -> Option<&'static str> {
    Some(match name {
        "builtin_interfaces/Time" | "builtin_interfaces/Duration" => "int32 sec\nuint32 nanosec",
        "std_msgs/Header" => "builtin_interfaces/Time stamp\nstring frame_id",
        "std_msgs/MultiArrayDimension" => "string label\nuint32 size\nuint32 stride",
        "std_msgs/MultiArrayLayout" => "MultiArrayDimension[] dim\nuint32 data_offset",
        "std_msgs/Float64MultiArray" => "MultiArrayLayout layout\nfloat64[] data",
        "std_msgs/Float32MultiArray" => "MultiArrayLayout layout\nfloat32[] data",
        "geometry_msgs/Vector3" => "float64 x\nfloat64 y\nfloat64 z",
        "geometry_msgs/Quaternion" => "float64 x\nfloat64 y\nfloat64 z\nfloat64 w",
        "geometry_msgs/Twist" => "Vector3 linear\nVector3 angular",
        "geometry_msgs/TwistStamped" => "std_msgs/Header header\nTwist twist",
        "sensor_msgs/JointState" => {
            "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort"
        }
        "sensor_msgs/Imu" => {
            "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n\
             geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n\
             geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance"
        }
        "trajectory_msgs/JointTrajectoryPoint" => {
            "float64[] positions\nfloat64[] velocities\nfloat64[] accelerations\nfloat64[] effort\n\
             builtin_interfaces/Duration time_from_start"
        }
        "trajectory_msgs/JointTrajectory" => {
            "std_msgs/Header header\nstring[] joint_names\nJointTrajectoryPoint[] points"
        }
        "control_msgs/InterfaceValue" => "string[] interface_names\nfloat64[] values",
        "control_msgs/DynamicJointState" => {
            "std_msgs/Header header\nstring[] joint_names\nInterfaceValue[] interface_values"
        }
        "unitree_go/MotorState" => {
            "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\nfloat32 q_raw\nfloat32 dq_raw\n\
             float32 ddq_raw\nint8 temperature\nuint32 lost\nuint32[2] reserve"
        }
        "unitree_go/MotorCmd" => {
            "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 tau\nfloat32 kp\nfloat32 kd\nuint32[3] reserve"
        }
        "unitree_go/IMUState" => {
            "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\nint8 temperature"
        }
        "unitree_go/BmsState" => {
            "uint8 version_high\nuint8 version_low\nuint8 status\nuint8 soc\nint32 current\nuint16 cycle\n\
             int8[2] bq_ntc\nint8[2] mcu_ntc\nuint16[15] cell_vol"
        }
        "unitree_go/BmsCmd" => "uint8 off\nuint8[3] reserve",
        "unitree_go/LowState" => {
            "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\nuint16 bandwidth\n\
             IMUState imu_state\nMotorState[20] motor_state\nBmsState bms_state\nint16[4] foot_force\n\
             int16[4] foot_force_est\nuint32 tick\nuint8[40] wireless_remote\nuint8 bit_flag\nfloat32 adc_reel\n\
             int8 temperature_ntc1\nint8 temperature_ntc2\nfloat32 power_v\nfloat32 power_a\nuint16[4] fan_frequency\n\
             uint32 reserve\nuint32 crc"
        }
        "unitree_go/LowCmd" => {
            "uint8[2] head\nuint8 level_flag\nuint8 frame_reserve\nuint32[2] sn\nuint32[2] version\nuint16 bandwidth\n\
             MotorCmd[20] motor_cmd\nBmsCmd bms_cmd\nuint8[40] wireless_remote\nuint8[12] led\nuint8[2] fan\nuint8 gpio\n\
             uint32 reserve\nuint32 crc"
        }
        "unitree_hg/MotorState" => {
            "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 ddq\nfloat32 tau_est\nint16[2] temperature\nfloat32 vol\n\
             uint32[2] sensor\nuint32 motorstate\nuint32[4] reserve"
        }
        "unitree_hg/MotorCmd" => {
            "uint8 mode\nfloat32 q\nfloat32 dq\nfloat32 tau\nfloat32 kp\nfloat32 kd\nuint32 reserve"
        }
        "unitree_hg/IMUState" => {
            "float32[4] quaternion\nfloat32[3] gyroscope\nfloat32[3] accelerometer\nfloat32[3] rpy\nint16 temperature"
        }
        "unitree_hg/LowState" => {
            "uint32[2] version\nuint8 mode_pr\nuint8 mode_machine\nuint32 tick\nIMUState imu_state\n\
             MotorState[35] motor_state\nuint8[40] wireless_remote\nuint32[4] reserve\nuint32 crc"
        }
        "unitree_hg/LowCmd" => {
            "uint8 mode_pr\nuint8 mode_machine\nMotorCmd[35] motor_cmd\nuint32[4] reserve\nuint32 crc"
        }
        _ => return None,
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::ros::schema;

    #[test]
    fn a_whole_definition_holds_all_types_in_it_and_is_read_as_the_built_in_one() {
        for kind in known_types() {
            let text = whole_definition(&kind).unwrap_or_default();
            let [whole, built_in] =
                [&*text, ""].map(|text| schema::parse(&kind, text).map(|schema| schema.types.len()));
            assert!(whole.is_ok() && whole.as_ref().ok() == built_in.as_ref().ok(), "{kind}: {text}");
            assert!(is_known(&kind));
        }
        let imu = whole_definition("sensor_msgs::msg::dds_::Imu_").unwrap_or_default();
        for part in ["MSG: std_msgs/Header", "MSG: geometry_msgs/Vector3", "MSG: builtin_interfaces/Time"] {
            assert_eq!(imu.matches(part).count(), 1, "{part}");
        }
        assert!(!is_known("sensor_msgs/msg/PointCloud2") && !is_known("std_msgs/msg/Header"));
    }
}
