//! Topics of a robot that speaks ROS 2, as its file states them.

use serde::Deserialize;

use super::{Messages, Robot};
use crate::listen::Topic;

/// A number of a command, by ros2_control's names.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum CommandPart {
    /// Angle wanted, rad.
    Position,
    /// Velocity wanted, rad/s.
    Velocity,
    /// Torque added, N·m.
    Effort,
    /// Position gain, N·m/rad.
    Stiffness,
    /// Velocity gain, N·m·s/rad.
    Damping,
}

impl CommandPart {
    /// All, in the order of messages that name them.
    pub const ALL: [Self; 5] = [Self::Position, Self::Velocity, Self::Effort, Self::Stiffness, Self::Damping];

    /// Its name.
    pub fn name(self) -> &'static str {
        match self {
            Self::Position => "position",
            Self::Velocity => "velocity",
            Self::Effort => "effort",
            Self::Stiffness => "stiffness",
            Self::Damping => "damping",
        }
    }
}

/// Type of the commands' messages.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Deserialize)]
pub enum CommandType {
    /// Names of joints and of numbers beside the numbers.
    #[default]
    #[serde(rename = "control_msgs/msg/DynamicJointState")]
    DynamicJointState,
    /// Numbers alone.
    #[serde(rename = "std_msgs/msg/Float64MultiArray")]
    Float64MultiArray,
}

impl CommandType {
    fn name(self) -> &'static str {
        match self {
            Self::DynamicJointState => "control_msgs/msg/DynamicJointState",
            Self::Float64MultiArray => "std_msgs/msg/Float64MultiArray",
        }
    }
}

/// Topics of a robot that speaks ROS 2.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Ros2 {
    /// Joint states.
    pub states: Topic,
    /// The inertial unit.
    pub imu: Topic,
    /// Commands.
    pub commands: Topic,
    /// Type of the commands' messages.
    pub command_type: CommandType,
    /// Numbers of each joint in messages without names.
    pub order: Vec<CommandPart>,
}

impl Robot {
    /// Its topics if it speaks ROS 2.
    ///
    /// # Errors
    /// In words: names that no topic has, or two topics of one name.
    pub fn ros2(&self) -> Result<Ros2, String> {
        let command_type = self.command_type.unwrap_or_default();
        let topic = |key: &str, name: Option<&str>, kind: &str| {
            Topic::new(name.unwrap_or_default(), kind).map_err(|problem| format!("`{key}`: {problem}"))
        };
        let topics = Ros2 {
            states: topic("state_topic", Some(self.state_topic()), "sensor_msgs/msg/JointState")?,
            imu: topic("imu_topic", self.imu_topic.as_deref().or(Some("/imu/data")), "sensor_msgs/msg/Imu")?,
            commands: topic("command_topic", Some(self.command_topic()), command_type.name())?,
            command_type,
            order: self.command_order.clone().unwrap_or_else(|| CommandPart::ALL.into()),
        };
        let names = [&topics.states.name, &topics.imu.name, &topics.commands.name];
        // This program would hear its own commands as states.
        if names[0] == names[1] || names[0] == names[2] || names[1] == names[2] {
            return Err(
                "two of `state_topic`, `imu_topic` and `command_topic` are the same; give each its own"
                    .to_owned(),
            );
        }
        Ok(topics)
    }

    /// Returns the first problem with the keys that only some messages have, in words.
    pub(super) fn wrong_kind(&self) -> Option<String> {
        if self.messages != Messages::Ros2 {
            return self.wrong_elsewhere();
        }
        if let Err(problem) = self.ros2() {
            return Some(problem);
        }
        if self.guard.charge.is_some() {
            return Some(
                "`guard.charge`: ROS 2's messages of joints have no battery; leave it out".to_owned(),
            );
        }
        if self.guard.temperature.is_some() {
            return Some(
                "`guard.temperature`: ROS 2's messages of joints have no temperatures; leave it out"
                    .to_owned(),
            );
        }
        if let Some(motor) = self.motors.iter().find(|motor| motor.slot.is_some()) {
            return Some(format!(
                "motor `{}`: `slot` is for Unitree's messages; ROS 2's have names. Leave it out; numbers of a \
                 Float64MultiArray are in the order of `motors`",
                motor.joint
            ));
        }
        self.wrong_names().or_else(|| self.wrong_order())
    }

