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
        let differences = self.differences()?;
        let count = self.simulator.recordings();
        let begin = |_: &Vec<f64>| {
            Mutex::new(Pending {
                accumulator: self.cost.begin(),
                recordings: vec![None; count],
                falls: 0,
                error: None,
            })
        };
        let pending: Vec<Mutex<Pending<'_>>> = candidates.iter().map(begin).collect();
        let consume = |candidate: usize, recording: usize, signals: Signals<'_>| {
            let Some(pending) = pending.get(candidate) else { return };
            let residuals = differences.compute(recording, signals);
            let mut pending = pending.lock().unwrap_or_else(|poisoned| poisoned.into_inner());
            pending.falls += usize::from(signals.fell_at.is_some());
            let added = residuals
                .and_then(|residuals| pending.accumulator.add(recording, signals).map(|()| residuals));
            match added {
                Ok(residuals) => {
                    if let Some(slot) = pending.recordings.get_mut(recording) {
                        *slot = Some(residuals);
                    }
                }
                Err(error) => pending.error = pending.error.take().or(Some(error)),
            }
        };
        let rollouts: Vec<Rollout> = candidates.iter().map(|values| self.rollout(values)).collect();
        self.simulator.simulate(self.theta, &rollouts, &consume, self.cancel)?;
        let finish = |pending: Mutex<Pending<'_>>| {
            let mut pending = pending.into_inner().unwrap_or_else(|poisoned| poisoned.into_inner());
            match pending.error {
                Some(error) if error.is_candidate_failure() => return Ok(None),
                Some(error) => return Err(FitError::Cost(error)),
                None => {}
            }
            let recordings =
                pending.recordings.into_iter().collect::<Option<Vec<_>>>().ok_or(FitError::Incomplete)?;
            let cost = pending.accumulator.finish().map_err(FitError::Cost)?.total;
            Ok(cost.is_finite().then_some(Residuals { recordings, cost, falls: pending.falls }))
        };
        pending.into_iter().map(finish).collect()
    }

    fn rollout(&self, values: &[f64]) -> Rollout {
        Rollout { values: values.to_vec(), resets: self.cost.resets(), draw: self.draw }
    }

    /// The derivatives of what `values` differ by, one column an entry of θ, where the simulator has them and all are
    /// finite.
    ///
    /// # Errors
    /// As [`Self::residuals`].
    pub(super) fn derivatives(&self, values: &[f64]) -> Result<Option<Vec<Column>>, FitError> {
        let differences = self.differences()?;
        let (count, entries) = (self.simulator.recordings(), self.theta.len());
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
            Some(error) if error.is_candidate_failure() => return Ok(None),
            Some(error) => return Err(FitError::Cost(error)),
            None => {}
        }
        let columns = columns.into_inner().unwrap_or_else(PoisonError::into_inner);
        let whole = |column: Vec<Option<Vec<f32>>>| column.into_iter().collect::<Option<Column>>();
        let columns = columns.into_iter().map(whole).collect::<Option<Vec<_>>>();
        columns.map(Some).ok_or(FitError::Incomplete)
    }

    /// Number of threads that may each take derivatives by `candidates` candidates, as far as memory allows.
    pub(in crate::fit) fn parallel(cost: &dyn Cost, candidates: usize, threads: usize) -> usize {
        let numbers = cost.differences().map_or(1, |differences| differences.count());
        let needed = numbers.saturating_mul(candidates).saturating_mul(size_of::<f32>());
        (MEMORY / needed.max(1)).clamp(1, threads.max(1))
    }

    /// Refuses more candidates than memory has room for.
    pub(super) fn check(&self, numbers: usize, candidates: usize) -> Result<(), FitError> {
        let needed = numbers.saturating_mul(candidates).saturating_mul(size_of::<f32>());
        if needed > MEMORY { Err(FitError::TooMany { needed, max: MEMORY }) } else { Ok(()) }
    }
}
