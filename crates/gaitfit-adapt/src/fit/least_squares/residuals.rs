//! Differences of many candidates from the recordings, as one batch of the simulator.

use crate::cost::{Accumulator, Cost, CostError, Differences};
use crate::fit::FitError;
use crate::{Cancel, Rollout, Signals, Simulator, Theta};
use std::sync::{Mutex, PoisonError};

/// Most memory for the differences of a batch, bytes.
const MEMORY: usize = 4 << 30;

/// Differences of one candidate from the recordings.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::fit) struct Residuals {
    /// One vector a recording, `samples × width`; see [`Differences::compute`].
    pub recordings: Vec<Vec<f32>>,
    /// Their cost, without regularisation and falls.
    pub cost: f64,
    /// Recordings in which the simulated robot fell.
    pub falls: usize,
}

/// The simulator, parameters and cost of least squares.
#[derive(Clone, Copy)]
pub struct Problem<'a> {
    /// Simulates the recordings.
    pub simulator: &'a dyn Simulator,
    /// The fitted parameters.
    pub theta: &'a Theta,
    /// Its differences are made small.
    pub cost: &'a dyn Cost,
    /// Random draws of every simulation.
    pub draw: u64,
    /// Asks whether to give up.
    pub cancel: &'a Cancel<'a>,
}

/// The derivative of every difference by an entry of θ, one vector a recording.
pub(super) type Column = Vec<Vec<f32>>;

struct Pending<'a> {
    accumulator: Box<dyn Accumulator + 'a>,
    recordings: Vec<Option<Vec<f32>>>,
    falls: usize,
    error: Option<CostError>,
}

impl Problem<'_> {
    pub(super) fn differences(&self) -> Result<Differences<'_>, FitError> {
        self.cost.differences().ok_or_else(|| FitError::Distributions(self.cost.name().to_owned()))
    }

    /// The differences of every candidate; `None` if it diverged.
    ///
    /// # Errors
    /// As [`Simulator::simulate`]; [`FitError::Distributions`], [`FitError::TooMany`].
    pub(in crate::fit) fn residuals(
        &self,
        candidates: &[Vec<f64>],
    ) -> Result<Vec<Option<Residuals>>, FitError> {
        Ok(residuals(&[(*self, candidates)])?.pop().unwrap_or_default())
    }

    fn rollout(&self, values: &[f64]) -> Rollout {
        Rollout { values: values.to_vec(), resets: self.cost.resets(), draw: self.draw }
    }

    /// The derivatives of the residuals of `values`, one column for each entry of θ; `None` if the simulator has no
    /// derivatives or some are not finite.
    ///
    /// # Errors
    /// As [`Self::residuals`].
    pub(super) fn derivatives(&self, values: &[f64]) -> Result<Option<Vec<Column>>, FitError> {
        let differences = self.differences()?;
        let (count, entries) = (self.simulator.recordings(), self.theta.len());
        // Slopes arrive in any order from several threads, so each has its slot.
        let columns: Mutex<Vec<Vec<Option<Vec<f32>>>>> = Mutex::new(vec![vec![None; count]; entries]);
        let failed = Mutex::new(None);
        let consume = |entry: usize, recording: usize, slopes: Signals<'_>| match differences
            .slopes(recording, slopes)
        {
            Ok(slopes) => {
                let mut columns = columns.lock().unwrap_or_else(PoisonError::into_inner);
                if let Some(slot) = columns.get_mut(entry).and_then(|of_entry| of_entry.get_mut(recording)) {
                    *slot = Some(slopes);
                }
            }
            Err(error) => *failed.lock().unwrap_or_else(PoisonError::into_inner) = Some(error),
        };
        if !self.simulator.differentiate(self.theta, &self.rollout(values), &consume, self.cancel)? {
            return Ok(None);
        }
        match failed.into_inner().unwrap_or_else(PoisonError::into_inner) {
            // Not finite: the caller takes differences of simulations instead.
            Some(error) if error.is_candidate_failure() => return Ok(None),
            Some(error) => return Err(FitError::Cost(error)),
            None => {}
        }
        let columns = columns.into_inner().unwrap_or_else(PoisonError::into_inner);
        // A missing slot means that the simulator left a simulation out.
        let whole = |column: Vec<Option<Vec<f32>>>| column.into_iter().collect::<Option<Column>>();
        let columns = columns.into_iter().map(whole).collect::<Option<Vec<_>>>();
        columns.map(Some).ok_or(FitError::Incomplete)
    }

    /// How many steps of `candidates` candidates each there is memory for at once, at least one.
    pub(in crate::fit) fn at_once(cost: &dyn Cost, candidates: usize) -> usize {
        let numbers = cost.differences().map_or(1, |differences| differences.count());
        let needed = numbers.saturating_mul(candidates).saturating_mul(size_of::<f32>());
        // One search is always taken; `check` refuses it if it is too large by itself.
        (MEMORY / needed.max(1)).max(1)
    }

    /// Refuses more candidates than memory has room for.
    pub(super) fn check(&self, numbers: usize, candidates: usize) -> Result<(), FitError> {
        let needed = numbers.saturating_mul(candidates).saturating_mul(size_of::<f32>());
        if needed > MEMORY { Err(FitError::TooMany { needed, max: MEMORY }) } else { Ok(()) }
    }
}

