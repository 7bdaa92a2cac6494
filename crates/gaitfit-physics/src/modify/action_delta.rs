//! ActionDelta: a correction of each joint's position target.

use super::Modify;
use super::network::{JointNetwork, PAST};
use crate::{Owner, Params, Real, Slot, State};

/// Networks whose outputs (rad) are added to the targets about to be sent, at the policy's rate; their past is
/// sampled at that rate too (He et al. 2025; Dao and Fern, eq. 4).
#[derive(Clone, Debug, PartialEq)]
pub struct ActionDelta<K>(pub Vec<JointNetwork<K>>);

impl<K: Copy> Modify<K> for ActionDelta<K> {
    fn memory(&self) -> usize {
        PAST * self.0.len()
    }

    fn memory_owner(&self, place: usize) -> Owner {
        self.0.get(place / PAST).map_or(Owner::Base, |network| Owner::Joint(network.joint))
    }

    fn settles_at_zero(&self) -> bool {
        false
    }

    fn visit_weights_mut(&mut self, mut visit: impl FnMut(Slot, &mut K)) {
        for network in &mut self.0 {
            network.visit_weights_mut("action_delta", &mut visit);
        }
    }

    #[inline(always)]
    fn settle<T: Real<K = K>>(&self, params: &Params<T>, state: &State<T>, memory: &mut [T]) {
        for (network, past) in self.0.iter().zip(memory.chunks_exact_mut(PAST)) {
            network.settle(params, state, past);
        }
    }

    #[inline(always)]
    fn targets<T: Real<K = K>>(
        &self,
        _substeps: usize,
        params: &Params<T>,
        state: &State<T>,
        memory: &mut [T],
        targets: &mut [T],
    ) {
        for (network, past) in self.0.iter().zip(memory.chunks_exact_mut(PAST)) {
            targets[network.joint] = targets[network.joint] + network.advance(params, state, past);
        }
    }
}
