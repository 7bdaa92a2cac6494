//! A log as an MCAP file of ROS 2 messages, which Foxglove, PlotJuggler and ROS 2 open.

use crate::ImportError;
use gaitfit_log::Trajectory;
use mcap::records::{MessageHeader, Metadata};
use std::collections::BTreeMap;
use std::io::Cursor;

/// Name of the metadata record that holds what messages do not say.
pub(crate) const METADATA: &str = "gaitfit";
/// Unix times begin here, s; logs that begin earlier are written as if they began at 1 s.
const UNIX_S: f64 = 1e9;

const HEADER: &str = "\
================================================================================\n\
MSG: std_msgs/Header\nbuiltin_interfaces/Time stamp\nstring frame_id\n\
================================================================================\n\
MSG: builtin_interfaces/Time\nint32 sec\nuint32 nanosec\n";
const VECTOR: &str = "\
================================================================================\n\
MSG: geometry_msgs/Vector3\nfloat64 x\nfloat64 y\nfloat64 z\n";
const JOINT_STATE: &str =
    "std_msgs/Header header\nstring[] name\nfloat64[] position\nfloat64[] velocity\nfloat64[] effort\n";
const TWIST: &str = "std_msgs/Header header\ngeometry_msgs/Twist twist\n\
================================================================================\n\
MSG: geometry_msgs/Twist\nVector3 linear\nVector3 angular\n";
const IMU: &str = "std_msgs/Header header\ngeometry_msgs/Quaternion orientation\nfloat64[9] orientation_covariance\n\
geometry_msgs/Vector3 angular_velocity\nfloat64[9] angular_velocity_covariance\n\
geometry_msgs/Vector3 linear_acceleration\nfloat64[9] linear_acceleration_covariance\n\
================================================================================\n\
MSG: geometry_msgs/Quaternion\nfloat64 x\nfloat64 y\nfloat64 z\nfloat64 w\n";

/// The bytes of an MCAP file with the log's messages, and what of the log is not in it.
///
/// Topics: `/joint_states` and `/joint_targets`, `/joint_actions` (`sensor_msgs/JointState`; positions in rad, actions
/// without unit), `/cmd_vel` (`geometry_msgs/TwistStamped`), `/imu` (`sensor_msgs/Imu`, base frame). Gains, rate and robot
/// are in a metadata record. A log that does not begin at a Unix time begins at 1 s.
///
/// # Errors
/// A trajectory that [`Trajectory::validate`] refuses; times that go backwards or do not fit.
pub fn mcap_bytes(log: &Trajectory) -> Result<(Vec<u8>, Vec<&'static str>), ImportError> {
    log.validate()?;
    let damaged =
        |error: mcap::McapError| ImportError::Clock { stream: "the log".into(), problem: error.to_string() };
    let options = mcap::WriteOptions::new().compression(None).profile("ros2").library("gaitfit");
    let mut writer = options.create(Cursor::new(Vec::new())).map_err(damaged)?;
    let mut channel = |topic: &str, kind: &str, parts: &[&str]| -> Result<u16, mcap::McapError> {
        let schema = writer.add_schema(kind, "ros2msg", parts.concat().as_bytes())?;
        writer.add_channel(schema, topic, "cdr", &BTreeMap::new())
    };
    const KIND: &str = "sensor_msgs/msg/JointState";
    let states = channel("/joint_states", KIND, &[JOINT_STATE, HEADER]).map_err(damaged)?;
    let mut joints = Vec::new();
    for (topic, values) in [("/joint_targets", &log.target), ("/joint_actions", &log.action)] {
        if let Some(values) = values {
            joints.push((channel(topic, KIND, &[JOINT_STATE, HEADER]).map_err(damaged)?, values));
        }
    }
    let command = match &log.command {
        Some(values) => {
            let kind = "geometry_msgs/msg/TwistStamped";
            Some((channel("/cmd_vel", kind, &[TWIST, HEADER, VECTOR]).map_err(damaged)?, values))
        }
        None => None,
    };
    let base = log.base.clone().unwrap_or_default();
    let imu = match base.quaternion.is_some() || base.angular_velocity.is_some() {
        true => Some(channel("/imu", "sensor_msgs/msg/Imu", &[IMU, HEADER, VECTOR]).map_err(damaged)?),
        false => None,
    };

    let width = log.joints.len();
    let start = log.time.first().copied().unwrap_or(0.0);
    let shift = if start >= UNIX_S { 0.0 } else { 1.0 - start };
    for sample in 0..log.len() {
        let at = log.time[sample] + shift;
        if !(0.0..=f64::from(i32::MAX)).contains(&at) {
            let problem =
                format!("{} s is no time that a message can have; cut the log there", log.time[sample]);
            return Err(ImportError::Clock { stream: "the log".into(), problem });
        }
        let ns = (at * 1e9).round() as u64;
        let mut send = |channel_id: u16, message: Message| {
            let sequence = u32::try_from(sample).unwrap_or(u32::MAX);
            let header = MessageHeader { channel_id, sequence, log_time: ns, publish_time: ns };
            writer.write_to_known_channel(&header, &message.0).map_err(damaged)
        };
        let row = |values: &[f64]| values[sample * width..(sample + 1) * width].to_vec();
        send(states, Message::joint_state(ns, &log.joints, &row(&log.position), &row(&log.velocity)))?;
        for (channel, values) in &joints {
            send(*channel, Message::joint_state(ns, &log.joints, &row(values), &[]))?;
        }
        if let Some((channel, values)) = &command {
            let [vx, vy, wz] = [values[3 * sample], values[3 * sample + 1], values[3 * sample + 2]];
            let mut message = Message::new(ns);
            [vx, vy, 0.0, 0.0, 0.0, wz].into_iter().for_each(|number| message.f64(number));
            send(*channel, message)?;
        }
        if let Some(channel) = imu {
            // An orientation of zeros, and a covariance that begins with −1, say that there is none.
            let quaternion = base.quaternion.as_ref().map_or([0.0; 4], |q| {
                let q = &q[4 * sample..4 * sample + 4];
                [q[1], q[2], q[3], q[0]]
            });
            let rates = base
                .angular_velocity
                .as_ref()
                .map_or([0.0; 3], |rates| [rates[3 * sample], rates[3 * sample + 1], rates[3 * sample + 2]]);
            let mut message = Message::new(ns);
            let unknown =
                |known: bool| [if known { 0.0 } else { -1.0 }, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0];
            quaternion
                .into_iter()
                .chain(unknown(base.quaternion.is_some()))
                .for_each(|number| message.f64(number));
            rates
                .into_iter()
                .chain(unknown(base.angular_velocity.is_some()))
                .for_each(|number| message.f64(number));
            [0.0; 3].into_iter().chain(unknown(false)).for_each(|number| message.f64(number));
            send(channel, message)?;
        }
    }
    writer.write_metadata(&metadata(log)).map_err(damaged)?;
    writer.finish().map_err(damaged)?;
    let left_out = [
        (base.position.is_some(), "the base's position"),
        (base.linear_velocity.is_some(), "the base's velocity"),
    ];
    let left_out = left_out.into_iter().filter_map(|(is, what)| is.then_some(what)).collect();
    Ok((writer.into_inner().into_inner(), left_out))
}

