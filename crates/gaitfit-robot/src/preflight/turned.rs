//! Rotations: mean orientations, angles between directions, and the axes that an inertial unit is turned by.

use gaitfit_model::rotation::{Quat, Vec3, cross, dot, from_axes, from_rpy, inverse, product, unit};

use super::Heard;

/// An orientation in double precision, of length 1; `None` if it is no orientation.
pub(super) fn orientation(quaternion: [f32; 4]) -> Option<Quat> {
    let wide = quaternion.map(f64::from);
    let length = wide.iter().map(|x| x * x).sum::<f64>().sqrt();
    // The guard refuses the same lengths (`OFF_UNIT`).
    (length.is_finite() && (length - 1.0).abs() < 0.05).then(|| wide.map(|x| x / length))
}

/// The mean of orientations that are near each other.
pub(super) fn mean_orientation(orientations: impl IntoIterator<Item = Quat>) -> Option<Quat> {
    let mut sum = [0.0f64; 4];
    for q in orientations {
        // q and −q are the same orientation: the one on the side of the sum is added.
        let along: f64 = sum.iter().zip(&q).map(|(a, b)| a * b).sum();
        let sign = if along < 0.0 { -1.0 } else { 1.0 };
        sum.iter_mut().zip(&q).for_each(|(sum, x)| *sum += sign * x);
    }
    let length = sum.iter().map(|x| x * x).sum::<f64>().sqrt();
    (length > 0.0).then(|| sum.map(|x| x / length))
}

/// The mean orientation of these states.
pub(super) fn mean_attitude(heard: &[Heard]) -> Option<Quat> {
    mean_orientation(heard.iter().filter_map(|one| orientation(one.state.quaternion)))
}

/// Roll, pitch and yaw, rad: R = Rz(yaw) Ry(pitch) Rx(roll).
pub(super) fn roll_pitch_yaw(q: Quat) -> [f64; 3] {
    let [w, x, y, z] = q;
    // Rounding may bring the sine beyond 1.
    let pitch = (2.0 * (w * y - z * x)).clamp(-1.0, 1.0).asin();
    let roll = (2.0 * (w * x + y * z)).atan2(1.0 - 2.0 * (x * x + y * y));
    let yaw = (2.0 * (w * z + x * y)).atan2(1.0 - 2.0 * (y * y + z * z));
    [roll, pitch, yaw]
}

/// Angle between two directions, rad; half a turn if one has no length.
pub(super) fn angle(a: Vec3, b: Vec3) -> f64 {
    match (unit(a), unit(b)) {
        (Some(a), Some(b)) => dot(cross(a, b), cross(a, b)).sqrt().atan2(dot(a, b)),
        _ => std::f64::consts::PI,
    }
}

/// The turn from one orientation to another as a vector in the body frame, rad.
pub(super) fn turn_between(from: Quat, to: Quat) -> Vec3 {
    let mut q = product(inverse(from), to);
    // q and −q are the same orientation: a positive q[0] gives the shorter turn.
    if q[0] < 0.0 {
        q = q.map(|x| -x);
    }
    let part = [q[1], q[2], q[3]];
    let sine = dot(part, part).sqrt();
    let angle = 2.0 * sine.atan2(q[0]);
    // For a smaller sine the direction of the axis is rounding.
    if sine > 1e-12 { part.map(|x| x * angle / sine) } else { [0.0; 3] }
}

/// The rotation whose axes are multiples of quarter turns and that is nearest to `q`, as roll, pitch and yaw in degrees, and
/// how far it is away, degrees.
pub(super) fn nearest_quarter_turns(q: Quat) -> ([f64; 3], f64) {
    let mut best = ([0.0; 3], f64::INFINITY);
    for yaw in [0.0, 90.0, -90.0, 180.0] {
        for pitch in [0.0, 90.0, -90.0] {
            for roll in [0.0, 90.0, -90.0, 180.0] {
                let angles = [roll, pitch, yaw];
                let [a, b, c] = angles.map(f64::to_radians);
                let turn = turn_between(from_rpy(a, b, c), q);
                let away = dot(turn, turn).sqrt().to_degrees();
                // At a pitch of ±90° several triples are the same rotation; rounding must not choose among them.
                if away < best.1 - 1e-6 {
                    best = (angles, away);
                }
            }
        }
    }
    best
}

