//! Drift: where a robot ends after a constant command, against where it should be.

use gaitfit_model::rotation::{heading, quat_of};
use gaitfit_sim::stats::Estimate;
use serde::Serialize;

use super::Subject;
use crate::player::Player;
use crate::task::{Ended, Environment, Task, TaskError};

/// The result of one constant command, over several robots.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DriftTrial {
    /// What was commanded, for example `+x`.
    pub name: &'static str,
    /// Command: forward, left (m/s), yaw rate (rad/s).
    pub command: [f64; 3],
    /// Final position along the start's heading minus the wanted one, m.
    pub x: Option<Estimate>,
    /// To the left of the start's heading, m.
    pub y: Option<Estimate>,
    /// Final heading minus the wanted one, rad.
    pub yaw: Option<Estimate>,
    /// Share of falls, divergences among them; fallen robots are left out of the errors.
    pub fall_rate: Option<Estimate>,
    /// Robots whose state stopped being a number.
    pub diverged: usize,
    /// Path of the first robot over the ground from the start's place and heading: x, y, m, and heading, rad, a
    /// control period each.
    pub path: Vec<[f64; 3]>,
}

/// Time of standing before and after the command, and of the command itself, s.
const STAND: f64 = 1.0;
const COMMAND: f64 = 4.0;
/// How many commands there are.
const TRIALS: usize = 7;

/// Constant commands along ±x, ±y and ±yaw, and standing: stand, command for four seconds, stand (the paper's hardware
/// trials). `robots` start with the task's own deviations. `speeds`: how fast, m/s, m/s and rad/s; half of the task's
/// greatest commands without them.
///
/// The wanted end of a turn is where it began; of a walk, speed times four seconds along its axis.
///
/// # Errors
/// A robot that cannot be, or the subject's `cancel`.
pub fn drift(
    subject: &Subject<'_>,
    robots: usize,
    speeds: Option<[f64; 3]>,
) -> Result<Vec<DriftTrial>, TaskError> {
    let limits = &subject.task.settings.command;
    let [x, y, yaw] = match speeds {
        Some(speeds) => speeds.map(|speed| [-speed, speed]),
        None => [limits.x, limits.y, limits.yaw].map(|range| range.map(|limit| 0.5 * limit)),
    };
    let trials: [(&str, [f64; 3]); TRIALS] = [
        ("stand", [0.0; 3]),
        ("+x", [x[1], 0.0, 0.0]),
        ("-x", [x[0], 0.0, 0.0]),
        ("+y", [0.0, y[1], 0.0]),
        ("-y", [0.0, y[0], 0.0]),
        ("+yaw", [0.0, 0.0, yaw[1]]),
        ("-yaw", [0.0, 0.0, yaw[0]]),
    ];
    trials.into_iter().map(|(name, command)| trial(subject, name, command, robots)).collect()
}

/// How many control periods [`drift`] counts, summed over all commands and robots.
pub fn drift_periods(task: &Task, robots: usize) -> usize {
    TRIALS * robots * periods(task, 2.0 * STAND + COMMAND) as usize
}

/// Control periods in a time, s.
fn periods(task: &Task, seconds: f64) -> u32 {
    (seconds / task.walker.interface.control_dt).round() as u32
}

/// Place and heading on the ground.
fn pose(environment: &Environment<'_>, index: usize) -> [f64; 3] {
    let motion = environment.motion();
    let quaternion = quat_of(&motion.base_quaternion[4 * index..]).map(f64::from);
    let place = &motion.base_position[3 * index..];
    [f64::from(place[0]), f64::from(place[1]), heading(quaternion)]
}

fn wrap(angle: f64) -> f64 {
    angle - std::f64::consts::TAU * (angle / std::f64::consts::TAU).round()
}

/// `now` seen from `start`.
fn relative(start: [f64; 3], now: [f64; 3]) -> [f64; 3] {
    let (sin, cos) = start[2].sin_cos();
    let (dx, dy) = (now[0] - start[0], now[1] - start[1]);
    [cos * dx + sin * dy, cos * dy - sin * dx, wrap(now[2] - start[2])]
}

fn trial(
    subject: &Subject<'_>,
    name: &'static str,
    command: [f64; 3],
    robots: usize,
) -> Result<DriftTrial, TaskError> {
    let Subject { task, candidate, seed, .. } = *subject;
    let mut environment = Environment::new(task, candidate, seed, 0, robots)?;
    for index in 0..robots {
        environment.hold_command(index, [0.0; 3]);
    }
    let mut player = Player::new(subject, environment);
    let (begin, end) = (periods(task, STAND), periods(task, STAND + COMMAND));
    let (mut fallen, mut diverged) = (vec![false; robots], vec![false; robots]);
    // Robots settle while they first stand: errors count from where they then are.
    let mut starts = vec![[0.0; 3]; robots];
    let mut path = Vec::new();
    for step in 1..=periods(task, 2.0 * STAND + COMMAND) {
        if step == begin + 1 || step == end + 1 {
            let now = if step == begin + 1 { command.map(|x| x as f32) } else { [0.0; 3] };
            for index in 0..robots {
                player.environment.hold_command(index, now);
                if step == begin + 1 {
                    starts[index] = pose(&player.environment, index);
                }
            }
        }
        player.step(step)?;
        for (index, &ended) in player.ended.iter().enumerate() {
            fallen[index] |= matches!(ended, Ended::Fall | Ended::Diverged);
            diverged[index] |= ended == Ended::Diverged;
        }
        if step > begin && !fallen[0] {
            path.push(relative(starts[0], pose(&player.environment, 0)));
        }
    }
    let wanted = command.map(|speed| speed * COMMAND);
    let errors: Vec<[f64; 3]> = (0..robots)
        .filter(|&index| !fallen[index])
        .map(|index| {
            let [x, y, yaw] = relative(starts[index], pose(&player.environment, index));
            [x - wanted[0], y - wanted[1], wrap(yaw - wanted[2])]
        })
        .collect();
    let estimate =
        |axis: usize| Estimate::from_values(&errors.iter().map(|error| error[axis]).collect::<Vec<_>>());
    let count = |robots: &[bool]| robots.iter().filter(|&&is| is).count();
    Ok(DriftTrial {
        name,
        command,
        x: estimate(0),
        y: estimate(1),
        yaw: estimate(2),
        fall_rate: Estimate::share(count(&fallen), robots),
        diverged: count(&diverged),
        path,
    })
}
