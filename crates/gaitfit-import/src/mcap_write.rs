//! A log as an MCAP file of ROS 2 messages, which Foxglove, PlotJuggler and ROS 2 open.

use crate::ImportError;
use gaitfit_log::Trajectory;
use mcap::records::{MessageHeader, Metadata};
use mcap::write::NoSeek;
use std::collections::BTreeMap;
use std::io::{Cursor, Seek, Write};

/// Name of the metadata record that holds what messages do not say.
pub(crate) const METADATA: &str = "gaitfit";
/// Unix times begin here, s: the year 2001. Logs that begin earlier are written as if they began at 1 s, because
/// readers take a stamp of 0 for one that is not set.
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

const ROBOT_STATE: &str = "std_msgs/Header header\nstring[] name\nfloat64[] temperature\nfloat64 battery_charge\n\
float64 battery_voltage\nfloat64 age\n";

/// Head of an MCAP log: all but its samples.
#[derive(Clone, Debug)]
pub struct McapHead<'a> {
    /// The joints, in the order of all rows.
    pub joints: &'a [String],
    /// Rate of the samples, Hz.
    pub rate_hz: f64,
    /// Name of the robot.
    pub robot: Option<&'a str>,
    /// Position and velocity gains, in the joints' order: N·m/rad, N·m·s/rad.
    pub gains: Option<(&'a [f64], &'a [f64])>,
    /// Whether the robot fell at the end.
    pub fell: bool,
}

/// A sample of an MCAP log. What is `None` or empty has no message.
#[derive(Clone, Copy, Debug, Default)]
pub struct McapRow<'a> {
    /// When, s; Unix time or since a beginning, which is then 1 s.
    pub time: f64,
    /// Joint positions, rad.
    pub position: &'a [f64],
    /// Joint velocities, rad/s.
    pub velocity: &'a [f64],
    /// Joint torques, N·m.
    pub torque: &'a [f64],
    /// How long after the row its target and action were sent, s.
    pub lead: f64,
    /// Position targets, rad.
    pub target: Option<&'a [f64]>,
    /// Actions, without unit.
    pub action: Option<&'a [f64]>,
    /// Command: forward, left, m/s, yaw rate, rad/s.
    pub command: Option<[f64; 3]>,
    /// Orientation of the base in the world: w, x, y, z.
    pub quaternion: Option<[f64; 4]>,
    /// Angular velocity of the base in its own frame, rad/s.
    pub angular_velocity: Option<[f64; 3]>,
    /// Reading of the accelerometer, in the base's frame, m/s².
    pub acceleration: Option<[f64; 3]>,
    /// State of motors and battery.
    pub state: Option<McapState<'a>>,
}

/// State of motors and battery of a robot.
#[derive(Clone, Copy, Debug)]
pub struct McapState<'a> {
    /// Temperatures of the motors, in the joints' order, °C.
    pub temperature: &'a [f64],
    /// Charge of the battery, %, and its voltage, V; not a number if they are not reported.
    pub battery: [f64; 2],
    /// Age of the sample when it was used, s.
    pub age: f64,
}

/// An MCAP file of ROS 2 messages that is being written.
///
/// Topics: `/joint_states` and `/joint_targets`, `/joint_actions` (`sensor_msgs/JointState`; positions in rad, torques as
/// efforts, actions without unit), `/cmd_vel` (`geometry_msgs/TwistStamped`), `/imu` (`sensor_msgs/Imu`, base frame),
/// `/robot_state` (of gaitfit's own type, whose definition is in the file). Gains, rate and robot are in a metadata record.
pub struct McapLog<W: Write + Seek> {
    writer: mcap::Writer<W>,
    joints: Vec<String>,
    /// Difference of messages' times and the log's times, s; known with the first row.
    shift: Option<f64>,
    rows: u32,
    channels: BTreeMap<&'static str, u16>,
}

/// An [`McapLog`] that may end at any moment.
pub type LiveMcap<W> = McapLog<NoSeek<W>>;

impl<W: Write> LiveMcap<W> {
    /// A log without chunks: `sink` is given whole records, and told to flush after each row. What it has then is read to
    /// that row, with the file's end or without it; the end is written when the log is dropped.
    ///
    /// # Errors
    /// What `sink` refuses.
    pub fn live(sink: W, head: &McapHead<'_>) -> Result<Self, ImportError> {
        // A chunk can be read only when it is whole, and a sink that is appended to cannot seek.
        let options = mcap::WriteOptions::new().use_chunks(false).disable_seeking(true);
        Self::begin(options, NoSeek::new(sink), head)
    }

    /// Writes a row's messages and flushes the sink.
    ///
    /// # Errors
    /// See [`McapLog::row`].
    pub fn flushed(&mut self, row: &McapRow<'_>) -> Result<(), ImportError> {
        self.row(row)?;
        self.writer.flush().map_err(|error| damaged(&error))
    }
}

