//! The policy in the simulator, under the logs' commands: what a fit of walking logs compares with them.

use super::reference;
use super::walking::Walking;
use crate::gpu_predictions::Readings;
use crate::log::Log;
use gaitfit_adapt::cost::Signal;
use gaitfit_adapt::{Cancel, Consume, Identity, Resets, Rollout, Signals, Simulator, SimulatorError, Theta};
use gaitfit_log::Trajectory;
use gaitfit_model::rotation;
use gaitfit_policy::follow::{self, Script, Track};
use gaitfit_policy::predict::{self, Course};
use gaitfit_policy::walker::Walker;
use gaitfit_random::{Purpose, Stream};
use gaitfit_sim::{Candidate, Start, pool};
use std::sync::Arc;

/// Runs a policy on candidate robots with the command sequences of some logs.
pub struct WalkSimulator {
    /// Joints of the signals are the policy's.
    identity: Identity,
    walking: Arc<Walking>,
    /// The robot that θ changes.
    base: Candidate,
    scripts: Vec<Script>,
    /// Rows that logs lost, one entry for each log; empty if no log lost rows.
    filled: Vec<Filled>,
    /// The readings of the logs' sensors.
    readings: Readings,
    /// Trust in standing feet to show how the base moves, see [`predict::Job::feet_trust`].
    feet_trust: f64,
    /// Joints of the model, which θ names.
    model_joints: Vec<String>,
}

impl WalkSimulator {
    /// A simulator of `logs` (joints in the policy's order, sampled at the policy's rate). `base`: the robot that θ
    /// changes.
    pub fn new(walking: Arc<Walking>, base: Candidate, logs: &[&Trajectory]) -> Self {
        let joints = &walking.task.walker.batch.model().joints;
        Self {
            identity: Identity::new(walking.joints(), logs.len()).with_signals(&Signal::ALL),
            base,
            filled: Vec::new(),
            scripts: logs.iter().map(|log| script(&walking.task.walker, log)).collect(),
            readings: readings(&walking, logs),
            feet_trust: predict::FEET_TRUST,
            model_joints: joints.iter().map(|joint| joint.name.clone()).collect(),
            walking,
        }
    }

    /// The policy on its robot.
    pub fn walking(&self) -> &Walking {
        &self.walking
    }

    /// The scripts of the simulated robots.
    pub fn scripts(&self) -> &[Script] {
        &self.scripts
    }

    /// The simulator with the rows of `logs` that were lost and are filled. Short predictions of these rows and from
    /// them have the log's values, so they cost nothing.
    pub fn with_filled(self, logs: &[Log]) -> Self {
        Self { filled: logs.iter().map(Filled::new).collect(), ..self }
    }

    /// Lets logs after the first `once` start near the start that their sensors show: with other joint angles and
    /// velocities, tilts, rates and speeds of the base. Each has `STARTS_NEAR` such starts; the draw of a simulation
    /// chooses one. The start hardly changes how a robot walks after a second. If the robot is close to a fall, the
    /// start decides whether it falls.
    pub fn with_starts_near(mut self, once: usize) -> Self {
        self.identity.logs = once;
        let walker = &self.walking.task.walker;
        for (number, script) in self.scripts.iter_mut().enumerate().skip(once) {
            let stream =
                // Seed 0: searches of all seeds share these starts.
                Stream::new(0, Purpose::START).environment(u32::try_from(number).unwrap_or(u32::MAX));
            script.others =
                (0..STARTS_NEAR).map(|start| near(walker, &script.start, stream.step(start))).collect();
            if let Some(start) = script.others.pop() {
                script.start = start;
            }
        }
        self
    }

    /// The simulator with other trust in standing feet.
    pub fn with_feet_trust(self, feet_trust: f64) -> Self {
        Self { feet_trust, ..self }
    }

    /// The robot with these values of θ.
    pub fn candidate(&self, theta: &Theta, values: &[f64]) -> Candidate {
        let mut candidate = self.base.clone();
        theta.apply(values, &self.model_joints, &mut candidate);
        candidate
    }
}

impl Simulator for WalkSimulator {
    fn identity(&self) -> &Identity {
        &self.identity
    }

    fn threads(&self) -> usize {
        self.walking.threads
    }

