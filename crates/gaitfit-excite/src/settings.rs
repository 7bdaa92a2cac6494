//! Settings of a chirp.

use gaitfit_log::PerJoint;
use gaitfit_model::shown_number;
use gaitfit_settings::Error;
use std::num::NonZeroUsize;
use std::path::PathBuf;

/// Max number of samples of a chirp.
pub(super) const MAX_SAMPLES: f64 = 100_000.0;
/// Min number of targets in a period of the fastest motion.
const MIN_TARGETS: f64 = 8.0;

/// Which joints move at a time.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Turns {
    /// All together.
    All,
    /// One limb after another; the joints of a limb move together.
    Limbs,
    /// One after another.
    Joints,
}

/// A chirp as a user asks for it.
#[derive(Clone, Debug)]
pub struct ChirpSettings {
    /// Robot file.
    pub robot: PathBuf,
    /// Whether what the engine cannot simulate in it is dropped.
    pub lenient: bool,
    /// Configuration of a fit, whose parameters, bounds and gains count; none: usual ones.
    pub fit: Option<PathBuf>,
    /// Patterns over the joints that move; none: all.
    pub joints: Vec<String>,
    /// Which joints move at a time.
    pub turns: Turns,
    /// Length of each turn, s.
    pub seconds: f64,
    /// First and last frequency, Hz.
    pub frequency: [f64; 2],
    /// Amplitude, rad.
    pub amplitude: f64,
    /// Targets a second.
    pub rate: f64,
    /// Time over which the amplitude rises at the beginning of a turn and falls at its end, s.
    pub ease: f64,
    /// Position gains; none: those of the fit or the robot.
    pub kp: Option<PerJoint>,
    /// Velocity gains.
    pub kd: Option<PerJoint>,
    /// Middle of the motion by joint name or pattern, rad; joints without one have a pose of the robot's.
    pub pose: Vec<(String, f64)>,
    /// Part of every limit that stays free.
    pub margin: f64,
    /// Speed limit of joints whose file says none, and of all if it is lower, rad/s.
    pub velocity_limit: Option<f64>,
    /// Torque limit of joints whose file says none, and of all if it is lower, N·m.
    pub torque_limit: Option<f64>,
    /// Root mean square of the differences to expect between a fit and its log, where the robot's range is 2.
    pub difference: f64,
    /// Seed of the joints' phases and of the simulated robots.
    pub seed: u64,
    /// Threads.
    pub threads: Option<NonZeroUsize>,
}

impl ChirpSettings {
    /// A chirp of 20 s on all joints of `robot`.
    pub fn new(robot: PathBuf) -> Self {
        Self {
            robot,
            lenient: false,
            fit: None,
            joints: Vec::new(),
            turns: Turns::All,
            seconds: 20.0,
            frequency: [0.1, 5.0],
            amplitude: 0.3,
            rate: 200.0,
            ease: 1.0,
            kp: None,
            kd: None,
            pose: Vec::new(),
            margin: 0.1,
            velocity_limit: None,
            torque_limit: None,
            difference: 2e-3,
            seed: 0,
            threads: None,
        }
    }

    /// Refuses numbers out of range.
    pub(super) fn check(&self) -> Result<(), Error> {
        let [low, high] = self.frequency;
        let within = |value: f64, min: f64, max: f64| value.is_finite() && (min..=max).contains(&value);
        let number = shown_number;
        let wrong = if !within(self.seconds, 0.5, 3600.0) {
            format!("`seconds` (--seconds) is {}; a turn takes 0.5 to 3600 s", number(self.seconds))
        } else if !within(self.rate, 20.0, 2000.0) {
            format!("`rate` (--rate) is {} Hz; give 20 to 2000", number(self.rate))
        } else if !(within(low, 1e-3, 1e3) && within(high, low, 1e3)) {
            format!(
                "`frequency` (--frequency) is {} {}; give two frequencies above 0, the lower first, Hz",
                number(low),
                number(high)
            )
        } else if high * MIN_TARGETS > self.rate {
            format!(
                "`frequency` (--frequency) ends at {} Hz, and a motion needs {MIN_TARGETS} targets a period: with {} \
                 targets a second give at most {}, or a higher --rate",
                number(high),
                number(self.rate),
                number(self.rate / MIN_TARGETS)
            )
        } else if !within(self.amplitude, 1e-4, std::f64::consts::PI) {
            format!("`amplitude` (--amplitude) is {} rad; give 1e-4 to π", number(self.amplitude))
        } else if !within(self.ease, 0.0, 0.5 * self.seconds) {
            format!(
                "`ease` (--ease) is {} s; give 0 to half of a turn, {} s",
                number(self.ease),
                number(0.5 * self.seconds)
            )
        } else if !within(self.margin, 0.0, 0.9) {
            format!("`margin` (--margin) is {}; give a part from 0 to 0.9", number(self.margin))
        } else if let Some(limit) = self.velocity_limit.filter(|limit| !within(*limit, 1e-3, 1e6)) {
            format!("`velocity_limit` (--velocity-limit) is {} rad/s; give 1e-3 to 1e6", number(limit))
        } else if let Some(limit) = self.torque_limit.filter(|limit| !within(*limit, 1e-3, 1e6)) {
            format!("`torque_limit` (--torque-limit) is {} N·m; give 1e-3 to 1e6", number(limit))
        } else if !within(self.difference, 1e-12, 1e3) {
            format!("`difference` (--difference) is {}; give 1e-12 to 1000", number(self.difference))
        } else if let Some((joint, angle)) = self.pose.iter().find(|(_, angle)| !angle.is_finite()) {
            format!("`pose` (--pose) has {joint} at {angle}; give an angle in rad")
        } else {
            return Ok(());
        };
        Err(Error::settings(wrong))
    }
}
