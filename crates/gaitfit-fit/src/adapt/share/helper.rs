//! The other side of a shared fit: a process that does tasks.

use super::task::{Answered, Task, Values, Work, bytes, read};
use super::{parcel, signals};
use crate::Error;
use crate::adapt::opening::Opening;
use crate::adapt::setup::Setup;
use crate::device::Devices;
use gaitfit_adapt::fit::{Failure, FitError, Job, Predicted, Problem, Views};
use gaitfit_adapt::{Cancel, Rollout, Signals, Simulator, SimulatorError, Theta, never};
use gaitfit_policy::Policy;
use std::sync::{Mutex, PoisonError};

/// A process that simulates for a fit elsewhere.
pub struct Helper {
    setup: Setup,
    /// θ with springs on some joints besides, which were asked for last.
    with_springs: Mutex<Option<(Vec<String>, Theta)>>,
}

/// The bits of every cost at the start of the search, as text. Machines whose marks differ compute other bits.
pub(super) fn mark(setup: &Setup) -> Result<String, Error> {
    // Seed 0 and draw 0 on every machine: two marks differ only if their arithmetic does.
    let job = |cost: usize| Job { cost, values: setup.theta.start(0), draw: 0 };
    let jobs: Vec<Job> = (0..setup.costs.len()).map(job).collect();
    let evaluations =
        setup.searched().simulator.costs(&setup.theta, &setup.costs, &jobs, &never).map_err(Error::failed)?;
    let shown = setup.costs.iter().zip(evaluations).map(|(cost, evaluation)| {
        let bits =
            evaluation.cost.map_or_else(|| "diverges".to_owned(), |cost| format!("{:016x}", cost.to_bits()));
        format!("{} {bits}, {} falls", cost.name(), evaluation.falls)
    });
    Ok(shown.collect::<Vec<_>>().join("; "))
}

impl Helper {
    /// Opens what [`Setup::parcel`] made; `policy`: as in [`Opening::policy`].
    ///
    /// # Errors
    /// Bytes that are not a parcel, and the errors of [`Opening::open`].
    pub fn open(
        parcel: &[u8],
        threads: usize,
        devices: &Devices,
        policy: Option<&Policy>,
    ) -> Result<Self, Error> {
        let folder = tempfile::tempdir().map_err(|error| {
            Error::failed(format!("a folder for the fit's files cannot be made: {error}"))
        })?;
        let config = parcel::unpack(parcel, folder.path())?;
        let path = folder.path().join("config.toml");
        let setup = Opening::new(&config, &path).threads(threads).devices(devices).policy(policy).open()?;
        Ok(Self { setup, with_springs: Mutex::new(None) })
    }

    /// The mark of the setup, see [`Setup::mark`].
    ///
    /// # Errors
    /// The errors of [`Setup::mark`].
    pub fn mark(&self) -> Result<String, Error> {
        self.setup.mark()
    }

    /// Does a task; the answer.
    ///
    /// # Errors
    /// A task of another fit or version, a simulation that fails, [`FitError::Cancelled`].
    pub fn work(&self, task: &[u8], cancel: &Cancel<'_>) -> Result<Vec<u8>, FitError> {
        let Task { simulator, values, work } = read(task)?;
        // One lock for the whole task: θ is borrowed from it.
        let mut with_springs = self.with_springs.lock().unwrap_or_else(PoisonError::into_inner);
        let nothing = Theta::default();
        let theta = match values {
            Values::None => &nothing,
            Values::Fitted { springs } if springs.is_empty() => &self.setup.theta,
            Values::Fitted { springs } => match &mut *with_springs {
                // Most tasks ask for the same springs as the one before, so their θ is kept.
                Some((known, theta)) if *known == springs => theta,
                other => {
                    let theta = self.setup.with_springs(&springs).map_err(SimulatorError::failed)?;
                    &other.insert((springs, theta)).1
                }
            },
        };
        let simulator = self.simulator(simulator)?;
        let unknown =
            || FitError::from(SimulatorError::failed("a cost that this fit does not have was asked for"));
        let costs = &self.setup.costs;
        Ok(match work {
            Work::Costs(jobs) if jobs.iter().all(|job| job.cost < costs.len()) => {
                bytes(&simulator.costs(theta, costs, &jobs, cancel)?)?
            }
            Work::Costs(_) => return Err(unknown()),
            Work::Views { cost, whole, rollouts } => {
                let cost = costs.get(cost).ok_or_else(unknown)?.as_ref();
                let views = match whole {
                    true => Views::whole(cost, simulator.recordings()),
                    false => Views::new(cost, simulator.recordings(), simulator.logs()),
                };
                bytes(&simulator.views(theta, &views, &rollouts, &|| (), cancel)?.0)?
            }
            Work::Signals(rollouts) => signals::write(&predicted(simulator, theta, &rollouts, cancel)?),
            Work::Ask { cost: number, draw, question, number: set } => {
                let cost = costs.get(number).ok_or_else(unknown)?.as_ref();
                let problem = Problem { simulator, theta, cost, draw, cancel };
                let Some(replicas) = &self.setup.replicas else { return Err(unknown()) };
                bytes(&match replicas.answer(&self.setup, number, problem, &question, set) {
                    Ok(comparison) => Answered::Compared(comparison),
                    // A reason is an answer; only an interruption or a broken task is an error.
                    Err(Failure::Fit(FitError::Cancelled)) => return Err(FitError::Cancelled),
                    // As the fit says it of its own.
                    Err(Failure::Fit(error)) => {
                        Answered::Said(format!("A comparison with simulated logs failed: {error}."))
                    }
                    Err(Failure::Said(reason)) => Answered::Said(reason),
                })?
            }
        })
    }

    fn simulator(&self, number: usize) -> Result<&dyn Simulator, FitError> {
        // The numbers are those that `Setup::shared` gave: 0 is the search's simulator, then the alternatives
        // in order.
        if number == 0 {
            return Ok(self.setup.searched().simulator.as_ref());
        }
        let other = self.setup.alternatives.get(number - 1).map(|other| other.alternative().simulator);
        other.ok_or_else(|| {
            SimulatorError::failed("a simulator that this fit does not have was asked for").into()
        })
    }
}

/// The signals of rollouts, one list of recordings each.
fn predicted(
    simulator: &dyn Simulator,
    theta: &Theta,
    rollouts: &[Rollout],
    cancel: &Cancel<'_>,
) -> Result<Vec<Vec<Predicted>>, FitError> {
    let predictions: Vec<Vec<Mutex<Option<Predicted>>>> =
        rollouts.iter().map(|_| (0..simulator.recordings()).map(|_| Mutex::new(None)).collect()).collect();
    let keep = |rollout: usize, recording: usize, signals: Signals<'_>| {
        if let Some(slot) = predictions.get(rollout).and_then(|one| one.get(recording)) {
            *slot.lock().unwrap_or_else(PoisonError::into_inner) = Some(Predicted::from_signals(&signals));
        }
    };
    simulator.simulate(theta, rollouts, &keep, cancel)?;
    let take = |slot: Mutex<Option<Predicted>>| slot.into_inner().unwrap_or_else(PoisonError::into_inner);
    let whole = |one: Vec<Mutex<Option<Predicted>>>| one.into_iter().map(take).collect::<Option<Vec<_>>>();
    predictions.into_iter().map(whole).collect::<Option<Vec<_>>>().ok_or(FitError::Incomplete)
}
