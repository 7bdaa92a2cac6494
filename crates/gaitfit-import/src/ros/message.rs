//! What of a message is a log's: by the fields that it has, so that a type of one's own that looks like a known one is read.

use super::value::Value;
use crate::known::Role;
use gaitfit_log::column_names::{BASE_QUATERNION, BASE_RATES, COMMAND};

/// Columns and values of one message.
pub(crate) type Columns = Vec<(String, f64)>;

/// Max count of numbers of a message of unknown type that a mapping asks for.
const MAX_FLAT: usize = 1000;

/// The columns of a message; empty if its fields are not known. `joints` is what its joints' positions are: positions,
/// targets or actions.
pub(crate) fn columns(message: &Value, joints: Role) -> Columns {
    let mut out = Columns::new();
    joint_state(message, joints, &mut out);
    controller_state(message, &mut out);
    dynamic_joint_state(message, joints, &mut out);
    trajectory(message, &mut out);
    motors(message, &mut out);
    unitree_imu(message, &mut out);
    imu(message, &mut out);
    twist(message, &mut out);
    out
}

/// ns since 1970 of the message's header, if it has one that is set.
pub(crate) fn stamp_ns(message: &Value) -> Option<i64> {
    let stamp = message.get(&["header"])?.get(&["stamp"])?;
    let seconds = stamp.get(&["sec", "secs"]).and_then(Value::number)?;
    let rest = stamp.get(&["nanosec", "nsec", "nsecs"]).and_then(Value::number)?;
    // A damaged stamp saturates.
    let ns = (seconds as i64).saturating_mul(1_000_000_000).saturating_add(rest as i64);
    (ns > 0).then_some(ns)
}

/// sensor_msgs/JointState: names beside positions, velocities and efforts, each as long as the names or empty.
fn joint_state(message: &Value, joints: Role, out: &mut Columns) {
    let Some(names) = message.get(&["name"]).and_then(Value::words) else { return };
    let mut add = |field: &str, prefix: &str| {
        let values = message.get(&[field]).and_then(Value::numbers).unwrap_or_default();
        // By its definition an array may be empty.
        if values.len() == names.len() {
            out.extend(names.iter().zip(values).map(|(name, value)| (format!("{prefix}{name}"), value)));
        }
    };
    add("position", joints.prefix().unwrap_or("q_"));
    // Velocities beside targets are wanted ones, not measured ones.
    if joints == Role::Position {
        add("velocity", "dq_");
    }
}

/// control_msgs/JointTrajectoryControllerState: what is asked for and what is, of each joint. The names of its parts
/// changed from `desired` and `actual` to `reference` and `feedback`.
fn controller_state(message: &Value, out: &mut Columns) {
    let Some(names) = message.get(&["joint_names"]).and_then(Value::words) else { return };
    let mut add = |parts: &[&str], field: &str, prefix: &str| {
        let values = message.get(parts).and_then(|point| point.get(&[field])).and_then(Value::numbers);
        if let Some(values) = values.filter(|values| values.len() == names.len()) {
            out.extend(names.iter().zip(values).map(|(name, value)| (format!("{prefix}{name}"), value)));
        }
    };
    add(&["feedback", "actual"], "positions", "q_");
    add(&["feedback", "actual"], "velocities", "dq_");
    add(&["reference", "desired"], "positions", "qdes_");
}

/// control_msgs/DynamicJointState: for each joint names of its interfaces and their values.
fn dynamic_joint_state(message: &Value, joints: Role, out: &mut Columns) {
    let names = message.get(&["joint_names"]).and_then(Value::words);
    let values = message.get(&["interface_values"]).and_then(Value::items);
    let (Some(names), Some(values)) = (names, values) else { return };
    for (joint, interfaces) in names.iter().zip(values) {
        let kinds = interfaces.get(&["interface_names"]).and_then(Value::words).unwrap_or_default();
        let numbers = interfaces.get(&["values"]).and_then(Value::numbers).unwrap_or_default();
        for (kind, number) in kinds.iter().zip(numbers) {
            let prefix = match *kind {
                "position" => joints.prefix().unwrap_or("q_"),
                "velocity" if joints == Role::Position => "dq_",
                _ => continue,
            };
            out.push((format!("{prefix}{joint}"), number));
        }
    }
}

/// trajectory_msgs/JointTrajectory as a stream of targets: its first point.
fn trajectory(message: &Value, out: &mut Columns) {
    let names = message.get(&["joint_names"]).and_then(Value::words);
    let points = message.get(&["points"]).and_then(Value::items);
    let (Some(names), Some([point, ..])) = (names, points) else { return };
    let values = point.get(&["positions"]).and_then(Value::numbers).unwrap_or_default();
    if values.len() == names.len() {
        out.extend(names.iter().zip(values).map(|(name, value)| (format!("qdes_{name}"), value)));
    }
}

