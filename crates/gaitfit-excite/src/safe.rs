//! Limits that hold in simulation: on robots all over the bounds of a fit.

use super::Swept;
use super::body::Body;
use super::settings::{ChirpSettings, MAX_SAMPLES};
use super::sweep::Sweep;
use gaitfit_adapt::{JointParameter, ReplaySimulator, Rollout, Signals, Simulator, SimulatorError, Theta};
use gaitfit_model::{shown, significant};
use gaitfit_physics::Preset;
use gaitfit_random::{Purpose, Stream};
use gaitfit_run::machine;
use gaitfit_run::watch::Watch;
use gaitfit_settings::Error;
use gaitfit_sim::{Candidate, Cpu, Engine, JointSignals, ReplayOptions};
use std::num::NonZeroUsize;
use std::sync::{Mutex, PoisonError};

/// Longest physics step, s: that of fits of legs in the air.
const STEP: f64 = 0.0025;
/// Kinds of parameters whose bounds are tried in all combinations: 4 kinds have 16 corners, each further one would
/// double them.
const CORNERED: usize = 4;
/// Robots drawn within the bounds.
const DRAWN: u32 = 15;
/// Simulations before it is given up.
const ROUNDS: usize = 60;
/// Factors by which a chirp gets smaller in one round: the smallest, because torque is not proportional to the
/// amplitude, and the largest, so that each round gets on.
const SMALLEST: f64 = 0.4;
const LARGEST: f64 = 0.97;
/// Share of the limit that a step aims at: a little inside it.
const INSIDE: f64 = 0.97;
/// A chirp whose amplitude is below this share of the one asked for counts as none.
const MIN_SHARE: f64 = 0.02;
/// A top frequency is not lowered below this share of the one asked for, nor below the first frequency.
const SLOWEST: f64 = 0.25;
/// Exponent of the factor for joints that carry the joint, or hang on it.
const NEIGHBOUR: f64 = 0.3;

/// Digits of numbers in messages.
const DIGITS: usize = 4;

/// A limit.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Limit {
    Position,
    Velocity,
    Torque,
}

/// Largest position, velocity and torque of a joint on one robot.
#[derive(Clone, Debug, PartialEq)]
struct Peak {
    /// Lowest and highest position, rad.
    position: [f64; 2],
    /// rad/s.
    velocity: f64,
    /// N·m.
    torque: f64,
}

impl Peak {
    fn new(centre: f64) -> Self {
        Self { position: [centre; 2], velocity: 0.0, torque: 0.0 }
    }

    fn join(&mut self, other: &Self) {
        self.position[0] = self.position[0].min(other.position[0]);
        self.position[1] = self.position[1].max(other.position[1]);
        self.velocity = self.velocity.max(other.velocity);
        self.torque = self.torque.max(other.torque);
    }
}

/// Results of one simulation of all robots.
struct Played {
    /// The peaks of each joint of each robot, the file's last.
    peaks: Vec<Vec<Peak>>,
    /// Positions and velocities of the robot of the file.
    expected: [Vec<f64>; 2],
}

/// The simulated robots.
pub(super) struct Trial<'a> {
    body: &'a Body,
    theta: Theta,
    rate: f64,
    margin: f64,
    threads: usize,
    robots: Vec<Vec<f64>>,
    longest_delay: f64,
}

/// A chirp within the limits.
pub(super) struct Safe {
    pub sweep: Sweep,
    pub targets: Vec<f64>,
    /// Positions and velocities of the robot of the file.
    pub expected: [Vec<f64>; 2],
    pub rounds: usize,
    peaks: Vec<Peak>,
    limited: Vec<Option<String>>,
}

impl Safe {
    /// The joints that move.
    pub fn swept(&self, body: &Body) -> Vec<Swept> {
        let joints = self.sweep.joints.iter().zip(&self.peaks).zip(&self.limited).enumerate();
        let moving = joints.filter(|(_, ((joint, _), _))| joint.turn.is_some());
        moving
            .map(|(at, ((joint, peak), limited))| Swept {
                name: body.names[at].clone(),
                centre: joint.centre,
                amplitude: joint.amplitude,
                top_hz: joint.top,
                position: peak.position,
                range: body.range[at],
                velocity: peak.velocity,
                velocity_limit: body.velocity[at],
                torque: peak.torque,
                torque_limit: body.torque[at],
                limited_by: limited.clone(),
            })
            .collect()
    }
}

