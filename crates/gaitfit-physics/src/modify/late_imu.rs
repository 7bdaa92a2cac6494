//! What an inertial unit whose readings arrive late reads.

use super::Modify;
use crate::{Drive, Owner, Params, Real, Settings, State};

/// Numbers of a reading: orientation of the base (wxyz) and its angular velocity (rad/s, body frame).
pub const IMU_READING: usize = 7;

/// The reading lies at most this many control periods back.
pub const IMU_PERIODS: usize = 2;

/// Numbers that belong to one reading: the reading itself, and the physics steps until it is taken.
const PART: usize = IMU_READING + 1;

/// Readings that are [`RobotParams::imu_delay`](crate::RobotParams) old. The motion does not depend on them.
///
/// A reading of age d is taken at the end of a control period. It equals the present state minus all changes of the last d
/// seconds, and these are summed while they happen: a physics step that ends n steps before the reading counts with the
/// part clamp(d / h − n, 0, 1) that lies within d, so the delay may be any part of a step h. The memory has this sum, the
/// reading minus the truth, for the reading at the end of this control period, then for the one at the end of the next.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct LateImu;

/// The numbers of a reading of the state as it is.
#[inline(always)]
fn truth<T: Real>(state: &State<T>) -> [T; IMU_READING] {
    let ([w, x, y, z], [a, b, c]) = (state.base_quaternion, state.base_angular);
    [w, x, y, z, a, b, c]
}

/// The part of the physics step that has begun which lies within the delay of a reading, `steps` physics steps after its start.
#[inline(always)]
fn share<T: Real>(settings: &Settings, params: &Params<T>, steps: T) -> T {
    let late = params.robot.imu_delay * T::lit(1.0 / settings.timestep);
    // `steps` counts from the start of the step. The n of the sum counts from its end, so n = steps − 1.
    (late + T::lit(1.0) - steps).clamp(T::zero(), T::lit(1.0))
}

// Zeros at the start: a robot that has stood still reads its state.
impl<K: Copy> Modify<K> for LateImu {
    fn memory(&self) -> usize {
        IMU_PERIODS * PART
    }

    fn memory_owner(&self, _place: usize) -> Owner {
        Owner::Base
    }

    /// The next reading becomes this one.
    #[inline(always)]
    fn targets<T: Real<K = K>>(
        &self,
        substeps: usize,
        _params: &Params<T>,
        _state: &State<T>,
        memory: &mut [T],
        _targets: &mut [T],
    ) {
        // The reading after the next moves up, and a new one begins behind it.
        for place in 0..memory.len() - PART {
            memory[place] = memory[place + PART];
        }
        for (period, part) in memory.chunks_exact_mut(PART).enumerate() {
            if period + 1 == IMU_PERIODS {
                part.fill(T::zero());
            }
            // Physics steps until the reading is taken; `release` counts them down.
            part[IMU_READING] = T::lit(((period + 1) * substeps) as f64);
        }
    }

    /// At the start of a physics step.
    #[inline(always)]
    fn torques<T: Real<K = K>>(
        &self,
        settings: &Settings,
        params: &Params<T>,
        state: &State<T>,
        memory: &mut [T],
        _drives: &mut [Drive<T>],
    ) {
        for part in memory.chunks_exact_mut(PART) {
            // The state before the step is added here, that after it taken off in `release`: minus the step's
            // change.
            let share = share(settings, params, part[IMU_READING]);
            for (sum, number) in part.iter_mut().zip(truth(state)) {
                *sum = share.fma(number, *sum);
            }
        }
    }

    /// At its end.
    #[inline(always)]
    fn release<T: Real<K = K>>(
        &self,
        settings: &Settings,
        params: &Params<T>,
        state: &mut State<T>,
        memory: &mut [T],
        _drives: &mut [Drive<T>],
    ) {
        for part in memory.chunks_exact_mut(PART) {
            let share = share(settings, params, part[IMU_READING]);
            for (sum, number) in part.iter_mut().zip(truth(state)) {
                *sum = share.fnma(number, *sum);
            }
            part[IMU_READING] = part[IMU_READING] - T::lit(1.0);
        }
    }
}
