//! A fit whose simulations are shared among processes.
//!
//! The fit is the same one, on one process: it draws candidates, keeps the checkpoint and writes the run folder. Only what is
//! simulated goes elsewhere. Every helper opens the same [`parcel`](Setup::parcel) and then does tasks, which are bytes: what
//! candidates cost, what they cost without some of the logs, their signals, what simulated logs say. A candidate's result
//! depends on nothing but the candidate, so neither the number of helpers nor how tasks are cut changes a bit.

mod helper;
mod parcel;
mod shared;
mod signals;
mod task;

pub use helper::Helper;

use super::log_set::LogSet;
use super::setup::Setup;
use crate::Error;
use gaitfit_adapt::fit::{Comparison, Failure, FitError, Problem, Question};
use gaitfit_adapt::{Cancel, SimulatorError};
use shared::Shared;
use std::sync::Arc;
use task::{Answered, Task, Values, Work};

/// Takes the answer to the task of that number.
pub type Done<'a> = dyn FnMut(usize, &[u8]) -> Result<(), SimulatorError> + 'a;

/// Has tasks done elsewhere.
pub trait Crew: Send + Sync {
    /// Number of tasks that it does at the same time, at least 1.
    fn places(&self) -> usize;

    /// Whether this process computes the same bits: then what is too small to be shared is computed here.
    fn alike(&self) -> bool;

    /// Has every task done once, and passes each answer on with the task's number, in any order.
    ///
    /// # Errors
    /// Whatever keeps a task from being done, and errors of `done`; [`SimulatorError::Cancelled`] soon after `cancel` says
    /// so.
    fn work(&self, tasks: &[Vec<u8>], done: &mut Done<'_>, cancel: &Cancel<'_>)
    -> Result<(), SimulatorError>;
}

/// A fit's crew, and the names by which its tasks go.
#[derive(Clone)]
pub struct Shares {
    crew: Arc<dyn Crew>,
    /// Names of the setup's costs.
    costs: Arc<[String]>,
    /// Names of the entries of what is fitted, springs on odd joints left out.
    entries: Arc<[String]>,
}

impl Setup {
    /// Has `crew` simulate.
    #[must_use]
    pub fn shared(mut self, crew: Arc<dyn Crew>) -> Self {
        let costs = self.costs.iter().map(|cost| cost.name().to_owned()).collect();
        let entries = self.theta.entries().iter().map(|entry| entry.name.clone()).collect();
        let shares = Shares { crew, costs, entries };
        // Number 0 is the search's own simulator; alternatives follow.
        let share = |local, number| Box::new(Shared { local, number, shares: shares.clone() });
        // Only one of the two sets is searched.
        match self.several.take() {
            Some(set) => self.several = Some(LogSet { simulator: share(set.simulator, 0), ..set }),
            None => self.fit.simulator = share(self.fit.simulator, 0),
        }
        let others = self.alternatives.into_iter().enumerate();
        self.alternatives = others.map(|(at, other)| other.with(|local| share(local, at + 1))).collect();
        self.shares = Some(shares);
        self
    }

    /// Fingerprint of this machine's arithmetic: the costs of the robot where the search begins, bit by bit. Helpers
    /// compute it too.
    ///
    /// # Errors
    /// A simulation that fails.
    pub fn mark(&self) -> Result<String, Error> {
        helper::mark(self)
    }
}

impl Shares {
    /// Has the crew ask the sets of simulated logs of `numbers`, each by itself; see [`gaitfit_adapt::fit::World::ask`].
    /// `notify` is called for each that is done.
    pub(super) fn ask(
        &self,
        cost: usize,
        problem: Problem<'_>,
        question: &Question,
        numbers: &[u32],
        notify: &dyn Fn(),
    ) -> Result<Vec<Comparison>, Failure> {
        let values = Values::new(problem.theta, &self.entries);
        let task = |&number: &u32| {
            let work = Work::Ask { cost, draw: problem.draw, question: question.clone(), number };
            Task { simulator: 0, values: values.clone(), work }.bytes()
        };
        let tasks: Vec<Vec<u8>> =
            numbers.iter().map(task).collect::<Result<_, _>>().map_err(FitError::from)?;
        // Answers arrive in any order.
        let mut answers: Vec<Option<Answered>> = vec![None; tasks.len()];
        let mut done = |number: usize, answer: &[u8]| {
            answers[number] = Some(task::read(answer)?);
            notify();
            Ok(())
        };
        self.crew.work(&tasks, &mut done, problem.cancel).map_err(FitError::from)?;
        let answer = |answer: Option<Answered>| match answer {
            Some(Answered::Compared(comparison)) => Ok(comparison),
            Some(Answered::Said(reason)) => Err(Failure::Said(reason)),
            None => Err(Failure::Fit(FitError::Incomplete)),
        };
        answers.into_iter().map(answer).collect()
    }
}