impl<'a> Trial<'a> {
    /// Robots at the corners of the bounds, and some drawn within them.
    pub fn new(settings: &ChirpSettings, body: &'a Body) -> Result<Self, Error> {
        let theta = body.theta()?;
        let mut kinds: Vec<&str> = Vec::new();
        for entry in theta.entries() {
            if !kinds.contains(&entry.kind) {
                kinds.push(entry.kind);
            }
        }
        // All entries of a kind are at the same end: one corner for each combination of joints would be too
        // many.
        let corner = |bits: usize| -> Vec<f64> {
            let value = |entry: &gaitfit_adapt::Entry| match kinds
                .iter()
                .take(CORNERED)
                .position(|kind| *kind == entry.kind)
            {
                Some(at) if bits >> at & 1 == 1 => entry.upper,
                Some(_) => entry.lower,
                None => entry.start,
            };
            theta.entries().iter().map(value).collect()
        };
        // The worst robot need not be at a corner.
        let drawn = |number: u32| -> Vec<f64> {
            let draws = Stream::new(settings.seed, Purpose::EXCITATION).environment(number).step(1);
            let entries = theta.entries().iter().zip(0..);
            entries.map(|(one, draw)| one.lower + (one.upper - one.lower) * draws.uniform(draw)).collect()
        };
        let robots = (0..1 << kinds.len().min(CORNERED)).map(corner).chain((0..DRAWN).map(drawn)).collect();
        let longest_delay = theta.largest(JointParameter::Delay).unwrap_or(0.0);
        Ok(Self {
            body,
            robots,
            longest_delay,
            rate: settings.rate,
            margin: settings.margin,
            threads: settings.threads.map_or_else(machine::threads, NonZeroUsize::get),
            theta,
        })
    }

    /// The parameters of the fit.
    pub fn theta(&self) -> &Theta {
        &self.theta
    }

    /// Number of simulated robots: the robot of the file, and those with parameters at their bounds.
    pub fn robots(&self) -> usize {
        self.robots.len() + 1
    }

    /// Describes the robot of the bounds number `at`.
    fn describe(&self, at: usize) -> String {
        let corners = self.robots.len() - DRAWN as usize;
        if at >= corners {
            return "a robot drawn within the bounds".to_owned();
        }
        let mut said: Vec<&str> = Vec::new();
        let mut words = Vec::new();
        for (entry, value) in self.theta.entries().iter().zip(&self.robots[at]) {
            if !said.contains(&entry.kind) {
                said.push(entry.kind);
                words.push(format!("{} {}", entry.kind, significant(*value, DIGITS)));
            }
        }
        format!("the robot with {}", words.join(", "))
    }

