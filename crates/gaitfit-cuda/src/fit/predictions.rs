//! Short predictions on a GPU: what `gaitfit_policy::predict` does.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use gaitfit_policy::follow;
use gaitfit_policy::predict::{Course, Job};
use gaitfit_policy::walker::Walker;
use gaitfit_sim::pool;

use super::{Candidates, FitError, Numbers, Readings, Structure, Subject, Tables, Tracks};
use crate::runtime::Device;

/// Predicts logs by candidates on a GPU. The robot must be the same in all calls. The logs may change from call to call: what is
/// compiled and allocated for logs as many and as long stays. Several threads may call: while one uses the GPU the others' calls
/// gather, and those on the same logs run together.
pub struct Predictions {
    device: Device,
    threads: usize,
    /// The candidates, on the logs of the last call.
    candidates: Mutex<Option<Candidates>>,
    /// Structures that candidates had before.
    known: Mutex<Vec<Structure>>,
    /// Requests that wait for the GPU.
    waiting: Mutex<Vec<Arc<Request>>>,
    /// Memory for signals that is free.
    spare: Mutex<Vec<Vec<f32>>>,
}

/// Max number of candidates that run together.
const MAX_TOGETHER: usize = 256;
/// Fewer candidates of a new structure are not worth a program of their own.
const FEW: usize = 4;

/// Candidates of one structure on some logs.
struct Request {
    tables: Arc<Tables>,
    structure: Structure,
    jobs: Vec<follow::Job>,
    numbers: Numbers,
    done: Mutex<Option<Done>>,
}

/// The signals of a request's candidates.
struct Done {
    signals: Arc<Vec<f32>>,
    /// Place of the request's first candidate among those of `signals`.
    first: usize,
    /// How many of the request's candidates are done: the first ones.
    count: usize,
}

impl Request {
    fn runs_with(&self, other: &Self) -> bool {
        Arc::ptr_eq(&self.tables, &other.tables) && self.structure == other.structure
    }

    fn take(&self) -> Option<Done> {
        locked(&self.done).take()
    }
}

fn locked<T>(mutex: &Mutex<T>) -> MutexGuard<'_, T> {
    mutex.lock().unwrap_or_else(PoisonError::into_inner)
}

impl Predictions {
    /// On `device`. `threads`: of the host, for what it prepares.
    pub fn new(device: &Device, threads: usize) -> Self {
        let (candidates, known, waiting, spare) = Default::default();
        Self { device: device.clone(), threads, candidates, known, waiting, spare }
    }

    /// Whether the GPU should predict these jobs: not a few robots that need another program than those before.
    pub fn is_worth(&self, jobs: &[Job]) -> bool {
        let mut known = locked(&self.known);
        let new = |job: &Job| Some(Structure::new(&job.candidate)).filter(|one| !known.contains(one));
        let new: Vec<Structure> = jobs.iter().filter_map(new).collect();
        let worth = new.is_empty() || new.len() >= FEW;
        if worth {
            for one in new {
                if !known.contains(&one) {
                    known.push(one);
                }
            }
        }
        worth
    }

