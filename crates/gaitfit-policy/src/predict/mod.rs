//! A robot under a log's own targets, put right again and again by what the log's sensors read: short predictions that a
//! fit compares with the log.
//!
//! Joint angles and velocities, attitude and rates of the base are what a legged robot measures by itself. How fast and
//! how high its base moves it does not; leg odometry keeps both such that the feet that stand go on as they did.

mod odometry;

use gaitfit_model::Model;
use gaitfit_model::kinematics::standing_height;
use gaitfit_physics::Params;
use gaitfit_sim::{Candidate, Imu, Motion, RobotState, Start, Tile};

use crate::follow::{ASK, Track, in_tiles};
use crate::walker::{TorqueNoise, Walker, WalkerError};
use odometry::Legs;
pub use odometry::{Feet, Foot};

/// Signals of one run from a log. Joint vectors are in the model's order.
#[derive(Clone, Debug, PartialEq)]
pub struct Course {
    /// Position targets sent after each sample, rad; `samples × joints`.
    pub targets: Vec<f32>,
    /// Joint positions as the encoders report them, rad; `samples × joints`.
    pub position: Vec<f32>,
    /// Joint velocities, rad/s; `samples × joints`.
    pub velocity: Vec<f32>,
    /// Orientation of the inertial unit, wxyz, unit. Its heading may drift.
    pub quaternion: Vec<[f32; 4]>,
    /// Angular velocity as the gyro reads it, rad/s.
    pub rates: Vec<[f32; 3]>,
    /// Where the feet are in the base's frame.
    legs: Legs,
}

impl Course {
    /// A run of `walker`'s robot; see the fields.
    ///
    /// # Errors
    /// Fields of different numbers of samples.
    pub fn new(
        walker: &Walker,
        targets: Vec<f32>,
        position: Vec<f32>,
        velocity: Vec<f32>,
        quaternion: Vec<[f32; 4]>,
        rates: Vec<[f32; 3]>,
    ) -> Result<Self, WalkerError> {
        let joints = walker.default_pose.len();
        let samples = quaternion.len();
        // All signals in numbers of joints, so that one comparison serves them.
        let lengths = [targets.len(), position.len(), velocity.len(), rates.len() * joints];
        if samples == 0 || lengths.iter().any(|&length| length != samples * joints) {
            let what = format!("have {lengths:?} numbers for {samples} samples of {joints} joints");
            return Err(WalkerError::Option { option: "the signals of a course", what });
        }
        let legs = Legs::new(&Feet::new(walker), walker.model(), &position, &velocity, &quaternion);
        Ok(Self { targets, position, velocity, quaternion, rates, legs })
    }

    /// Number of samples.
    pub fn samples(&self) -> usize {
        self.quaternion.len()
    }

    fn joints(&self) -> usize {
        self.position.len() / self.samples()
    }

    /// Readings of the sensors at sample `sample`, as a start with the base at the origin and at rest.
    pub fn reading(&self, sample: usize) -> Start {
        let row = sample * self.joints()..(sample + 1) * self.joints();
        Start {
            base_position: [0.0; 3],
            base_quaternion: self.quaternion[sample],
            base_linear: [0.0; 3],
            base_angular: self.rates[sample],
            joint_position: self.position[row.clone()].to_vec(),
            joint_velocity: self.velocity[row].to_vec(),
        }
    }

    /// Where the feet are in the base's frame: at every sample, for every foot, its place (m), its velocity (m/s) and what a
    /// unit of each of `joints` joints of its leg moves it by (m/rad), three numbers each. Legs with fewer joints end in zeros.
    pub fn legs(&self, joints: usize) -> Vec<f32> {
        self.legs.numbers(joints)
    }

    /// The state in which `candidate`, a robot of `walker`, begins: feet on the ground, the base still.
    pub fn first(&self, walker: &Walker, candidate: &Candidate) -> Start {
        self.start(walker.model(), &Correction::new(candidate, FEET_TRUST))
    }

    /// Orientation and angular velocity (rad/s, body frame) of the base at sample `sample`, without the errors of the
    /// candidate's inertial unit.
    fn base(&self, sample: usize, imu: Option<&Imu>) -> ([f32; 4], [f32; 3]) {
        let (attitude, rates) = (self.quaternion[sample], self.rates[sample]);
        imu.map_or((attitude, rates), |imu| imu.base(attitude, rates))
    }

