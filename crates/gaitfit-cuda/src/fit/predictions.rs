//! Short predictions on a GPU: what `gaitfit_policy::predict` does.

use std::sync::{Arc, Mutex, PoisonError};

use gaitfit_policy::follow;
use gaitfit_policy::predict::{Course, Job};
use gaitfit_policy::walker::Walker;
use gaitfit_sim::pool;

use super::{Candidates, FitError, Numbers, Readings, Structure, Subject, Tables, Tracks};
use crate::runtime::Device;

/// Predicts logs by candidates on a GPU. The robot must be the same in all calls. The logs may change from call to call: what is
/// compiled and allocated for logs as many and as long stays. Calls of several threads take turns on the GPU alone.
pub struct Predictions {
    device: Device,
    threads: usize,
    /// The candidates, on the logs of the last call.
    candidates: Mutex<Option<Candidates>>,
    /// Memory for signals that is free.
    spare: Mutex<Vec<Vec<f32>>>,
}

impl Predictions {
    /// On `device`. `threads`: of the host, for what it prepares.
    pub fn new(device: &Device, threads: usize) -> Self {
        Self { device: device.clone(), threads, candidates: Mutex::default(), spare: Mutex::default() }
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
        if jobs.is_empty() || courses.is_empty() {
            return Ok(());
        }
        let mut groups: Vec<(Structure, Vec<usize>)> = Vec::new();
        for (number, job) in jobs.iter().enumerate() {
            let structure = Structure::new(&job.candidate);
            match groups.iter_mut().find(|(of, _)| *of == structure) {
                Some((_, own)) => own.push(number),
                None => groups.push((structure, vec![number])),
            }
        }
        for (_, own) in groups {
            let mut rest = own.as_slice();
            while !rest.is_empty() {
                if cancel() {
                    return Err(FitError::Cancelled);
                }
                rest = self.part(walker, (tables, courses), jobs, rest, consume)?;
            }
        }
        Ok(())
    }

    /// As many of the jobs `rest`, which share a structure, as there is room for. Returns the others.
    fn part<'a>(
        &self,
        walker: &Walker,
        (tables, courses): (&Arc<Tables>, &[Course]),
        jobs: &[Job],
        rest: &'a [usize],
        consume: &(dyn Fn(usize, usize, Tracks<'_>) + Sync),
    ) -> Result<&'a [usize], FitError> {
        let subject = Subject::Predict(walker);
        let dimensions = subject.dimensions();
        let followed = |&job: &usize| follow::Job {
            candidate: jobs[job].candidate.clone(),
            reset_every: Some(jobs[job].every),
            seed: jobs[job].seed,
        };
        let followed: Vec<follow::Job> = rest.iter().map(followed).collect();
        let trust: Vec<f64> = rest.iter().map(|&job| jobs[job].feet_trust).collect();
        let readings = Readings { walker, courses, trust: &trust };
        let numbers = Numbers::new(subject, &followed, followed.len(), tables.starts, self.threads)?
            .predicting(&followed, &readings, self.threads);
        let mut signals = self.spare.lock().unwrap_or_else(PoisonError::into_inner).pop().unwrap_or_default();
        let now = {
            let mut candidates = self.candidates.lock().unwrap_or_else(PoisonError::into_inner);
            let candidates = match candidates.as_mut() {
                Some(candidates) => candidates,
                None => {
                    candidates.insert(Candidates::new(&self.device, Arc::clone(tables), self.threads)?)
                }
            };
            candidates.set_tables(tables)?;
            candidates.predict(subject, &followed[0], numbers, rest.len(), &mut signals)?
        };
        let size = tables.samples * dimensions;
        let recordings = tables.recordings();
        pool::for_each(
            now * recordings,
            self.threads,
            || (),
            |(), run| {
                let recording = run % recordings;
                let length = tables.lengths[recording] as usize;
                let rows = &signals[run * size..][..length * dimensions];
                consume(rest[run / recordings], recording, Tracks { rows, dimensions, fell_at: None });
            },
        );
        self.spare.lock().unwrap_or_else(PoisonError::into_inner).push(signals);
        Ok(&rest[now..])
    }
}
