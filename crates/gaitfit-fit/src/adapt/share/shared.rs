//! A fit's simulator, which others compute.

use super::Shares;
use super::signals;
use super::task::{Task, Values, Work, read};
use gaitfit_adapt::cost::Cost;
use gaitfit_adapt::fit::{Costs, Evaluation, FitError, Job, Views};
use gaitfit_adapt::{Cancel, Consume, Identity, Rollout, SharedSimulator, Simulator, SimulatorError, Theta};
use std::ops::Range;

/// Robots that are simulated together: fewer in a task would leave lanes empty.
const TOGETHER: usize = 16;
/// Tasks for each place of a crew: places that are slower, or lost, leave theirs to others.
const EACH: usize = 3;

/// The simulator `local`, on other machines.
pub(super) struct Shared {
    pub local: Box<SharedSimulator>,
    /// The number by which tasks name it.
    pub number: usize,
    pub shares: Shares,
}

impl Shared {
    /// Ranges of candidates, one a task, into which `count` candidates are cut.
    fn pieces(&self, count: usize) -> Vec<Range<usize>> {
        pieces(count, self.local.recordings(), self.shares.crew.places())
    }

    /// Whether work of this many pieces is done on this machine instead of the crew's.
    fn stays(&self, pieces: usize) -> bool {
        // With other bits even one piece goes to the crew, so that all costs of a fit are comparable.
        pieces < 2 && self.shares.crew.alike()
    }

    /// The number of a cost of the setup; `None` of others, which only this process knows.
    fn cost(&self, cost: &dyn Cost) -> Option<usize> {
        self.shares.costs.iter().position(|name| name == cost.name())
    }

    /// Has `work` of every piece of candidates done; `take` gets the piece and the answer for it.
    fn done(
        &self,
        theta: &Theta,
        pieces: &[Range<usize>],
        work: impl Fn(Range<usize>) -> Work,
        mut take: impl FnMut(Range<usize>, &[u8]) -> Result<(), SimulatorError>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        let values = Values::new(theta, &self.shares.entries);
        let task = |piece: &Range<usize>| {
            Task { simulator: self.number, values: values.clone(), work: work(piece.clone()) }.bytes()
        };
        let tasks: Vec<Vec<u8>> = pieces.iter().map(task).collect::<Result<_, _>>()?;
        let mut done = |number: usize, answer: &[u8]| take(pieces[number].clone(), answer);
        self.shares.crew.work(&tasks, &mut done, cancel)?;
        if cancel() { Err(SimulatorError::Cancelled) } else { Ok(()) }
    }
}

/// `count` candidates in pieces of about one size.
fn pieces(count: usize, recordings: usize, places: usize) -> Vec<Range<usize>> {
    // Each recording of a candidate is a robot, so many recordings fill the lanes with few candidates.
    let min = TOGETHER.div_ceil(recordings.max(1));
    let pieces = places.saturating_mul(EACH).clamp(1, count.div_ceil(min).max(1));
    (0..pieces).map(|piece| piece * count / pieces..(piece + 1) * count / pieces).collect()
}

/// Puts the answers for a piece where they belong.
fn put<T>(into: &mut [Option<T>], piece: Range<usize>, answers: Vec<T>) -> Result<(), SimulatorError> {
    if answers.len() != piece.len() {
        let (count, needed) = (answers.len(), piece.len());
        return Err(SimulatorError::failed(format!("{count} answers came for {needed} candidates")));
    }
    into[piece].iter_mut().zip(answers).for_each(|(slot, answer)| *slot = Some(answer));
    Ok(())
}

fn all<T>(answers: Vec<Option<T>>) -> Result<Vec<T>, FitError> {
    answers.into_iter().collect::<Option<_>>().ok_or(FitError::Incomplete)
}

impl Simulator for Shared {
    fn identity(&self) -> &Identity {
        self.local.identity()
    }