    fn simulate(
        &self,
        theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        let &Walking { ref policy, ref task, threads, .. } = self.walking.as_ref();
        // Free walks and short predictions are simulated by different programs, in two batches.
        let (mut free, mut corrected) = (Vec::new(), Vec::new());
        for (number, rollout) in candidates.iter().enumerate() {
            let (candidate, seed) = (self.candidate(theta, &rollout.values), rollout.draw);
            match rollout.resets {
                Resets::Never => free.push((number, follow::Job { candidate, reset_every: None, seed })),
                Resets::State(every) => {
                    free.push((number, follow::Job { candidate, reset_every: Some(every), seed }));
                }
                Resets::Sensors(every) => {
                    let feet_trust = self.feet_trust;
                    corrected.push((number, predict::Job { candidate, every, feet_trust, seed }));
                }
            }
        }
        // The list of readings ends before the first log without them, so its length names this log.
        if !corrected.is_empty() && self.readings.courses.len() < self.scripts.len() {
            return Err(SimulatorError::failed(format!(
                "the cost needs what an IMU measures, and log {} of {} lacks it: columns {IMU_COLUMNS}",
                self.readings.courses.len() + 1,
                self.scripts.len()
            )));
        }
        // A track without a signal has an empty list, and `Signals` none.
        fn given(signal: &[f32]) -> Option<&[f32]> {
            Some(signal).filter(|signal| !signal.is_empty())
        }
        let pass = |candidate: usize, recording: usize, track: &Track| {
            let signals = Signals {
                position: &track.position,
                velocity: &track.velocity,
                action: given(&track.action),
                base_position: given(&track.base_position),
                base_velocity: given(&track.base_velocity),
                fell_at: track.fell_at,
            };
            consume(candidate, recording, signals);
        };
        let (places, jobs): (Vec<usize>, Vec<follow::Job>) = free.into_iter().unzip();
        let walker = &task.walker;
        let to = |job: usize, script: usize, track: &Track| pass(places[job], script, track);
        let followed = follow::follow(walker, policy, &self.scripts, &jobs, threads, &to, cancel);
        // If a policy's function failed, its caller has cancelled: what is done is kept.
        if followed.is_err() && cancel() {
            return Err(SimulatorError::Cancelled);
        }
        followed.map_err(SimulatorError::failed)?;
        let (places, jobs): (Vec<usize>, Vec<predict::Job>) = corrected.into_iter().unzip();
        let every: Vec<usize> = jobs.iter().map(|job| job.every).collect();
        // Rows that were lost have no reading to predict from or to compare with.
        let to = |job: usize, course: usize, track: &Track| match self.filled.get(course) {
            Some(filled) if !filled.rows.is_empty() => {
                pass(places[job], course, &filled.instead(track, walker.joints.len(), every[job]));
            }
            _ => pass(places[job], course, track),
        };
        // What the GPU did not simulate goes to the CPU.
        let left = self.walking.predictions.predict(&self.walking, &self.readings, &jobs, &to, cancel)?;
        let rest: Vec<predict::Job> = left.iter().map(|&job| jobs[job].clone()).collect();
        let to = |job: usize, course: usize, track: &Track| to(left[job], course, track);
        predict::predict(walker, &self.readings.courses, &rest, threads, &to, cancel)
            .map_err(SimulatorError::failed)?;
        if cancel() { Err(SimulatorError::Cancelled) } else { Ok(()) }
    }
}

/// Rows that a log lost, and the values that replace them.
#[derive(Default)]
struct Filled {
    rows: Vec<usize>,
    /// Joint positions and velocities of the log, `samples × joints`.
    position: Vec<f32>,
    velocity: Vec<f32>,
}

impl Filled {
    fn new(log: &Log) -> Self {
        if log.filled.is_empty() {
            return Self::default();
        }
        let single = |values: &[f64]| values.iter().map(|&x| x as f32).collect();
        let (position, velocity) = (single(&log.trajectory.position), single(&log.trajectory.velocity));
        Self { rows: log.filled.clone(), position, velocity }
    }

    /// `track` with the log's own values in the filled rows, and in the `every` rows after each that are predicted from
    /// it. `width`: joints of the track.
    fn instead(&self, track: &Track, width: usize, every: usize) -> Track {
        let mut track = track.clone();
        for &row in &self.rows {
            for (simulated, logged) in
                [(&mut track.position, &self.position), (&mut track.velocity, &self.velocity)]
            {
                // A prediction that begins in a filled row is wrong until the next reset, `every` samples
                // later.
                let end = ((row + every + 1) * width).min(simulated.len()).min(logged.len());
                let cells = (row * width).min(end)..end;
                simulated[cells.clone()].copy_from_slice(&logged[cells]);
            }
        }
        track
    }
}

/// Min cosine of the base's angle from upright, 30°. Above it, a simulation starts with the log's orientation.
const START_UPRIGHT: f64 = 0.87;
/// Number of starts near a log's start; a simulation takes one of them. With the usual four simulations of each log,
/// three of which start near, a log has 48.
const STARTS_NEAR: u32 = 16;
/// Standard deviation of a joint's angle at a start near the log's, rad.
const START_ANGLE: f64 = 0.05;
/// Standard deviation of a joint's velocity there, rad/s.
const START_VELOCITY: f64 = 1.0;
/// Standard deviation of the base's roll and pitch there, rad.
const START_TILT: f64 = 0.04;
/// Standard deviation of the base's rates there, rad/s.
const START_RATE: f64 = 0.3;
/// Standard deviation of the base's velocity there along each horizontal axis, m/s.
const START_SPEED: f64 = 0.1;

