//! The link to robots that speak ROS 2's messages.

use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Instant, SystemTime, UNIX_EPOCH};

use super::dds::{Dds, Inbox, Joining, Sending, lock};
use crate::RobotError;
use crate::command::Command;
use crate::listen::Topic;
use crate::robot::{CommandType, Robot};
use crate::ros::{
    DynamicJointState, Float64MultiArray, Imu, JointState, Stamp, States, Taken, array, dynamic,
};

/// States, names and inbox, which the messages of two topics share.
#[derive(Clone)]
struct Parts {
    states: Arc<Mutex<States>>,
    /// The joints' names for commands.
    names: Arc<Mutex<Vec<String>>>,
    inbox: Arc<Mutex<Inbox>>,
}

impl Parts {
    fn imu(&self, message: &Imu) {
        let taken = self.states.lock().unwrap_or_else(PoisonError::into_inner).imu(Instant::now(), message);
        self.keep(taken);
    }

    fn joints(&self, message: &JointState) {
        // Copied, so that the inbox is not locked while the states are.
        let patience = lock(&self.inbox).patience;
        let taken = {
            let mut states = self.states.lock().unwrap_or_else(PoisonError::into_inner);
            let taken = states.joints(Instant::now(), message, patience);
            let mut names = self.names.lock().unwrap_or_else(PoisonError::into_inner);
            states.keep_names(&mut names);
            taken
        };
        self.keep(taken);
    }

    fn keep(&self, taken: Result<Taken, String>) {
        let mut inbox = lock(&self.inbox);
        match taken {
            Ok(Taken::Reading(reading)) => {
                inbox.lacks = None;
                inbox.push(*reading);
            }
            Ok(Taken::Lacks(what)) => inbox.lacks = Some(what),
            Ok(Taken::Nothing) => {}
            Err(problem) => inbox.break_off(problem),
        }
    }
}

fn now() -> Stamp {
    let now = SystemTime::now().duration_since(UNIX_EPOCH).unwrap_or_default();
    // Seconds of ROS 2 are 32 bits with a sign (`builtin_interfaces/msg/Time`): they last until 2038.
    Stamp { sec: now.as_secs() as i32, nanosec: now.subsec_nanos() }
}

impl Joining {
    pub(super) fn ros2(mut self, robot: &Robot, silent: bool) -> Result<Dds, RobotError> {
        let ros = robot.ros2().map_err(RobotError::Topics)?;
        let states = States::new(robot, &ros);
        // Commands name the joints as the last states did, so both share the names.
        let names = Arc::new(Mutex::new(states.names()));
        let parts =
            Parts { states: Arc::new(Mutex::new(states)), names: Arc::clone(&names), inbox: self.inbox() };
        let dds = |topic: &Topic| (topic.dds_name(), topic.dds_type());
        let (name, kind) = dds(&ros.imu);
        // Each topic has a thread of its own, with the same parts.
        let into = parts.clone();
        self.hear((&name, &kind), "imu", move |message: Imu| into.imu(&message))?;
        let (name, kind) = dds(&ros.states);
        self.hear((&name, &kind), "states", move |message: JointState| parts.joints(&message))?;
        let (name, kind) = dds(&ros.commands);
        let sending = match ros.command_type {
            CommandType::DynamicJointState => {
                let writer = self.commands::<DynamicJointState>((&name, &kind), silent)?;
                writer.map(|writer| -> Sending {
                    Box::new(move |command: &Command| {
                        let message = {
                            let names = names.lock().unwrap_or_else(PoisonError::into_inner);
                            dynamic(command, &names, now())
                        };
                        writer.send(message)
                    })
                })
            }
            CommandType::Float64MultiArray => {
                let writer = self.commands::<Float64MultiArray>((&name, &kind), silent)?;
                let order = ros.order;
                writer.map(|writer| -> Sending {
                    Box::new(move |command: &Command| writer.send(array(command, &order)))
                })
            }
        };
        Ok(self.link(sending))
    }
}