    /// Returns the same for Unitree's messages.
    fn wrong_elsewhere(&self) -> Option<String> {
        if self.guard.temperature.is_none() {
            return Some("`guard.temperature` is missing; give the hottest a motor may be, in °C".to_owned());
        }
        // A key without effect would hide a mistake.
        let keys = [
            ("imu_topic", self.imu_topic.is_some()),
            ("command_type", self.command_type.is_some()),
            ("command_order", self.command_order.is_some()),
            ("topic_name", self.motors.iter().any(|motor| motor.topic_name.is_some())),
        ];
        let (key, _) = keys.into_iter().find(|(_, is_there)| *is_there)?;
        Some(format!("`{key}` is only for messages = \"ros2\"; leave it out, or change `messages`"))
    }

    fn wrong_names(&self) -> Option<String> {
        let mut seen: Vec<&str> = Vec::with_capacity(self.motors.len());
        for motor in &self.motors {
            let name = motor.topic_name.as_ref().unwrap_or(&motor.joint);
            // A message with a longer name is refused when it comes, so the joint would never be found.
            if name.is_empty() || name.len() > crate::ros::MAX_NAME || seen.contains(&name.as_str()) {
                return Some(format!(
                    "motor `{}`: the name `{name}` in messages; give each joint its own `topic_name` of 1 to {} bytes",
                    motor.joint,
                    crate::ros::MAX_NAME
                ));
            }
            seen.push(name);
        }
        None
    }