    fn simulate(
        &self,
        theta: &Theta,
        candidates: &[Rollout],
        consume: &Consume<'_>,
        cancel: &Cancel<'_>,
    ) -> Result<(), SimulatorError> {
        let pieces = self.pieces(candidates.len());
        if self.stays(pieces.len()) {
            return self.local.simulate(theta, candidates, consume, cancel);
        }
        let take = |piece: Range<usize>, answer: &[u8]| {
            signals::read(answer, piece.len(), self.recordings(), |rollout, recording, predicted| {
                consume(piece.start + rollout, recording, predicted.signals());
            })
        };
        self.done(theta, &pieces, |piece| Work::Signals(candidates[piece].to_vec()), take, cancel)
    }

    /// It computes derivatives all at once, so that sharing has nothing to gain.
    fn inner(&self) -> Option<&dyn Simulator> {
        Some(self.local.as_ref())
    }

    fn costs(
        &self,
        theta: &Theta,
        costs: &[Box<dyn Cost>],
        jobs: &[Job],
        cancel: &Cancel<'_>,
    ) -> Result<Vec<Evaluation>, FitError> {
        let numbers: Option<Vec<usize>> = costs.iter().map(|cost| self.cost(cost.as_ref())).collect();
        let pieces = self.pieces(jobs.len());
        let Some(numbers) = numbers.filter(|_| !self.stays(pieces.len())) else {
            return self.local.costs(theta, costs, jobs, cancel);
        };
        // A caller may pass some of the costs alone. Helpers count them in the order of the setup.
        let named = |job: &Job| Job { cost: numbers[job.cost], ..job.clone() };
        let mut evaluations: Vec<Option<Evaluation>> = vec![None; jobs.len()];
        let take = |piece, answer: &[u8]| put(&mut evaluations, piece, read(answer)?);
        let work = |piece: Range<usize>| Work::Costs(jobs[piece].iter().map(named).collect());
        self.done(theta, &pieces, work, take, cancel)?;
        all(evaluations)
    }

    fn views(
        &self,
        theta: &Theta,
        views: &Views<'_>,
        rollouts: &[Rollout],
        notify: &(dyn Fn() + Sync),
        cancel: &Cancel<'_>,
    ) -> Result<(Vec<Costs>, usize), FitError> {
        let pieces = self.pieces(rollouts.len());
        // Costs that the helpers do not have, and work too small to share, stay here.
        let Some(cost) = self.cost(views.cost()).filter(|_| !self.stays(pieces.len())) else {
            return self.local.views(theta, views, rollouts, notify, cancel);
        };
        let whole = views.count() == 1;
        let mut costs: Vec<Option<Costs>> = vec![None; rollouts.len()];
        let take = |piece: Range<usize>, answer: &[u8]| {
            // Before the answer is read: each rollout of the piece is done either way.
            piece.clone().for_each(|_| notify());
            put(&mut costs, piece, read(answer)?)
        };
        let work = |piece: Range<usize>| Work::Views { cost, whole, rollouts: rollouts[piece].to_vec() };
        self.done(theta, &pieces, work, take, cancel)?;
        // Signals stay where they were simulated.
        Ok((all(costs)?, 0))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn pieces_cover_all_candidates_and_fill_lanes() {
        for (count, recordings, places, expected) in [
            (48, 64, 2, 6),
            (48, 1, 2, 3),
            (5, 64, 100, 5),
            (1, 64, 100, 1),
            (15, 1, 8, 1),
            (1000, 8, 3, 9),
            (0, 4, 2, 1),
        ] {
            let pieces = pieces(count, recordings, places);
            assert_eq!(pieces.len(), expected, "{count} candidates, {recordings} logs, {places} places");
            assert_eq!((pieces[0].start, pieces[expected - 1].end), (0, count));
            assert!(pieces.windows(2).all(|pair| pair[0].end == pair[1].start));
            let sizes = pieces.iter().map(ExactSizeIterator::len);
            assert!(sizes.clone().max().unwrap_or(0) - sizes.min().unwrap_or(0) <= 1);
        }
    }
}
