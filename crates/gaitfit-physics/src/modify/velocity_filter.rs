//! Joint velocities as slow sensors read them.

use super::Modify;
use crate::{Drive, Owner, Params, Real, Settings, State};

/// A first-order low-pass filter of all joint velocities, with the time constant [`RobotParams::velocity_lag`](crate::RobotParams), advanced at every
/// physics step by backward Euler: f' = f + h / (lag + h) · (v' − f). Slow motions are read late by the time constant, whatever
/// the step h. It does not change the motion, because the PD controller has the true velocities. It remembers f − v, the
/// sensor's reading minus the true velocity, rad/s.
///
/// It must come after [`super::Gears`], because sensors are at the motors.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct VelocityFilter {
    /// Joints of the robot.
    pub joints: usize,
}

/// Velocity of a joint at the moment of the reading, which is the moment of PD control; see [`Settings::lead`].
#[inline(always)]
fn velocity<T: Real>(settings: &Settings, state: &State<T>, joint: usize) -> T {
    let lead = settings.drive_lead();
    if lead == 0.0 { state.qvel[joint] } else { T::lit(lead).fma(state.qacc[joint], state.qvel[joint]) }
}

// Zeros at the start: a robot that has moved evenly reads its velocity.
impl<K: Copy> Modify<K> for VelocityFilter {
    fn memory(&self) -> usize {
        self.joints
    }

    fn memory_owner(&self, place: usize) -> Owner {
        Owner::Joint(place)
    }

    /// At the start of a step: f in the place of f − v.
    #[inline(always)]
    fn torques<T: Real<K = K>>(
        &self,
        settings: &Settings,
        _params: &Params<T>,
        state: &State<T>,
        memory: &mut [T],
        _drives: &mut [Drive<T>],
    ) {
        for (j, reading) in memory.iter_mut().enumerate() {
            *reading = *reading + velocity(settings, state, j);
        }
    }

    /// At its end: f' − v' = lag / (lag + h) · (f − v').
    #[inline(always)]
    fn release<T: Real<K = K>>(
        &self,
        settings: &Settings,
        params: &Params<T>,
        state: &mut State<T>,
        memory: &mut [T],
        _drives: &mut [Drive<T>],
    ) {
        let lag = params.robot.velocity_lag;
        let kept = lag.div(lag + T::lit(settings.timestep));
        for (j, reading) in memory.iter_mut().enumerate() {
            *reading = kept * (*reading - velocity(settings, state, j));
        }
    }
}