    /// The robot's state by the sensors at sample `sample`, with the base's position `place` and velocity `linear`.
    fn shown(&self, sample: usize, correction: &Correction<'_>, place: [f32; 3], linear: [f32; 3]) -> Start {
        // Encoders report the true angle plus their bias.
        let true_angle = |(&angle, &bias): (&f32, &f64)| (f64::from(angle) - bias) as f32;
        let (base_quaternion, base_angular) = self.base(sample, correction.imu.as_ref());
        let reading = self.reading(sample);
        Start {
            base_position: place,
            base_quaternion,
            base_linear: linear,
            base_angular,
            joint_position: reading.joint_position.iter().zip(correction.bias).map(true_angle).collect(),
            joint_velocity: reading.joint_velocity,
        }
    }

    /// The first state: feet on the ground, the base still. The first steps of a log teach how it moves.
    fn start(&self, model: &Model, correction: &Correction<'_>) -> Start {
        let start = self.shown(0, correction, [0.0; 3], [0.0; 3]);
        let angles: Vec<f64> = start.joint_position.iter().map(|&angle| f64::from(angle)).collect();
        let height = standing_height(model, start.base_quaternion.map(f64::from), &angles);
        Start { base_position: [0.0, 0.0, height as f32], ..start }
    }
}

/// Correction of a job's robot by the readings of a log's sensors.
struct Correction<'a> {
    /// Errors of its encoders, rad, and of its inertial unit; they are removed from the readings.
    bias: &'a [f64],
    imu: Option<Imu>,
    /// [`Job::feet_trust`].
    feet_trust: f64,
}

impl<'a> Correction<'a> {
    fn new(candidate: &'a Candidate, feet_trust: f64) -> Self {
        Self { bias: &candidate.robot.encoder_bias, imu: candidate.sensors.imu(), feet_trust }
    }

    /// The state that sample `sample` of `course` says robot `index` has; `None` if the robot has diverged.
    fn state(
        &self,
        feet: &Feet,
        motion: &Motion,
        index: usize,
        course: &Course,
        sample: usize,
    ) -> Option<Start> {
        let three = |rows: &[f32]| -> [f32; 3] { std::array::from_fn(|k| rows[3 * index + k]) };
        let (mut place, mut linear) = (three(&motion.base_position), three(&motion.base_linear));
        let base = course.base(sample, self.imu.as_ref());
        if let Some(change) = course.legs.change(feet, motion, index, course, sample, base) {
            // Height alone: on flat ground the place of the base along it changes nothing.
            place[2] += (self.feet_trust * change.height) as f32;
            (0..3).for_each(|k| linear[k] += (self.feet_trust * change.linear[k]) as f32);
        }
        // A diverged robot is left as it is, so that the fit sees it.
        if !linear.iter().chain(&place).all(|x| x.is_finite()) {
            return None;
        }
        let mut state = course.shown(sample, self, place, linear);
        // The list is empty where readings of joint velocities are not filtered.
        if !motion.filtered_velocity.is_empty() {
            let rows = index * course.joints()..(index + 1) * course.joints();
            let (read, own) = (&motion.filtered_velocity[rows.clone()], &motion.joint_velocity[rows]);
            // The filter keeps its difference from the true velocity, so that its reading is the log's.
            for ((velocity, read), own) in state.joint_velocity.iter_mut().zip(read).zip(own) {
                *velocity -= read - own;
            }
        }
        Some(state)
    }
}

/// [`Job::feet_trust`] that trusts sensors and simulation alike.
pub const FEET_TRUST: f64 = 0.5;

/// A robot that predicts.
#[derive(Clone, Debug, PartialEq)]
pub struct Job {
    /// The robot.
    pub candidate: Candidate,
    /// Samples from one correction to the next; 1 predicts each sample from the one before.
    pub every: usize,
    /// Share of the base's change that standing feet ask for which is made, 0 to 1.
    pub feet_trust: f64,
    /// Seed of the torque noise.
    pub seed: u64,
}

/// Runs every job on every course and hands `consume(job, course, track)` each track, once, from any thread in any
/// order. Rows of a track hold the prediction, before the correction that follows it; there are no actions in it.
/// Tracks do not depend on the other jobs, nor on the number of threads. Once `cancel` says so it returns soon,
/// without the tracks that are missing; `cancel` must keep saying so.
///
/// # Errors
/// A candidate that is no robot.
pub fn predict(
    walker: &Walker,
    courses: &[Course],
    jobs: &[Job],
    threads: usize,
    consume: &(dyn Fn(usize, usize, &Track) + Sync),
    cancel: &(dyn Fn() -> bool + Sync),
) -> Result<(), WalkerError> {
    let feet = Feet::new(walker);
    in_tiles(jobs.len(), courses, threads, |worker: &mut Worker, job, first, chunk| {
        let whole = worker.run(walker, &feet, &jobs[job], chunk, first, &mut |_| (), cancel)?;
        for (k, track) in worker.tracks.iter().enumerate().take(if whole { chunk.len() } else { 0 }) {
            consume(job, first + k, track);
        }
        Ok(())
    })
}

