//! The candidates of a fit on one GPU or several of one host.

use std::sync::Arc;

use gaitfit_policy::follow::Job;

use super::shares::{Cancel, shared};
use super::{Candidates, Compared, FitError, Measured, Parts, Subject, Tables, Tracks};
use crate::runtime::Device;

/// Simulates candidates on the recordings of some tables, on one GPU or several. Each GPU has the recordings, takes an
/// equal contiguous share of the candidates and is driven by a thread of its own. What comes of a candidate depends on
/// that candidate alone, so on GPUs of one kind the bits do not depend on their number.
pub struct MultiGpu {
    gpus: Vec<Candidates>,
    tables: Arc<Tables>,
}

impl MultiGpu {
    /// Candidates on `devices`, at least one. `threads`: of the host, for what it prepares, of all GPUs
    /// together.
    ///
    /// # Errors
    /// A failure of a GPU.
    pub fn new(devices: &[Device], tables: Tables, threads: usize) -> Result<Self, FitError> {
        let tables = Arc::new(tables);
        let each = threads.div_ceil(devices.len().max(1));
        let gpus = devices
            .iter()
            .map(|device| Candidates::new(device, Arc::clone(&tables), each))
            .collect::<Result<_, _>>()?;
        Ok(Self { gpus, tables })
    }

    /// The recordings.
    pub fn tables(&self) -> &Tables {
        &self.tables
    }

    /// Sets what candidates are compared with.
    ///
    /// # Errors
    /// As [`Candidates::measure`].
    pub fn measure(&mut self, measured: Measured, dimensions: usize) -> Result<(), FitError> {
        let measured = Arc::new(measured);
        self.gpus.iter_mut().try_for_each(|gpu| gpu.measure(Arc::clone(&measured), dimensions))
    }

    /// As [`Candidates::parts`].
    ///
    /// # Errors
    /// As there; where there are several GPUs, [`FitError::On`] names the one that failed.
    pub fn parts(
        &mut self,
        subject: Subject<'_>,
        jobs: &[Job],
        compared: &[Compared],
        cancel: &Cancel<'_>,
    ) -> Result<Vec<Parts>, FitError> {
        let shares = shared(&mut self.gpus, jobs.len(), cancel, |gpu, share, cancel| {
            gpu.parts(subject, &jobs[share.clone()], &compared[share], cancel)
        })?;
        Ok(shares.into_iter().flatten().collect())
    }

    /// As [`Candidates::tracks`].
    ///
    /// # Errors
    /// As [`MultiGpu::parts`].
    pub fn tracks(
        &mut self,
        subject: Subject<'_>,
        jobs: &[Job],
        consume: &(dyn Fn(usize, usize, Tracks<'_>) + Sync),
        cancel: &Cancel<'_>,
    ) -> Result<(), FitError> {
        shared(&mut self.gpus, jobs.len(), cancel, |gpu, share, cancel| {
            let consume = |job: usize, recording: usize, tracks: Tracks<'_>| {
                consume(share.start + job, recording, tracks);
            };
            gpu.tracks(subject, &jobs[share.clone()], &consume, cancel)
        })?;
        Ok(())
    }
}
