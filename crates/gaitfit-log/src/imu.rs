//! Cells of orientation and body rates that no inertial unit can have read and that would make nonsense of a fit.

/// A quaternion whose length is further from 1 is none; recorders that round to two digits stay below.
const OFF_UNIT: f64 = 0.02;
/// Largest roll or pitch, rad.
const MAX_ANGLE: f64 = 2.0 * std::f64::consts::PI;
/// Largest body rate, rad/s: gyros of robots end at a third of it.
const MAX_RATE: f64 = 200.0;
/// Largest body rate, °/s.
const MAX_DEGREES: f64 = 12_000.0;

const NOT_FINITE: &str =
    "no reading of an inertial unit; delete the row, or leave the cell empty where a sample was lost";

/// The first cell, by its place in the row's (w, x, y, z), that is no unit quaternion's, and why.
pub(crate) fn orientation(quaternion: &[f64]) -> Option<(usize, &'static str)> {
    if let Some(place) = infinite(quaternion) {
        return Some((place, NOT_FINITE));
    }
    let length = quaternion.iter().map(|x| x * x).sum::<f64>().sqrt();
    // A sample that was lost has NaN in it.
    ((length - 1.0).abs() > OFF_UNIT).then_some((
        0,
        "part of no rotation: the squares of w, x, y and z must sum to 1; record the quaternion as the inertial unit gives \
         it, w first, or delete the row",
    ))
}

/// The first of (roll, pitch, yaw) that cannot be, and why. Yaw may have been unwrapped.
pub(crate) fn angles(angles: &[f64]) -> Option<(usize, &'static str)> {
    let beyond = || angles.iter().take(2).position(|angle| angle.abs() > MAX_ANGLE.to_degrees());
    infinite(angles).map(|place| (place, NOT_FINITE)).or_else(|| Some((beyond()?, TOO_FAR)))
}

/// The first of (roll, pitch, yaw) that can be one in degrees only, and why.
pub(crate) fn far(angles: &[f64]) -> Option<(usize, &'static str)> {
    Some((angles.iter().take(2).position(|angle| angle.abs() > MAX_ANGLE)?, TOO_FAR))
}

const TOO_FAR: &str = "more than a full turn; give radians, or delete the row";

/// The first cell of a gravity vector that cannot be, and why.
pub(crate) fn gravity(vector: &[f64]) -> Option<(usize, &'static str)> {
    let length = vector.iter().map(|x| x * x).sum::<f64>().sqrt();
    infinite(vector).map(|place| (place, NOT_FINITE)).or_else(|| {
        // Room around 1 (g) and 9.81 (m/s²). A lost sample is NaN and passes.
        (!(0.1..20.0).contains(&length) && !length.is_nan()).then_some((
            0,
            "part of no gravity vector: its length must be 1 or 9.81; delete the row, or leave the cells empty where a sample \
             was lost",
        ))
    })
}

/// The first of the body rates that cannot be, and why.
pub(crate) fn rates(rates: &[f64]) -> Option<(usize, &'static str)> {
    let beyond = || rates.iter().position(|rate| rate.abs() > MAX_DEGREES);
    infinite(rates).map(|place| (place, NOT_FINITE)).or_else(|| Some((beyond()?, TOO_FAST)))
}

/// The first of the body rates that can be one in degrees per second only, and why.
pub(crate) fn fast(rates: &[f64]) -> Option<(usize, &'static str)> {
    Some((rates.iter().position(|rate| rate.abs() > MAX_RATE)?, TOO_FAST))
}

const TOO_FAST: &str = "beyond 200 rad/s, faster than any robot turns; give rad/s, or delete the row";

fn infinite(values: &[f64]) -> Option<usize> {
    values.iter().position(|value| value.is_infinite())
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn readings_pass_and_what_cannot_be_read_does_not() {
        let half = std::f64::consts::FRAC_1_SQRT_2;
        let rounded = [0.71, 0.0, -0.71, 0.0];
        for good in [[1.0, 0.0, 0.0, 0.0], [half, 0.0, -half, 0.0], rounded, [f64::NAN; 4]] {
            assert_eq!(orientation(&good), None, "{good:?}");
        }
        for bad in [[0.0; 4], [1.0, 1.0, 0.0, 0.0], [0.9, 0.0, 0.0, 0.0]] {
            assert_eq!(orientation(&bad).map(|(place, _)| place), Some(0), "{bad:?}");
        }
        assert_eq!(orientation(&[1.0, 0.0, f64::INFINITY, 0.0]), Some((2, NOT_FINITE)));
        assert_eq!(angles(&[-3.1, 1.5, 40.0]), None);
        assert_eq!(angles(&[0.1, -90.0, 0.0]), None);
        assert_eq!(angles(&[0.1, -900.0, 0.0]).map(|(place, _)| place), Some(1));
        assert_eq!(far(&[0.1, -90.0, 0.0]).map(|(place, _)| place), Some(1));
        assert_eq!(fast(&[0.0, 0.0, 250.0]).map(|(place, _)| place), Some(2));
        assert_eq!(rates(&[-35.0, 0.0, f64::NAN]), None);
        assert_eq!(rates(&[0.0, 0.0, 1e12]).map(|(place, _)| place), Some(2));
        assert_eq!(rates(&[f64::NEG_INFINITY, 0.0, 1e12]), Some((0, NOT_FINITE)));
    }
}
