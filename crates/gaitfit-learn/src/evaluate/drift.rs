//! Drift: where a robot ends after a constant command, against where it should be.

use gaitfit_model::rotation::{heading, quat_of};
use gaitfit_sim::stats::Estimate;
use serde::Serialize;

use super::Subject;
use crate::player::Player;
use crate::task::{Ended, Environment, Task, TaskError};
use crate::tiles::in_tiles;

/// The result of one constant command, over several robots.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct DriftTrial {
    /// Name of the command, for example `+x`.
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
/// Number of commands.
const TRIALS: usize = 7;
/// Robots that one thread advances together.
const TILE: usize = 256;

/// Constant commands along ±x, ±y and ±yaw, and standing: stand, command for four seconds, stand (the paper's hardware
/// trials). `robots` start with the task's own deviations. `speeds`: how fast, m/s, m/s and rad/s; half of the task's
/// greatest commands without them.
///
/// The wanted end of a turn is where it began; of a walk, speed times four seconds along its axis. Results do not
/// depend on the number of threads.
///
/// # Errors
/// A robot that cannot be, or the subject's `cancel`.
pub fn drift(
    subject: &Subject<'_>,
    robots: usize,
    speeds: Option<[f64; 3]>,
    threads: usize,
) -> Result<Vec<DriftTrial>, TaskError> {
    let one = |job: u32, _| {
        // A job is one command on one tile of robots; commands change fastest, as `joined` expects.
        let (first, command) = (job as usize / TRIALS * TILE, job as usize % TRIALS);
        // A recorder of every command is made, and this job takes its own.
        let recorder =
            DriftRecorder::all(subject.task, TILE.min(robots - first), speeds).swap_remove(command);
        Ok(vec![record(subject, first as u32, recorder)?])
    };
    let recorders = in_tiles(TRIALS * robots.div_ceil(TILE), 1, threads, one)?;
    Ok(DriftRecorder::joined(recorders))
}

/// Moves the robots from number `first` on under the command of `recorder`.
fn record(
    subject: &Subject<'_>,
    first: u32,
    mut recorder: DriftRecorder,
) -> Result<DriftRecorder, TaskError> {
    let robots = recorder.robots();
    let mut player = Player::new(subject, drift_environment(subject, first, robots)?);
    for step in 1..=recorder.last() {
        if let Some(command) = recorder.new_command(step) {
            (0..robots).for_each(|index| player.environment.hold_command(index, command));
        }
        player.step(step)?;
        let motion = player.environment.motion();
        recorder.take(step, |index| {
            let (place, quaternion) =
                (&motion.base_position[3 * index..], &motion.base_quaternion[4 * index..]);
            (player.ended[index], ground_pose(place, quaternion))
        });
    }
    Ok(recorder)
}

/// Makes `count` robots, numbered from `first`, under the command to stand, with which each constant-command trial
/// begins.
///
/// # Errors
/// A robot that cannot be.
pub fn drift_environment<'a>(
    subject: &Subject<'a>,
    first: u32,
    count: usize,
) -> Result<Environment<'a>, TaskError> {
    let mut environment = Environment::new(subject.task, subject.candidate, subject.seed, first, count)?;
    (0..count).for_each(|index| environment.hold_command(index, [0.0; 3]));
    Ok(environment)
}

/// Number of control periods that [`drift`] counts, summed over all commands and robots.
pub fn drift_periods(task: &Task, robots: usize) -> usize {
    TRIALS * robots * periods(task, 2.0 * STAND + COMMAND) as usize
}

/// Control periods in a time, s.
fn periods(task: &Task, seconds: f64) -> u32 {
    (seconds / task.walker.interface.control_dt).round() as u32
}

/// Place (m) and heading (rad) on the ground of a base at `position` (m) with the orientation `quaternion` (wxyz).
pub fn ground_pose(position: &[f32], quaternion: &[f32]) -> [f64; 3] {
    let quaternion = quat_of(quaternion).map(f64::from);
    [f64::from(position[0]), f64::from(position[1]), heading(quaternion)]
}

fn wrap(angle: f64) -> f64 {
    // Full turns are taken off, so that the angle lies between −π and π.
    angle - std::f64::consts::TAU * (angle / std::f64::consts::TAU).round()
}

/// `now` seen from `start`.
fn relative(start: [f64; 3], now: [f64; 3]) -> [f64; 3] {
    let (sin, cos) = start[2].sin_cos();
    let (dx, dy) = (now[0] - start[0], now[1] - start[1]);
    // The start's heading is turned back: x is then ahead of the robot, and y to its left.
    [cos * dx + sin * dy, cos * dy - sin * dx, wrap(now[2] - start[2])]
}

/// One constant command, step by step, from whatever simulates the robots.
#[derive(Debug)]
pub struct DriftRecorder {
    name: &'static str,
    command: [f64; 3],
    /// The last steps before the command, with the command, and in all.
    steps: [u32; 3],
    fallen: Vec<bool>,
    diverged: Vec<bool>,
    /// Robots settle while they first stand: errors count from where they then are.
    starts: Vec<[f64; 3]>,
    ends: Vec<[f64; 3]>,
    path: Vec<[f64; 3]>,
}

