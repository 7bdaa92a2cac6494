//! A robot's states from two topics: each message of the joints with the newest of the inertial unit.

use std::time::{Duration, Instant};

use super::messages::{Imu, JointState, Stamp};
use crate::per_motor::PerMotor;
use crate::remote::Remote;
use crate::robot::{Robot, Ros2};
use crate::state::{Reading, RobotState, Seal};

/// Names that an error lists at most.
const LISTED: usize = 40;
/// First number of a covariance whose quantity is not measured, by the definition of `sensor_msgs/msg/Imu`.
const UNKNOWN: f64 = -1.0;

/// Result of taking a message.
#[derive(Clone, Debug, PartialEq)]
pub enum Taken {
    /// A state.
    Reading(Box<Reading>),
    /// None, because of what is missing, in words.
    Lacks(String),
    /// None yet.
    Nothing,
}

/// Puts states together.
#[derive(Clone, Debug)]
pub struct States {
    /// Name of each motor's joint, and whether `_joint` may be behind it.
    motors: Vec<(String, bool)>,
    joint_topic: String,
    imu_topic: String,
    /// The newest message of the inertial unit, and when it came.
    imu: Option<(Instant, Imu)>,
    /// The names of the last message of the joints, and where each motor is among them.
    names: Vec<String>,
    places: PerMotor<usize>,
}

impl States {
    /// The states of a robot, before any message.
    pub fn new(robot: &Robot, ros: &Ros2) -> Self {
        let name = |motor: &crate::robot::Motor| match &motor.topic_name {
            Some(name) => (name.clone(), false),
            None => (motor.joint.clone(), true),
        };
        Self {
            motors: robot.motors.iter().map(name).collect(),
            joint_topic: ros.states.name.clone(),
            imu_topic: ros.imu.name.clone(),
            imu: None,
            names: Vec::new(),
            places: PerMotor::new(0, 0),
        }
    }

    /// The joints' names in messages, motor order: as the last message has them, before one came as the robot's file has them.
    pub fn names(&self) -> Vec<String> {
        if self.names.is_empty() {
            return self.motors.iter().map(|(name, _)| name.clone()).collect();
        }
        self.places.iter().map(|&place| self.names[place].clone()).collect()
    }

    /// Writes [`Self::names`] to `names` if they changed.
    pub fn keep_names(&self, names: &mut Vec<String>) {
        // Messages come hundreds of times a second, and names hardly ever change: a comparison allocates
        // nothing.
        let same = |(place, name): (&usize, &String)| self.names[*place] == *name;
        if !self.names.is_empty() && !self.places.iter().zip(names.iter()).all(same) {
            *names = self.names();
        }
    }

    /// Takes a message of the inertial unit that came at `now`. One with the stamp of the last has no news and is passed over.
    ///
    /// # Errors
    /// A unit without orientation or body rates.
    pub fn imu(&mut self, now: Instant, message: &Imu) -> Result<Taken, String> {
        let stamp = message.header.stamp;
        // A driver that sets no stamps sends 0 each time; its messages all count as new.
        if self.imu.is_some_and(|(_, last)| stamp != Stamp::default() && stamp == last.header.stamp) {
            return Ok(Taken::Nothing);
        }
        for (name, covariance) in [
            ("orientation", &message.orientation_covariance),
            ("angular_velocity", &message.angular_velocity_covariance),
        ] {
            if covariance[0] == UNKNOWN {
                return Err(format!(
                    "the inertial unit on {} states that it does not measure {name} (its covariance begins with -1); name a topic \
                     with it as imu_topic in the robot's file",
                    self.imu_topic
                ));
            }
        }
        self.imu = Some((now, *message));
        Ok(match self.names.is_empty() {
            true => Taken::Lacks(format!("no joint states: nothing on {}", self.joint_topic)),
            false => Taken::Nothing,
        })
    }