/// The differences of the candidates of several problems with the same simulator and θ, all simulated together: a list
/// for each problem, `None` for a candidate that diverged.
///
/// # Errors
/// As [`Problem::residuals`].
pub(super) fn residuals(
    asked: &[(Problem<'_>, &[Vec<f64>])],
) -> Result<Vec<Vec<Option<Residuals>>>, FitError> {
    // All problems have the same simulator and θ, so the first one's serve for all.
    let Some((Problem { simulator, theta, cancel, .. }, _)) = asked.first() else { return Ok(Vec::new()) };
    let (mut rollouts, mut pending) = (Vec::new(), Vec::new());
    for (problem, candidates) in asked {
        let differences = problem.differences()?;
        for values in *candidates {
            rollouts.push(problem.rollout(values));
            pending.push((differences, Mutex::new(Pending::new(problem.cost, simulator.recordings()))));
        }
    }
    let consume = |candidate: usize, recording: usize, signals: Signals<'_>| {
        if let Some((differences, pending)) = pending.get(candidate) {
            // Computed before the lock is taken, so that threads do not wait for one another.
            let residuals = differences.compute(recording, signals);
            let mut pending = pending.lock().unwrap_or_else(PoisonError::into_inner);
            pending.add(recording, signals, residuals);
        }
    };
    simulator.simulate(theta, &rollouts, &consume, cancel)?;
    let mut finished = pending
        .into_iter()
        .map(|(_, pending)| pending.into_inner().unwrap_or_else(PoisonError::into_inner).finish());
    // Results have the order of the rollouts, so each problem takes as many as it asked for.
    asked.iter().map(|(_, candidates)| finished.by_ref().take(candidates.len()).collect()).collect()
}

impl<'a> Pending<'a> {
    fn new(cost: &'a dyn Cost, recordings: usize) -> Self {
        Self { accumulator: cost.begin(), recordings: vec![None; recordings], falls: 0, error: None }
    }

    fn add(&mut self, recording: usize, signals: Signals<'_>, residuals: Result<Vec<f32>, CostError>) {
        // Falls count even if the signals cannot be compared.
        self.falls += usize::from(signals.fell_at.is_some());
        match residuals.and_then(|numbers| self.accumulator.add(recording, signals).map(|()| numbers)) {
            Ok(numbers) => {
                if let Some(slot) = self.recordings.get_mut(recording) {
                    *slot = Some(numbers);
                }
            }
            // The first error stays: later ones tend to follow from it.
            Err(error) => self.error = self.error.take().or(Some(error)),
        }
    }

    fn finish(mut self) -> Result<Option<Residuals>, FitError> {
        match self.error {
            Some(error) if error.is_candidate_failure() => return Ok(None),
            Some(error) => return Err(FitError::Cost(error)),
            None => {}
        }
        let recordings =
            self.recordings.into_iter().collect::<Option<Vec<_>>>().ok_or(FitError::Incomplete)?;
        let cost = self.accumulator.finish().map_err(FitError::Cost)?.total;
        Ok(cost.is_finite().then_some(Residuals { recordings, cost, falls: self.falls }))
    }
}