/// A random start near `start`, drawn from `stream`.
fn near(walker: &Walker, start: &Start, stream: Stream) -> Start {
    let joints = start.joint_position.len();
    let drawn = |values: &[f32], spread: f64, first: usize| -> Vec<f64> {
        let drawn =
            |(k, &value): (usize, &f32)| f64::from(value) + spread * stream.normal((first + k) as u32);
        values.iter().enumerate().map(drawn).collect()
    };
    let angles = drawn(&start.joint_position, START_ANGLE, 0);
    let velocities = drawn(&start.joint_velocity, START_VELOCITY, joints);
    let speeds = drawn(&[0.0; 2], START_SPEED, 2 * joints);
    // Each group of numbers has draws of its own, so the offsets must not overlap.
    let tilt = drawn(&[0.0; 2], START_TILT, 2 * joints + 2);
    let rates = drawn(&start.base_angular, START_RATE, 2 * joints + 4);
    let turned = rotation::product(rotation::turn(1, tilt[1]), rotation::turn(0, tilt[0]));
    let attitude = rotation::product(start.base_quaternion.map(f64::from), turned);
    Start {
        base_linear: [speeds[0] as f32, speeds[1] as f32, 0.0],
        base_angular: std::array::from_fn(|k| rates[k] as f32),
        joint_velocity: velocities.iter().map(|&x| x as f32).collect(),
        // Other angles and tilts move the feet, so the height at which the robot stands is computed anew.
        ..walker.standing([0.0; 2], attitude, &angles)
    }
}

/// The columns of a log with the readings of an IMU.
pub const IMU_COLUMNS: &str =
    "base_quat_w, base_quat_x, base_quat_y, base_quat_z (or roll, pitch, yaw) and wx, wy, wz";

/// The readings of the logs' sensors, up to the first log that lacks those of an IMU.
fn readings(walking: &Walking, logs: &[&Trajectory]) -> Readings {
    let courses = pool::map(logs.len(), walking.threads, |log| course(&walking.task.walker, logs[log]));
    Readings::new(courses.into_iter().map_while(|course| course).collect())
}

/// The readings of the log's sensors; `None` without attitude and rates.
fn course(walker: &Walker, log: &Trajectory) -> Option<Course> {
    let base = log.base.as_ref()?;
    let (quaternion, rates) = (base.quaternion.as_ref()?, base.angular_velocity.as_ref()?);
    let (samples, joints) = (log.len(), walker.default_pose.len());
    let mut targets = vec![0.0f32; samples * joints];
    // A log without targets has actions, from which the targets follow.
    match &log.target {
        Some(target) => targets = in_model(walker, target, &walker.default_pose),
        None => walker.targets(&actions(log), &mut targets),
    }
    let row = |values: &[f64], sample: usize, k: usize| values[sample + k] as f32;
    Course::new(
        walker,
        targets,
        in_model(walker, &log.position, &walker.default_pose),
        in_model(walker, &log.velocity, &vec![0.0; joints]),
        (0..samples).map(|sample| unit(std::array::from_fn(|k| row(quaternion, 4 * sample, k)))).collect(),
        (0..samples).map(|sample| std::array::from_fn(|k| row(rates, 3 * sample, k))).collect(),
    )
    .ok()
}

/// Length of a logged quaternion less 1 that is more than rounding of single precision.
const OFF_UNIT: f32 = 1e-5;

/// A quaternion that was logged with few digits, of length 1.
fn unit(quaternion: [f32; 4]) -> [f32; 4] {
    let length = quaternion.iter().map(|x| x * x).sum::<f32>().sqrt();
    // One of length 1 keeps its bits, so logs of simulated robots are not changed.
    if (length - 1.0).abs() > OFF_UNIT { quaternion.map(|x| x / length) } else { quaternion }
}

/// Rows of the policy's joints as rows of the model's joints. `others`: values of the joints that the policy does not
/// move, in the model's order.
pub(super) fn in_model(walker: &Walker, values: &[f64], others: &[f32]) -> Vec<f32> {
    let rows = values.chunks_exact(walker.joints.len());
    let mut in_model = others.repeat(rows.len());
    for (row, values) in in_model.chunks_exact_mut(others.len()).zip(rows) {
        for (&joint, &value) in walker.joints.iter().zip(values) {
            row[joint] = value as f32;
        }
    }
    in_model
}

