//! Numbers of candidates that go to the GPU.

use std::borrow::Cow;

use gaitfit_policy::follow::{Job, start_number};
use gaitfit_policy::predict;
use gaitfit_policy::walker::Walker;
use gaitfit_sim::{Imu, SimError, Start, pool};

use super::FitError;
use super::scene::Subject;
use super::tables;
use crate::physics;

/// Numbers of some candidates, one after the other.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Numbers {
    /// Parameters of the physics.
    pub params: Vec<f32>,
    /// Factors on the position and velocity gains, and encoder biases, rad: a number a joint each.
    pub factors: Vec<f64>,
    /// Samples between resets, 0 for none.
    pub every: Vec<u32>,
    /// Seeds of torque noise, low word first.
    pub seeds: Vec<u32>,
    /// Number of the start that each candidate begins at, among the starts of a recording. For robots that make logs: the
    /// number of samples that each environment walks before its recording begins.
    pub begins: Vec<u32>,
    /// For robots that make logs, and for predictions: the state at the start of each environment.
    pub starts: Vec<f32>,
    /// For predictions: the share of what standing feet ask for that is done, of each candidate.
    pub trust: Vec<f64>,
    /// Standard deviations of torque noise, N·m.
    pub deviation: Vec<f64>,
    /// Errors of the inertial units, [`IMU_NUMBERS`](gaitfit_sim::IMU_NUMBERS) each.
    pub imus: Vec<f32>,
    /// Weights of networks, a list a candidate, as the step visits them.
    pub weights: Vec<Vec<f64>>,
}

impl Numbers {
    /// Numbers of `jobs`. `starts`: number of starts of each recording.
    ///
    /// # Errors
    /// A candidate that is no robot, or whose delay is longer than the simulator's.
    pub fn new(subject: Subject<'_>, jobs: &[Job], starts: usize, threads: usize) -> Result<Self, FitError> {
        let robots = pool::map(jobs.len(), threads, |job| robot(subject, &jobs[job]));
        let robots = robots.into_iter().collect::<Result<Vec<_>, _>>()?;
        let mut numbers = Self::default();
        for (job, (params, weights)) in jobs.iter().zip(robots) {
            let robot = &job.candidate.robot;
            numbers.params.extend(params);
            numbers.factors.extend(robot.kp_scale.iter().chain(&robot.kd_scale).chain(&robot.encoder_bias));
            // 0 tells the kernel never to reset, so a period of 0 becomes 1.
            let every = job.reset_every.map(|every| every.max(1));
            numbers.every.push(every.map_or(0, |every| u32::try_from(every).unwrap_or(u32::MAX)));
            // The kernel takes a seed as two words of 32 bits.
            numbers.seeds.extend([job.seed as u32, (job.seed >> 32) as u32]);
            numbers.begins.push(start_number(job.seed, starts) as u32);
            numbers.deviation.push(job.candidate.torque_noise);
            numbers.imus.extend(Imu::numbers(job.candidate.sensors.imu().as_ref()));
            numbers.weights.push(weights);
        }
        Ok(numbers)
    }
}

/// How a robot that makes logs begins one of them.
#[derive(Clone, Debug, PartialEq)]
pub struct Begin {
    /// Number of samples that it walks under the first command before the recording begins.
    pub earlier: u32,
    /// Its state when it starts to walk.
    pub start: Start,
}

impl Numbers {
    /// The same numbers with these beginnings of the recordings: `begins[job][recording]`.
    #[must_use]
    pub fn beginning(mut self, begins: &[&[Begin]]) -> Self {
        let all = || begins.iter().copied().flatten();
        self.starts = all().flat_map(|begin| tables::numbers(&begin.start)).collect();
        self.begins = all().map(|begin| begin.earlier).collect();
        self
    }
}

/// Data that predictions of some candidates need besides their numbers.
#[derive(Clone, Copy)]
pub struct PredictionInput<'a> {
    /// The robot.
    pub walker: &'a Walker,
    /// Readings of the logs' sensors.
    pub courses: &'a [predict::Course],
    /// [`predict::Job::feet_trust`] of each job.
    pub trust: &'a [f64],
}

impl Numbers {
    /// The same numbers of `jobs` with the first states of their predictions, and with the trust in standing feet.
    #[must_use]
    pub fn predicting(mut self, jobs: &[Job], input: &PredictionInput<'_>, threads: usize) -> Self {
        let PredictionInput { walker, courses, trust } = *input;
        // Candidates with the same errors of sensors begin alike.
        let alike = |one: &Job, other: &Job| {
            one.candidate.robot.encoder_bias == other.candidate.robot.encoder_bias
                && one.candidate.sensors == other.candidate.sensors
        };
        let first: Vec<usize> =
            jobs.iter().map(|job| jobs.iter().position(|other| alike(job, other)).unwrap_or(0)).collect();
        let distinct: Vec<usize> = (0..jobs.len()).filter(|&job| first[job] == job).collect();
        let begun: Vec<Vec<f32>> = pool::map(distinct.len() * courses.len(), threads, |piece| {
            let (job, course) = (distinct[piece / courses.len()], &courses[piece % courses.len()]);
            tables::numbers(&course.first(walker, &jobs[job].candidate))
        });
        let begun_by = |job: usize| {
            let place = distinct.iter().position(|&other| other == job).unwrap_or(0);
            begun[place * courses.len()..][..courses.len()].iter().flatten().copied()
        };
        self.starts = first.iter().flat_map(|&job| begun_by(job)).collect();
        self.trust = trust.to_vec();
        self
    }
}

impl Numbers {
    /// These numbers of `jobs` candidates, repeated or cut until there are `count`: a session computes all that it has room for.
    #[must_use]
    pub fn repeated(&self, jobs: usize, count: usize) -> Cow<'_, Self> {
        fn repeat<T: Clone>(numbers: &[T], jobs: usize, count: usize) -> Vec<T> {
            let each = numbers.len() / jobs.max(1);
            numbers.iter().cycle().take(each * count).cloned().collect()
        }
        if jobs == count {
            return Cow::Borrowed(self);
        }
        Cow::Owned(Self {
            params: repeat(&self.params, jobs, count),
            factors: repeat(&self.factors, jobs, count),
            every: repeat(&self.every, jobs, count),
            seeds: repeat(&self.seeds, jobs, count),
            begins: repeat(&self.begins, jobs, count),
            starts: repeat(&self.starts, jobs, count),
            trust: repeat(&self.trust, jobs, count),
            deviation: repeat(&self.deviation, jobs, count),
            imus: repeat(&self.imus, jobs, count),
            weights: repeat(&self.weights, jobs, count),
        })
    }
}

/// Parameters and weights of a candidate.
fn robot(subject: Subject<'_>, job: &Job) -> Result<(Vec<f32>, Vec<f64>), FitError> {
    let model = subject.model();
    let candidate = &job.candidate;
    let delay = candidate.robot.delay.iter().fold(0.0f64, |max, &delay| max.max(delay));
    if delay > subject.max_delay() {
        let must = "at most the simulator's max_delay";
        return Err(SimError::Option { option: "a candidate's delay", value: delay.to_string(), must }.into());
    }
    let robot = subject.params(candidate)?;
    if let Some(walker) = subject.walker() {
        walker.batch.check_imu_delay(std::slice::from_ref(&robot))?;
    }
    let mut params = Vec::new();
    robot.visit(|_, &number| params.push(number as f32));
    Ok((params, physics::weights(model, &candidate.networks)?))
}
