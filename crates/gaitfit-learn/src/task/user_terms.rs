//! Reward and ends of episodes by a function of the caller, which sees a whole tile after each control step of a training.

use super::{Ended, Environment};
use std::sync::Arc;

/// Changes what a control step of a tile pays, and whose episode it ends: `(environment, reward, ended)`. Robots of another tile
/// may be stepped meanwhile. False if the function failed.
type AfterStep = dyn Fn(&Environment<'_>, &mut [f32], &mut [Ended]) -> bool + Send + Sync;

/// A function of the caller in a task's place. It counts in trainings on the CPU alone: no file can hold it.
#[derive(Clone)]
pub struct UserTerms(Arc<AfterStep>);

impl UserTerms {
    /// Terms by this function. A robot whose simulation diverged keeps its end and is paid nothing, whatever the function does.
    pub fn new(
        after_step: impl Fn(&Environment<'_>, &mut [f32], &mut [Ended]) -> bool + Send + Sync + 'static,
    ) -> Self {
        Self(Arc::new(after_step))
    }

    /// Calls the function; false if it failed.
    pub(crate) fn apply(
        &self,
        environment: &Environment<'_>,
        reward: &mut [f32],
        ended: &mut [Ended],
    ) -> bool {
        // Noted before the call, because the function may change the ends.
        let diverged: Vec<usize> =
            ended.iter().enumerate().filter(|(_, end)| **end == Ended::Diverged).map(|(at, _)| at).collect();
        let done = (self.0)(environment, reward, ended);
        for at in diverged {
            (reward[at], ended[at]) = (0.0, Ended::Diverged);
        }
        done
    }
}
