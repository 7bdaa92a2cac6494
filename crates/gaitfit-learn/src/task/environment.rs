//! One tile of robots at a task.

use gaitfit_policy::MotionPlace;
use gaitfit_policy::observation::{LastAction, Past};
use gaitfit_policy::walker::TorqueNoise;
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::{Candidate, Imu, Motion, Tile};

use super::command::{command, within};
use super::error::refuse;
use super::feet::Foot;
use super::judge::Ended;
use super::reward::Scratch;
use super::start::start;
use super::terrain::Way;
use super::{Interval, Task, TaskError, UserTerms};

/// One tile of robots at a task; rows are environments.
///
/// Steps are numbered by the caller (one number a control period, never used twice): all draws are functions of
/// the seed, the environment's number and the step's.
pub struct Environment<'a> {
    pub(super) task: &'a Task,
    pub(super) seed: u64,
    /// Number of the tile's first environment.
    pub(super) first: u32,
    pub(super) tile: Tile<'a>,
    pub(super) motion: Motion,
    pub(super) steps: Vec<u32>,
    pub(super) command: Vec<[f32; 3]>,
    /// Ranges that commands are drawn from.
    ranges: [Interval; 3],
    pub(super) last_action: LastAction,
    /// Angle by which the motion that the policy follows is turned in this episode, rad.
    pub(super) turned: Vec<f32>,
    /// Rows of the step before, of actor and critic.
    pub(super) past: [Past; 2],
    pub(super) targets: Vec<f32>,
    /// `environments × feet`.
    pub(super) feet: Vec<Foot>,
    /// One an environment on generated ground; else none.
    pub(super) ways: Vec<Way>,
    /// Sum of each reward term since [`Environment::take_terms`].
    pub(super) terms: Vec<f64>,
    /// Errors of each environment in the last step, see [`Environment::tracking_error`].
    pub(super) errors: Vec<[f32; 2]>,
    /// Memory for the reward terms of a step.
    pub(super) scratch: Scratch,
    /// The first environment whose reward was not finite in the last step, and the term that was not.
    pub(super) broken_term: Option<(usize, usize)>,
    /// Commands set from outside are not redrawn.
    held_commands: bool,
    /// Deviation of each environment's torque noise, N·m.
    deviations: Vec<f64>,
    /// The inertial unit of each environment, where it has errors.
    imus: Vec<Option<Imu>>,
    noise: TorqueNoise,
}

impl<'a> Environment<'a> {
    /// Environments `first..first + count` of the task, started at step 0, around `candidate` (the robot of the
    /// file if none is given).
    ///
    /// # Errors
    /// A randomisation that leaves no robot; a candidate of another robot.
    pub fn new(
        task: &'a Task,
        candidate: Option<&Candidate>,
        seed: u64,
        first: u32,
        count: usize,
    ) -> Result<Self, TaskError> {
        match candidate {
            Some(candidate) => Self::among(task, std::slice::from_ref(candidate), seed, first, count),
            None => {
                let nominal = Candidate::nominal(task.walker.model());
                Self::among(task, std::slice::from_ref(&nominal), seed, first, count)
            }
        }
    }

    /// As [`Environment::new`], around several robots: environment number `e` around number `e` modulo their
    /// count. Their networks must be the same.
    ///
    /// # Errors
    /// As [`Environment::new`]; no robots, or robots whose networks differ.
    pub fn among(
        task: &'a Task,
        candidates: &[Candidate],
        seed: u64,
        first: u32,
        count: usize,
    ) -> Result<Self, TaskError> {
        let walker = &task.walker;
        let Some(candidate) = candidates.first() else {
            return refuse("robots", "are none".to_owned());
        };
        // The tile takes one set of networks for all its robots.
        if candidates.iter().any(|other| other.networks != candidate.networks) {
            return refuse("robots", "have different networks, which robots of a tile share".to_owned());
        }
        let robots = task.robots(candidates, seed, first, count)?;
        let robot_number = |environment: u32| environment as usize % candidates.len();
        let tile_candidates =
            || (first..first + count as u32).map(|number| &candidates[robot_number(number)]);
        // Torque noise and the inertial unit belong to the candidate that a robot is varied around.
        let deviations = tile_candidates().map(|candidate| candidate.torque_noise).collect();
        let imus = tile_candidates().map(|candidate| candidate.sensors.imu()).collect();
        let joints = walker.joints.len();
        let mut environment = Self {
            task,
            seed,
            first,
            tile: walker.engine.tile(&walker.batch, &robots, &candidate.networks)?,
            motion: walker.batch.motion(count),
            steps: vec![0; count],
            command: vec![[0.0; 3]; count],
            // The widest ranges; a training with a curriculum narrows them before its first step.
            ranges: task.settings.command.ranges(1.0),
            last_action: LastAction::new(count, joints),
            turned: vec![0.0; count],
            past: [&walker.observation, &walker.critic_observation].map(|layout| Past::new(layout, count)),
            targets: vec![0.0; count * walker.default_pose.len()],
            feet: vec![Foot::default(); count * task.settings.feet.len()],
            // Empty on ground without cells, where nothing is counted.
            ways: vec![Way::default(); if task.course.is_some() { count } else { 0 }],
            terms: vec![0.0; task.rewards.terms().len()],
            errors: vec![[0.0; 2]; count],
            scratch: task.rewards.scratch(),
            broken_term: None,
            held_commands: false,
            deviations,
            imus,
            noise: TorqueNoise::default(),
        };
        // The level comes first: it decides where the robot starts.
        for index in 0..count {
            environment.draw_level(index, 0);
            environment.restart(index, 0);
        }
        environment.tile.observe(&mut environment.motion);
        Ok(environment)
    }

