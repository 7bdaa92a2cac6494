//! Logs of a policy in a simulator, as a robot would record them.

use gaitfit_log::{BaseState, Gains, Trajectory};
use gaitfit_random::{Purpose, Stream};

use crate::evaluate::Subject;
use crate::player::Player;
use crate::task::{Ended, Environment, TaskError};
use crate::tiles::in_tiles;

/// What is recorded.
#[derive(Clone, Debug, PartialEq)]
pub struct CollectOptions {
    /// Trajectories.
    pub count: usize,
    /// Length of each, s.
    pub seconds: f64,
    /// The log begins this long after the robot, drawn uniformly for each trajectory, s.
    pub shift: [f64; 2],
    /// Whether the base's pose and velocity are recorded too, which a robot does not measure.
    pub privileged: bool,
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

/// Runs the subject's policy and records every robot's joint signals at the control rate: a row holds position
/// and velocity as the policy saw them, and the action and target that followed. Commands are drawn as the task
/// says. Results do not depend on the number of threads.
///
/// # Errors
/// A robot that cannot be.
pub fn collect(
    subject: &Subject<'_>,
    options: &CollectOptions,
    threads: usize,
) -> Result<Vec<Collected>, TaskError> {
    in_tiles(options.count, TILE, threads, |first, count| collect_tile(subject, options, first, count))
}

fn collect_tile(
    subject: &Subject<'_>,
    options: &CollectOptions,
    first: u32,
    count: usize,
) -> Result<Vec<Collected>, TaskError> {
    let Subject { task, policy, candidate, seed } = *subject;
    let interface = &task.walker.interface;
    let dt = interface.control_dt;
    let environment = Environment::new(task, candidate, seed, first, count)?;
    let mut player = Player::new(task, policy, environment);
    let steps = (options.seconds / dt).round().max(1.0) as u32;
    let shifts: Vec<u32> = (0..count as u32)
        .map(|index| {
            let draw = Stream::new(seed, Purpose::LOG_SHIFT).environment(first + index).uniform(0);
            let [low, high] = options.shift;
            ((low + (high - low) * draw) / dt).round() as u32
        })
        .collect();
    let empty = || Trajectory {
        source: None,
        robot: Some(task.walker.model().name.clone()),
        joints: interface.joints.clone(),
        time: Vec::new(),
        rate_hz: 1.0 / dt,
        position: Vec::new(),
        velocity: Vec::new(),
        target: Some(Vec::new()),
        action: Some(Vec::new()),
        command: Some(Vec::new()),
        base: options.privileged.then(|| BaseState {
            position: Some(Vec::new()),
            quaternion: Some(Vec::new()),
            linear_velocity: Some(Vec::new()),
            angular_velocity: Some(Vec::new()),
        }),
        gains: Some(Gains { kp: interface.kp.clone(), kd: interface.kd.clone() }),
        fell: false,
    };
    let mut logs: Vec<Collected> =
        (0..count).map(|_| Collected { trajectory: empty(), fell: false }).collect();
    let last = steps + shifts.iter().copied().max().unwrap_or(0);
    for step in 1..=last {
        for (index, log) in logs.iter_mut().enumerate() {
            if recording(log, step, shifts[index], steps) {
                before_action(&mut log.trajectory, &player.environment, &task.walker.joints, index, dt);
            }
        }
        player.step(step)?;
        for (index, log) in logs.iter_mut().enumerate() {
            let recorded = recording(log, step, shifts[index], steps);
            if recorded {
                after_action(&mut log.trajectory, &player, &task.walker.joints, index);
            }
            log.fell |= matches!(player.ended[index], Ended::Fall | Ended::Diverged);
            log.trajectory.fell |= recorded && log.fell;
        }
    }
    Ok(logs)
}

fn recording(log: &Collected, step: u32, shift: u32, steps: u32) -> bool {
    !log.fell && step > shift && step <= shift + steps
}

fn before_action(
    log: &mut Trajectory,
    environment: &Environment<'_>,
    joints: &[usize],
    index: usize,
    dt: f64,
) {
    let motion = environment.motion();
    let row = |values: &[f32], width: usize| -> Vec<f64> {
        values[index * width..(index + 1) * width].iter().map(|&x| f64::from(x)).collect()
    };
    log.time.push(log.time.len() as f64 * dt);
    let width = motion.joint_position.len() / environment.count();
    let (position, velocity) = (row(&motion.joint_position, width), row(&motion.joint_velocity, width));
    log.position.extend(joints.iter().map(|&joint| position[joint]));
    log.velocity.extend(joints.iter().map(|&joint| velocity[joint]));
    let command = environment.commands()[index];
    log.command.get_or_insert_default().extend(command.map(f64::from));
    if let Some(base) = &mut log.base {
        base.position.get_or_insert_default().extend(row(&motion.base_position, 3));
        base.quaternion.get_or_insert_default().extend(row(&motion.base_quaternion, 4));
        base.linear_velocity.get_or_insert_default().extend(row(&motion.base_linear, 3));
        base.angular_velocity.get_or_insert_default().extend(row(&motion.base_angular, 3));
    }
}

fn after_action(log: &mut Trajectory, player: &Player<'_>, joints: &[usize], index: usize) {
    let width = joints.len();
    let action = &player.action[index * width..(index + 1) * width];
    log.action.get_or_insert_default().extend(action.iter().map(|&x| f64::from(x)));
    let targets = player.environment.targets();
    let all = targets.len() / player.environment.count();
    let target = |&joint: &usize| f64::from(targets[index * all + joint]);
    log.target.get_or_insert_default().extend(joints.iter().map(target));
}