/// How the unit is mounted if turns about the base's axes x, y and z read as `read`: the orientation of the unit's axes in the
/// base. `None` if these are not nearly at right angles.
pub(super) fn mounting(read: [Vec3; 3]) -> Option<Quat> {
    let [x, y, z] = [unit(read[0])?, unit(read[1])?, unit(read[2])?];
    // 0.7 rad is 40°: turns by hand are not pure, and from 45° on the nearest quarter turn is ambiguous.
    let square = angle(cross(x, y), z) < 0.7 && (angle(x, y) - std::f64::consts::FRAC_PI_2).abs() < 0.7;
    if !square {
        return None;
    }
    let z = unit(cross(x, y))?;
    let y = unit(cross(z, x))?;
    // Columns are the base's axes in the unit: the inverse is the unit in the base.
    Some(inverse(from_axes(x, y, z)))
}

/// An orientation that a constant rate changes for a time, body frame.
pub(super) fn advanced(q: Quat, rate: Vec3, seconds: f64) -> Quat {
    let speed = dot(rate, rate).sqrt();
    let half = 0.5 * speed * seconds;
    // At a speed of 0 this is the limit of sin(half) / speed.
    let part = if speed > 1e-12 { half.sin() / speed } else { 0.5 * seconds };
    product(q, [half.cos(), rate[0] * part, rate[1] * part, rate[2] * part])
}

/// Names of the nearest axis and its sign, such as `+x`.
pub(super) fn axis_name(v: Vec3) -> &'static str {
    let at = (0..3).max_by(|a, b| v[*a].abs().total_cmp(&v[*b].abs())).unwrap_or(0);
    match (at, v[at] < 0.0) {
        (0, false) => "+x",
        (0, true) => "−x",
        (1, false) => "+y",
        (1, true) => "−y",
        (_, false) => "+z",
        (_, true) => "−z",
    }
}

#[cfg(test)]
#[allow(clippy::unwrap_used, reason = "a failed unwrap is a failed test")]
mod tests {
    use super::*;
    use gaitfit_model::rotation::{axes, rotate};

    #[test]
    fn a_turned_unit_is_found_by_the_turns_that_it_reads() {
        for degrees in
            [[0.0, 0.0, 90.0], [180.0, 0.0, 0.0], [90.0, 0.0, 0.0], [0.0, -90.0, 0.0], [0.0, 0.0, 180.0]]
        {
            let [a, b, c] = degrees.map(f64::to_radians);
            let of_base = from_rpy(a, b, c);
            // What the unit reads of a turn about each axis of the base.
            let read = axes(inverse(of_base));
            let turn = mounting(read).unwrap();
            let away = turn_between(turn, of_base);
            assert!(dot(away, away).sqrt() < 1e-9, "{degrees:?}: {turn:?}");
            let (nearest, off) = nearest_quarter_turns(turn);
            assert!(off < 1e-6 && nearest == degrees, "{nearest:?} {degrees:?}");
            assert!(angle(rotate(turn, read[1]), [0.0, 1.0, 0.0]) < 1e-9);
        }
        assert_eq!(mounting([[1.0, 0.0, 0.0], [1.0, 0.1, 0.0], [0.0, 0.0, 1.0]]), None);
    }

    #[test]
    fn angles_come_back() {
        let q = from_rpy(0.1, -0.4, 2.0);
        let back = roll_pitch_yaw(q);
        assert!(back.iter().zip([0.1, -0.4, 2.0]).all(|(a, b)| (a - b).abs() < 1e-12), "{back:?}");
        let turned = advanced(q, [0.0, 0.3, 0.0], 2.0);
        let turn = turn_between(q, turned);
        assert!((turn[1] - 0.6).abs() < 1e-12 && turn[0].abs() < 1e-12, "{turn:?}");
        assert_eq!((axis_name([0.1, -0.9, 0.0]), axis_name([0.0, 0.0, 2.0])), ("−y", "+z"));
    }
}