    /// Environments in the tile.
    pub fn count(&self) -> usize {
        self.steps.len()
    }

    /// The task.
    pub fn task(&self) -> &'a Task {
        self.task
    }

    /// The function of the caller that changes rewards and ends of episodes, if the task has one.
    pub fn user_terms(&self) -> Option<&'a UserTerms> {
        self.task.user_terms.as_ref()
    }

    /// The tile's motion after the last step.
    pub fn motion(&self) -> &Motion {
        &self.motion
    }

    /// The inertial unit of environment `index`; absent if it has no errors.
    pub fn imu(&self, index: usize) -> Option<&Imu> {
        self.imus[index].as_ref()
    }

    /// Feet of environment `index`.
    pub fn feet(&self, index: usize) -> &[Foot] {
        let feet = self.task.settings.feet.len();
        &self.feet[index * feet..(index + 1) * feet]
    }

    /// Commands, one an environment.
    pub fn commands(&self) -> &[[f32; 3]] {
        &self.command
    }

    /// Position targets sent in the last step, rad, model order; `environments × joints`.
    pub fn targets(&self) -> &[f32] {
        &self.targets
    }

    /// Sets the command of environment `index`, until the next one is drawn.
    pub fn set_command(&mut self, index: usize, command: [f32; 3]) {
        self.command[index] = command;
    }

    /// Sets the command of environment `index` and stops drawing commands in this tile.
    pub fn hold_command(&mut self, index: usize, command: [f32; 3]) {
        self.command[index] = command;
        self.held_commands = true;
    }

    /// Sets what commands are drawn from: forward, left, yaw rate. Those that robots have stay.
    pub fn set_command_ranges(&mut self, ranges: [Interval; 3]) {
        self.ranges = ranges;
    }

    /// Draws the commands of all environments, as at their start.
    pub fn draw_commands(&mut self) {
        for index in 0..self.count() {
            self.command[index] = self.drawn(self.first + index as u32, 0);
        }
    }

    /// The command that an environment gets at `step`.
    fn drawn(&self, environment: u32, step: u32) -> [f32; 3] {
        command(&self.ranges, self.task.settings.command.standing, self.seed, environment, step)
    }

    /// Steps that are left of the episode of environment `index`.
    pub fn steps_left(&self, index: usize) -> u32 {
        self.task.episode_steps().saturating_sub(self.steps[index])
    }

    /// Spreads the episodes' ages evenly, so that time-outs do not come in waves.
    pub fn stagger(&mut self) {
        for (index, steps) in self.steps.iter_mut().enumerate() {
            *steps = self.task.staggered_age(self.seed, self.first + index as u32);
        }
    }

    /// Sums of the weighted reward terms since the last call, in [`Task::reward_names`] order.
    pub fn take_terms(&mut self) -> Vec<f64> {
        let none = vec![0.0; self.terms.len()];
        std::mem::replace(&mut self.terms, none)
    }

    /// Name of the reward term that was not finite in the last step, if it is what made environment `index`, the first
    /// that diverged, diverge.
    pub fn broken_term(&self, index: usize) -> Option<&str> {
        let (_, term) = self.broken_term.filter(|(environment, _)| *environment == index)?;
        self.task.rewards.terms().get(term).map(|term| term.name.as_str())
    }

    /// Starts a new episode of environment `index` at `step`.
    pub(super) fn restart(&mut self, index: usize, step: u32) {
        let number = self.first + index as u32;
        let place = self.start_place(index, step);
        let start = start(self.task, self.seed, number, step, place);
        self.tile.place(index, &start);
        self.turned[index] = self.task.turned(&start);
        self.steps[index] = 0;
        if !self.held_commands {
            self.command[index] = self.drawn(number, step);
        }
        // Nothing of the old episode may show in what the new one observes and is paid for.
        self.last_action.begin(index);
        self.past.iter_mut().for_each(|past| past.begin(index));
        let feet = self.task.settings.feet.len();
        self.feet[index * feet..(index + 1) * feet].fill(Foot::default());
    }

    /// Place of environment `index` in the motion that the policy follows.
    pub fn motion_place(&self, index: usize) -> MotionPlace {
        let time = f64::from(self.steps[index]) * self.task.walker.interface.control_dt;
        MotionPlace { time, heading: f64::from(self.turned[index]) }
    }

    /// Root-mean-square difference between the policy's joints and the motion, rad; `None` if the policy follows no motion.
    pub fn motion_error(&self, index: usize) -> Option<f32> {
        let walker = &self.task.walker;
        let wanted = walker.observation.motion_position(self.motion_place(index).time)?;
        let angles = &self.motion.joint_position[index * walker.default_pose.len()..];
        // The motion has angles of the policy's joints, the simulator of all the model's.
        let squares =
            walker.joints.iter().zip(&wanted).map(|(&joint, wanted)| (angles[joint] - wanted).powi(2));
        Some((squares.sum::<f32>() / wanted.len().max(1) as f32).sqrt())
    }

    pub(super) fn clock(&self, index: usize) -> f32 {
        self.task.walker.clock(self.steps[index])
    }

    /// One control period under `actions` (`environments × joints`, policy order): writes what each environment
    /// was paid and whether its episode ended. Ended episodes stay where they are until
    /// [`Environment::begin_episodes`].
    pub fn step(&mut self, step: u32, actions: &[f32], reward: &mut [f32], ended: &mut [Ended]) {
        let task = self.task;
        // Before the step: the past rows are those of the state in which the actions were chosen.
        self.remember(step);
        task.walker.targets(actions, &mut self.targets);
        // A push changes the velocity at once, so the step that follows already computes with it.
        self.push(step);
        let torques = self.noise.torques_of(&task.walker, &self.deviations, self.seed, self.first, step);
        self.tile.step(&self.targets, torques, &mut self.motion);
        // Ages and feet come before the rewards, which read both.
        for index in 0..self.count() {
            self.steps[index] += 1;
            self.step_feet(index);
        }
        self.judge(actions, reward, ended);
        self.last_action.take(actions);
        if !self.held_commands {
            let period = task.command_steps();
            for index in 0..self.count() {
                // Steps count from the start of the episode, which has drawn the first command.
                if self.steps[index].is_multiple_of(period) {
                    let number = self.first + index as u32;
                    // The observation that shows the new command belongs to the next step.
                    self.command[index] = self.drawn(number, step + 1);
                }
            }
        }
    }

    /// Starts new episodes where they ended; the step that ended them was `step`.
    pub fn begin_episodes(&mut self, step: u32, ended: &[Ended]) {
        let mut any = false;
        for (index, ended) in ended.iter().enumerate() {
            if *ended != Ended::No {
                self.move_on(index, step + 1, *ended);
                self.restart(index, step + 1);
                any = true;
            }
        }
        if any {
            self.tile.observe(&mut self.motion);
        }
    }

    fn push(&mut self, step: u32) {
        let settings = &self.task.settings.push;
        // 0 seconds turn pushes off.
        let period = (settings.seconds / self.task.walker.interface.control_dt).round() as u32;
        if period == 0 || settings.velocity == 0.0 {
            return;
        }
        for index in 0..self.count() {
            let number = self.first + index as u32;
            // Robots are pushed at different times.
            // An episode's first period begins as the start's settings say, without a push.
            // Neighbours' pushes lie 7 control periods apart, modulo the period.
            let due = step.wrapping_add(number.wrapping_mul(7)).is_multiple_of(period);
            if due && self.steps[index] > 0 {
                let stream = Stream::new(self.seed, Purpose::PUSH).environment(number).step(step);
                let jump = [-settings.velocity, settings.velocity];
                self.tile.push(index, [within(stream, 0, jump) as f32, within(stream, 1, jump) as f32, 0.0]);
            }
        }
    }

    fn step_feet(&mut self, index: usize) {
        let task = self.task;
        let feet = task.walker.feet.len();
        let geoms = task.walker.batch.contact_geoms().len();
        let dt = task.walker.interface.control_dt as f32;
        for (k, contact) in task.walker.feet.iter().enumerate() {
            // A foot may have several geoms; their forces add up.
            let forces = &self.motion.normal_force[index * geoms..(index + 1) * geoms];
            let force: f32 = contact.geoms.iter().map(|&geom| forces[geom]).sum();
            let at = 3 * (index * feet + k);
            let place = [self.motion.tracked[at], self.motion.tracked[at + 1], self.motion.tracked[at + 2]];
            let foot = &mut self.feet[index * feet + k];
            // Episodes may begin in their midst, and far from the origin.
            let fresh = task.course.is_some() && *foot == Foot::default();
            let begins = self.steps[index] <= 1 || fresh;
            foot.advance(force, place, task.walker.ground_under(place), dt, begins);
        }
    }

    /// Angular velocity of environment `index` about the vertical, rad/s.
    pub fn yaw_rate(&self, index: usize) -> f32 {
        self.base(index).yaw_rate
    }

    /// Horizontal velocity error (m/s) and yaw-rate error (rad/s) of environment `index` after the last step, against
    /// the command that it had in this step. A command that was drawn at the step's end does not count.
    pub fn tracking_error(&self, index: usize) -> [f32; 2] {
        self.errors[index]
    }
}
