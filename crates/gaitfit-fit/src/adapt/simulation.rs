//! Where the result of a fit walks when it is judged: in the fit's own simulation, or as robots make logs.

use super::log_set::LogSet;
use super::replicas::Replicas;
use super::score::{Robot, cost_of};
use super::setup::Setup;
use crate::Error;
use crate::walk::recorder::Recorder;
use gaitfit_adapt::cost::{Cost, CostKind};
use gaitfit_adapt::fit::{Evaluation, Predicted, Regression};
use gaitfit_adapt::{Cancel, Resets};
use std::sync::{Mutex, PoisonError};

/// Robots that are simulated as they make logs. They differ by their random draws. The one of median cost counts.
const ROBOTS: usize = 15;
/// Number of the first of them. The robots of a regression have smaller numbers, so no draw is used twice.
const FIRST: u64 = 1 << 30;

/// What walks under the commands of logs.
#[derive(Clone, Copy)]
pub(super) enum Simulation<'a> {
    /// The simulation in which the fit searched.
    OfFit,
    /// The robot as it makes logs, with unknown starts and draws that `seed` selects.
    AsLogged { recorder: &'a Recorder, seed: u64 },
}

impl<'a> Simulation<'a> {
    /// The simulation that judges a fit of `setup` with this regression.
    pub fn new(setup: &'a Setup, regression: Option<&Regression>) -> Self {
        let as_logged = regression.is_some_and(Regression::judged_as_logged);
        Self::with(setup.replicas.as_ref().filter(|_| as_logged), setup.config.optimizer.seed)
    }

    /// That of `replicas`, if they are there.
    pub fn with(replicas: Option<&'a Replicas>, seed: u64) -> Self {
        replicas.map_or(Self::OfFit, |one| Self::AsLogged { recorder: one.recorder(), seed })
    }

    /// `wass` of `robot` on the fitted logs, and its falls, if robots are simulated as they make logs; else `None`.
    ///
    /// # Errors
    /// As [`Self::predict`].
    pub fn evaluate_as_logged(
        self,
        setup: &Setup,
        robot: Robot<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<Option<Evaluation>, Error> {
        if matches!(self, Self::OfFit) {
            return Ok(None);
        }
        let cost = wass(&setup.fit)?;
        let walks = self.predict(&setup.fit, robot, Resets::Never, cancel)?;
        let falls = walks.iter().filter(|log| log.fell_at.is_some()).count();
        Ok(Some(Evaluation { cost: cost_of(cost.as_ref(), &walks), falls }))
    }

    /// The signals of `robot` under the commands of `set`. `resets`: what the fit's own simulation is given. Of robots that are
    /// simulated as they make logs, those of the robot whose `wass` is the median; one that diverges comes last.
    ///
    /// # Errors
    /// A simulation that fails; of the kind `Interrupted` soon after `cancel` asks to stop.
    pub fn predict(
        self,
        set: &LogSet,
        robot: Robot<'_>,
        resets: Resets,
        cancel: &Cancel<'_>,
    ) -> Result<Vec<Predicted>, Error> {
        let Self::AsLogged { recorder, seed } = self else {
            return robot.simulate_until(set.simulator.as_ref(), resets, cancel);
        };
        let cost = wass(set)?;
        let walks: Mutex<Vec<Option<Vec<Predicted>>>> = Mutex::new(vec![None; ROBOTS]);
        let keep = |at: usize, logs: Vec<Predicted>| {
            if let Some(slot) = walks.lock().unwrap_or_else(PoisonError::into_inner).get_mut(at) {
                *slot = Some(logs);
            }
        };
        let trajectories: Vec<_> = set.logs.iter().map(|log| &log.trajectory).collect();
        let robots = vec![robot.values.to_vec(); ROBOTS];
        recorder
            .under(&trajectories)
            .walk(robot.theta, &robots, [seed, FIRST], &keep, cancel)
            .map_err(Error::failed)?;
        if cancel() {
            let message = "stopped before the end".to_owned();
            return Err(gaitfit_run::Error::Interrupted { message, kept: None }.into());
        }
        let walks = walks.into_inner().unwrap_or_else(PoisonError::into_inner);
        let costly = |logs: Vec<Predicted>| (cost_of(cost.as_ref(), &logs).unwrap_or(f64::INFINITY), logs);
        let mut walks: Vec<(f64, Vec<Predicted>)> = walks.into_iter().flatten().map(costly).collect();
        walks.sort_by(|a, b| a.0.total_cmp(&b.0));
        let median = walks.len() / 2;
        walks
            .into_iter()
            .nth(median)
            .map(|(_, logs)| logs)
            .ok_or_else(|| Error::failed("no robot could be simulated as it makes logs"))
    }
}

fn wass(set: &LogSet) -> Result<Box<dyn Cost>, Error> {
    CostKind::Wass.build(&set.reference, set.simulator.as_ref()).map_err(Error::failed)
}
