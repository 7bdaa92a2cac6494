//! Data of recordings that simulated robots follow, as the kernels' arrays.

use gaitfit_physics::{State, compile};
use gaitfit_policy::Policy;
use gaitfit_policy::follow::Script;
use gaitfit_policy::predict::{Course, Feet};
use gaitfit_policy::walker::Walker;
use gaitfit_sim::{Replay, Start};

use super::text::leg_joints;
use super::{FitError, Subject};
use crate::networks::{Networks, unknown_policy};

/// Numbers of the base's orientation (a quaternion) and rates.
const IMU_SIGNALS: usize = 7;

/// Data of recordings that simulated robots follow. Recordings shorter than the longest are filled up.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Tables {
    /// Samples of each recording.
    pub lengths: Vec<u32>,
    /// Samples of the longest.
    pub samples: usize,
    /// Whether every sample of every recording has a whole state and actions, for resets.
    pub has_states: bool,
    /// Number of starts of each recording; 1 for a replay.
    pub starts: usize,
    /// For robots that make logs ([`Tables::for_logs`]): the max number of samples that a robot walks before a recording begins.
    pub earlier: Option<usize>,
    /// Arrays in single precision, by name.
    pub singles: Vec<(&'static str, Vec<f32>)>,
    /// Arrays in double precision, by name.
    pub doubles: Vec<(&'static str, Vec<f64>)>,
}

impl Tables {
    /// Tables of robots that follow `scripts` under `policy`.
    ///
    /// # Errors
    /// [`FitError::Unsupported`] for policies that the kernels do not know.
    pub fn walk(walker: &Walker, policy: &Policy, scripts: &[Script]) -> Result<Self, FitError> {
        if let Some(what) = unknown_policy(policy) {
            return Err(FitError::Unsupported(what.to_owned()));
        }
        let (actions, joints) = (walker.joints.len(), walker.default_pose.len());
        let lengths: Vec<usize> = scripts.iter().map(|script| script.commands.len()).collect();
        // All recordings have the room of the longest, so that a kernel finds a sample by multiplication.
        let samples = lengths.iter().copied().max().unwrap_or(0);
        // Resets need the state at every sample; one log without them switches them off.
        let has_states = scripts.iter().all(|script| {
            let length = script.commands.len();
            script.states.len() >= length && script.actions.len() >= length * actions
        });
        // Base: position (3), quaternion (4), linear and angular velocity (3 each). Joints: positions and velocities.
        let width = 13 + 2 * joints;
        let rows = scripts.len() * samples;
        let mut commands = vec![0.0; 3 * rows];
        let mut states = vec![0.0; if has_states { width * rows } else { 0 }];
        let mut logged = vec![0.0; if has_states { actions * rows } else { 0 }];
        let each = scripts.iter().map(|script| 1 + script.others.len()).max().unwrap_or(1);
        let mut starts = Vec::with_capacity(width * each * scripts.len());
        for (number, script) in scripts.iter().enumerate() {
            let first = number * samples;
            for (sample, command) in script.commands.iter().enumerate() {
                commands[3 * (first + sample)..][..3].copy_from_slice(command);
            }
            // All recordings get `each` starts; a recording with fewer repeats its own.
            starts.extend((0..each).flat_map(|number| numbers(script.begins(number as u64))));
            if has_states {
                let length = script.commands.len();
                logged[actions * first..][..actions * length]
                    .copy_from_slice(&script.actions[..actions * length]);
                for (sample, state) in script.states.iter().take(length).enumerate() {
                    states[width * (first + sample)..][..width].copy_from_slice(&numbers(state));
                }
            }
        }
        Ok(Self {
            lengths: lengths.iter().map(|&length| length as u32).collect(),
            samples,
            has_states,
            starts: each,
            earlier: None,
            singles: vec![
                ("commands", commands),
                ("starts", starts),
                ("states", states),
                ("actions", logged),
                ("network", Networks::new(policy).numbers),
            ],
            doubles: motion_places(walker, scripts, samples).into_iter().collect(),
        })
    }

    /// Tables for short predictions. `courses` holds what the logs' sensors read; it must not be empty.
    pub fn predict(walker: &Walker, courses: &[Course]) -> Self {
        let leg_joints = leg_joints(&Feet::new(walker));
        let samples = courses.iter().map(Course::samples).max().unwrap_or(0);
        let of_samples = |numbers: &dyn Fn(&Course) -> Vec<f32>| -> Vec<f32> {
            let filled = courses.iter().flat_map(|course| {
                let mut rows = numbers(course);
                rows.resize(rows.len() / course.samples() * samples, 0.0);
                rows
            });
            filled.collect()
        };
        let readings = |course: &Course| {
            (0..course.samples()).flat_map(|sample| numbers(&course.reading(sample))).collect()
        };
        Self {
            lengths: courses.iter().map(|course| course.samples() as u32).collect(),
            samples,
            has_states: true,
            starts: 1,
            earlier: None,
            singles: vec![
                ("logged", of_samples(&|course| course.targets.clone())),
                ("readings", of_samples(&readings)),
                ("legs", of_samples(&|course| course.legs(leg_joints))),
            ],
            doubles: Vec::new(),
        }
    }

    /// Tables of clamped robots that are given their recordings' targets.
    ///
    /// # Errors
    /// A robot that cannot be stepped.
    pub fn replay(replay: &Replay) -> Result<Self, FitError> {
        let joints = replay.model().joints.len();
        let recordings = replay.recordings();
        let lengths: Vec<usize> = recordings.iter().map(|one| one.target.len() / joints.max(1)).collect();
        let samples = lengths.iter().copied().max().unwrap_or(0);
        let mut logged = vec![0.0; recordings.len() * samples * joints];
        let (mut velocities, mut gains) = (Vec::new(), Vec::new());
        for (number, one) in recordings.iter().enumerate() {
            let targets = &mut logged[number * samples * joints..];
            for (to, &target) in targets.iter_mut().zip(&one.target) {
                *to = target as f32;
            }
            velocities.extend(one.dq0.iter().map(|&velocity| velocity as f32));
            gains.extend(one.kp.iter().chain(&one.kd).chain(&one.q0));
        }
        // The kernel needs a whole state; a clamped robot's base keeps the numbers that it has at rest.
        let tree = compile::<f32>(replay.model(), replay.settings())?;
        let mut rest = Vec::new();
        State::<f32>::new(&tree).visit(|_, &number| rest.push(number));
        Ok(Self {
            lengths: lengths.iter().map(|&length| length as u32).collect(),
            samples,
            has_states: false,
            starts: 1,
            earlier: None,
            singles: vec![("logged", logged), ("velocities", velocities), ("rest", rest)],
            doubles: vec![("gains", gains)],
        })
    }

    /// Tables for robots that make logs. Each robot has its own beginning of each recording ([`Begin`](super::Begin)). The signals
    /// also have the readings of its inertial unit. `earlier`: the max number of samples before a recording begins.
    #[must_use]
    pub fn for_logs(mut self, earlier: usize) -> Self {
        self.singles.retain(|(name, _)| *name != "starts");
        Self { earlier: Some(earlier), starts: 1, ..self }
    }

    /// Number of signals of a sample: [`Subject::dimensions`], and for logs seven more. These are the base's orientation (wxyz) and
    /// rates, as its inertial unit reads them.
    pub fn dimensions(&self, subject: Subject<'_>) -> usize {
        subject.dimensions() + if self.earlier.is_some() { IMU_SIGNALS } else { 0 }
    }

    /// Number of samples that are simulated: those of the longest recording, and those before it.
    pub fn steps(&self) -> usize {
        self.samples + self.earlier.unwrap_or(0)
    }

    /// Whether arrays of these tables have room for those of `other`.
    pub(super) fn has_sizes_of(&self, other: &Self) -> bool {
        let lengths = |tables: &Self| -> Vec<usize> {
            let (singles, doubles) = (tables.singles.iter(), tables.doubles.iter());
            singles.map(|(_, all)| all.len()).chain(doubles.map(|(_, all)| all.len())).collect()
        };
        let sizes = |tables: &Self| (tables.recordings(), tables.samples, tables.starts, tables.earlier);
        sizes(self) == sizes(other) && lengths(self) == lengths(other)
    }

    /// Recordings.
    pub fn recordings(&self) -> usize {
        self.lengths.len()
    }
}

/// Places in the motion that the policy follows, at each sample of each recording: the time since the motion's
/// beginning (s), then the angle about the vertical (rad) by which the motion is turned, for robots that are reset
/// and for robots that begin at a script's start. `None` for other policies.
fn motion_places(walker: &Walker, scripts: &[Script], samples: usize) -> Option<(&'static str, Vec<f64>)> {
    let place = |script: &Script, sample: usize| {
        let (logged, turned) = (script.place(sample, false), script.place(sample, true));
        [logged.time, logged.heading, turned.heading]
    };
    let rows = scripts.iter().flat_map(|script| (0..samples).map(move |sample| (script, sample)));
    let places = || rows.flat_map(|(script, sample)| place(script, sample)).collect();
    walker.observation.follows().then(|| ("motion_places", places()))
}

/// A start as the first numbers of a state.
pub(super) fn numbers(start: &Start) -> Vec<f32> {
    let parts: [&[f32]; 6] = [
        &start.base_position,
        &start.base_quaternion,
        &start.base_linear,
        &start.base_angular,
        &start.joint_position,
        &start.joint_velocity,
    ];
    parts.concat()
}
