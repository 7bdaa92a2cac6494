//! How many regressions an estimate has done, for progress and for stopping.

use crate::SwingError;
use std::ops::ControlFlow;

/// A function that gets how many regressions are done and how many there are. It answers whether to continue.
pub type Progress<'a> = dyn FnMut(usize, usize) -> ControlFlow<()> + 'a;

/// Counts the regressions of an estimate.
pub(crate) struct Count<'a, 'b> {
    done: usize,
    total: usize,
    progress: &'a mut Progress<'b>,
    stopped: bool,
}

impl<'a, 'b> Count<'a, 'b> {
    /// A count at 0 of at most `total` regressions.
    pub(crate) fn new(total: usize, progress: &'a mut Progress<'b>) -> Self {
        Self { done: 0, total, progress, stopped: false }
    }

    /// Does this many regressions, as many at a time as there are threads. Each gets its number.
    /// After the caller stopped, it does no more.
    pub(crate) fn map<T: Send>(
        &mut self,
        regressions: usize,
        threads: usize,
        regression: impl Fn(usize) -> Option<T> + Sync,
    ) -> Vec<Option<T>> {
        let mut results = Vec::with_capacity(regressions);
        while results.len() < regressions {
            let first = results.len();
            let count = threads.clamp(1, regressions - first);
            self.stopped = self.stopped || (self.progress)(self.done, self.total).is_break();
            // A regression that is left out still has a place in the list, so that places remain numbers of
            // regressions.
            let one = |number: usize| {
                if self.stopped { None } else { regression(first + number) }
            };
            results.extend(gaitfit_pool::map(count, threads, one));
            self.done = (self.done + count).min(self.total);
        }
        results
    }

    /// An error if the caller stopped the work: the results are then incomplete.
    pub(crate) fn check(&self) -> Result<(), SwingError> {
        if self.stopped { Err(SwingError::Stopped) } else { Ok(()) }
    }

    /// Reports that all regressions are done.
    pub(crate) fn finish(self) -> Result<(), SwingError> {
        self.check()?;
        match (self.progress)(self.total, self.total) {
            ControlFlow::Continue(()) => Ok(()),
            ControlFlow::Break(()) => Err(SwingError::Stopped),
        }
    }
}
