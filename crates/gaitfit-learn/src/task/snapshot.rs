//! One robot at its task, apart from what simulates it.

use gaitfit_sim::RobotState;

use super::{Environment, Foot, TaskError};

/// One robot at its task: everything that changes from step to step.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Snapshot {
    /// The robot.
    pub robot: RobotState,
    /// Steps since its episode began.
    pub steps: u32,
    /// Its command.
    pub command: [f32; 3],
    /// Its last action, policy order.
    pub last_action: Vec<f32>,
    /// Its feet, as [`Foot::numbers`] lists them.
    pub feet: Vec<[f32; Foot::NUMBERS]>,
    /// Reward and steps since its episode began.
    pub returns: [f32; 2],
}

impl Environment<'_> {
    /// Environment `index` as it is; its `returns` are not known here.
    ///
    /// # Panics
    /// If there is no such environment: an error of the caller.
    pub fn snapshot(&mut self, index: usize) -> Snapshot {
        Snapshot {
            robot: self.tile.robot(index),
            steps: self.steps[index],
            command: self.command[index],
            last_action: self.last_action.row(index).to_vec(),
            feet: self.feet(index).iter().map(Foot::numbers).collect(),
            returns: [0.0; 2],
        }
    }

    /// Makes environment `index` what it was, here or on a GPU; past frames of observations begin anew. The motion shows it after [`Environment::refresh`].
    ///
    /// # Errors
    /// A snapshot of another robot.
    ///
    /// # Panics
    /// If there is no such environment: an error of the caller.
    pub fn set_snapshot(&mut self, index: usize, snapshot: &Snapshot) -> Result<(), TaskError> {
        let count = self.feet(index).len();
        if snapshot.last_action.len() != self.last_action.row(index).len() || snapshot.feet.len() != count {
            let what = "is of another task or robot".to_owned();
            return Err(TaskError::Setting { setting: "a robot's state".to_owned(), what });
        }
        self.tile.set_robot(index, &snapshot.robot)?;
        self.steps[index] = snapshot.steps;
        self.command[index] = snapshot.command;
        self.last_action.set(index, &snapshot.last_action);
        self.past.iter_mut().for_each(|past| past.begin(index));
        let feet = &mut self.feet[index * count..(index + 1) * count];
        for (foot, numbers) in feet.iter_mut().zip(&snapshot.feet) {
            *foot = Foot::from_numbers(numbers);
            foot.height -= self.task.walker.ground_under(foot.place);
        }
        Ok(())
    }

    /// Reports the motion anew.
    pub fn refresh(&mut self) {
        self.tile.observe(&mut self.motion);
    }
}