    /// Plays `targets` on all robots. One whose simulation diverges has peaks that are not finite.
    fn play(&self, targets: &[f64], watch: &Watch<'_>) -> Result<Played, Error> {
        let body = self.body;
        let options = ReplayOptions {
            // The subtraction takes rounding away: a whole number of steps must not become one more.
            substeps: (1.0 / (self.rate * STEP) - 1e-9).ceil().max(1.0) as usize,
            preset: Preset::Accurate,
            max_delay: self.longest_delay,
            isa: None,
        };
        let recording = body.recording(self.rate, targets.to_vec());
        let simulator = ReplaySimulator::new(&body.model, vec![recording], options, self.threads)
            .map_err(Error::failed)?;
        // One place more than robots: the last is the robot of the file.
        let peaks = Mutex::new(vec![Vec::new(); self.robots.len() + 1]);
        let expected = Mutex::new([Vec::new(), Vec::new()]);
        let keep = |at: usize, values: Vec<Peak>| {
            peaks.lock().unwrap_or_else(PoisonError::into_inner)[at] = values;
        };
        let of_bounds = |at: usize, _: usize, signals: Signals<'_>| {
            let candidate = simulator.candidate(&self.theta, &self.robots[at]);
            keep(at, self.peaks(&candidate, targets, signals));
        };
        let nominal = Candidate::nominal(&body.model);
        // The robot of the file is simulated as well: its signals are what the user compares the real log
        // with.
        let of_file = |_: usize, _: usize, signals: &JointSignals| {
            let signals = Signals::of_joints(&signals.position, &signals.velocity);
            keep(self.robots.len(), self.peaks(&nominal, targets, signals));
            let wide = |signal: &[f32]| signal.iter().map(|&value| f64::from(value)).collect();
            *expected.lock().unwrap_or_else(PoisonError::into_inner) =
                [wide(signals.position), wide(signals.velocity)];
        };
        let rollout = |values: &Vec<f64>| Rollout { values: values.clone(), ..Rollout::default() };
        let rollouts: Vec<Rollout> = self.robots.iter().map(rollout).collect();
        let cancel = || watch.stop();
        let stopped = || Error::interrupted_with_nothing("interrupted; nothing was written");
        simulator.simulate(&self.theta, &rollouts, &of_bounds, &cancel).map_err(|error| match error {
            SimulatorError::Cancelled => stopped(),
            error => Error::failed(error),
        })?;
        Cpu { threads: 1 }
            .replay(simulator.replay(), std::slice::from_ref(&nominal.robot), &of_file, &cancel)
            .map_err(Error::failed)?;
        if cancel() {
            return Err(stopped());
        }
        Ok(Played {
            peaks: peaks.into_inner().unwrap_or_else(PoisonError::into_inner),
            expected: expected.into_inner().unwrap_or_else(PoisonError::into_inner),
        })
    }

    /// The peaks of `signals`. The controller's torque is looked at with every target that may be in force at a sample:
    /// those sent since the candidate's delay before it, and the one that is sent then.
    fn peaks(&self, candidate: &Candidate, targets: &[f64], signals: Signals<'_>) -> Vec<Peak> {
        let width = self.body.names.len();
        let robot = candidate.robot(&self.body.gains.kp, &self.body.gains.kd);
        let mut peaks: Vec<Peak> = self.body.centre.iter().map(|&centre| Peak::new(centre)).collect();
        // Comparisons with NaN are false, so a diverged simulation would seem to keep every limit.
        let nan_is_all = |value: f64| if value.is_finite() { value } else { f64::INFINITY };
        for (joint, peak) in peaks.iter_mut().enumerate() {
            // Rounded up and one more: the delay need not be a whole number of samples.
            let late = (robot.delay[joint] * self.rate).ceil() as usize + 1;
            for sample in 0..targets.len() / width {
                let at = sample * width + joint;
                let (q, dq) = (f64::from(signals.position[at]), f64::from(signals.velocity[at]));
                let torque = |sent: usize| {
                    (robot.kp[joint] * (targets[sent * width + joint] - q) - robot.kd[joint] * dq).abs()
                };
                let max = (sample.saturating_sub(late)..=sample).map(torque).fold(0.0, f64::max);
                let position = if q.is_finite() { [q; 2] } else { [f64::NEG_INFINITY, f64::INFINITY] };
                let (velocity, torque) = (nan_is_all(dq.abs()), nan_is_all(max));
                peak.join(&Peak { position, velocity, torque });
            }
        }
        peaks
    }

    /// The limit that `peak` of a joint comes nearest to, and how much of the way: above 1 it does not hold. Positions count
    /// from the middle of the motion.
    fn used(&self, joint: usize, peak: &Peak) -> (Limit, f64) {
        let body = self.body;
        let part = 1.0 - self.margin;
        let [low, high] = body.range[joint];
        let (centre, free) = (body.centre[joint], 0.5 * self.margin * (high - low));
        // A pose at a limit leaves no room: any motion towards it then uses far more than all of it.
        let way = |distance: f64, room: f64| if distance <= 0.0 { 0.0 } else { distance / room.max(1e-9) };
        let below = way(centre - peak.position[0], centre - (low + free));
        let above = way(peak.position[1] - centre, high - free - centre);
        let all = [
            (Limit::Position, below.max(above)),
            (Limit::Velocity, peak.velocity / (part * body.velocity[joint])),
            (Limit::Torque, peak.torque / (part * body.torque[joint])),
        ];
        all.into_iter().fold((Limit::Position, 0.0), |max, one| if one.1 > max.1 { one } else { max })
    }

    /// The worst of all robots for each joint: which limit, how much of it is used, and which robot.
    fn worst(&self, peaks: &[Vec<Peak>]) -> Vec<(Limit, f64, usize)> {
        let used_most = |joint: usize| {
            let robots = peaks.iter().enumerate().map(|(robot, peaks)| {
                let (limit, used) = self.used(joint, &peaks[joint]);
                (limit, used, robot)
            });
            robots.fold((Limit::Position, 0.0, 0), |max, one| if one.1 > max.1 { one } else { max })
        };
        (0..self.body.names.len()).map(used_most).collect()
    }

    /// States which limit a joint meets on which robot.
    fn say(&self, joint: usize, limit: Limit, robot: usize) -> String {
        let body = self.body;
        let kind = body.model.joints[joint].kind;
        let limit = match limit {
            Limit::Position => {
                let [low, high] = body.range[joint].map(|limit| significant(limit, DIGITS));
                format!("position, {low} to {high} {}", kind.unit("rad"))
            }
            Limit::Velocity => {
                format!("velocity, {} {}", significant(body.velocity[joint], DIGITS), kind.unit("rad/s"))
            }
            Limit::Torque => {
                format!("torque, {} {}", significant(body.torque[joint], DIGITS), kind.unit("N·m"))
            }
        };
        let who = match robot {
            robot if robot < self.robots.len() => self.describe(robot),
            _ => "the robot of the file".to_owned(),
        };
        format!("{limit}, on {who}")
    }
}

