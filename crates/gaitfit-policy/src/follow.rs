//! A policy under given commands from given states. A fit compares the result with a robot's log.

use std::sync::Mutex;
use std::sync::PoisonError;

use gaitfit_physics::Params;
use gaitfit_sim::{Candidate, Imu, Motion, Start, Tile, pool};

use crate::network::Scratch;
use crate::observation::{LastAction, Past, Sensed};
use crate::walker::{TorqueNoise, Walker, WalkerError};
use crate::{MotionPlace, Policy};

/// The commands and the start of one simulated robot.
#[derive(Clone, Debug, PartialEq)]
pub struct Script {
    /// Command at each sample: m/s, m/s, rad/s.
    pub commands: Vec<[f32; 3]>,
    /// The state at the beginning. Its orientation and rates are readings of an inertial unit: errors of the candidate's unit
    /// ([`gaitfit_sim::Sensors`]) are removed from them. The height does not change.
    pub start: Start,
    /// Further starts, with readings as in `start`. The seed of a job chooses `start` or one of these; if this is empty,
    /// all jobs begin at `start`. The scripts of one simulation have the same number of further starts, or none.
    pub others: Vec<Start>,
    /// The logged state at each sample, for resets, with readings as in `start`; empty if the log lacks it.
    pub states: Vec<Start>,
    /// The logged actions, policy order, `samples × joints`: after a reset the policy's last action is the log's, and so
    /// are the past frames of what it observes.
    pub actions: Vec<f32>,
    /// The robot's place at each sample in the motion that the policy follows; empty for policies without a motion.
    pub motion: Vec<MotionPlace>,
    /// Angle by which `start` and `others` are turned back from where the log has them, rad. The motion turns with them.
    pub turned_back: f64,
}

/// The signals of one robot, one row for each sample. Row `i` holds the state in which action `i` was chosen, and that action.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Track {
    /// Joint positions as the encoders report them, rad, policy order; `samples × joints`.
    pub position: Vec<f32>,
    /// Joint velocities as sensors read them, rad/s; `samples × joints`.
    pub velocity: Vec<f32>,
    /// Actions; `samples × joints`.
    pub action: Vec<f32>,
    /// Base position, m, world frame; `samples × 3`.
    pub base_position: Vec<f32>,
    /// Base linear velocity, m/s, world frame; `samples × 3`.
    pub base_velocity: Vec<f32>,
    /// Orientation of the base as the inertial unit reads it, wxyz; `samples × 4`.
    pub base_quaternion: Vec<f32>,
    /// Angular velocity of the base as the gyro reads it, rad/s; `samples × 3`.
    pub base_rates: Vec<f32>,
    /// First sample at which the robot had fallen or diverged.
    pub fell_at: Option<usize>,
}

/// A simulated robot and how it follows.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// The robot.
    pub candidate: Candidate,
    /// Samples between resets to the logged state, from sample 0 on; `None` begins at the script's start and
    /// never resets. At a reset the row holds what the simulation reached before it.
    pub reset_every: Option<usize>,
    /// Seed of the torque noise, and of the choice among a script's starts.
    pub seed: u64,
}

/// The number of the start, from 0 to `count` − 1, that a job with this seed uses. Seed 0 uses start 0.
pub fn start_number(seed: u64, count: usize) -> usize {
    // The remainder is below `count`, so it always fits.
    usize::try_from(seed % count.max(1) as u64).unwrap_or(0)
}

/// Samples between two checks for cancellation.
pub(crate) const ASK: usize = 16;

/// Robots that one thread advances together.
const TILE: usize = 32;