impl<W: Write + Seek> McapLog<W> {
    fn begin(options: mcap::WriteOptions, sink: W, head: &McapHead<'_>) -> Result<Self, ImportError> {
        let options = options.compression(None).profile("ros2").library("gaitfit");
        let mut writer = options.create(sink).map_err(|error| damaged(&error))?;
        writer.write_metadata(&metadata(head)).map_err(|error| damaged(&error))?;
        let joints = head.joints.to_vec();
        Ok(Self { writer, joints, shift: None, rows: 0, channels: BTreeMap::new() })
    }

    /// Writes a row's messages.
    ///
    /// # Errors
    /// A time that no message can have; what the sink refuses.
    pub fn row(&mut self, row: &McapRow<'_>) -> Result<(), ImportError> {
        // Messages have unsigned times, so a log on a clock of its own is shifted once, by its first row.
        let start = if row.time >= UNIX_S { 0.0 } else { 1.0 - row.time };
        let at = row.time + *self.shift.get_or_insert(start);
        // Stamps of ROS 2 have 32 bits of seconds with a sign.
        if !(0.0..=f64::from(i32::MAX)).contains(&at) {
            let problem = format!("{} s is no time that a message can have; cut the log there", row.time);
            return Err(ImportError::Clock { stream: "the log".into(), problem });
        }
        let ns = (at * 1e9).round() as u64;
        let states = Message::joint_state(ns, &self.joints, [row.position, row.velocity, row.torque]);
        self.send("/joint_states", ns, states)?;
        for (topic, values) in [("/joint_targets", row.target), ("/joint_actions", row.action)] {
            if let Some(values) = values {
                // Targets get the time at which they were sent, so that a reader finds the same lead again.
                let sent = ((at + row.lead) * 1e9).round() as u64;
                let message = Message::joint_state(sent, &self.joints, [values, &[], &[]]);
                self.send(topic, sent, message)?;
            }
        }
        if let Some([vx, vy, wz]) = row.command {
            let mut message = Message::new(ns);
            message.numbers(&[vx, vy, 0.0, 0.0, 0.0, wz]);
            self.send("/cmd_vel", ns, message)?;
        }
        if row.quaternion.is_some() || row.angular_velocity.is_some() {
            self.send("/imu", ns, Message::imu(ns, row))?;
        }
        if let Some(state) = row.state {
            let mut message = Message::new(ns);
            message.texts(&self.joints);
            message.row(state.temperature);
            message.numbers(&[state.battery[0], state.battery[1], state.age]);
            self.send("/robot_state", ns, message)?;
        }
        self.rows = self.rows.saturating_add(1);
        Ok(())
    }

    /// Writes the end of the file: statistics and where things are.
    ///
    /// # Errors
    /// What the sink refuses.
    pub fn finish(&mut self) -> Result<(), ImportError> {
        self.writer.finish().map(|_| ()).map_err(|error| damaged(&error))
    }

    fn send(&mut self, topic: &'static str, ns: u64, message: Message) -> Result<(), ImportError> {
        let channel_id = match self.channels.get(topic) {
            Some(channel) => *channel,
            // With its first message, so that a topic without messages does not show.
            None => {
                let (kind, definition) = definition(topic);
                let schema = self.writer.add_schema(kind, "ros2msg", definition.as_bytes());
                let channel = schema
                    .and_then(|schema| self.writer.add_channel(schema, topic, "cdr", &BTreeMap::new()))
                    .map_err(|error| damaged(&error))?;
                self.channels.insert(topic, channel);
                channel
            }
        };
        let header = MessageHeader { channel_id, sequence: self.rows, log_time: ns, publish_time: ns };
        self.writer.write_to_known_channel(&header, &message.0).map_err(|error| damaged(&error))
    }
}

fn damaged(error: &mcap::McapError) -> ImportError {
    ImportError::Clock { stream: "the log".into(), problem: error.to_string() }
}

/// Type and definition of a topic's messages.
fn definition(topic: &str) -> (&'static str, String) {
    match topic {
        "/cmd_vel" => ("geometry_msgs/msg/TwistStamped", [TWIST, HEADER, VECTOR].concat()),
        "/imu" => ("sensor_msgs/msg/Imu", [IMU, HEADER, VECTOR].concat()),
        "/robot_state" => ("gaitfit_msgs/msg/RobotState", [ROBOT_STATE, HEADER].concat()),
        _ => ("sensor_msgs/msg/JointState", [JOINT_STATE, HEADER].concat()),
    }
}

