//! The interface through which this crate uses a simulator. It is so small that a user's own simulator can have it.

use crate::Theta;
use crate::cost::{Cost, Signal};
use crate::fit::{Costs, Evaluation, FitError, Job, Views, accumulate, measure};
use serde::{Deserialize, Serialize};

/// The parts of the recording that a simulated robot gets during the simulation. At the sample of a reset the signals hold the state that
/// the simulation reached; the reset follows. With every sample given, each from the second on is a one-sample
/// prediction.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub enum Resets {
    /// None: it starts with the recording's joints and runs freely, under its policy if it has one.
    #[default]
    Never,
    /// The whole state, joints and base, every this many samples, the first at sample 0. Robots do not record it.
    State(usize),
    /// The readings of the robot's own sensors, joints and IMU, every this many samples, and the recording's targets at every
    /// sample.
    Sensors(usize),
}

/// One candidate to simulate on every recording.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Rollout {
    /// One value an entry of θ; with an empty θ the robot is as its file says.
    pub values: Vec<f64>,
    /// The parts of the recording that the simulated robot gets.
    pub resets: Resets,
    /// Selects the random draws (torque noise, observation noise): rollouts with equal `draw` see equal noise.
    /// A simulator without randomness ignores it.
    pub draw: u64,
}

/// Simulated signals of one candidate on one recording. Joint matrices are `samples × joints`, row-major, joints in
/// the order of [`Identity::joints`]; base matrices `samples × 3`. Row 0 is the initial state.
#[derive(Clone, Copy, Debug, Default)]
pub struct Signals<'a> {
    /// Joint positions as the encoders report them, rad.
    pub position: &'a [f32],
    /// Joint velocities, rad/s.
    pub velocity: &'a [f32],
    /// Policy actions, unitless; absent when the log's own targets are replayed.
    pub action: Option<&'a [f32]>,
    /// Base position, m, world frame.
    pub base_position: Option<&'a [f32]>,
    /// Base linear velocity, m/s, world frame.
    pub base_velocity: Option<&'a [f32]>,
    /// First sample at which the robot has fallen. Matrices keep their length; from this row on their values do
    /// not matter.
    pub fell_at: Option<usize>,
}

impl<'a> Signals<'a> {
    /// Joint signals alone.
    pub fn of_joints(position: &'a [f32], velocity: &'a [f32]) -> Self {
        Self { position, velocity, ..Self::default() }
    }

    /// The matrix of `signal`, if there is one.
    pub fn get(&self, signal: Signal) -> Option<&'a [f32]> {
        match signal {
            Signal::Position => Some(self.position),
            Signal::Velocity => Some(self.velocity),
            Signal::Action => self.action,
            Signal::BasePosition => self.base_position,
            Signal::BaseVelocity => self.base_velocity,
        }
    }
}

/// Takes the signals of one (candidate, recording); called from several threads, in any order, once each.
pub type Consume<'a> = dyn Fn(usize, usize, Signals<'_>) + Sync + 'a;

/// Asks whether to give up. It is asked often, from any thread. Once it says yes it keeps saying so.
pub type Cancel<'a> = dyn Fn() -> bool + Sync + 'a;

/// The [`Cancel`] that never gives up.
pub fn never() -> bool {
    false
}

/// The content of a [`Simulator`]'s simulations, wherever they are computed.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Identity {
    /// Joint names, in the order of all signals.
    pub joints: Vec<String>,
    /// Number of recordings. A simulation of a recording has as many samples as the recording.
    pub recordings: usize,
    /// Number of logs. Recording `r` is a simulation of log `r % logs`; recordings of the same log have different starts.
    pub logs: usize,
    /// The signals that [`Signals`] contains.
    pub signals: Vec<Signal>,
}

impl Identity {
    /// One recording a log, with the positions and velocities of `joints`.
    pub fn new(joints: Vec<String>, recordings: usize) -> Self {
        Self { joints, recordings, logs: recordings, signals: vec![Signal::Position, Signal::Velocity] }
    }

    /// The same with these signals.
    #[must_use]
    pub fn with_signals(self, signals: &[Signal]) -> Self {
        Self { signals: signals.to_vec(), ..self }
    }
}