    /// Has every job predict every course and hands `consume(job, course, tracks)` the joint positions and velocities, once,
    /// from any thread. `tables`: [`Tables::predict`] of the courses.
    ///
    /// # Errors
    /// Candidates that cannot be simulated; a failure of the GPU; [`FitError::Cancelled`].
    pub fn run(
        &self,
        walker: &Walker,
        (tables, courses): (&Arc<Tables>, &[Course]),
        jobs: &[Job],
        consume: &(dyn Fn(usize, usize, Tracks<'_>) + Sync),
        cancel: &(dyn Fn() -> bool + Sync),
    ) -> Result<(), FitError> {
        if courses.is_empty() {
            return Ok(());
        }
        let structures: Vec<Structure> = jobs.iter().map(|job| Structure::new(&job.candidate)).collect();
        let mut left: Vec<usize> = (0..jobs.len()).collect();
        while let Some(&first) = left.first() {
            if cancel() {
                return Err(FitError::Cancelled);
            }
            let (own, others): (Vec<usize>, Vec<usize>) =
                left.iter().partition(|&&job| structures[job] == structures[first]);
            let chosen: Vec<&Job> = own.iter().map(|&job| &jobs[job]).collect();
            let request = self.request(walker, (tables, courses), &structures[first], &chosen)?;
            let Done { signals, first, count } = self.answer(Subject::Predict(walker), &request)?;
            let dimensions = Subject::Predict(walker).dimensions();
            let (size, recordings) = (tables.samples * dimensions, tables.recordings());
            let one = |(): &mut (), run: usize| {
                let recording = run % recordings;
                let length = tables.lengths[recording] as usize;
                let rows = &signals[(first * recordings + run) * size..][..length * dimensions];
                consume(own[run / recordings], recording, Tracks { rows, dimensions, fell_at: None });
            };
            pool::for_each(count * recordings, self.threads, || (), one);
            if let Some(signals) = Arc::into_inner(signals) {
                locked(&self.spare).push(signals);
            }
            left = own[count..].iter().chain(&others).copied().collect();
        }
        Ok(())
    }

    /// What the GPU needs of these jobs, which share a structure.
    fn request(
        &self,
        walker: &Walker,
        (tables, courses): (&Arc<Tables>, &[Course]),
        structure: &Structure,
        jobs: &[&Job],
    ) -> Result<Arc<Request>, FitError> {
        let followed = |job: &&Job| follow::Job {
            candidate: job.candidate.clone(),
            reset_every: Some(job.every),
            seed: job.seed,
        };
        let trust: Vec<f64> = jobs.iter().map(|job| job.feet_trust).collect();
        let jobs: Vec<follow::Job> = jobs.iter().map(followed).collect();
        let readings = Readings { walker, courses, trust: &trust };
        let numbers = Numbers::new(Subject::Predict(walker), &jobs, jobs.len(), tables.starts, self.threads)?
            .predicting(&jobs, &readings, self.threads);
        let (tables, structure) = (Arc::clone(tables), structure.clone());
        Ok(Arc::new(Request { tables, structure, jobs, numbers, done: Mutex::default() }))
    }

    /// The signals of some of the request's candidates, at least of one: with those of other threads' requests, if there are.
    fn answer(&self, subject: Subject<'_>, request: &Arc<Request>) -> Result<Done, FitError> {
        locked(&self.waiting).push(Arc::clone(request));
        let mut candidates = locked(&self.candidates);
        // Another thread may have done it meanwhile.
        if let Some(done) = request.take() {
            return Ok(done);
        }
        let together = self.together(request);
        let wanted = together.iter().map(|one| one.jobs.len()).sum();
        let numbers = Numbers::joined(together.iter().map(|one| &one.numbers));
        let mut signals = locked(&self.spare).pop().unwrap_or_default();
        let candidates = match candidates.as_mut() {
            Some(candidates) => candidates,
            None => {
                candidates.insert(Candidates::new(&self.device, Arc::clone(&request.tables), self.threads)?)
            }
        };
        candidates.set_tables(&request.tables)?;
        let done = candidates.predict(subject, &request.jobs[0], numbers, wanted, &mut signals)?;
        let (signals, mut first) = (Arc::new(signals), 0);
        for one in &together {
            let count = one.jobs.len().min(done.saturating_sub(first));
            if count > 0 {
                *locked(&one.done) = Some(Done { signals: Arc::clone(&signals), first, count });
            }
            first += one.jobs.len();
        }
        drop(signals);
        request.take().ok_or(FitError::Cancelled)
    }

    /// Takes `request` and what can run with it from those that wait; `request` is the first. Those whose candidates there is no
    /// room for, or that another failure left, run when their own threads' turns come.
    fn together(&self, request: &Arc<Request>) -> Vec<Arc<Request>> {
        let mut waiting = locked(&self.waiting);
        let (mut together, mut count) = (vec![Arc::clone(request)], request.jobs.len());
        waiting.retain(|other| {
            if Arc::ptr_eq(other, request) {
                return false;
            }
            let fits = other.runs_with(request) && count + other.jobs.len() <= MAX_TOGETHER;
            if fits {
                count += other.jobs.len();
                together.push(Arc::clone(other));
            }
            !fits
        });
        together
    }
}
