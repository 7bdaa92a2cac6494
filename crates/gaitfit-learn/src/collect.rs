//! Logs of a policy in a simulator, as a robot would record them.

use gaitfit_log::{BaseState, Gains, Trajectory};
use gaitfit_policy::MotionPlace;
use gaitfit_random::{Purpose, Stream};

use std::sync::{Mutex, PoisonError};

use crate::evaluate::Subject;
use crate::player::Player;
use crate::task::{Ended, Environment, Task, TaskError};
use crate::tiles::in_tiles;

/// Settings of a recording.
#[derive(Clone, Debug, PartialEq)]
pub struct CollectOptions {
    /// Trajectories.
    pub count: usize,
    /// Length of each, s.
    pub seconds: f64,
    /// The log begins this long after the robot, drawn uniformly for each trajectory, s.
    pub shift: [f64; 2],
    /// Whether the base's position and velocity are recorded too, which a robot does not measure. Orientation and body
    /// rates always are: an inertial unit measures them.
    pub privileged: bool,
}

impl CollectOptions {
    /// At most how many control periods are simulated, summed over all robots. `period`: the control period, s.
    pub fn periods(&self, period: f64) -> usize {
        // A log has one row at least, see `Recorder::new`.
        self.count * ((self.seconds + self.shift[1]) / period).round().max(1.0) as usize
    }
}

/// One trajectory and how it ended.
#[derive(Clone, Debug, PartialEq)]
pub struct Collected {
    /// The log, the policy's joint order.
    pub trajectory: Trajectory,
    /// Whether the robot fell; the log ends there.
    pub fell: bool,
}

/// Environments that one thread advances together.
const TILE: usize = 64;

/// Runs the subject's policy and records every robot's joint signals and inertial unit at the control rate: a row holds
/// position and velocity as the policy saw them, and the action and target that followed. Commands are drawn as the
/// task says. Results do not depend on the number of threads.
///
/// # Errors
/// A robot that cannot be, or the subject's `cancel`.
pub fn collect(
    subject: &Subject<'_>,
    options: &CollectOptions,
    threads: usize,
) -> Result<Vec<Collected>, TaskError> {
    in_tiles(options.count, TILE, threads, |first, count| collect_tile(subject, options, first, count))
}

/// Records the same logs and gives each to `each` with its trajectory's number as soon as its tile is done,
/// from any thread and in any order.
///
/// # Errors
/// As [`collect`], and the first error of `each`, after which no further tile begins.
pub fn collect_each<E: From<TaskError> + Send>(
    subject: &Subject<'_>,
    options: &CollectOptions,
    threads: usize,
    each: impl Fn(usize, Collected) -> Result<(), E> + Sync,
) -> Result<(), E> {
    let failed = Mutex::new(None);
    let tile = |first: u32, count: usize| {
        for (log, number) in collect_tile(subject, options, first, count)?.into_iter().zip(first as usize..) {
            if let Err(error) = each(number, log) {
                // The first error is what the caller gets; the one returned here only stops further tiles.
                failed.lock().unwrap_or_else(PoisonError::into_inner).get_or_insert(error);
                return Err(TaskError::Interrupted);
            }
        }
        Ok(Vec::<()>::new())
    };
    let done = in_tiles(options.count, TILE, threads, tile);
    match failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
        Some(error) => Err(error),
        None => Ok(done.map(drop)?),
    }
}