/// The script of the simulated robot: the log's commands, from the log's first joint angles and velocities. The base
/// has the orientation and rates of the log's inertial unit; without one it is in the task's posture and does not turn.
/// Its linear velocity is 0, because no sensor measures it.
pub fn script(walker: &Walker, log: &Trajectory) -> Script {
    let joints = walker.joints.len();
    let samples = log.len();
    let command = log.command.as_deref().unwrap_or_default();
    let commands = (0..samples).map(|row| std::array::from_fn(|k| command[3 * row + k] as f32)).collect();
    // Joints that the log lacks, held ones for example, have the pose of the task.
    let model_order = |values: &[f64], row: usize, others: &[f64]| -> Vec<f64> {
        let mut in_model = others.to_vec();
        for (&joint, &value) in walker.joints.iter().zip(&values[row * joints..]) {
            in_model[joint] = value;
        }
        in_model
    };
    let (home, still) =
        (walker.default_pose.iter().map(|&angle| f64::from(angle)), walker.default_pose.len());
    let (home, still): (Vec<f64>, _) = (home.collect(), vec![0.0; still]);
    let posture =
        |row: usize| (model_order(&log.position, row, &home), model_order(&log.velocity, row, &still));
    let (angles, velocities) = posture(0);
    // The log's heading is taken away, so that every walk begins along x.
    let (start, turned_back) = match inertial_start(log) {
        Some((quaternion, rates, heading)) => {
            let start = Start {
                base_angular: rates,
                joint_velocity: velocities.iter().map(|&x| x as f32).collect(),
                ..walker.standing([0.0; 2], quaternion, &angles)
            };
            (start, heading)
        }
        // The robot still faces along x. The motion that it follows was turned together with the log.
        None => (walker.start_from_joints(&angles, &velocities), first_heading(log)),
    };
    let motion = match &log.motion {
        Some(_) => (0..samples).map(|row| reference::place(log, row)).collect(),
        None => Vec::new(),
    };
    // Resets need the whole state, which only simulated logs have.
    let (states, actions) = (states(log, posture), actions(log));
    Script { commands, start, others: Vec::new(), states, actions, motion, turned_back }
}

/// Heading of the log's first orientation, rad; 0 if it has none.
fn first_heading(log: &Trajectory) -> f64 {
    let quaternion = log.base.as_ref().and_then(|base| base.quaternion.as_deref()?.first_chunk::<4>());
    let heading = quaternion.map_or(0.0, |quaternion| rotation::heading(rotation::normalize(*quaternion)));
    if heading.is_finite() { heading } else { 0.0 }
}

/// Orientation (turned to heading 0), body rates (rad/s) and heading (rad) at the log's first sample, if it has them
/// and the base is nearly upright.
fn inertial_start(log: &Trajectory) -> Option<([f64; 4], [f32; 3], f64)> {
    let base = log.base.as_ref()?;
    let (quaternion, rates) = (base.quaternion.as_ref()?, base.angular_velocity.as_ref()?);
    let quaternion = rotation::normalize(*quaternion.first_chunk::<4>()?);
    let rates = rates.first_chunk::<3>()?.map(|x| x as f32);
    let numbers = quaternion.iter().all(|x| x.is_finite()) && rates.iter().all(|x| x.is_finite());
    let heading = rotation::heading(quaternion);
    let level = rotation::product(rotation::turn(2, -heading), quaternion);
    // A robot that leans further does not stand, so it is not put on its feet in that attitude.
    (numbers && rotation::up(level)[2] > START_UPRIGHT).then_some((level, rates, heading))
}

/// The whole state at every sample, where the log has it.
fn states(log: &Trajectory, posture: impl Fn(usize) -> (Vec<f64>, Vec<f64>)) -> Vec<Start> {
    let Some(base) = &log.base else { return Vec::new() };
    let (Some(position), Some(quaternion), Some(linear), Some(angular)) =
        (&base.position, &base.quaternion, &base.linear_velocity, &base.angular_velocity)
    else {
        return Vec::new();
    };
    fn row<const N: usize>(values: &[f64], row: usize) -> [f32; N] {
        std::array::from_fn(|k| values[row * N + k] as f32)
    }
    (0..log.len())
        .map(|sample| {
            let (angles, velocities) = posture(sample);
            let single = |values: Vec<f64>| values.into_iter().map(|x| x as f32).collect();
            Start {
                base_position: row(position, sample),
                base_quaternion: row(quaternion, sample),
                base_linear: row(linear, sample),
                base_angular: row(angular, sample),
                joint_position: single(angles),
                joint_velocity: single(velocities),
            }
        })
        .collect()
}

fn actions(log: &Trajectory) -> Vec<f32> {
    log.action.iter().flatten().map(|&action| action as f32).collect()
}
