//! Orientation from a gravity vector: roll and pitch follow from it, the heading from the rates.

use gaitfit_model::rotation::{Quat, from_rpy};

/// A gravity vector shorter than this has no direction: units are g or m/s².
const NO_DIRECTION: f64 = 0.1;

/// Orientations (w, x, y, z, base to world; `len × 4`) of a base that feels gravity in the directions `gravity` (`len × 3`,
/// base frame, (0, 0, −1) when upright, of any length). The heading begins at 0 and is integrated from `rates` (rad/s, base
/// frame, `len × 3`); without them it stays 0. Rows without a direction are NaN.
///
/// Roll and pitch of R = Rz(yaw)·Ry(pitch)·Rx(roll) are atan2(−g_y, −g_z) and asin(g_x); the heading changes by
/// (ω_y sin roll + ω_z cos roll) / cos pitch (Diebel 2006, "Representing Attitude", eq. 67 and 74).
pub fn orientation_of_gravity(time: &[f64], gravity: &[f64], rates: Option<&[f64]>) -> Vec<f64> {
    let mut out = Vec::with_capacity(4 * time.len());
    let (mut heading, mut before) = (0.0, None);
    for (sample, at) in time.iter().enumerate() {
        let Some(row) = gravity.get(3 * sample..3 * sample + 3) else { break };
        let length = row.iter().map(|x| x * x).sum::<f64>().sqrt();
        if !(length.is_finite() && length > NO_DIRECTION) {
            out.extend([f64::NAN; 4]);
            continue;
        }
        let [x, y, z] = [row[0] / length, row[1] / length, row[2] / length];
        // Rounding may bring x beyond 1.
        let (roll, pitch) = ((-y).atan2(-z), x.clamp(-1.0, 1.0).asin());
        let turn = rates.and_then(|rates| rates.get(3 * sample..3 * sample + 3)).map_or(0.0, |w| {
            // At a pitch of 90° the heading is not defined; the bound, 87°, keeps its rate finite there.
            let turn = (w[1] * roll.sin() + w[2] * roll.cos()) / pitch.cos().max(0.05);
            if turn.is_finite() { turn } else { 0.0 }
        });
        // Trapezoidal rule: rates are known at both ends of the step.
        if let Some((earlier, slower)) = before {
            let step: f64 = at - earlier;
            heading += 0.5 * (turn + slower) * step.max(0.0);
        }
        // Rows without a direction are stepped over; the rate before them is the last known one.
        before = Some((*at, turn));
        let q: Quat = from_rpy(roll, pitch, heading);
        out.extend(q);
    }
    out
}

#[cfg(test)]
mod tests {
    use super::*;
    use gaitfit_model::rotation::{normalize, product, quat_of, rotate_back, turn};

    /// A base that rolls, pitches and turns; gravity and rates as its sensors see them.
    #[test]
    fn the_orientation_is_that_of_the_base() {
        let step = 0.002;
        let time: Vec<f64> = (0..1500).map(|i| f64::from(i) * step).collect();
        let mut q = turn(2, 0.0);
        let (mut truth, mut gravity, mut rates) = (Vec::new(), Vec::new(), Vec::new());
        for t in &time {
            let w = [0.8 * (9.0 * t).cos(), 0.6 * (7.0 * t).sin(), 0.5];
            truth.push(q);
            gravity.extend(rotate_back(q, [0.0, 0.0, -9.81]));
            rates.extend(w);
            let half: [f64; 4] = [1.0, 0.5 * step * w[0], 0.5 * step * w[1], 0.5 * step * w[2]];
            q = normalize(product(q, half));
        }
        let orientation = orientation_of_gravity(&time, &gravity, Some(&rates));
        for (q, estimate) in truth.iter().zip(orientation.chunks_exact(4)) {
            let off: f64 = q.iter().zip(quat_of(estimate)).map(|(a, b)| a * b).sum::<f64>().abs();
            assert!(off > 0.99999, "{q:?} {estimate:?}");
        }
        // Without rates the heading is 0.
        let level = orientation_of_gravity(&[0.0, 1.0], &[0.0, 0.0, -1.0, 0.0, 0.0, 0.0], None);
        assert_eq!(level[..4], [1.0, 0.0, 0.0, 0.0]);
        assert!(level[4].is_nan());
    }
}