/// Whether `a` carries `b`, or `b` carries `a`.
fn related(body: &Body, a: usize, b: usize) -> bool {
    let (a, b) = (body.model.joints[a].body, body.model.joints[b].body);
    let above = |from: usize, to: usize| {
        std::iter::successors(Some(from), |&one| body.model.bodies[one].parent).any(|one| one == to)
    };
    above(a, b) || above(b, a)
}

/// Makes the chirp smaller and slower until all limits hold.
pub(super) fn shrink(
    settings: &ChirpSettings,
    body: &Body,
    trial: &Trial<'_>,
    watch: &Watch<'_>,
) -> Result<Safe, Error> {
    let mut sweep = Sweep::new(settings, &body.centre, &body.turn);
    let samples = sweep.samples() as f64;
    if samples > MAX_SAMPLES {
        return Err(Error::settings(format!(
            "the chirp has {samples} targets, more than {MAX_SAMPLES}; shorten `seconds` (--seconds), lower `rate` \
             (--rate), or let more joints move together (--turns)"
        )));
    }
    // No smaller chirp helps if the pose itself exceeds a limit, so it is tried first.
    let still = sweep.at_rest();
    let peaks = trial.play(&still.targets(), watch)?.peaks;
    for (joint, (limit, used, robot)) in trial.worst(&peaks).into_iter().enumerate() {
        if used > 1.0 {
            return Err(Error::settings(format!(
                "no chirp about this pose stays within the limits: {} at rest uses {:.0} % of what the margin leaves \
                 of its limit ({}); give another `pose` (--pose), other gains, or a smaller `margin` (--margin)",
                shown(&body.names[joint]),
                100.0 * used,
                trial.say(joint, limit, robot)
            )));
        }
    }
    let lowest: Vec<f64> =
        sweep.joints.iter().map(|joint| (SLOWEST * joint.top).max(sweep.bottom).min(joint.top)).collect();
    let mut limited: Vec<Option<String>> = vec![None; body.names.len()];
    let mut last = None;
    for round in 1..=ROUNDS {
        let targets = sweep.targets();
        let Played { peaks, expected } = trial.play(&targets, watch)?;
        let worst = trial.worst(&peaks);
        if worst.iter().all(|(_, used, _)| *used <= 1.0) {
            // The report shows the worst of all robots for each joint.
            let mut all: Vec<Peak> = body.centre.iter().map(|&centre| Peak::new(centre)).collect();
            for robot in &peaks {
                all.iter_mut().zip(robot).for_each(|(all, one)| all.join(one));
            }
            return Ok(Safe { sweep, targets, expected, rounds: round, peaks: all, limited });
        }
        for (joint, (limit, used, robot)) in worst.into_iter().enumerate().filter(|(_, one)| one.1 > 1.0) {
            let said = trial.say(joint, limit, robot);
            last = Some(format!("{}: {said}", shown(&body.names[joint])));
            // Bounded steps: peaks are no linear function of the amplitude.
            let factor = (INSIDE / used).clamp(SMALLEST, LARGEST);
            let moves = sweep.joints[joint].turn.is_some();
            // Joints of one limb load each other, so the neighbours give way too, by less.
            for other in (0..body.names.len()).filter(|&other| related(body, joint, other)) {
                let factor = if other == joint || !moves { factor } else { factor.powf(NEIGHBOUR) };
                let part = &mut sweep.joints[other];
                if part.turn.is_none() {
                    continue;
                }
                // Slower motions need less speed and torque, and keep their size.
                let slower = if limit == Limit::Position { 1.0 } else { factor.sqrt() };
                let top = (part.top * slower).max(lowest[other]);
                // The amplitude takes what the frequency does not: amplitude × frequency, the speed, falls by
                // `factor`.
                part.amplitude *= factor * part.top / top;
                part.top = top;
                let whose = if other == joint { "" } else { "of a joint of the same limb: " };
                limited[other] = Some(format!("{whose}{said}"));
            }
        }
        // A chirp so small would identify nothing.
        let small = sweep
            .joints
            .iter()
            .position(|joint| joint.turn.is_some() && joint.amplitude < MIN_SHARE * settings.amplitude);
        if let Some(joint) = small {
            let why = limited[joint].clone().or(last).unwrap_or_default();
            return Err(Error::settings(format!(
                "no chirp of {} stays within the limits: even {} rad is too much ({why}); give a lower last \
                 `frequency` (--frequency), another `pose` (--pose), other gains, or a smaller `margin` (--margin)",
                shown(&body.names[joint]),
                significant(sweep.joints[joint].amplitude, DIGITS)
            )));
        }
    }
    Err(Error::settings(format!(
        "after {ROUNDS} rounds a limit is still exceeded ({}); give a smaller `amplitude` (--amplitude) or last \
         `frequency` (--frequency)",
        last.unwrap_or_default()
    )))
}
