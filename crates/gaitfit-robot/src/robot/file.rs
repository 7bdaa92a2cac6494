//! Reading and checking a robot's file.

use std::path::Path;

use gaitfit_model::with_meant;

use super::{Motor, Robot};
use crate::RobotError;

/// Largest file, bytes: the built-in ones have 5 kB.
const MAX_BYTES: u64 = 1 << 18;
/// Largest number in a file; beyond it lies no robot.
const LARGEST: f32 = 1e5;

/// The message of an error with its place in the text.
fn placed(text: &str, error: &toml::de::Error) -> String {
    let message = with_meant(error.message()).replace('\n', "; ");
    let Some(before) = error.span().and_then(|span| text.get(..span.start)) else { return message };
    let line = before.matches('\n').count() + 1;
    // Columns count characters, as editors do.
    let column = before.rsplit('\n').next().unwrap_or_default().chars().count() + 1;
    format!("line {line}, column {column}: {message}")
}

impl Robot {
    /// Reads a robot's file.
    ///
    /// # Errors
    /// A file that cannot be read, is no TOML, has other keys, or contradicts itself.
    pub fn read(path: &Path) -> Result<Self, RobotError> {
        let file = path.display().to_string();
        let text = gaitfit_log::regular_file::read_text(path, MAX_BYTES)
            .map_err(|error| RobotError::File { file: file.clone(), problem: format!(": {error}") })?;
        Self::parse(&text, &file)
    }

    /// A robot's file as text; `file` is its name for errors.
    ///
    /// # Errors
    /// As [`Robot::read`].
    pub fn parse(text: &str, file: &str) -> Result<Self, RobotError> {
        let refuse =
            |problem: String| RobotError::File { file: file.to_owned(), problem: format!(": {problem}") };
        let robot: Self = toml::from_str(text).map_err(|error| refuse(placed(text, &error)))?;
        match robot.wrong() {
            Some(problem) => Err(refuse(problem)),
            None => Ok(robot),
        }
    }

    /// Returns the first contradiction of the file, in words.
    fn wrong(&self) -> Option<String> {
        let slots = self.messages.slots();
        if self.motors.is_empty() || self.motors.len() > slots {
            return Some(format!("{} motors; its messages have slots for 1 to {slots}", self.motors.len()));
        }
        if self.name.is_empty() || self.policies.is_empty() || self.policies.iter().any(String::is_empty) {
            return Some(
                "`name` or `policies` is empty; name the robot, and the names by which policies know it"
                    .to_owned(),
            );
        }
        if self.state_topic().is_empty() || self.command_topic().is_empty() {
            return Some(
                "`state_topic` or `command_topic` is empty; leave it out for the usual one".to_owned(),
            );
        }
        if let Some(problem) = self.wrong_kind() {
            return Some(problem);
        }
        // The comparison is written so that NaN fails too.
        let rules = [("tilt", self.guard.tilt), ("kp", self.guard.kp), ("kd", self.guard.kd)];
        if let Some((name, value)) = rules.into_iter().find(|(_, value)| !(*value > 0.0 && *value <= LARGEST))
        {
            return Some(format!("`guard.{name}` is {value}; give a number above 0"));
        }
        let mut taken = Vec::with_capacity(self.motors.len());
        let mut named = Vec::with_capacity(self.motors.len());
        // Without `slot` motors are in the messages' order.
        for (index, motor) in self.motors.iter().enumerate() {
            let slot = motor.slot.unwrap_or(index);
            let name = &motor.joint;
            if slot >= slots || taken.contains(&slot) {
                return Some(format!(
                    "motor `{name}` is in slot {slot}; slots are 0 to {}, each once",
                    slots - 1
                ));
            }
            taken.push(slot);
            for name in std::iter::once(name).chain(&motor.aliases) {
                // `Motor::moves` takes the ending away before it compares.
                if name.is_empty() || name.ends_with("_joint") || named.contains(&name) {
                    return Some(format!("motor `{name}`: name each joint once, without `_joint`"));
                }
                named.push(name);
            }
            if let Some(problem) = self.wrong_motor(motor) {
                return Some(format!("motor `{name}`: {problem}"));
            }
        }
        None
    }

