//! One robot at its task, apart from what simulates it.

use gaitfit_policy::observation::Layout;
use gaitfit_sim::RobotState;

use super::terrain::Way;
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
    /// On generated ground: level of its cell, distance walked along its commands and distance commanded (m) since its
    /// episode began; else zeros.
    pub way: [f32; 3],
    /// Angle by which the motion that its policy follows is turned, rad; 0 without one.
    pub turned: f32,
    /// Its last rows, actor's and critic's; empty at an episode's start, and without past frames.
    pub past: [Vec<f32>; 2],
}

impl Environment<'_> {
    /// The current state of environment `index`; its `returns` are not known here.
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
            way: self.ways.get(index).map_or([0.0; 3], Way::numbers),
            turned: self.turned[index],
            past: [0, 1].map(|who| self.past[who].row(index).map(<[f32]>::to_vec).unwrap_or_default()),
        }
    }

    /// Makes environment `index` what it was, here or on a GPU. The motion shows it after [`Environment::refresh`].
    ///
    /// # Errors
    /// A snapshot of another robot or ground.
    ///
    /// # Panics
    /// If there is no such environment: an error of the caller.
    pub fn set_snapshot(&mut self, index: usize, snapshot: &Snapshot) -> Result<(), TaskError> {
        let count = self.feet(index).len();
        if snapshot.last_action.len() != self.last_action.row(index).len() || snapshot.feet.len() != count {
            let what = "is of another task or robot".to_owned();
            return Err(TaskError::Setting { setting: "a robot's state".to_owned(), what });
        }
        let way = self.saved_ways(&snapshot.way).and_then(|ways| ways.into_iter().next());
        if !self.ways.is_empty() && way.is_none() {
            let what = "is of ground with other levels".to_owned();
            return Err(TaskError::Setting { setting: "a robot's state".to_owned(), what });
        }
        // All checks come before the first change. The simulator makes none if it refuses the robot.
        self.tile.set_robot(index, &snapshot.robot)?;
        if let Some((way, saved)) = self.ways.get_mut(index).zip(way) {
            *way = saved;
        }
        self.steps[index] = snapshot.steps;
        self.command[index] = snapshot.command;
        self.turned[index] = snapshot.turned;
        self.last_action.set(index, &snapshot.last_action);
        let widths = [&self.task.walker.observation, &self.task.walker.critic_observation].map(Layout::width);
        for ((past, row), width) in self.past.iter_mut().zip(&snapshot.past).zip(widths) {
            // An empty row stands for the start of an episode, where there is no past yet.
            past.begin(index);
            if row.len() == width {
                past.set(index, row);
            }
        }
        let feet = &mut self.feet[index * count..(index + 1) * count];
        for (foot, numbers) in feet.iter_mut().zip(&snapshot.feet) {
            *foot = Foot::from_numbers(numbers);
            // Numbers have the height on flat ground.
            foot.height -= self.task.walker.ground_under(foot.place);
        }
        Ok(())
    }

    /// Reports the motion anew.
    pub fn refresh(&mut self) {
        self.tile.observe(&mut self.motion);
    }
}