/// The bytes of an MCAP file with the log's messages ([`McapLog`]), and what of the log is not in it. A log that does not
/// begin at a Unix time begins at 1 s.
///
/// # Errors
/// A trajectory that [`Trajectory::validate`] refuses; times that go backwards or do not fit.
pub fn mcap_bytes(log: &Trajectory) -> Result<(Vec<u8>, Vec<&'static str>), ImportError> {
    log.validate()?;
    let head = McapHead {
        joints: &log.joints,
        rate_hz: log.rate_hz,
        robot: log.robot.as_deref(),
        gains: log.gains.as_ref().map(|gains| (&gains.kp[..], &gains.kd[..])),
        fell: log.fell,
    };
    let mut bytes = Cursor::new(Vec::new());
    let mut file = McapLog::begin(mcap::WriteOptions::new(), &mut bytes, &head)?;
    let width = log.joints.len();
    let base = log.base.clone().unwrap_or_default();
    for sample in 0..log.len() {
        let row = sample * width..(sample + 1) * width;
        file.row(&McapRow {
            time: log.time[sample],
            lead: log.lead.map_or(0.0, |lead| lead.seconds),
            position: &log.position[row.clone()],
            velocity: &log.velocity[row.clone()],
            target: log.target.as_ref().map(|values| &values[row.clone()]),
            action: log.action.as_ref().map(|values| &values[row.clone()]),
            command: numbers(&log.command, sample),
            quaternion: numbers(&base.quaternion, sample),
            angular_velocity: numbers(&base.angular_velocity, sample),
            // A trajectory has no torques, accelerations and temperatures.
            ..McapRow::default()
        })?;
    }
    file.finish()?;
    // It borrows the bytes.
    drop(file);
    let velocities = !log.velocity_joints.is_empty();
    let left_out = [
        (velocities, "the header's velocity_joints: which targets are velocities"),
        (base.position.is_some(), "the base's position"),
        (base.linear_velocity.is_some(), "the base's velocity"),
        (log.motion.is_some(), "the place in the motion: motion_time and motion_heading"),
        (log.simulated_step.is_some(), "the header's simulated_step_s: the physics step of a simulator"),
    ];
    let left_out = left_out.into_iter().filter_map(|(is, what)| is.then_some(what)).collect();
    Ok((bytes.into_inner(), left_out))
}

/// A sample's numbers, `N` in a row.
fn numbers<const N: usize>(rows: &Option<Vec<f64>>, sample: usize) -> Option<[f64; N]> {
    rows.as_ref().map(|rows| std::array::from_fn(|k| rows[N * sample + k]))
}

/// Returns the head of a log as text.
fn metadata(head: &McapHead<'_>) -> Metadata {
    let mut entries = BTreeMap::new();
    let mut add = |name: &str, text: String| drop(entries.insert(name.to_owned(), text));
    add("rate_hz", format!("{:?}", head.rate_hz));
    if let Some(robot) = head.robot {
        add("robot", robot.to_owned());
    }
    if let Some((kp, kd)) = head.gains {
        add("kp", format!("{kp:?}"));
        add("kd", format!("{kd:?}"));
    }
    if head.fell {
        add("fell", "true".into());
    }
    Metadata { name: METADATA.to_owned(), metadata: entries }
}

/// A message in little-endian CDR that begins with a header.
struct Message(Vec<u8>);

impl Message {
    fn new(ns: u64) -> Self {
        // The head of little-endian CDR.
        let mut message = Message(vec![0, 1, 0, 0]);
        message.u32((ns / 1_000_000_000) as u32);
        message.u32((ns % 1_000_000_000) as u32);
        message.text("");
        message
    }

    /// Positions, velocities, efforts.
    fn joint_state(ns: u64, names: &[String], rows: [&[f64]; 3]) -> Self {
        let mut message = Message::new(ns);
        message.texts(names);
        rows.into_iter().for_each(|row| message.row(row));
        message
    }

    /// An orientation of zeros, and a covariance that begins with −1, say that there is none.
    fn imu(ns: u64, row: &McapRow<'_>) -> Self {
        let mut message = Message::new(ns);
        let mut part = |values: &[f64], known: bool| {
            message.numbers(values);
            // Zeros: it is measured, and its covariance is not known (`sensor_msgs/msg/Imu`).
            message.numbers(&[if known { 0.0 } else { -1.0 }, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0, 0.0]);
        };
        let [w, x, y, z] = row.quaternion.unwrap_or_default();
        part(&[x, y, z, w], row.quaternion.is_some());
        for values in [row.angular_velocity, row.acceleration] {
            part(&values.unwrap_or_default(), values.is_some());
        }
        message
    }

    fn texts(&mut self, texts: &[String]) {
        self.u32(texts.len() as u32);
        texts.iter().for_each(|text| self.text(text));
    }

    /// A sequence, whose length comes first.
    fn row(&mut self, values: &[f64]) {
        self.u32(values.len() as u32);
        self.numbers(values);
    }

    fn numbers(&mut self, values: &[f64]) {
        values.iter().for_each(|value| self.f64(*value));
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
        // CDR counts the zero at the end.
        self.u32(text.len() as u32 + 1);
        self.0.extend(text.as_bytes());
        self.0.push(0);
    }
}
