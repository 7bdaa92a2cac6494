//! Names of topics and types: ROS 2's, and those that DDS has for them.

use std::collections::BTreeMap;

use crate::RobotError;

/// Max number of topics of a recording.
pub const MAX_TOPICS: usize = 64;
/// Longest name, bytes.
const LONGEST: usize = 200;

/// A topic of ROS 2. Topics are ordered by name, then by type.
#[derive(Clone, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub struct Topic {
    /// Its name, such as `/joint_states`.
    pub name: String,
    /// Its type, such as `sensor_msgs/msg/JointState`.
    pub kind: String,
}

impl Topic {
    /// A topic of this name and type. The name may be without its slash, or as DDS has it; the type may lack `msg`.
    ///
    /// # Errors
    /// In words: names that no topic or type can have.
    pub fn new(name: &str, kind: &str) -> Result<Self, String> {
        let shown = name.escape_debug();
        // ROS 2 allows no other letters in names.
        let plain = |text: &str, more: &str| {
            !text.is_empty()
                && text.len() <= LONGEST
                && text.chars().all(|c| c.is_ascii_alphanumeric() || more.contains(c))
        };
        // DDS puts `rt/` before names of ROS 2's topics.
        let short = name.strip_prefix("rt/").unwrap_or(name).trim_start_matches('/');
        if !plain(short, "_/") {
            return Err(format!("`{shown}` is no name of a topic; names have letters, digits, _ and /"));
        }
        let parts: Vec<&str> = kind.split('/').filter(|part| *part != "msg").collect();
        let [package, type_name] = parts[..] else {
            return Err(format!(
                "`{shown}`: `{}` is no type; write package/msg/Name, such as sensor_msgs/msg/JointState",
                kind.escape_debug()
            ));
        };
        if !(plain(package, "_") && plain(type_name, "_")) {
            return Err(format!("`{shown}`: `{}` is no name of a type", kind.escape_debug()));
        }
        Ok(Self { name: format!("/{short}"), kind: format!("{package}/msg/{type_name}") })
    }

    /// Its name in DDS: `rt/joint_states`.
    pub fn dds_name(&self) -> String {
        format!("rt{}", self.name)
    }

    /// Its type's name in DDS: `sensor_msgs::msg::dds_::JointState_`.
    pub fn dds_type(&self) -> String {
        let (package, name) = self.kind.split_once("/msg/").unwrap_or_default();
        format!("{package}::msg::dds_::{name}_")
    }

    /// Makes a topic of its names in DDS; `None` where they are not ROS 2's.
    pub fn from_dds(name: &str, kind: &str) -> Option<Self> {
        // The slash stays: a topic's name in ROS begins with it.
        let name = name.strip_prefix("rt").filter(|name| name.starts_with('/'))?;
        let (package, kind) = kind.split_once("::msg::dds_::")?;
        Some(Self { name: name.to_owned(), kind: format!("{package}/msg/{}", kind.strip_suffix('_')?) })
    }
}

/// Topics from a table of names and types. A name may be without its slash, or as DDS has it; a type may lack `msg`.
///
/// # Errors
/// No topics, or more than [`MAX_TOPICS`]; names that no topic or type can have.
pub fn topics(table: &BTreeMap<String, String>) -> Result<Vec<Topic>, RobotError> {
    let refuse = |problem: String| Err(RobotError::Topics(problem));
    if table.is_empty() {
        return refuse(
            "there are none; add a table such as [topics] with \"/joint_states\" = \"sensor_msgs/msg/JointState\"".to_owned(),
        );
    }
    if table.len() > MAX_TOPICS {
        return refuse(format!("{} of them; {MAX_TOPICS} at most", table.len()));
    }
    let mut topics: Vec<Topic> = Vec::with_capacity(table.len());
    for (name, kind) in table {
        let topic = Topic::new(name, kind).map_err(RobotError::Topics)?;
        // One topic may be written in several ways, which are the same only now.
        if topics.iter().any(|other| other.name == topic.name) {
            return refuse(format!("`{}` is there twice; name each topic once", topic.name));
        }
        topics.push(topic);
    }
    Ok(topics)
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;

    fn table(rows: &[(&str, &str)]) -> BTreeMap<String, String> {
        rows.iter().map(|(name, kind)| ((*name).to_owned(), (*kind).to_owned())).collect()
    }

    #[test]
    fn names_are_ros_2s_in_dds_and_back() {
        let topics = topics(&table(&[
            ("/robot/joint_states", "sensor_msgs/msg/JointState"),
            ("imu", "sensor_msgs/Imu"),
            ("rt/lowstate", "unitree_go/msg/LowState"),
        ]));
        let topics = topics.unwrap();
        let names: Vec<(String, String)> =
            topics.iter().map(|topic| (topic.dds_name(), topic.dds_type())).collect();
        let wanted = [
            ("rt/robot/joint_states", "sensor_msgs::msg::dds_::JointState_"),
            ("rt/imu", "sensor_msgs::msg::dds_::Imu_"),
            ("rt/lowstate", "unitree_go::msg::dds_::LowState_"),
        ];
        for (name, kind) in wanted {
            assert!(names.contains(&(name.to_owned(), kind.to_owned())), "{name} {names:?}");
        }
        for topic in &topics {
            assert_eq!(Topic::from_dds(&topic.dds_name(), &topic.dds_type()).as_ref(), Some(topic));
        }
        assert_eq!(Topic::from_dds("ros_discovery_info", "rmw_dds_common::msg::dds_::X_"), None);
    }

    #[test]
    fn what_no_topic_is_called_is_refused_with_a_remedy() {
        for (name, kind, words) in [
            ("/joint states", "sensor_msgs/msg/JointState", "letters, digits"),
            ("/", "sensor_msgs/msg/JointState", "no name of a topic"),
            ("/imu", "Imu", "package/msg/Name"),
            ("/imu", "sensor_msgs/msg/Im u", "no name of a type"),
            ("/imu", "a/b/c/d", "package/msg/Name"),
        ] {
            let error = topics(&table(&[(name, kind)])).unwrap_err().to_string();
            assert!(error.contains(words), "{name} {kind}: {error}");
        }
        assert!(topics(&table(&[])).unwrap_err().to_string().contains("[topics]"));
        let twice = table(&[("/imu", "sensor_msgs/msg/Imu"), ("imu", "sensor_msgs/msg/Imu")]);
        assert!(topics(&twice).unwrap_err().to_string().contains("twice"));
        let many: BTreeMap<String, String> =
            (0..65).map(|k| (format!("/t{k}"), "sensor_msgs/msg/Imu".to_owned())).collect();
        assert!(topics(&many).unwrap_err().to_string().contains("64 at most"));
    }
}
