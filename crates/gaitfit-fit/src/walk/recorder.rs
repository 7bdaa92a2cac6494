//! The robot as it makes logs: its policy walks in closed loop, and what the robot's sensors read is kept.

use super::simulator::{in_model, script};
use super::walking::Walking;
use crate::gpu_logs::{Beginning, GpuLogs};
use gaitfit_adapt::fit::Predicted;
use gaitfit_adapt::{Cancel, Theta};
use gaitfit_log::{BaseState, Trajectory};
use gaitfit_model::kinematics::standing_height;
use gaitfit_policy::MotionPlace;
use gaitfit_policy::follow::{self, Script, Track};
use gaitfit_policy::walker::{Walker, WalkerError};
use gaitfit_random::{Purpose, Stream, derive_seed};
use gaitfit_sim::{Candidate, pool};
use std::sync::{Arc, Mutex, OnceLock, PoisonError};

/// A log with an unknown start begins up to this time after its robot, s: about a step of a gait.
const EARLIER_S: f64 = 0.5;
/// Deviation of its base's velocity there along each horizontal axis, m/s.
const BASE_SPEED: f64 = 0.1;

/// Makes logs under the commands of others.
pub struct Recorder {
    walking: Arc<Walking>,
    /// The robot that θ changes.
    base: Candidate,
    scripts: Vec<Script>,
    /// The same, as if the logs had joints and commands alone.
    plain: Vec<Script>,
    /// Names of the model's joints, which θ names.
    model_joints: Vec<String>,
    /// Makes the logs of [`Recorder::record`] on a GPU, if there is one.
    record_gpu: OnceLock<Option<GpuLogs>>,
    /// Makes the logs of [`Recorder::walk`] on a GPU, if there is one.
    walk_gpu: OnceLock<Option<GpuLogs>>,
}

/// A simulated robot with torque noise.
#[derive(Clone, Debug, PartialEq)]
pub struct NoisyRobot {
    /// Values of θ.
    pub values: Vec<f64>,
    /// Standard deviation of the random torques at its joints, N·m.
    pub noise: f64,
    /// Seed of these torques.
    pub seed: u64,
}

impl Recorder {
    /// A recorder of logs like `logs` (joints in the policy's order, sampled at the policy's rate): as long, under the
    /// same commands, from the state that their first sample shows. The logs do not show how the base moved then; here
    /// it is at rest. `base`: the robot that θ changes.
    pub fn new(walking: Arc<Walking>, base: Candidate, logs: &[&Trajectory]) -> Self {
        let walker = &walking.task.walker;
        let joints = &walker.batch.model().joints;
        Self {
            base,
            scripts: logs.iter().map(|log| begun(walker, log)).collect(),
            plain: logs.iter().map(|log| plain(walker, log)).collect(),
            model_joints: joints.iter().map(|joint| joint.name.clone()).collect(),
            walking,
            record_gpu: OnceLock::new(),
            walk_gpu: OnceLock::new(),
        }
    }

    /// Physics step of the robot, s.
    pub fn physics_step(&self) -> f64 {
        self.walking.task.walker.physics_step()
    }

    /// Period of the logs' samples, s.
    pub fn period(&self) -> f64 {
        self.walking.task.walker.interface.control_dt
    }

    /// The robot with these values of θ.
    fn candidate(&self, theta: &Theta, values: &[f64]) -> Candidate {
        let mut candidate = self.base.clone();
        theta.apply(values, &self.model_joints, &mut candidate);
        candidate
    }