/// A robot before and after a control period.
pub type Stepped = [RobotState; 2];

/// Every robot of `job` before and after each control period, `periods × courses`: before it, it is already corrected.
/// Tests compare other engines with it.
///
/// # Errors
/// As [`predict`].
pub fn robots(walker: &Walker, courses: &[Course], job: &Job) -> Result<Vec<Vec<Stepped>>, WalkerError> {
    let (mut periods, mut before) = (Vec::new(), None);
    let mut watch = |tile: &mut Tile<'_>| {
        let now: Vec<RobotState> = (0..courses.len()).map(|index| tile.robot(index)).collect();
        // The watch is called twice a period: before the step and after it.
        before = match before.take() {
            None => Some(now),
            Some(before) => {
                periods.push(before.into_iter().zip(now).map(|(before, now)| [before, now]).collect());
                None
            }
        };
    };
    // One tile holds all courses, however many there are.
    Worker::default().run(walker, &Feet::new(walker), job, courses, 0, &mut watch, &|| false)?;
    Ok(periods)
}

/// A thread's buffers.
#[derive(Default)]
struct Worker {
    tracks: Vec<Track>,
    motion: Motion,
    targets: Vec<f32>,
    corrected: Vec<(usize, Start)>,
    noise: TorqueNoise,
}

impl Worker {
    /// Fills the tracks of some courses. False if it gave up. `watch` is called before and after each control period.
    #[allow(clippy::too_many_arguments, reason = "one caller besides tests")]
    fn run(
        &mut self,
        walker: &Walker,
        feet: &Feet,
        job: &Job,
        courses: &[Course],
        first: usize,
        watch: &mut dyn FnMut(&mut Tile<'_>),
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Result<bool, WalkerError> {
        let (batch, count) = (&walker.batch, courses.len());
        // All robots of a tile are the job's robot, each under another course.
        let robot: Params<f64> = walker.robot(&job.candidate).params(batch.model())?;
        let correction = Correction::new(&job.candidate, job.feet_trust);
        let mut tile = walker.engine.tile(batch, &vec![robot; count], &job.candidate.networks)?;
        self.motion = batch.motion(count);
        // The list never shrinks: tracks keep their memory from tile to tile.
        self.tracks.resize_with(count.max(self.tracks.len()), Track::default);
        for (index, (course, track)) in courses.iter().zip(&mut self.tracks).enumerate() {
            track.begin();
            tile.place(index, &course.start(batch.model(), &correction));
        }
        tile.observe(&mut self.motion);
        let longest = courses.iter().map(Course::samples).max().unwrap_or(0);
        for sample in 0..longest {
            if sample.is_multiple_of(ASK) && cancel() {
                return Ok(false);
            }
            // The prediction is recorded before it is corrected.
            for (index, course) in courses.iter().enumerate().filter(|(_, course)| sample < course.samples())
            {
                self.tracks[index].look(walker, &self.motion, index, correction.imu.as_ref(), sample);
                // Who fell in a prediction is put on its feet again: a fall is no end here.
                self.tracks[index].fell_at = None;
                if sample > 0 && sample.is_multiple_of(job.every.max(1)) {
                    let state = correction.state(feet, &self.motion, index, course, sample);
                    self.corrected.extend(state.map(|state| (index, state)));
                }
            }
            // All at once: robots of one block are set together, which is faster.
            tile.correct(&self.corrected);
            self.corrected.clear();
            // No row would hold the state after a last step.
            if sample + 1 == longest {
                break;
            }
            self.targets.clear();
            for course in courses {
                // A course that is over keeps its last targets until the longest one of the tile ends.
                let row = sample.min(course.samples() - 1) * course.joints();
                self.targets.extend_from_slice(&course.targets[row..row + course.joints()]);
            }
            let torques =
                self.noise.torques(walker, &job.candidate, job.seed, first as u32, sample as u32, count);
            watch(&mut tile);
            tile.step(&self.targets, torques, &mut self.motion);
            watch(&mut tile);
        }
        Ok(true)
    }
}
