//! What stands for GPUs in a build without `gaitfit-cuda`: there are none, so nothing of this is ever called.

use super::Device;
use crate::Error;
use gaitfit_learn::collect::{CollectOptions, Collected};
use gaitfit_learn::evaluate::{Crossing, DriftTrial, Subject, Trial};
use gaitfit_learn::task::Task;
use gaitfit_learn::{Iteration, Training};
use gaitfit_policy::Policy;
use gaitfit_policy::follow::{Job, Script, Track};
use gaitfit_policy::walker::Walker;
use gaitfit_sim::Candidate;
use std::convert::Infallible;
use std::marker::PhantomData;

/// An opened GPU: there is none.
#[derive(Clone, Debug)]
pub struct Gpu {
    never: Infallible,
}

/// A training on a GPU: there is none.
pub struct Trainer<'a> {
    never: Infallible,
    _training: PhantomData<&'a ()>,
}

impl Trainer<'_> {
    /// Whether all iterations are done.
    pub fn finished(&self) -> bool {
        match self.never {}
    }

    /// One iteration.
    ///
    /// # Errors
    /// None.
    pub fn iterate(&mut self) -> Result<Iteration, Error> {
        match self.never {}
    }
}

/// The device that `auto` means: the processor.
pub(super) fn automatic() -> Device {
    Device::Cpu
}

pub(super) fn name(_number: usize) -> Option<String> {
    None
}

pub(super) fn open(number: usize) -> Result<Gpu, Error> {
    Err(absent(Device::Cuda(number)))
}

pub(super) fn check(_scene: &Task, _candidates: &[Candidate]) -> Result<(), Error> {
    Err(absent(Device::Cuda(0)))
}

/// Why there is no GPU, and what to do.
fn absent(device: Device) -> Error {
    Error::Missing(format!(
        "device {device}: this build of gaitfit has no NVIDIA GPUs. Build the crate `gaitfit` with its feature `cuda`, or take \
         the device cpu."
    ))
}

/// Trajectories with random commands.
///
/// # Errors
/// None.
pub fn trials(
    gpu: &Gpu,
    _subject: &Subject<'_>,
    _count: usize,
    _seconds: f64,
    _cancel: &dyn Fn() -> bool,
) -> Result<Vec<Trial>, Error> {
    match gpu.never {}
}

/// Constant commands.
///
/// # Errors
/// None.
pub fn drift(
    gpu: &Gpu,
    _subject: &Subject<'_>,
    _robots: usize,
    _speeds: Option<[f64; 3]>,
    _cancel: &dyn Fn() -> bool,
) -> Result<Vec<DriftTrial>, Error> {
    match gpu.never {}
}

/// Crossings of uneven ground.
///
/// # Errors
/// None.
pub fn crossings(
    gpu: &Gpu,
    _subject: &Subject<'_>,
    _robots: usize,
    _speed: f64,
    _cancel: &dyn Fn() -> bool,
) -> Result<Vec<Crossing>, Error> {
    match gpu.never {}
}

/// Logs of walks under random commands.
///
/// # Errors
/// None.
pub fn collect(
    gpu: &Gpu,
    _subject: &Subject<'_>,
    _options: &CollectOptions,
    _cancel: &dyn Fn() -> bool,
) -> Result<Vec<Collected>, Error> {
    match gpu.never {}
}

/// Walks under the commands of scripts.
///
/// # Errors
/// None.
pub fn follow(
    gpu: &Gpu,
    _policy: (&Walker, &Policy),
    _scripts: &[Script],
    _job: &Job,
    _threads: usize,
    _consume: &(dyn Fn(usize, &Track) + Sync),
    _cancel: &(dyn Fn() -> bool + Sync),
) -> Result<(), Error> {
    match gpu.never {}
}

/// Continues a training on a GPU.
///
/// # Errors
/// None.
pub fn start_training<'a>(gpus: &[Gpu], _training: &mut Training<'a>) -> Result<Trainer<'a>, Error> {
    match gpus.first() {
        Some(gpu) => match gpu.never {},
        None => Err(absent(Device::Cuda(0))),
    }
}

/// Brings the state of a trainer back.
///
/// # Errors
/// None.
pub fn store_training(trainer: &Trainer<'_>, _training: &mut Training<'_>) -> Result<(), Error> {
    match trainer.never {}
}