    /// Simulates one walk under each log's commands, with θ unchanged.
    ///
    /// # Errors
    /// A policy's function that failed.
    pub fn tracks(&self) -> Result<Vec<Track>, WalkerError> {
        let Walking { policy, task, threads, .. } = self.walking.as_ref();
        let candidate = self.candidate(&Theta::default(), &[]);
        let job = follow::Job { candidate, reset_every: None, seed: 0 };
        let tracks = Mutex::new(vec![Track::default(); self.scripts.len()]);
        let keep = |_: usize, number: usize, track: &Track| {
            let mut tracks = tracks.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(slot) = tracks.get_mut(number) {
                slot.clone_from(track);
            }
        };
        follow::follow(&task.walker, policy, &self.scripts, &[job], *threads, &keep, &|| false)?;
        Ok(tracks.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// The logs of each robot.
    ///
    /// # Errors
    /// Values that are not those of a possible robot.
    pub fn record(
        &self,
        theta: &Theta,
        robots: &[NoisyRobot],
        cancel: &Cancel<'_>,
    ) -> Result<Vec<Vec<Recorded>>, WalkerError> {
        let Walking { policy, task, threads, .. } = self.walking.as_ref();
        let job = |robot: &NoisyRobot| follow::Job {
            candidate: Candidate { torque_noise: robot.noise, ..self.candidate(theta, &robot.values) },
            reset_every: None,
            seed: robot.seed,
        };
        let jobs: Vec<follow::Job> = robots.iter().map(job).collect();
        // Logs come in any order from several threads; each has its slot.
        let logs = Mutex::new(vec![vec![Recorded::default(); self.scripts.len()]; robots.len()]);
        let keep = |robot: usize, number: usize, track: &Track| {
            let recorded = Recorded::new(&task.walker, &self.scripts[number], track);
            let mut logs = logs.lock().unwrap_or_else(PoisonError::into_inner);
            if let Some(slot) = logs.get_mut(robot).and_then(|set| set.get_mut(number)) {
                *slot = recorded;
            }
        };
        let gpu = self.record_gpu.get_or_init(|| GpuLogs::new(&self.walking, &self.scripts, 0));
        let begins = |job: &follow::Job| -> Vec<Beginning> {
            self.scripts.iter().map(|script| (0, script.begins(job.seed).clone())).collect()
        };
        let keep_all = |robot: usize, tracks: Vec<Track>| {
            tracks.iter().enumerate().for_each(|(number, track)| keep(robot, number, track));
        };
        // The GPU makes what it can; the CPU makes the rest below.
        let left = self.on_gpu(gpu.as_ref(), &jobs, &|robot| begins(&jobs[robot]), &keep_all, cancel);
        let rest: Vec<follow::Job> = left.iter().map(|&robot| jobs[robot].clone()).collect();
        let pass = |robot: usize, number: usize, track: &Track| keep(left[robot], number, track);
        follow::follow(&task.walker, policy, &self.scripts, &rest, *threads, &pass, cancel)?;
        Ok(logs.into_inner().unwrap_or_else(PoisonError::into_inner))
    }

    /// Makes the logs of `jobs` on a GPU, if there is one. `begins(job)`: how the robot of the job begins each
    /// recording. Returns the jobs that remain for the CPU.
    fn on_gpu(
        &self,
        gpu: Option<&GpuLogs>,
        jobs: &[follow::Job],
        begins: &dyn Fn(usize) -> Vec<Beginning>,
        keep: &(dyn Fn(usize, Vec<Track>) + Sync),
        cancel: &Cancel<'_>,
    ) -> Vec<usize> {
        let numbers = 0..jobs.len();
        match gpu {
            Some(gpu) => {
                let begins: Vec<Vec<Beginning>> = numbers.map(begins).collect();
                gpu.make(&self.walking, jobs, &begins, keep, cancel)
            }
            None => numbers.collect(),
        }
    }

    /// The logs of each of `robots` (values of θ), with unknown starts: the robot stands in the log's first joint
    /// angles, moves a little, and has walked under the log's first command for a time that is drawn anew for each log.
    /// `first` numbers the robots; with `seed` it selects all draws. `keep(robot, logs)` gets the logs of each robot,
    /// once, from any thread.
    ///
    /// # Errors
    /// Values that are not those of a possible robot; a policy's function that failed.
    pub fn walk(
        &self,
        theta: &Theta,
        robots: &[Vec<f64>],
        [seed, first]: [u64; 2],
        keep: &(dyn Fn(usize, Vec<Predicted>) + Sync),
        cancel: &Cancel<'_>,
    ) -> Result<(), WalkerError> {
        let Walking { policy, task, threads, .. } = self.walking.as_ref();
        let (walker, joints) = (&task.walker, task.walker.joints.len());
        let number = |robot: usize| u32::try_from(first + robot as u64).unwrap_or(u32::MAX);
        let job = |robot: usize| follow::Job {
            candidate: self.candidate(theta, &robots[robot]),
            reset_every: None,
            seed: derive_seed(seed, Purpose::TORQUE_NOISE, number(robot).wrapping_add(1)),
        };
        // A GPU gets the scripts of the logs, and the beginnings of each robot beside them.
        let gpu =
            self.walk_gpu.get_or_init(|| GpuLogs::new(&self.walking, &self.plain, self.max_samples_before()));
        let jobs: Vec<follow::Job> = (0..robots.len()).map(job).collect();
        let begins = |robot: usize| self.unknown_starts(seed, number(robot));
        // Its tracks begin where the recording does, so nothing is cut from them.
        let take_all = |robot: usize, tracks: Vec<Track>| {
            keep(robot, tracks.iter().map(|track| kept(track, joints, 0)).collect());
        };
        let left = self.on_gpu(gpu.as_ref(), &jobs, &begins, &take_all, cancel);
        let failed: Mutex<Option<(usize, WalkerError)>> = Mutex::new(None);
        // Each thread simulates one robot: its logs differ in their beginnings, so each needs scripts of its own.
        let one = |robot: usize| {
            let begins = begins(robot);
            let scripts: Vec<Script> = self
                .plain
                .iter()
                .zip(&begins)
                .map(|(script, begin)| self.begun_earlier(script, begin))
                .collect();
            let predicted = Mutex::new(vec![Predicted::default(); scripts.len()]);
            let take = |_: usize, log: usize, track: &Track| {
                let mut predicted = predicted.lock().unwrap_or_else(PoisonError::into_inner);
                if let Some(slot) = predicted.get_mut(log) {
                    *slot = kept(track, joints, begins[log].0);
                }
            };
            follow::follow(walker, policy, &scripts, std::slice::from_ref(&jobs[robot]), 1, &take, cancel)?;
            Ok(predicted.into_inner().unwrap_or_else(PoisonError::into_inner))
        };
        pool::for_each(
            left.len(),
            *threads,
            || (),
            |(), at| {
                if cancel() {
                    return;
                }
                let robot = left[at];
                match one(robot) {
                    // A robot that was cancelled in the middle is not whole, and is dropped.
                    Ok(logs) if !cancel() => keep(robot, logs),
                    Ok(_) => {}
                    Err(error) => {
                        let mut slot = failed.lock().unwrap_or_else(PoisonError::into_inner);
                        // The error is that of the first robot, whichever thread fails first.
                        if slot.as_ref().is_none_or(|(other, _)| robot < *other) {
                            *slot = Some((robot, error));
                        }
                    }
                }
            },
        );
        failed.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(()), |(_, error)| Err(error))
    }

    /// Max number of samples that a robot with unknown starts walks before a recording begins.
    fn max_samples_before(&self) -> usize {
        (EARLIER_S / self.period() + 1.0) as usize
    }

    /// The beginning of each recording if the robot's starts are unknown.
    fn unknown_starts(&self, seed: u64, robot: u32) -> Vec<Beginning> {
        let max = EARLIER_S / self.period();
        // The values of simulated robots are drawn from lower environments of the same purpose.
        let stream = Stream::new(seed, Purpose::SIMULATED_ROBOTS).environment(robot.wrapping_add(1 << 31));
        let scripts = self.plain.iter().enumerate();
        let begun = scripts.map(|(number, script)| {
            let draws = stream.step(u32::try_from(number).unwrap_or(u32::MAX));
            // Whole samples from 0 to `max`, all as likely.
            let earlier = (draws.uniform(0) * (max + 1.0)) as usize;
            let mut start = script.start.clone();
            for (axis, speed) in start.base_linear.iter_mut().take(2).enumerate() {
                *speed += (BASE_SPEED * draws.normal(1 + axis as u32)) as f32;
            }
            (earlier, start)
        });
        begun.collect()
    }

    /// `script` with further samples under its first command at its beginning.
    fn begun_earlier(&self, script: &Script, (earlier, start): &Beginning) -> Script {
        let period = self.period();
        let mut script = Script { start: start.clone(), ..script.clone() };
        let first = script.commands.first().copied().unwrap_or_default();
        script.commands.splice(0..0, std::iter::repeat_n(first, *earlier));
        if let Some(&first) = script.motion.first() {
            // The motion keeps its pace, so each sample before the log is one period earlier in the motion.
            let before = |k: usize| MotionPlace { time: first.time - (earlier - k) as f64 * period, ..first };
            script.motion.splice(0..0, (0..*earlier).map(before));
        }
        script
    }
}

/// A walk's signals from sample `from` on.
fn kept(track: &Track, joints: usize, from: usize) -> Predicted {
    let rows = |signal: &Vec<f32>| signal.get(from * joints..).unwrap_or_default().to_vec();
    Predicted {
        position: rows(&track.position),
        velocity: rows(&track.velocity),
        action: Some(rows(&track.action)),
        fell_at: track.fell_at.map(|fell| fell.saturating_sub(from)),
        ..Predicted::default()
    }
}

/// The recording of a robot, in the policy's joint order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Recorded {
    position: Vec<f64>,
    velocity: Vec<f64>,
    action: Vec<f64>,
    target: Vec<f64>,
    base: BaseState,
    /// Time in the motion that the policy follows (s) and its heading (rad) at each sample.
    motion: Option<Vec<f64>>,
    /// First sample at which the robot had fallen.
    pub fell_at: Option<usize>,
}