/// What the log says beside its samples, as text.
fn metadata(log: &Trajectory) -> Metadata {
    let mut entries = BTreeMap::new();
    let mut add = |name: &str, text: String| drop(entries.insert(name.to_owned(), text));
    add("rate_hz", format!("{:?}", log.rate_hz));
    if let Some(robot) = &log.robot {
        add("robot", robot.clone());
    }
    if let Some(gains) = &log.gains {
        add("kp", format!("{:?}", gains.kp));
        add("kd", format!("{:?}", gains.kd));
    }
    if log.fell {
        add("fell", "true".into());
    }
    Metadata { name: METADATA.to_owned(), metadata: entries }
}

/// A message in little-endian CDR that begins with a header.
struct Message(Vec<u8>);

impl Message {
    fn new(ns: u64) -> Self {
        let mut message = Message(vec![0, 1, 0, 0]);
        message.u32((ns / 1_000_000_000) as u32);
        message.u32((ns % 1_000_000_000) as u32);
        message.text("");
        message
    }

    fn joint_state(ns: u64, names: &[String], position: &[f64], velocity: &[f64]) -> Self {
        let mut message = Message::new(ns);
        message.u32(names.len() as u32);
        names.iter().for_each(|name| message.text(name));
        for values in [position, velocity, &[]] {
            message.u32(values.len() as u32);
            values.iter().for_each(|value| message.f64(*value));
        }
        message
    }

    /// Numbers begin at multiples of their size, counted after the first four bytes.
    fn align(&mut self, size: usize) {
        while !(self.0.len() - 4).is_multiple_of(size) {
            self.0.push(0);
        }
    }

    fn u32(&mut self, number: u32) {
        self.align(4);
        self.0.extend(number.to_le_bytes());
    }

    fn f64(&mut self, number: f64) {
        self.align(8);
        self.0.extend(number.to_le_bytes());
    }

    fn text(&mut self, text: &str) {
        self.u32(text.len() as u32 + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
    }
}
