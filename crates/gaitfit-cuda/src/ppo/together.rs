//! One update of several GPUs, each with its share of the samples.
//!
//! All GPUs have the same weights. Each computes its part of a sum; then all parts go to every GPU, which adds them up in the
//! order of the shares. So all do the same step, to the bit. Copies are direct where the driver lets one GPU read another's
//! memory, else the driver takes them through the host's memory.

use gaitfit_learn::ppo::Diagnostics;

use super::error::PpoError;
use super::learner::Learner;
use super::report;
use crate::runtime::CudaError;

/// One update of the learners of all shares of a training, in order, on the samples in their memory. Each has learned the
/// same before.
///
/// # Errors
/// [`PpoError::Update`] as [`Learner::update`], or a failure of a GPU.
pub fn update_together(learners: &mut [Learner], iteration: u32) -> Result<Diagnostics, PpoError> {
    learners.iter_mut().try_for_each(|learner| learner.begin(iteration))?;
    run_together(learners).inspect_err(|_| {
        // Nobody may free what another still reads; the error that is told is the first one.
        learners.iter().for_each(|learner| drop(learner.stream().wait()));
    })?;
    let states = learners.iter().map(Learner::state).collect::<Result<Vec<_>, _>>()?;
    report::together(learners, &states, iteration)
}

/// Starts the update's work without waiting; [`update_together`] has set what it needs.
///
/// # Errors
/// [`CudaError`].
pub fn run_together(learners: &mut [Learner]) -> Result<(), CudaError> {
    learners.iter_mut().try_for_each(Learner::record)?;
    let parts = learners.first().map_or(0, |learner| learner.plan().parts().len());
    for part in 0..parts {
        learners.iter_mut().try_for_each(|learner| learner.launch(part))?;
        exchange(learners, part)?;
    }
    Ok(())
}

/// The exchange after a part of the update, if there is one. Each GPU takes what the others say. What it says itself is taken in
/// the part. It says it again in the same array two exchanges later at the earliest: by then it has heard of all others what they
/// said after they had taken it.
fn exchange(learners: &[Learner], part: usize) -> Result<(), CudaError> {
    if learners.len() < 2 || learners.iter().any(|learner| learner.plan().exchanges.get(part).is_none()) {
        return Ok(());
    }
    learners.iter().try_for_each(|learner| learner.said().record(learner.stream()))?;
    for (number, learner) in learners.iter().enumerate() {
        for (_, other) in learners.iter().enumerate().filter(|(other, _)| *other != number) {
            learner.stream().wait_for(other.said())?;
            learner.take(part, other)?;
        }
    }
    Ok(())
}