impl Recorded {
    /// The recording of `walker` under `script` in the simulation.
    pub fn new(walker: &Walker, script: &Script, track: &Track) -> Self {
        let wide = |values: &[f32]| values.iter().map(|&value| f64::from(value)).collect();
        let joints = walker.default_pose.len();
        // Targets of all joints of the model; the log has only the policy's.
        let mut targets = vec![0.0; script.commands.len() * joints];
        walker.targets(&track.action, &mut targets);
        let rows = targets.chunks_exact(joints);
        Self {
            position: wide(&track.position),
            velocity: wide(&track.velocity),
            action: wide(&track.action),
            target: rows.flat_map(|row| walker.joints.iter().map(|&joint| f64::from(row[joint]))).collect(),
            base: BaseState {
                quaternion: Some(wide(&track.base_quaternion)),
                angular_velocity: Some(wide(&track.base_rates)),
                ..BaseState::default()
            },
            motion: (!script.motion.is_empty()).then(|| {
                let row = |place: &MotionPlace| [place.time, place.heading - script.turned_back];
                script.motion.iter().flat_map(row).collect()
            }),
            fell_at: track.fell_at,
        }
    }

    /// Replaces the signals of `log` by the recorded ones, up to `margin` samples before a fall. `None` if no more than
    /// `min` samples are left.
    ///
    /// # Errors
    /// A log that cannot be cut, in a sentence.
    pub fn before_fall(
        self,
        log: &Trajectory,
        margin: usize,
        min: usize,
    ) -> Result<Option<Trajectory>, String> {
        let end = self.fell_at.map(|fell| fell.saturating_sub(margin));
        let whole = self.instead_of(log);
        match end {
            None => Ok(Some(whole)),
            Some(end) if end > min => whole.slice(0..end).map(Some).map_err(|error| format!("{error}.")),
            Some(_) => Ok(None),
        }
    }