    fn wrong_order(&self) -> Option<String> {
        let array = self.command_type == Some(CommandType::Float64MultiArray);
        // Only arrays have an order, and they need one.
        let order = match &self.command_order {
            None if array => {
                return Some(
                    "`command_order` is missing; state which numbers of a joint the array has, such as [\"position\", \
                     \"velocity\", \"effort\", \"stiffness\", \"damping\"]"
                        .to_owned(),
                );
            }
            None => return None,
            Some(_) if !array => {
                return Some(
                    "`command_order` is only for command_type = \"std_msgs/msg/Float64MultiArray\"; other commands name \
                     their numbers. Leave it out"
                        .to_owned(),
                );
            }
            Some(order) => order,
        };
        let twice = order.iter().enumerate().find(|(at, one)| order[..*at].contains(one));
        if let Some((_, one)) = twice {
            return Some(format!("`command_order` has \"{}\" twice; name each number once", one.name()));
        }
        let lacks = |one: CommandPart| !order.contains(&one);
        if lacks(CommandPart::Position) {
            return Some("`command_order` lacks \"position\"; a policy's targets are positions".to_owned());
        }
        if let Some(gain) = [CommandPart::Stiffness, CommandPart::Damping].into_iter().find(|one| lacks(*one))
        {
            return Some(format!(
                "`command_order` lacks \"{}\"; without gains in its commands a robot cannot be damped, so it is not walked. \
                 Make the robot take them, and add both gains",
                gain.name()
            ));
        }
        if lacks(CommandPart::Velocity) && self.motors.iter().any(super::Motor::is_wheel) {
            return Some("`command_order` lacks \"velocity\"; wheels are moved by velocities".to_owned());
        }
        None
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::super::BUILT_IN;
    use super::*;

    const FILE: &str = r#"
name = "biped"
title = "toy biped"
policies = ["biped"]
messages = "ros2"
guard = { tilt = 60, kp = 100, kd = 5 }
motors = [
  { joint = "hip", range = [-1.0, 1.0], speed = 30, torque = 24, kp = 50, kd = 2, damping = 2, lying = 0.1 },
  { joint = "wheel", speed = 30, torque = 24, kp = 0, kd = 2, damping = 2, lying = 0 },
]
"#;

    const ARRAY: &str = "command_type = \"std_msgs/msg/Float64MultiArray\"\nguard";

    #[test]
    fn topics_have_ros_2s_usual_names_or_those_of_the_file() {
        let topics = Robot::parse(FILE, "biped.toml").unwrap().ros2().unwrap();
        let dds: Vec<(String, String)> = [&topics.states, &topics.imu, &topics.commands]
            .map(|one| (one.dds_name(), one.dds_type()))
            .into();
        let named = |name: &str, kind: &str| (name.to_owned(), kind.to_owned());
        let wanted = [
            named("rt/joint_states", "sensor_msgs::msg::dds_::JointState_"),
            named("rt/imu/data", "sensor_msgs::msg::dds_::Imu_"),
            named("rt/joint_commands", "control_msgs::msg::dds_::DynamicJointState_"),
        ];
        assert_eq!(dds, wanted);
        let keys = "state_topic = \"/dog/joint_states\"\nimu_topic = \"/dog/imu\"\ncommand_topic = \"dog/commands\"\nguard";
        let topics = Robot::parse(&FILE.replacen("guard", keys, 1), "biped.toml").unwrap().ros2().unwrap();
        let names = [&topics.states, &topics.imu, &topics.commands].map(Topic::dds_name);
        assert_eq!(names, ["rt/dog/joint_states", "rt/dog/imu", "rt/dog/commands"]);
    }

    #[test]
    fn a_file_that_messages_cannot_honour_is_refused_with_file_key_and_remedy() {
        let order = |order: &str| format!("command_order = {order}\n{ARRAY}");
        let order = |names: &str| ("guard", order(names));
        for ((from, to), words) in [
            (
                ("guard", "command_type = \"std_msgs/msg/Float64Array\"\nguard".to_owned()),
                "Float64MultiArray`",
            ),
            (("guard", "imu_topic = \"/joint_states\"\nguard".to_owned()), "give each its own"),
            (("guard", "imu_topic = \"/imu data\"\nguard".to_owned()), "`imu_topic`: `/imu data` is no name"),
            (("guard", "state_topic = \"\"\nguard".to_owned()), "leave it out for the usual one"),
            (("tilt", "charge = 10, tilt".to_owned()), "no battery; leave it out"),
            (("tilt", "temperature = 80, tilt".to_owned()), "no temperatures; leave it out"),
            (("joint = \"hip\"", "joint = \"hip\", slot = 3".to_owned()), "`slot` is for Unitree's"),
            (("joint = \"hip\"", "joint = \"hip\", topic_name = \"\"".to_owned()), "its own `topic_name`"),
            (
                ("joint = \"hip\"", "joint = \"hip\", topic_name = \"wheel\"".to_owned()),
                "its own `topic_name`",
            ),
            (("guard", ARRAY.to_owned()), "`command_order` is missing"),
            (
                ("guard", "command_order = [\"position\"]\nguard".to_owned()),
                "name their numbers. Leave it out",
            ),
            (order("[\"stiffness\", \"damping\"]"), "lacks \"position\""),
            (order("[\"position\", \"damping\"]"), "lacks \"stiffness\"; without gains"),
            (order("[\"position\", \"stiffness\"]"), "lacks \"damping\"; without gains"),
            (order("[\"position\", \"stiffness\", \"damping\"]"), "lacks \"velocity\"; wheels"),
            (order("[\"position\", \"position\"]"), "\"position\" twice"),
            (order("[\"position\", \"torque\"]"), "unknown variant `torque`"),
        ] {
            assert!(FILE.contains(from), "{from}");
            let error = Robot::parse(&FILE.replacen(from, &to, 1), "mine.toml").unwrap_err().to_string();
            assert!(error.starts_with("mine.toml: ") && error.contains(words), "{from} → {to}: {error}");
        }
        let whole = order("[\"position\", \"velocity\", \"stiffness\", \"damping\"]").1;
        assert!(Robot::parse(&FILE.replacen("guard", &whole, 1), "mine.toml").is_ok());
    }

    #[test]
    fn keys_of_ros_2_are_refused_beside_unitrees_messages() {
        let go2 = BUILT_IN[0].1;
        for (from, to, words) in [
            ("guard", "imu_topic = \"/imu/data\"\nguard", "`imu_topic` is only for messages = \"ros2\""),
            ("guard", "command_order = []\nguard", "`command_order` is only for"),
            ("joint = \"FR_hip\"", "joint = \"FR_hip\", topic_name = \"a\"", "`topic_name` is only for"),
            ("temperature = 80, ", "", "`guard.temperature` is missing"),
        ] {
            let error = Robot::parse(&go2.replacen(from, to, 1), "mine.toml").unwrap_err().to_string();
            assert!(error.starts_with("mine.toml: ") && error.contains(words), "{to}: {error}");
        }
    }
}
