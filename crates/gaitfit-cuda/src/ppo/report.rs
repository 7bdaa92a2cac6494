//! What an update says of itself.

use gaitfit_learn::ppo::{Culprit, Diagnostics, SamplesError, UpdateError};

use super::error::PpoError;
use super::launch::Batch;
use super::learner::Learner;
use super::plan::CHECKED;
use crate::runtime::CudaError;

/// Places in the array `state`, as the text has them.
pub(super) const LEARNING_RATE: usize = 0;
pub(super) const STEPS: usize = 1;
const FAULT: usize = 5;
/// The fault of samples that are not finite: beyond the numbers of the culprits below, which count from 1.
const FAULT_SAMPLES: f64 = 100.0;

/// The report of an update. It is the same on all GPUs, but for samples that are not finite.
pub(super) fn together(
    learners: &[Learner],
    states: &[Vec<f64>],
    iteration: u32,
) -> Result<Diagnostics, PpoError> {
    let Some((learner, state)) = learners.iter().zip(states).next() else {
        let (expected, found) = ("at least one GPU".to_owned(), "0".to_owned());
        return Err(PpoError::Batch { expected, found });
    };
    if state[FAULT] == FAULT_SAMPLES {
        for learner in learners {
            if let Some(error) = learner.faulty_sample()? {
                return Err(error.into());
            }
        }
        let what = Culprit::PolicyLoss;
        let error = UpdateError::NotFinite { culprit: what, iteration, epoch: 0, minibatch: 0 };
        return Err(error.into());
    }
    learner.report(state, iteration)
}

impl Learner {
    /// The update's numbers, or what was not finite.
    fn report(&self, state: &[f64], iteration: u32) -> Result<Diagnostics, PpoError> {
        let fault = state[FAULT];
        let culprits = [
            Culprit::PolicyLoss,
            Culprit::ValueLoss,
            Culprit::KlDivergence,
            Culprit::ActorGradient,
            Culprit::CriticGradient,
            Culprit::LogStdGradient,
        ];
        if let Some(&culprit) = (fault >= 1.0).then(|| culprits.get(fault as usize - 1)).flatten() {
            let (epoch, minibatch) = (state[FAULT + 1] as usize, state[FAULT + 2] as usize);
            return Err(UpdateError::NotFinite { culprit, iteration, epoch, minibatch }.into());
        }
        let count = (self.settings.epochs * self.settings.minibatches) as f64;
        let sums = &state[FAULT + 3..];
        Ok(Diagnostics {
            policy_loss: sums[0] / count,
            value_loss: sums[1] / count,
            entropy: sums[2] / count,
            kl: sums[3] / count,
            kl_last: sums[4],
            approx_kl_k1: sums[5] / count,
            approx_kl_k3: sums[6] / count,
            clip_fraction: sums[7] / count,
            gradient_norm: sums[8] / count,
            explained_variance: sums[9],
            mean_std: sums[10],
            learning_rate: state[LEARNING_RATE],
        })
    }

    /// Which number of the samples is not finite.
    fn faulty_sample(&self) -> Result<Option<UpdateError>, CudaError> {
        let Batch { environments, tile, share, .. } = self.batch;
        for name in CHECKED {
            let numbers = self.read_f32(name)?;
            let rows = if name == "last_value" { environments } else { self.batch.rows() };
            let width = (numbers.len() / rows.max(1)).max(1);
            if let Some(place) = numbers.iter().position(|number| !number.is_finite()) {
                let (row, element) = (place / width, place % width);
                // Numbered as in the whole training, so that the message is the same for any number of GPUs.
                let environment = share.number * environments + row % environments;
                return Ok(Some(UpdateError::from(SamplesError::NotFinite {
                    tile: environment / tile,
                    array: name,
                    step: row / environments,
                    environment: environment % tile,
                    element,
                    value: numbers[place],
                })));
            }
        }
        Ok(None)
    }
}
