//! How soft a constraint's row is: from MuJoCo's `solref` and `solimp` to the step's numbers.

use crate::tree::{Impedance, TINY};
use crate::{PhysicsError, Settings};

/// Smallest and largest impedance (MuJoCo's `mjMINIMP`, `mjMAXIMP`).
const IMPEDANCE: [f64; 2] = [0.0001, 0.9999];
/// Largest power of an impedance curve: beyond it single precision overflows.
const MAX_POWER: f64 = 8.0;

/// An impedance curve from MuJoCo's `solimp`. `object` is named in errors.
///
/// # Errors
/// A power beyond what single precision can compute.
pub(crate) fn impedance<K>(
    solimp: &[f64; 5],
    k: impl Fn(f64) -> K,
    object: &str,
) -> Result<Impedance<K>, PhysicsError> {
    let clamp = |x: f64| x.clamp(IMPEDANCE[0], IMPEDANCE[1]);
    // MuJoCo bounds what it reads: both impedances and the midpoint, the width from 0 and the power from 1.
    let (dmin, dmax, width) = (clamp(solimp[0]), clamp(solimp[1]), solimp[2].max(0.0));
    let (midpoint, power) = (clamp(solimp[3]), solimp[4].max(1.0));
    // Without a rise or a width the curve is a constant: the mean of both ends, as in MuJoCo.
    if dmin == dmax || width <= TINY {
        let flat = 0.5 * (dmin + dmax);
        return Ok(Impedance {
            dmin: k(flat),
            rise: k(0.0),
            per_width: k(0.0),
            midpoint: k(0.5),
            power: 1,
            fraction: 0,
            low: k(1.0),
            high: k(1.0),
        });
    }
    if !(1.0..=MAX_POWER).contains(&power) {
        return Err(PhysicsError::ImpedancePower { object: object.to_owned(), power });
    }
    Ok(Impedance {
        dmin: k(dmin),
        rise: k(dmax - dmin),
        per_width: k(1.0 / width),
        midpoint: k(midpoint),
        power: power as u32,
        // As binary digits: each stands for a further square root of the base.
        fraction: (power.fract() * 2f64.powi(64)) as u64,
        low: k(1.0 / midpoint.powf(power - 1.0)),
        high: k(1.0 / (1.0 - midpoint).powf(power - 1.0)),
    })
}

/// Impedance at zero violation, as friction loss has it.
pub(crate) fn impedance_at_zero(solimp: &[f64; 5]) -> f64 {
    let clamp = |x: f64| x.clamp(IMPEDANCE[0], IMPEDANCE[1]);
    let (dmin, dmax) = (clamp(solimp[0]), clamp(solimp[1]));
    if solimp[2] <= TINY { 0.5 * (dmin + dmax) } else { dmin }
}

/// A row's stiffness k and damping b, and the factor on its D. Where velocities act `lead` later than at the step's
/// start, the residual J a + b v + k r becomes J a + b (v + lead · J a) + k r.
pub(crate) fn reference(solref: &[f64; 2], dmax: f64, settings: &Settings) -> (f64, f64, f64) {
    // MuJoCo bounds the time constant by its own timestep, which is the emulated one where a step emulates
    // another.
    let (k, b) = mujoco_reference(solref, dmax, settings.emulated_step.unwrap_or(settings.timestep));
    // A row reads the velocity v + lead · a. Solved for a, this divides k and b by the gain.
    let gain = 1.0 + b * settings.lead();
    (k / gain, b / gain, gain)
}

/// Stiffness and damping of MuJoCo's two reference formats.
fn mujoco_reference(solref: &[f64; 2], dmax: f64, timestep: f64) -> (f64, f64) {
    let dmax = dmax.clamp(IMPEDANCE[0], IMPEDANCE[1]);
    // A mixed format is replaced by the default, as MuJoCo does.
    let solref = if (solref[0] > 0.0) != (solref[1] > 0.0) { [0.02, 1.0] } else { *solref };
    if solref[0] > 0.0 {
        // Time constant and damping ratio. A time constant below two steps would be unstable (MuJoCo's
        // `refsafe`).
        let (time, ratio) = (solref[0].max(2.0 * timestep), solref[1]);
        (1.0 / (dmax * dmax * time * time * ratio * ratio).max(TINY), 2.0 / (dmax * time).max(TINY))
    } else {
        // Stiffness and damping themselves, with the opposite sign.
        (-solref[0] / (dmax * dmax).max(TINY), -solref[1] / dmax.max(TINY))
    }
}