/// Runs every job on every script and calls `consume(job, script, track)` once for each track, from any thread in any
/// order. Tracks do not depend on the other jobs, nor on the number of threads. Once `cancel` returns true, it returns soon,
/// without the missing tracks; from then on `cancel` must always return true.
///
/// # Errors
/// A candidate that is not a possible robot; resets of a script without states, or of a recurrent policy; a policy's function
/// that failed.
pub fn follow(
    walker: &Walker,
    policy: &Policy,
    scripts: &[Script],
    jobs: &[Job],
    threads: usize,
    consume: &(dyn Fn(usize, usize, &Track) + Sync),
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<(), WalkerError> {
    // A reset takes the state and the action of its sample from the log.
    let stateless = |script: &Script| {
        script.states.len() < script.commands.len()
            || script.actions.len() < script.commands.len() * walker.joints.len()
    };
    if jobs.iter().any(|job| job.reset_every.is_some()) && scripts.iter().any(stateless) {
        return Err(WalkerError::NoStates);
    }
    if jobs.iter().any(|job| job.reset_every.is_some()) && policy.is_recurrent() {
        return Err(WalkerError::NoMemory);
    }
    in_tiles(jobs.len(), scripts, threads, |worker: &mut Worker, job, first, chunk| {
        let whole = worker.run(walker, policy, &jobs[job], chunk, first, cancel)?;
        // The tracks of a tile that was cancelled are cut short, so none of them is given out.
        for (k, track) in worker.tracks.iter().enumerate().take(if whole { chunk.len() } else { 0 }) {
            consume(job, first + k, track);
        }
        Ok(())
    })
}

/// Calls `run(worker, job, first, chunk)` for every job and every tile of `runs`. Each thread has a worker of its own;
/// `first` is the number of the chunk's first run.
///
/// # Errors
/// The error of the first job that failed, whichever thread was faster.
pub(crate) fn in_tiles<W: Default + Send, R: Sync>(
    jobs: usize,
    runs: &[R],
    threads: usize,
    run: impl Fn(&mut W, usize, usize, &[R]) -> Result<(), WalkerError> + Sync,
) -> Result<(), WalkerError> {
    // Without runs there are no tiles and no work, so nothing is divided by this 0.
    let tiles = runs.len().div_ceil(TILE);
    // The error with the smallest number is kept, so that the message does not depend on the threads.
    let failure: Mutex<Option<(usize, WalkerError)>> = Mutex::new(None);
    pool::for_each(jobs * tiles, threads, W::default, |worker, index| {
        let (job, first) = (index / tiles, (index % tiles) * TILE);
        let chunk = &runs[first..runs.len().min(first + TILE)];
        if let Err(error) = run(worker, job, first, chunk) {
            let mut slot = failure.lock().unwrap_or_else(PoisonError::into_inner);
            if slot.as_ref().is_none_or(|(other, _)| index < *other) {
                *slot = Some((index, error));
            }
        }
    });
    failure.into_inner().unwrap_or_else(PoisonError::into_inner).map_or(Ok(()), |(_, error)| Err(error))
}

/// A thread's buffers.
#[derive(Default)]
struct Worker {
    tracks: Vec<Track>,
    motion: Motion,
    observation: Vec<f32>,
    action: Vec<f32>,
    targets: Vec<f32>,
    noise: TorqueNoise,
    scratch: Scratch,
}

impl Worker {
    /// Fills the tracks of some scripts. Returns false if it was cancelled.
    fn run(
        &mut self,
        walker: &Walker,
        policy: &Policy,
        job: &Job,
        scripts: &[Script],
        first: usize,
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Result<bool, WalkerError> {
        let batch = &walker.batch;
        let (count, joints) = (scripts.len(), walker.joints.len());
        // All scripts of a tile are runs of the same robot.
        let robot: Params<f64> = walker.robot(&job.candidate).params(batch.model())?;
        let mut tile = walker.engine.tile(batch, &vec![robot; count], &job.candidate.networks)?;
        let imu = job.candidate.sensors.imu();
        // Readings hold the errors of the unit; the simulation begins in the true state.
        let place = |tile: &mut Tile<'_>, index: usize, reading: &Start| match &imu {
            Some(imu) => tile.place(index, &imu.state(reading)),
            None => tile.place(index, reading),
        };
        self.motion = batch.motion(count);
        self.action.resize(count * joints, 0.0);
        let mut last_action = LastAction::new(count, joints);
        let mut past = Past::new(&walker.observation, count);
        let mut memory = policy.memory(count);
        let mut sensed = Sensed::new(joints);
        self.targets.resize(count * walker.default_pose.len(), 0.0);
        let width = walker.observation.width();
        self.observation.resize(count * width, 0.0);
        // Never fewer than before: tracks keep their memory from tile to tile.
        self.tracks.resize_with(count.max(self.tracks.len()), Track::default);
        for (index, (script, track)) in scripts.iter().zip(&mut self.tracks).enumerate() {
            track.begin();
            // With resets every stretch begins in the logged state, the first one too. Seeds then choose no start.
            let logged = job.reset_every.and_then(|_| script.states.first());
            place(&mut tile, index, logged.unwrap_or_else(|| script.begins(job.seed)));
        }
        tile.observe(&mut self.motion);
        // Scripts may differ in length, and the tile advances until the longest one is over.
        let longest = scripts.iter().map(|script| script.commands.len()).max().unwrap_or(0);
        for sample in 0..longest {
            if sample.is_multiple_of(ASK) && cancel() {
                return Ok(false);
            }
            // Not at sample 0, where the script begins in the logged state anyway. 0 samples between resets
            // count as 1.
            let resets =
                job.reset_every.is_some_and(|every| sample > 0 && sample.is_multiple_of(every.max(1)));
            for (index, (script, track)) in scripts.iter().zip(&mut self.tracks).enumerate() {
                if sample < script.commands.len() {
                    // The row comes before the reset: it is where the stretch before has arrived.
                    track.look(walker, &self.motion, index, imu.as_ref(), sample);
                    if resets {
                        place(&mut tile, index, &script.states[sample]);
                        let row = (sample - 1) * joints..sample * joints;
                        // The policy must see the log's past, not the one that the simulation is reset from.
                        last_action.set(index, &script.actions[row]);
                        script.recall(walker, sample, index, &mut sensed, &mut past);
                    }
                }
            }
            if resets {
                tile.observe(&mut self.motion);
            }
            // One observation for each robot, and then one pass of the policy for all of them.
            for (index, row) in self.observation.chunks_exact_mut(width).enumerate() {
                let commands = &scripts[index].commands;
                walker.sense(&self.motion, index, imu.as_ref(), &mut sensed);
                // A script that is over keeps its last command until the longest one of the tile ends;
                // nothing of it is recorded.
                let last = commands.len().saturating_sub(1);
                sensed.command = commands.get(sample.min(last)).copied().unwrap_or_default();
                sensed.last_action.copy_from_slice(last_action.row(index));
                sensed.clock = walker.clock(sample as u32);
                // Resets put the robot where the log has it, so the motion is not turned back then.
                sensed.motion = scripts[index].place(sample, job.reset_every.is_none());
                walker.observation.write(&sensed, past.row(index), |_, _| (), row);
            }
            // All rows are kept, also those of scripts that are over: what is not recorded may be anything.
            past.take(&self.observation);
            policy.act_with(count, &self.observation, &mut memory, &mut self.action, &mut self.scratch);
            if policy.has_failed() {
                return Err(WalkerError::Failed);
            }
            for (index, script) in scripts.iter().enumerate() {
                if sample < script.commands.len() {
                    let row = &self.action[index * joints..(index + 1) * joints];
                    self.tracks[index].action.extend_from_slice(row);
                }
            }
            // A last step would move the robots to a state that no row holds.
            if sample + 1 == longest {
                break;
            }
            walker.targets(&self.action, &mut self.targets);
            let torques =
                self.noise.torques(walker, &job.candidate, job.seed, first as u32, sample as u32, count);
            tile.step(&self.targets, torques, &mut self.motion);
            // After the step, because an observation's last action is the one that the robot has moved under.
            last_action.take(&self.action);
        }
        Ok(true)
    }
}

impl Script {
    /// The start of jobs with this seed.
    pub fn begins(&self, seed: u64) -> &Start {
        // Number 0 is `start`; the others follow it.
        start_number(seed, 1 + self.others.len())
            .checked_sub(1)
            .map_or(&self.start, |other| &self.others[other])
    }

    /// The robot's place in the motion at `sample`; behind the last sample, at that one. `back`: whether the robot
    /// was turned back at its start, and the motion with it ([`Script::turned_back`]).
    pub fn place(&self, sample: usize, back: bool) -> MotionPlace {
        // A script without a motion has no places, and a default one that nobody reads.
        let last = self.motion.len().saturating_sub(1);
        let place = self.motion.get(sample.min(last)).copied().unwrap_or_default();
        let heading = if back { place.heading - self.turned_back } else { place.heading };
        MotionPlace { heading, ..place }
    }

    /// Fills `past` with the observations of this run before `sample`, as if the robot had been in the logged states.
    fn recall(&self, walker: &Walker, sample: usize, index: usize, sensed: &mut Sensed, past: &mut Past) {
        if !past.is_kept() {
            return;
        }
        let layout = &walker.observation;
        let joints = walker.joints.len();
        let mut row = vec![0.0; layout.width()];
        past.begin(index);
        // All frames but the oldest of the row before this sample stay in its row.
        for before in (sample + 1).saturating_sub(layout.frames())..sample {
            walker.sense_state(&self.states[before], sensed);
            sensed.command = self.commands[before];
            // Before the first logged action the last action is 0, as at an episode's start.
            match before.checked_sub(1) {
                Some(last) => {
                    let last = &self.actions[last * joints..(last + 1) * joints];
                    sensed.last_action.copy_from_slice(last);
                }
                None => sensed.last_action.fill(0.0),
            }
            sensed.clock = walker.clock(before as u32);
            sensed.motion = self.place(before, false);
            layout.write(sensed, past.row(index), |_, _| (), &mut row);
            past.set(index, &row);
        }
    }
}

impl Track {
    pub(crate) fn begin(&mut self) {
        for signal in [
            &mut self.position,
            &mut self.velocity,
            &mut self.action,
            &mut self.base_position,
            &mut self.base_velocity,
            &mut self.base_quaternion,
            &mut self.base_rates,
        ] {
            signal.clear();
        }
        self.fell_at = None;
    }

    pub(crate) fn look(
        &mut self,
        walker: &Walker,
        motion: &Motion,
        index: usize,
        imu: Option<&Imu>,
        sample: usize,
    ) {
        let width = walker.default_pose.len();
        let (position, velocity) = (
            &motion.joint_position[index * width..(index + 1) * width],
            &motion.velocity_readings()[index * width..(index + 1) * width],
        );
        // In the policy's order of joints.
        self.position.extend(walker.joints.iter().map(|&joint| position[joint]));
        self.velocity.extend(walker.joints.iter().map(|&joint| velocity[joint]));
        self.base_position.extend_from_slice(&motion.base_position[3 * index..3 * index + 3]);
        self.base_velocity.extend_from_slice(&motion.base_linear[3 * index..3 * index + 3]);
        let (attitude, rates) = motion.imu_reading(index);
        self.base_quaternion.extend(imu.map_or(attitude, |imu| imu.attitude(attitude)));
        self.base_rates.extend(imu.map_or(rates, |imu| imu.rates(rates)));
        // Numbers that are not finite fail every comparison, so a diverged robot is tested here.
        let lost = !motion.base_position[3 * index..3 * index + 3].iter().all(|x| x.is_finite());
        // The state of sample 0 is the script's and not one that the simulation reached, so it counts as no fall.
        if self.fell_at.is_none() && sample > 0 && (lost || walker.fallen(motion, index)) {
            self.fell_at = Some(sample);
        }
    }
}