impl DriftRecorder {
    /// One for each command of [`drift`].
    pub fn all(task: &Task, robots: usize, speeds: Option<[f64; 3]>) -> Vec<Self> {
        let limits = &task.settings.command;
        let [x, y, yaw] = match speeds {
            // Given speeds hold for both directions.
            Some(speeds) => speeds.map(|speed| [-speed, speed]),
            // Half of the range on either side: the two directions may have different limits.
            None => [limits.x, limits.y, limits.yaw].map(|range| range.map(|limit| 0.5 * limit)),
        };
        let commands: [(&str, [f64; 3]); TRIALS] = [
            ("stand", [0.0; 3]),
            ("+x", [x[1], 0.0, 0.0]),
            ("-x", [x[0], 0.0, 0.0]),
            ("+y", [0.0, y[1], 0.0]),
            ("-y", [0.0, y[0], 0.0]),
            ("+yaw", [0.0, 0.0, yaw[1]]),
            ("-yaw", [0.0, 0.0, yaw[0]]),
        ];
        let steps = [STAND, STAND + COMMAND, 2.0 * STAND + COMMAND].map(|seconds| periods(task, seconds));
        let recorder = |(name, command)| Self {
            name,
            command,
            steps,
            fallen: vec![false; robots],
            diverged: vec![false; robots],
            starts: vec![[0.0; 3]; robots],
            ends: vec![[0.0; 3]; robots],
            path: Vec::new(),
        };
        commands.into_iter().map(recorder).collect()
    }

    /// Robots that count.
    pub fn robots(&self) -> usize {
        self.fallen.len()
    }

    /// Number of the last step; the first is 1.
    pub fn last(&self) -> u32 {
        self.steps[2]
    }

    /// Returns the largest number of steps that divides the times at which the command changes. A GPU runs
    /// this many steps at a time and looks at the command in between.
    pub fn command_period(&self) -> u32 {
        let [begin, end, last] = self.steps;
        // From the longest on: the first that divides all three is the greatest common divisor.
        (1..=begin.max(1))
            .rev()
            .find(|&length| [begin, end, last].iter().all(|step| step % length == 0))
            .unwrap_or(1)
    }

    /// The command of step number `step`, if it is another one than before.
    pub fn new_command(&self, step: u32) -> Option<[f32; 3]> {
        let [begin, end, _] = self.steps;
        match step.checked_sub(1) {
            Some(before) if before == begin => Some(self.command.map(|speed| speed as f32)),
            Some(before) if before == end => Some([0.0; 3]),
            _ => None,
        }
    }

    /// Adds step number `step`: how each robot's episode stands, and its place (m) and heading (rad), as
    /// [`ground_pose`] gives them. What a robot does after its fall does not count.
    pub fn take(&mut self, step: u32, state: impl Fn(usize) -> (Ended, [f64; 3])) {
        let [begin, ..] = self.steps;
        for index in 0..self.robots() {
            let (ended, pose) = state(index);
            self.fallen[index] |= matches!(ended, Ended::Fall | Ended::Diverged);
            // A divergence is counted in both lists: it is a fall too, and reports give it apart.
            self.diverged[index] |= ended == Ended::Diverged;
            if self.fallen[index] {
                continue;
            }
            self.ends[index] = pose;
            if step <= begin {
                self.starts[index] = pose;
            }
        }
        // The path ends where the first robot falls.
        if step > begin && !self.fallen.first().copied().unwrap_or(true) {
            self.path.push(relative(self.starts[0], self.ends[0]));
        }
    }

    /// Results of all commands. `recorders`: for each lot of robots, one recorder a command, in the order of
    /// [`Self::all`].
    pub fn joined(recorders: Vec<Self>) -> Vec<DriftTrial> {
        let mut whole: Vec<Self> = Vec::with_capacity(TRIALS);
        for (number, lot) in recorders.into_iter().enumerate() {
            // The first lot keeps its path: it has the first robot.
            if number < TRIALS {
                whole.push(lot);
                continue;
            }
            let command = &mut whole[number % TRIALS];
            command.fallen.extend(lot.fallen);
            command.diverged.extend(lot.diverged);
            command.starts.extend(lot.starts);
            command.ends.extend(lot.ends);
        }
        whole.into_iter().map(Self::finish).collect()
    }

    /// Returns the result.
    fn finish(self) -> DriftTrial {
        let robots = self.robots();
        let wanted = self.command.map(|speed| speed * COMMAND);
        let errors: Vec<[f64; 3]> = (0..robots)
            .filter(|&index| !self.fallen[index])
            .map(|index| {
                let [x, y, yaw] = relative(self.starts[index], self.ends[index]);
                // The wanted turn may be more than half a turn, so the difference is wrapped again.
                [x - wanted[0], y - wanted[1], wrap(yaw - wanted[2])]
            })
            .collect();
        let estimate =
            |axis: usize| Estimate::from_values(&errors.iter().map(|error| error[axis]).collect::<Vec<_>>());
        let count = |robots: &[bool]| robots.iter().filter(|&&is| is).count();
        DriftTrial {
            name: self.name,
            command: self.command,
            x: estimate(0),
            y: estimate(1),
            yaw: estimate(2),
            fall_rate: Estimate::share(count(&self.fallen), robots),
            diverged: count(&self.diverged),
            path: self.path,
        }
    }
}