    /// Takes a message of the joints that came at `now`. With an inertial unit that is older than `patience` there is no state.
    ///
    /// # Errors
    /// Motors that the message lacks or names twice, arrays of other lengths.
    pub fn joints(
        &mut self,
        now: Instant,
        message: &JointState,
        patience: Duration,
    ) -> Result<Taken, String> {
        // Places are found once: messages repeat the same names. Before the first ones, a message without names has the same
        // empty list and no motor.
        if (self.names.is_empty() || message.name != self.names) && !self.find(&message.name)? {
            // Another program's joints beside those of the robot.
            if !self.names.is_empty() {
                return Ok(Taken::Nothing);
            }
            return Ok(Taken::Lacks(format!(
                "no motor of the robot on {}; its messages have {}",
                self.joint_topic,
                listed(&message.name)
            )));
        }
        let count = message.name.len();
        let lengths = [("position", &message.position), ("velocity", &message.velocity)];
        if let Some((field, values)) = lengths.into_iter().find(|(_, values)| values.len() != count) {
            return Err(format!(
                "a message on {} has {count} names and {} numbers of `{field}`; the robot must publish it for each joint",
                self.joint_topic,
                values.len()
            ));
        }
        if !message.effort.is_empty() && message.effort.len() != count {
            return Err(format!(
                "a message on {} has {count} names and {} numbers of `effort`; it may have {count} or none",
                self.joint_topic,
                message.effort.len()
            ));
        }
        // Joints give the rate of states; the newest message of the inertial unit goes with each.
        let Some((came, imu)) = &self.imu else {
            return Ok(Taken::Lacks(format!("no inertial unit: nothing on {}", self.imu_topic)));
        };
        let age = now.saturating_duration_since(*came);
        if age > patience {
            return Ok(Taken::Lacks(format!(
                "no inertial unit: nothing on {} for {} ms",
                self.imu_topic,
                age.as_millis()
            )));
        }
        Ok(Taken::Reading(Box::new(self.reading(message, imu))))
    }

    /// Finds the motors among `names`; `false` if none of them is there.
    fn find(&mut self, names: &[String]) -> Result<bool, String> {
        let is = |motor: &(String, bool), name: &str| {
            let (known, suffixed) = motor;
            name == known || *suffixed && name.strip_suffix("_joint") == Some(known)
        };
        let place = |motor: &(String, bool)| {
            let mut places =
                names.iter().enumerate().filter(|(_, name)| is(motor, name)).map(|(place, _)| place);
            // The second shows whether the name is there twice.
            (places.next(), places.next())
        };
        let places: Vec<_> = self.motors.iter().map(place).collect();
        // Another program may publish joints of its own on this topic.
        if places.iter().all(|(first, _)| first.is_none()) {
            return Ok(false);
        }
        for ((name, _), place) in self.motors.iter().zip(&places) {
            let problem = match place {
                (Some(_), None) => continue,
                (None, _) => "lacks",
                (Some(_), Some(_)) => "has more than once",
            };
            return Err(format!(
                "a message on {} {problem} the joint `{name}`; it has {}. One message must have all motors; name joints as the \
                 robot does with topic_name in the robot's file",
                self.joint_topic,
                listed(names)
            ));
        }
        self.places = PerMotor::from_fn(places.len(), |motor| places[motor].0.unwrap_or_default());
        self.names = names.to_vec();
        Ok(true)
    }

    fn reading(&self, message: &JointState, imu: &Imu) -> Reading {
        // `effort` may be empty and then reads 0. The other arrays are as long as the names.
        let values_of =
            |values: &[f64]| self.places.map(|place| values.get(place).map_or(0.0, |x| *x as f32));
        let three = |v: super::Vector3| [v.x, v.y, v.z].map(|x| x as f32);
        let q = imu.orientation;
        let state = RobotState {
            q: values_of(&message.position),
            dq: values_of(&message.velocity),
            torque: values_of(&message.effort),
            // These messages have no temperatures, errors, losses, battery and remote.
            temperature: self.places.map(|_| 0),
            error: self.places.map(|_| 0),
            lost: self.places.map(|_| 0),
            quaternion: [q.w, q.x, q.y, q.z].map(|x| x as f32),
            gyroscope: three(imu.angular_velocity),
            accelerometer: three(imu.linear_acceleration),
            battery: None,
            tick: message.header.stamp.ms(),
            remote: Remote::default(),
        };
        Reading { state, seal: Seal::Unused }
    }
}

/// Names for an error.
fn listed(names: &[String]) -> String {
    let mut shown: Vec<String> =
        names.iter().take(LISTED).map(|name| name.escape_debug().to_string()).collect();
    match names.len() {
        0 => return "no names".to_owned(),
        count if count > LISTED => shown.push(format!("{} more", count - LISTED)),
        _ => {}
    }
    shown.join(", ")
}