/// A simulator that several threads may use at once.
pub type SharedSimulator = dyn Simulator + Send + Sync;

/// Simulates a fixed set of recordings with candidate robots.
pub trait Simulator {
    /// The content of the simulations. A simulator that wraps another one returns the identity of that one.
    fn identity(&self) -> &Identity;

    /// [`Identity::joints`].
    fn joints(&self) -> &[String] {
        &self.identity().joints
    }

    /// [`Identity::recordings`].
    fn recordings(&self) -> usize {
        self.identity().recordings
    }

    /// [`Identity::logs`].
    fn logs(&self) -> usize {
        self.identity().logs
    }

    /// Whether [`Signals`] holds `signal`.
    fn provides(&self, signal: Signal) -> bool {
        self.identity().signals.contains(&signal)
    }

    /// The simulator that this one wraps, if it wraps one: it computes derivatives in this one's place.
    fn inner(&self) -> Option<&dyn Simulator> {
        None
    }

    /// Number of threads for what is computed of signals.
    fn threads(&self) -> usize {
        self.inner().map_or(1, |inner| inner.threads())
    }

    /// Simulates every candidate on every recording as one batch. A diverging candidate shows as non-finite
    /// signals, a falling one by [`Signals::fell_at`], neither as an error. The signals depend on the rollout
    /// alone: not on what else is in the batch, nor on the number of threads. There is one exception: a simulator with a GPU may
    /// leave candidates whose program few of the batch share to the CPU. Once `cancel` returns true, it returns within a
    /// fraction of a second, without the simulations that are not done.
    ///
    /// # Errors
    /// Work that the simulator cannot do, for example [`Rollout::resets`], in its own words; [`SimulatorError::Cancelled`].
    fn simulate(
        &self,
        theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError>;

    /// The derivatives of the signals of `candidate` by every entry of θ, in a signal's unit over the entry's. Each goes to
    /// `consume(entry, recording, derivatives)`. It returns `false` if the simulator has no derivatives: then differences of
    /// simulations replace them. By default the derivatives are those of [`Self::inner`], or there are none.
    ///
    /// # Errors
    /// As [`Self::simulate`].
    fn differentiate(
        &self,
        theta: &Theta,
        candidate: &Rollout,
        consume: &Consume<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<bool, SimulatorError> {
        self.inner().map_or(Ok(false), |inner| inner.differentiate(theta, candidate, consume, cancel))
    }

    /// The cost of every job, in order, without the charges for falls and regularisation. By default the candidates
    /// are simulated and their signals compared here. A simulator that has the recordings, on a GPU for example,
    /// may compute the costs itself; then it does not return signals.
    ///
    /// # Errors
    /// As [`Self::simulate`]; [`FitError::Cost`] for errors that no candidate has caused; [`FitError::Incomplete`].
    fn costs(
        &self,
        theta: &Theta,
        costs: &[Box<dyn Cost>],
        jobs: &[Job],
        cancel: &Cancel<'_>,
    ) -> Result<Vec<Evaluation>, FitError> {
        accumulate(self, theta, costs, jobs, cancel)
    }

    /// The costs of rollouts in each view, without falls and regularisation, and the memory of one rollout in bytes, 0 if it
    /// does not matter. `notify` is called for each that is done, from any thread. By default as
    /// [`Self::costs`]: the signals are compared here.
    ///
    /// # Errors
    /// As [`Self::costs`].
    fn views(
        &self,
        theta: &Theta,
        views: &Views<'_>,
        rollouts: &[Rollout],
        notify: &(dyn Fn() + Sync),
        cancel: &Cancel<'_>,
    ) -> Result<(Vec<Costs>, usize), FitError> {
        measure(self, theta, views, rollouts, notify, cancel)
    }
}

/// Why a batch could not be simulated.
#[derive(Debug, thiserror::Error)]
pub enum SimulatorError {
    /// The simulator's own words.
    #[error("{0}")]
    Failed(String),
    /// It was asked to give up.
    #[error("cancelled")]
    Cancelled,
}

impl SimulatorError {
    /// The simulator's own words.
    pub fn failed(message: impl ToString) -> Self {
        Self::Failed(message.to_string())
    }
}
