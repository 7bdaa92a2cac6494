//! Measures of a policy's motion itself, without a simulation.

use gaitfit_policy::Interface;
use gaitfit_policy::walker::Walker;

/// Length of the motion that a policy follows, s; `None` without one.
pub fn seconds(interface: &Interface) -> Option<f64> {
    let reference = interface.reference.as_ref()?;
    let last = reference.samples(interface.joints.len()).saturating_sub(1);
    Some(last as f64 / reference.rate_hz)
}

/// Distance from the motion of a robot that stays in its first pose, over so many seconds: mean over the control steps of the
/// root-mean-square over the joints, rad. `None` without a motion.
pub fn at_rest(walker: &Walker, seconds: f64) -> Option<f64> {
    let first = walker.observation.motion_position(0.0)?;
    let dt = walker.interface.control_dt;
    let steps = (seconds / dt).round().max(1.0) as u32;
    let off = |step: u32| {
        let pose = walker.observation.motion_position(f64::from(step) * dt).unwrap_or_default();
        let squares: f64 = pose.iter().zip(&first).map(|(a, b)| f64::from(a - b).powi(2)).sum();
        (squares / first.len().max(1) as f64).sqrt()
    };
    // At step 0 every robot is in the first pose, so the start does not count.
    Some((1..=steps).map(off).sum::<f64>() / f64::from(steps))
}