    fn wrong_motor(&self, motor: &Motor) -> Option<String> {
        let positive = [("speed", motor.speed), ("torque", motor.torque)];
        if let Some((name, value)) =
            positive.into_iter().find(|(_, value)| !(*value > 0.0 && *value <= LARGEST))
        {
            return Some(format!("`{name}` is {value}; give a number above 0"));
        }
        // The guard clamps larger gains: the robot would stand up more softly than its file says.
        let gains = [
            ("kp", motor.kp, self.guard.kp),
            ("kd", motor.kd, self.guard.kd),
            ("damping", motor.damping, self.guard.kd),
        ];
        if let Some((name, value, max)) =
            gains.into_iter().find(|(_, value, max)| !(0.0..=*max).contains(value))
        {
            return Some(format!("`{name}` is {value}; the guard lets 0 to {max} through"));
        }
        if motor.damping == 0.0 {
            return Some("`damping` is 0; it must resist motion when the robot is stopped".to_owned());
        }
        // ] A wheel has no range, but its angles must be finite numbers too.
        let [low, high] = motor.range.unwrap_or([-LARGEST, LARGEST]);
        if !(low < high && low >= -LARGEST && high <= LARGEST) {
            return Some(format!("`range` is {low} to {high}; give the lower angle first"));
        }
        let poses = [("lying", Some(motor.lying)), ("held", motor.held), ("hanging", motor.hanging)];
        let outside = |value: Option<f32>| value.is_some_and(|angle| !(low..=high).contains(&angle));
        let (name, _) = poses.into_iter().find(|(_, value)| outside(*value))?;
        Some(format!("`{name}` is outside its range, {low} to {high}"))
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::super::{BUILT_IN, Messages, Robot};

    fn go2() -> String {
        BUILT_IN[0].1.to_owned()
    }

    fn refused(text: &str) -> String {
        Robot::parse(text, "mine.toml").unwrap_err().to_string()
    }

    #[test]
    fn the_built_in_robots_are_read() {
        let all: Vec<(usize, Messages)> = BUILT_IN
            .iter()
            .map(|(name, _)| Robot::built_in(name).map(|robot| (robot.motors.len(), robot.messages)).unwrap())
            .collect();
        use Messages::{UnitreeGo, UnitreeHg};
        assert_eq!(
            all,
            [(12, UnitreeGo), (16, UnitreeGo), (12, UnitreeGo), (29, UnitreeHg), (27, UnitreeHg)]
        );
        assert!(Robot::built_in("unitree-go9").unwrap_err().to_string().contains("unitree-go2w"));
    }

    #[test]
    fn a_file_that_contradicts_itself_is_refused_with_file_motor_and_remedy() {
        for (from, to, words) in [
            ("kp = 100", "kp = -1", "guard.kp"),
            ("joint = \"FL_hip\"", "joint = \"FR_hip\"", "each joint once"),
            ("range = [-1.0472, 1.0472]", "range = [1.0472, -1.0472]", "lower angle first"),
            ("kp = 50", "kp = 150", "0 to 100"),
            ("lying = 0.0", "lying = 3.0", "`lying` is outside"),
            ("damping = 2", "damping = 0", "must resist"),
            ("torque = 23.7", "torque = nan", "`torque` is NaN"),
            ("unitree_go\"", "unitree_go3\"", "Did you mean `unitree_go`?"),
            ("tilt", "lean", "unknown field"),
            ("joint = \"FR_hip\"", "slot = 20, joint = \"FR_hip\"", "slots are 0 to 19"),
            ("joint = \"FR_hip\"", "slot = 1, joint = \"FR_hip\"", "`FR_thigh` is in slot 1"),
        ] {
            let text = go2();
            assert!(text.contains(from), "{from}");
            let error = refused(&text.replacen(from, to, 1));
            assert!(error.starts_with("mine.toml: ") && error.contains(words), "{from} → {to}: {error}");
        }
        let line = go2().lines().find(|line| line.contains("FR_hip")).unwrap().to_owned();
        let many: String = (0..21).map(|k| line.replace("FR_hip", &format!("j{k}")) + "\n").collect();
        let head = go2().split("motors = [").next().unwrap().to_owned();
        assert!(refused(&format!("{head}motors = [\n{many}]")).contains("21 motors"));
        assert!(refused(&format!("{head}motors = []")).contains("0 motors"));
    }
}