fn collect_tile(
    subject: &Subject<'_>,
    options: &CollectOptions,
    first: u32,
    count: usize,
) -> Result<Vec<Collected>, TaskError> {
    let Subject { task, candidate, seed, .. } = *subject;
    let environment = Environment::new(task, candidate, seed, first, count)?;
    let mut player = Player::new(subject, environment);
    let mut recorder = Recorder::new(subject, options, first, count);
    let actions = task.walker.joints.len();
    let mut row = Vec::with_capacity(sensed_width(actions));
    // The starts were drawn as of step 0 (`Environment::new`). A number is never used twice, so periods begin with 1.
    for step in 1..=recorder.last() {
        // A row has the readings before the step, and the action and target that followed from them.
        for index in 0..count {
            if recorder.records(index, step) {
                sensed(task, &player.environment, index, &mut row);
                recorder.sense(index, &row);
                recorder.follow(index, player.environment.motion_place(index));
            }
        }
        // Robots whose log is over move on too: a tile advances as a whole.
        player.step(step)?;
        let targets = player.environment.targets();
        // Targets are of all the model's joints, actions of those that the policy moves.
        let width = targets.len() / count;
        for index in 0..count {
            let action = &player.action[index * actions..(index + 1) * actions];
            let fell = matches!(player.ended[index], Ended::Fall | Ended::Diverged);
            recorder.act(index, step, action, &targets[index * width..(index + 1) * width], fell);
        }
    }
    Ok(recorder.finish())
}

/// Writes the state and command before an action of environment `index` of `task` into `row`, as
/// [`Recorder::sense`] takes it.
pub fn sensed(task: &Task, environment: &Environment<'_>, index: usize, row: &mut Vec<f32>) {
    let (motion, joints) = (environment.motion(), &task.walker.joints);
    let range = |values: &'_ [f32]| -> std::ops::Range<usize> {
        let width = values.len() / environment.count();
        index * width..(index + 1) * width
    };
    let position = &motion.joint_position[range(&motion.joint_position)];
    let velocity = &motion.velocity_readings()[range(&motion.joint_velocity)];
    row.clear();
    row.extend(joints.iter().map(|&joint| position[joint]));
    row.extend(joints.iter().map(|&joint| velocity[joint]));
    row.extend(environment.commands()[index]);
    // A unit that is late reads an older state, and its errors come on top of that.
    let (attitude, rates) = motion.imu_reading(index);
    let imu = environment.imu(index);
    row.extend(&motion.base_position[range(&motion.base_position)]);
    row.extend(imu.map_or(attitude, |imu| imu.attitude(attitude)));
    row.extend(&motion.base_linear[range(&motion.base_linear)]);
    row.extend(imu.map_or(rates, |imu| imu.rates(rates)));
}

/// Numbers of a row that [`Recorder::sense`] takes of a robot with this many actions.
pub fn sensed_width(actions: usize) -> usize {
    // Command 3; base: position 3, orientation 4, velocity 3, rates 3.
    2 * actions + 16
}

/// Logs of robots side by side, step by step, from whatever simulates them.
pub struct Recorder {
    logs: Vec<Collected>,
    /// Steps before each log begins.
    shifts: Vec<u32>,
    /// Steps of a log.
    steps: u32,
    /// The control period, s.
    dt: f64,
    /// The policy's joints in the model's order.
    joints: Vec<usize>,
}

impl Recorder {
    /// A recorder for the robots of the environments `first..first + count`.
    pub fn new(subject: &Subject<'_>, options: &CollectOptions, first: u32, count: usize) -> Self {
        let Subject { task, seed, .. } = *subject;
        let interface = &task.walker.interface;
        let dt = interface.control_dt;
        let shift = |index: u32| {
            let draw = Stream::new(seed, Purpose::LOG_SHIFT).environment(first + index).uniform(0);
            let [low, high] = options.shift;
            // Whole control periods: a log's rows are at the control rate.
            ((low + (high - low) * draw) / dt).round() as u32
        };
        let empty = || Trajectory {
            source: None,
            robot: Some(task.walker.model().name.clone()),
            joints: interface.joints.clone(),
            velocity_joints: interface.velocity_joints.clone(),
            time: Vec::new(),
            rate_hz: 1.0 / dt,
            position: Vec::new(),
            velocity: Vec::new(),
            target: Some(Vec::new()),
            action: Some(Vec::new()),
            command: Some(Vec::new()),
            motion: interface.reference.is_some().then(Vec::new),
            base: Some(BaseState {
                position: options.privileged.then(Vec::new),
                quaternion: Some(Vec::new()),
                linear_velocity: options.privileged.then(Vec::new),
                angular_velocity: Some(Vec::new()),
            }),
            gains: Some(Gains { kp: interface.kp.clone(), kd: interface.kd.clone() }),
            lead: None,
            simulated_step: Some(task.walker.physics_step()),
            fell: false,
        };
        Self {
            logs: (0..count).map(|_| Collected { trajectory: empty(), fell: false }).collect(),
            shifts: (0..count as u32).map(shift).collect(),
            // A log without rows could not be written.
            steps: (options.seconds / dt).round().max(1.0) as u32,
            dt,
            joints: task.walker.joints.clone(),
        }
    }

