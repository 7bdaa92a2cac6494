//! Short predictions on a GPU: what `gaitfit_policy::predict` does.

use std::sync::{Arc, Mutex, MutexGuard, PoisonError};

use gaitfit_policy::follow;
use gaitfit_policy::predict::{Course, Job};
use gaitfit_policy::walker::Walker;
use gaitfit_sim::pool;

use super::scene::by_structure;
use super::shares::Cancel;
use super::{Candidates, FitError, Numbers, Readings, Structure, Subject, Tables, Tracks};
use crate::runtime::Device;

/// Predicts logs by candidates on a GPU. The robot must be the same in all calls. The logs may change from call to call: what is
/// compiled and allocated for logs as many and as long stays. Several threads may call: while one uses the GPU, the others' calls
/// wait, and those for the same logs and the same program then run together.
pub struct Predictions {
    device: Device,
    threads: usize,
    candidates: Mutex<Option<Candidates>>,
    /// Requests that wait for the GPU.
    waiting: Mutex<Vec<Arc<Request>>>,
    /// Memory for signals that is free.
    spare: Mutex<Vec<Vec<f32>>>,
}

/// Max number of candidates of several requests that run together, and of one request.
const MAX_TOGETHER: usize = 256;
/// The CPU predicts fewer candidates than this with a program of their own: a program takes seconds to compile. The number depends
/// on the call alone, so that a fit repeats its bits.
const FEW: usize = 4;
/// Max number of lists of signals that are kept for the next call.
const MAX_SPARE: usize = 4;

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
        Self {
            device: device.clone(),
            threads,
            candidates: Mutex::new(None),
            waiting: Mutex::new(Vec::new()),
            spare: Mutex::new(Vec::new()),
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
        let (size, recordings) = (tables.samples * subject.dimensions(), tables.recordings());
        for (structure, own) in by_structure(jobs.iter().map(|job| &job.candidate)) {
            if own.len() < FEW || courses.is_empty() {
                few.extend(own);
                continue;
            }
            let mut rest = own.as_slice();
            while !rest.is_empty() {
                let chosen: Vec<&Job> = rest.iter().take(MAX_TOGETHER).map(|&job| &jobs[job]).collect();
                let request = self.request(walker, (tables, courses), &structure, &chosen)?;
                let Done { signals, first, count } = self.answer(subject, &request, cancel)?;
                let one = |(): &mut (), run: usize| {
                    let recording = run % recordings;
                    let length = tables.lengths[recording] as usize;
                    let from = (first * recordings + run) * size;
                    let rows = &signals[from..from + length * subject.dimensions()];
                    let dimensions = subject.dimensions();
                    consume(rest[run / recordings], recording, Tracks { rows, dimensions, fell_at: None });
                };
                pool::for_each(count * recordings, self.threads, || (), one);
                let mut spare = locked(&self.spare);
                spare.extend(Arc::into_inner(signals));
                spare.truncate(MAX_SPARE);
                rest = &rest[count..];
            }
        }
        few.sort_unstable();
        Ok(few)
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
        let numbers = Numbers::new(Subject::Predict(walker), &jobs, tables.starts, self.threads)?.predicting(
            &jobs,
            &readings,
            self.threads,
        );
        let (tables, structure) = (Arc::clone(tables), structure.clone());
        Ok(Arc::new(Request { tables, structure, jobs, numbers, done: Mutex::default() }))
    }

    /// The signals of some of the request's candidates, at least of one: with those of other threads' requests, if there are.
    fn answer(
        &self,
        subject: Subject<'_>,
        request: &Arc<Request>,
        cancel: &Cancel<'_>,
    ) -> Result<Done, FitError> {
        locked(&self.waiting).push(Arc::clone(request));
        let mut candidates = locked(&self.candidates);
        // Another thread may have done it meanwhile.
        if let Some(done) = request.take() {
            return Ok(done);
        }
        let together = self.together(request);
        if cancel() {
            return Err(FitError::Cancelled);
        }
        let wanted = together.iter().map(|one| one.jobs.len()).sum();
        let numbers = Numbers::joined(together.iter().map(|one| &one.numbers));
        let mut signals = locked(&self.spare).pop().unwrap_or_default();
        let candidates = match candidates.as_mut() {
            Some(candidates) => candidates,
            None => {
                candidates.insert(Candidates::new(&self.device, Arc::clone(&request.tables), self.threads)?)
            }
        };
        let example = &request.jobs[0];
        let done = candidates.predict(subject, &request.tables, example, (numbers, wanted), &mut signals)?;
        let (signals, mut first) = (Arc::new(signals), 0);
        for one in &together {
            let count = one.jobs.len().min(done.saturating_sub(first));
            if count > 0 {
                *locked(&one.done) = Some(Done { signals: Arc::clone(&signals), first, count });
            }
            first += one.jobs.len();
        }
        drop(signals);
        request.take().ok_or(FitError::Length { what: "a request", expected: 1, found: 0 })
    }

    /// Takes `request` and the waiting requests that can run with it; `request` comes first. A request that does not fit, or whose
    /// batch fails, runs when its own thread gets the GPU.
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
