//! Short predictions on a GPU: what `gaitfit_policy::predict` does.

use std::sync::{Arc, Condvar, Mutex, MutexGuard, PoisonError};

use gaitfit_policy::follow;
use gaitfit_policy::predict::{Course, Job};
use gaitfit_policy::walker::Walker;
use gaitfit_sim::pool;

use super::candidates::Known;
use super::scene::by_structure;
use super::shares::Cancel;
use super::{Candidates, FitError, Numbers, PredictionInput, Structure, Subject, Tables, Tracks};
use crate::runtime::Device;

/// Predicts logs by candidates on a GPU. The robot must be the same in all calls. The logs may change from call to call: what is
/// compiled and allocated for logs as many and as long stays. Several threads may call. Up to eight use the GPU at the same time;
/// others wait.
pub struct Predictions {
    device: Device,
    threads: usize,
    known: Known,
    places: Mutex<Places<Candidates>>,
    /// A place has become free.
    freed: Condvar,
}

/// Max number of candidates of a call that run together.
const MAX_TOGETHER: usize = 256;
/// Max number of threads that use the GPU at once.
const MAX_PLACES: usize = 8;
/// The CPU predicts fewer candidates than this with a program of their own: a program takes seconds to compile. The number depends
/// on the call alone, so that a fit repeats its bits.
const FEW: usize = 4;

/// Candidates (`T`) that threads use the GPU with, and those that are free.
struct Places<T> {
    /// Candidates that no thread uses, the last used one last.
    free: Vec<T>,
    /// Number of threads that use candidates.
    taken: usize,
}

impl<T> Places<T> {
    fn are_full(&self) -> bool {
        self.taken >= MAX_PLACES
    }

    /// Takes a place. Its candidates are the last used ones of those that suit. If none suit, they are those that were used
    /// longest ago; `None` if none are free.
    fn take(&mut self, suits: impl Fn(&T) -> bool) -> Option<T> {
        self.taken += 1;
        let suited = self.free.iter().rposition(suits);
        suited.or_else(|| (!self.free.is_empty()).then_some(0)).map(|at| self.free.remove(at))
    }

    /// Gives a place back, with its candidates if it still has them.
    fn give_back(&mut self, candidates: Option<T>) {
        self.taken -= 1;
        self.free.extend(candidates);
    }
}

/// A thread's place; free again when this is dropped.
struct Place<'a> {
    predictions: &'a Predictions,
    /// `None` before the first use, and after a failure.
    candidates: Option<Candidates>,
}

impl Drop for Place<'_> {
    fn drop(&mut self) {
        self.predictions.places().give_back(self.candidates.take());
        self.predictions.freed.notify_all();
    }
}

/// Candidates of one structure and what they predict.
struct Batch<'a> {
    subject: Subject<'a>,
    tables: &'a Arc<Tables>,
    structure: &'a Structure,
    /// One of the candidates.
    example: &'a follow::Job,
    numbers: Numbers,
    wanted: usize,
}

impl Predictions {
    /// Predictions on `device`. `threads`: of the host, for what it prepares.
    pub fn new(device: &Device, threads: usize) -> Self {
        Self {
            device: device.clone(),
            threads,
            known: Known::default(),
            places: Mutex::new(Places { free: Vec::new(), taken: 0 }),
            freed: Condvar::new(),
        }
    }