    /// Replaces the signals of `log` by the recorded ones.
    pub fn instead_of(self, log: &Trajectory) -> Trajectory {
        Trajectory {
            position: self.position,
            velocity: self.velocity,
            action: Some(self.action),
            target: Some(self.target),
            base: Some(self.base),
            motion: self.motion,
            fell: false,
            ..log.clone()
        }
    }
}

/// The log's commands and the joints of its first sample.
fn plain(walker: &Walker, log: &Trajectory) -> Script {
    let mut script = script(walker, log);
    script.states.clear();
    script.actions.clear();
    script
}

/// The log's commands, from the state that its first sample shows.
fn begun(walker: &Walker, log: &Trajectory) -> Script {
    let mut script = script(walker, log);
    // What the first sample shows is taken: attitude, then rates. Joints are in the start already.
    let base = log.base.as_ref();
    let attitude = base.and_then(|base| base.quaternion.as_deref()?.first_chunk::<4>());
    let rates = base.and_then(|base| base.angular_velocity.as_deref()?.first_chunk::<3>());
    // Without an orientation the script's own start stays: upright, at rest.
    if let Some(&attitude) = attitude.filter(|attitude| attitude.iter().all(|x| x.is_finite())) {
        let width = walker.joints.len().min(log.position.len());
        let angles: Vec<f64> = in_model(walker, &log.position[..width], &walker.default_pose)
            .into_iter()
            .map(f64::from)
            .collect();
        // The robot stands on the ground in the attitude of its first sample.
        script.start.base_position[2] = standing_height(walker.model(), attitude, &angles) as f32;
        script.start.base_quaternion = attitude.map(|x| x as f32);
        // The start keeps the log's heading, so the motion is not turned.
        script.turned_back = 0.0;
    }
    if let Some(rates) = rates.filter(|rates| rates.iter().all(|x| x.is_finite())) {
        script.start.base_angular = rates.map(|x| x as f32);
    }
    // The states of later samples would reset the robot, which is to walk on by itself.
    script.states.clear();
    script
}
