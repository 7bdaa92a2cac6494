//! The signal: a sine whose frequency rises in proportion to time, faded in and out.

use super::settings::{ChirpSettings, Turns};
use gaitfit_random::{Purpose, Stream};
use std::f64::consts::{PI, TAU};

/// Rest before the first turn and after the last, s.
const REST_SECONDS: f64 = 0.5;
/// Joints that move together end at frequencies down to this part of the last one, so that their motions differ.
const SLOWEST: f64 = 0.8;
/// Steps of a written target in a radian. Targets are rounded before they are simulated, so that what was simulated
/// is what the file holds.
const STEPS: f64 = 1e6;

/// The targets of a chirp.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Sweep {
    rate: f64,
    /// Samples of a turn, and of the rest at both ends.
    turn: usize,
    rest: usize,
    ease: f64,
    /// First frequency, Hz.
    pub bottom: f64,
    turns: usize,
    /// One a joint of the robot.
    pub joints: Vec<JointSweep>,
}

/// The targets of a joint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct JointSweep {
    /// Turn in which it moves; `None`: it is held.
    pub turn: Option<usize>,
    /// Middle of the motion, rad.
    pub centre: f64,
    /// rad.
    pub amplitude: f64,
    /// Last frequency, Hz.
    pub top: f64,
    /// Phase at the beginning, rad.
    phase: f64,
}

impl Sweep {
    /// The chirp of the settings, before anything makes it smaller. `turn`: the turn of each joint.
    pub fn new(settings: &ChirpSettings, centre: &[f64], turn: &[Option<usize>]) -> Self {
        let [bottom, top] = settings.frequency;
        let joint = |(number, (&centre, &turn)): (usize, (&f64, &Option<usize>))| {
            let draws = Stream::new(settings.seed, Purpose::EXCITATION).environment(number as u32);
            // A joint that moves alone has no other to be told apart from.
            let alone = settings.turns == Turns::Joints;
            let part = if alone { 1.0 } else { SLOWEST + (1.0 - SLOWEST) * draws.uniform(1) };
            JointSweep {
                turn,
                centre,
                amplitude: if turn.is_some() { settings.amplitude } else { 0.0 },
                top: (top * part).max(bottom),
                // Random phases and end frequencies keep joints that move together from moving alike.
                phase: TAU * draws.uniform(0),
            }
        };
        Self {
            rate: settings.rate,
            // In whole samples.
            turn: (settings.seconds * settings.rate).round() as usize,
            rest: (REST_SECONDS * settings.rate).round() as usize,
            ease: settings.ease,
            bottom,
            turns: turn.iter().flatten().max().map_or(0, |last| last + 1),
            joints: centre.iter().zip(turn).enumerate().map(joint).collect(),
        }
    }

    /// A sweep that holds the same pose without motion, for as long as robots need to settle.
    pub fn at_rest(&self) -> Self {
        let still = |joint: &JointSweep| JointSweep { turn: None, amplitude: 0.0, ..*joint };
        // 2 s.
        let turn = (2.0 * self.rate).round() as usize;
        Self { turn, turns: 1, joints: self.joints.iter().map(still).collect(), ..self.clone() }
    }

    /// Number of targets of a joint.
    pub fn samples(&self) -> usize {
        2 * self.rest + self.turns * self.turn
    }

    /// `samples × joints`, rad, as they are written.
    pub fn targets(&self) -> Vec<f64> {
        let row = |sample: usize| self.joints.iter().map(move |joint| self.target(joint, sample));
        (0..self.samples()).flat_map(row).collect()
    }

    fn target(&self, joint: &JointSweep, sample: usize) -> f64 {
        let begin = self.rest + joint.turn.unwrap_or(0) * self.turn;
        let moves = joint.turn.is_some() && (begin..begin + self.turn).contains(&sample);
        let offset = if moves { self.wave(joint, (sample - begin) as f64 / self.rate) } else { 0.0 };
        ((joint.centre + offset) * STEPS).round() / STEPS
    }

    /// The motion `time` seconds into the joint's turn, rad.
    fn wave(&self, joint: &JointSweep, time: f64) -> f64 {
        let seconds = self.turn as f64 / self.rate;
        let edge = time.min(seconds - time).max(0.0);
        // Raised cosine at both ends: target and its velocity do not jump.
        let fade = if edge < self.ease { 0.5 - 0.5 * (PI * edge / self.ease).cos() } else { 1.0 };
        // Cycles so far: the integral of a frequency that rises in proportion to time.
        let turns = self.bottom * time + 0.5 * (joint.top - self.bottom) * time * time / seconds;
        joint.amplitude * fade * (TAU * turns + joint.phase).sin()
    }
}