    /// Has jobs predict every course and hands `consume(job, course, tracks)` the joint positions and velocities, once, from any
    /// thread. `tables`: [`Tables::predict`] of the courses. Returns the jobs that are left for the CPU: those of structures that few
    /// of the jobs have.
    ///
    /// # Errors
    /// Candidates that cannot be simulated; a failure of the GPU; [`FitError::Cancelled`].
    pub fn run(
        &self,
        walker: &Walker,
        (tables, courses): (&Arc<Tables>, &[Course]),
        jobs: &[Job],
        consume: &(dyn Fn(usize, usize, Tracks<'_>) + Sync),
        cancel: &Cancel<'_>,
    ) -> Result<Vec<usize>, FitError> {
        let mut few = Vec::new();
        let subject = Subject::Predict(walker);
        for (structure, own) in by_structure(jobs.iter().map(|job| &job.candidate)) {
            if own.len() < FEW || courses.is_empty() {
                few.extend(own);
                continue;
            }
            let mut rest = own.as_slice();
            while !rest.is_empty() {
                let chosen: Vec<&Job> = rest.iter().take(MAX_TOGETHER).map(|&job| &jobs[job]).collect();
                let (followed, numbers) = self.numbers(walker, courses, &chosen)?;
                let wanted = followed.len();
                let example = &followed[0];
                let batch = Batch { subject, tables, structure: &structure, example, numbers, wanted };
                let pass = |place: usize, course: usize, tracks: Tracks<'_>| {
                    consume(rest[place], course, tracks);
                };
                // `predict` handles at least one, so the loop ends.
                rest = &rest[self.predict(&batch, &pass, cancel)?..];
            }
        }
        few.sort_unstable();
        Ok(few)
    }

    /// Numbers of these jobs, which share a structure, for the GPU.
    fn numbers(
        &self,
        walker: &Walker,
        courses: &[Course],
        jobs: &[&Job],
    ) -> Result<(Vec<follow::Job>, Numbers), FitError> {
        let followed = |job: &&Job| follow::Job {
            candidate: job.candidate.clone(),
            reset_every: Some(job.every),
            seed: job.seed,
        };
        let trust: Vec<f64> = jobs.iter().map(|job| job.feet_trust).collect();
        let followed: Vec<follow::Job> = jobs.iter().map(followed).collect();
        let input = PredictionInput { walker, courses, trust: &trust };
        let numbers = Numbers::new(Subject::Predict(walker), &followed, 1, self.threads)?.predicting(
            &followed,
            &input,
            self.threads,
        );
        Ok((followed, numbers))
    }

    /// Hands `consume` the predictions of the first candidates of `batch`, at least of one, and returns of how many.
    fn predict(
        &self,
        batch: &Batch<'_>,
        consume: &(dyn Fn(usize, usize, Tracks<'_>) + Sync),
        cancel: &Cancel<'_>,
    ) -> Result<usize, FitError> {
        let mut place = self.place(batch);
        if cancel() {
            return Err(FitError::Cancelled);
        }
        let run = |place: &mut Place<'_>| -> Result<usize, FitError> {
            // Taken out: if the run fails, the place gives nothing back and their memory is free.
            let mut candidates = match place.candidates.take() {
                Some(candidates) => candidates,
                None => self.candidates(batch)?,
            };
            let (signals, count) = batch.run(&mut candidates)?;
            self.consume(batch, signals, count, consume);
            place.candidates = Some(candidates);
            Ok(count)
        };
        match run(&mut place) {
            Err(error) if error.is_memory() => {
                // Again without the memory that no thread uses.
                self.places().free.clear();
                // The first error says what did not fit with all in use.
                run(&mut place).map_err(|_| error)
            }
            done => done,
        }
    }

    fn consume(
        &self,
        batch: &Batch<'_>,
        signals: &[f32],
        count: usize,
        consume: &(dyn Fn(usize, usize, Tracks<'_>) + Sync),
    ) {
        let Batch { subject, tables, .. } = batch;
        let (recordings, dimensions) = (tables.recordings(), subject.dimensions());
        let size = tables.samples * dimensions;
        // Each candidate has a lock, so neighbouring pieces belong to different candidates.
        pool::for_each(
            count * recordings,
            self.threads,
            || (),
            |(): &mut (), piece| {
                let (place, recording) = (piece % count, piece / count);
                let from = (place * recordings + recording) * size;
                let rows = &signals[from..from + tables.lengths[recording] as usize * dimensions];
                consume(place, recording, Tracks { rows, dimensions, fell_at: None });
            },
        );
    }

    /// A place for the calling thread, if possible with what `batch` needs.
    fn place(&self, batch: &Batch<'_>) -> Place<'_> {
        let full = |places: &mut Places<Candidates>| places.are_full();
        let mut places = self.freed.wait_while(self.places(), full).unwrap_or_else(PoisonError::into_inner);
        let suits = |one: &Candidates| {
            one.has_prediction_session(batch.subject, batch.tables, (batch.structure, batch.wanted))
        };
        let candidates = places.take(suits);
        Place { predictions: self, candidates }
    }

    fn candidates(&self, batch: &Batch<'_>) -> Result<Candidates, FitError> {
        Candidates::sharing(&self.device, Arc::clone(batch.tables), self.threads, Arc::clone(&self.known))
    }

    fn places(&self) -> MutexGuard<'_, Places<Candidates>> {
        self.places.lock().unwrap_or_else(PoisonError::into_inner)
    }
}

impl Batch<'_> {
    /// The signals of the first candidates, and of how many they are.
    fn run<'a>(&self, candidates: &'a mut Candidates) -> Result<(&'a [f32], usize), FitError> {
        candidates.predict(self.subject, self.tables, self.example, (&self.numbers, self.wanted))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Places with these free candidates, the last used one last.
    fn places(free: &[&'static str]) -> Places<&'static str> {
        Places { free: free.to_vec(), taken: 0 }
    }

    #[test]
    fn the_last_used_candidates_that_suit_are_taken() {
        let mut places = places(&["walk 1", "walk 2", "other"]);
        let walks = |name: &&str| name.starts_with("walk");
        assert_eq!(places.take(walks), Some("walk 2"));
        assert_eq!(places.take(walks), Some("walk 1"));
        assert_eq!((places.free, places.taken), (vec!["other"], 2));
    }

    #[test]
    fn without_any_that_suit_the_longest_unused_are_taken() {
        let mut places = places(&["old", "new"]);
        assert_eq!(places.take(|_| false), Some("old"));
        assert_eq!(places.take(|_| false), Some("new"));
        assert_eq!(places.take(|_| false), None);
    }

    #[test]
    fn a_place_is_free_again_after_a_failure_too() {
        let mut places = places(&["one"]);
        let taken: Vec<_> = (0..MAX_PLACES).map(|_| places.take(|_| true)).collect();
        assert!(places.are_full() && taken[0].is_some() && taken[1].is_none());
        // A failure loses the candidates, not the place.
        places.give_back(None);
        assert!(!places.are_full() && places.free.is_empty());
        places.give_back(Some("two"));
        assert_eq!(places.take(|_| true), Some("two"));
    }
}
