//! ResidAct: a torque added to each joint's PD torque.

use super::Modify;
use super::network::{JointNetwork, PAST};
use crate::{Drive, Owner, Params, Real, Settings, Slot, State};

/// Networks whose outputs (N·m) are added to the PD torques after their limits, at the physics' rate; their past is
/// sampled at that rate too (Dao and Fern's residual actuator model). After the limits, as what is missing may be
/// outside the motor: a spring, a cable.
///
/// What of an output resists the joint's velocity (−∂τ/∂q̇ > 0) is integrated implicitly: it enters the solver's matrix.
/// A torque against the change of velocity since the step before, −A Δq̇/h, stands for an inertia of 2 A: by itself it
/// is unstable for A beyond the joint's own inertia M, integrated so its fastest mode is −A / (M + A), which decays.
/// What resists more than it should because another part of the network pushes is not told apart: only the sum counts.
#[derive(Clone, Debug, PartialEq)]
pub struct ResidAct<K>(pub Vec<JointNetwork<K>>);

impl<K: Copy> Modify<K> for ResidAct<K> {
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
            network.visit_weights_mut("resid_act", &mut visit);
        }
    }

    #[inline(always)]
    fn settle<T: Real<K = K>>(&self, params: &Params<T>, state: &State<T>, memory: &mut [T]) {
        for (network, past) in self.0.iter().zip(memory.chunks_exact_mut(PAST)) {
            network.settle(params, state, past);
        }
    }

    #[inline(always)]
    fn torques<T: Real<K = K>>(
        &self,
        _settings: &Settings,
        params: &Params<T>,
        state: &State<T>,
        memory: &mut [T],
        drives: &mut [Drive<T>],
    ) {
        for (network, past) in self.0.iter().zip(memory.chunks_exact_mut(PAST)) {
            let drive = &mut drives[network.joint];
            let (torque, slope) = network.advance_with_slope(params, state, past);
            drive.torque = drive.torque + torque;
            // A torque that grows with velocity would damp less than nothing: it stays explicit.
            drive.resistance = drive.resistance + (-slope).max(T::zero());
        }
    }
}