    /// Number of the last step that a log may have; the first is 1.
    pub fn last(&self) -> u32 {
        self.steps + self.shifts.iter().copied().max().unwrap_or(0)
    }

    /// Whether step number `step` of robot `index` is in its log.
    pub fn records(&self, index: usize, step: u32) -> bool {
        let shift = self.shifts[index];
        !self.logs[index].fell && step > shift && step <= shift + self.steps
    }

    /// Adds what was there before a step's action, of a robot whose step is [recorded](Self::records). `row`, of
    /// [`sensed_width`] numbers: joint positions and velocities in the policy's order (rad, rad/s) as the policy sees
    /// them; the command, forward and left (m/s) and yaw rate (rad/s); the base's position (m), orientation as the
    /// inertial unit reads it (wxyz), velocity in the world (m/s) and rates as the gyro reads them (rad/s).
    pub fn sense(&mut self, index: usize, row: &[f32]) {
        let Some(log) = self.logs.get_mut(index).map(|log| &mut log.trajectory) else { return };
        log.time.push(log.time.len() as f64 * self.dt);
        let mut rest = row;
        let mut next = |width: usize| {
            // A row that is too short leaves parts empty and does not panic.
            let (now, later) = rest.split_at(width.min(rest.len()));
            rest = later;
            now.iter().map(|&x| f64::from(x))
        };
        let actions = self.joints.len();
        log.position.extend(next(actions));
        log.velocity.extend(next(actions));
        log.command.get_or_insert_default().extend(next(3));
        if let Some(base) = &mut log.base {
            let parts = [
                &mut base.position,
                &mut base.quaternion,
                &mut base.linear_velocity,
                &mut base.angular_velocity,
            ];
            for (part, width) in parts.into_iter().zip([3, 4, 3, 3]) {
                // A part that is not recorded is passed over all the same.
                let values = next(width);
                if let Some(part) = part {
                    part.extend(values);
                }
            }
        }
    }

    /// Adds where a robot is in the motion that its policy follows, after [`Recorder::sense`]; nothing for other
    /// policies.
    pub fn follow(&mut self, index: usize, place: MotionPlace) {
        if let Some(motion) = self.logs.get_mut(index).and_then(|log| log.trajectory.motion.as_mut()) {
            motion.extend([place.time, place.heading]);
        }
    }

    /// Adds what followed in step number `step` of robot `index`: its action, the targets of all the model's joints
    /// (rad), and whether it fell. Call it for every step, because a log ends at the first fall.
    pub fn act(&mut self, index: usize, step: u32, action: &[f32], targets: &[f32], fell: bool) {
        // Asked before the fall is noted: the step of the fall is the log's last row.
        let recorded = self.records(index, step);
        let Some(log) = self.logs.get_mut(index) else { return };
        log.fell |= fell;
        if recorded {
            let trajectory = &mut log.trajectory;
            trajectory.action.get_or_insert_default().extend(action.iter().map(|&x| f64::from(x)));
            let target = |&joint: &usize| f64::from(targets[joint]);
            trajectory.target.get_or_insert_default().extend(self.joints.iter().map(target));
            trajectory.fell |= log.fell;
        }
    }

    /// The logs, in the robots' order.
    pub fn finish(self) -> Vec<Collected> {
        self.logs
    }
}