/// Unitree's LowState and LowCmd: one structure a motor.
fn motors(message: &Value, out: &mut Columns) {
    let mut add = |list: &str, fields: &[(&str, &str)]| {
        for (i, motor) in message.get(&[list]).and_then(Value::items).unwrap_or_default().iter().enumerate() {
            for (field, prefix) in fields {
                if let Some(value) = motor.get(&[field]).and_then(Value::number) {
                    out.push((format!("{prefix}#m{i}"), value));
                }
            }
        }
    };
    add("motor_state", &[("q", "q_"), ("dq", "dq_")]);
    add("motor_cmd", &[("q", "qdes_"), ("dq", "dqdes_"), ("tau", "tauff_"), ("kp", "kp_"), ("kd", "kd_")]);
}

/// Unitree's imu_state: the quaternion is w, x, y, z; the gyroscope is in the base's frame.
fn unitree_imu(message: &Value, out: &mut Columns) {
    let Some(imu) = message.get(&["imu_state"]) else { return };
    let mut add = |field: &str, names: &[&str]| {
        let values = imu.get(&[field]).and_then(Value::numbers).unwrap_or_default();
        if values.len() == names.len() {
            out.extend(names.iter().zip(values).map(|(name, value)| ((*name).to_owned(), value)));
        }
    };
    let quaternion = imu.get(&["quaternion"]).and_then(Value::numbers).unwrap_or_default();
    // Zeros are sent where there is no IMU.
    if quaternion.iter().any(|part| *part != 0.0) {
        add("quaternion", &BASE_QUATERNION);
        add("gyroscope", &BASE_RATES);
    }
}

/// sensor_msgs/Imu.
fn imu(message: &Value, out: &mut Columns) {
    let (Some(orientation), Some(rates)) =
        (message.get(&["orientation"]), message.get(&["angular_velocity"]))
    else {
        return;
    };
    let part = |value: &Value, name: &str| value.get(&[name]).and_then(Value::number);
    let quaternion: Option<Vec<f64>> =
        ["w", "x", "y", "z"].iter().map(|name| part(orientation, name)).collect();
    let rates: Option<Vec<f64>> = ["x", "y", "z"].iter().map(|name| part(rates, name)).collect();
    // By the type's definition, a covariance that begins with -1 states that the quantity is not measured.
    let measured = |covariance: &str| {
        let numbers = message.get(&[covariance]).and_then(Value::numbers).unwrap_or_default();
        numbers.first() != Some(&-1.0)
    };
    let quaternion = quaternion.filter(|_| measured("orientation_covariance"));
    let rates = rates.filter(|_| measured("angular_velocity_covariance"));
    // Some drivers without an estimate send zeros.
    if let Some(quaternion) = quaternion.filter(|parts| parts.iter().any(|part| *part != 0.0)) {
        out.extend(BASE_QUATERNION.iter().zip(quaternion).map(|(name, value)| ((*name).to_owned(), value)));
    }
    if let Some(rates) = rates {
        out.extend(BASE_RATES.iter().zip(rates).map(|(name, value)| ((*name).to_owned(), value)));
    }
}

/// geometry_msgs/Twist and TwistStamped as commands.
fn twist(message: &Value, out: &mut Columns) {
    let twist = message.get(&["twist"]).unwrap_or(message);
    let (Some(linear), Some(angular)) = (twist.get(&["linear"]), twist.get(&["angular"])) else { return };
    let part = |value: &Value, name: &str| value.get(&[name]).and_then(Value::number);
    let values = [part(linear, "x"), part(linear, "y"), part(angular, "z")];
    out.extend(COMMAND.iter().zip(values).filter_map(|(name, value)| Some(((*name).to_owned(), value?))));
}

/// All numbers of a message, named by their path.
pub(crate) fn flat(message: &Value) -> Columns {
    let mut out = Columns::new();
    // A list in place of recursion; messages may be deep.
    let mut waiting = vec![(String::new(), message)];
    while let Some((path, value)) = waiting.pop() {
        if out.len() >= MAX_FLAT {
            break;
        }
        match value {
            Value::Number(number) => out.push((path, *number)),
            Value::Numbers(numbers) if numbers.len() <= MAX_FLAT => {
                out.extend(numbers.iter().enumerate().map(|(i, number)| (format!("{path}[{i}]"), *number)));
            }
            Value::List(items) if items.len() <= MAX_FLAT => {
                waiting.extend(items.iter().enumerate().map(|(i, item)| (format!("{path}[{i}]"), item)));
            }
            Value::Struct(fields) => {
                let join =
                    |name: &str| if path.is_empty() { name.to_owned() } else { format!("{path}.{name}") };
                waiting.extend(fields.iter().map(|(name, item)| (join(name), item)));
            }
            _ => {}
        }
    }
    out
}
