//! Compares the effects in real logs with what logs of simulated robots without these effects show.

use super::World;
use crate::walk::swing::{Effect, EffectKind, Estimate};
use gaitfit_sim::stats::{deviation, mean};
use std::sync::PoisonError;

/// Effects that are compared with what simulated robots without them show. The geometry of standing legs, soft contacts and
/// torque noise look like small effects of these kinds.
const COMPARED: [EffectKind; 5] = [
    EffectKind::LoadFriction,
    EffectKind::OddFriction,
    EffectKind::Strength,
    EffectKind::Elasticity,
    EffectKind::Backlash,
];
/// Min simulated robots for such a comparison.
const MIN_COMPARED: usize = 6;

impl World<'_> {
    /// The `effects` that the simulated robots of the latest round show too, with the mean and scatter of their sizes.
    pub(super) fn compared(&self, effects: Vec<Effect>) -> Vec<Effect> {
        let shown = self.effects_shown.lock().unwrap_or_else(PoisonError::into_inner);
        let beside = |mut effect: Effect| {
            let same = |other: &&Effect| other.is_same(&effect);
            let mut sizes: Vec<f64> =
                shown.iter().filter_map(|all| all.iter().find(same)).map(|one| one.size.value).collect();
            sizes.retain(|size| size.is_finite());
            // Threads deliver the robots in any order; the sum must not depend on it.
            sizes.sort_by(f64::total_cmp);
            effect.without = Some(scatter(&sizes)?);
            Some(effect)
        };
        effects.into_iter().filter(|effect| COMPARED.contains(&effect.kind)).filter_map(beside).collect()
    }
}

/// Mean and standard deviation; absent for too few values.
fn scatter(values: &[f64]) -> Option<Estimate> {
    let enough = values.len() >= MIN_COMPARED;
    Some(Estimate { value: mean(values)?, error: deviation(values)? }).filter(|_| enough)
}
