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
const FAULT_SAMPLES: f64 = 100.0;

impl Learner {
    /// The update's numbers, or what was not finite.
    pub(super) fn report(&self, state: &[f64], iteration: u32) -> Result<Diagnostics, PpoError> {
        let fault = state[FAULT];
        if fault == FAULT_SAMPLES {
            return Err(self.faulty_sample()?.into());
        }
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
    fn faulty_sample(&self) -> Result<UpdateError, CudaError> {
        let Batch { environments, tile, .. } = self.batch;
        for name in CHECKED {
            let numbers = self.read_f32(name)?;
            let rows = if name == "last_value" { environments } else { self.batch.rows() };
            let width = (numbers.len() / rows.max(1)).max(1);
            if let Some(place) = numbers.iter().position(|number| !number.is_finite()) {
                let (row, element) = (place / width, place % width);
                let environment = row % environments;
                return Ok(UpdateError::from(SamplesError::NotFinite {
                    tile: environment / tile,
                    array: name,
                    step: row / environments,
                    environment: environment % tile,
                    element,
                    value: numbers[place],
                }));
            }
        }
        let what = Culprit::PolicyLoss;
        Ok(UpdateError::NotFinite { culprit: what, iteration: 0, epoch: 0, minibatch: 0 })
    }
}
